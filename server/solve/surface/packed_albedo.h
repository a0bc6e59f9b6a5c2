/* packed_albedo.h: albedo of a texel in 6 bytes: each channel in 65535ths, rounded.
 * Threads: pure functions, [any]. */
#ifndef LW_SURFACE_PACKED_ALBEDO_H
#define LW_SURFACE_PACKED_ALBEDO_H

#include "common/base/vec.h"

#include <math.h>
#include <stdint.h>

#define LW_PACKED_ALBEDO_ONE 65535.0f

struct lw_packed_albedo {
    uint16_t r, g, b;
};

/** channel: more than 1 becomes 1, less than 0 becomes 0. */
static inline uint16_t lw_packed_albedo_channel(float channel) {
    return (uint16_t)(fminf(fmaxf(channel, 0), 1) * LW_PACKED_ALBEDO_ONE + 0.5f);
}

static inline struct lw_packed_albedo lw_packed_albedo(struct lw_vec3 albedo) {
    return (struct lw_packed_albedo){lw_packed_albedo_channel(albedo.x), lw_packed_albedo_channel(albedo.y),
                                     lw_packed_albedo_channel(albedo.z)};
}

static inline struct lw_vec3 lw_packed_albedo_unpack(struct lw_packed_albedo albedo) {
    return lw_vec3_scale(lw_vec3((float)albedo.r, (float)albedo.g, (float)albedo.b),
                         1 / LW_PACKED_ALBEDO_ONE);
}

#endif
