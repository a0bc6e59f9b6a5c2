#include "tests/support/support.h"

#include "server/publish/levels.h"

#include <string.h>

#define SIDE 64u

static float plane[3][SIDE * SIDE];
static uint8_t covered[SIDE * SIDE];
static struct lw_tile_place place = {.width = SIDE, .height = SIDE};

static void load(struct lw_levels *levels) {
    struct lw_atlas atlas;
    lw_atlas_init(&atlas, SIDE, SIDE);
    lw_support_ok(lw_levels_init(levels, &atlas), NULL);
    struct lw_solver_tile tile = {.covered = covered, .width = SIDE, .height = SIDE};
    for (int c = 0; c < 3; c++) tile.light[c] = plane[c];
    lw_levels_load_tile(levels, &place, &tile);
    lw_levels_build(levels);
}

static float red(const struct lw_levels *levels, uint32_t level, uint32_t x, uint32_t y) {
    return levels->level[level].rgb[(y * levels->level[level].width + x) * 3];
}

/* Two charts: the left half holds 1, the right half 9, with columns 14..17 empty between them. */
static void test_charts_do_not_mix_up_to_level_two(void **state) {
    (void)state;
    memset(covered, 0, sizeof covered);
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE; x++) {
            if (x >= 14 && x < 18) continue; /* a gutter of two texels on either side of column 16 */
            covered[y * SIDE + x] = 1;
            for (int c = 0; c < 3; c++) plane[c][y * SIDE + x] = x < 16 ? 1 : 9;
        }
    struct lw_levels levels;
    load(&levels);
    for (uint32_t x = 0; x < SIDE; x++) assert_true(red(&levels, 0, x, 5) == (x < 16 ? 1 : 9));
    assert_int_equal(levels.count, 3);
    for (uint32_t l = 1; l <= 2; l++)
        for (uint32_t x = 0; x < SIDE >> l; x++) assert_true(red(&levels, l, x, 3) == (x < 16u >> l ? 1 : 9));
    lw_levels_finish(&levels);
}

static void test_mean_is_over_covered_texels(void **state) {
    (void)state;
    memset(covered, 0, sizeof covered);
    memset(plane, 0, sizeof plane);
    covered[0] = covered[SIDE + 1] = 1;
    plane[0][0] = 2;
    plane[0][SIDE + 1] = 4;
    struct lw_levels levels;
    load(&levels);
    assert_true(red(&levels, 1, 0, 0) == 3);
    lw_levels_finish(&levels);
}

/* A gutter that the solver has filled is read as it is, and is a part of coarser levels. */
static void test_filled_gutters_are_kept(void **state) {
    (void)state;
    static uint8_t filled[SIDE * SIDE];
    memset(covered, 0, sizeof covered);
    memset(plane, 0, sizeof plane);
    covered[0] = 1;
    plane[0][0] = 4;
    filled[1] = 1;
    plane[0][1] = 10;
    struct lw_levels levels;
    struct lw_atlas atlas;
    lw_atlas_init(&atlas, SIDE, SIDE);
    lw_support_ok(lw_levels_init(&levels, &atlas), NULL);
    struct lw_solver_tile tile = {.covered = covered, .filled = filled, .width = SIDE, .height = SIDE};
    for (int c = 0; c < 3; c++) tile.light[c] = plane[c];
    lw_levels_load_tile(&levels, &place, &tile);
    lw_levels_build(&levels);
    assert_true(red(&levels, 0, 1, 0) == 10);
    assert_true(red(&levels, 0, 0, 1) == 4); /* filled here, from what is covered alone */
    assert_true(red(&levels, 1, 0, 0) == 0.25f * (4 + 10 + 4 + 4));
    assert_int_equal(levels.level[1].covered[0], 1);
    lw_levels_finish(&levels);
}

static void test_coarsest_level_has_no_hole(void **state) {
    (void)state;
    memset(covered, 0, sizeof covered);
    memset(plane, 0, sizeof plane);
    covered[7 * SIDE + 9] = 1;
    plane[0][7 * SIDE + 9] = 5;
    struct lw_levels levels;
    load(&levels);
    const struct lw_levels_image *coarse = &levels.level[levels.count - 1];
    for (uint32_t i = 0; i < coarse->width * coarse->height; i++) assert_true(coarse->rgb[i * 3] == 5);
    assert_true(red(&levels, 0, 0, 0) == 0); /* far from any chart: nothing, which costs nothing to send */
    lw_levels_finish(&levels);
}

/* A sixteenth of a lightmap is bright. */
static void test_quantile(void **state) {
    (void)state;
    static uint64_t bin[LW_LEVELS_BINS];
    memset(bin, 0, sizeof bin);
    assert_true(lw_levels_quantile(bin, 0.99) == 0);
    memset(covered, 1, sizeof covered);
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        for (int c = 0; c < 3; c++) plane[c][i] = i / SIDE / 4 == 15 ? 1000 : 3;
    struct lw_levels levels;
    load(&levels);
    lw_levels_count_values(&levels, bin); /* 16 x 16 texels of the coarsest level, the last row bright */
    lw_levels_count_values(&levels, bin);
    assert_true(lw_levels_quantile(bin, 0.9) == 3);
    const float bright = lw_levels_quantile(bin, 0.99);
    assert_true(bright <= 1000 && bright >= 800);
    lw_levels_finish(&levels);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_charts_do_not_mix_up_to_level_two),
        cmocka_unit_test(test_mean_is_over_covered_texels),
        cmocka_unit_test(test_filled_gutters_are_kept),
        cmocka_unit_test(test_coarsest_level_has_no_hole),
        cmocka_unit_test(test_quantile),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
