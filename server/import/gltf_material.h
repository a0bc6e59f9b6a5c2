/* gltf_material.h: materials and the textures they use, converted on first use, each once.
 * Threads: one set belongs to one document. */
#ifndef LW_IMPORT_GLTF_MATERIAL_H
#define LW_IMPORT_GLTF_MATERIAL_H

#include "common/scene/scene.h"
#include "server/import/gltf_document.h"
#include "server/import/tally.h"

struct lw_gltf_image_slot {
    const uint8_t *rgba; /* in the scene; NULL: not decoded yet */
    uint32_t width, height;
    bool unreadable;
};

struct lw_gltf_materials {
    struct lw_gltf_document *document;
    struct lw_scene *scene;
    /* glTF material -> scene material, LW_SCENE_NONE before its first use; one more entry for the default
     * material */
    uint32_t *material_of;
    uint32_t *texture_of; /* glTF texture -> scene texture */
    struct lw_gltf_image_slot *image;
    struct lw_tally without_image; /* textures without one that is read, for each use */
    struct lw_tally bright;        /* materials whose base colour is above 1 */
};

/** finish() also after failure. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_materials_init(struct lw_gltf_materials *materials,
                                                    struct lw_gltf_document *document, struct lw_scene *scene,
                                                    struct lw_error *err);
void lw_gltf_materials_finish(struct lw_gltf_materials *materials);

/** An image, decoded on first use. *out is `unreadable` if that has been told instead.
 * Errors: LW_BAD_DATA: wrong JSON; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_materials_image(struct lw_gltf_materials *materials, uint32_t index,
                                                     const struct lw_gltf_image_slot **out,
                                                     struct lw_error *err);

/** The scene's material for a glTF material, or for the default one if index is LW_SCENE_NONE. */
LW_MUST_CHECK enum lw_status lw_gltf_materials_get(struct lw_gltf_materials *materials, uint32_t index,
                                                   uint32_t *out_material, struct lw_error *err);

#endif
