/* builtin_scenes.h: the builders behind builtin.c's table; each makes one scene.
 * Threads: [any], one scene per call. */
#ifndef LW_COMMON_BUILTIN_SCENES_H
#define LW_COMMON_BUILTIN_SCENES_H

#include "common/scene/scene.h"

LW_MUST_CHECK enum lw_status lw_builtin_cornell_build(struct lw_scene **out_scene, struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_builtin_ajar_build(struct lw_scene **out_scene, struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_builtin_atrium_build(struct lw_scene **out_scene, struct lw_error *err);
/** The same without finishes; both are called "atrium". */
LW_MUST_CHECK enum lw_status lw_builtin_atrium_matt_build(struct lw_scene **out_scene, struct lw_error *err);

/* Blocks along a side of the town; 6 by 6 are 4 million triangles, 32 by 32 below 2^27. */
#define LW_BUILTIN_CITY_BLOCKS_MIN     1u
#define LW_BUILTIN_CITY_BLOCKS_MAX     32u
#define LW_BUILTIN_CITY_BLOCKS_DEFAULT 6u
LW_MUST_CHECK enum lw_status lw_builtin_city_build(unsigned blocks, struct lw_scene **out_scene,
                                                   struct lw_error *err);

#endif
