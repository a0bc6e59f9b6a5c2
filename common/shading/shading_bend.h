/* shading_bend.h: a bumped normal, bent so that it mirrors light from above the surface to the eye.
 * Threads: pure functions, [any].
 *
 * A normal map may turn a normal away from the eye, or so far that the mirrored direction lies below the
 * surface. Both would be black. With the surface's own normal ng, the direction to the eye v, and r the
 * mirror image of v at n:
 *
 *     t = min(0.9 ng.v, 0.01)
 *     n stays where n.v > 0 and r.ng >= t; else r is lifted along ng until r.ng = t, and
 *     n = (v + r) / |v + r|
 *
 * so that n.v > 0 always. All shaders of normal maps use it. Light from below ng counts as none. */
#ifndef LW_COMMON_SHADING_BEND_H
#define LW_COMMON_SHADING_BEND_H

#include "common/base/vec.h"

/* Smoothed normals may turn away from the eye at an outline: there ng counts as seen under this cosine. */
#define LW_SHADING_BEND_SEEN_MIN 1e-3f

/** n: the bumped normal. ng: the surface's normal without its bumps. v: to the eye. All unit. Unit. */
static inline struct lw_vec3 lw_shading_bend(struct lw_vec3 n, struct lw_vec3 ng, struct lw_vec3 v) {
    float seen = lw_vec3_dot(ng, v);
    if (seen < LW_SHADING_BEND_SEEN_MIN) {
        ng = lw_vec3_normalize(lw_vec3_mad(ng, v, LW_SHADING_BEND_SEEN_MIN - seen));
        seen = lw_vec3_dot(ng, v);
    }
    const float t = fminf(0.9f * seen, 0.01f), facing = lw_vec3_dot(n, v);
    struct lw_vec3 r = lw_vec3_sub(lw_vec3_scale(n, 2 * facing), v);
    const float above = lw_vec3_dot(r, ng);
    if (facing > 0 && above >= t) return n;
    r = lw_vec3_normalize(lw_vec3_mad(r, ng, fmaxf(t - above, 0)));
    const struct lw_vec3 half = lw_vec3_add(v, r);
    return lw_vec3_length(half) > 1e-6f ? lw_vec3_normalize(half) : ng;
}

#endif
