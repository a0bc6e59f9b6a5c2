/* mirror.h: the rays along which smooth surfaces mirror the room.
 * Flow:    gloss -> [mirror] -> compose: a second packet, whose radiance is added
 * Threads: pure functions, [any].
 *
 * A surface sends one ray a sample, mirrored at a facet that is drawn from its lobe: over the samples of a
 * pixel the room is as blurred as the surface is rough. The light that the ray meets is read at a level whose
 * texels are as wide as a part of the lobe. Rougher surfaces keep what gloss.h says by E and its direction;
 * between the two roughnesses the share of the ray falls.
 *
 * After: Walter et al. 2007 (facets of GGX). */
#ifndef LW_CLIENT_VIEW_SHADING_MIRROR_H
#define LW_CLIENT_VIEW_SHADING_MIRROR_H

#include "common/base/random.h"
#include "common/light/direction.h"

#include <math.h>
#include <string.h>

#define LW_MIRROR_ROUGHNESS_RAY 0.25f /* up to it, the ray's radiance alone */
#define LW_MIRROR_ROUGHNESS_MAX 0.65f /* from here on none */
/* Facets beyond this share of the lobe are not drawn: they are rare, and far off. */
#define LW_MIRROR_LOBE 0.9f

/** The share of a ray in what a surface mirrors. */
static inline float lw_mirror_share(float roughness) {
    return fminf(1, fmaxf(0, (LW_MIRROR_ROUGHNESS_MAX - roughness) /
                                 (LW_MIRROR_ROUGHNESS_MAX - LW_MIRROR_ROUGHNESS_RAY)));
}

/** The width of a third of the lobe at a metre: facets turn a ray by twice their angle.
 * alpha2: alpha^2 with the spread of normals */
static inline float lw_mirror_slope(float alpha2) { return 0.6f * sqrtf(alpha2); }

/** The direction, unit, in which a surface with that normal mirrors the eye.
 * eye    where it is, unit, above the surface
 * ray    the eye's ray: each has a facet of its own */
static inline struct lw_vec3 lw_mirror_direction(struct lw_vec3 normal, struct lw_vec3 eye, float alpha2,
                                                 struct lw_vec3 ray) {
    uint32_t bits[2];
    memcpy(&bits[0], &ray.x, sizeof bits[0]);
    memcpy(&bits[1], &ray.y, sizeof bits[1]);
    const uint32_t seed = lw_random_hash2(bits[0], bits[1]);
    const float u = LW_MIRROR_LOBE * lw_random_unit(seed),
                turn = 2 * LW_PI * lw_random_unit(lw_random_hash(seed)), tilt = sqrtf(alpha2 * u / (1 - u));
    const struct lw_vec3 facet =
        lw_vec3_normalize(lw_direction_about(normal, lw_vec3(tilt * cosf(turn), tilt * sinf(turn), 1)));
    const struct lw_vec3 to = lw_vec3_sub(lw_vec3_scale(facet, 2 * lw_vec3_dot(facet, eye)), eye);
    if (lw_vec3_dot(to, normal) > 0.01f) return to;
    return lw_vec3_sub(lw_vec3_scale(normal, 2 * lw_vec3_dot(normal, eye)), eye);
}

#endif
