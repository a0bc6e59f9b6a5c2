/* packed_normal.h: a unit normal in 4 bytes: its two octahedral coordinates, 16 bits each.
 * Threads: pure functions, [any].
 * After:   Meyer et al. 2010.
 *
 * Rounding turns a normal by at most sqrt(18) / LW_PACKED_NORMAL_STEPS, 6.5e-5. */
#ifndef LW_SURFACE_PACKED_NORMAL_H
#define LW_SURFACE_PACKED_NORMAL_H

#include "common/base/vec.h"

#include <math.h>
#include <stdint.h>

/* An even number of steps, so that the six axes, which most walls face, are exact. */
#define LW_PACKED_NORMAL_STEPS 65534.0f

/** A direction, of any length but 0, as octahedral coordinates in [-1, 1]. */
static inline struct lw_vec2 lw_packed_normal_fold(struct lw_vec3 d) {
    float norm = fabsf(d.x) + fabsf(d.y) + fabsf(d.z), u = d.x / norm, v = d.y / norm;
    if (d.z >= 0) return (struct lw_vec2){u, v};
    return (struct lw_vec2){(1 - fabsf(v)) * copysignf(1, u), (1 - fabsf(u)) * copysignf(1, v)};
}

/** An octahedral coordinate in 0..LW_PACKED_NORMAL_STEPS. */
static inline uint32_t lw_packed_normal_quantise(float x) {
    return (uint32_t)((x * 0.5f + 0.5f) * LW_PACKED_NORMAL_STEPS + 0.5f);
}

static inline uint32_t lw_packed_normal(struct lw_vec3 normal) {
    const struct lw_vec2 p = lw_packed_normal_fold(normal);
    return lw_packed_normal_quantise(p.x) | lw_packed_normal_quantise(p.y) << 16;
}

static inline struct lw_vec3 lw_packed_normal_unpack(uint32_t word) {
    const float u = (float)(word & 0xffffu) * (2 / LW_PACKED_NORMAL_STEPS) - 1,
                v = (float)(word >> 16) * (2 / LW_PACKED_NORMAL_STEPS) - 1, z = 1 - fabsf(u) - fabsf(v),
                fold = z < 0 ? -z : 0;
    return lw_vec3_normalize(lw_vec3(u - copysignf(fold, u), v - copysignf(fold, v), z));
}

#endif
