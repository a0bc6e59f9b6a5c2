#include "tests/support/support.h"

#include "common/base/random.h"
#include "server/publish/levels.h"

#include <string.h>

#define SIDE 64u

static float plane[3][SIDE * SIDE];
static uint8_t covered[SIDE * SIDE];
static struct lw_tile_place place = {.width = SIDE, .height = SIDE};

static void load(struct lw_levels *levels) {
    struct lw_atlas atlas;
    lw_atlas_init(&atlas, SIDE, SIDE);
    lw_support_ok(lw_levels_init(levels, LW_TILE_CHANNEL_FULL, &atlas), NULL);
    struct lw_solver_tile tile = {.covered = covered, .width = SIDE, .height = SIDE};
    for (int c = 0; c < 3; c++) tile.shown[LW_TILE_CHANNEL_FULL][c] = plane[c];
    lw_levels_load_tile(levels, &place, &tile);
    lw_levels_build(levels);
}

static float red(const struct lw_levels *levels, uint32_t level, uint32_t x, uint32_t y) {
    return levels->level[level].value[(y * levels->level[level].width + x) * 3];
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
    lw_support_ok(lw_levels_init(&levels, LW_TILE_CHANNEL_FULL, &atlas), NULL);
    struct lw_solver_tile tile = {.covered = covered, .filled = filled, .width = SIDE, .height = SIDE};
    for (int c = 0; c < 3; c++) tile.shown[LW_TILE_CHANNEL_FULL][c] = plane[c];
    lw_levels_load_tile(&levels, &place, &tile);
    lw_levels_build(&levels);
    assert_true(red(&levels, 0, 1, 0) == 10);
    assert_true(red(&levels, 0, 0, 1) == 4); /* filled here, from covered texels alone */
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
    for (uint32_t i = 0; i < coarse->width * coarse->height; i++) assert_true(coarse->value[i * 3] == 5);
    assert_true(red(&levels, 0, 0, 0) == 0); /* far from any chart: nothing, which costs nothing to send */
    lw_levels_finish(&levels);
}

/* Nor beside texels that are the mean of gutters alone. */
static void test_coarsest_level_is_filled_from_gutters(void **state) {
    (void)state;
    static uint8_t filled[SIDE * SIDE];
    memset(covered, 0, sizeof covered);
    memset(plane, 0, sizeof plane);
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE;
             x++) { /* a chart, a gutter around it, and a corner far from the chart */
            covered[y * SIDE + x] = x < 40;
            filled[y * SIDE + x] = x >= 40 && x < 60;
            plane[0][y * SIDE + x] = x < 40 ? 4 : x < 60 ? 10 : 0;
        }
    struct lw_levels levels;
    struct lw_atlas atlas;
    lw_atlas_init(&atlas, SIDE, SIDE);
    lw_support_ok(lw_levels_init(&levels, LW_TILE_CHANNEL_FULL, &atlas), NULL);
    struct lw_solver_tile tile = {.covered = covered, .filled = filled, .width = SIDE, .height = SIDE};
    for (int c = 0; c < 3; c++) tile.shown[LW_TILE_CHANNEL_FULL][c] = plane[c];
    lw_levels_load_tile(&levels, &place, &tile);
    lw_levels_build(&levels);
    const uint32_t last = levels.count - 1, side = SIDE >> last;
    for (uint32_t y = 0; y < side; y++) assert_true(red(&levels, last, side - 1, y) == 10);
    lw_levels_finish(&levels);
}

/* ---- parts ---- */

#define WIDTH  195u /* tiles of 64 and one of 3 texels */
#define HEIGHT 330u

/* An atlas as the solver holds it, tile by tile. */
struct solved {
    struct lw_atlas atlas;
    struct lw_tile_place place[24];
    float light[24][3][LW_TILE_TEXELS_MAX];
    uint8_t covered[24][LW_TILE_TEXELS_MAX], filled[24][LW_TILE_TEXELS_MAX];
    uint32_t seed;
};

static uint32_t next(struct solved *s) { return s->seed = lw_random_hash(s->seed + 1); }

/* Some squares with light, some texels that the solver has filled. */
static void solve_tile(struct solved *s, uint32_t t) {
    const struct lw_tile_place *at = &s->place[t];
    memset(s->covered[t], 0, sizeof s->covered[t]);
    memset(s->filled[t], 0, sizeof s->filled[t]);
    for (int k = 0; k < 6; k++) {
        const uint32_t x0 = next(s) % 64, y0 = next(s) % 64, side = 1 + next(s) % 20;
        for (uint32_t y = y0; y < y0 + side && y < at->height; y++)
            for (uint32_t x = x0; x < x0 + side && x < at->width; x++) s->covered[t][y * at->width + x] = 1;
    }
    for (uint32_t i = 0; i < at->width * at->height; i++) {
        s->filled[t][i] = !s->covered[t][i] && next(s) % 40 == 0;
        for (int c = 0; c < 3; c++)
            s->light[t][c][i] = s->covered[t][i] || s->filled[t][i] ? (float)(next(s) % 1000) : 0;
    }
}

static void load_tile(struct solved *s, uint32_t t, struct lw_levels *levels) {
    struct lw_solver_tile tile = {.covered = s->covered[t],
                                  .filled = s->filled[t],
                                  .width = s->place[t].width,
                                  .height = s->place[t].height};
    for (int c = 0; c < 3; c++) tile.shown[LW_TILE_CHANNEL_FULL][c] = s->light[t][c];
    lw_levels_load_tile(levels, &s->place[t], &tile);
}

/* What differs between two pyramids lies in tiles that say so of themselves; returns how many tiles do. */
static uint32_t count_changed(const struct lw_levels *levels, const struct lw_levels *before,
                              const struct lw_atlas *atlas) {
    uint32_t changed = 0;
    for (uint32_t l = 0; l < levels->count; l++)
        for (uint32_t n = 0; n < atlas->level[l].tiles_x * atlas->level[l].tiles_y; n++) {
            static float rgb[2][LW_TILE_TEXELS_MAX * 3];
            static uint8_t light[2][LW_TILE_TEXELS_MAX];
            struct lw_tile_place at = {
                .level = l, .x = n % atlas->level[l].tiles_x, .y = n / atlas->level[l].tiles_x};
            const uint32_t right = atlas->level[l].width - at.x * LW_TILE_SIDE,
                           below = atlas->level[l].height - at.y * LW_TILE_SIDE;
            at.width = right < LW_TILE_SIDE ? right : LW_TILE_SIDE;
            at.height = below < LW_TILE_SIDE ? below : LW_TILE_SIDE;
            lw_levels_store_tile(levels, &at, rgb[0], light[0]);
            lw_levels_store_tile(before, &at, rgb[1], light[1]);
            const bool same = !memcmp(rgb[0], rgb[1], sizeof(float) * 3 * at.width * at.height) &&
                              !memcmp(light[0], light[1], (size_t)at.width * at.height);
            assert_true(same || lw_levels_has_changed(levels, &at));
            changed += lw_levels_has_changed(levels, &at);
        }
    return changed;
}

/* Building what hangs on some tiles gives what building all of them does. */
static void test_parts_are_as_the_whole(void **state) {
    (void)state;
    static struct solved s;
    s.seed = 1;
    lw_atlas_init(&s.atlas, WIDTH, HEIGHT);
    assert_true(s.atlas.level[0].tiles_x == 4 && s.atlas.level[0].tiles_y == 6 && s.atlas.level_count > 4);
    struct lw_levels parts, before;
    lw_support_ok(lw_levels_init(&parts, LW_TILE_CHANNEL_FULL, &s.atlas), NULL);
    for (uint32_t t = 0; t < 24; t++) {
        s.place[t] = (struct lw_tile_place){.x = t % 4, .y = t / 4};
        s.place[t].width = t % 4 == 3 ? WIDTH - 192 : 64;
        s.place[t].height = t / 4 == 5 ? HEIGHT - 320 : 64;
        solve_tile(&s, t);
        load_tile(&s, t, &parts);
    }
    lw_levels_build(&parts);
    lw_support_ok(lw_levels_init(&before, LW_TILE_CHANNEL_FULL, &s.atlas), NULL);
    for (uint32_t t = 0; t < 24; t++) load_tile(&s, t, &before);
    lw_levels_build(&before);
    for (int round = 0; round < 40; round++) {
        struct lw_levels whole;
        for (uint32_t k = 0; k <= (uint32_t)round % 3; k++) {
            const uint32_t t = next(&s) % 24;
            solve_tile(&s, t);
            load_tile(&s, t, &parts);
        }
        lw_levels_build(&parts);
        lw_support_ok(lw_levels_init(&whole, LW_TILE_CHANNEL_FULL, &s.atlas), NULL);
        for (uint32_t t = 0; t < 24; t++) load_tile(&s, t, &whole);
        lw_levels_build(&whole);
        for (uint32_t l = 0; l < whole.count; l++) {
            const size_t texels = (size_t)whole.level[l].width * whole.level[l].height;
            assert_memory_equal(parts.level[l].covered, whole.level[l].covered, texels);
            assert_memory_equal(parts.level[l].value, whole.level[l].value, texels * 3 * sizeof(float));
        }
        const uint32_t changed = count_changed(&parts, &before, &s.atlas);
        if (round % 3 == 0) assert_true(changed <= 9 + 4 + 4 + 4);
        lw_levels_finish(&before);
        before = whole;
    }
    lw_levels_finish(&before);
    lw_levels_finish(&parts);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_charts_do_not_mix_up_to_level_two),
        cmocka_unit_test(test_mean_is_over_covered_texels),
        cmocka_unit_test(test_filled_gutters_are_kept),
        cmocka_unit_test(test_coarsest_level_has_no_hole),
        cmocka_unit_test(test_coarsest_level_is_filled_from_gutters),
        cmocka_unit_test(test_parts_are_as_the_whole),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
