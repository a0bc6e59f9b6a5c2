#include "tests/support/support.h"

#include "common/tile/atlas.h"

#include <string.h>

static void test_levels_halve_rounding_up(void **state) {
    (void)state;
    struct lw_atlas atlas;
    lw_atlas_init(&atlas, 132, 68);
    assert_int_equal(atlas.level_count, 5);
    const uint32_t width[] = {132, 66, 33, 17, 9}, height[] = {68, 34, 17, 9, 5};
    for (int l = 0; l < 5; l++) {
        assert_int_equal(atlas.level[l].width, width[l]);
        assert_int_equal(atlas.level[l].height, height[l]);
    }
    assert_int_equal(atlas.level[0].tiles_x, 3);
    assert_int_equal(atlas.level[0].tiles_y, 2);
    assert_int_equal(atlas.level[1].first_tile, 6);
    assert_int_equal(atlas.tile_count, 6 + 2 + 1 + 1 + 1);
}

static void test_small_atlas_has_one_level(void **state) {
    (void)state;
    struct lw_atlas atlas;
    lw_atlas_init(&atlas, LW_ATLAS_COARSEST, LW_ATLAS_COARSEST);
    assert_int_equal(atlas.level_count, 1);
    lw_atlas_init(&atlas, LW_ATLAS_COARSEST + 1, 4);
    assert_int_equal(atlas.level_count, 2);
    lw_atlas_init(&atlas, LW_SCENE_ATLAS_SIDE_MAX, 4);
    assert_int_equal(atlas.level[atlas.level_count - 1].width, LW_ATLAS_COARSEST);
}

static void test_every_place_is_found_under_its_id(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(3, 1);
    scene->mesh[0].atlas_width = 200;
    scene->mesh[0].atlas_height = 72;
    struct lw_atlas_map map;
    lw_support_ok(lw_atlas_map_init(&map, scene), NULL);
    uint64_t texels = 0;
    for (uint32_t id = 0; id < map.tile_count; id++) {
        const struct lw_tile_place *p = &map.place[id];
        assert_int_equal(lw_atlas_map_find(&map, p->object, p->level, p->x, p->y).v, id);
        uint32_t number = p->y * map.atlas[p->object].level[p->level].tiles_x + p->x;
        assert_int_equal(lw_atlas_map_find_tile(&map, p->object, p->level, number).v, id);
        assert_int_equal(lw_atlas_map_number(&map, (lw_tile_id){id}), number);
        assert_true(p->width >= 1 && p->width <= LW_TILE_SIDE && p->height >= 1 && p->height <= LW_TILE_SIDE);
        if (p->level == 0) texels += (uint64_t)p->width * p->height;
    }
    assert_int_equal(texels, 3 * 200 * 72);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

static void test_places_outside_are_not_found(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    scene->mesh[0].atlas_width = 128;
    scene->mesh[0].atlas_height = 64;
    struct lw_atlas_map map;
    lw_support_ok(lw_atlas_map_init(&map, scene), NULL);
    assert_int_equal(lw_atlas_map_find(&map, 0, 0, 1, 0).v, 1);
    assert_int_equal(lw_atlas_map_find(&map, 0, 0, 2, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find(&map, 0, 0, 0, 1).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find(&map, 1, 0, 0, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find(&map, 0, map.atlas[0].level_count, 0, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find(&map, UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find_tile(&map, 0, 0, 2).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find_tile(&map, 1, 0, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find_tile(&map, 0, map.atlas[0].level_count, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find_tile(&map, UINT32_MAX, UINT32_MAX, UINT32_MAX).v, UINT32_MAX);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_levels_halve_rounding_up),
        cmocka_unit_test(test_small_atlas_has_one_level),
        cmocka_unit_test(test_every_place_is_found_under_its_id),
        cmocka_unit_test(test_places_outside_are_not_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
