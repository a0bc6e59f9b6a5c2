/* lightmap_density.h: how much finer or coarser the lightmaps of some objects are than the others.
 * Flow:    --density-of -> [density] -> lightmap
 * Threads: pure functions; [any]. */
#ifndef LW_COMMON_LIGHTMAP_DENSITY_H
#define LW_COMMON_LIGHTMAP_DENSITY_H

#include "common/base/status.h"
#include "common/scene/scene.h"

/* Multiples of texels per metre; 8 a side are 64 times the texels. */
#define LW_LIGHTMAP_FACTOR_MIN (1.0 / 64)
#define LW_LIGHTMAP_FACTOR_MAX 8.0

/** text "NAME=FACTOR,...": a name holds for all objects that have it; NULL: none
 *  out_factor  per mesh of the scene: the largest factor of its objects; 1 where none is named
 *  Errors: LW_USAGE for a name that no object has, a part without "=", or a factor out of bounds. */
LW_MUST_CHECK enum lw_status lw_lightmap_density_read(const char *text, const struct lw_scene *scene,
                                                      float *out_factor, struct lw_error *err);

#endif
