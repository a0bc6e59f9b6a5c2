#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/tile/tile_codec.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

static struct lw_tile_codec *codec;
static uint8_t *payload;
static float rgb[LW_TILE_TEXELS_MAX * 3], back[LW_TILE_TEXELS_MAX * 3];

static int set_up(void **state) {
    (void)state;
    payload = malloc(lw_tile_codec_bound());
    return lw_tile_codec_create(&codec) == LW_OK && payload ? 0 : -1;
}

static int tear_down(void **state) {
    (void)state;
    lw_tile_codec_destroy(codec);
    free(payload);
    return 0;
}

/* Encodes and decodes the first width * height texels of rgb; returns the count of saturated channels. */
static uint32_t round_trip(uint32_t width, uint32_t height, float *out_scale) {
    size_t size;
    uint32_t saturated;
    lw_support_ok(lw_tile_codec_encode_half(codec, NULL, rgb, width, height, payload, lw_tile_codec_bound(),
                                            &size, out_scale, &saturated),
                  NULL);
    lw_support_ok(lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, payload, size, *out_scale, width,
                                       height, NULL, back),
                  NULL);
    return saturated;
}

static void test_error_is_that_of_half_floats(void **state) {
    (void)state;
    const float largest[] = {1e-6f, 0.3f, 80000, 3e6f,
                             1e12f}; /* a sun is 80,000 lux and more; halves end at 65,504 */
    for (size_t m = 0; m < sizeof largest / sizeof largest[0]; m++) {
        for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++)
            rgb[i] = largest[m] * lw_random_unit(lw_random_hash2(i, (uint32_t)m));
        rgb[5] = largest[m];
        float scale;
        assert_int_equal(round_trip(LW_TILE_SIDE, LW_TILE_SIDE, &scale), 0);
        int exponent;
        assert_true(frexpf(scale, &exponent) == 0.5f); /* a power of two */
        for (uint32_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++)
            assert_true(fabsf(back[i] - rgb[i]) <= rgb[i] * 0x1p-11f + largest[m] * 0x1p-38f);
    }
}

static void test_what_has_no_number_is_counted(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 48; i++) rgb[i] = 2;
    rgb[3] = NAN;
    rgb[4] = INFINITY;
    rgb[5] = -1;
    float scale;
    assert_int_equal(round_trip(4, 4, &scale), 3);
    for (uint32_t i = 0; i < 48; i++) assert_true(back[i] == (i >= 3 && i <= 5 ? 0.0f : 2.0f));
}

static void test_one_texel_and_black(void **state) {
    (void)state;
    float scale;
    memset(rgb, 0, sizeof rgb);
    assert_int_equal(round_trip(1, 1, &scale), 0);
    assert_true(scale == 1 && back[0] == 0 && back[2] == 0);
    rgb[1] = 0x1p-140f; /* denormal */
    round_trip(1, 1, &scale);
    assert_true(isfinite(back[1]));
}

static void test_hostile_payloads_are_refused(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 192; i++) rgb[i] = (float)(i % 7);
    size_t size;
    float scale;
    uint32_t saturated;
    lw_support_ok(lw_tile_codec_encode_half(codec, NULL, rgb, 8, 8, payload, lw_tile_codec_bound(), &size,
                                            &scale, &saturated),
                  NULL);
    for (size_t n = 0; n < size; n++)
        assert_int_equal(
            lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, payload, n, scale, 8, 8, NULL, back),
            LW_BAD_DATA);
    assert_int_equal(
        lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, payload, size, scale, 8, 7, NULL, back),
        LW_BAD_DATA);
    assert_int_equal(
        lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, payload, size, scale, 64, 64, NULL, back),
        LW_BAD_DATA);
    assert_int_equal(
        lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, payload, size, scale, 65, 64, NULL, back),
        LW_BAD_DATA);
    const float bad[] = {0, -1, NAN, INFINITY, 0x1p112f};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        assert_int_equal(lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, payload, size, bad[i], 8,
                                              8, NULL, back),
                         LW_BAD_DATA);
    /* Flipped bits: refused, or finite numbers. */
    for (size_t bit = 0; bit < size * 8; bit++) {
        payload[bit / 8] ^= (uint8_t)(1u << bit % 8);
        if (lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, payload, size, scale, 8, 8, NULL,
                                 back) == LW_OK)
            for (uint32_t i = 0; i < 192; i++) assert_true(isfinite(back[i]) && back[i] >= 0);
        payload[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
}

static enum lw_status decode_frame(const uint8_t *bytes, size_t size) {
    return lw_tile_codec_decode(codec, NULL, LW_TILE_CODEC_HALF_ZSTD, bytes, size, 1, 1, 1, NULL, back);
}

/* zstd would take all of these. */
static void test_only_one_frame_of_known_size(void **state) {
    (void)state;
    const uint8_t texel[6] = {0};
    static uint8_t frames[400];
    size_t size = ZSTD_compress(frames, sizeof frames, texel, sizeof texel, 1);
    lw_support_ok(decode_frame(frames, size), NULL);
    size_t more = ZSTD_compress(frames + size, sizeof frames - size, texel, 0, 1);
    assert_int_equal(decode_frame(frames, size + more), LW_BAD_DATA); /* an empty frame after it */
    const uint8_t skippable[] = {0x50, 0x2a, 0x4d, 0x18, 0, 0, 0, 0};
    memcpy(frames + size, skippable, sizeof skippable);
    assert_int_equal(decode_frame(frames, size + sizeof skippable), LW_BAD_DATA);
    size_t half = ZSTD_compress(frames, sizeof frames, texel, 3, 1);
    half += ZSTD_compress(frames + half, sizeof frames - half, texel, 3, 1);
    assert_int_equal(decode_frame(frames, half), LW_BAD_DATA); /* in two halves */
    ZSTD_CCtx *compress = ZSTD_createCCtx();
    assert_non_null(compress);
    ZSTD_CCtx_setParameter(compress, ZSTD_c_contentSizeFlag, 0);
    size = ZSTD_compress2(compress, frames, sizeof frames, texel, sizeof texel);
    ZSTD_freeCCtx(compress);
    assert_false(ZSTD_isError(size));
    assert_int_equal(decode_frame(frames, size), LW_BAD_DATA); /* a frame without its size */
}

static void test_unknown_codecs_are_refused(void **state) {
    (void)state;
    const uint8_t nothing[8] = {0};
    assert_false(lw_tile_codec_is_known(0) || lw_tile_codec_is_known(3) || lw_tile_codec_is_known(5));
    assert_int_equal(lw_tile_codec_decode(codec, NULL, 3, nothing, sizeof nothing, 1, 1, 1, NULL, back),
                     LW_BAD_DATA);
}

static void test_encode_checks_its_room(void **state) {
    (void)state;
    size_t size;
    float scale;
    uint32_t saturated;
    assert_int_equal(lw_tile_codec_encode_half(codec, NULL, rgb, 64, 64, payload, lw_tile_codec_bound() - 1,
                                               &size, &scale, &saturated),
                     LW_INTERNAL);
    assert_int_equal(lw_tile_codec_encode_half(codec, NULL, rgb, 64, 65, payload, lw_tile_codec_bound(),
                                               &size, &scale, &saturated),
                     LW_INTERNAL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_error_is_that_of_half_floats),
        cmocka_unit_test(test_what_has_no_number_is_counted),
        cmocka_unit_test(test_one_texel_and_black),
        cmocka_unit_test(test_hostile_payloads_are_refused),
        cmocka_unit_test(test_only_one_frame_of_known_size),
        cmocka_unit_test(test_unknown_codecs_are_refused),
        cmocka_unit_test(test_encode_checks_its_room),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
