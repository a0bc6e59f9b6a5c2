/* direction_linear.h: irradiance of a bent normal as a linear function of it: what engines' lightmaps hold.
 * Flow:    direction_form -> [direction_linear] -> directions of baked lightmaps
 * Threads: pure functions, [any].
 *
 * An engine multiplies a texel's irradiance by even + slope.m, m: the bent normal, n: the plain one. With the
 * source (w, d) and s of direction_form.h, and t = 1 - s / 2 where d.n > 0, else s / 2,
 *
 *     slope = (1 - w) / 2 n + w t d / max(lobe(n), 1/20)      even = 1 - slope.n
 *
 * Exact: E at the plain normal. An even hemisphere, at any m. direction_form.h, value and gradient at n; all
 * of it where d.m and d.n have the same sign and its factor lies in [0, 4], because it is linear there.
 * Lost: normals that turn away from the source, where direction_form.h stops at 0 and a line goes on below.
 * Lost: a lamp alone has even = 0. Engines divide by `even`, so slopes are cut to `ratio` times it. `k` keeps
 * E at the plain normal:
 *
 *     k = min(1, ratio / (|slope| + ratio slope.n))      slope' = k slope      even' = 1 - k slope.n
 *
 * A line with ratio 1 is never negative. A lamp of direction d gets (1 + ratio d.m) / (1 + ratio d.n), where
 * (d.m) / (d.n) is right. One luminance direction serves all channels: coloured directions are lost. */
#ifndef LW_COMMON_DIRECTION_LINEAR_H
#define LW_COMMON_DIRECTION_LINEAR_H

#include "common/light/direction_form.h"

/** E(m) / E(n) = even + slope.m, for unit m. */
struct lw_direction_linear {
    float even;           /* > 0 */
    struct lw_vec3 slope; /* at most ratio * even long */
};

/** The line of a source. n: unit, the plain normal; ratio: at least 1. */
static inline struct lw_direction_linear lw_direction_linear_of(const struct lw_direction_source *source,
                                                                struct lw_vec3 n, float ratio) {
    if (!source->known) return (struct lw_direction_linear){1, {0, 0, 0}}; /* as direction_form.h */
    const float wide = 0.5f * (1 - source->share), along = lw_vec3_dot(source->direction, n),
                steep = along > 0 ? 1 - 0.5f * wide : 0.5f * wide,
                share = source->share * steep / fmaxf(lw_direction_lobe(source, n), 0.05f);
    struct lw_vec3 slope =
        lw_vec3_mad(lw_vec3_scale(n, 0.5f * (1 - source->share)), source->direction, share);
    const float limit = lw_vec3_length(slope) + ratio * lw_vec3_dot(slope, n);
    if (limit > ratio) slope = lw_vec3_scale(slope, ratio / limit);
    return (struct lw_direction_linear){1 - lw_vec3_dot(slope, n), slope};
}

static inline float lw_direction_linear_factor(const struct lw_direction_linear *line, struct lw_vec3 m) {
    return line->even + lw_vec3_dot(line->slope, m);
}

#endif
