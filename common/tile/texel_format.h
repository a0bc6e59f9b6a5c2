/* texel_format.h: irradiance, and vectors beside it, in the formats that GPUs sample.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_TEXEL_FORMAT_H
#define LW_COMMON_TEXEL_FORMAT_H

#include <stddef.h>
#include <stdint.h>

enum lw_texel_format {
    LW_TEXEL_FORMAT_RGB9E5,  /* 4 bytes: red in the low 9 bits, the exponent in the high 5 */
    LW_TEXEL_FORMAT_RGBA16F, /* 8 bytes: halves, alpha 1 */
    LW_TEXEL_FORMAT_RGB32F,  /* 12 bytes */
    LW_TEXEL_FORMAT_RGBA32F, /* 16 bytes, alpha 1 */
    LW_TEXEL_FORMAT_COUNT
};

#define LW_TEXEL_FORMAT_RGB9E5_MAX  65408.0f
#define LW_TEXEL_FORMAT_RGBA16F_MAX 65504.0f

/** Bytes of a texel; 0: no such format. */
size_t lw_texel_format_size(enum lw_texel_format format);

/** Writes `count` texels of 3 floats, each times `scale`, to the nearest value of the format. A value
 * above the format's largest becomes its largest, a negative one or NaN becomes 0.
 * format  one of the above
 * dst     count * lw_texel_format_size() bytes, at any address */
void lw_texel_format_write(enum lw_texel_format format, float scale, const float *rgb, size_t count,
                           void *dst);

/** The same of vectors, each number from -1 to 1: a number beyond is cut, NaN becomes 0.
 * format  any but RGB9E5, which has no sign */
void lw_texel_format_write_vectors(enum lw_texel_format format, const float *xyz, size_t count, void *dst);

/** The nearest half of a number, ties to even. */
uint16_t lw_texel_format_half(float number);

#endif
