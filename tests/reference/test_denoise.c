/* The filter: it moves no energy, fades out with the noise, leaves edges alone, and is worth having. */
#include "tests/reference/room.h"

#include <math.h>
#include <stdlib.h>

static void solve(struct room_solution *solution, const struct room *room, uint32_t seed, unsigned frames,
                  unsigned threads) {
    room_solve(solution, room,
               (struct lw_solver_desc){
                   .bounces = 2, .indirect_samples = 2, .seed = seed, .denoise = true, .threads = threads},
               frames);
}

/* Over all covered texels of an object, or of all (LW_SCENE_NONE): sums of the shown light and of the light
 * that was solved, and the squared differences of the two. */
struct sums {
    double shown, solved, change2, solved2;
};

static struct sums sum_of(const struct room_solution *s, uint32_t object) {
    struct sums sums = {0};
    for (uint32_t id = 0; id < s->map.tile_count; id++) {
        if (s->map.place[id].level || (object != LW_SCENE_NONE && s->map.place[id].object != object))
            continue;
        struct lw_solver_tile tile;
        s->solver->ops->read_tile(s->solver, (lw_tile_id){id}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i]) continue;
            const double solved = (double)tile.direct[1][i] + (double)tile.indirect[1][i],
                         shown = (double)tile.shown[LW_TILE_CHANNEL_FULL][1][i];
            assert_true(isfinite(shown) && shown >= 0);
            sums.shown += shown;
            sums.solved += solved;
            sums.change2 += (shown - solved) * (shown - solved);
            sums.solved2 += solved * solved;
        }
    }
    return sums;
}

static void test_energy_stays_in_its_object(void **state) {
    (void)state;
    static const unsigned frames[] = {1, 3, 8};
    for (int f = 0; f < 3; f++) {
        struct room room = room_lit_box(12);
        struct room_solution s;
        solve(&s, &room, 1, frames[f], 2);
        for (uint32_t o = 0; o < room.quad_count; o++) {
            const struct sums sums = sum_of(&s, o);
            assert_true(fabs(sums.shown - sums.solved) <= 1e-5 * sums.solved); /* the rounding of floats */
        }
        room_finish(&s);
    }
}

/* As the noise falls, so does what the filter changes: to nothing in the end. */
static void test_filter_fades_out(void **state) {
    (void)state;
    double before = 1;
    static const unsigned frames[] = {4, 32, 200};
    for (int f = 0; f < 3; f++) {
        struct room room = room_lit_box(12);
        struct room_solution s;
        solve(&s, &room, 1, frames[f], 2);
        const struct sums sums = sum_of(&s, LW_SCENE_NONE);
        const double change = sqrt(sums.change2 / sums.solved2);
        assert_true(change > 0 && change < 0.6 * before);
        before = change;
        room_finish(&s);
    }
    assert_true(before < 0.03);
}

/* Light without noise has nothing but edges: they stay to the bit. A lamp without extent gives the same
 * sample each frame. */
static void test_edges_without_noise_stay(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 20};
    room_box(&room, lw_vec3(2, 2, 2), 0, 0);
    room_quad(&room, lw_vec3(0.7f, 1, 0.7f), lw_vec3(0, 0, 0.6f), lw_vec3(0.6f, 0, 0), 0, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {4, 4, 4}};
    room.light_position[0] = lw_vec3(1, 1.8f, 1);
    room.light_count = 1;
    struct room_solution s;
    solve(&s, &room, 1, 64, 2);
    const struct sums sums = sum_of(&s, LW_SCENE_NONE);
    assert_true(sums.solved > 0 && sqrt(sums.change2 / sums.solved2) < 0.01);
    room_finish(&s);
}

static double error_of(const struct room_solution *s, const struct room_solution *reference, bool shown) {
    double error = 0, square = 0;
    for (uint32_t id = 0; id < s->map.tile_count; id++) {
        if (s->map.place[id].level) continue;
        struct lw_solver_tile a, t;
        s->solver->ops->read_tile(s->solver, (lw_tile_id){id}, &a);
        reference->solver->ops->read_tile(reference->solver, (lw_tile_id){id}, &t);
        for (uint32_t i = 0; i < a.width * a.height; i++) {
            if (!a.covered[i]) continue; /* shown planes have gutters too */
            const double want = (double)t.direct[1][i] + (double)t.indirect[1][i],
                         got = shown ? (double)a.shown[LW_TILE_CHANNEL_FULL][1][i]
                                     : (double)a.direct[1][i] + (double)a.indirect[1][i];
            error += (got - want) * (got - want);
            square += want * want;
        }
    }
    return error / square;
}

/* limit: what the filter leaves of the error, at most. */
static void expect_error_falls(const struct room *room, const unsigned frames[3], const double limit[3]) {
    struct room_solution reference, s;
    solve(&reference, room, 2, 200, 2);
    for (int f = 0; f < 3; f++) {
        solve(&s, room, 1, frames[f], 2);
        const double before = error_of(&s, &reference, false), after = error_of(&s, &reference, true);
        print_message("%u frames: relative squared error %.5f, filtered %.5f\n", frames[f], before, after);
        if (!(after < limit[f] * before))
            fail_msg("%u frames: relative squared error %.5f before, %.5f after", frames[f], before, after);
        room_finish(&s);
    }
    room_finish(&reference);
}

static void test_error_falls(void **state) {
    (void)state;
    const struct room room = room_lit_box(12);
    expect_error_falls(&room, (const unsigned[]){1, 4, 16}, (const double[]){0.5, 0.5, 0.6});
}

/* Shadows of a lamp without extent, and the noise of indirect light: edges differ from noise as soon as
 * there are two frames. */
static void test_shadows_stay_among_noise(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 12};
    room_box(&room, lw_vec3(2, 2, 3), 0.3f, 0);
    for (uint32_t i = 0; i < 5; i++)
        room_quad(&room, lw_vec3(0.1f + 0.4f * (float)i, 1, 0.2f), lw_vec3(0, 0, 2.6f), lw_vec3(0.2f, 0, 0),
                  0.3f, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {4, 4, 4}};
    room.light_position[0] = lw_vec3(1, 1.8f, 1.5f);
    room.light_count = 1;
    expect_error_falls(&room, (const unsigned[]){1, 2, 3}, (const double[]){0.8, 0.65, 0.6});
}

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    struct room room = room_lit_box(12);
    struct room_solution a, b;
    solve(&a, &room, 1, 3, 1);
    solve(&b, &room, 1, 3, 3);
    room_expect_same(&a, &b);
    room_finish(&b);
    room_finish(&a);
}

/* A floor of nine tiles under a lamp, with the shadow of a board. */
static struct room wide_floor(void) {
    struct room room = {.texels_per_metre = 50};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 3), lw_vec3(3, 0, 0), 0.6f, 0);
    room_quad(&room, lw_vec3(1, 2, 1), lw_vec3(0.6f, 0, 0), lw_vec3(0, 0, 0.6f), 0, 5);
    room_quad(&room, lw_vec3(0.4f, 0.5f, 0.9f), lw_vec3(0.7f, 0, 0), lw_vec3(0, 0, 0.7f), 0, 0);
    return room;
}

/* Solves until all has converged; each frame of the whole as `parts` frames of every parts-th tile. */
static void solve_in_parts(struct room_solution *s, const struct room *room, uint32_t parts) {
    room_solve(s, room, (struct lw_solver_desc){.seed = 1, .denoise = true, .target_error = 0.1f}, 1);
    uint8_t *wanted = malloc(s->map.tile_count);
    assert_non_null(wanted);
    uint64_t frame = 1;
    for (uint32_t idle = 0; idle < parts; idle = s->stats.tiles_solved ? 0 : idle + 1) {
        assert_true(frame < 2000);
        for (uint32_t id = 0; id < s->map.tile_count; id++)
            wanted[id] = s->map.place[id].level == 0 && id % parts == frame % parts;
        lw_support_ok(s->solver->ops->set_interest(s->solver, wanted, NULL), NULL);
        room_frame(s, ++frame);
    }
    assert_int_equal(s->stats.tiles_converged, s->stats.tiles);
    free(wanted);
}

/* Shown light depends on the sums, not on the frames in which they came about; and blocks that have
 * converged keep up with those beside them that do not. */
static void test_parts_of_a_frame_show_the_same(void **state) {
    (void)state;
    struct room room = wide_floor();
    struct room_solution whole, parts;
    solve_in_parts(&whole, &room, 1);
    solve_in_parts(&parts, &room, 4);
    assert_true(whole.map.atlas[0]->level[0].tiles_x >= 3);
    size_t filtered = 0;
    for (uint32_t id = 0; id < whole.map.tile_count; id++) {
        if (whole.map.place[id].level) continue;
        struct lw_solver_tile x, y;
        whole.solver->ops->read_tile(whole.solver, (lw_tile_id){id}, &x);
        parts.solver->ops->read_tile(parts.solver, (lw_tile_id){id}, &y);
        assert_int_equal(x.sample_count, y.sample_count);
        for (int c = 0; c < 3; c++)
            assert_memory_equal(x.shown[LW_TILE_CHANNEL_FULL][c], y.shown[LW_TILE_CHANNEL_FULL][c],
                                x.width * x.height * sizeof(float));
        for (uint32_t i = 0; i < x.width * x.height; i++)
            filtered +=
                x.covered[i] && x.shown[LW_TILE_CHANNEL_FULL][0][i] != x.direct[0][i] + x.indirect[0][i];
    }
    assert_true(filtered > 1000);
    room_finish(&parts);
    room_finish(&whole);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_energy_stays_in_its_object),
        cmocka_unit_test(test_filter_fades_out),
        cmocka_unit_test(test_edges_without_noise_stay),
        cmocka_unit_test(test_error_falls),
        cmocka_unit_test(test_shadows_stay_among_noise),
        cmocka_unit_test(test_same_bytes_at_any_thread_count),
        cmocka_unit_test(test_parts_of_a_frame_show_the_same),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
