#include "tests/support/support.h"

#include "client/view/compose/show.h"

#include <math.h>
#include <string.h>

enum { TILES = 4 };

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    return ((const struct lw_client_tile *)context)[id.v];
}

static bool is_red(struct lw_vec3 c) { return c.x > c.y && c.x > c.z; }
static bool is_green(struct lw_vec3 c) { return c.y > c.x && c.y > c.z; }
static bool is_blue(struct lw_vec3 c) { return c.z > c.x && c.z > c.y; }
static bool is_violet(struct lw_vec3 c) { return c.x > c.y && c.z > c.y && !is_red(c) && !is_blue(c); }

static void test_names(void **state) {
    (void)state;
    char all[256] = "";
    for (int i = 0; i < LW_SHOW_COUNT; i++) {
        strcat(strcat(all, i ? "|" : ""), lw_show_name((enum lw_show)i));
        assert_true(strlen(lw_show_about((enum lw_show)i)) > 0);
    }
    assert_string_equal(all, LW_SHOW_CHOICES);
}

static void test_ramp(void **state) {
    (void)state;
    assert_true(is_blue(lw_show_ramp(-1)) && is_blue(lw_show_ramp(NAN)) && is_blue(lw_show_ramp(0)));
    assert_true(is_green(lw_show_ramp(0.5f)));
    assert_true(is_red(lw_show_ramp(1)) && is_red(lw_show_ramp(7)));
    for (unsigned a = 0; a < 4; a++)
        for (unsigned b = 0; b < a; b++) {
            const struct lw_vec3 x = lw_show_level_colour(a), y = lw_show_level_colour(b);
            assert_true(lw_vec3_length(lw_vec3_sub(x, y)) > 0.2f);
        }
    assert_float_equal(lw_show_level_colour(3).x, lw_show_level_colour(9).x, 0);
}

static void test_tiles(void **state) {
    (void)state;
    const uint64_t s = 1000000000;
    struct lw_client_tile there[TILES] = {{.version = 1, .arrived_ns = 2000 * s, .error = 0.0005f},
                                          {.version = 1, .arrived_ns = 1990 * s, .error = 0.0316f},
                                          {.version = 2, .arrived_ns = 1 * s, .error = 1.5f},
                                          {.version = 0}};
    struct lw_show_tiles of = {.count = TILES, .context = there, .tile = tile, .now_ns = 2000 * s};
    struct lw_vec3 c[TILES];
    for (int i = 0; i < 2; i++) {
        lw_show_colour_tiles(i ? LW_SHOW_ERROR : LW_SHOW_AGE, &of, c);
        assert_true(is_blue(c[0]) && is_green(c[1]) && is_red(c[2]) && is_violet(c[3]));
    }
}

static void test_interest(void **state) {
    (void)state;
    struct lw_attention a;
    struct lw_vec3 c[TILES];
    const uint8_t first[TILES] = {1, 0, 1, 0}, second[TILES] = {1, 0, 0, 0}, around[TILES] = {1, 1, 0, 0};
    lw_support_ok(lw_attention_init(&a, TILES), NULL);
    struct lw_show_tiles of = {.count = TILES, .attention = NULL, .around = around};
    lw_show_colour_tiles(LW_SHOW_INTEREST, &of, c);
    for (int i = 0; i < TILES; i++) assert_float_equal(c[i].x, LW_SHOW_BEHIND, 0);
    lw_attention_list(&a, first, around, 1000);
    lw_attention_list(&a, second, around, 2000);
    of.attention = &a;
    lw_show_colour_tiles(LW_SHOW_INTEREST, &of, c);
    assert_true(is_green(c[0]) && is_blue(c[1]));
    assert_true(c[2].x > 0.5f && c[2].y > 0.4f && c[2].z < 0.1f); /* yellow */
    assert_float_equal(c[3].x, LW_SHOW_BEHIND, 0);
    lw_attention_finish(&a);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_names),
        cmocka_unit_test(test_ramp),
        cmocka_unit_test(test_tiles),
        cmocka_unit_test(test_interest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
