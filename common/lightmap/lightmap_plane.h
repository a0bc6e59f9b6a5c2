/* lightmap_plane.h: the triangles of one chart in its plane; tests whether a new triangle would overlap them.
 * Flow:    [plane] serves charts while they grow and merge
 * Threads: a plane belongs to one thread. */
#ifndef LW_COMMON_LIGHTMAP_PLANE_H
#define LW_COMMON_LIGHTMAP_PLANE_H

#include "common/base/status.h"
#include "common/base/vec.h"

#include <stdint.h>

struct lw_lightmap_plane;

/** A plane for at most triangle_capacity triangles at a time. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_plane_create(uint32_t triangle_capacity,
                                                      struct lw_lightmap_plane **out_plane);
void lw_lightmap_plane_destroy(struct lw_lightmap_plane *plane);
/** Takes all triangles away; costs nothing. */
void lw_lightmap_plane_clear(struct lw_lightmap_plane *plane);
/** corner  counter-clockwise */
void lw_lightmap_plane_add(struct lw_lightmap_plane *plane, const struct lw_vec2 corner[3]);
/** Whether a triangle would lie on one that is there by more than a hundredth of a texel; also true where so
 * many are near that comparing with all of them takes too long. */
bool lw_lightmap_plane_overlaps(struct lw_lightmap_plane *plane, const struct lw_vec2 corner[3]);

#endif
