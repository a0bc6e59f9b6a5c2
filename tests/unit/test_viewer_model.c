#include "tests/support/support.h"

#include "client/load/viewer_model.h"
#include "common/builtin/builtin.h"
#include "common/lightmap/lightmap.h"

#include <stdlib.h>
#include <string.h>

#define SIDE_M   4.0f
#define TEXELS   256u
#define CAPACITY 4096u

/* One square of 4 x 4 m at height 0 with an atlas of 256 x 256 texels that it fills: 64 texels a metre. */
struct world {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_viewer_model *model;
    struct lw_vec2 uv[4];
    lw_tile_id ids[CAPACITY];
};

static void init_world(struct world *w, unsigned squares) {
    w->scene = lw_support_squares(squares, SIDE_M);
    struct lw_mesh *mesh = &w->scene->mesh[0];
    assert_int_equal(mesh->vertex_count, 4);
    for (int i = 0; i < 4; i++) {
        struct lw_vec3 p = mesh->position[i];
        w->uv[i] =
            (struct lw_vec2){(p.x / SIDE_M + 0.5f) * (float)TEXELS, (p.z / SIDE_M + 0.5f) * (float)TEXELS};
    }
    mesh->lightmap_uv = w->uv;
    mesh->atlas_width = mesh->atlas_height = TEXELS;
    lw_support_ok(lw_atlas_map_init(&w->map, w->scene), NULL);
    lw_support_ok(lw_viewer_model_create(w->scene, &w->map, &w->model), NULL);
}

static void finish_world(struct world *w) {
    lw_viewer_model_destroy(w->model);
    lw_atlas_map_finish(&w->map);
    lw_scene_destroy(w->scene);
}

static bool has(const struct world *w, uint32_t count, lw_tile_id id) {
    for (uint32_t i = 0; i < count; i++)
        if (w->ids[i].v == id.v) return true;
    return false;
}

static uint32_t choose(struct world *w, struct lw_vec3 position, struct lw_vec3 forward) {
    struct lw_viewer_model_eye eye = {position, lw_vec3_normalize(forward)};
    uint32_t count = lw_viewer_model_choose(w->model, &eye, w->ids, CAPACITY);
    for (uint32_t i = 0; i < count; i++) /* each once */
        for (uint32_t j = 0; j < i; j++) assert_true(w->ids[i].v != w->ids[j].v);
    return count;
}

/* Centre of the level-0 tile (x, y) of the square. */
static struct lw_vec3 centre_of(uint32_t x, uint32_t y) {
    float tile_m = SIDE_M * LW_TILE_SIDE / (float)TEXELS;
    return lw_vec3(((float)x + 0.5f) * tile_m - SIDE_M / 2, 0, ((float)y + 0.5f) * tile_m - SIDE_M / 2);
}

static void test_near_tiles_are_fine(void **state) {
    (void)state;
    struct world w;
    init_world(&w, 1);
    for (uint32_t y = 0; y < 4; y++)
        for (uint32_t x = 0; x < 4; x++) {
            struct lw_vec3 eye = centre_of(x, y);
            eye.y = 0.3f; /* sees a circle of 0.25 m, in a tile of 1 m */
            uint32_t count = choose(&w, eye, lw_vec3(0, -1, 0));
            assert_true(has(&w, count, lw_atlas_map_find(&w.map, 0, 0, x, y)));
            assert_true(count >= 2 &&
                        count <= 6); /* the coarsest, and of the neighbours those that share a side */
        }
    finish_world(&w);
}

static void test_far_tiles_are_coarse(void **state) {
    (void)state;
    struct world w;
    init_world(&w, 1);
    uint32_t last = UINT32_MAX;
    /* 1/64 m is a pixel of 60/720 degrees at 10.7 m; each level doubles that */
    for (uint32_t level = 0; level < w.map.atlas[0]->level_count; level++) {
        float height = 10.742f * (float)(1u << level) * 0.98f;
        uint32_t count = choose(&w, lw_vec3(0, height, 0), lw_vec3(0, -1, 0));
        uint32_t expected = level ? level - 1 : 0;
        assert_true(has(&w, count, lw_atlas_map_find(&w.map, 0, expected, 0, 0)));
        assert_true(count <= last);
        last = count;
        count = choose(&w, lw_vec3(0, height / 0.96f, 0), lw_vec3(0, -1, 0));
        assert_true(has(&w, count, lw_atlas_map_find(&w.map, 0, level, 0, 0)));
    }
    finish_world(&w);
}

static void test_nothing_behind(void **state) {
    (void)state;
    struct world w;
    init_world(&w, 3);
    assert_int_equal(choose(&w, lw_vec3(0, 5, 0), lw_vec3(0, 1, 0)), 0);
    assert_true(choose(&w, lw_vec3(0, 5, 0), lw_vec3(0, -1, 0)) > 0);
    finish_world(&w);
}

static void test_fits(void **state) {
    (void)state;
    struct world w;
    init_world(&w, 1);
    struct lw_viewer_model_eye eye = {lw_vec3(0, 3.2f, 0), lw_vec3(0, -1, 0)};
    assert_int_equal(lw_viewer_model_choose(w.model, &eye, w.ids, CAPACITY), 16); /* all of level 0 */
    uint32_t count = lw_viewer_model_choose(w.model, &eye, w.ids, 10);
    assert_int_equal(count, 4); /* all of level 1 */
    assert_true(has(&w, count, lw_atlas_map_find(&w.map, 0, 1, 1, 1)));
    assert_int_equal(lw_viewer_model_choose(w.model, &eye, w.ids, 1), 1);
    assert_int_equal(lw_viewer_model_choose(w.model, &eye, w.ids, 0), 0);
    finish_world(&w);
}

/* In a real scene: all chosen tiles exist, and level-0 tiles are met from somewhere. */
static void test_walk_through_cornell(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_error err = {0};
    struct lw_atlas_map map;
    struct lw_viewer_model *model;
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 32}, NULL, &err),
                  &err);
    lw_support_ok(lw_atlas_map_init(&map, scene), NULL);
    lw_support_ok(lw_viewer_model_create(scene, &map, &model), NULL);
    bool *seen = calloc(map.tile_count, sizeof *seen);
    static lw_tile_id ids[CAPACITY];
    struct lw_vec3 before = lw_viewer_model_walk(model, 1, 1, 0).position;
    for (double s = 0; s < 60; s += 0.5) {
        struct lw_viewer_model_eye eye = lw_viewer_model_walk(model, 1, 1, s),
                                   again = lw_viewer_model_walk(model, 1, 1, s);
        assert_memory_equal(&eye, &again, sizeof eye);
        assert_true(lw_vec3_length(lw_vec3_sub(eye.position, before)) <= 1.4f * 0.5f + 1e-4f);
        before = eye.position;
        uint32_t count = lw_viewer_model_choose(model, &eye, ids, CAPACITY);
        for (uint32_t i = 0; i < count; i++) {
            assert_true(ids[i].v < map.tile_count);
            seen[ids[i].v] = true;
        }
    }
    uint32_t fine = 0;
    for (uint32_t i = 0; i < map.tile_count; i++) fine += seen[i] && map.place[i].level == 0;
    assert_true(fine > 0);
    struct lw_viewer_model_eye a = lw_viewer_model_place(model, 1, 1, 0),
                               b = lw_viewer_model_place(model, 1, 1, 1),
                               c = lw_viewer_model_place(model, 1, 2, 0);
    assert_true(memcmp(&a, &b, sizeof a) != 0 && memcmp(&a, &c, sizeof a) != 0);
    free(seen);
    lw_viewer_model_destroy(model);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_near_tiles_are_fine),  cmocka_unit_test(test_far_tiles_are_coarse),
        cmocka_unit_test(test_nothing_behind),       cmocka_unit_test(test_fits),
        cmocka_unit_test(test_walk_through_cornell),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
