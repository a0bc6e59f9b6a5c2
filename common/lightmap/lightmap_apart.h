/* lightmap_apart.h: keeps parts of a chart that are apart in space apart in the plane.
 * Flow:    [apart] serves charts while they grow and merge
 * Threads: one belongs to one thread.
 *
 * A bilinear lookup reads texels up to one texel away. Two arms of a chart that come near without touching
 * would read the same texels, and each would show light of both places. */
#ifndef LW_COMMON_LIGHTMAP_APART_H
#define LW_COMMON_LIGHTMAP_APART_H

#include "common/base/status.h"
#include "common/base/vec.h"

#include <stdint.h>

struct lw_lightmap_apart;

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_apart_create(struct lw_lightmap_apart **out_apart);
void lw_lightmap_apart_destroy(struct lw_lightmap_apart *apart);
/** Takes all triangles away; costs nothing. */
void lw_lightmap_apart_clear(struct lw_lightmap_apart *apart);

/** corner  in the chart
 * place    in space; both in texels
 * Errors   LW_NO_MEMORY */
LW_MUST_CHECK enum lw_status lw_lightmap_apart_add(struct lw_lightmap_apart *apart,
                                                   const struct lw_vec2 corner[3],
                                                   const struct lw_vec3 place[3]);
/** Whether a triangle would come within reach of another that is far from it in space. The two must not
 * overlap. */
bool lw_lightmap_apart_mixes(const struct lw_lightmap_apart *apart, const struct lw_vec2 corner[3],
                             const struct lw_vec3 place[3]);

#endif
