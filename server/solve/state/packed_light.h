/* packed_light.h: light of a texel, three channels in 8 bytes.
 * Threads: pure functions, [any].
 *
 * Each channel has 21 bits of a float, red in the lowest ones, and a float's range. Light that is never
 * negative has 13 bits of a fraction: rounding moves it by at most 2^-14 of itself. Other light has a sign
 * and 12 bits, and moves by 2^-13. This is far below the noise of any mean, and as often up as down. */
#ifndef LW_STATE_PACKED_LIGHT_H
#define LW_STATE_PACKED_LIGHT_H

#include "common/base/vec.h"

#include <stdint.h>
#include <string.h>

#define LW_PACKED_LIGHT_BITS 21u /* a channel has these bits */

/* The last bits of a float, which are dropped. Without a sign there are 31. */
enum lw_packed_light_dropped { LW_PACKED_LIGHT_POSITIVE = 10, LW_PACKED_LIGHT_SIGNED = 11 };

static inline uint64_t lw_packed_light_channel(float channel, enum lw_packed_light_dropped dropped) {
    uint32_t bits;
    if (dropped == LW_PACKED_LIGHT_POSITIVE && !(channel > 0)) return 0;
    memcpy(&bits, &channel, sizeof bits);
    return (bits + (1u << (dropped - 1))) >> dropped;
}

/** light: finite. A channel below 0 becomes 0 unless light is SIGNED. */
static inline uint64_t lw_packed_light(struct lw_vec3 light, enum lw_packed_light_dropped dropped) {
    return lw_packed_light_channel(light.x, dropped) |
           lw_packed_light_channel(light.y, dropped) << LW_PACKED_LIGHT_BITS |
           lw_packed_light_channel(light.z, dropped) << 2 * LW_PACKED_LIGHT_BITS;
}

static inline struct lw_vec3 lw_packed_light_unpack(uint64_t word, enum lw_packed_light_dropped dropped) {
    const uint32_t mask = ((1u << LW_PACKED_LIGHT_BITS) - 1) << dropped;
    const uint32_t bits[3] = {(uint32_t)(word << dropped) & mask,
                              (uint32_t)(word >> (LW_PACKED_LIGHT_BITS - dropped)) & mask,
                              (uint32_t)(word >> (2 * LW_PACKED_LIGHT_BITS - dropped)) & mask};
    struct lw_vec3 light;
    memcpy(&light.x, &bits[0], sizeof bits[0]);
    memcpy(&light.y, &bits[1], sizeof bits[1]);
    memcpy(&light.z, &bits[2], sizeof bits[2]);
    return light;
}

/** Light after packing and unpacking. */
static inline struct lw_vec3 lw_packed_light_rounded(struct lw_vec3 light,
                                                     enum lw_packed_light_dropped dropped) {
    return lw_packed_light_unpack(lw_packed_light(light, dropped), dropped);
}

#endif
