/* Light transport as a whole: form factors off the axis, reciprocity, energy, partial sums, and what a result
 * must not hang on: the order of tiles, the packet that a ray travels in. */
#include "tests/reference/effort.h"
#include "tests/reference/room.h"

#include "common/base/random.h"
#include "common/trace/trace.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846

/* ---- a disc ---- */

#define DISC_RADIUS   0.6
#define DISC_HEIGHT   0.8
#define DISC_RADIANCE 3.0

struct worst {
    double off, sum_got, sum_want;
    unsigned texels;
};

/* A point of a plane parallel to a disc, at any distance from its axis (Howell's catalogue, B-13):
 * F = 1/2 (1 - (Z - 2 R^2) / sqrt(Z^2 - 4 R^2)), Z = 1 + H^2 + R^2, H = h / a, R = r / a. */
static void compare_with_disc(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)area;
    struct worst *worst = user;
    double a = hypot((double)p.x, (double)p.z) + 1e-6, h = DISC_HEIGHT / a, r = DISC_RADIUS / a;
    double z = 1 + h * h + r * r;
    double want = PI * DISC_RADIANCE * 0.5 * (1 - (z - 2 * r * r) / sqrt(z * z - 4 * r * r));
    worst->off = fmax(worst->off, fabs(direct / want - 1));
    worst->sum_got += direct;
    worst->sum_want += want;
    worst->texels++;
    assert_true(indirect == 0);
}

static void test_disc(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 16};
    room_disc(&room, lw_vec3(0, (float)DISC_HEIGHT, 0), lw_vec3((float)DISC_RADIUS, 0, 0),
              lw_vec3(0, 0, (float)DISC_RADIUS), 0, (float)DISC_RADIANCE); /* facing down */
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0, 0);
    struct room_solution solution;
    struct worst worst = {0};
    room_solve(&solution, &room, (struct lw_solver_desc){.direct_samples = 8}, 128);
    room_each_texel(&solution, 1, compare_with_disc, &worst);
    assert_true(worst.texels >= 32 * 32);
    /* 96 chords hold 0.9993 of the circle's area. A sample's relative deviation is up to 0.65 (the cosines
     * change by that much over the disc), so one of 1024 samples is 0.02: five of these for the worst of 1024
     * texels. */
    expect_near(worst.sum_got, worst.sum_want, 0.002);
    if (worst.off > 0.1) fail_msg("a texel is off by %.2g %%", 100 * worst.off);
    room_finish(&solution);
}

/* ---- reciprocity ---- */

/* Two black plates of different size in a grey room, with a screen between them. */
static struct room two_plates(int lit) {
    struct room room = {.texels_per_metre = 16};
    room_box(&room, lw_vec3(2, 2, 2), 0.7f, 0);
    room_quad(&room, lw_vec3(0.2f, 0.3f, 0.4f), lw_vec3(0, 0, 1), lw_vec3(0.5f, 0, 0), 0,
              lit == 0 ? 4.0f : 0);
    room_quad(&room, lw_vec3(1.6f, 0.6f, 0.7f), lw_vec3(0, 0, 0.6f), lw_vec3(0, 0.6f, 0), 0,
              lit == 1 ? 4.0f : 0); /* facing -X */
    room_quad(&room, lw_vec3(1, 0.2f, 0.9f), lw_vec3(0, 0.9f, 0), lw_vec3(0, 0, 0.5f), 0.4f, 0);
    room.quad[8].double_sided = true;
    return room;
}

/* What plate 1 gets from plate 0 is what plate 0 gets from plate 1 when that shines as bright: by area, and
 * after any number of bounces. */
static void test_reciprocity(void **state) {
    (void)state;
    double watts[2];
    for (int lit = 0; lit < 2; lit++) {
        struct room room = two_plates(lit);
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 3, .direct_samples = 4}, 64 * effort);
        struct room_mean mean = room_object_mean(&solution, lit == 0 ? 7 : 6);
        watts[lit] = mean.total * (lit == 0 ? 0.6 * 0.6 : 0.5);
        assert_true(mean.direct > 0 && mean.indirect > 0);
        room_finish(&solution);
    }
    expect_near(watts[0], watts[1], noise(0.021));
}

/* ---- energy ---- */

static double absorbed(const struct room_solution *solution, const struct room *room, const double *area) {
    double watts = 0;
    for (uint32_t o = 0; o < room->quad_count; o++)
        watts += room_object_mean(solution, o).total * area[o] * (1 - (double)room->quad[o].albedo);
    return watts;
}

/* The walls of a closed room absorb the flux of a lamp. With N bounces at most rho^(N+1) of it is missing,
 * and never more is absorbed than was sent. */
static void test_energy_is_neither_made_nor_lost(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 12};
    room_box(&room, lw_vec3(2, 2, 3), 0.5f, 0);
    room_quad(&room, lw_vec3(0.7f, 1.9f, 0.9f), lw_vec3(0.6f, 0, 0), lw_vec3(0, 0, 0.6f), 0, 5);
    const double area[7] = {6, 6, 4, 4, 6, 6, 0.36}, sent = PI * 5 * 0.36;
    double before = 0;
    for (uint32_t bounces = 0; bounces <= 8; bounces += 4) {
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){.bounces = bounces, .direct_samples = 4}, 96);
        double watts = absorbed(&solution, &room, area);
        assert_true(watts > before);
        if (watts > sent * 1.004) fail_msg("%g W of %g W arrive after %u bounces", watts, sent, bounces);
        if (watts < sent * (1 - pow(0.5, bounces + 1) - 0.01))
            fail_msg("only %g W of %g W arrive after %u bounces", watts, sent, bounces);
        before = watts;
        room_finish(&solution);
    }
}

/* Each bounce count reads the partial sum of its own orders: the closed furnace, order by order. */
static void test_partial_sums_of_the_furnace(void **state) {
    (void)state;
    for (uint32_t bounces = 0; bounces <= 4; bounces++) {
        struct room room = {.texels_per_metre = 6};
        room_box(&room, lw_vec3(2, 2, 2), 0.8f, 1);
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){.bounces = bounces, .direct_samples = 4}, 64);
        double want = 0, mean = 0, first = 0;
        for (uint32_t k = 0; k <= bounces; k++) want += PI * pow(0.8, k);
        for (uint32_t o = 0; o < 6; o++) {
            mean += room_object_mean(&solution, o).total / 6;
            first += room_object_mean(&solution, o).direct / 6;
        }
        expect_near(mean, want, 0.015);
        expect_near(first, PI, 0.015);
        room_finish(&solution);
    }
}

/* ---- settings that must not matter ---- */

/* Cells decide the order in which tiles are solved: without probes no byte may depend on it. */
static void test_same_bytes_in_any_order_of_tiles(void **state) {
    (void)state;
    static const float cell_size_m[] = {0.3f, 1e6f, 1e-6f}; /* many, one for all, more than there are tiles */
    struct room room = room_lit_box(40);
    struct room_solution a, b;
    room_solve(&a, &room, (struct lw_solver_desc){.bounces = 2, .cell_size_m = 9, .threads = 2}, 3);
    for (size_t k = 0; k < sizeof cell_size_m / sizeof *cell_size_m; k++) {
        room_solve(&b, &room,
                   (struct lw_solver_desc){.bounces = 2, .cell_size_m = cell_size_m[k], .threads = 2}, 3);
        assert_true(room_expect_same(&a, &b) > 12);
        room_finish(&b);
    }
    room_finish(&a);
}

static void random_ray(struct lw_ray16 *rays, uint32_t lane, uint32_t seed) {
    float r[5];
    for (uint32_t i = 0; i < 5; i++) r[i] = lw_random_unit(lw_random_hash3(seed, lane, i));
    float z = 1 - 2 * r[3], radius = sqrtf(1 - z * z), angle = 2 * LW_PI * r[4];
    lw_trace_set_ray(rays, lane, lw_vec3(0.1f + 1.8f * r[0], 0.1f + 1.7f * r[1], 0.1f + 2.8f * r[2]),
                     lw_vec3(radius * cosf(angle), radius * sinf(angle), z), INFINITY);
}

/* Sixteen rays at once meet what each meets alone, with and without the coherent flag: distances to a few ulp
 * (the kernels order their arithmetic differently), and the same surface unless two are that near. */
static void test_packets_against_single_rays(void **state) {
    (void)state;
    struct room room = room_lit_box(40);
    struct room_solution solution;
    struct lw_error err = {0};
    room_solve(&solution, &room, (struct lw_solver_desc){0}, 1);
    struct lw_trace *trace;
    lw_support_ok(lw_trace_create(solution.scene, &solution.pose, &trace, &err), &err);
    unsigned differ = 0, rays_traced = 0;
    for (uint32_t packet = 0; packet < 200; packet++) {
        struct lw_ray16 rays = {.salt = packet};
        struct lw_hit16 all, coherent, one;
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) random_ray(&rays, lane, packet);
        lw_trace_closest16(trace, LW_TRACE_LIGHT, UINT16_MAX, &rays, &all);
        lw_trace_closest16(trace, LW_TRACE_LIGHT | LW_TRACE_COHERENT, UINT16_MAX, &rays, &coherent);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++, rays_traced++) {
            const uint16_t alone = (uint16_t)(1u << lane);
            lw_trace_closest16(trace, LW_TRACE_LIGHT, alone, &rays, &one);
            assert_true(one.object[lane] != LW_TRACE_MISS); /* the room is closed */
            assert_true(fabsf(one.t[lane] - all.t[lane]) <= 4e-6f * one.t[lane]);
            assert_true(fabsf(one.t[lane] - coherent.t[lane]) <= 4e-6f * one.t[lane]);
            differ += one.object[lane] != all.object[lane] || one.object[lane] != coherent.object[lane];
            for (uint32_t other = 0; other < LW_TRACE_WIDTH; other++)
                assert_true(other == lane || one.object[other] == LW_TRACE_MISS);
            /* Shadow rays that end just short of the hit pass; just beyond it they do not. */
            rays.t_far[lane] = one.t[lane] * 0.999f;
            assert_int_equal(lw_trace_occluded16(trace, LW_TRACE_LIGHT, alone, &rays), 0);
            rays.t_far[lane] = one.t[lane] * 1.001f;
            assert_int_equal(lw_trace_occluded16(trace, LW_TRACE_LIGHT, alone, &rays), alone);
            rays.t_far[lane] = INFINITY;
        }
    }
    if (differ > 3) fail_msg("%u of %u rays meet another object in a packet than alone", differ, rays_traced);
    lw_trace_destroy(trace);
    room_finish(&solution);
}

/* With an argument: the same of more samples. */
int main(int argc, char **argv) {
    (void)argv;
    set_effort(argc);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_disc),
        cmocka_unit_test(test_reciprocity),
        cmocka_unit_test(test_energy_is_neither_made_nor_lost),
        cmocka_unit_test(test_partial_sums_of_the_furnace),
        cmocka_unit_test(test_same_bytes_in_any_order_of_tiles),
        cmocka_unit_test(test_packets_against_single_rays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
