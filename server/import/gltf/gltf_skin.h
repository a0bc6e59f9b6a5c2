/* gltf_skin.h: a skin as it stands when nothing is animated: a matrix per joint, from the mesh's space into
 * world space. The place of the node that shows the mesh does not count.
 * Threads: a skin belongs to one thread. After: glTF 2.0, 3.7.3. */
#ifndef LW_IMPORT_GLTF_GLTF_SKIN_H
#define LW_IMPORT_GLTF_GLTF_SKIN_H

#include "common/scene/scene.h"
#include "server/import/gltf/gltf_document.h"

struct lw_gltf_skin {
    uint32_t joint_count;
    struct lw_affine *matrix; /* per joint: its node's place times its inverse bind matrix */
    uint32_t *joint;          /* glTF nodes */
};

/** Reads skin `index`. finish() also after failure.
 * node_of  glTF node -> node of the scene, or LW_SCENE_NONE
 * place    object to world, per node of the scene, at rest
 * Errors: LW_BAD_DATA that starts with "skins[N]"; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_skin_init(struct lw_gltf_skin *skin,
                                               const struct lw_gltf_document *document, uint32_t index,
                                               const uint32_t *node_of, const struct lw_affine *place,
                                               struct lw_error *err);
void lw_gltf_skin_finish(struct lw_gltf_skin *skin);

#endif
