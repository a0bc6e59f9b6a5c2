/* colour.h: linear-sRGB light and its 8-bit shadow. Pure functions, [any]. */
#ifndef LW_COMMON_BASE_COLOUR_H
#define LW_COMMON_BASE_COLOUR_H

#include "common/base/vec.h"

#include <stdint.h>

/** Rec. 709 luminance of linear RGB. */
static inline float lw_colour_luminance(struct lw_vec3 c) {
    return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z;
}

/** IEC 61966-2-1 decoding and encoding of one channel in [0, 1]. */
static inline float lw_colour_from_srgb(float s) {
    return s <= 0.04045f ? s / 12.92f : powf((s + 0.055f) / 1.055f, 2.4f);
}
static inline float lw_colour_to_srgb(float l) {
    return l <= 0.0031308f ? 12.92f * l : 1.055f * powf(l, 1.0f / 2.4f) - 0.055f;
}

/** Decoding table for 8-bit sRGB: 256 floats. */
extern const float lw_colour_srgb8_table[256];
static inline float lw_colour_from_srgb8(uint8_t s) { return lw_colour_srgb8_table[s]; }

#endif
