/* ray_hit.h: where a frame's bounce rays ended. Rays are traced once a frame; every
 * bounce order reads along them.
 *
 * A ray hit is one word: a texel to read, a probe and a direction, or nothing. Where tiles hold cosine
 * moments, a half word has the ray's direction. The estimate of bounce k is
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

/** A direction (of any length but 0) in 16 bits, 8 for each octahedral coordinate: to within a degree. */
static inline uint16_t lw_ray_direction_pack(struct lw_vec3 d) {
    const struct lw_vec2 p = lw_octahedral_encode(d);
    const uint32_t a = (uint32_t)(p.x * 255.0f + 0.5f), b = (uint32_t)(p.y * 255.0f + 0.5f);
    return (uint16_t)((a & 255u) << 8 | (b & 255u));
}
static inline struct lw_vec3 lw_ray_direction_unpack(uint32_t word) {
    return lw_octahedral_decode(
        (struct lw_vec2){(float)(word >> 8 & 255u) * (1 / 255.0f), (float)(word & 255u) * (1 / 255.0f)});
}

/** The word for a probe and a direction, which probes resolve far less well. */
static inline uint32_t lw_ray_hit_pack_probe(uint32_t probe, struct lw_vec3 d) {
    const uint32_t word = LW_RAY_HIT_PROBE | (probe & 0x7fffu) << 16 | lw_ray_direction_pack(d);
    return word == LW_RAY_HIT_NOTHING ? word - 1 : word;
}
static inline uint32_t lw_ray_hit_probe(uint32_t hit) { return hit >> 16 & 0x7fffu; }
static inline struct lw_vec3 lw_ray_hit_direction(uint32_t hit) { return lw_ray_direction_unpack(hit); }

#endif
