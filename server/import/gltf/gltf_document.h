/* gltf_document.h: a glTF document with its buffers: container, JSON, URIs, buffer views, warnings.
 * Threads: a document belongs to one thread.
 * err is never NULL here. Errors start with the element ("bufferViews[3]: ..."); the caller adds the file's
 * name. */
#ifndef LW_IMPORT_GLTF_GLTF_DOCUMENT_H
#define LW_IMPORT_GLTF_GLTF_DOCUMENT_H

#include "server/import/gltf/gltf_json.h"
#include "server/import/images/image_file.h"

#include <stdint.h>

/* Limits on a file. */
#define LW_GLTF_FILE_SIZE_MAX    (4ull << 30)   /* bytes of a .glb or .gltf, and of one buffer */
#define LW_GLTF_JSON_SIZE_MAX    (128ull << 20) /* bytes; nesting is bounded by jansson (2048) */
#define LW_GLTF_BUFFERS_SIZE_MAX (8ull << 30)   /* bytes of all buffers together */
#define LW_GLTF_URI_LENGTH_MAX   2048u          /* bytes of a URI that names a file */

/* The lists of a document: name in C, name in JSON. */
#define LW_GLTF_LIST_MAP(X)                                                                                  \
    X(ACCESSORS, "accessors")                                                                                \
    X(ANIMATIONS, "animations")                                                                              \
    X(BUFFERS, "buffers")                                                                                    \
    X(BUFFER_VIEWS, "bufferViews")                                                                           \
    X(CAMERAS, "cameras")                                                                                    \
    X(IMAGES, "images")                                                                                      \
    X(LIGHTS, "extensions.KHR_lights_punctual.lights")                                                       \
    X(MATERIALS, "materials")                                                                                \
    X(MESHES, "meshes")                                                                                      \
    X(NODES, "nodes")                                                                                        \
    X(SAMPLERS, "samplers")                                                                                  \
    X(SCENES, "scenes")                                                                                      \
    X(SKINS, "skins")                                                                                        \
    X(TEXTURES, "textures")

enum lw_gltf_list {
#define X(name, key) LW_GLTF_##name,
    LW_GLTF_LIST_MAP(X)
#undef X
        LW_GLTF_LIST_COUNT
};

/* Ignored features; one warning each per file. */
#define LW_GLTF_WARNING_MAP(X)                                                                               \
    X(SKIN, "skins are not animated: skinned meshes keep their rest pose")                                   \
    X(TRANSMISSION, "transmission by a texture is ignored: such materials stay as opaque as they are")       \
    X(TINT, "light that bounces through coloured transmission keeps its brightness and loses its colour")    \
    X(IMAGE_LIGHT, "an image-based light whose pictures cannot be read is left out")                         \
    X(POINTS, "points and lines are ignored: only triangles are lit")                                        \
    X(LIGHT_RANGE, "the range of lights is ignored: light falls off with the square of distance")            \
    X(CONES, "a spot's innerConeAngle is not less than its outerConeAngle: its edge is taken as hard")       \
    X(UV_SET, "textures that use TEXCOORD_2 or higher are ignored")                                          \
    X(UV_MISSING,                                                                                            \
      "a material has a texture for which its primitive has no texture coordinates: (0, 0) is used")         \
    X(CHANNEL_WEIGHTS, "morph weights are not animated: meshes keep those they have at rest")                \
    X(CHANNEL_OTHER,                                                                                         \
      "animation channels other than places of nodes, intensities and colours of lights are ignored")        \
    X(CHANNEL_TWICE, "several animations move the same node: the first one counts")

enum lw_gltf_warning {
#define X(name, text) LW_GLTF_WARN_##name,
    LW_GLTF_WARNING_MAP(X)
#undef X
        LW_GLTF_WARNING_COUNT
};

struct lw_gltf_bytes {
    const uint8_t *data;
    size_t size;
};

struct lw_gltf_buffer_view {
    struct lw_gltf_bytes bytes;
    size_t stride; /* bytes; 0: tightly packed */
};

struct lw_gltf_document {
    const char *name; /* the file's, for messages */
    char *folder;     /* NULL: the document may name no file */
    json_t *root;
    const json_t *list[LW_GLTF_LIST_COUNT]; /* arrays of objects, or NULL */
    uint32_t count[LW_GLTF_LIST_COUNT];
    struct lw_gltf_bytes binary;  /* BIN chunk of a .glb */
    struct lw_gltf_bytes *buffer; /* one per buffer; data is NULL if views of it are compressed elsewhere */
    uint8_t **buffer_storage;     /* what of them we allocated */
    struct lw_gltf_buffer_view *view;
    uint8_t **view_storage; /* compressed views' */
    bool *moves_skin;       /* per node: its place is part of a skin's; NULL before nodes are read */
    uint32_t *light_of;     /* per scene light: its light of KHR_lights_punctual; NULL likewise */
    bool quantized;         /* KHR_mesh_quantization is in use */
    uint32_t warned;        /* bit per enum lw_gltf_warning */
    struct lw_image_file_budget pictures;
};

/** Opens a document in memory; `bytes` must outlive it. finish() also after failure. */
LW_MUST_CHECK enum lw_status lw_gltf_document_init(struct lw_gltf_document *document, const char *name,
                                                   const char *folder, struct lw_gltf_bytes bytes,
                                                   struct lw_error *err);
void lw_gltf_document_finish(struct lw_gltf_document *document);

/** Element of a list; index < count[list]. */
const json_t *lw_gltf_document_item(const struct lw_gltf_document *document, enum lw_gltf_list list,
                                    uint32_t index);

/** object[key] as an index into a list; *out untouched if absent. */
LW_MUST_CHECK enum lw_status lw_gltf_document_index(const struct lw_gltf_document *document,
                                                    const json_t *object, const char *key,
                                                    enum lw_gltf_list list, uint32_t *out,
                                                    struct lw_error *err);

/** The bytes behind a URI: data: or a file in the document's folder. *out_storage is malloc'ed.
 * size_min: a file that is shorter is an error; size_max: no more is read (files) or allowed (data).
 * whole: a file longer than size_max is an error too.
 * Errors: LW_BAD_DATA if the URI is wrong or leaves the folder, or too few bytes are there; LW_NO_INPUT if
 * what it names cannot be read; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_document_fetch(const struct lw_gltf_document *document, const char *uri,
                                                    uint64_t size_min, uint64_t size_max, bool whole,
                                                    uint8_t **out_storage, size_t *out_size,
                                                    struct lw_error *err);

void lw_gltf_document_warn(struct lw_gltf_document *document, enum lw_gltf_warning warning);

#endif
