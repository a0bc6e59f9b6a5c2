/* gltf_material.h: materials and the textures they use, converted on first use, each once.
 * Threads: one set belongs to one document. */
#ifndef LW_IMPORT_GLTF_GLTF_MATERIAL_H
#define LW_IMPORT_GLTF_GLTF_MATERIAL_H

#include "common/scene/scene.h"
#include "server/import/gltf/gltf_finish.h"
#include "server/import/gltf/gltf_texture.h"

struct lw_gltf_materials {
    struct lw_gltf_document *document;
    struct lw_scene *scene;
    /* glTF material -> scene material, LW_SCENE_NONE before its first use; one more entry for the default
     * material */
    uint32_t *material_of;
    bool matt; /* no finishes */
    struct lw_gltf_textures textures;
    struct lw_gltf_finishes finishes;
    struct lw_tally bright; /* materials whose base colour is above 1 */
};

/** matt: materials have no finishes. finish() also after failure. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_materials_init(struct lw_gltf_materials *materials,
                                                    struct lw_gltf_document *document, struct lw_scene *scene,
                                                    bool matt, struct lw_error *err);
void lw_gltf_materials_finish(struct lw_gltf_materials *materials);

/** The scene's material for a glTF material, or for the default one if index is LW_SCENE_NONE. */
LW_MUST_CHECK enum lw_status lw_gltf_materials_get(struct lw_gltf_materials *materials, uint32_t index,
                                                   uint32_t *out_material, struct lw_error *err);

#endif
