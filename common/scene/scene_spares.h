/* scene_spares.h: room for objects that may be added while a scene is lit.
 * Flow:    scene with lightmap UVs -> [spares] -> package, atlases
 *
 * Atlases, tile numbers and the package that clients get are fixed once a scene is loaded. So objects that
 * may be added exist from the start as spares: invisible objects without a node (scene.h). A spare costs the
 * memory of its atlas, and no ray. */
#ifndef LW_COMMON_SCENE_SPARES_H
#define LW_COMMON_SCENE_SPARES_H

#include "common/scene/scene.h"

#define LW_SCENE_SPARES_MAX 65536u /* per mesh */

/** Adds spares to a scene, behind its objects, mesh by mesh. A mesh's spares are called by its name, "#" and
 * a number from 1.
 * text    "vase=4,chair=2": 4 spares of mesh vase, 2 of chair. "#3=2": 2 of mesh number 3. "1": one of every
 *         mesh. For the same mesh the last entry counts: "1,hall=0" is one of every mesh except hall
 * Errors: LW_USAGE with the wrong part of the text; LW_BAD_DATA if the scene grows past a limit;
 * LW_NO_MEMORY. The scene is as before. */
LW_MUST_CHECK enum lw_status lw_scene_spares_add(struct lw_scene *scene, const char *text,
                                                 struct lw_error *err);

#endif
