#include "tests/support/support.h"

#include "server/serve/tiles/priority.h"

#include <math.h>
#include <stdlib.h>

/* Levels 200x100, 100x50, 50x25, 25x13, 13x7 of one object: 8 + 2 + 1 + 1 + 1 tiles. */
struct world {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_priority priority;
};

static int init_world(void **state) {
    struct world *w = calloc(1, sizeof *w);
    assert_non_null(w);
    w->scene = lw_support_squares(1, 1);
    w->scene->mesh[0].atlas_width = 200;
    w->scene->mesh[0].atlas_height = 100;
    lw_support_ok(lw_atlas_map_init(&w->map, w->scene), NULL);
    lw_support_ok(lw_priority_init(&w->priority, &w->map), NULL);
    *state = w;
    return 0;
}

static int finish_world(void **state) {
    struct world *w = *state;
    lw_priority_finish(&w->priority);
    lw_atlas_map_finish(&w->map);
    lw_scene_destroy(w->scene);
    free(w);
    return 0;
}

static void what_moved_further_is_more_urgent(void **state) {
    struct world *w = *state;
    for (uint32_t t = 0; t < 3; t++) lw_priority_note(&w->priority, t, 1, 1);
    for (uint64_t version = 2; version <= 5; version++) {
        lw_priority_note(&w->priority, 0, version, 0.1f);
        lw_priority_note(&w->priority, 1, version, 0.2f);
    }
    assert_true(lw_priority_of(&w->priority, 1, 1, 5) > lw_priority_of(&w->priority, 0, 1, 5));
    assert_true(lw_priority_of(&w->priority, 0, 5, 5) == 0);
    assert_true(lw_priority_of(&w->priority, 2, 1, 5) == 0);
    /* 64 x 64 texels, 0.2 off, for two frames; more is not remembered than there is */
    assert_float_equal(lw_priority_of(&w->priority, 1, 4, 6), 0.04f * 4096 * 4, 0.1f);
    for (uint64_t version = 6; version <= 100; version++) lw_priority_note(&w->priority, 0, version, 0.1f);
    assert_float_equal(lw_priority_of(&w->priority, 0, 1, 93), 0.08f * 4096, 1);
}

/* As after days of a lamp that flickers. */
static void small_changes_count_after_many_large_ones(void **state) {
    struct world *w = *state;
    uint64_t version = 1;
    for (; version <= 100000; version++) lw_priority_note(&w->priority, 0, version, 100);
    lw_priority_note(&w->priority, 0, version, 0.01f);
    assert_float_equal(lw_priority_of(&w->priority, 0, version - 1, version), 1e-4f * 4096, 1e-4f);
}

static void what_waits_grows_more_urgent(void **state) {
    struct world *w = *state;
    lw_priority_note(&w->priority, 0, 2, 0.1f);
    lw_priority_note(&w->priority, 0, 3, 0.1f);
    assert_true(lw_priority_of(&w->priority, 0, 2, 50) > 2 * lw_priority_of(&w->priority, 0, 2, 10));
}

static void what_was_never_sent_goes_coarse_first(void **state) {
    struct world *w = *state;
    assert_true(isinf(lw_priority_of(&w->priority, 12, 0, 1)));
    for (uint32_t t = 0; t < 11; t++) {
        const float finer = lw_priority_of(&w->priority, t, 0, 1),
                    coarser = lw_priority_of(&w->priority, t + 1, 0, 1);
        assert_true(finer > 0);
        assert_true(w->map.place[t].level == w->map.place[t + 1].level ? finer == coarser : finer < coarser);
    }
}

static void lists_are_put_in_order(void **state) {
    struct world *w = *state;
    static const float value[] = {0, 1e-30f, 3, INFINITY, 3, 1, 1e30f, 2, 0, 4, 1.05f};
    static const uint32_t order[] = {3, 6, 9, 2, 4, 7, 5, 10, 0, 1, 8}; /* 1 and 1.05: as good as the same */
    uint32_t out[13];
    for (int again = 0; again < 2; again++) {
        lw_priority_list_begin(&w->priority);
        for (uint32_t i = 0; i < 11; i++) lw_priority_list(&w->priority, i, value[i]);
        assert_int_equal(w->priority.listed_count, 11);
        lw_priority_list_end(&w->priority, out);
        for (uint32_t i = 0; i < 11; i++) assert_int_equal(out[i], order[i]);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_moved_further_is_more_urgent, init_world, finish_world),
        cmocka_unit_test_setup_teardown(small_changes_count_after_many_large_ones, init_world, finish_world),
        cmocka_unit_test_setup_teardown(what_waits_grows_more_urgent, init_world, finish_world),
        cmocka_unit_test_setup_teardown(what_was_never_sent_goes_coarse_first, init_world, finish_world),
        cmocka_unit_test_setup_teardown(lists_are_put_in_order, init_world, finish_world),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
