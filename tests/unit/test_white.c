#include "tests/support/support.h"

#include "server/publish/white.h"

#include <string.h>

#define SIDE  LW_TILE_SIDE
#define SMALL 8u

/* Two objects: an atlas of 2 x 2 tiles, which are 256 squares, and one of a single square. */
struct world {
    struct lw_scene scene;
    struct lw_mesh mesh[2];
    struct lw_object object[2];
    struct lw_atlas_map map;
    struct lw_white white;
    bool hidden[2];
};

static void init_world(struct world *w) {
    memset(w, 0, sizeof *w);
    w->mesh[0].atlas_width = w->mesh[0].atlas_height = 2 * SIDE;
    w->mesh[1].atlas_width = w->mesh[1].atlas_height = SMALL;
    w->object[1].mesh = 1;
    w->scene = (struct lw_scene){.mesh = w->mesh, .mesh_count = 2, .object = w->object, .object_count = 2};
    lw_support_ok(lw_atlas_map_init(&w->map, &w->scene), NULL);
    lw_support_ok(lw_white_init(&w->white, &w->map), NULL);
}

static void finish_world(struct world *w) {
    lw_white_finish(&w->white);
    lw_atlas_map_finish(&w->map);
}

/* `rows` rows of texels have the light `first`, those after them `rest`; a third of it is direct. 0: no
 * surface. */
static void note(struct world *w, lw_tile_id id, uint32_t rows, float first, float rest) {
    static float direct[SIDE * SIDE], indirect[SIDE * SIDE];
    static uint8_t covered[SIDE * SIDE];
    const uint32_t side = w->map.place[id.v].width;
    for (uint32_t i = 0; i < side * side; i++) {
        const float e = i / side < rows ? first : rest;
        direct[i] = e / 3;
        indirect[i] = e - e / 3;
        covered[i] = e > 0;
    }
    struct lw_solver_tile tile = {.covered = covered, .width = side, .height = side};
    for (int c = 0; c < 3; c++) {
        tile.direct[c] = direct;
        tile.indirect[c] = indirect;
    }
    lw_white_note(&w->white, id, &tile);
}

static void note_large(struct world *w, float e) {
    for (uint32_t t = 0; t < 4; t++) note(w, lw_atlas_map_find(&w->map, 0, 0, t % 2, t / 2), 0, 0, e);
}

static void note_small(struct world *w, uint32_t rows, float first, float rest) {
    note(w, lw_atlas_map_find(&w->map, 1, 0, 0, 0), rows, first, rest);
}

static void expect_white(const struct world *w, float expected) {
    const float white = lw_white_find(&w->white, w->hidden);
    assert_true(white <= expected * 1.0001f && white >= expected * 0.8f);
}

static void test_no_light_has_no_white(void **state) {
    (void)state;
    struct world w;
    init_world(&w);
    assert_true(lw_white_find(&w.white, w.hidden) == 0);
    note_large(&w, 0);
    assert_true(lw_white_find(&w.white, w.hidden) == 0);
    finish_world(&w);
}

static void test_white_is_what_nearly_all_light_is_under(void **state) {
    (void)state;
    struct world w;
    const lw_tile_id id = {0};
    init_world(&w);
    note_large(&w, 3);
    expect_white(&w, 3);
    note(&w, id, 8, 1000, 3); /* a row of eight squares of 256 */
    expect_white(&w, 1000);
    note(&w, id, 0, 0, 3); /* replaces the last one */
    expect_white(&w, 3);
    finish_world(&w);
}

/* Such as the cage of a lamp. */
static void test_a_small_object_counts_by_its_squares(void **state) {
    (void)state;
    struct world w;
    init_world(&w);
    note_small(&w, 0, 0, 1000);
    expect_white(&w, 1000);
    note_large(&w, 3);
    expect_white(&w, 3);
    finish_world(&w);
}

static void test_hidden_objects_do_not_count(void **state) {
    (void)state;
    struct world w;
    init_world(&w);
    note_large(&w, 3);
    note_small(&w, 0, 0, 1000);
    w.hidden[0] = true;
    expect_white(&w, 1000);
    w.hidden[1] = true;
    expect_white(&w, 0);
    finish_world(&w);
}

/* Texels without surface do not count. */
static void test_a_square_is_its_mean(void **state) {
    (void)state;
    struct world w;
    init_world(&w);
    note_small(&w, 2, 2048, 0);
    expect_white(&w, 2048);
    note_small(&w, 2, 2048, 1e-30f);
    expect_white(&w, 512);
    finish_world(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_no_light_has_no_white),
        cmocka_unit_test(test_white_is_what_nearly_all_light_is_under),
        cmocka_unit_test(test_a_small_object_counts_by_its_squares),
        cmocka_unit_test(test_hidden_objects_do_not_count),
        cmocka_unit_test(test_a_square_is_its_mean),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
