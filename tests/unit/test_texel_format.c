#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/tile/texel_format.h"

#include <math.h>

static float from_half(uint16_t h) {
    const int exponent = h >> 10 & 31, mantissa = h & 0x3ff;
    return exponent ? ldexpf((float)(1024 + mantissa), exponent - 25) : ldexpf((float)mantissa, -24);
}

static void from_rgb9e5(uint32_t texel, float out[3]) {
    for (int i = 0; i < 3; i++) out[i] = ldexpf((float)(texel >> (9 * i) & 511), (int)(texel >> 27) - 15 - 9);
}

/* Every half there is comes back, and between two of them the nearer one, ties to even. */
static void test_halves(void **state) {
    (void)state;
    for (uint16_t h = 0; h < 0x7bff; h++) {
        const float low = from_half(h), high = from_half((uint16_t)(h + 1)), middle = low + (high - low) / 2;
        assert_int_equal(lw_texel_format_half(low), h);
        assert_int_equal(lw_texel_format_half(middle), h & 1 ? h + 1 : h);
        assert_int_equal(lw_texel_format_half(nextafterf(middle, 0)), h);
        assert_int_equal(lw_texel_format_half(nextafterf(middle, INFINITY)), h + 1);
    }
    assert_int_equal(lw_texel_format_half(1e9f), 0x7bff);
    assert_int_equal(lw_texel_format_half(INFINITY), 0x7bff);
    assert_int_equal(lw_texel_format_half(-1), 0);
    assert_int_equal(lw_texel_format_half(NAN), 0);
}

/* No channel is further off than half a step of the exponent that the largest one needs. */
static void test_rgb9e5(void **state) {
    (void)state;
    for (uint32_t n = 0; n < 20000; n++) {
        float rgb[3], back[3], largest = 0;
        for (uint32_t i = 0; i < 3; i++) {
            rgb[i] =
                ldexpf((float)(lw_random_hash2(n, i) >> 8), -24 + (int)(lw_random_hash2(n, 9) % 44) - 28);
            largest = fmaxf(largest, rgb[i]);
        }
        uint32_t texel;
        lw_texel_format_write(LW_TEXEL_FORMAT_RGB9E5, 1, rgb, 1, &texel);
        from_rgb9e5(texel, back);
        const float rounded = largest + ldexpf(1, ilogbf(fmaxf(largest, 0x1p-30f)) - 9);
        const float step = fmaxf(ldexpf(1, ilogbf(rounded) + 1 - 9), 0x1p-24f);
        for (int i = 0; i < 3; i++) assert_true(fabsf(back[i] - rgb[i]) <= step * 0.501f);
    }
    const float hard[][3] = {{511.9f, 1, 0}, {1, 1, 1}, {0, 0, 0}, {1e9f, INFINITY, 65408}, {NAN, -1, 0.5f}};
    const float want[][3] = {{512, 2, 0}, {1, 1, 1}, {0, 0, 0}, {65408, 65408, 65408}, {0, 0, 0.5f}};
    for (size_t k = 0; k < sizeof hard / sizeof *hard; k++) {
        float back[3];
        uint32_t texel;
        lw_texel_format_write(LW_TEXEL_FORMAT_RGB9E5, 1, hard[k], 1, &texel);
        from_rgb9e5(texel, back);
        assert_true(back[0] == want[k][0] && back[2] == want[k][2]);
        assert_true(fabsf(back[1] - want[k][1]) <= 1);
    }
}

static void test_all_formats(void **state) {
    (void)state;
    const float rgb[6] = {1, 2, 3, 0.5f, 0.25f, 4};
    uint16_t half[8];
    float three[6], four[8];
    lw_texel_format_write(LW_TEXEL_FORMAT_RGBA16F, 2, rgb, 2, half);
    lw_texel_format_write(LW_TEXEL_FORMAT_RGB32F, 2, rgb, 2, three);
    lw_texel_format_write(LW_TEXEL_FORMAT_RGBA32F, 2, rgb, 2, four);
    for (int t = 0; t < 2; t++)
        for (int i = 0; i < 3; i++) {
            assert_true(three[3 * t + i] == 2 * rgb[3 * t + i]);
            assert_true(four[4 * t + i] == 2 * rgb[3 * t + i]);
            assert_true(from_half(half[4 * t + i]) == 2 * rgb[3 * t + i]);
        }
    assert_true(four[3] == 1 && four[7] == 1 && half[3] == 0x3c00 && half[7] == 0x3c00);
    assert_int_equal(lw_texel_format_size(LW_TEXEL_FORMAT_RGB9E5), 4);
    assert_int_equal(lw_texel_format_size(LW_TEXEL_FORMAT_COUNT), 0);
}

static void test_vectors(void **state) {
    (void)state;
    const float xyz[6] = {-0.5f, 1e-4f, 0.75f, -2, INFINITY, NAN}, want[6] = {-0.5f, 1e-4f, 0.75f, -1, 1, 0};
    uint16_t half[8];
    float three[6], four[8];
    lw_texel_format_write_vectors(LW_TEXEL_FORMAT_RGBA16F, xyz, 2, half);
    lw_texel_format_write_vectors(LW_TEXEL_FORMAT_RGB32F, xyz, 2, three);
    lw_texel_format_write_vectors(LW_TEXEL_FORMAT_RGBA32F, xyz, 2, four);
    for (int t = 0; t < 2; t++)
        for (int i = 0; i < 3; i++) {
            const float expected = want[3 * t + i];
            const uint16_t h = half[4 * t + i];
            assert_true(three[3 * t + i] == expected && four[4 * t + i] == expected);
            assert_int_equal(h >> 15, expected < 0);
            assert_true(fabsf(from_half(h & 0x7fff) - fabsf(expected)) <= 0x1p-12f);
        }
    assert_true(four[3] == 1 && four[7] == 1 && half[3] == 0x3c00 && half[7] == 0x3c00);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_halves),
        cmocka_unit_test(test_rgb9e5),
        cmocka_unit_test(test_all_formats),
        cmocka_unit_test(test_vectors),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
