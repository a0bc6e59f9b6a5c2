/* gltf_animation.h: the animations of a document become the channels of a scene. */
#ifndef LW_IMPORT_GLTF_GLTF_ANIMATION_H
#define LW_IMPORT_GLTF_GLTF_ANIMATION_H

#include "common/scene/scene.h"
#include "server/import/gltf/gltf_document.h"

#define LW_GLTF_KEYS_MAX (1u << 26) /* of all channels together */

/** Adds channels and the duration to a scene whose nodes are complete.
 * node_of  per glTF node: the scene's node, or LW_SCENE_NONE if it is not in the scene (then its channels
 *          are dropped)
 * Errors: LW_BAD_DATA that starts with "animations[N]"; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_animation_convert(struct lw_gltf_document *document,
                                                       const uint32_t *node_of, struct lw_scene *scene,
                                                       struct lw_error *err);

#endif
