/* builtin_scenes.h: the builders behind builtin.c's table; each makes one scene.
 * Threads: [any], one scene per call. */
#ifndef LW_COMMON_BUILTIN_SCENES_H
#define LW_COMMON_BUILTIN_SCENES_H

#include "common/scene/scene.h"

LW_MUST_CHECK enum lw_status lw_builtin_cornell_build(struct lw_scene **out_scene, struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_builtin_atrium_build(struct lw_scene **out_scene, struct lw_error *err);

#endif
