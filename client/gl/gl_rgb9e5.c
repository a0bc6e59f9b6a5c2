#include "client/gl/gl_rgb9e5.h"

#include <string.h>

#define PACKED_MAX 65408.0f

uint32_t lw_gl_rgb9e5_pack(const float rgb[3], float scale) {
    float c[3], most = 0;
    for (int i = 0; i < 3; i++) {
        const float scaled = rgb[i] * scale;
        c[i] = scaled > 0 ? (scaled < PACKED_MAX ? scaled : PACKED_MAX) : 0;
        most = c[i] > most ? c[i] : most;
    }
    /* shared exponent e: steps of 2^(e - 24), of which the largest channel has at most 511 */
    uint32_t bits;
    memcpy(&bits, &most, sizeof bits);
    int e = (int)(bits >> 23) - 127 + 16;
    e = e < 0 ? 0 : e;
    uint32_t step_bits = (uint32_t)(24 - e + 127) << 23;
    float steps; /* a unit */
    memcpy(&steps, &step_bits, sizeof steps);
    if ((uint32_t)(most * steps + 0.5f) > 511) e++, steps *= 0.5f;
    uint32_t packed = (uint32_t)e << 27;
    for (int i = 0; i < 3; i++) packed |= (uint32_t)(c[i] * steps + 0.5f) << (9 * i);
    return packed;
}
