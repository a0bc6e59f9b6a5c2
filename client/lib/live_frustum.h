/* live_frustum.h: whether a box of an object may lie in a view.
 * Threads: pure functions, [any]. */
#ifndef LIGHTWELL_LIVE_FRUSTUM_H
#define LIGHTWELL_LIVE_FRUSTUM_H

#include "client/include/lightwell/lightwell.h"
#include "common/base/vec.h"

#include <stdbool.h>

#define LW_LIVE_FRUSTUM_AROUND 0.15f /* beyond each edge, of half a side */

/** Object space. half.x < 0: nothing. */
struct lw_live_box {
    struct lw_vec3 middle, half;
};

/** value = dot(n, p) + d of a point p */
struct lw_live_linear {
    struct lw_vec3 n;
    float d;
};

/** A view in an object's space. A box lies beyond a side where its nearest corner is negative there. */
struct lw_live_frustum {
    struct lw_live_linear side[4],
        depth;     /* depth: clip space's w, which grows with the distance to the eye */
    float pixel_m; /* height of a pixel at depth 1, in object space; 0: not known */
};

/** Row r of view_projection times object_to_world: of clip coordinates x, y, z, w. */
struct lw_live_linear lw_live_frustum_row(const struct lw_live_view *view, int r,
                                          const struct lw_affine *object_to_world);
struct lw_live_frustum lw_live_frustum_of(const struct lw_live_view *view,
                                          const struct lw_affine *object_to_world);
/** Whether some of a box may lie in the view; then how near its nearest corner is. */
bool lw_live_frustum_meets(const struct lw_live_frustum *frustum, const struct lw_live_box *box,
                           float *out_depth);

#endif
