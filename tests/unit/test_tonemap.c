#include "tests/support/support.h"

#include "client/view/tonemap.h"
#include "common/base/colour.h"

#include <math.h>

static const enum lw_tonemap_curve curves[] = {LW_TONEMAP_REINHARD, LW_TONEMAP_ACES, LW_TONEMAP_NONE};

static void encode_grey(enum lw_tonemap_curve curve, float stops, float light, uint8_t out[3]) {
    struct lw_tonemap tonemap;
    lw_tonemap_init(&tonemap, curve, stops);
    lw_tonemap_encode(&tonemap, (float[3]){light, light, light}, 1, 3, out);
}

static void test_none_is_plain_srgb(void **state) {
    (void)state;
    struct lw_tonemap tonemap;
    lw_tonemap_init(&tonemap, LW_TONEMAP_NONE, 0);
    for (int i = 0; i <= 100000; i++) {
        float light = (float)i * 1e-5f;
        uint8_t code[3];
        lw_tonemap_encode(&tonemap, (float[3]){light, light, light}, 1, 3, code);
        float exact = 255.0f * lw_colour_to_srgb(light);
        /* the nearest code, except of values within rounding of the middle between two */
        assert_true(fabsf(exact - (float)code[0]) <= 0.5f + 1e-3f);
    }
    for (int i = 0; i < 256; i++) { /* every code comes back from its own light */
        float light = lw_colour_from_srgb8((uint8_t)i);
        uint8_t code[3];
        lw_tonemap_encode(&tonemap, (float[3]){light, light, light}, 1, 3, code);
        assert_int_equal(code[1], i);
    }
}

static void test_known_values(void **state) {
    (void)state;
    struct lw_vec3 c = lw_tonemap_apply(LW_TONEMAP_REINHARD, lw_vec3(1, 1, 1));
    assert_float_equal(c.x, 0.5f, 1e-6f);
    c = lw_tonemap_apply(LW_TONEMAP_REINHARD, lw_vec3(0.18f, 0.18f, 0.18f));
    assert_float_equal(c.y, 0.18f / 1.18f, 1e-6f);
    /* by luminance: channels keep their ratio */
    c = lw_tonemap_apply(LW_TONEMAP_REINHARD, lw_vec3(0.4f, 0.2f, 0.1f));
    assert_float_equal(c.x / c.z, 4.0f, 1e-5f);
    /* Narkowicz 2015: (1 (2.51 + 0.03)) / (1 (2.43 + 0.59) + 0.14) */
    c = lw_tonemap_apply(LW_TONEMAP_ACES, lw_vec3(1, 0, 0));
    assert_float_equal(c.x, 2.54f / 3.16f, 1e-6f);
    assert_float_equal(c.y, 0.0f, 1e-9f);
    c = lw_tonemap_apply(LW_TONEMAP_NONE, lw_vec3(0.25f, 7.0f, -1.0f));
    assert_float_equal(c.x, 0.25f, 0.0f);
    assert_float_equal(c.y, 1.0f, 0.0f);
    assert_float_equal(c.z, 0.0f, 0.0f);
}

static void test_monotone(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof curves / sizeof curves[0]; k++) {
        int before = 0, first = -1;
        for (float light = 1e-6f; light < 1e6f; light *= 1.02f) {
            uint8_t code[3];
            encode_grey(curves[k], 0, light, code);
            assert_int_equal(code[0], code[1]);
            assert_int_equal(code[1], code[2]);
            assert_true(code[0] >= before);
            before = code[0];
            if (first < 0) first = code[0];
        }
        assert_int_equal(first, 0);
        assert_true(before >= 254);
    }
}

static void test_a_stop_doubles(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof curves / sizeof curves[0]; k++) {
        uint8_t a[3], b[3];
        encode_grey(curves[k], 3, 0.02f, a);
        encode_grey(curves[k], 0, 0.16f, b);
        assert_memory_equal(a, b, 3);
    }
}

static void test_not_finite(void **state) {
    (void)state;
    const float rgb[9] = {NAN, NAN, NAN, INFINITY, INFINITY, INFINITY, -INFINITY, -1, -0.0f};
    for (size_t k = 0; k < sizeof curves / sizeof curves[0]; k++) {
        struct lw_tonemap tonemap;
        uint8_t code[12];
        lw_tonemap_init(&tonemap, curves[k], 60);
        lw_tonemap_encode(&tonemap, rgb, 3, 4, code);
        const uint8_t expected[12] = {0, 0, 0, 255, 255, 255, 255, 255, 0, 0, 0, 255};
        assert_memory_equal(code, expected, 12);
    }
}

enum { PIXELS = 1000 };

static void fill(float *rgb, size_t first, size_t last, float light) {
    for (size_t i = 3 * first; i < 3 * last; i++) rgb[i] = light;
}

static void test_auto_exposure(void **state) {
    (void)state;
    float rgb[3 * PIXELS];
    for (float light = 1e-4f; light < 1e5f; light *= 10) { /* an even picture is put at the key */
        fill(rgb, 0, PIXELS, light);
        assert_float_equal(lw_tonemap_auto_stops(rgb, PIXELS), log2f(0.18f / light), 1.0f / 16 + 1e-3f);
    }
    /* half of it four times as bright: two stops apart in the logarithm, so trimming leaves between 0 and
     * 2 */
    fill(rgb, 0, PIXELS / 2, 1);
    fill(rgb, PIXELS / 2, PIXELS, 4);
    float stops = lw_tonemap_auto_stops(rgb, PIXELS);
    assert_float_equal(stops, log2f(0.18f) - 2.0f * (0.40f / 0.85f), 0.1f);
}

static void test_auto_exposure_is_robust(void **state) {
    (void)state;
    float rgb[3 * PIXELS];
    fill(rgb, 0, PIXELS, 0.1f);
    float plain = lw_tonemap_auto_stops(rgb, PIXELS);
    fill(rgb, 0, PIXELS * 9 / 100, 1e5f); /* a sun patch */
    assert_float_equal(lw_tonemap_auto_stops(rgb, PIXELS), plain, 1e-4f);
    fill(rgb, PIXELS / 2, PIXELS, 0); /* black around the scene */
    fill(rgb, 0, PIXELS / 25, 0.1f);
    fill(rgb, PIXELS / 25, PIXELS * 9 / 100, 0.1f);
    rgb[0] = NAN, rgb[3] = INFINITY;
    assert_float_equal(lw_tonemap_auto_stops(rgb, PIXELS), plain, 1e-4f);
    fill(rgb, 0, PIXELS, 0);
    assert_float_equal(lw_tonemap_auto_stops(rgb, PIXELS), 0, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_none_is_plain_srgb),
        cmocka_unit_test(test_known_values),
        cmocka_unit_test(test_monotone),
        cmocka_unit_test(test_a_stop_doubles),
        cmocka_unit_test(test_not_finite),
        cmocka_unit_test(test_auto_exposure),
        cmocka_unit_test(test_auto_exposure_is_robust),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
