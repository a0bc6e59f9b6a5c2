/* packed_length.h: a length in 2 bytes, rounded up.
 * Threads: pure functions, [any].
 *
 * The first 16 bits of a float have 7 bits of its fraction: a length grows by less than 2^-7 of itself. */
#ifndef LW_SURFACE_PACKED_LENGTH_H
#define LW_SURFACE_PACKED_LENGTH_H

#include <stdint.h>
#include <string.h>

/** length: 0 or more, finite. */
static inline uint16_t lw_packed_length(float length) {
    uint32_t bits;
    memcpy(&bits, &length, sizeof bits);
    return (uint16_t)((bits + 0xffffu) >> 16);
}

static inline float lw_packed_length_unpack(uint16_t packed) {
    const uint32_t bits = (uint32_t)packed << 16;
    float length;
    memcpy(&length, &bits, sizeof length);
    return length;
}

#endif
