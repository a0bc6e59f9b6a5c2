#include "tests/support/support.h"

#include "common/base/clock.h"
#include "common/lightmap/lightmap.h"
#include "server/solve/geometry.h"
#include "server/solve/state/tiles.h"

#include <string.h>

#define LIMIT_NS 60000000000ull

/* A floor of three adjacent squares, each an object that may begin to move. */
struct floor {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_geometry geometry;
    struct lw_tiles tiles;
    uint64_t frame;
};

static void set_up(struct floor *floor) {
    floor->frame = 0;
    struct lw_error err = {0};
    floor->scene = lw_support_squares(3, 2);
    for (uint32_t i = 0; i < 3; i++)
        floor->scene->node[floor->scene->object[i].node].translation[0] = 2 * (float)i;
    lw_support_ok(
        lw_lightmap_build(floor->scene, &(struct lw_lightmap_desc){.texels_per_metre = 8}, NULL, &err), &err);
    lw_support_ok(lw_atlas_map_init(&floor->map, floor->scene), NULL);
    lw_support_ok(lw_pose_init(&floor->pose, floor->scene), NULL);
    lw_support_ok(lw_geometry_init(&floor->geometry, floor->scene, &floor->pose, NULL, 1, NULL, NULL, &err),
                  &err);
    lw_support_ok(lw_tiles_init(&floor->tiles, floor->scene, &floor->map, &floor->geometry.texels, 1, 1),
                  NULL);
    lw_support_ok(lw_geometry_find_seams(&floor->geometry, &floor->tiles, true), NULL);
    assert_int_equal(floor->geometry.seams_found, 1); /* there are none that could serve meanwhile */
}

static void tear_down(struct floor *floor) {
    lw_geometry_forget_tiles(&floor->geometry);
    lw_tiles_finish(&floor->tiles);
    lw_geometry_finish(&floor->geometry);
    lw_pose_finish(&floor->pose);
    lw_atlas_map_finish(&floor->map);
    lw_scene_destroy(floor->scene);
}

static void set_free(struct floor *floor, uint32_t object) {
    struct lw_error err = {0};
    floor->pose.object_dynamic[object] = true;
    lw_support_ok(lw_geometry_set_pose(&floor->geometry, &floor->pose, true, ++floor->frame, &err), &err);
}

static void await_seams(struct floor *floor, uint32_t found) {
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS; floor->geometry.seams_found < found;) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_geometry_find_seams(&floor->geometry, &floor->tiles, true), NULL);
    }
    assert_int_equal(floor->geometry.seams_found, found);
}

static void assert_same_seams(const struct lw_seams *a, const struct lw_seams *b) {
    assert_int_equal(a->row_count, b->row_count);
    assert_int_equal(a->member_count, b->member_count);
    assert_int_equal(a->component_count, b->component_count);
    assert_memory_equal(a->first_row, b->first_row, (a->component_count + 1) * sizeof *a->first_row);
    assert_memory_equal(a->first_member, b->first_member, (a->component_count + 1) * sizeof *a->first_member);
}

static void seams_that_are_found_later_are_the_same(void **state) {
    (void)state;
    struct floor at_once, later;
    set_up(&at_once);
    set_up(&later);
    uint32_t rows = at_once.geometry.seams.row_count;
    for (uint32_t object = 0; object < 2; object++) {
        set_free(&at_once, object);
        set_free(&later, object);
        lw_support_ok(lw_geometry_find_seams(&at_once.geometry, &at_once.tiles, false), NULL);
        await_seams(&later, 2 + object);
        assert_same_seams(&at_once.geometry.seams, &later.geometry.seams);
    }
    assert_true(at_once.geometry.seams.row_count < rows); /* it has no seam to the second any more */
    tear_down(&later);
    tear_down(&at_once);
}

/* Another object begins to move while seams without the first are sought: nobody gets these seams. */
static void a_search_that_is_overtaken_is_dropped(void **state) {
    (void)state;
    struct floor at_once, later;
    set_up(&at_once);
    set_up(&later);
    for (uint32_t object = 0; object < 2; object++) {
        set_free(&at_once, object);
        set_free(&later, object);
        lw_support_ok(lw_geometry_find_seams(&later.geometry, &later.tiles, true), NULL);
    }
    lw_support_ok(lw_geometry_find_seams(&at_once.geometry, &at_once.tiles, false), NULL);
    await_seams(&later, 2);
    assert_same_seams(&at_once.geometry.seams, &later.geometry.seams);
    tear_down(&later);
    tear_down(&at_once);
}

static void a_search_may_be_left_alone(void **state) {
    (void)state;
    struct floor floor;
    set_up(&floor);
    set_free(&floor, 0);
    lw_support_ok(lw_geometry_find_seams(&floor.geometry, &floor.tiles, true), NULL);
    tear_down(&floor);
}

/* As many texels as before may be others: what an object that goes gives back, beside what yields now. */
static void blocks_take_what_is_covered_now(void **state) {
    (void)state;
    struct floor floor;
    set_up(&floor);
    struct lw_solve_tile *tile = &floor.tiles.tile[0];
    uint32_t *changes = &floor.geometry.texels.changes[tile->object];
    struct lw_solve_block *block = &tile->block[0];
    uint8_t *covered = floor.geometry.texels.covered + tile->first;
    uint32_t one = 0;
    while (!covered[one]) one++;
    const uint32_t other = one + 1, all = block->covered_count;
    assert_true(covered[other] && all > 2 && block->packet_count > 0);
    tile->change.invalidated_count = tile->covered_count; /* something has moved, and all waits for a frame */
    covered[one] = 0;
    ++*changes;
    lw_tiles_recount(&floor.tiles, 1);
    assert_int_equal(block->covered_count, all - 1);
    assert_int_equal(tile->change.invalidated_count, tile->covered_count);
    block->direct.sample_count = 5;
    ++*changes;
    lw_tiles_recount(&floor.tiles, 1); /* they are the same */
    assert_int_equal(block->direct.sample_count, 5);
    covered[one] = 1;
    covered[other] = 0;
    ++*changes;
    lw_tiles_recount(&floor.tiles, 1);
    assert_int_equal(block->covered_count, all - 1);
    assert_int_equal(block->direct.sample_count, 0);
    uint32_t dealt = 0;
    for (uint32_t p = 0; p < block->packet_count; p++)
        for (uint32_t lane = 0; lane < block->packet[p].count; lane++, dealt++)
            assert_true(covered[lw_packet_texel(&block->packet[p], lane, 0, tile->width)]);
    assert_int_equal(dealt, all - 1);
    tear_down(&floor);
}

static void who_stops_does_not_wait(void **state) {
    (void)state;
    const _Atomic bool cancel = true;
    struct floor floor;
    struct lw_geometry geometry;
    struct lw_error err = {0};
    set_up(&floor);
    assert_int_equal(lw_geometry_init(&geometry, floor.scene, &floor.pose, NULL, 1, &cancel, NULL, &err),
                     LW_CLOSED);
    assert_int_equal(err.status, LW_OK);
    lw_geometry_finish(&geometry);
    tear_down(&floor);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(seams_that_are_found_later_are_the_same),
        cmocka_unit_test(a_search_that_is_overtaken_is_dropped),
        cmocka_unit_test(a_search_may_be_left_alone),
        cmocka_unit_test(blocks_take_what_is_covered_now),
        cmocka_unit_test(who_stops_does_not_wait),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
