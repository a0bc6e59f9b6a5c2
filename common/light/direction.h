/* direction.h: random directions from two even numbers, and their frames.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_DIRECTION_H
#define LW_COMMON_DIRECTION_H

#include "common/base/vec.h"

/** Cosine-weighted direction about +z: pdf = z / pi (Malley's method). point: 2 floats in [0, 1). */
static inline struct lw_vec3 lw_direction_cosine(const float point[2]) {
    float radius = sqrtf(point[0]), angle = 2 * LW_PI * point[1];
    return lw_vec3(radius * cosf(angle), radius * sinf(angle), sqrtf(fmaxf(0, 1 - point[0])));
}

/** Uniform direction on the sphere: pdf = 1 / 4 pi. point: 2 floats in [0, 1). */
static inline struct lw_vec3 lw_direction_sphere(const float point[2]) {
    float z = 1 - 2 * point[0], radius = sqrtf(fmaxf(0, 1 - z * z)), angle = 2 * LW_PI * point[1];
    return lw_vec3(radius * cosf(angle), radius * sinf(angle), z);
}

/** A direction about +z, turned to be about a unit normal. */
static inline struct lw_vec3 lw_direction_about(struct lw_vec3 normal, struct lw_vec3 local) {
    struct lw_vec3 t, b;
    lw_vec3_frame(normal, &t, &b);
    return lw_vec3_mad(lw_vec3_mad(lw_vec3_scale(normal, local.z), t, local.x), b, local.y);
}

#endif
