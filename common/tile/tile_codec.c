#include "common/tile/tile_codec.h"

#include "common/base/invariant.h"
#include "common/tile/tile_dct.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#define ZSTD_LEVEL   1 /* tiles are noise at first: higher levels cost time and gain under 2 % */
#define VALUES_MAX   (LW_TILE_TEXELS_MAX * LW_TILE_CHANNEL_PLANES_MAX)
#define HALF_MAX     65504.0f
#define HALF_LARGEST 0x7bffu
#define HALF_SIGN    0x8000u
/* Values are scaled so that the largest lies in (2^14, 2^15]: inside half's range with a bit to spare, and
 * with its normal numbers reaching 29 powers of two below. */
#define SCALED_EXPONENT 15

struct lw_tile_codec {
    ZSTD_CCtx *compress;
    ZSTD_DCtx *decompress;
    uint16_t half[VALUES_MAX];
    uint8_t planes[VALUES_MAX * 2];
    struct lw_tile_dct dct;
    struct lw_tile_dct_coefficients *between; /* two; made when they are needed first */
};

enum lw_status lw_tile_codec_create(struct lw_tile_codec **out_codec) {
    struct lw_tile_codec *codec = aligned_alloc(_Alignof(struct lw_tile_codec), sizeof *codec);
    if (!codec) return LW_NO_MEMORY;
    codec->between = NULL;
    lw_tile_dct_init(&codec->dct);
    codec->compress = ZSTD_createCCtx();
    codec->decompress = ZSTD_createDCtx();
    if (!codec->compress || !codec->decompress) {
        lw_tile_codec_destroy(codec);
        return LW_NO_MEMORY;
    }
    *out_codec = codec;
    return LW_OK;
}

void lw_tile_codec_destroy(struct lw_tile_codec *codec) {
    if (!codec) return;
    ZSTD_freeDCtx(codec->decompress);
    ZSTD_freeCCtx(codec->compress);
    free(codec->between);
    free(codec);
}

size_t lw_tile_codec_bound(void) {
    const size_t half = ZSTD_compressBound(VALUES_MAX * 2u);
    return half > LW_TILE_DCT_BOUND ? half : LW_TILE_DCT_BOUND;
}

bool lw_tile_codec_is_known(uint32_t number) {
    return number == LW_TILE_CODEC_HALF_ZSTD || number == LW_TILE_CODEC_DCT;
}

static size_t planes_of(const struct lw_tile_channel *channel) { return channel ? channel->planes : 3; }

/* Nearest half of a float in [0, HALF_MAX], ties to even: adding 2^(13 + exponent) drops the mantissa's low
 * bits. */
static uint16_t half_from_float(float f) {
    uint32_t bits;
    LW_INVARIANT_DEAR(f >= 0 && f <= HALF_MAX);
    if (f < 0x1p-14f) return (uint16_t)lrintf(f * 0x1p24f); /* subnormal: multiples of 2^-24 */
    memcpy(&bits, &f, sizeof bits);
    bits += 0xfffu + (bits >> 13 & 1u);
    return (uint16_t)((bits >> 13) - ((127u - 15u) << 10));
}

static float float_from_half(uint16_t h) {
    uint32_t exponent = h >> 10 & 31u, mantissa = h & 0x3ffu;
    if (exponent == 0) return (float)mantissa * 0x1p-24f;
    uint32_t bits = (exponent + 112u) << 23 | mantissa << 13;
    float f;
    memcpy(&f, &bits, sizeof f);
    return f;
}

/* The power of two that brings the largest value to half's upper range; 1 for a black tile. */
static float choose_scale(const float *rgb, size_t count, bool is_signed) {
    float largest = 0;
    for (size_t i = 0; i < count; i++) {
        const float size = is_signed ? fabsf(rgb[i]) : rgb[i];
        if (size > largest && isfinite(size)) largest = size;
    }
    if (largest < 0x1p-100f) return 1.0f;
    int exponent;
    frexpf(largest, &exponent);
    return ldexpf(1.0f, exponent - SCALED_EXPONENT);
}

enum lw_status lw_tile_codec_encode_half(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                                         const float *rgb, uint32_t width, uint32_t height, uint8_t *dst,
                                         size_t dst_capacity, size_t *out_size, float *out_scale,
                                         uint32_t *out_saturated) {
    const size_t planes = planes_of(channel), texels = (size_t)width * height, values = texels * planes;
    const bool is_signed = channel && channel->is_signed;
    if (values > VALUES_MAX || values == 0 || dst_capacity < lw_tile_codec_bound()) return LW_INTERNAL;
    const float scale = choose_scale(rgb, values, is_signed), inverse = 1.0f / scale;
    const uint32_t sign = is_signed ? HALF_SIGN : 0;
    uint32_t saturated = 0;
    for (size_t i = 0; i < texels; i++)
        for (size_t c = 0; c < planes; c++) {
            const float value = rgb[i * planes + c] * inverse, v = is_signed ? fabsf(value) : value;
            bool fits = v >= 0 && v <= HALF_MAX; /* false for NaN */
            const uint32_t half = fits ? half_from_float(v) : v > HALF_MAX && isfinite(v) ? HALF_LARGEST : 0;
            codec->half[c * texels + i] = (uint16_t)(half | (value < 0 && half ? sign : 0));
            saturated += !fits;
        }
    for (size_t i = 0; i < values; i++) {
        codec->planes[i] = (uint8_t)codec->half[i];
        codec->planes[values + i] = (uint8_t)(codec->half[i] >> 8);
    }
    size_t size =
        ZSTD_compressCCtx(codec->compress, dst, dst_capacity, codec->planes, values * 2, ZSTD_LEVEL);
    if (ZSTD_isError(size)) return LW_NO_MEMORY;
    LW_INVARIANT(size > 0 && size <= dst_capacity && scale > 0 && saturated <= values);
    *out_size = size;
    *out_scale = scale;
    *out_saturated = saturated;
    return LW_OK;
}

enum lw_status lw_tile_codec_encode_dct(struct lw_tile_codec *codec, const struct lw_tile_dct_source *source,
                                        struct lw_tile_dct_history *history, uint8_t *dst, uint8_t *delta_dst,
                                        size_t dst_capacity, struct lw_tile_dct_coded *out_coded) {
    if (source->width - 1 >= LW_TILE_SIDE || source->height - 1 >= LW_TILE_SIDE ||
        dst_capacity < lw_tile_codec_bound())
        return LW_INTERNAL;
    lw_tile_dct_encode(&codec->dct, source, history, dst, delta_dst, out_coded);
    LW_INVARIANT(out_coded->size > 0 && out_coded->size <= LW_TILE_DCT_BOUND);
    LW_INVARIANT(out_coded->delta_size <= LW_TILE_DCT_BOUND && (history || !out_coded->delta_size));
    LW_INVARIANT(out_coded->saturated <= 3 * source->width * source->height);
    return LW_OK;
}

static bool make_between(struct lw_tile_codec *codec) {
    if (!codec->between)
        codec->between = aligned_alloc(_Alignof(struct lw_tile_dct_coefficients), 2 * sizeof *codec->between);
    return codec->between;
}

enum lw_status lw_tile_codec_encode_between(struct lw_tile_codec *codec,
                                            const struct lw_tile_channel *channel, const uint8_t *from,
                                            size_t from_size, const uint8_t *to, size_t to_size,
                                            uint32_t width, uint32_t height, uint8_t *dst,
                                            size_t dst_capacity, size_t *out_size) {
    if (dst_capacity < lw_tile_codec_bound()) return LW_INTERNAL;
    if (!make_between(codec)) return LW_NO_MEMORY;
    const size_t size = lw_tile_dct_encode_between(&codec->dct, channel, from, from_size, to, to_size, width,
                                                   height, codec->between, dst);
    LW_INVARIANT(size <= LW_TILE_DCT_BOUND);
    if (!size) return LW_BAD_DATA;
    *out_size = size;
    return LW_OK;
}

enum lw_status lw_tile_codec_encode_sum(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                                        const uint8_t *from, size_t from_size, const uint8_t *delta,
                                        size_t delta_size, uint32_t width, uint32_t height, uint8_t *dst,
                                        size_t dst_capacity, size_t *out_size) {
    if (dst_capacity < lw_tile_codec_bound()) return LW_INTERNAL;
    if (!make_between(codec)) return LW_NO_MEMORY;
    const size_t size = lw_tile_dct_encode_sum(&codec->dct, channel, from, from_size, delta, delta_size,
                                               width, height, codec->between, dst);
    LW_INVARIANT(size <= LW_TILE_DCT_BOUND);
    if (!size) return LW_BAD_DATA;
    *out_size = size;
    return LW_OK;
}

/* One frame that says its size and needs no dictionary, and nothing after it: zstd itself would also take
 * frames in a row and frames of any size. */
static bool is_one_frame(const uint8_t *src, size_t src_size, size_t content_size) {
    return ZSTD_getFrameContentSize(src, src_size) == content_size &&
           ZSTD_findFrameCompressedSize(src, src_size) == src_size;
}

static enum lw_status decode_half(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                                  const uint8_t *src, size_t src_size, float scale, size_t texels,
                                  float *rgb) {
    const size_t planes = planes_of(channel), values = texels * planes;
    const uint32_t sign = channel && channel->is_signed ? HALF_SIGN : 0;
    /* A scale this large would take half's range past float's. */
    if (!(scale <= 0x1p111f) || !is_one_frame(src, src_size, values * 2)) return LW_BAD_DATA;
    size_t size = ZSTD_decompressDCtx(codec->decompress, codec->planes, sizeof codec->planes, src, src_size);
    if (ZSTD_isError(size) || size != values * 2) return LW_BAD_DATA;
    for (size_t i = 0; i < texels; i++)
        for (size_t c = 0; c < planes; c++) {
            const size_t at = c * texels + i;
            const uint32_t h = codec->planes[at] | (uint32_t)codec->planes[values + at] << 8,
                           magnitude = h & ~sign;
            if (magnitude > HALF_LARGEST) return LW_BAD_DATA; /* infinite, NaN or negative */
            const float value = float_from_half((uint16_t)magnitude) * scale;
            rgb[i * planes + c] = h == magnitude ? value : -value;
        }
    return LW_OK;
}

enum lw_status lw_tile_codec_decode(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                                    uint32_t number, const uint8_t *src, size_t src_size, float scale,
                                    uint32_t width, uint32_t height,
                                    struct lw_tile_dct_coefficients *coefficients, float *rgb) {
    if (width - 1 >= LW_TILE_SIDE || height - 1 >= LW_TILE_SIDE || !(scale > 0)) return LW_BAD_DATA;
    switch (number) {
    case LW_TILE_CODEC_HALF_ZSTD:
        return decode_half(codec, channel, src, src_size, scale, (size_t)width * height, rgb);
    case LW_TILE_CODEC_DCT:
        return lw_tile_dct_decode(&codec->dct, channel, LW_TILE_DCT_INTRA, src, src_size, scale, width,
                                  height, coefficients, rgb)
                   ? LW_OK
                   : LW_BAD_DATA;
    default:
        return LW_BAD_DATA;
    }
}

enum lw_status lw_tile_codec_decode_delta(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                                          uint32_t number, const uint8_t *src, size_t src_size, float scale,
                                          uint32_t width, uint32_t height,
                                          struct lw_tile_dct_coefficients *coefficients, float *rgb) {
    return number == LW_TILE_CODEC_DCT &&
                   lw_tile_dct_decode(&codec->dct, channel, LW_TILE_DCT_DELTA, src, src_size, scale, width,
                                      height, coefficients, rgb)
               ? LW_OK
               : LW_BAD_DATA;
}
