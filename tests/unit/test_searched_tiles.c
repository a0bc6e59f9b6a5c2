#include "tests/support/support.h"

#include "common/builtin/builtin.h"
#include "common/lightmap/lightmap.h"
#include "server/solve/surface/fine_texels.h"
#include "server/solve/surface/invalid_texels.h"
#include "server/solve/surface/searched_tiles.h"
#include "server/solve/surface/standing.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#define FINER 2u
#define IDS   4096u

/* A Cornell box whose blocks are slabs on the floor, which hide points of it. */
struct fixture {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_texels texels;
    struct lw_standing standing;
    struct lw_fine_texels_maker *maker;
    struct lw_hidden_points_search points;
};

static void set_up(struct fixture *f) {
    struct lw_error err = {0};
    uint64_t count;
    *f = (struct fixture){0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &f->scene, &err), &err);
    for (uint32_t o = 0; o < f->scene->object_count; o++)
        if (strstr(f->scene->object[o].name, "block"))
            f->scene->node[f->scene->object[o].node].scale[1] = 0.01f;
    lw_support_ok(lw_lightmap_build(f->scene, &(struct lw_lightmap_desc){.texels_per_metre = 20}, NULL, &err),
                  &err);
    lw_support_ok(lw_atlas_map_init_finer(&f->map, f->scene, FINER, IDS), NULL);
    lw_support_ok(lw_pose_init(&f->pose, f->scene), NULL);
    lw_support_ok(lw_trace_create(f->scene, &f->pose, &f->trace, &err), &err);
    lw_support_ok(lw_texels_init(&f->texels, f->scene, 1, NULL, NULL, &err), &err);
    lw_support_ok(lw_standing_init(&f->standing, f->scene, &f->pose), NULL);
    lw_support_ok(
        lw_invalid_texels_find(&f->texels, &f->pose, f->standing.stands, f->trace, 1, NULL, NULL, &count),
        NULL);
    assert_true(count > 0);
    lw_support_ok(lw_fine_texels_maker_create(&f->texels, false, &f->maker), NULL);
    f->points = lw_invalid_texels_points(&f->texels, &f->pose, f->trace);
}

static void tear_down(struct fixture *f) {
    lw_fine_texels_maker_destroy(f->maker);
    lw_standing_finish(&f->standing);
    lw_texels_finish(&f->texels);
    lw_trace_destroy(f->trace);
    lw_pose_finish(&f->pose);
    lw_atlas_map_finish(&f->map);
    lw_scene_destroy(f->scene);
}

static const struct lw_tile_place *place_of(struct fixture *f, uint32_t object, uint32_t tile) {
    const lw_tile_id id = lw_atlas_map_claim_tile(&f->map, object, LW_ATLAS_FINER + FINER, tile);
    assert_true(id.v != UINT32_MAX);
    return &f->map.place[id.v];
}

static void make(struct fixture *f, const struct lw_tile_place *place, struct lw_fine_texels *out) {
    lw_support_ok(lw_fine_texels_prepare(f->maker, place->object), NULL);
    lw_support_ok(lw_fine_texels_make(f->maker, &f->points, place, out), NULL);
    lw_fine_texels_remember(f->maker, place, out);
}

static void expect_same(const struct lw_fine_texels *a, const struct lw_fine_texels *b) {
    const size_t count = a->mesh.texel_count;
    assert_int_equal(b->mesh.texel_count, count);
    assert_memory_equal(a->covered, b->covered, count);
    assert_memory_equal(a->usable, b->usable, count);
    assert_memory_equal(a->filled, b->filled, count);
    assert_memory_equal(a->walls, b->walls, count);
    assert_memory_equal(a->side, b->side, count * sizeof *a->side);
    assert_memory_equal(a->source, b->source, count * sizeof *a->source);
    assert_memory_equal(a->mesh.covered, b->mesh.covered, count);
    assert_memory_equal(a->mesh.chart, b->mesh.chart, count * sizeof *a->mesh.chart);
    for (int c = 0; c < 3; c++) assert_memory_equal(a->mesh.position[c], b->mesh.position[c], count * 4);
    assert_memory_equal(a->mesh.sample_points.first, b->mesh.sample_points.first, (count + 1) * 4);
}

static uint64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

/* A tile that is made again is not searched again, and has the same texels byte by byte. It is once texels of
 * level 0 have changed. */
static void a_tile_is_searched_once(void **state) {
    (void)state;
    struct fixture f;
    uint32_t searched = 0, quiet = 0;
    uint64_t took_ns[2] = {0};
    set_up(&f);
    for (uint32_t o = 0; o < f.scene->object_count; o++)
        for (uint32_t t = 0; lw_atlas_map_has_tile(&f.map, o, LW_ATLAS_FINER + FINER, t); t++) {
            const struct lw_tile_place *place = place_of(&f, o, t);
            struct lw_fine_texels first, second;
            const uint64_t began_ns = now_ns();
            make(&f, place, &first);
            const uint64_t made_ns = now_ns();
            make(&f, place, &second);
            took_ns[0] += first.searched ? made_ns - began_ns : 0;
            took_ns[1] += first.searched ? now_ns() - made_ns : 0;
            assert_false(first.remembered || second.searched);
            assert_true(second.remembered == first.searched);
            expect_same(&first, &second);
            *(first.searched ? &searched : &quiet) += 1;
            lw_fine_texels_finish(&second);
            if (first.searched) {
                f.texels.changes[o]++;
                make(&f, place, &second);
                assert_true(second.searched && !second.remembered);
                expect_same(&first, &second);
                lw_fine_texels_finish(&second);
                f.texels.changes[o]--;
            }
            lw_fine_texels_finish(&first);
        }
    assert_true(searched > 4 && quiet > 4);
    printf("%u tiles: %.2f ms each with a search, %.2f without\n", searched,
           1e-6 * (double)took_ns[0] / searched, 1e-6 * (double)took_ns[1] / searched);
    tear_down(&f);
}

/* Results that were used last stay, as many as there is room for. */
static void results_that_were_used_last_stay(void **state) {
    (void)state;
    enum { FLOOR_TILES = 4 };
    struct fixture f;
    struct lw_fine_texels made;
    struct lw_searched_tiles *tiles;
    set_up(&f);
    const struct lw_tile_place *place[FLOOR_TILES];
    for (uint32_t t = 0; t < FLOOR_TILES; t++) place[t] = place_of(&f, 0, t);
    make(&f, place[0], &made);
    const struct lw_searched_texels arrays = {&made.mesh, made.covered, made.usable, made.filled,
                                              made.walls, made.side,    made.source};
    lw_support_ok(lw_searched_tiles_create(2, 1 << 20, &tiles), NULL);
    lw_searched_tiles_keep(tiles, place[0], 7, &arrays);
    lw_searched_tiles_keep(tiles, place[1], 7, &arrays);
    lw_searched_tiles_keep(tiles, place[0], 7, &arrays); /* used again */
    lw_searched_tiles_keep(tiles, place[2], 7, &arrays);
    assert_true(lw_searched_tiles_find(tiles, place[0], 7) && lw_searched_tiles_find(tiles, place[2], 7));
    assert_false(lw_searched_tiles_find(tiles, place[1], 7) || lw_searched_tiles_find(tiles, place[0], 8));
    lw_searched_tiles_keep(tiles, place[0], 8, &arrays); /* in place of the one before */
    assert_true(lw_searched_tiles_find(tiles, place[0], 8) && lw_searched_tiles_find(tiles, place[2], 7));
    const size_t one = lw_searched_tiles_memory_bytes(tiles) / 2;
    lw_searched_tiles_destroy(tiles);
    lw_support_ok(lw_searched_tiles_create(FLOOR_TILES, 2 * one, &tiles), NULL);
    for (uint32_t t = 0; t < FLOOR_TILES; t++) {
        lw_searched_tiles_keep(tiles, place[t], 0, &arrays);
        assert_true(lw_searched_tiles_find(tiles, place[t], 0));
    }
    assert_false(lw_searched_tiles_find(tiles, place[0], 0));
    lw_searched_tiles_destroy(tiles);
    lw_support_ok(lw_searched_tiles_create(FLOOR_TILES, 8, &tiles), NULL);
    lw_searched_tiles_keep(tiles, place[0], 0, &arrays); /* does not fit */
    assert_false(lw_searched_tiles_find(tiles, place[0], 0));
    lw_searched_tiles_destroy(tiles);
    lw_fine_texels_finish(&made);
    tear_down(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_tile_is_searched_once),
        cmocka_unit_test(results_that_were_used_last_stay),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
