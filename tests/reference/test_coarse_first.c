/* Light of a quarter of the density first: it is right, it stays in its room, and the light of the whole
 * density follows, the same as without. */
#include "tests/reference/house.h"

#include "common/base/cache_folder.h"
#include "common/light/client_lights.h"
#include "common/lightmap/lightmap.h"
#include "server/solve/coarse_first.h"
#include "server/solve/coarse_tiles.h"
#include "server/solve/surface/saved_texels.h"
#include "tests/support/support.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static _Atomic bool cancelled;

static const struct lw_solver_desc terms = {.bounces = 2,
                                            .direct_samples = 1,
                                            .indirect_samples = 4,
                                            .tracing_range_m = INFINITY,
                                            .target_error = 0.02f,
                                            .threads = 2,
                                            .seed = 3,
                                            .cancel = &cancelled};

/* Takes the scene. */
static void begin_with(struct room_solution *s, struct lw_scene *scene, float texels_per_metre, bool coarse,
                       struct lw_solver_desc desc) {
    struct lw_error err = {0};
    cancelled = false;
    *s = (struct room_solution){.scene = scene};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = texels_per_metre},
                                    NULL, &err),
                  &err);
    lw_support_ok(lw_atlas_map_init(&s->map, scene), NULL);
    lw_support_ok(lw_pose_init(&s->pose, scene), NULL);
    lw_pose_evaluate(&s->pose, scene, 0);
    desc.scene = scene;
    desc.atlas_map = &s->map;
    const struct lw_solvers_entry *entry = lw_solvers_at(0);
    lw_support_ok(coarse ? lw_coarse_first_create(entry, &desc, &s->pose, &s->solver, &err)
                         : entry->create(&desc, &s->pose, &s->solver, &err),
                  &err);
}

static void begin(struct room_solution *s, struct lw_scene *scene, float texels_per_metre, bool coarse) {
    begin_with(s, scene, texels_per_metre, coarse, terms);
}

static void step(struct room_solution *s, uint64_t from, uint64_t to) {
    for (uint64_t frame = from; frame <= to; frame++) room_frame(s, frame);
}

#define ALONE  LW_COARSE_FIRST_ALONE
#define FRAMES LW_COARSE_TILES_FRAMES

/* In a closed room whose walls all emit Le and reflect rho, bounce k adds pi Le rho^k. */
static void test_a_furnace(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 24};
    struct room_solution s;
    room_box(&room, lw_vec3(3, 2, 2.5f), 0.5f, 1);
    struct lw_scene *scene = room_scene(&room);
    struct lw_solver_desc desc = terms;
    desc.direct_samples *= 16;
    desc.indirect_samples *= 16;
    begin_with(&s, scene, 24, true, desc);
    step(&s, 1, ALONE);
    const double want = (double)LW_PI * (1 + 0.5 + 0.25);
    double sum = 0, texels = 0;
    for (uint32_t o = 0; o < s.scene->object_count; o++) {
        const struct room_mean mean = room_object_mean(&s, o);
        expect_near(mean.total, want, 0.05); /* a near wall's light has a heavy tail in corners */
        sum += mean.total * mean.texels;
        texels += mean.texels;
    }
    expect_near(sum / texels, want, 0.02);
    room_finish(&s);
}

static double block_mean(const struct lw_solver_tile *tile, const float *plane, uint32_t x, uint32_t y) {
    double sum = 0;
    uint32_t count = 0;
    for (uint32_t j = y; j < y + LW_COARSE_SCENE_SIDE && j < tile->height; j++)
        for (uint32_t i = x; i < x + LW_COARSE_SCENE_SIDE && i < tile->width; i++, count++)
            sum += (double)plane[j * tile->width + i];
    return sum / count;
}

/* Planes that are worked out when a tile is read are those that are held. */
static void expect_same_planes(const struct lw_coarse_tiles *tiles, const struct lw_solver *solver,
                               lw_tile_id id, const struct lw_solver_tile *held) {
    static struct lw_solver_room room;
    const size_t bytes = (size_t)held->width * held->height * sizeof(float);
    struct lw_solver_tile read = *held;
    lw_coarse_tiles_read_planes(tiles, solver, id, &room, &read);
    for (int c = 0; c < 3; c++) {
        assert_ptr_not_equal(read.direct[c], held->direct[c]);
        assert_memory_equal(read.direct[c], held->direct[c], bytes);
        assert_memory_equal(read.shown[LW_TILE_CHANNEL_FULL][c], held->shown[LW_TILE_CHANNEL_FULL][c], bytes);
    }
}

/* Level 2 of the atlas is the coarse atlas. */
static void test_blocks_keep_their_mean(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct room_solution s;
    struct lw_coarse_scene coarse;
    struct lw_coarse_tiles tiles;
    struct lw_solver *solver;
    struct lw_solver_stats stats;
    struct lw_error err = {0};
    uint32_t compared = 0, uneven = 0;
    begin(&s, room_scene(&room), 13, false);
    lw_support_ok(lw_coarse_scene_init(&coarse, s.scene), NULL);
    lw_support_ok(lw_coarse_tiles_init(&tiles, &s.map, &coarse.map, true, 2), NULL);
    struct lw_solver_desc desc = terms;
    desc.scene = &coarse.scene;
    desc.atlas_map = &coarse.map;
    lw_support_ok(lw_solvers_create(NULL, &desc, &s.pose, &solver, &err), &err);
    lw_support_ok(solver->ops->frame(solver, &s.pose, 1, &stats, &err), &err);
    lw_support_ok(lw_coarse_tiles_update(&tiles, solver, 1u << LW_TILE_CHANNEL_FULL, NULL), NULL);
    for (uint32_t id = 0; id < s.map.plain_count; id++) {
        const struct lw_tile_place *place = &s.map.place[id];
        struct lw_solver_tile tile, below;
        if (place->level) continue;
        const uint32_t x0 = place->x * LW_TILE_SIDE / LW_COARSE_SCENE_SIDE,
                       y0 = place->y * LW_TILE_SIDE / LW_COARSE_SCENE_SIDE;
        lw_coarse_tiles_read(&tiles, (lw_tile_id){id}, &tile);
        expect_same_planes(&tiles, solver, (lw_tile_id){id}, &tile);
        solver->ops->read_tile(
            solver, lw_atlas_map_find(&coarse.map, place->object, 0, x0 / LW_TILE_SIDE, y0 / LW_TILE_SIDE),
            &below);
        const float *plane = tile.shown[LW_TILE_CHANNEL_FULL][1],
                    *plane_below = below.shown[LW_TILE_CHANNEL_FULL][1];
        for (uint32_t y = 0; y < tile.height; y += LW_COARSE_SCENE_SIDE)
            for (uint32_t x = 0; x < tile.width; x += LW_COARSE_SCENE_SIDE) {
                const uint32_t i = (y0 % LW_TILE_SIDE + y / LW_COARSE_SCENE_SIDE) * below.width +
                                   x0 % LW_TILE_SIDE + x / LW_COARSE_SCENE_SIDE;
                assert_int_equal(tile.covered[y * tile.width + x], below.covered[i]);
                if (!below.covered[i]) continue;
                expect_near(block_mean(&tile, plane, x, y), (double)plane_below[i], 1e-4);
                uneven += plane[y * tile.width + x] != plane[y * tile.width + x + 1];
                compared++;
            }
    }
    assert_true(compared > 300);
    assert_true(2 * uneven > compared); /* most are interpolated */
    solver->ops->destroy(solver);
    lw_coarse_tiles_finish(&tiles);
    lw_coarse_scene_finish(&coarse);
    room_finish(&s);
}

/* Each texel that has light at the whole density has light before. */
static void test_no_texel_is_left_out(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct room_solution coarse, whole;
    uint32_t compared = 0;
    begin(&coarse, room_scene(&room), 13, true);
    begin(&whole, room_scene(&room), 13, false);
    step(&coarse, 1, 1);
    step(&whole, 1, 1);
    for (uint32_t id = 0; id < whole.map.tile_count; id++) {
        struct lw_solver_tile a, b;
        if (whole.map.place[id].level) continue;
        coarse.solver->ops->read_tile(coarse.solver, (lw_tile_id){id}, &a);
        whole.solver->ops->read_tile(whole.solver, (lw_tile_id){id}, &b);
        assert_true(a.width == b.width && a.height == b.height);
        for (uint32_t i = 0; i < a.width * a.height; i++) {
            assert_true(a.covered[i] || a.filled[i] || !(b.covered[i] || b.filled[i]));
            compared += b.covered[i];
        }
        assert_true(a.error == 0 || a.error >= LW_ATLAS_COARSE_ERROR);
    }
    assert_true(compared > 5000);
    room_finish(&coarse);
    room_finish(&whole);
}

static void expect_no_negative_light(const struct room_solution *s) {
    for (uint32_t id = 0; id < s->map.plain_count; id++) {
        struct lw_solver_tile tile;
        if (s->map.place[id].level) continue;
        s->solver->ops->read_tile(s->solver, (lw_tile_id){id}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++)
            for (int c = 0; c < 3; c++)
                assert_true(tile.shown[LW_TILE_CHANNEL_FULL][c][i] >= 0 &&
                            isfinite(tile.shown[LW_TILE_CHANNEL_FULL][c][i]) && tile.direct[c][i] >= 0);
    }
}

static void test_light_stays_in_its_room(void **state) {
    (void)state;
    for (unsigned k = 0; k < 12; k++) {
        struct house h = {.kind = HOUSE_BOXES,
                          .thick = k % 2 ? 0.1f : 0.3f,
                          .angle = 0.3f * (float)(k % 3),
                          .shift_x = 0.062f * (float)k,
                          .shift_z = 0.034f * (float)k,
                          .density = 12};
        const struct room room = house_build(&h);
        struct room_solution s;
        begin(&s, room_scene(&room), h.density, true);
        step(&s, 1, 2);
        expect_no_negative_light(&s); /* there is no sun inside, and much of it beside that */
        h.density /= LW_COARSE_SCENE_SIDE;
        house_expect_apart(&s, &h, house_inner_face(&h), 1);
        room_finish(&s);
    }
}

/* Frames of the whole solver are those of a solver without a coarse one: the same bytes. */
static void test_the_whole_follows(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct room_solution s, plain;
    struct lw_solver_tile tile;
    begin(&s, room_scene(&room), 13, true);
    step(&s, 1, ALONE);
    lw_coarse_first_wait(s.solver);
    step(&s, ALONE + 1, ALONE + FRAMES - 1);
    s.solver->ops->read_tile(s.solver, (lw_tile_id){0}, &tile);
    assert_true(tile.error >= LW_ATLAS_COARSE_ERROR);
    step(&s, ALONE + FRAMES, ALONE + FRAMES);
    s.solver->ops->read_tile(s.solver, (lw_tile_id){0}, &tile);
    assert_true(tile.error < LW_ATLAS_COARSE_ERROR && tile.solved_frame == ALONE + FRAMES);
    assert_int_equal(s.stats.tiles_shown, s.stats.tiles);
    begin(&plain, room_scene(&room), 13, false);
    step(&plain, ALONE + 1, ALONE + FRAMES);
    assert_true(room_expect_same(&s, &plain) > 6);
    room_finish(&s);
    room_finish(&plain);
}

/* A tile that nobody looks at stays coarse, until something moves. */
static void test_tiles_follow_by_themselves(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    for (int moves = 0; moves < 2; moves++) {
        struct room_solution s;
        struct lw_solver_tile other;
        begin(&s, room_scene(&room), 13, true);
        step(&s, 1, ALONE);
        uint8_t *interest = calloc(s.map.tile_count, 1);
        assert_non_null(interest);
        lw_support_ok(s.solver->ops->set_interest(s.solver, interest, NULL), NULL); /* nobody looks */
        free(interest);
        lw_coarse_first_wait(s.solver);
        uint64_t frame = ALONE + FRAMES;
        step(&s, ALONE + 1, frame);
        const lw_tile_id plate = lw_atlas_map_find(&s.map, ROOM_PLATE, 0, 0, 0);
        s.solver->ops->read_tile(s.solver, plate, &other);
        assert_true(other.error == LW_ATLAS_COARSE_ERROR);
        if (moves) s.pose.light[0].position_ws.x += 0.1f;
        step(&s, frame + 1, frame + 1);
        s.solver->ops->read_tile(s.solver, plate, &other);
        assert_true((other.error == LW_ATLAS_COARSE_ERROR) == !moves);
        assert_true(!moves || (other.solved_frame == frame + 1 && s.stats.tiles_shown > 0));
        if (!moves) {
            lw_support_ok(s.solver->ops->set_interest(s.solver, NULL, NULL), NULL);
            step(&s, frame + 2, frame + 1 + FRAMES);
            s.solver->ops->read_tile(s.solver, plate, &other);
            assert_true(other.error < LW_ATLAS_COARSE_ERROR);
        }
        room_finish(&s);
    }
}

/* A client that comes late takes a channel that the coarse solver never showed. */
static void test_another_channel_ends_coarse_light(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct lw_scene *scene = room_scene(&room);
    struct room_solution s;
    struct lw_pose pose;
    struct lw_client_lights client;
    struct lw_error err = {0};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_client_lights_init(&client, scene, &pose, "lamps", &err), &err);
    assert_true(client.drawn_lights > 0);
    struct lw_solver_desc desc = terms;
    desc.client_lights = &client;
    begin_with(&s, scene, 13, true, desc);
    step(&s, 1, ALONE);
    uint8_t *nothing = calloc(s.map.tile_count, 1);
    assert_non_null(nothing);
    lw_support_ok(s.solver->ops->set_interest(s.solver, nothing, NULL), NULL);
    free(nothing);
    lw_coarse_first_wait(s.solver);
    step(&s, ALONE + 1, ALONE + FRAMES);
    s.solver->ops->choose_channels(s.solver, 1u << LW_TILE_CHANNEL_FULL | 1u << LW_TILE_CHANNEL_SPLIT);
    step(&s, ALONE + FRAMES + 1, ALONE + FRAMES + 1);
    for (uint32_t id = 0; id < s.map.plain_count; id++) {
        struct lw_solver_tile tile;
        if (s.map.place[id].level) continue;
        s.solver->ops->read_tile(s.solver, (lw_tile_id){id}, &tile);
        assert_non_null(tile.shown[LW_TILE_CHANNEL_SPLIT][0]);
        assert_true(tile.error < LW_ATLAS_COARSE_ERROR);
    }
    room_finish(&s);
    lw_client_lights_finish(&client);
    lw_pose_finish(&pose);
}

/* A wall gets another colour, and an object another place, while the whole solver is built. The interest
 * set is given before it is there. */
static void test_changes_meanwhile(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct room_solution s;
    struct lw_scene variant;
    const struct lw_scene *scene;
    double mean[2];
    for (int dark = 0; dark < 2; dark++) {
        begin(&s, room_scene(&room), 9, true);
        step(&s, 1, ALONE);
        lw_support_ok(lw_scene_init_variant(&variant, s.scene), NULL);
        scene = s.scene;
        for (uint32_t m = 0; m < scene->material_count && dark; m++)
            for (int c = 0; c < 3; c++) s.scene->material[m].base_colour[c] = 0;
        lw_pose_evaluate(&s.pose, s.scene, 0);
        uint8_t *interest = calloc(s.map.tile_count, 1);
        assert_non_null(interest);
        memset(interest, 1, s.map.tile_count);
        lw_support_ok(s.solver->ops->set_interest(s.solver, interest, NULL), NULL);
        free(interest);
        lw_coarse_first_wait(s.solver);
        step(&s, ALONE + 1, ALONE + FRAMES);
        assert_int_equal(s.stats.tiles_interest, s.stats.tiles);
        mean[dark] = room_object_mean(&s, 0).indirect;
        lw_scene_finish_variant(&variant);
        room_finish(&s);
    }
    assert_true(mean[0] > 0.1);
    assert_true(mean[1] == 0);
}

/* Whatever it is at when it ends. */
static void test_it_ends_at_any_time(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    const uint64_t frames[] = {0, 1, ALONE, ALONE + 1};
    for (unsigned k = 0; k < sizeof frames / sizeof *frames; k++) {
        struct room_solution s;
        begin(&s, room_scene(&room), 9, true);
        step(&s, 1, frames[k]);
        cancelled = true;
        room_finish(&s);
    }
}

/* A building that is cancelled ends the next frame. */
static void test_a_failure_is_a_frames(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct room_solution s;
    struct lw_error err = {0};
    begin(&s, room_scene(&room), 9, true);
    step(&s, 1, ALONE - 1);
    cancelled = true; /* the coarse solver does not look at it between frames */
    enum lw_status status = s.solver->ops->frame(s.solver, &s.pose, ALONE, &s.stats, &err);
    assert_int_equal(status, LW_CLOSED);
    room_finish(&s);
}

/* Sums are those of the whole solver. */
static void test_saved_and_loaded(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    const uint8_t key[16] = {7};
    struct room_solution s, again;
    struct lw_error err = {0};
    uint64_t frames = 0;
    char path[] = "/tmp/lightwell-coarse-XXXXXX";
    const int file = mkstemp(path);
    assert_true(file >= 0);
    close(file);
    unlink(path);
    begin(&s, room_scene(&room), 9, true);
    step(&s, 1, ALONE);
    lw_support_ok(s.solver->ops->save(s.solver, path, key, &err), &err);
    assert_true(access(path, F_OK) != 0); /* nothing is worth it */
    lw_coarse_first_wait(s.solver);
    step(&s, ALONE + 1, ALONE + FRAMES);
    lw_support_ok(s.solver->ops->save(s.solver, path, key, &err), &err);
    begin(&again, room_scene(&room), 9, true);
    assert_int_equal(again.solver->ops->load(again.solver, "/nowhere/sums", key, &frames, NULL), LW_NO_INPUT);
    step(&again, 1, 1); /* and it did not wait: the light is coarse */
    assert_true(again.stats.coarse);
    lw_support_ok(again.solver->ops->load(again.solver, path, key, &frames, &err), &err);
    assert_int_equal(frames, FRAMES);
    step(&s, ALONE + FRAMES + 1, ALONE + FRAMES + 1);
    step(&again, ALONE + FRAMES + 1, ALONE + FRAMES + 1);
    assert_true(room_expect_same(&s, &again) > 6);
    unlink(path);
    room_finish(&s);
    room_finish(&again);
}

static struct stat file_of(const char *path) {
    struct stat file;
    assert_int_equal(stat(path, &file), 0);
    return file;
}

/* Which coarse texels light reaches is saved under a key of its own, and read by the next start. */
static void test_a_second_start_looks_into_nothing(void **state) {
    (void)state;
    const struct lw_saved_texels saved = {.folder = lw_support_temporary("coarse-texels"), .key = {7}};
    const struct room room = room_with_two_lamps();
    struct lw_solver_desc desc = terms;
    struct room_solution first, second;
    uint8_t key[LW_SAVED_TEXELS_KEY_SIZE];
    desc.saved_texels = &saved;
    lw_coarse_scene_key(saved.key, key);
    char *path = lw_cache_folder_path(saved.folder, key, LW_SAVED_TEXELS_SUFFIX),
         *whole = lw_cache_folder_path(saved.folder, saved.key, LW_SAVED_TEXELS_SUFFIX);
    begin_with(&first, room_scene(&room), 13, true, desc);
    assert_int_equal(access(whole, F_OK), -1); /* it is not built yet */
    const struct stat file = file_of(path);
    begin_with(&second, room_scene(&room), 13, true, desc);
    assert_int_equal(file_of(path).st_ino, file.st_ino); /* saving makes another file */
    step(&first, 1, 2);
    step(&second, 1, 2);
    assert_true(room_expect_same(&first, &second) > 6);
    room_finish(&first);
    room_finish(&second);
    free(path);
    free(whole);
}

static void test_small_scenes_do_without(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct room_solution s;
    begin(&s, room_scene(&room), 9, false);
    assert_false(lw_coarse_first_pays(s.scene));
    s.scene->mesh[0].atlas_width = LW_COARSE_FIRST_TEXELS_MIN / s.scene->mesh[0].atlas_height + 4;
    assert_true(lw_coarse_first_pays(s.scene));
    room_finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_furnace),
        cmocka_unit_test(test_blocks_keep_their_mean),
        cmocka_unit_test(test_no_texel_is_left_out),
        cmocka_unit_test(test_light_stays_in_its_room),
        cmocka_unit_test(test_the_whole_follows),
        cmocka_unit_test(test_tiles_follow_by_themselves),
        cmocka_unit_test(test_another_channel_ends_coarse_light),
        cmocka_unit_test(test_changes_meanwhile),
        cmocka_unit_test(test_it_ends_at_any_time),
        cmocka_unit_test(test_a_failure_is_a_frames),
        cmocka_unit_test(test_saved_and_loaded),
        cmocka_unit_test(test_a_second_start_looks_into_nothing),
        cmocka_unit_test(test_small_scenes_do_without),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
