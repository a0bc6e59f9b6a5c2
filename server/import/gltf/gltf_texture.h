/* gltf_texture.h: the pictures and textures of a document, decoded on first use, each once for each enum
 * lw_content that it is used as.
 * Threads: one set belongs to one document. */
#ifndef LW_IMPORT_GLTF_GLTF_TEXTURE_H
#define LW_IMPORT_GLTF_GLTF_TEXTURE_H

#include "common/scene/scene.h"
#include "server/import/gltf/gltf_document.h"
#include "server/import/tally.h"

#define LW_GLTF_CONTENTS 3 /* values of enum lw_content */

struct lw_gltf_image_slot {
    const uint8_t *texel[LW_GLTF_CONTENTS]; /* in the scene; NULL: not decoded yet */
    uint32_t width, height;
    bool unreadable;
};

/** A texture as a material names it. */
struct lw_gltf_texture_info {
    uint32_t texture; /* the document's; LW_SCENE_NONE: none, or one on a UV set that is not read */
    struct lw_texture_use place; /* its texture is LW_SCENE_NONE */
};

struct lw_gltf_textures {
    struct lw_gltf_document *document;
    struct lw_scene *scene;
    uint32_t *texture_of;        /* glTF texture -> scene texture, LW_SCENE_NONE before its first use */
    uint32_t finish_texture_max; /* room in the scene */
    struct lw_gltf_image_slot *image;
    struct lw_tally without_image; /* textures without one that is read, for each use */
    struct lw_tally odd_normals;   /* normal maps with many texels that are no normals */
};

/** finish() also after failure. finish_textures: the most that are added to those of finishes.
 * Errors: LW_BAD_DATA, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_init(struct lw_gltf_textures *textures,
                                                   struct lw_gltf_document *document, struct lw_scene *scene,
                                                   uint64_t finish_textures, struct lw_error *err);
void lw_gltf_textures_finish(struct lw_gltf_textures *textures);

/** An image as one content. *out is `unreadable` if a warning says so.
 * Errors: LW_BAD_DATA: wrong JSON; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_image(struct lw_gltf_textures *textures, uint32_t index,
                                                    enum lw_content content,
                                                    const struct lw_gltf_image_slot **out,
                                                    struct lw_error *err);

/** parent[key] as a textureInfo. Errors: LW_BAD_DATA that starts with the key. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_info(struct lw_gltf_textures *textures, const json_t *parent,
                                                   const char *key, struct lw_gltf_texture_info *out,
                                                   struct lw_error *err);

/** Sampler of a texture of the document: its wraps and name. *out_image: LW_SCENE_NONE: there is none
 * that is read, and a warning says so. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_sampler(struct lw_gltf_textures *textures, uint32_t index,
                                                      struct lw_texture *out, uint32_t *out_image,
                                                      struct lw_error *err);
/** The same with its picture as one content; rgba NULL: it cannot be read. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_sample(struct lw_gltf_textures *textures, uint32_t index,
                                                     enum lw_content content, struct lw_texture *out,
                                                     struct lw_error *err);

/** The use of parent[key] as a texture of the scene. *out_unreadable: there should be one, but it cannot be
 * read; then the use is untouched. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_use(struct lw_gltf_textures *textures, const json_t *parent,
                                                  const char *key, struct lw_texture_use *use,
                                                  bool *out_unreadable, struct lw_error *err);

/** The same of a texture of finishes. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_use_finish(struct lw_gltf_textures *textures,
                                                         const json_t *parent, const char *key,
                                                         enum lw_content content, struct lw_texture_use *use,
                                                         bool *out_unreadable, struct lw_error *err);

/** A texture of finishes, or the one that is there with the same texels and wraps.
 * Errors: LW_BAD_DATA: too many. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_add_finish(struct lw_gltf_textures *textures,
                                                         const struct lw_texture *texture, uint32_t *out,
                                                         struct lw_error *err);

/** Texels of the scene's for a picture that is made of others, counted. Errors: LW_BAD_DATA: past the limit;
 * LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_texels(struct lw_gltf_textures *textures, uint32_t width,
                                                     uint32_t height, uint8_t **out, struct lw_error *err);

/** Gives a texture the size and the texels of an image, which may be changed. *out_rgba NULL: it cannot be
 * read. */
LW_MUST_CHECK enum lw_status lw_gltf_textures_decode(struct lw_gltf_textures *textures, uint32_t image,
                                                     struct lw_texture *out, uint8_t **out_rgba,
                                                     struct lw_error *err);

#endif
