/* ray_hit.h: where a frame's bounce rays ended. Rays are traced once a frame; every
 * bounce order reads along them.
 *
 * A ray hit is one word: a texel to read, a probe and a direction, or nothing. Where tiles hold cosine
 * moments, a second word has the ray's direction. The estimate of bounce k is
 *
 *   E_k(x) = (pi / N) sum over ray hits of L_{k-1}      and the light of reflectors (reflectors.h)
 *
 * the operator sampled once, applied to each order. The rays of different texels are independent, so the
 * product over two bounces stays unbiased. The orders of one texel correlate, which moves no mean. To trace
 * per order would cost bounces times the rays, for the same error per order.
 * Threads: values, [any]. */
#ifndef LW_TRANSPORT_RAY_HIT_H
#define LW_TRANSPORT_RAY_HIT_H

#include "server/solve/transport/octahedral.h"

#include <stdint.h>

#define LW_RAY_HIT_NOTHING                                                                                   \
    UINT32_MAX /* the sky or a reflector, which are counted elsewhere, or a black back */
#define LW_RAY_HIT_PROBE 0x80000000u /* flag: 15 bits of probe, 16 bits of direction */

/** The word for a probe and a direction (of any length but 0); 8 bits for each octahedral coordinate, under a
 * degree: far below what a probe resolves. */
static inline uint32_t lw_ray_hit_pack_probe(uint32_t probe, struct lw_vec3 d) {
    struct lw_vec2 p = lw_octahedral_encode(d);
    uint32_t a = (uint32_t)(p.x * 255.0f + 0.5f), b = (uint32_t)(p.y * 255.0f + 0.5f);
    uint32_t word = LW_RAY_HIT_PROBE | (probe & 0x7fffu) << 16 | (a & 255u) << 8 | (b & 255u);
    return word == LW_RAY_HIT_NOTHING ? word - 1 : word;
}
static inline uint32_t lw_ray_hit_probe(uint32_t hit) { return hit >> 16 & 0x7fffu; }
static inline struct lw_vec3 lw_ray_hit_direction(uint32_t hit) {
    return lw_octahedral_decode(
        (struct lw_vec2){(float)(hit >> 8 & 255u) * (1 / 255.0f), (float)(hit & 255u) * (1 / 255.0f)});
}

/** The word for a unit direction: ten bits for each coordinate, a tenth of a degree. */
static inline uint32_t lw_ray_direction_pack(struct lw_vec3 d) {
    const uint32_t x = (uint32_t)(d.x * 511 + 512.5f), y = (uint32_t)(d.y * 511 + 512.5f),
                   z = (uint32_t)(d.z * 511 + 512.5f);
    return (x & 1023u) << 20 | (y & 1023u) << 10 | (z & 1023u);
}
/** Its length is within 0.3 % of 1. */
static inline struct lw_vec3 lw_ray_direction_unpack(uint32_t word) {
    const float x = (float)(int)(word >> 20 & 1023u), y = (float)(int)(word >> 10 & 1023u),
                z = (float)(int)(word & 1023u);
    return lw_vec3((x - 512) * (1.0f / 511), (y - 512) * (1.0f / 511), (z - 512) * (1.0f / 511));
}

#endif
