/* octahedron.h: directions as points of a square: the sphere folded to an octahedron, the octahedron to a
 * square of coordinates in [-1, 1].
 * Threads: pure functions, [any].
 * After:   Meyer et al. 2010 (the mapping), Cigolle et al. 2014 (its error). */
#ifndef LW_SURFACE_OCTAHEDRON_H
#define LW_SURFACE_OCTAHEDRON_H

#include "common/base/vec.h"

#include <math.h>

/** d: of any length but 0. */
static inline struct lw_vec2 lw_octahedron_fold(struct lw_vec3 d) {
    float norm = fabsf(d.x) + fabsf(d.y) + fabsf(d.z), u = d.x / norm, v = d.y / norm;
    if (d.z >= 0) return (struct lw_vec2){u, v};
    return (struct lw_vec2){(1 - fabsf(v)) * copysignf(1, u), (1 - fabsf(u)) * copysignf(1, v)};
}

/** Returns a unit vector. */
static inline struct lw_vec3 lw_octahedron_unfold(float u, float v) {
    const float z = 1 - fabsf(u) - fabsf(v), fold = z < 0 ? -z : 0;
    return lw_vec3_normalize(lw_vec3(u - copysignf(fold, u), v - copysignf(fold, v), z));
}

#endif
