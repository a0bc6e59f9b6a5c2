/* Virtual point lights against closed forms, against the cell solver, and against themselves. */
#include "tests/reference/room.h"

#include <stdlib.h>

static const double pi = 3.14159265358979;

/* ---- a lamp over a disc, and what faces both from above ---- */

enum { RADIUS = 2, ABOVE = 2 };
#define LAMP_M 0.5
#define RHO    0.6

/* E of the small square over the middle: of rings of the disc, each lit by the lamp. */
static double of_rings(double near_m) {
    const int rings = 4000;
    double e = 0;
    for (int i = 0; i < rings; i++) {
        const double dr = (double)RADIUS / rings, r = (i + 0.5) * dr,
                     lit = LAMP_M / pow(LAMP_M * LAMP_M + r * r, 1.5), d2 = ABOVE * ABOVE + r * r;
        e += RHO / pi * lit * ABOVE * ABOVE / d2 / fmax(d2, near_m * near_m) * 2 * pi * r * dr;
    }
    return e;
}

static double over_disc(float near_m) {
    struct room room = {.texels_per_metre = 10};
    struct room_solution s;
    room_disc(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, RADIUS), lw_vec3(RADIUS, 0, 0), RHO, 0);
    room_quad(&room, lw_vec3(-0.05f, ABOVE, -0.05f), lw_vec3(0.1f, 0, 0), lw_vec3(0, 0, 0.1f), 0, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {1, 1, 1}};
    room.light_position[0] = lw_vec3(0, LAMP_M, 0);
    room.light_count = 1;
    room_solve_by(&s, &room, "vpl",
                  (struct lw_solver_desc){.bounces = 1, .vpl = {.lights = 512, .near_m = near_m}}, 16);
    const double e = room_object_mean(&s, 1).indirect;
    room_finish(&s);
    return e;
}

/* 16 frames of 512 lights, stratified by light: the rest is the size of texels under the lamp. Nothing is
 * nearer than 2 m. With a d0 of 2.5 m the light of rings that are nearer is as little as it says. */
static void test_a_lamp_over_a_plane(void **state) {
    (void)state;
    expect_near(over_disc(0.1f), of_rings(0.1), 0.01);
    expect_near(over_disc(2.5f), of_rings(2.5), 0.01);
    assert_true(of_rings(2.5) < 0.9 * of_rings(0.1));
}

/* d0 takes light from corners alone: with 5 cm under 3 % of the indirect light of an object. 240 lights a
 * frame scatter by some 0.8 % (one sigma). */
static void test_agrees_with_the_cell_solver(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution cells, vpl;
    struct lw_solver_desc desc = {.bounces = 3, .indirect_samples = 4};
    room.texels_per_metre = 6;
    room_solve_by(&cells, &room, "cells", desc, 128);
    desc.vpl = (struct lw_vpl_terms){.lights = 1920, .sets = 8, .near_m = 0.05f};
    room_solve_by(&vpl, &room, "vpl", desc, 128);
    for (uint32_t o = 0; o < room.quad_count; o++) {
        const struct room_mean want = room_object_mean(&cells, o), got = room_object_mean(&vpl, o);
        expect_near(got.direct, want.direct, 0.02);
        if (o != ROOM_PANEL) expect_near(got.indirect, want.indirect, 0.03);
    }
    room_finish(&cells);
    room_finish(&vpl);
}

/* ---- sets ---- */

struct light_of {
    double *at;
    size_t count;
};
static void collect(void *user, struct lw_vec3 position_ws, double area, double direct, double indirect) {
    struct light_of *light = user;
    (void)position_ws, (void)area, (void)direct;
    light->at[light->count++] = indirect;
}

/* The mean of T frames is the sum over all lights, whatever T: but for rounding. */
static void test_sets_add_up(void **state) {
    (void)state;
    enum { MOST = 1 << 16 };
    struct room room = room_with_two_lamps();
    room.texels_per_metre = 6;
    double *const all = malloc(MOST * sizeof *all), *const some = malloc(MOST * sizeof *some);
    for (uint32_t sets = 1; sets <= 32; sets *= 4) {
        struct room_solution s;
        room_solve_by(&s, &room, "vpl",
                      (struct lw_solver_desc){.bounces = 2,
                                              .vpl = {.lights = 256, .sets = sets, .reshoot = UINT32_MAX}},
                      sets);
        struct light_of light = {sets == 1 ? all : some, 0};
        for (uint32_t o = 0; o < room.quad_count; o++) room_each_texel(&s, o, collect, &light);
        assert_true(light.count > 1000 && light.count < MOST);
        double most = 0, sum = 0;
        for (size_t i = 0; i < light.count; i++) sum += all[i] / (double)light.count;
        for (size_t i = 0; i < light.count; i++) most = fmax(most, fabs(light.at[i] - all[i]));
        if (!(most < 1e-4 * sum)) fail_msg("%u sets: %g off, of %g", sets, most, sum);
        assert_true(sum > 0);
        room_finish(&s);
    }
    free(all);
    free(some);
}

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct lw_solver_desc desc = {.bounces = 2, .threads = 1, .vpl = {.lights = 128, .sets = 4}};
    struct room_solution a, b;
    room.texels_per_metre = 6;
    room_solve_by(&a, &room, "vpl", desc, 7);
    desc.threads = 3;
    room_solve_by(&b, &room, "vpl", desc, 7);
    assert_true(room_expect_same(&a, &b) > 0);
    room_finish(&a);
    room_finish(&b);
}

/* A checkpoint in the second round, read by a new solver: the next frames are the same, bit for bit. */
static void test_goes_on_from_a_checkpoint(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution a, b;
    const struct lw_solver_desc desc = {.bounces = 2, .vpl = {.lights = 128, .sets = 4}};
    const uint8_t key[16] = {1};
    struct lw_error err = {0};
    uint64_t frames;
    room.texels_per_metre = 6;
    room_solve_by(&a, &room, "vpl", desc, 6);
    room_solve_by(&b, &room, "vpl", desc, 0);
    const char *path = lw_support_temporary("state");
    lw_support_ok(a.solver->ops->save(a.solver, path, key, &err), &err);
    lw_support_ok(b.solver->ops->load(b.solver, path, key, &frames, &err), &err);
    assert_int_equal(frames, 6);
    for (uint64_t f = 7; f <= 9; f++) {
        lw_support_ok(a.solver->ops->frame(a.solver, &a.pose, f, &a.stats, &err), &err);
        lw_support_ok(b.solver->ops->frame(b.solver, &b.pose, f, &b.stats, &err), &err);
    }
    assert_true(room_expect_same(&a, &b) > 0);
    room_finish(&a);
    room_finish(&b);
}

/* ---- moving objects ---- */

enum { FLOOR, CEILING, SHADE };

/* Floor and ceiling, 2 m apart, a lamp under the ceiling, and a black shade far off. */
static struct room under_a_lamp(void) {
    struct room room = {.texels_per_metre = 8};
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(-1, 2, -1), lw_vec3(2, 0, 0), lw_vec3(0, 0, 2), 0.5f, 0);
    room_quad(&room, lw_vec3(20, 1.7f, -0.5f), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0, 0);
    room.quad[SHADE].double_sided = true;
    /* a spot: it lights the floor alone */
    room.light[0] = (struct lw_light){
        .kind = LW_LIGHT_SPOT, .intensity = {5, 5, 5}, .inner_cone = 0.3f, .outer_cone = 0.5f};
    room.light_position[0] = lw_vec3(0, 1.8f, 0);
    room.light_count = 1;
    return room;
}

/* A shade that comes between the lamp and the floor takes the floor's lights, and theirs on the ceiling with
 * them. Without another shot none comes back when it goes; with some a frame they do, part by part. */
static void test_what_comes_between(void **state) {
    (void)state;
    const struct room room = under_a_lamp();
    for (uint32_t again = 0; again < 2; again++) {
        struct room_solution s;
        room_solve_by(
            &s, &room, "vpl",
            (struct lw_solver_desc){.bounces = 2, .vpl = {.lights = 128, .reshoot = again ? 32 : UINT32_MAX}},
            0);
        s.pose.object_dynamic[SHADE] = true;
        room_frame(&s, 1);
        const double floor = room_object_mean(&s, FLOOR).indirect,
                     ceiling = room_object_mean(&s, CEILING).indirect;
        assert_true(floor > 0 && ceiling > 0);
        s.pose.object_to_world[SHADE].m[0][3] -= 20.5f;
        room_frame(&s, 2);
        assert_true(s.stats.moved);
        assert_true(room_object_mean(&s, FLOOR).direct == 0);
        assert_true(room_object_mean(&s, FLOOR).indirect == 0);
        assert_true(room_object_mean(&s, CEILING).indirect == 0);
        s.pose.object_to_world[SHADE].m[0][3] += 20.5f;
        room_frame(&s, 3);
        if (!again) {
            assert_true(room_object_mean(&s, FLOOR).direct > 0);
            assert_true(room_object_mean(&s, CEILING).indirect == 0);
        } else {
            /* A quarter was shot again in the dark; another one now, and has light. */
            const double now = room_object_mean(&s, CEILING).indirect / ceiling;
            if (!(now > 0.15 && now < 0.35)) fail_msg("%g of the light is back after a frame", now);
            for (uint64_t f = 4; f < 64; f++) room_frame(&s, f);
            expect_near(room_object_mean(&s, CEILING).indirect, ceiling, 0.1);
        }
        room_finish(&s);
    }
}

/* A shade under the ceiling, above the lamp, takes the points on the ceiling that it hides from theirs on the
 * floor, and no others. */
static void test_what_comes_between_two_points(void **state) {
    (void)state;
    struct room room = under_a_lamp();
    struct room_solution s;
    room.quad[SHADE].corner.y = 1.9f;
    room_solve_by(&s, &room, "vpl",
                  (struct lw_solver_desc){.bounces = 2, .vpl = {.lights = 128, .reshoot = UINT32_MAX}}, 0);
    s.pose.object_dynamic[SHADE] = true;
    room_frame(&s, 1);
    const double floor = room_object_mean(&s, FLOOR).indirect,
                 ceiling = room_object_mean(&s, CEILING).indirect;
    s.pose.object_to_world[SHADE].m[0][3] -= 20.5f;
    room_frame(&s, 2);
    assert_true(room_object_mean(&s, CEILING).indirect < 0.9 * ceiling); /* it is in the shade */
    s.pose.object_to_world[SHADE].m[0][3] += 20.5f;
    room_frame(&s, 3);
    expect_near(room_object_mean(&s, CEILING).indirect, ceiling, 1e-5);
    const double left = room_object_mean(&s, FLOOR).indirect / floor;
    if (!(left > 0.2 && left < 0.8)) fail_msg("%g of the second bounce is left", left);
    room_finish(&s);
}

/* Who stays follows its lamp. */
static void test_a_lamp_that_dims(void **state) {
    (void)state;
    const struct room room = under_a_lamp();
    struct room_solution s;
    room_solve_by(&s, &room, "vpl",
                  (struct lw_solver_desc){.bounces = 2, .vpl = {.lights = 128, .reshoot = UINT32_MAX}}, 1);
    const double floor = room_object_mean(&s, FLOOR).indirect,
                 ceiling = room_object_mean(&s, CEILING).indirect;
    s.pose.light[0].intensity = lw_vec3_scale(s.pose.light[0].intensity, 0.25f);
    room_frame(&s, 2);
    assert_true(s.stats.moved);
    expect_near(room_object_mean(&s, FLOOR).indirect, floor / 4, 1e-5);
    expect_near(room_object_mean(&s, CEILING).indirect, ceiling / 4, 1e-5);
    room_finish(&s);
}

static void refuse(struct lw_solver_desc desc, const char *solver, const char *part) {
    const struct lw_solvers_entry *entry;
    struct lw_error err = {0};
    lw_support_ok(lw_solvers_find(solver, &entry, &err), &err);
    lw_support_fails(entry->check(&desc, &err), LW_USAGE, &err, part);
}

static void test_refusals(void **state) {
    (void)state;
    struct lw_light_groups groups = {0};
    refuse((struct lw_solver_desc){.light_groups = &groups}, "vpl", "--light-groups");
    refuse((struct lw_solver_desc){.tracing_range_m = 1}, "vpl", "--tracing-range");
    refuse((struct lw_solver_desc){.frame_budget_s = 1}, "vpl", "--frame-budget-ms");
    refuse((struct lw_solver_desc){.radiosity = {.directions = 4}}, "vpl", "for \"radiosity\"");
    refuse((struct lw_solver_desc){.vpl = {.sets = 2}}, "radiosity", "for \"vpl\"");
    refuse((struct lw_solver_desc){.vpl = {.near_m = 2}}, "cells", "for \"vpl\"");
    refuse((struct lw_solver_desc){.vpl = {.lights = LW_VPL_LIGHTS_MAX + 1}}, "vpl", "at most 65536");
    refuse((struct lw_solver_desc){.vpl = {.sets = LW_VPL_SETS_MAX + 1}}, "vpl", "at most 64");
    refuse((struct lw_solver_desc){.bounces = 4, .vpl = {.lights = 15, .sets = 4}}, "vpl", "16 at least");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_a_lamp_over_a_plane),
                                       cmocka_unit_test(test_agrees_with_the_cell_solver),
                                       cmocka_unit_test(test_sets_add_up),
                                       cmocka_unit_test(test_same_bytes_at_any_thread_count),
                                       cmocka_unit_test(test_goes_on_from_a_checkpoint),
                                       cmocka_unit_test(test_what_comes_between),
                                       cmocka_unit_test(test_what_comes_between_two_points),
                                       cmocka_unit_test(test_a_lamp_that_dims),
                                       cmocka_unit_test(test_refusals)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
