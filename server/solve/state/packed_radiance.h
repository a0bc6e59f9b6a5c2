/* packed_radiance.h: radiance of a texel in 8 bytes.
 * Threads: pure functions, [any].
 *
 * Each channel has the 21 bits behind the sign of a float, red in the lowest ones: a float's range, and
 * 13 bits of its fraction. Rounding moves a channel by at most 2^-14 of itself, far below the noise of
 * any mean, and as often up as down. */
#ifndef LW_STATE_PACKED_RADIANCE_H
#define LW_STATE_PACKED_RADIANCE_H

#include "common/base/vec.h"

#include <stdint.h>
#include <string.h>

#define LW_PACKED_RADIANCE_BITS 21u /* a channel has these bits */

/** channel: finite; less than 0 becomes 0. */
static inline uint64_t lw_packed_radiance_channel(float channel) {
    const uint32_t dropped = 31 - LW_PACKED_RADIANCE_BITS;
    uint32_t bits;
    if (!(channel > 0)) return 0;
    memcpy(&bits, &channel, sizeof bits);
    return (bits + (1u << (dropped - 1))) >> dropped;
}

static inline uint64_t lw_packed_radiance(struct lw_vec3 radiance) {
    return lw_packed_radiance_channel(radiance.x) |
           lw_packed_radiance_channel(radiance.y) << LW_PACKED_RADIANCE_BITS |
           lw_packed_radiance_channel(radiance.z) << 2 * LW_PACKED_RADIANCE_BITS;
}

static inline struct lw_vec3 lw_packed_radiance_unpack(uint64_t word) {
    const uint32_t dropped = 31 - LW_PACKED_RADIANCE_BITS, mask = ((1u << LW_PACKED_RADIANCE_BITS) - 1)
                                                                  << dropped;
    const uint32_t bits[3] = {(uint32_t)(word << dropped) & mask,
                              (uint32_t)(word >> (LW_PACKED_RADIANCE_BITS - dropped)) & mask,
                              (uint32_t)(word >> (2 * LW_PACKED_RADIANCE_BITS - dropped)) & mask};
    struct lw_vec3 radiance;
    memcpy(&radiance.x, &bits[0], sizeof bits[0]);
    memcpy(&radiance.y, &bits[1], sizeof bits[1]);
    memcpy(&radiance.z, &bits[2], sizeof bits[2]);
    return radiance;
}

#endif
