/* transport.h: where a frame's bounce rays ended. Rays are traced once a frame; every bounce order reads along them.
 *
 * An end is one word: a texel to read, a probe to ask in a direction, or nothing. The estimate of bounce k is
 * E_k(x) = (pi / N) sum over ends of L_{k-1}: the operator sampled once, applied to each order. The rays of different
 * texels are drawn independently, so the product over two bounces stays unbiased; what correlates are the orders of
 * one texel with each other, which moves no mean. Tracing per order costs bounces times the rays for the same error
 * per order.
 * Threads: values, [any]. */
#ifndef LW_SOLVE_TRANSPORT_H
#define LW_SOLVE_TRANSPORT_H

#include "common/vec.h"

#include <stdint.h>

#define LW_END_NOTHING UINT32_MAX  /* the sky (which the direct pass has counted), or a black back */
#define LW_END_PROBE   0x80000000u /* flag: 15 bits of probe, 16 bits of direction */

/** The word for a probe and a direction; 8 bits for each octahedral coordinate (Meyer et al. 2010), under a degree:
 * far below what nine coefficients resolve. */
static inline uint32_t lw_end_pack_probe(uint32_t probe, struct lw_vec3 d) {
    float norm = fabsf(d.x) + fabsf(d.y) + fabsf(d.z), u = d.x / norm, v = d.y / norm;
    if (d.z < 0) {
        float folded = (1 - fabsf(v)) * copysignf(1, u);
        v = (1 - fabsf(u)) * copysignf(1, v);
        u = folded;
    }
    uint32_t a = (uint32_t)((u * 0.5f + 0.5f) * 255.0f + 0.5f),
             b = (uint32_t)((v * 0.5f + 0.5f) * 255.0f + 0.5f);
    uint32_t word = LW_END_PROBE | (probe & 0x7fffu) << 16 | (a & 255u) << 8 | (b & 255u);
    return word == LW_END_NOTHING ? word - 1 : word;
}
static inline uint32_t lw_end_probe(uint32_t end) { return end >> 16 & 0x7fffu; }
static inline struct lw_vec3 lw_end_direction(uint32_t end) {
    float u = (float)(end >> 8 & 255u) * (2 / 255.0f) - 1, v = (float)(end & 255u) * (2 / 255.0f) - 1;
    float z = 1 - fabsf(u) - fabsf(v), fold = z < 0 ? -z : 0;
    return lw_vec3_normalize(lw_vec3(u - copysignf(fold, u), v - copysignf(fold, v), z));
}

#endif
