/* The pictures of a comparison; its thread is tested with the window (test_window). */
#include "tests/support/support.h"

#include "client/view/window/comparison.h"

#include <math.h>

enum { WIDTH = 4, HEIGHT = 2, OUT_WIDTH = 8, OUT_HEIGHT = 4 };

static void fill(float *rgb, int count, float value) {
    for (int i = 0; i < 3 * count; i++) rgb[i] = value;
}

static void test_wipe(void **state) {
    (void)state;
    float rgb[3 * WIDTH * HEIGHT];
    uint32_t out[OUT_WIDTH * OUT_HEIGHT];
    fill(rgb, WIDTH * HEIGHT, 1);
    rgb[3 * (WIDTH - 1)] = rgb[3 * (WIDTH - 1) + 1] = rgb[3 * (WIDTH - 1) + 2] = 0; /* upper right: black */
    const struct lw_comparison_picture picture = {.rgb = rgb, .width = WIDTH, .height = HEIGHT, .samples = 1};
    for (uint32_t left = 1; left <= OUT_WIDTH; left++) {
        out[(OUT_WIDTH - left) * OUT_HEIGHT] = 0x12345678u; /* one more than it fills */
        lw_comparison_wipe(&picture, LW_TONEMAP_NONE, 0, OUT_WIDTH, OUT_HEIGHT, left, out);
        assert_int_equal(out[(OUT_WIDTH - left) * OUT_HEIGHT], 0x12345678u);
        if (left + 3 > OUT_WIDTH) continue;
        assert_int_equal(out[0], 0xffffffffu); /* the line */
        assert_int_equal(out[OUT_WIDTH - left - 1], 0xff000000u);
        assert_int_equal(out[(OUT_WIDTH - left) * OUT_HEIGHT - 1], 0xffffffffu);
    }
}

static void test_difference(void **state) {
    (void)state;
    float rgb[3 * WIDTH * HEIGHT], other[3 * 2 * WIDTH * 2 * HEIGHT];
    uint32_t out[OUT_WIDTH * OUT_HEIGHT];
    const struct lw_comparison_picture picture = {.rgb = rgb, .width = WIDTH, .height = HEIGHT, .samples = 1};
    fill(rgb, WIDTH * HEIGHT, 2);
    fill(other, 4 * WIDTH * HEIGHT, 2);
    double off = lw_comparison_difference(&picture, other, 2 * WIDTH, 2 * HEIGHT, OUT_WIDTH, OUT_HEIGHT, out);
    assert_float_equal(off, 0, 1e-6);
    assert_true((out[0] & 0xff) > (out[0] >> 8 & 0xff) && (out[0] & 0xff) > (out[0] >> 16 & 0xff)); /* blue */
    fill(other, 4 * WIDTH * HEIGHT, 4); /* by 100 %, but for the floor */
    off = lw_comparison_difference(&picture, other, 2 * WIDTH, 2 * HEIGHT, OUT_WIDTH, OUT_HEIGHT, out);
    assert_true(fabs(off - 1 / 1.01) < 1e-4);
    assert_true((out[5] >> 16 & 0xff) > (out[5] & 0xff) &&
                (out[5] >> 16 & 0xff) > (out[5] >> 8 & 0xff)); /* red */
    /* detail that the traced picture cannot have does not count */
    for (int i = 0; i < 4 * WIDTH * HEIGHT; i++)
        for (int c = 0; c < 3; c++) other[3 * i + c] = i % 2 ? 3 : 1;
    off = lw_comparison_difference(&picture, other, 2 * WIDTH, 2 * HEIGHT, OUT_WIDTH, OUT_HEIGHT, out);
    assert_float_equal(off, 0, 1e-6);
    /* a smaller one, as while things move */
    fill(other, 1, 2);
    off = lw_comparison_difference(&picture, other, 1, 1, OUT_WIDTH, OUT_HEIGHT, out);
    assert_float_equal(off, 0, 1e-6);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wipe),
        cmocka_unit_test(test_difference),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
