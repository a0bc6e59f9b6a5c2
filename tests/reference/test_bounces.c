/* Indirect light against closed forms and against itself: the closed furnace,
 * threads, linearity, convergence. */
#include "tests/reference/effort.h"
#include "tests/reference/room.h"

#include "common/builtin/builtin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* In a closed room whose walls all emit Le and reflect rho, bounce k adds pi Le rho^k. */
static void expect_furnace(float rho, uint32_t bounces, double tolerance) {
    struct room room = {.texels_per_metre = 8};
    room_box(&room, lw_vec3(2, 2, 2), rho, 1.5f);
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.bounces = bounces, .direct_samples = 16},
               32 * effort);
    double want = 0, pi_le = 1.5 * acos(-1.0);
    for (uint32_t k = 0; k <= bounces; k++) want += pi_le * pow((double)rho, k);
    double mean = 0;
    for (uint32_t o = 0; o < 6; o++) mean += room_object_mean(&solution, o).total / 6;
    if (fabs(mean - want) > tolerance * want)
        fail_msg("furnace rho %.2f, %u bounces: E %.5f, expected %.5f", (double)rho, bounces, mean, want);
    room_finish(&solution);
}

/* The direct term draws two of twelve triangles for a packet. The mean over 6 x 16^2 texels of 512 samples,
 * which share directions within blocks, scatters by 0.1 % (one sigma, six seeds), by 0.15 with three bounces
 * of 0.5, by 0.8 with eight of 0.9. */
static void test_furnace(void **state) {
    (void)state;
    expect_furnace(0.5f, 0, noise(0.004));
    expect_furnace(0.5f, 3, noise(0.006));
    expect_furnace(0.9f, 8, noise(0.024));
}

/* Fins stand on the floor, five to a texel. Most rays that end between them see no texel's place. They take
 * no light out of a furnace all the same. */
static void test_fins_in_a_furnace(void **state) {
    (void)state;
    enum { FINS = 19 };
    const float rho = 0.7f, le = 1.5f;
    const uint32_t bounces = 3;
    struct room room = {.texels_per_metre = 2};
    struct room_solution solution;
    double want = 0, mean = 0;
    room_box(&room, lw_vec3(2, 2, 2), rho, le);
    for (int i = 1; i <= FINS; i++) {
        room_quad(&room, lw_vec3(0.1f * (float)i, 0, 0), lw_vec3(0, 0.4f, 0), lw_vec3(0, 0, 2), rho, le);
        room.quad[room.quad_count - 1].double_sided = true;
    }
    room_solve(&solution, &room,
               (struct lw_solver_desc){.bounces = bounces, .direct_samples = 16, .indirect_samples = 4},
               64 * effort);
    for (uint32_t k = 0; k <= bounces; k++) want += acos(-1.0) * (double)le * pow((double)rho, k);
    for (uint32_t o = 1; o < 6; o++) mean += room_object_mean(&solution, o).total / 5;
    printf("above fins: %.4f of the furnace's light\n", mean / want);
    expect_near(mean, want, 0.028); /* where a whole packet sees no place, light is lost */
    room_finish(&solution);
}

static double total_over_room(const struct room_solution *solution) {
    double sum = 0;
    for (uint32_t o = 0; o < solution->scene->object_count; o++) {
        struct room_mean mean = room_object_mean(solution, o);
        sum += mean.total * mean.texels;
    }
    return sum;
}

static void copy_tiles(const struct room_solution *solution, float *dst) {
    for (uint32_t id = 0; id < solution->map.tile_count; id++) {
        if (solution->map.place[id].level) continue;
        struct lw_solver_tile tile;
        solution->solver->ops->read_tile(solution->solver, (lw_tile_id){id}, &tile);
        for (int c = 0; c < 3; c++) {
            memcpy(dst, tile.direct[c], tile.width * tile.height * sizeof *dst);
            dst += tile.width * tile.height;
            memcpy(dst, tile.indirect[c], tile.width * tile.height * sizeof *dst);
            dst += tile.width * tile.height;
        }
    }
}

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    struct room room = room_lit_box(10);
    struct room_solution a, b;
    struct lw_solver_desc desc = {
        .bounces = 2, .threads = 1, .tracing_range_m = 1.0f, .probe_spacing_m = 0.5f};
    room_solve(&a, &room, desc, 5);
    desc.threads = 3;
    room_solve(&b, &room, desc, 5);
    size_t floats = 0;
    for (uint32_t id = 0; id < a.map.tile_count; id++)
        if (a.map.place[id].level == 0) floats += (size_t)a.map.place[id].width * a.map.place[id].height * 6;
    float *x = malloc(floats * sizeof *x), *y = malloc(floats * sizeof *y);
    assert_non_null(x);
    assert_non_null(y);
    copy_tiles(&a, x);
    copy_tiles(&b, y);
    assert_memory_equal(x, y, floats * sizeof *x);
    assert_true(a.rays == b.rays && a.rays > 0);
    free(y);
    free(x);
    room_finish(&b);
    room_finish(&a);
}

static void test_light_is_linear(void **state) {
    (void)state;
    double sum[3];
    for (int i = 0; i < 3; i++) {
        struct room room = room_lit_box(10);
        if (i == 1) room.quad[6].emission = 0;
        if (i != 0) {
            room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {4, 4, 4}};
            room.light_position[0] = lw_vec3(1, 1, 2.2f);
            room.light_count = 1;
        }
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 2}, 48);
        sum[i] = total_over_room(&solution);
        room_finish(&solution);
    }
    /* lamp alone, point alone, both */
    expect_near(sum[0] + sum[1], sum[2], 0.004);
}

static void test_converged_scene_costs_nothing(void **state) {
    (void)state;
    struct room room = room_lit_box(10);
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 1, .target_error = 0.1f}, 64);
    assert_int_equal(solution.stats.tiles_converged, solution.stats.tiles);
    assert_int_equal(solution.stats.tiles_solved, 0);
    assert_int_equal(solution.stats.rays_shadow + solution.stats.rays_bounce, 0);
    room_finish(&solution);
}

static void no_light_lost(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)area;
    (void)p;
    (void)user;
    assert_true(isfinite(direct) && isfinite(indirect) && direct >= 0 && indirect >= 0);
}

/* A light in an empty room of black walls: the arriving power is the emitted power. */
static void test_energy_of_a_point_light_arrives(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 24};
    room_box(&room, lw_vec3(2, 2, 2), 0, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {1, 1, 1}};
    room.light_position[0] = lw_vec3(0.8f, 1.1f, 0.9f);
    room.light_count = 1;
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 2}, 1);
    double watts = 0;
    for (uint32_t o = 0; o < 6; o++) {
        watts += room_object_mean(&solution, o).total * 4; /* m^2 */
        room_each_texel(&solution, o, no_light_lost, NULL);
    }
    expect_near(watts, 4 * acos(-1.0), 0.003); /* the grid's rim: (1/48)^2 */
    room_finish(&solution);
}

/* A lamp 3 cm over a dish that catches 28 % of its light and sends 22 % on; one ray in hundreds meets it. */
static struct room room_with_dish(void) {
    struct room room = {.texels_per_metre = 8};
    room_box(&room, lw_vec3(2, 2, 2), 0.6f, 0);
    room_disc(&room, lw_vec3(1, 1, 1), lw_vec3(0.06f, 0, 0), lw_vec3(0, 0, -0.06f), 0.8f, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {1, 1, 1}};
    room.light_position[0] = lw_vec3(1, 1.03f, 1);
    room.light_count = 1;
    return room;
}

struct texels {
    double indirect[6 * 16 * 16];
    uint32_t count;
};

static void note_indirect(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    struct texels *texels = user;
    (void)p, (void)area, (void)direct;
    assert_true(texels->count < 6 * 16 * 16);
    texels->indirect[texels->count++] = indirect;
}

/* What bounces after the first give to the walls: the first is the same in both. */
static void solve_later_bounces(struct texels *out, uint32_t seed, unsigned frames) {
    const struct room room = room_with_dish();
    struct texels solved[2] = {0};
    for (uint32_t all = 0; all < 2; all++) {
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){.bounces = all ? 3 : 1, .seed = seed}, frames);
        for (uint32_t o = 0; o < 6; o++) room_each_texel(&solution, o, note_indirect, &solved[all]);
        room_finish(&solution);
    }
    *out = solved[1];
    for (uint32_t i = 0; i < out->count; i++) out->indirect[i] -= solved[0].indirect[i];
}

static double mean_of(const struct texels *texels) {
    double sum = 0;
    for (uint32_t i = 0; i < texels->count; i++) sum += texels->indirect[i];
    return sum / texels->count;
}

/* The mean indirect light of the walls after four frames, of a lamp of 2^power W/sr. */
static double mean_under(int power) {
    struct room room = room_with_dish();
    struct room_solution solution;
    struct texels texels = {0};
    for (int c = 0; c < 3; c++) room.light[0].intensity[c] = ldexpf(1, power);
    room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 3, .seed = 1}, 4);
    for (uint32_t o = 0; o < 6; o++) room_each_texel(&solution, o, note_indirect, &texels);
    room_finish(&solution);
    return mean_of(&texels);
}

/* A lamp that fades out passes numbers whose reciprocal is infinite. Its light stays in proportion, but for
 * what rounding to 2^-149 takes: less than 1 % at 2^-134. */
static void test_faint_light_is_light(void **state) {
    (void)state;
    const double want = mean_under(0);
    for (int power = -134; power < -100; power += 3)
        expect_near(ldexp(mean_under(power), -power), want, 0.01);
}

/* After four frames a few texels have met the dish and shine a hundred times as bright as others, and their
 * blocks send on what they have more. relMSE of later bounces about their mean: 0.08, and 0.9 if each sent
 * what it has. The means of seeds scatter by 20 %. */
static void test_rare_samples_are_no_lamps(void **state) {
    (void)state;
    const uint32_t seeds = 32;
    struct texels many;
    solve_later_bounces(&many, 1, 256 * effort); /* known to 0.2 sqrt(4 / 256): 2.5 % */
    const double want = mean_of(&many);
    double square = 0, light = 0;
    for (uint32_t seed = 1; seed <= seeds; seed++) {
        struct texels few;
        solve_later_bounces(&few, seed, 4);
        const double got = mean_of(&few);
        for (uint32_t i = 0; i < many.count; i++)
            square += pow(few.indirect[i] / got - many.indirect[i] / want, 2) / many.count / seeds;
        light += got / seeds;
    }
    if (square > 0.2) fail_msg("relMSE of later bounces after four frames: %.4f", square);
    expect_near(light, want, 0.13);
}

/* With an argument: the same of more samples. */
int main(int argc, char **argv) {
    (void)argv;
    set_effort(argc);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_furnace),
        cmocka_unit_test(test_fins_in_a_furnace),
        cmocka_unit_test(test_same_bytes_at_any_thread_count),
        cmocka_unit_test(test_light_is_linear),
        cmocka_unit_test(test_converged_scene_costs_nothing),
        cmocka_unit_test(test_energy_of_a_point_light_arrives),
        cmocka_unit_test(test_rare_samples_are_no_lamps),
        cmocka_unit_test(test_faint_light_is_light),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
