/* direction_form.h: irradiance of a bent normal, from the irradiance of the plain one and its cosine moment.
 * Flow:    solve -> tiles -> [direction_form] -> shading
 * Threads: pure functions, [any].
 *
 * Beside E, a tile holds the cosine moment of the same light, by luminance:
 *
 *     E = integral of L (n.w) dw      V = integral of L (n.w) w dw, r = V / E
 *
 * both over the hemisphere about n. Cosine-weighted rays give both with the same bounded weight. |r| <= 1,
 * and n.r >= 0. An even hemisphere has r = 2/3 n, a single source of direction d has r = d. So light with
 * this r is modelled as an even part and one source. The source's share w of E, and its direction d, follow:
 *
 *     u = r - 2/3 n      w = 6/5 (n.u) + sqrt((6/5 n.u)^2 + 9/5 |u|^2)      d = u / w + 2/3 n
 *
 * A weak source is taken to be wide: s = (1 - w) / 2, lobe(m) = (1 - s) max(0, d.m) + s (1 + d.m) / 2. Then
 *
 *     E(m) / E(n) = 1 + (1 - w) n.(m - n) / 2 + w (lobe(m) - lobe(n)) / max(lobe(n), 1/20), in [0, 4]
 *
 * which is 1, to the bit, where m = n. Where r is short, the direction is not known: no tile has come, or the
 * texel has no light. Then this is 1 for any m, and a mirror sees E/pi. Else a mirror of GGX width alpha sees
 * E/pi of the even part, and the source as a spherical Gaussian, blurred by the mirror's lobe, that brings
 * its share of E:
 *
 *     l = 2 + 12 w / (1.02 - w)       k = l q / (l + q), q = 1 / (2 alpha^2)
 *     L(m) pi / E = 1 - w + w k exp(k (m.d - 1)) / (2 c (1 - exp(-2 k)))
 *     c = (h + sqrt(h^2 + 1 / (4 + k pi/2))) / 2, h = (coth k - 1 / k) n.d
 *
 * c is about the integral of that Gaussian times the cosine above the surface: h is the integral over both
 * sides, and n.d = 0 has the limits 1/4 of k = 0 and 1 / sqrt(2 pi k). So white mirrors send back as much as
 * arrives.
 *
 * docs/lab/direction.md compares both with other forms. After: Hazel 2015 (Geomerics; a direction beside E),
 * Wang et al. 2009 (lobes as spherical Gaussians). */
#ifndef LW_COMMON_DIRECTION_FORM_H
#define LW_COMMON_DIRECTION_FORM_H

#include "common/base/colour.h"
#include "common/base/vec.h"

#include <stdbool.h>

#define LW_DIRECTION_FACTOR_MAX 4.0f
#define LW_DIRECTION_GAIN_MAX   8.0f
/* The least luminance that has a direction, W/m^2. */
#define LW_DIRECTION_LIGHT_MIN 1e-30f
/* The length of r under an even hemisphere. */
#define LW_DIRECTION_EVEN (2.0f / 3)
/* A shorter r says nothing. So a look-up between texels, and 10 bits a number, need not give 0 exactly. */
#define LW_DIRECTION_SHORT 0.02f

/** r of a texel: the cosine moment over the luminance of its light; 0 where there is none. Each number is
 * within -1 to 1, for any input. */
static inline struct lw_vec3 lw_direction_of(const float moment[3], const float light[3]) {
    const float luminance = lw_colour_luminance(lw_vec3(light[0], light[1], light[2]));
    float r[3] = {0};
    const bool lit = luminance >= LW_DIRECTION_LIGHT_MIN && luminance < INFINITY;
    for (int k = 0; lit && k < 3; k++)
        if (isfinite(moment[k])) r[k] = fminf(fmaxf(moment[k] / luminance, -1), 1);
    return lw_vec3(r[0], r[1], r[2]);
}

/** The source in light that is otherwise even. */
struct lw_direction_source {
    struct lw_vec3 direction; /* unit, towards it */
    float share;              /* its part of E at the plain normal, 0 to 1 */
    bool known;               /* false: share is 0, and E of every normal is that of the plain one */
};

/** Any r gives a source: too long a one is shortened, one below the surface is put on it, and one that is
 * short or no number is not known. n: unit. */
static inline struct lw_direction_source lw_direction_source_of(struct lw_vec3 r, struct lw_vec3 n) {
    const float length2 = lw_vec3_dot(r, r);
    if (!(length2 > LW_DIRECTION_SHORT * LW_DIRECTION_SHORT && length2 < INFINITY))
        return (struct lw_direction_source){n, 0, false};
    if (length2 > 1) r = lw_vec3_scale(r, 1 / sqrtf(length2));
    r = lw_vec3_mad(r, n, fmaxf(-lw_vec3_dot(r, n), 0));
    const struct lw_vec3 u = lw_vec3_mad(r, n, -LW_DIRECTION_EVEN);
    const float up = 1.2f * lw_vec3_dot(u, n), w = fminf(up + sqrtf(up * up + 1.8f * lw_vec3_dot(u, u)), 1);
    if (!(w > LW_DIRECTION_SHORT)) return (struct lw_direction_source){n, 0, true};
    return (struct lw_direction_source){
        lw_vec3_normalize(lw_vec3_mad(lw_vec3_scale(u, 1 / w), n, LW_DIRECTION_EVEN)), w, true};
}

static inline float lw_direction_lobe(const struct lw_direction_source *source, struct lw_vec3 m) {
    const float wide = 0.5f * (1 - source->share), along = lw_vec3_dot(source->direction, m);
    return (1 - wide) * fmaxf(along, 0) + wide * 0.5f * (1 + along);
}

/** E of normal m over that of the plain normal n; both unit. 1 where the direction is not known. */
static inline float lw_direction_factor(const struct lw_direction_source *source, struct lw_vec3 n,
                                        struct lw_vec3 m) {
    if (!source->known) return 1;
    const float even = lw_vec3_dot(n, lw_vec3_sub(m, n)), own = lw_direction_lobe(source, n);
    const float factor = 1 + 0.5f * (1 - source->share) * even +
                         source->share * (lw_direction_lobe(source, m) - own) / fmaxf(own, 0.05f);
    return fminf(fmaxf(factor, 0), LW_DIRECTION_FACTOR_MAX);
}

/** Radiance that a mirror shows of the light, over E/pi, at most LW_DIRECTION_GAIN_MAX. 1 where the direction
 * is not known.
 * mirrored  unit: where the mirror's lobe points
 * alpha     its GGX width, roughness squared; > 0 */
static inline float lw_direction_gain(const struct lw_direction_source *source, struct lw_vec3 n,
                                      struct lw_vec3 mirrored, float alpha) {
    const float w = source->share, sharp = 2 + 12 * w / (1.02f - w), q = 0.5f / (alpha * alpha),
                k = sharp * q / (sharp + q), behind = expf(-2 * k);
    const float high = ((1 + behind) / (1 - behind) - 1 / k) * lw_vec3_dot(source->direction, n);
    const float cosine = fmaxf(0.5f * (high + sqrtf(high * high + 1 / (4 + 0.5f * LW_PI * k))), 0.05f);
    const float lobe =
        k * expf(k * (lw_vec3_dot(mirrored, source->direction) - 1)) / (2 * cosine * (1 - behind));
    return fminf(1 - w + w * lobe, LW_DIRECTION_GAIN_MAX);
}

#endif
