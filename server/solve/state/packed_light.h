/* packed_light.h: light of a texel, three channels in 8 bytes.
 * Threads: pure functions, [any].
 *
 * Each channel has the first 21 bits of a float, red in the lowest ones: sign, a float's range, and 12 bits
 * of its fraction. Rounding moves a channel by at most 2^-13 of itself, far below the noise of any mean, and
 * as often up as down. */
#ifndef LW_STATE_PACKED_LIGHT_H
#define LW_STATE_PACKED_LIGHT_H

#include "common/base/vec.h"

#include <stdint.h>
#include <string.h>

#define LW_PACKED_LIGHT_BITS    21u                         /* a channel has these bits */
#define LW_PACKED_LIGHT_DROPPED (32 - LW_PACKED_LIGHT_BITS) /* and not these bits of a float */

static inline uint64_t lw_packed_light_channel(float channel) {
    uint32_t bits;
    memcpy(&bits, &channel, sizeof bits);
    return (bits + (1u << (LW_PACKED_LIGHT_DROPPED - 1))) >> LW_PACKED_LIGHT_DROPPED;
}

/** light: finite. */
static inline uint64_t lw_packed_light(struct lw_vec3 light) {
    return lw_packed_light_channel(light.x) | lw_packed_light_channel(light.y) << LW_PACKED_LIGHT_BITS |
           lw_packed_light_channel(light.z) << 2 * LW_PACKED_LIGHT_BITS;
}

static inline struct lw_vec3 lw_packed_light_unpack(uint64_t word) {
    const uint32_t mask = ~0u << LW_PACKED_LIGHT_DROPPED;
    const uint32_t bits[3] = {(uint32_t)(word << LW_PACKED_LIGHT_DROPPED) & mask,
                              (uint32_t)(word >> (LW_PACKED_LIGHT_BITS - LW_PACKED_LIGHT_DROPPED)) & mask,
                              (uint32_t)(word >> (2 * LW_PACKED_LIGHT_BITS - LW_PACKED_LIGHT_DROPPED)) &
                                  mask};
    struct lw_vec3 light;
    memcpy(&light.x, &bits[0], sizeof bits[0]);
    memcpy(&light.y, &bits[1], sizeof bits[1]);
    memcpy(&light.z, &bits[2], sizeof bits[2]);
    return light;
}

/** Light after packing and unpacking. */
static inline struct lw_vec3 lw_packed_light_rounded(struct lw_vec3 light) {
    return lw_packed_light_unpack(lw_packed_light(light));
}

#endif
