#include "server/import/gltf/gltf.h"

#include "common/base/file_read.h"
#include "common/base/log.h"
#include "server/import/gltf/gltf_animation.h"
#include "server/import/gltf/gltf_image_light.h"
#include "server/import/gltf/gltf_node.h"

#include <stdlib.h>
#include <string.h>

static enum lw_status convert_parts(struct lw_gltf_document *document, struct lw_gltf_meshes *meshes,
                                    struct lw_scene *scene, uint32_t *node_of, struct lw_error *err) {
    if (lw_gltf_node_convert(document, meshes, scene, node_of, err) ||
        lw_gltf_animation_convert(document, node_of, scene, err) ||
        lw_gltf_image_light_convert(document, meshes->materials, scene, err))
        return err->status;
    if (meshes->builder.degenerate_count)
        lw_log(LW_LOG_WARNING, "%s: %llu triangles without area are left out", document->name,
               (unsigned long long)meshes->builder.degenerate_count);
    if (meshes->builder.bad_tangent_count)
        lw_log(LW_LOG_WARNING, "%s: %llu vertices have a TANGENT that is none: computed ones stand in",
               document->name, (unsigned long long)meshes->builder.bad_tangent_count);
    lw_tally_warn(&meshes->materials->textures.without_image, document->name,
                  "textures have no image in a format that is read; a colour stands in");
    lw_tally_warn(&meshes->materials->textures.odd_normals, document->name,
                  "normal maps have texels of no length, or that point into the surface: those are even, or "
                  "follow from x and y");
    lw_gltf_finishes_report(&meshes->materials->finishes);
    lw_tally_warn(&meshes->materials->bright, document->name, "base colours above 1 are lowered to 1");
    lw_tally_warn(&meshes->bright, document->name, "vertex colours above 1 are lowered to 1");
    if (scene->object_count == 0)
        return lw_status_fail(err, LW_BAD_DATA,
                              "has no triangles in its default scene: there is nothing to light");
    return lw_scene_validate(scene, err);
}

static enum lw_status convert(struct lw_gltf_document *document, struct lw_scene *scene, bool matt,
                              struct lw_error *err) {
    struct lw_gltf_materials materials;
    struct lw_gltf_meshes meshes;
    lw_gltf_meshes_init(&meshes, &materials);
    uint32_t *node_of = malloc((document->count[LW_GLTF_NODES] + 1ul) * sizeof *node_of);
    enum lw_status status = lw_gltf_materials_init(&materials, document, scene, matt, err);
    if (status == LW_OK && !node_of) status = lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (status == LW_OK) status = convert_parts(document, &meshes, scene, node_of, err);
    free(node_of);
    lw_gltf_meshes_finish(&meshes);
    lw_gltf_materials_finish(&materials);
    return status;
}

static enum lw_status load(struct lw_gltf_bytes bytes, const char *name, const char *folder,
                           const struct lw_gltf_options *options, struct lw_scene **out_scene,
                           struct lw_error *err) {
    struct lw_gltf_document document;
    struct lw_scene *scene = NULL;
    enum lw_status status = lw_gltf_document_init(&document, name, folder, bytes, err);
    if (status == LW_OK && (status = lw_scene_create(&scene)) != LW_OK)
        lw_status_fail(err, status, "out of memory");
    document.pictures.limit = options ? options->picture_texels : 0;
    if (status == LW_OK) status = convert(&document, scene, options && options->matt, err);
    lw_gltf_document_finish(&document);
    if (status) {
        lw_scene_destroy(scene);
        return status;
    }
    *out_scene = scene;
    return LW_OK;
}

/* Ends a load: the error starts with the file's name. */
static enum lw_status name_error(enum lw_status status, const char *name, const struct lw_error *own,
                                 struct lw_error *err) {
    if (status == LW_OK) return LW_OK;
    struct lw_error named = *own;
    lw_status_context(&named, "%s", name);
    return lw_status_fail(err, named.status, "%s", named.text);
}

enum lw_status lw_gltf_load_bytes(const uint8_t *bytes, size_t size, const char *name,
                                  const struct lw_gltf_options *options, struct lw_scene **out_scene,
                                  struct lw_error *err) {
    struct lw_error own = {0};
    enum lw_status status = load((struct lw_gltf_bytes){bytes, size}, name, NULL, options, out_scene, &own);
    return name_error(status, name, &own, err);
}

enum lw_status lw_gltf_load_memory(const uint8_t *bytes, size_t size, const char *name,
                                   struct lw_scene **out_scene, struct lw_error *err) {
    return lw_gltf_load_bytes(bytes, size, name, NULL, out_scene, err);
}

static char *folder_of(const char *path) {
    const char *slash = strrchr(path, '/');
    if (!slash) return strdup(".");
    return slash == path ? strdup("/") : strndup(path, (size_t)(slash - path));
}

enum lw_status lw_gltf_load(const char *path, const struct lw_gltf_options *options,
                            struct lw_scene **out_scene, struct lw_error *err) {
    struct lw_error own = {0};
    struct lw_gltf_bytes bytes = {0};
    uint8_t *storage = NULL;
    char *folder = folder_of(path);
    enum lw_status status = folder ? LW_OK : lw_status_fail(&own, LW_NO_MEMORY, "out of memory");
    if (status == LW_OK)
        status = lw_file_read(path, LW_GLTF_FILE_SIZE_MAX, true, &storage, &bytes.size, &own);
    bytes.data = storage;
    if (status == LW_OK) status = load(bytes, path, folder, options, out_scene, &own);
    free(storage);
    free(folder);
    return name_error(status, path, &own, err);
}
