#include "common/tile/texel_format.h"

#include "common/base/invariant.h"

#include <math.h>
#include <string.h>

#define EXPONENT_BIAS 15
#define MANTISSA_BITS 9
#define HALF_ONE      0x3c00u

static uint32_t bits_of(float f) {
    uint32_t bits;
    memcpy(&bits, &f, sizeof bits);
    return bits;
}
static float float_of(uint32_t bits) {
    float f;
    memcpy(&f, &bits, sizeof f);
    return f;
}

/* 2^exponent of a normal float. */
static float power(int exponent) { return float_of((uint32_t)(exponent + 127) << 23); }

/* No number becomes 0: the comparison is false. */
static float clamp(float f, float max) {
    if (!(f > 0)) return 0;
    return f < max ? f : max;
}

size_t lw_texel_format_size(enum lw_texel_format format) {
    switch (format) {
    case LW_TEXEL_FORMAT_RGB9E5:
        return 4;
    case LW_TEXEL_FORMAT_RGBA16F:
        return 8;
    case LW_TEXEL_FORMAT_RGB32F:
        return 12;
    case LW_TEXEL_FORMAT_RGBA32F:
        return 16;
    default:
        return 0;
    }
}

uint16_t lw_texel_format_half(float number) {
    const float f = clamp(number, LW_TEXEL_FORMAT_RGBA16F_MAX);
    /* Adding a power of two leaves as many bits as a subnormal half has; the processor rounds. */
    if (f < 0x1p-14f) return (uint16_t)(bits_of(f + 0.5f) - bits_of(0.5f));
    const uint32_t bits = bits_of(f) + 0xfffu + (bits_of(f) >> 13 & 1u);
    return (uint16_t)((bits >> 13) - ((127u - EXPONENT_BIAS) << 10));
}

/* OpenGL 3.3, appendix C.2 (EXT_texture_shared_exponent): the smallest exponent at which the largest channel,
 * rounded, has 9 bits. */
static uint32_t rgb9e5(const float rgb[3], float scale) {
    float c[3], largest = 0;
    for (int i = 0; i < 3; i++) {
        c[i] = clamp(rgb[i] * scale, LW_TEXEL_FORMAT_RGB9E5_MAX);
        if (c[i] > largest) largest = c[i];
    }
    int exponent = (int)(bits_of(largest) >> 23) - 127 + 1 + EXPONENT_BIAS;
    if (exponent < 0) exponent = 0;
    float steps = power(EXPONENT_BIAS + MANTISSA_BITS - exponent); /* the shared exponent's, in one */
    if ((uint32_t)(largest * steps + 0.5f) == 1u << MANTISSA_BITS) {
        exponent++; /* at most 31: the largest value of all needs no rounding up */
        steps *= 0.5f;
    }
    uint32_t texel = (uint32_t)exponent << 27;
    for (int i = 0; i < 3; i++) texel |= (uint32_t)(c[i] * steps + 0.5f) << (MANTISSA_BITS * i);
    return texel;
}

void lw_texel_format_write(enum lw_texel_format format, float scale, const float *rgb, size_t count,
                           void *dst) {
    uint8_t *out = dst;
    const size_t size = lw_texel_format_size(format);
    for (size_t i = 0; i < count; i++, rgb += 3, out += size) {
        if (format == LW_TEXEL_FORMAT_RGB9E5) {
            const uint32_t texel = rgb9e5(rgb, scale);
            memcpy(out, &texel, sizeof texel);
        } else if (format == LW_TEXEL_FORMAT_RGBA16F) {
            const uint16_t texel[4] = {lw_texel_format_half(rgb[0] * scale),
                                       lw_texel_format_half(rgb[1] * scale),
                                       lw_texel_format_half(rgb[2] * scale), HALF_ONE};
            memcpy(out, texel, sizeof texel);
        } else {
            const float texel[4] = {clamp(rgb[0] * scale, 3.4028235e38f),
                                    clamp(rgb[1] * scale, 3.4028235e38f),
                                    clamp(rgb[2] * scale, 3.4028235e38f), 1};
            memcpy(out, texel, size);
        }
    }
}

static float cut(float f) { return f > 0 ? fminf(f, 1) : f < 0 ? fmaxf(f, -1) : 0; }

static uint16_t signed_half(float f) {
    return (uint16_t)(lw_texel_format_half(fabsf(f)) | (f < 0 ? 0x8000u : 0));
}

void lw_texel_format_write_vectors(enum lw_texel_format format, const float *xyz, size_t count, void *dst) {
    uint8_t *out = dst;
    const size_t size = lw_texel_format_size(format);
    LW_INVARIANT(format != LW_TEXEL_FORMAT_RGB9E5);
    for (size_t i = 0; i < count; i++, xyz += 3, out += size) {
        const float texel[4] = {cut(xyz[0]), cut(xyz[1]), cut(xyz[2]), 1};
        if (format == LW_TEXEL_FORMAT_RGBA16F) {
            const uint16_t half[4] = {signed_half(texel[0]), signed_half(texel[1]), signed_half(texel[2]),
                                      HALF_ONE};
            memcpy(out, half, sizeof half);
        } else {
            memcpy(out, texel, size);
        }
    }
}
