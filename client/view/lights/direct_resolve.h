/* direct_resolve.h: the share of a light that each pixel sees, of the rays around it.
 * Flow:    rays of a tile -> [direct_resolve] -> shares -> e and mirrored of its blocks
 * Threads: any worker. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_RESOLVE_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_RESOLVE_H

#include "client/view/lights/direct_private.h"

/** Adds a share of the light at hand to a block. */
void lw_direct_resolve_add(const struct lw_direct_job *job, uint32_t b, const float share[LW_DIRECT_LANES],
                           struct lw_vec3 colour);

/** Adds the light at hand to all blocks. In a penumbra of several pixels a pixel has the mean of its
 * neighbours. */
void lw_direct_resolve_tile(const struct lw_direct_job *job);

#endif
