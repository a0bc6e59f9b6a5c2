/* microfacets.h: the arithmetic of a rough mirror: GGX facets, height-correlated Smith masking, Schlick's
 * Fresnel. Directions are in the surface's frame, the normal is +z; they point away from the surface.
 * Threads: pure functions, [any].
 * After:   Walter et al. 2007; Heitz 2014 (masking); Dupuy and Benyoub 2023 (visible normals by caps). */
#ifndef LW_COMMON_MICROFACETS_H
#define LW_COMMON_MICROFACETS_H

#include "common/base/vec.h"

/** Smallest alpha: a mirror's. Sharper ones are rounded away. */
#define LW_MICROFACETS_ALPHA_MIN 1e-3f

static inline float lw_microfacets_alpha(float roughness) {
    const float alpha = roughness * roughness;
    return alpha > LW_MICROFACETS_ALPHA_MIN ? alpha : LW_MICROFACETS_ALPHA_MIN;
}

/** (1 - cosine)^5 */
static inline float lw_microfacets_schlick(float cosine) {
    const float x = 1 - fminf(fmaxf(cosine, 0), 1), x2 = x * x;
    return x2 * x2 * x;
}

/** Density of facets with the normal `half`, per unit area and solid angle. */
static inline float lw_microfacets_density(struct lw_vec3 half, float alpha) {
    const float across = half.x * half.x + half.y * half.y, d = across + alpha * alpha * half.z * half.z;
    return alpha * alpha / (LW_PI * d * d);
}

/* Smith's lambda, in 1 + 2 lambda = stretch / cosine. */
static inline float lw_microfacets_stretch(float cosine, float alpha) {
    return sqrtf(alpha * alpha + (1 - alpha * alpha) * cosine * cosine);
}

/** Masking and shadowing over 4 cos cos'. */
static inline float lw_microfacets_visibility(float to_eye, float to_light, float alpha) {
    return 0.5f / (to_light * lw_microfacets_stretch(to_eye, alpha) +
                   to_eye * lw_microfacets_stretch(to_light, alpha));
}

/** Share of the facets seen by the eye that the light reaches. */
static inline float lw_microfacets_seen_again(float to_eye, float to_light, float alpha) {
    return to_light * (lw_microfacets_stretch(to_eye, alpha) + to_eye) /
           (to_light * lw_microfacets_stretch(to_eye, alpha) +
            to_eye * lw_microfacets_stretch(to_light, alpha));
}

/** Normal of a facet that the eye sees. u: two even random numbers in [0, 1). */
static inline struct lw_vec3 lw_microfacets_sample(struct lw_vec3 to_eye, float alpha, const float u[2]) {
    const struct lw_vec3 seen = lw_vec3_normalize(lw_vec3(alpha * to_eye.x, alpha * to_eye.y, to_eye.z));
    const float phi = 2 * LW_PI * u[0], z = (1 - u[1]) * (1 + seen.z) - seen.z;
    const float s = sqrtf(fmaxf(1 - z * z, 0));
    const struct lw_vec3 half = lw_vec3(s * cosf(phi) + seen.x, s * sinf(phi) + seen.y, z + seen.z);
    return lw_vec3_normalize(lw_vec3(alpha * half.x, alpha * half.y, fmaxf(half.z, 0)));
}

static inline struct lw_vec3 lw_microfacets_mirror(struct lw_vec3 to_eye, struct lw_vec3 half) {
    return lw_vec3_sub(lw_vec3_scale(half, 2 * lw_vec3_dot(to_eye, half)), to_eye);
}

/** Density per solid angle by which lw_microfacets_sample() and lw_microfacets_mirror() find the direction of
 * light that `half` mirrors to the eye. */
static inline float lw_microfacets_pdf(struct lw_vec3 to_eye, struct lw_vec3 half, float alpha) {
    return lw_microfacets_density(half, alpha) / (2 * (to_eye.z + lw_microfacets_stretch(to_eye.z, alpha)));
}

#endif
