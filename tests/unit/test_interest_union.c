#include "tests/support/support.h"

#include "server/serve/tiles/interest_union.h"

#include <string.h>

/* Object 0: levels 200x100, 100x50, 50x25, 25x13, 13x7, which are 4 x 2, 2 x 1, 1, 1 and 1 tiles. Object 1
 * the same. */
struct fixture {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_interest_union interest_union;
};

static void start(struct fixture *f) {
    f->scene = lw_support_squares(2, 1.0f);
    f->scene->mesh[0].atlas_width = 200;
    f->scene->mesh[0].atlas_height = 100;
    lw_support_ok(lw_atlas_map_init(&f->map, f->scene), NULL);
    assert_int_equal(f->map.tile_count, 2 * 13);
    lw_support_ok(lw_interest_union_init(&f->interest_union, &f->map), NULL);
}

static void end(struct fixture *f) {
    lw_interest_union_finish(&f->interest_union);
    lw_atlas_map_finish(&f->map);
    lw_scene_destroy(f->scene);
}

static uint32_t id(const struct fixture *f, uint32_t object, uint32_t level, uint32_t x, uint32_t y) {
    lw_tile_id tile = lw_atlas_map_find(&f->map, object, level, x, y);
    assert_true(tile.v != UINT32_MAX);
    return tile.v;
}

/* The level-0 tiles of both objects, row by row, a digit each; and nothing on other levels. */
static void expect(const struct fixture *f, const char *digits) {
    uint8_t levels[26];
    char text[18] = "";
    memset(levels, 77, sizeof levels);
    lw_interest_union_levels(&f->interest_union, levels);
    for (uint32_t t = 0, n = 0; t < 26; t++) {
        if (f->map.place[t].level)
            assert_int_equal(levels[t], 0);
        else
            text[n++] = (char)('0' + levels[t]);
    }
    assert_string_equal(text, digits);
}

static void test_levels_cover_what_is_below(void **state) {
    (void)state;
    struct fixture f;
    start(&f);
    expect(&f, "0000000000000000");
    const uint32_t one[] = {id(&f, 0, 0, 2, 1)};
    lw_interest_union_add(&f.interest_union, one, 1);
    expect(&f, "0000001000000000");
    const uint32_t right_half[] = {id(&f, 0, 1, 1, 0)};
    lw_interest_union_add(&f.interest_union, right_half, 1);
    expect(&f, "0022001200000000");
    const uint32_t coarsest[] = {id(&f, 0, 4, 0, 0), id(&f, 1, 2, 0, 0)};
    lw_interest_union_add(&f.interest_union, coarsest, 2);
    expect(&f, "5522551233333333");
    lw_interest_union_remove(&f.interest_union, one, 1);
    lw_interest_union_remove(&f.interest_union, coarsest, 2);
    expect(&f, "0022002200000000");
    end(&f);
}

/* Only the first to want a tile and the last to leave it change anything. */
static void test_counts(void **state) {
    (void)state;
    struct fixture f;
    start(&f);
    const uint32_t a[] = {id(&f, 0, 0, 0, 0), id(&f, 0, 0, 1, 0)}, b[] = {id(&f, 0, 0, 1, 0)};
    assert_false(f.interest_union.changed);
    for (int i = 0; i < 1000; i++) {
        f.interest_union.changed = false;
        lw_interest_union_add(&f.interest_union, a, 2);
        lw_interest_union_add(&f.interest_union, b, 1);
        lw_interest_union_add_everything(&f.interest_union);
        assert_int_equal(f.interest_union.changed, i == 0);
    }
    assert_int_equal(f.interest_union.everything, 1000);
    for (int i = 0; i < 999; i++) lw_interest_union_remove(&f.interest_union, a, 2);
    for (int i = 0; i < 999; i++) lw_interest_union_remove_everything(&f.interest_union);
    for (int i = 0; i < 1000; i++) lw_interest_union_remove(&f.interest_union, b, 1);
    assert_false(f.interest_union.changed);
    expect(&f, "1100000000000000");
    lw_interest_union_remove_everything(&f.interest_union);
    assert_true(f.interest_union.changed);
    f.interest_union.changed = false;
    lw_interest_union_remove(&f.interest_union, a, 2);
    assert_true(f.interest_union.changed);
    expect(&f, "0000000000000000");
    end(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_levels_cover_what_is_below),
        cmocka_unit_test(test_counts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
