/* packed_normal.h: a unit normal in 4 bytes: its two octahedral coordinates (octahedron.h), 16 bits each.
 * Threads: pure functions, [any].
 *
 * Rounding turns a normal by at most sqrt(18) / LW_PACKED_NORMAL_STEPS, 6.5e-5. */
#ifndef LW_SURFACE_PACKED_NORMAL_H
#define LW_SURFACE_PACKED_NORMAL_H

#include "server/solve/surface/octahedron.h"

#include <stdint.h>

/* An even number of steps, so that the six axes, which most walls face, are exact. */
#define LW_PACKED_NORMAL_STEPS 65534.0f

/** An octahedral coordinate in 0..LW_PACKED_NORMAL_STEPS. */
static inline uint32_t lw_packed_normal_quantise(float x) {
    return (uint32_t)((x * 0.5f + 0.5f) * LW_PACKED_NORMAL_STEPS + 0.5f);
}

static inline uint32_t lw_packed_normal(struct lw_vec3 normal) {
    const struct lw_vec2 p = lw_octahedron_fold(normal);
    return lw_packed_normal_quantise(p.x) | lw_packed_normal_quantise(p.y) << 16;
}

static inline struct lw_vec3 lw_packed_normal_unpack(uint32_t word) {
    return lw_octahedron_unfold((float)(word & 0xffffu) * (2 / LW_PACKED_NORMAL_STEPS) - 1,
                                (float)(word >> 16) * (2 / LW_PACKED_NORMAL_STEPS) - 1);
}

#endif
