/* The hybrid: bounce rays of finite range, which ask probes. Against closed forms and against rays without an
 * end. */
#include "tests/reference/room.h"

#include "common/builtin/builtin.h"
#include "server/solve/transport/probe_form.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const enum lw_probe_form_kind forms[] = {LW_PROBE_FORM_OCTAHEDRAL, LW_PROBE_FORM_SH,
                                                LW_PROBE_FORM_CUBE};
#define FORMS (sizeof forms / sizeof *forms)
static const enum lw_probe_projection projections[] = {LW_PROBE_PROJECTION_DEPTH, LW_PROBE_PROJECTION_BOX,
                                                       LW_PROBE_PROJECTION_STEP};

/* In a closed room whose walls all emit Le and reflect rho, bounce k adds pi Le rho^k. Radiance is uniform,
 * which all forms of probe represent exactly, so probes must not change the result. */
static void expect_furnace(enum lw_probe_form_kind form, enum lw_probe_projection projection, float range_m) {
    struct room room = {.texels_per_metre = 8};
    room_box(&room, lw_vec3(2, 2, 2), 0.5f, 1.5f);
    struct room_solution solution;
    room_solve(&solution, &room,
               (struct lw_solver_desc){.bounces = 3,
                                       .probe_spacing_m = 0.5f,
                                       .tracing_range_m = range_m,
                                       .probe_form = form,
                                       .probe_projection = projection,
                                       .direct_samples = 8},
               16);
    double want = 0, mean = 0;
    for (uint32_t k = 0; k <= 3; k++) want += 1.5 * acos(-1.0) * pow(0.5, k);
    for (uint32_t o = 0; o < 6; o++) mean += room_object_mean(&solution, o).total / 6;
    expect_near(mean, want, 0.015); /* 128 samples scatter by 0.42 %: test_bounces.c */
    room_finish(&solution);
}

static void test_furnace(void **state) {
    (void)state;
    for (size_t form = 0; form < FORMS; form++)
        for (size_t projection = 0; projection < 3; projection++)
            expect_furnace(forms[form], projections[projection], projection ? 0.7f : 1e-4f);
}

/* Two rooms of 2 x 2 x 2 m beside each other, apart by a wall of `thick` metres with faces of its own. One
 * has a lamp. Light in the other one has leaked through the wall. */
static void solve_two_rooms(struct room_solution *solution, float thick, struct lw_solver_desc desc,
                            unsigned frames) {
    const struct lw_vec3 x = lw_vec3(2, 0, 0), y = lw_vec3(0, 2, 0), z = lw_vec3(0, 0, 2);
    struct room room = {.texels_per_metre = 6};
    room_box(&room, lw_vec3(2, 2, 2), 0.7f, 0);
    const float left = 2 + thick;
    const struct lw_vec3 o = lw_vec3(left, 0, 0);
    room_quad(&room, o, z, x, 0.7f, 0);
    room_quad(&room, lw_vec3(left, 2, 0), x, z, 0.7f, 0);
    room_quad(&room, o, x, y, 0.7f, 0);
    room_quad(&room, lw_vec3(left, 0, 2), y, x, 0.7f, 0);
    room_quad(&room, o, y, z, 0.7f, 0);
    room_quad(&room, lw_vec3(left + 2, 0, 0), z, y, 0.7f, 0);
    room_quad(&room, lw_vec3(0.7f, 1.99f, 0.7f), lw_vec3(0.6f, 0, 0), lw_vec3(0, 0, 0.6f), 0, 50);
    room_solve(solution, &room, desc, frames);
}

static double mean_of(const struct room_solution *solution, uint32_t first, uint32_t last) {
    double sum = 0, area = 0;
    for (uint32_t o = first; o <= last; o++) {
        struct room_mean mean = room_object_mean(solution, o);
        sum += mean.indirect * mean.texels;
        area += mean.texels;
    }
    return sum / area;
}

static void test_no_light_through_a_wall(void **state) {
    (void)state;
    static const float ranges[] = {0.05f, 0.1f, 0.3f}; /* in the longest side, 4 m and a wall */
    static const float walls[] = {0.02f, 0.2f};
    for (size_t form = 0; form < FORMS; form++)
        for (int range = 0; range < 3; range++)
            for (int wall = 0; wall < 2; wall++) {
                struct room_solution solution;
                solve_two_rooms(&solution, walls[wall],
                                (struct lw_solver_desc){.bounces = 2,
                                                        .probe_spacing_m = 0.5f,
                                                        .probe_form = forms[form],
                                                        .tracing_range_m = ranges[range] * (4 + walls[wall])},
                                4);
                double lit = mean_of(&solution, 0, 5), dark = mean_of(&solution, 6, 11);
                if (!(lit > 1 && dark < 2e-4 * lit))
                    fail_msg("%s, range %.2f, wall %.2f m: E %.4g in the dark room, %.4g in the lit one",
                             lw_probe_form(forms[form])->name, (double)ranges[range], (double)walls[wall],
                             dark, lit);
                room_finish(&solution);
            }
}

/* Light in the lit room itself neither grows nor shrinks: per wall, against rays without an end. */
static void test_energy_is_that_of_rays_without_end(void **state) {
    (void)state;
    struct room_solution reference, hybrid;
    solve_two_rooms(&reference, 0.2f, (struct lw_solver_desc){.bounces = 2, .indirect_samples = 16}, 12);
    for (size_t form = 0; form < FORMS; form++) {
        const bool smears = forms[form] == LW_PROBE_FORM_SH;
        solve_two_rooms(
            &hybrid, 0.2f,
            (struct lw_solver_desc){
                .bounces = 2, .indirect_samples = 16, .probe_form = forms[form], .tracing_range_m = 0.4f},
            12);
        expect_near(mean_of(&hybrid, 0, 5), mean_of(&reference, 0, 5), smears ? 0.03 : 0.015);
        for (uint32_t o = 0; o < 6; o++)
            expect_near(mean_of(&hybrid, o, o), mean_of(&reference, o, o), smears ? 0.15 : 0.04);
        room_finish(&hybrid);
    }
    room_finish(&reference);
}

static void solve_cornell(struct room_solution *solution, enum lw_probe_form_kind form, unsigned threads) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    room_solve_scene(solution, scene, 5,
                     (struct lw_solver_desc){
                         .bounces = 2, .threads = threads, .probe_form = form, .tracing_range_m = 0.3f},
                     3);
}

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    for (size_t form = 0; form < FORMS; form++) {
        struct room_solution a, b;
        solve_cornell(&a, forms[form], 1);
        solve_cornell(&b, forms[form], 3);
        assert_true(a.rays == b.rays && a.rays > 0);
        room_expect_same(&a, &b);
        room_finish(&b);
        room_finish(&a);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_furnace),
        cmocka_unit_test(test_no_light_through_a_wall),
        cmocka_unit_test(test_energy_is_that_of_rays_without_end),
        cmocka_unit_test(test_same_bytes_at_any_thread_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
