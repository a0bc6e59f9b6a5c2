#include "common/tile/tile_codec.h"

#include "common/tile/tile_dct.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#define ZSTD_LEVEL   1 /* tiles are noise at first: higher levels cost time and gain under 2 % */
#define PLANES_MAX   (LW_TILE_TEXELS_MAX * 3u)
#define HALF_MAX     65504.0f
#define HALF_LARGEST 0x7bffu
/* Values are scaled so that the largest lies in (2^14, 2^15]: inside half's range with a bit to spare, and
 * with its normal numbers reaching 29 powers of two below. */
#define SCALED_EXPONENT 15

struct lw_tile_codec {
    ZSTD_CCtx *compress;
    ZSTD_DCtx *decompress;
    uint16_t half[PLANES_MAX];
    uint8_t planes[PLANES_MAX * 2];
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
    const size_t half = ZSTD_compressBound(PLANES_MAX * 2u);
    return half > LW_TILE_DCT_BOUND ? half : LW_TILE_DCT_BOUND;
}

bool lw_tile_codec_is_known(uint32_t number) {
    return number == LW_TILE_CODEC_HALF_ZSTD || number == LW_TILE_CODEC_DCT;
}

/* Nearest half of a float in [0, HALF_MAX], ties to even: adding 2^(13 + exponent) drops the mantissa's low
 * bits. */
static uint16_t half_from_float(float f) {
    uint32_t bits;
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
static float choose_scale(const float *rgb, size_t count) {
    float largest = 0;
    for (size_t i = 0; i < count; i++)
        if (rgb[i] > largest && isfinite(rgb[i])) largest = rgb[i];
    if (largest < 0x1p-100f) return 1.0f;
    int exponent;
    frexpf(largest, &exponent);
    return ldexpf(1.0f, exponent - SCALED_EXPONENT);
}

enum lw_status lw_tile_codec_encode_half(struct lw_tile_codec *codec, const float *rgb, uint32_t width,
                                         uint32_t height, uint8_t *dst, size_t dst_capacity, size_t *out_size,
                                         float *out_scale, uint32_t *out_saturated) {
    const size_t texels = (size_t)width * height, values = texels * 3;
    if (values > PLANES_MAX || values == 0 || dst_capacity < lw_tile_codec_bound()) return LW_INTERNAL;
    const float scale = choose_scale(rgb, values), inverse = 1.0f / scale;
    uint32_t saturated = 0;
    for (size_t i = 0; i < texels; i++)
        for (size_t c = 0; c < 3; c++) {
            float v = rgb[i * 3 + c] * inverse;
            bool fits = v >= 0 && v <= HALF_MAX; /* false for NaN */
            codec->half[c * texels + i] = fits                          ? half_from_float(v)
                                          : v > HALF_MAX && isfinite(v) ? HALF_LARGEST
                                                                        : 0;
            saturated += !fits;
        }
    for (size_t i = 0; i < values; i++) {
        codec->planes[i] = (uint8_t)codec->half[i];
        codec->planes[values + i] = (uint8_t)(codec->half[i] >> 8);
    }
    size_t size =
        ZSTD_compressCCtx(codec->compress, dst, dst_capacity, codec->planes, values * 2, ZSTD_LEVEL);
    if (ZSTD_isError(size)) return LW_NO_MEMORY;
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
    return LW_OK;
}

enum lw_status lw_tile_codec_encode_between(struct lw_tile_codec *codec, const uint8_t *from,
                                            size_t from_size, const uint8_t *to, size_t to_size,
                                            uint32_t width, uint32_t height, uint8_t *dst,
                                            size_t dst_capacity, size_t *out_size) {
    if (dst_capacity < lw_tile_codec_bound()) return LW_INTERNAL;
    if (!codec->between && !(codec->between = aligned_alloc(_Alignof(struct lw_tile_dct_coefficients),
                                                            2 * sizeof *codec->between)))
        return LW_NO_MEMORY;
    const size_t size = lw_tile_dct_encode_between(&codec->dct, from, from_size, to, to_size, width, height,
                                                   codec->between, dst);
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

static enum lw_status decode_half(struct lw_tile_codec *codec, const uint8_t *src, size_t src_size,
                                  float scale, size_t texels, float *rgb) {
    const size_t values = texels * 3;
    /* A scale this large would take half's range past float's. */
    if (!(scale <= 0x1p111f) || !is_one_frame(src, src_size, values * 2)) return LW_BAD_DATA;
    size_t size = ZSTD_decompressDCtx(codec->decompress, codec->planes, sizeof codec->planes, src, src_size);
    if (ZSTD_isError(size) || size != values * 2) return LW_BAD_DATA;
    for (size_t i = 0; i < texels; i++)
        for (size_t c = 0; c < 3; c++) {
            size_t at = c * texels + i;
            uint16_t h = (uint16_t)(codec->planes[at] | codec->planes[values + at] << 8);
            if (h > HALF_LARGEST) return LW_BAD_DATA; /* infinite, NaN or negative */
            rgb[i * 3 + c] = float_from_half(h) * scale;
        }
    return LW_OK;
}

enum lw_status lw_tile_codec_decode(struct lw_tile_codec *codec, uint32_t number, const uint8_t *src,
                                    size_t src_size, float scale, uint32_t width, uint32_t height,
                                    struct lw_tile_dct_coefficients *coefficients, float *rgb) {
    if (width - 1 >= LW_TILE_SIDE || height - 1 >= LW_TILE_SIDE || !(scale > 0)) return LW_BAD_DATA;
    switch (number) {
    case LW_TILE_CODEC_HALF_ZSTD:
        return decode_half(codec, src, src_size, scale, (size_t)width * height, rgb);
    case LW_TILE_CODEC_DCT:
        return lw_tile_dct_decode(&codec->dct, LW_TILE_DCT_INTRA, src, src_size, scale, width, height,
                                  coefficients, rgb)
                   ? LW_OK
                   : LW_BAD_DATA;
    default:
        return LW_BAD_DATA;
    }
}

enum lw_status lw_tile_codec_decode_delta(struct lw_tile_codec *codec, uint32_t number, const uint8_t *src,
                                          size_t src_size, float scale, uint32_t width, uint32_t height,
                                          struct lw_tile_dct_coefficients *coefficients, float *rgb) {
    return number == LW_TILE_CODEC_DCT && lw_tile_dct_decode(&codec->dct, LW_TILE_DCT_DELTA, src, src_size,
                                                             scale, width, height, coefficients, rgb)
               ? LW_OK
               : LW_BAD_DATA;
}
