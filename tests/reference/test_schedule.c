/* Interest: tiles in the interest set get the light of a full solve, their contributors follow, other tiles
 * are not solved. */
#include "tests/reference/room.h"

#include <stdlib.h>
#include <string.h>

enum { FLOOR, CEILING }; /* objects of room_box() */

/* Two closed rooms, each with a point light, far apart. Objects 0..5 are the first room's faces, 6..11 the
 * second's. */
static struct room two_rooms(void) {
    struct room room = {.texels_per_metre = 12};
    room_box(&room, lw_vec3(2, 2, 3), 0.6f, 0);
    room_box(&room, lw_vec3(2, 2, 3), 0.6f, 0);
    for (uint32_t q = 6; q < 12; q++) room.quad[q].corner.x += 10;
    for (uint32_t l = 0; l < 2; l++) {
        room.light[l] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {4, 4, 4}};
        room.light_position[l] = lw_vec3(0.6f + 10 * (float)l, 1.2f, 1.9f);
    }
    room.light_count = 2;
    return room;
}

/* What somebody looks at: the level-0 tiles of these objects, from level `level`. */
static uint8_t *looks_at(const struct room_solution *s, uint32_t first, uint32_t count, uint32_t level) {
    uint8_t *wanted = calloc(s->map.tile_count, 1);
    assert_non_null(wanted);
    for (uint32_t id = 0; id < s->map.tile_count; id++)
        if (s->map.place[id].level == 0 && s->map.place[id].object - first < count)
            wanted[id] = (uint8_t)(1 + level);
    return wanted;
}

static void set_interest(struct room_solution *s, uint32_t first, uint32_t count, uint32_t level) {
    uint8_t *wanted = looks_at(s, first, count, level);
    lw_support_ok(s->solver->ops->set_interest(s->solver, wanted, NULL), NULL);
    free(wanted);
}

static struct lw_solver_tile first_tile(const struct room_solution *s, uint32_t object) {
    struct lw_solver_tile tile;
    s->solver->ops->read_tile(s->solver, (lw_tile_id){s->map.first_tile[object]}, &tile);
    return tile;
}

/* ---- the same light ---- */

static void test_wanted_tiles_are_lit_as_in_a_whole_solve(void **state) {
    (void)state;
    struct room room = room_lit_box(12);
    struct room_solution whole, seen;
    const struct lw_solver_desc desc = {.bounces = 2, .target_error = -1};
    uint64_t frame = 0;
    room_solve(&whole, &room, desc, 256);
    room_solve(&seen, &room, desc, 0);
    set_interest(&seen, FLOOR, 1, 0);
    room_solve_on(&seen, &frame, 256);
    const struct room_mean a = room_object_mean(&whole, FLOOR), b = room_object_mean(&seen, FLOOR);
    assert_true(a.indirect > 0.2 * a.direct);
    expect_near(b.direct, a.direct, 1e-6); /* the same samples */
    /* The floor's own 4 x 256 rays of each texel are the same; what they read has had an eighth of the
     * samples and more. */
    expect_near(b.indirect, a.indirect, 0.004);
    assert_int_equal(seen.stats.tiles_interest, 1);
    assert_int_equal(seen.stats.tiles_contributing, 6); /* the other faces, the lamp */
    assert_true(3 * seen.rays < 2 * whole.rays);
    for (uint32_t o = 0; o < 6; o++) {
        const uint32_t frames = first_tile(&seen, o).sample_count;
        if (o == FLOOR)
            assert_int_equal(frames, 256);
        else
            assert_in_range(frames, 256 / 16, 256 / 2 + 2);
    }
    room_finish(&seen);
    room_finish(&whole);
}

/* Seen from afar: a texel of level k is the mean of 4^k. */
static void test_far_tiles_are_solved_less_often(void **state) {
    (void)state;
    struct room room = two_rooms();
    struct room_solution s;
    room_solve(&s, &room, (struct lw_solver_desc){.bounces = 0, .target_error = -1}, 0);
    static const uint32_t frames[] = {65, 33, 17, 9, 9};
    uint32_t before = 0;
    for (uint32_t level = 0; level < 5; level++) {
        uint64_t frame = 64 * level;
        set_interest(&s, 0, 1, level);
        room_solve_on(&s, &frame, 64);
        const uint32_t now = first_tile(&s, 0).sample_count;
        assert_in_range(now - before, frames[level] - 2, frames[level]);
        before = now;
    }
    room_finish(&s);
}

static float *copy_light(const struct room_solution *s, size_t *out_size) {
    size_t floats = 0;
    for (uint32_t id = 0; id < s->map.tile_count; id++)
        if (!s->map.place[id].level) floats += (size_t)s->map.place[id].width * s->map.place[id].height * 3;
    float *copy = malloc(floats * sizeof *copy), *to = copy;
    assert_non_null(copy);
    for (uint32_t id = 0; id < s->map.tile_count; id++) {
        if (s->map.place[id].level) continue;
        struct lw_solver_tile tile;
        s->solver->ops->read_tile(s->solver, (lw_tile_id){id}, &tile);
        for (int c = 0; c < 3; c++, to += tile.width * tile.height)
            memcpy(to, tile.shown[LW_TILE_CHANNEL_FULL][c], sizeof *to * tile.width * tile.height);
    }
    *out_size = floats * sizeof *copy;
    return copy;
}

/* The interest set and the moving objects change on the way. */
static float *wander(unsigned threads, uint64_t *out_rays, size_t *out_size) {
    struct room room = two_rooms();
    struct room_solution s;
    uint64_t frame = 0;
    room_solve(&s, &room, (struct lw_solver_desc){.bounces = 2, .threads = threads, .denoise = true}, 0);
    for (uint32_t o = 0; o < 12; o += 3) {
        set_interest(&s, o, 2, o % 2);
        room_solve_on(&s, &frame, 9);
        s.pose.light[0].intensity.x *= 1.25f;
        room_solve_on(&s, &frame, 3);
    }
    *out_rays = s.rays;
    float *light = copy_light(&s, out_size);
    room_finish(&s);
    return light;
}

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    uint64_t rays[2];
    size_t size[2];
    float *one = wander(1, &rays[0], &size[0]), *three = wander(3, &rays[1], &size[1]);
    assert_true(rays[0] == rays[1] && size[0] == size[1]);
    assert_memory_equal(one, three, size[0]);
    free(three);
    free(one);
}

/* ---- converged ---- */

static void test_nobody_looks_nothing_is_traced(void **state) {
    (void)state;
    struct room room = two_rooms();
    struct room_solution s;
    uint64_t frame = 0, rays;
    room_solve(&s, &room, (struct lw_solver_desc){.bounces = 2, .tracing_range_m = 1}, 0);
    set_interest(&s, 0, 0, 0);
    room_solve_on(&s, &frame, 1);
    assert_int_equal(s.stats.tiles_solved, 12); /* all have been lit once */
    rays = s.rays;
    for (unsigned i = 0; i < 4; i++) {
        s.pose.light[0].intensity.x += 1;
        room_solve_on(&s, &frame, 2);
        assert_int_equal(s.stats.tiles_solved + s.stats.tiles_interest + s.stats.tiles_contributing, 0);
        assert_int_equal(s.stats.tiles, 12);
    }
    assert_true(s.rays == rays);
    lw_support_ok(s.solver->ops->set_interest(s.solver, NULL, NULL), NULL);
    room_solve_on(&s, &frame, 1);
    assert_int_equal(s.stats.tiles_solved, 12);
    assert_int_equal(s.stats.tiles_interest, 12);
    room_finish(&s);
}

static void test_what_neither_is_seen_nor_lights_it_sleeps(void **state) {
    (void)state;
    struct room room = two_rooms();
    struct room_solution s;
    uint64_t frame = 0;
    room_solve(&s, &room, (struct lw_solver_desc){.bounces = 2, .target_error = -1}, 0);
    set_interest(&s, FLOOR, 1, 0);
    room_solve_on(&s, &frame, 1);
    const struct room_mean asleep = room_object_mean(&s, 6 + FLOOR);
    room_solve_on(&s, &frame, 40);
    assert_int_equal(s.stats.tiles_contributing, 5);
    for (uint32_t o = 6; o < 12; o++) assert_int_equal(first_tile(&s, o).sample_count, 1);
    assert_true(room_object_mean(&s, 6 + FLOOR).total == asleep.total);
    /* Somebody looks there, and nothing has moved: the old sample counts as much as the new ones. */
    set_interest(&s, 6 + FLOOR, 1, 0);
    room_solve_on(&s, &frame, 1);
    const struct room_mean two = room_object_mean(&s, 6 + FLOOR);
    struct room_solution whole;
    room_solve(&whole, &room, (struct lw_solver_desc){.bounces = 2, .target_error = -1}, 2);
    expect_near(two.direct, room_object_mean(&whole, 6 + FLOOR).direct, 1e-6);
    room_finish(&whole);
    room_finish(&s);
}

static void test_rests_with_what_is_looked_at(void **state) {
    (void)state;
    struct room room = room_lit_box(12);
    struct room_solution s;
    uint64_t frame = 0;
    room_solve(&s, &room, (struct lw_solver_desc){.bounces = 1, .target_error = 0.1f}, 0);
    set_interest(&s, FLOOR, 1, 0);
    room_solve_on(&s, &frame, 200);
    assert_int_equal(s.stats.tiles_solved, 0);
    assert_int_equal(s.stats.tiles_contributing, 0);
    assert_true(first_tile(&s, FLOOR).error <= 0.1f);
    assert_true(first_tile(&s, CEILING).error > 0.1f); /* had not to */
    room_finish(&s);
}

/* ---- light that changes ---- */

static void dim(struct room_solution *s, uint32_t light, float factor) {
    s->pose.light[light].intensity = lw_vec3_scale(s->pose.light[light].intensity, factor);
}

/* Light that changed while a tile slept: the first frame that solves it again forgets it. */
static void test_wakes_to_the_light_of_today(void **state) {
    (void)state;
    struct room room = two_rooms();
    struct room_solution s;
    uint64_t frame = 0;
    room_solve(&s, &room, (struct lw_solver_desc){.bounces = 2, .target_error = 0.02f}, 0);
    set_interest(&s, 0, 12, 0);
    room_solve_on(&s, &frame, 300); /* long means, which forget slowly when asked to remember */
    set_interest(&s, 0, 6, 0);
    for (unsigned i = 0; i < 100;
         i++) { /* until it is forgotten that the second room's tiles light each other */
        dim(&s, 0, 1.001f);
        room_solve_on(&s, &frame, 1);
    }
    const struct room_mean before = room_object_mean(&s, 6 + FLOOR);
    for (unsigned i = 0; i < 40; i++) {
        dim(&s, 1, powf(3, 1 / 40.0f));
        room_solve_on(&s, &frame, 1);
    }
    room_solve_on(&s, &frame, 400); /* still frames make it no older */
    assert_true(room_object_mean(&s, 6 + FLOOR).total == before.total);
    set_interest(&s, 6, 6, 0);
    room_solve_on(&s, &frame, 1);
    expect_near(room_object_mean(&s, 6 + FLOOR).direct, 3 * before.direct, 0.01);
    room_solve_on(&s, &frame, 60);
    assert_true(s.stats.tiles_solved > 0); /* does not converge while the first frames still show */
    const struct room_mean after = room_object_mean(&s, 6 + FLOOR);
    expect_near(after.direct, 3 * before.direct, 0.005);
    expect_near(after.indirect, 3 * before.indirect, 0.02);
    room_finish(&s);
}

/* What lights the ceiling changes where nobody looks: it hears of it as in a whole solve, a few frames
 * later. */
static void test_changes_reach_what_is_looked_at(void **state) {
    (void)state;
    for (unsigned moving = 0; moving < 2; moving++) {
        struct room room = room_lit_box(12);
        room.light[0] = (struct lw_light){
            .kind = LW_LIGHT_SPOT, .intensity = {8, 8, 8}, .inner_cone = 0.2f, .outer_cone = 0.5f};
        room.light_position[0] = lw_vec3(1, 0.5f, 1.5f); /* onto the middle of the floor */
        room.light_count = 1;
        struct room_solution s[2];
        double indirect[2];
        for (unsigned seen = 0; seen < 2; seen++) {
            uint64_t frame = 0;
            room_solve(&s[seen], &room, (struct lw_solver_desc){.bounces = 1, .target_error = -1}, 0);
            if (seen) set_interest(&s[seen], CEILING, 1, 0);
            room_solve_on(&s[seen], &frame, 60);
            dim(&s[seen], 0, 4);
            room_solve_on(&s[seen], &frame, 1);
            for (unsigned i = 0; i < 20 + seen * 8; i++) {
                if (moving) dim(&s[seen], 0, 1.001f);
                room_solve_on(&s[seen], &frame, 1);
            }
            indirect[seen] = room_object_mean(&s[seen], CEILING).indirect;
            room_finish(&s[seen]);
        }
        if (indirect[1] < 0.95 * indirect[0]) /* a bright spot seen by few rays: each known to some 3 % */
            fail_msg("8 frames later %g, in a whole solve %g", indirect[1], indirect[0]);
    }
}

/* Frames that have time for next to nothing: each solves one tile, the round is shown at its end, and no tile
 * waits for longer; but where the light begins to change, that comes first, and is shown at once. */
static void test_a_round_in_many_frames(void **state) {
    (void)state;
    struct room room = two_rooms();
    struct room_solution s;
    uint64_t frame = 0;
    struct lw_solver_desc d = {.bounces = 1, .target_error = -1, .frame_budget_s = 1e-12};
    room_solve(&s, &room, d, 0);
    set_interest(&s, 0, 12, 0);
    room_solve_on(&s, &frame, 1);
    const uint32_t tiles = s.stats.tiles_solved;
    assert_int_equal(s.stats.tiles_shown, tiles); /* the first frame lights everything */
    assert_true(tiles >= 12);
    for (unsigned round = 1; round <= 3; round++) {
        for (uint32_t f = 0; f < tiles; f++) {
            room_solve_on(&s, &frame, 1);
            assert_int_equal(s.stats.tiles_solved, 1);
            assert_int_equal(s.stats.tiles_shown, f + 1 < tiles ? 0 : tiles);
        }
        for (uint32_t o = 0; o < 12; o++) assert_int_equal(first_tile(&s, o).sample_count, round + 1);
    }
    const double before = room_object_mean(&s, 6 + FLOOR).direct;
    dim(&s, 1, 2);
    room_solve_on(&s, &frame, 1);
    assert_true(s.stats.tiles_shown > 0 && s.stats.tiles_shown < tiles); /* corrected, or solved */
    room_solve_on(&s, &frame, 2 * tiles);
    expect_near(room_object_mean(&s, 6 + FLOOR).direct, 2 * before, 0.01);
    room_finish(&s);
}

/* At the end of a round somebody waits for the frame to end: the round is shown in the next frame, even if
 * somebody waits then. */
static void test_a_round_is_put_off_once(void **state) {
    (void)state;
    struct room room = two_rooms();
    struct room_solution s;
    uint64_t frame = 0;
    _Atomic bool awaited = false;
    room_solve(&s, &room,
               (struct lw_solver_desc){
                   .bounces = 1, .target_error = -1, .frame_budget_s = 1e-12, .awaited = &awaited},
               0);
    room_solve_on(&s, &frame, 1);
    const uint32_t tiles = s.stats.tiles_solved;
    room_solve_on(&s, &frame, tiles - 1);
    awaited = true;
    room_solve_on(&s, &frame, 1);
    assert_int_equal(s.stats.tiles_shown, 0);
    room_solve_on(&s, &frame, 1);
    assert_int_equal(s.stats.tiles_shown, tiles);
    room_finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wanted_tiles_are_lit_as_in_a_whole_solve),
        cmocka_unit_test(test_far_tiles_are_solved_less_often),
        cmocka_unit_test(test_same_bytes_at_any_thread_count),
        cmocka_unit_test(test_nobody_looks_nothing_is_traced),
        cmocka_unit_test(test_what_neither_is_seen_nor_lights_it_sleeps),
        cmocka_unit_test(test_rests_with_what_is_looked_at),
        cmocka_unit_test(test_wakes_to_the_light_of_today),
        cmocka_unit_test(test_changes_reach_what_is_looked_at),
        cmocka_unit_test(test_a_round_in_many_frames),
        cmocka_unit_test(test_a_round_is_put_off_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
