/* new_root.h: puts one transform above a whole scene: another unit, other axes. */
#ifndef LW_IMPORT_NEW_ROOT_H
#define LW_IMPORT_NEW_ROOT_H

#include "common/scene/scene.h"

/** Adds a root above all nodes of the scene. Quantities per area or angle (radiance, intensity) stay
 * as they are.
 * Errors: LW_BAD_DATA (one node too many), LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_new_root_add(struct lw_scene *scene, const char *name,
                                             const struct lw_affine *place, struct lw_error *err);

#endif
