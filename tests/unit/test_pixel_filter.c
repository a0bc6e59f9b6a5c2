#include "tests/support/support.h"

#include "common/scene/pixel_filter.h"

#include <string.h>

#define PIXELS_MAX 1800u

/* As docs/scene_package.md has it. */
static void the_example_is_as_documented(void **state) {
    (void)state;
    static const uint8_t rgba[] = {10, 20, 30, 255, 11, 22, 33, 255, 10, 20, 40, 255, 13, 23, 33, 254},
                         filtered[] = {0xf6, 0xff, 0x00, 0x01, 0x14, 0x02, 0x00, 0x01,
                                       0x0a, 0x01, 0x0a, 0xf6, 0xff, 0x00, 0x00, 0xff};
    uint8_t out[sizeof rgba], back[sizeof rgba];
    lw_pixel_filter_apply(rgba, 2, 2, out);
    assert_memory_equal(out, filtered, sizeof filtered);
    lw_pixel_filter_undo(out, 2, 2, back);
    assert_memory_equal(back, rgba, sizeof rgba);
}

static void any_pixels_come_back_and_any_bytes_are_pixels(void **state) {
    (void)state;
    static const uint32_t size[][2] = {{1, 1},   {1, 7},   {7, 1},   {2, 3},
                                       {16, 16}, {17, 23}, {600, 3}, {257, 2}};
    uint32_t noise = 1;
    for (size_t i = 0; i < sizeof size / sizeof size[0]; i++)
        for (int kind = 0; kind < 3; kind++) {
            uint8_t from[4 * PIXELS_MAX], there[4 * PIXELS_MAX], back[4 * PIXELS_MAX];
            const uint32_t w = size[i][0], h = size[i][1];
            for (uint32_t p = 0; p < 4 * w * h; p++) {
                noise = noise * 1664525u + 1013904223u;
                from[p] = kind == 0   ? (uint8_t)(noise >> 24)
                          : kind == 1 ? (uint8_t)(255 * (noise >> 31))
                                      : (uint8_t)p;
            }
            lw_pixel_filter_apply(from, w, h, there);
            lw_pixel_filter_undo(there, w, h, back);
            assert_memory_equal(back, from, 4 * w * h);
            lw_pixel_filter_undo(from, w, h, there);
            lw_pixel_filter_apply(there, w, h, back);
            assert_memory_equal(back, from, 4 * w * h);
        }
}

static void what_is_even_becomes_zeros(void **state) {
    (void)state;
    uint8_t rgba[4 * PIXELS_MAX], out[4 * PIXELS_MAX];
    for (uint32_t y = 0; y < 20; y++)
        for (uint32_t x = 0; x < 20; x++) memset(rgba + 4 * (20 * y + x), (int)(3 * y), 4);
    lw_pixel_filter_apply(rgba, 20, 20, out);
    uint32_t zeros = 0;
    for (uint32_t i = 0; i < 4 * 20 * 20; i++) zeros += out[i] == 0;
    assert_true(zeros >= 4 * 20 * 20 - 2 * 20);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_example_is_as_documented),
        cmocka_unit_test(any_pixels_come_back_and_any_bytes_are_pixels),
        cmocka_unit_test(what_is_even_becomes_zeros),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
