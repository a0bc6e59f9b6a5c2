/* A solve that is saved and taken up by another solver goes on byte for byte; a file that is
 * damaged, cut or of something else is refused, and nothing of it taken. */
#include "tests/reference/room.h"

#include "server/solve/state/checkpoint.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FRAMES 24u
#define BEFORE 10u

static const uint8_t key[LW_CHECKPOINT_KEY_SIZE] = {1, 2, 3}, other_key[LW_CHECKPOINT_KEY_SIZE] = {1, 2, 4};

/* A closed room with a lamp and a double-sided board in it: tiles in several cells, some with backs. */
static struct room make_room(void) {
    struct room room = {.texels_per_metre = 6};
    room_box(&room, lw_vec3(8, 3, 8), 0.6f, 0);
    room_quad(&room, lw_vec3(3, 2.9f, 3), lw_vec3(2, 0, 0), lw_vec3(0, 0, 2), 0.5f, 10);
    room_quad(&room, lw_vec3(1, 1, 1), lw_vec3(1, 0, 0), lw_vec3(0, 1, 1), 0.5f, 0);
    room.quad[room.quad_count - 1].double_sided = true;
    return room;
}

static struct lw_solver_desc describe(float range_m, float target_error) {
    return (struct lw_solver_desc){.bounces = 2,
                                   .tracing_range_m = range_m,
                                   .cell_size_m = 2,
                                   .indirect_samples = 2,
                                   .target_error = target_error,
                                   .threads = 2};
}

static void solve(struct room_solution *solution, struct lw_solver_desc desc, unsigned frames) {
    const struct room room = make_room();
    room_solve(solution, &room, desc, frames);
}

static void go_on(struct room_solution *solution, unsigned from, unsigned to) {
    struct lw_error err = {0};
    for (unsigned f = from + 1; f <= to; f++)
        lw_support_ok(
            solution->solver->ops->frame(solution->solver, &solution->pose, f, &solution->stats, &err), &err);
}

static void expect_same(const struct room_solution *a, const struct room_solution *b) {
    room_expect_same(a, b);
    assert_int_equal(a->stats.tiles_converged, b->stats.tiles_converged);
}

static void resumes(float range_m, float target_error) {
    const char *path = lw_support_temporary("state");
    struct room_solution whole, first, second;
    struct lw_error err = {0};
    solve(&whole, describe(range_m, target_error), FRAMES);
    solve(&first, describe(range_m, target_error), BEFORE);
    lw_support_ok(first.solver->ops->save(first.solver, path, key, &err), &err);
    solve(&second, describe(range_m, target_error), 0);
    uint64_t frames = 0;
    lw_support_ok(second.solver->ops->load(second.solver, path, key, &frames, &err), &err);
    assert_int_equal(frames, BEFORE);
    go_on(&second, BEFORE, FRAMES);
    expect_same(&whole, &second);
    assert_true(whole.stats.tiles_converged < whole.stats.tiles || target_error > 0.5f);
    room_finish(&whole);
    room_finish(&first);
    room_finish(&second);
}

static void resumed_is_uninterrupted(void **state) {
    (void)state;
    resumes(INFINITY, 0);
    resumes(INFINITY, 0.03f); /* some tiles converge */
}

static void resumed_is_uninterrupted_with_probes(void **state) {
    (void)state;
    resumes(0.8f, 0);
}

/* Loads bytes as a file into a fresh solver, expecting to be refused; the solver must then work as a new one
 * does. */
static void refused(const uint8_t *bytes, size_t size, enum lw_status status, const char *text) {
    const char *path = lw_support_temporary("bad");
    lw_support_write_file(path, bytes, size);
    struct room_solution fresh, tried;
    solve(&fresh, describe(INFINITY, 0), 2);
    solve(&tried, describe(INFINITY, 0), 0);
    struct lw_error err = {0};
    uint64_t frames;
    lw_support_fails(tried.solver->ops->load(tried.solver, path, key, &frames, &err), status, &err, text);
    assert_non_null(strstr(err.text, path));
    go_on(&tried, 0, 2);
    expect_same(&fresh, &tried);
    room_finish(&fresh);
    room_finish(&tried);
}

static void damaged_is_refused(void **state) {
    (void)state;
    const char *path = lw_support_temporary("good");
    struct room_solution solution;
    struct lw_error err = {0};
    solve(&solution, describe(INFINITY, 0), 2);
    lw_support_ok(solution.solver->ops->save(solution.solver, path, key, &err), &err);
    size_t size;
    uint8_t *bytes = lw_support_read_file(path, &size);
    refused(bytes, 0, LW_BAD_DATA, "no checkpoint");
    refused(bytes, 20, LW_BAD_DATA, "cut short");
    refused(bytes, size - 1, LW_BAD_DATA, "cut short");
    bytes[8]++; /* the version */
    refused(bytes, size, LW_BAD_DATA, "has version");
    bytes[8]--;
    bytes[size / 2] ^= 1;
    refused(bytes, size, LW_BAD_DATA, "damaged");
    bytes[size / 2] ^= 1;
    bytes[size - 1] ^= 1;
    refused(bytes, size, LW_BAD_DATA, "damaged");
    free(bytes);
    room_finish(&solution);
}

static void other_bakes_are_refused(void **state) {
    (void)state;
    const char *path = lw_support_temporary("mine");
    struct room_solution mine, other;
    struct lw_error err = {0};
    uint64_t frames;
    solve(&mine, describe(INFINITY, 0), 1);
    lw_support_ok(mine.solver->ops->save(mine.solver, path, key, &err), &err);
    lw_support_fails(mine.solver->ops->load(mine.solver, path, other_key, &frames, &err), LW_BAD_DATA, &err,
                     "another scene");
    struct lw_solver_desc desc = describe(INFINITY, 0);
    desc.bounces = 1;
    solve(&other, desc, 0);
    err = (struct lw_error){0};
    lw_support_fails(other.solver->ops->load(other.solver, path, key, &frames, &err), LW_BAD_DATA, &err,
                     "another scene");
    err = (struct lw_error){0};
    lw_support_fails(mine.solver->ops->load(mine.solver, lw_support_temporary("none"), key, &frames, &err),
                     LW_NO_INPUT, &err, "none");
    err = (struct lw_error){0};
    lw_support_fails(mine.solver->ops->save(mine.solver, "/nowhere/state", key, &err), LW_CANNOT_CREATE, &err,
                     "/nowhere/state");
    err = (struct lw_error){0};
    lw_support_fails(mine.solver->ops->save(mine.solver, "/dev/full", key, &err), LW_IO, &err, "/dev/full");
    room_finish(&mine);
    room_finish(&other);
}

/* As many texels in each tile, but others. */
static void other_texels_are_refused(void **state) {
    (void)state;
    enum { TEXELS = 4 };
    const char *path = lw_support_temporary("texels");
    const uint8_t saved[TEXELS] = {1, 0, 1, 0}, moved[TEXELS] = {1, 1, 0, 0};
    float plane[TEXELS] = {1, 2, 3, 4};
    struct lw_error err = {0};
    struct lw_tiles tiles = {.texel_count = TEXELS, .covered = saved, .mean = plane, .spread = plane};
    for (int c = 0; c < 3; c++)
        tiles.direct[c] = tiles.indirect[c] = tiles.shown[LW_TILE_CHANNEL_FULL][c] = plane;
    lw_support_ok(lw_checkpoint_save(path, key, &tiles, NULL, 0, &err), &err);
    plane[0] = 5;
    tiles.covered = moved;
    lw_support_fails(lw_checkpoint_load(path, key, &tiles, NULL, 0, &err), LW_BAD_DATA, &err, "other texels");
    assert_true(plane[0] == 5);
    tiles.covered = saved;
    err = (struct lw_error){0};
    lw_support_ok(lw_checkpoint_load(path, key, &tiles, NULL, 0, &err), &err);
    assert_true(plane[0] == 1);
}

/* Stops are not part of the state: a resumed solve may aim elsewhere, and an aim that is reached needs no
 * frame. */
static void limits_may_change(void **state) {
    (void)state;
    const char *path = lw_support_temporary("limits");
    struct room_solution first, second;
    struct lw_error err = {0};
    uint64_t frames;
    struct lw_solver_desc desc = describe(INFINITY, -1);
    desc.frames_max = 3;
    solve(&first, desc, 5);
    assert_int_equal(first.stats.tiles_converged, first.stats.tiles);
    assert_int_equal(first.stats.tiles_solved, 0); /* the 4th and 5th frame cost nothing */
    lw_support_ok(first.solver->ops->save(first.solver, path, key, &err), &err);
    desc.frames_max = 4;
    solve(&second, desc, 0);
    lw_support_ok(second.solver->ops->load(second.solver, path, key, &frames, &err), &err);
    go_on(&second, 3, 4);
    assert_true(second.stats.tiles_solved > 0);
    struct room_solution whole;
    solve(&whole, desc, 4);
    expect_same(&whole, &second);
    room_finish(&whole);
    room_finish(&first);
    room_finish(&second);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(resumed_is_uninterrupted), cmocka_unit_test(resumed_is_uninterrupted_with_probes),
        cmocka_unit_test(damaged_is_refused),       cmocka_unit_test(other_bakes_are_refused),
        cmocka_unit_test(other_texels_are_refused), cmocka_unit_test(limits_may_change),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
