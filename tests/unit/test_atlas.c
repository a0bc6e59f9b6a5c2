#include "tests/support/support.h"

#include "common/tile/atlas.h"

#include <stdlib.h>
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
        uint32_t number = p->y * map.atlas[p->object]->level[p->level].tiles_x + p->x;
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
    assert_int_equal(lw_atlas_map_find(&map, 0, map.atlas[0]->level_count, 0, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find(&map, UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find_tile(&map, 0, 0, 2).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find_tile(&map, 1, 0, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find_tile(&map, 0, map.atlas[0]->level_count, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_find_tile(&map, UINT32_MAX, UINT32_MAX, UINT32_MAX).v, UINT32_MAX);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

/* ---- finer levels ---- */

static struct lw_atlas_map with_finer(struct lw_scene **out_scene, uint32_t room) {
    struct lw_atlas_map map;
    *out_scene = lw_support_squares(3, 1);
    (*out_scene)->mesh[0].atlas_width = 200;
    (*out_scene)->mesh[0].atlas_height = 72;
    lw_support_ok(lw_atlas_map_init_finer(&map, *out_scene, 4, room), NULL);
    return map;
}

/* Every tile of every finer level has an id once it is claimed, its own, and lies where it was said to. */
static void test_every_fine_tile_has_an_id_of_its_own(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_atlas_map map = with_finer(&scene, 20000);
    uint32_t count = 0;
    uint64_t texels = 0;
    assert_int_equal(map.tile_count, map.plain_count + 20000);
    for (int again = 0; again < 2; again++)
        for (uint32_t o = 0; o < 3; o++)
            for (uint32_t k = 1; k <= 4; k++)
                for (uint32_t t = 0; lw_atlas_map_has_tile(&map, o, LW_ATLAS_FINER + k, t); t++) {
                    const uint32_t level = LW_ATLAS_FINER + k;
                    const lw_tile_id id = lw_atlas_map_claim_tile(&map, o, level, t);
                    const struct lw_tile_place *p = &map.place[id.v];
                    assert_int_equal(lw_atlas_map_find_tile(&map, o, level, t).v, id.v);
                    assert_int_equal(lw_atlas_map_number(&map, id), t);
                    assert_int_equal(lw_atlas_map_claim_name(&map, lw_atlas_map_name(&map, id)).v, id.v);
                    assert_true(lw_atlas_map_name(&map, id) < map.fine_names);
                    assert_int_equal(p->object, o);
                    assert_int_equal(p->level, level);
                    assert_int_equal(map.place[lw_atlas_map_below(&map, id).v].x, p->x >> k);
                    if (again) continue;
                    assert_int_equal(id.v, map.plain_count + count++); /* in the order of claiming */
                    if (k == 4) texels += (uint64_t)p->width * p->height;
                }
    assert_int_equal(count, map.fine_names);
    assert_int_equal(texels, 3 * 200 * 72 * 256);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

/* The page has the same table (client/web/test/finer.test.mjs): its numbers of them follow all others. */
static void test_names_follow_objects_and_levels(void **state) {
    (void)state;
    struct lw_mesh mesh[] = {{.atlas_width = 132, .atlas_height = 68},
                             {.atlas_width = 0},
                             {.atlas_width = 20, .atlas_height = 100}};
    struct lw_object object[] = {{.mesh = 0}, {.mesh = 1}, {.mesh = 2}, {.mesh = 0}};
    const struct lw_scene scene = {.mesh = mesh, .mesh_count = 3, .object = object, .object_count = 4};
    struct lw_atlas_map map;
    lw_support_ok(lw_atlas_map_init_finer(&map, &scene, 2, 8), NULL);
    assert_int_equal(map.plain_count, 27);
    assert_int_equal(map.fine_names, 165 - 27);
    const uint32_t first[] = {27, 87, 87, 105};
    for (int o = 0; o < 4; o++) assert_int_equal(map.plain_count + map.first_finer[o], first[o]);
    const struct {
        uint32_t object, finer, tile, number;
    } known[] = {{0, 1, 0, 27}, {0, 1, 14, 41},  {0, 2, 0, 42}, {0, 2, 44, 86},
                 {2, 1, 3, 90}, {2, 2, 13, 104}, {3, 2, 7, 127}};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        const lw_tile_id id =
            lw_atlas_map_claim_tile(&map, known[i].object, LW_ATLAS_FINER + known[i].finer, known[i].tile);
        assert_int_equal(map.plain_count + lw_atlas_map_name(&map, id), known[i].number);
        assert_int_equal(lw_atlas_map_claim_name(&map, known[i].number - map.plain_count).v, id.v);
    }
    assert_int_equal(lw_atlas_map_claim_tile(&map, 0, LW_ATLAS_FINER + 1, 15).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_claim_tile(&map, 0, LW_ATLAS_FINER, 0).v, UINT32_MAX);
    lw_atlas_map_finish(&map);
}

/* Where no id is left a tile gets none; one that is released goes to the next who claims, after those that
 * were free before. */
static void test_ids_run_out_and_come_back(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_atlas_map map = with_finer(&scene, 3);
    const uint32_t level = LW_ATLAS_FINER + 2;
    lw_tile_id id[3];
    for (uint32_t t = 0; t < 3; t++) {
        assert_false(lw_atlas_map_is_used(&map, (lw_tile_id){map.plain_count + t}));
        id[t] = lw_atlas_map_claim_tile(&map, 1, level, t);
        assert_true(lw_atlas_map_is_used(&map, id[t]));
    }
    assert_int_equal(lw_atlas_map_claim_tile(&map, 1, level, 3).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_claim_tile(&map, 1, level, 2).v, id[2].v);
    lw_atlas_map_release(&map, id[1]);
    assert_int_equal(lw_atlas_map_find_tile(&map, 1, level, 1).v, UINT32_MAX);
    lw_atlas_map_release(&map, id[0]);
    assert_int_equal(lw_atlas_map_claim_tile(&map, 2, level, 9).v, id[1].v);
    assert_int_equal(map.place[id[1].v].object, 2);
    assert_int_equal(lw_atlas_map_claim_tile(&map, 1, level, 1).v, id[0].v);
    assert_int_equal(lw_atlas_map_find_tile(&map, 1, level, 2).v, id[2].v);
    assert_int_equal(lw_atlas_map_find_tile(&map, 1, level, 0).v, UINT32_MAX);
    assert_int_equal(lw_atlas_map_claim_tile(&map, 1, level + 3, 0).v,
                     UINT32_MAX); /* there is no such level */
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

/* Threads that claim the same tiles get the same ids, each tile one. */
static void test_threads_claim_together(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_atlas_map map = with_finer(&scene, 500);
    const uint32_t level = LW_ATLAS_FINER + 4;
    uint32_t id[4][500];
#pragma omp parallel for num_threads(4) schedule(static, 1)
    for (uint32_t thread = 0; thread < 4; thread++)
        for (uint32_t t = 0; t < 500; t++)
            id[thread][(t * 7 + thread * 100) % 500] =
                lw_atlas_map_claim_tile(&map, 0, level, (t * 7 + thread * 100) % 500).v;
    bool is_given[500] = {0};
    for (uint32_t t = 0; t < 500; t++) {
        for (uint32_t thread = 0; thread < 4; thread++) assert_int_equal(id[thread][t], id[0][t]);
        assert_true(id[0][t] >= map.plain_count && id[0][t] < map.tile_count);
        assert_false(is_given[id[0][t] - map.plain_count]);
        is_given[id[0][t] - map.plain_count] = true;
        assert_int_equal(lw_atlas_map_number(&map, (lw_tile_id){id[0][t]}), t);
    }
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

/* A list that is sorted by the comparison is searched by it: what it has is found, and nothing else. */
static void test_lists_of_ids_are_sorted_and_searched(void **state) {
    (void)state;
    lw_tile_id list[] = {{7}, {UINT32_MAX}, {0}, {3}, {0x80000000u}, {12}};
    const size_t count = sizeof list / sizeof *list;
    const lw_tile_id there[] = {{0}, {3}, {7}, {12}, {0x80000000u}, {UINT32_MAX}};
    const lw_tile_id lacking[] = {{1}, {8}, {0x7fffffffu}, {UINT32_MAX - 1}};
    qsort(list, count, sizeof *list, lw_tile_id_compare);
    assert_memory_equal(list, there, sizeof list);
    for (size_t i = 0; i < count; i++) assert_true(lw_tile_id_is_in(list, count, there[i]));
    for (size_t i = 0; i < sizeof lacking / sizeof *lacking; i++)
        assert_false(lw_tile_id_is_in(list, count, lacking[i]));
    assert_false(lw_tile_id_is_in(list, count - 1, (lw_tile_id){UINT32_MAX}));
    assert_false(lw_tile_id_is_in(NULL, 0, (lw_tile_id){0}));
    assert_int_equal(lw_tile_id_compare(&there[1], &there[1]), 0);
}

/* A map has room for as many tiles of finer levels as it was given. */
static void test_room_is_that_of_finer_levels(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_atlas_map map = with_finer(&scene, 37), plain;
    assert_int_equal(lw_atlas_map_room(&map), 37);
    lw_support_ok(lw_atlas_map_init(&plain, scene), NULL);
    assert_int_equal(lw_atlas_map_room(&plain), 0);
    lw_atlas_map_finish(&plain);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_levels_halve_rounding_up),
        cmocka_unit_test(test_small_atlas_has_one_level),
        cmocka_unit_test(test_every_place_is_found_under_its_id),
        cmocka_unit_test(test_places_outside_are_not_found),
        cmocka_unit_test(test_every_fine_tile_has_an_id_of_its_own),
        cmocka_unit_test(test_names_follow_objects_and_levels),
        cmocka_unit_test(test_ids_run_out_and_come_back),
        cmocka_unit_test(test_threads_claim_together),
        cmocka_unit_test(test_lists_of_ids_are_sorted_and_searched),
        cmocka_unit_test(test_room_is_that_of_finer_levels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
