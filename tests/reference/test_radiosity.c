/* The radiosity solver against closed forms, against the cell solver, and against itself. Full passes draw
 * no number: their tolerances are those of a midpoint rule over texels, from halving the texel. */
#include "tests/reference/room.h"

#include "server/solve/radiosity/radiosity_directions.h"

static double furnace(float density, float rho, uint32_t bounces) {
    struct room room = {.texels_per_metre = density};
    struct room_solution s;
    double mean = 0;
    room_box(&room, lw_vec3(2, 2, 2), rho, 1.5f);
    room_solve_by(&s, &room, "radiosity", (struct lw_solver_desc){.bounces = bounces}, 1);
    for (uint32_t o = 0; o < 6; o++) mean += room_object_mean(&s, o).total / 6;
    room_finish(&s);
    return mean;
}

/* E = pi Le sum rho^k: form factors of a closed room sum to 1. The missing part lies in the edges, within a
 * texel of them: it halves with the texel. */
static void test_furnace(void **state) {
    (void)state;
    const double pi_le = 1.5 * acos(-1.0);
    const double coarse = furnace(4, 0.5f, 3), fine = furnace(8, 0.5f, 3), want = pi_le * 1.875;
    expect_near(coarse, want, 0.06);
    expect_near(fine, want, 0.03);
    expect_near(2 * fine - coarse, want, 0.006);
    expect_near(furnace(8, 0.5f, 0), pi_le, 0.02);
}

/* One square of 1 m lights another: E = pi Le F. */
static double plates(struct lw_vec3 corner, struct lw_vec3 edge_u, struct lw_vec3 edge_v, float density) {
    struct room room = {.texels_per_metre = density};
    struct room_solution s;
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
    room_quad(&room, corner, edge_u, edge_v, 0, 1);
    room_solve_by(&s, &room, "radiosity", (struct lw_solver_desc){.bounces = 0}, 1);
    const double e = room_object_mean(&s, 0).total / acos(-1.0);
    room_finish(&s);
    return e;
}

static void test_form_factors_of_squares(void **state) {
    (void)state;
    /* Hottel: parallel, 1 m apart; perpendicular, with a common edge. */
    expect_near(plates(lw_vec3(0, 1, 0), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 16), 0.19982, 0.002);
    const struct lw_vec3 o = lw_vec3(0, 0, 0), x = lw_vec3(1, 0, 0), y = lw_vec3(0, 1, 0);
    const double coarse = plates(o, x, y, 8), fine = plates(o, x, y, 16);
    expect_near(fine, 0.20004, 0.025);
    expect_near(2 * fine - coarse, 0.20004, 0.004);
}

/* A double-sided plate between a lamp and the floor: its shadow, and both of its sides. */
static void test_agrees_with_the_cell_solver(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution cells, radiosity;
    const struct lw_solver_desc desc = {.bounces = 3, .indirect_samples = 4};
    room.texels_per_metre = 8;
    room_solve_by(&cells, &room, "cells", desc, 128);
    room_solve_by(&radiosity, &room, "radiosity", desc, 2);
    for (uint32_t o = 0; o < room.quad_count; o++) {
        const struct room_mean want = room_object_mean(&cells, o), got = room_object_mean(&radiosity, o);
        expect_near(got.total, want.total, 0.02);
        if (o != ROOM_PANEL) expect_near(got.indirect, want.indirect, 0.03);
    }
    room_finish(&cells);
    room_finish(&radiosity);
}

/* Spread evenly over the disc, and so cosine-weighted over the hemisphere: the mean cosine is 2/3,
 * and more by what the middles of cells 1 / sqrt(N) wide lie above their means at the rim. Hexagons
 * would keep 1.9 / sqrt(N) from one another; circles that are filled one by one, half of that and more. */
static void test_directions_are_spread(void **state) {
    (void)state;
    for (uint32_t n = 64; n <= LW_RADIOSITY_DIRECTIONS_MAX; n *= 4) {
        struct lw_radiosity_directions set;
        double nearest = 4, cosine = 0;
        lw_support_ok(lw_radiosity_directions_init(&set, n), NULL);
        for (uint32_t i = 0; i < n; i++) {
            const double x = (double)set.point[i][0], y = (double)set.point[i][1];
            assert_true(x * x + y * y < 1);
            cosine += sqrt(1 - x * x - y * y) / n;
            for (uint32_t j = 0; j < i; j++)
                nearest = fmin(nearest, hypot((double)set.point[j][0] - x, (double)set.point[j][1] - y));
        }
        assert_true(nearest > 0.9 / sqrt(n));
        expect_near(cosine, 2.0 / 3, 0.25 / sqrt(n));
        lw_radiosity_directions_finish(&set);
    }
}

static void test_directions_agree_with_the_cell_solver(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution cells, radiosity;
    struct lw_solver_desc desc = {.bounces = 3};
    room.texels_per_metre = 6;
    room_solve_by(&cells, &room, "cells", desc, 256);
    desc.radiosity.directions = 256;
    room_solve_by(&radiosity, &room, "radiosity", desc, 4);
    for (uint32_t o = 0; o < room.quad_count; o++) {
        const struct room_mean want = room_object_mean(&cells, o), got = room_object_mean(&radiosity, o);
        expect_near(got.direct, want.direct, 0.01);
        expect_near(got.indirect, want.indirect, 0.015);
    }
    room_finish(&cells);
    room_finish(&radiosity);
}

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    room.texels_per_metre = 6;
    struct lw_solver_desc desc = {
        .bounces = 2, .threads = 1, .radiosity = {.undersample = LW_UNDERSAMPLE_RANDOM, .window = 2}};
    struct room_solution a, b;
    room_solve_by(&a, &room, "radiosity", desc, 2);
    desc.threads = 3;
    room_solve_by(&b, &room, "radiosity", desc, 2);
    assert_true(room_expect_same(&a, &b) > 0);
    room_finish(&a);
    room_finish(&b);
}

/* A lamp that moves begins another solution: as if it had always been there. */
static void test_a_moved_lamp(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution a, b;
    const struct lw_solver_desc desc = {.bounces = 1};
    struct lw_error err = {0};
    room.texels_per_metre = 6;
    room_solve_by(&a, &room, "radiosity", desc, 1);
    a.pose.light[0].position_ws.x += 0.5f;
    lw_support_ok(a.solver->ops->frame(a.solver, &a.pose, 2, &a.stats, &err), &err);
    assert_true(a.stats.moved);
    room.light_position[0].x += 0.5f;
    room_solve_by(&b, &room, "radiosity", desc, 1);
    for (uint32_t o = 0; o < room.quad_count; o++) {
        const struct room_mean x = room_object_mean(&a, o), y = room_object_mean(&b, o);
        expect_near(x.direct, y.direct, 1e-4); /* by the node's rounding of the place */
        expect_near(x.indirect, y.indirect, 1e-4);
    }
    room_finish(&a);
    room_finish(&b);
}

/* What stands for many has the flux of all, and is near. Windows of 2 x 2 lose light beside them: within 4 %
 * of full passes. So do squares whose light and normals agree to 0.05. */
static void test_fewer_shooters(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution full, few;
    const struct lw_solver_desc desc = {.bounces = 2};
    room.texels_per_metre = 8;
    room_solve_by(&full, &room, "radiosity", desc, 1);
    for (int u = LW_UNDERSAMPLE_STRIDE; u <= LW_UNDERSAMPLE_MIP + 1; u++) {
        struct lw_solver_desc other = desc;
        if (u <= LW_UNDERSAMPLE_MIP)
            other.radiosity = (struct lw_radiosity_terms){.undersample = (enum lw_undersample)u, .window = 2};
        else
            other.radiosity.subdivide = 0.05f;
        room_solve_by(&few, &room, "radiosity", other, 1);
        for (uint32_t o = 0; o < ROOM_FACES; o++)
            expect_near(room_object_mean(&few, o).total, room_object_mean(&full, o).total, 0.04);
        assert_true(few.stats.rays_bounce < full.stats.rays_bounce * 2 / 3);
        room_finish(&few);
    }
    room_finish(&full);
}

/* Bits of all pairs: the light is the same, bit for bit, and the rays are those of one bounce. A lamp that
 * moves, and another solver that reads the file, take none. */
static void test_kept_visibility(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution once, kept, read;
    struct lw_solver_desc desc = {.bounces = 1};
    struct lw_error err = {0};
    room.texels_per_metre = 6;
    room_solve_by(&once, &room, "radiosity", desc, 1);
    const uint64_t one_bounce = once.stats.rays_bounce;
    room_finish(&once);
    desc.bounces = 3;
    room_solve_by(&once, &room, "radiosity", desc, 1);
    desc.radiosity.keeps_visibility = true;
    desc.radiosity.visibility_path = lw_support_temporary("pairs");
    room_solve_by(&kept, &room, "radiosity", desc, 1);
    assert_true(room_expect_same(&once, &kept) > 0);
    /* The panel shoots twice in the other count, once for itself. */
    assert_true(kept.stats.rays_bounce > 0 && kept.stats.rays_bounce <= one_bounce);
    assert_true(once.stats.rays_bounce > 2 * one_bounce);

    kept.pose.light[0].position_ws.x += 0.5f;
    lw_support_ok(kept.solver->ops->frame(kept.solver, &kept.pose, 1, &kept.stats, &err), &err);
    assert_int_equal(kept.stats.rays_bounce, 0);
    room.light_position[0].x += 0.5f;
    room_solve_by(&read, &room, "radiosity", desc, 1);
    assert_int_equal(read.stats.rays_bounce, 0);
    assert_true(room_expect_same(&kept, &read) > 0);
    room_finish(&read);

    /* Another shape is not taken for it. */
    room.quad[ROOM_PLATE].corner.y += 0.1f;
    struct room_solution other = {0};
    struct lw_solver_desc same = desc;
    same.radiosity.visibility_path = NULL;
    room_solve_by(&other, &room, "radiosity", same, 0);
    same = desc;
    same.scene = other.scene;
    same.atlas_map = &other.map;
    same.direct_samples = same.indirect_samples = same.seed = 1;
    struct lw_solver *solver;
    struct lw_solver_stats stats;
    lw_support_ok(lw_solvers_create("radiosity", &same, &other.pose, &solver, &err), &err);
    lw_support_fails(solver->ops->frame(solver, &other.pose, 1, &stats, &err), LW_BAD_DATA, &err,
                     "other geometry");
    solver->ops->destroy(solver);
    room_finish(&other);
    room_finish(&kept);
    room_finish(&once);
}

/* A checkpoint after one frame, read by a new solver: the second frame is the same, bit for bit. */
static void test_goes_on_from_a_checkpoint(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution a, b;
    const struct lw_solver_desc desc = {.bounces = 1, .radiosity = {.undersample = LW_UNDERSAMPLE_RANDOM}};
    const uint8_t key[16] = {1};
    struct lw_error err = {0};
    uint64_t frames;
    room.texels_per_metre = 6;
    room_solve_by(&a, &room, "radiosity", desc, 1);
    room_solve_by(&b, &room, "radiosity", desc, 0);
    const char *path = lw_support_temporary("state");
    lw_support_ok(a.solver->ops->save(a.solver, path, key, &err), &err);
    lw_support_ok(b.solver->ops->load(b.solver, path, key, &frames, &err), &err);
    assert_int_equal(frames, 1);
    lw_support_ok(a.solver->ops->frame(a.solver, &a.pose, 2, &a.stats, &err), &err);
    lw_support_ok(b.solver->ops->frame(b.solver, &b.pose, 2, &b.stats, &err), &err);
    assert_true(room_expect_same(&a, &b) > 0);
    room_finish(&a);
    room_finish(&b);
}

/* It stops by itself: no frame after the last one that was asked for. */
static void test_ends(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution s;
    room.texels_per_metre = 6;
    room_solve_by(&s, &room, "radiosity",
                  (struct lw_solver_desc){.bounces = 1, .frames_max = 2, .target_error = -1}, 2);
    assert_true(s.stats.tiles_solved > 0);
    assert_int_equal(s.stats.tiles_converged, s.stats.tiles);
    room_frame(&s, 3);
    assert_int_equal(s.stats.tiles_solved, 0);
    assert_int_equal(s.stats.rays_shadow + s.stats.rays_bounce, 0);
    room_finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_furnace),
        cmocka_unit_test(test_form_factors_of_squares),
        cmocka_unit_test(test_agrees_with_the_cell_solver),
        cmocka_unit_test(test_directions_are_spread),
        cmocka_unit_test(test_directions_agree_with_the_cell_solver),
        cmocka_unit_test(test_same_bytes_at_any_thread_count),
        cmocka_unit_test(test_a_moved_lamp),
        cmocka_unit_test(test_fewer_shooters),
        cmocka_unit_test(test_kept_visibility),
        cmocka_unit_test(test_goes_on_from_a_checkpoint),
        cmocka_unit_test(test_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
