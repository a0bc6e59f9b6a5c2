/* Scenes at the edge of what there can be: hardly any texels, hardly any extent, no light, a million
 * lights. */
#include "common/lightmap/lightmap.h"
#include "tests/reference/room.h"

#define LIGHTS (1u << 20)

struct sum {
    double direct, indirect, worst; /* worst: |direct - want| / want */
    double want;
    unsigned count;
};

static void add_texel(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    struct sum *sum = user;
    (void)p, (void)area;
    assert_true(isfinite(direct) && isfinite(indirect) && direct >= 0 && indirect >= 0);
    sum->direct += direct;
    sum->indirect += indirect;
    sum->worst = fmax(sum->worst, sum->want > 0 ? fabs(direct / sum->want - 1) : 0);
    sum->count++;
}

static struct sum sum_of(const struct room_solution *solution, double want) {
    struct sum sum = {.want = want};
    for (uint32_t o = 0; o < solution->scene->object_count; o++)
        room_each_texel(solution, o, add_texel, &sum);
    return sum;
}

/* A probe for rays over half a metre; and none. */
static const float ranges[] = {INFINITY, 0.5f};

static void test_no_light_at_all(void **state) {
    (void)state;
    for (size_t i = 0; i < 2; i++) {
        struct room room = {.texels_per_metre = 4};
        struct room_solution solution;
        room_box(&room, lw_vec3(2, 2, 2), 0.5f, 0);
        room_solve(&solution, &room,
                   (struct lw_solver_desc){.bounces = 2, .tracing_range_m = ranges[i], .target_error = 0.02f},
                   8);
        const struct sum sum = sum_of(&solution, 0);
        assert_true(sum.count > 300 && sum.direct == 0 && sum.indirect == 0);
        assert_true(solution.stats.rays_shadow == 0);
        room_finish(&solution);
    }
}

/* All at one place of a room's middle; `shining` of them shine. */
static struct lw_scene *room_of_lights(const struct room *room, uint32_t shining) {
    struct lw_scene *scene = room_scene(room);
    scene->light = lw_scene_alloc(scene, LIGHTS, sizeof *scene->light);
    scene->light_count = LIGHTS;
    for (uint32_t i = 0; i < LIGHTS; i++) {
        const float power = i % (LIGHTS / 4) == 77 && i / (LIGHTS / 4) < shining ? 1 : 0;
        scene->light[i] = (struct lw_light){.name = "light",
                                            .node = room->quad_count,
                                            .kind = i % 2 ? LW_LIGHT_SPOT : LW_LIGHT_POINT,
                                            .intensity = {power, power, power},
                                            .inner_cone = 1.5f,
                                            .outer_cone = 1.55f};
    }
    return scene;
}

static void test_a_million_lights_of_no_power(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 8, .light_count = 1};
    struct room_solution solution;
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0.5f, 0);
    room.light_position[0] = lw_vec3(0, 1, 0);
    room.light[0].kind = LW_LIGHT_POINT;
    room_solve_scene(&solution, room_of_lights(&room, 0), room.texels_per_metre, (struct lw_solver_desc){0},
                     2);
    struct sum sum = sum_of(&solution, 0);
    assert_true(sum.count >= 14 * 14 && sum.direct == 0 && solution.rays == 0);
    room_finish(&solution);
    /* two of a million: a group each, so that there is no noise */
    room_solve_scene(&solution, room_of_lights(&room, 2), room.texels_per_metre, (struct lw_solver_desc){0},
                     16);
    double want = 0;
    for (int i = 0; i < 64; i++)
        for (int j = 0; j < 64; j++) {
            const double x = (i + 0.5) / 32 - 1, z = (j + 0.5) / 32 - 1;
            want += 2 * pow(x * x + 1 + z * z, -1.5) / (64 * 64);
        }
    expect_near(room_object_mean(&solution, 0).direct, want, 0.002);
    room_finish(&solution);
}

/* A square that is a texel or less: light arrives, and is right. */
static void test_a_texel_for_everything(void **state) {
    (void)state;
    for (size_t i = 0; i < 2; i++) {
        struct room room = {.texels_per_metre = 0.1f};
        struct room_solution solution;
        room_box(&room, lw_vec3(2, 2, 2), 0.5f, 1);
        room_solve(
            &solution, &room,
            (struct lw_solver_desc){
                .bounces = 4, .tracing_range_m = ranges[i], .direct_samples = 4, .indirect_samples = 16},
            100);
        const struct sum sum = sum_of(&solution, 0);
        assert_true(sum.count >= 6 && sum.count <= 6 * 16);
        /* a closed furnace: pi (1 + 1/2 + 1/4 + ...); 400 samples of six walls' texels */
        double series = 0;
        for (int k = 0; k <= 4; k++) series += pow(0.5, k);
        expect_near((sum.direct + sum.indirect) / sum.count, acos(-1.0) * series, i ? 0.1 : 0.03);
        room_finish(&solution);
    }
}

/* Slats a hundredth of a texel to a texel wide, in the open: what the sky gives, on each of their texels. */
static void test_charts_a_texel_wide(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 8, .sky = 2};
    struct room_solution solution;
    for (unsigned i = 0; i < 6; i++)
        room_quad(&room, lw_vec3(0, 0, 0.5f * (float)i), lw_vec3(0, 0, 0.00125f * powf(2.5f, (float)i)),
                  lw_vec3(3, 0, 0), 0.5f, 0);
    room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 1}, 4);
    const struct sum sum = sum_of(&solution, 2 * acos(-1.0));
    assert_true(sum.count >= 6 * 20);
    if (sum.worst > 1e-4) fail_msg("off by %g", sum.worst);
    assert_true(sum.indirect == 0);
    room_finish(&solution);
}

/* Nothing but a plane, and nothing but a line of planes: an axis of the grid, or two, have no length. */
static void test_flat_scenes(void **state) {
    (void)state;
    for (size_t i = 0; i < 2; i++)
        for (unsigned along = 0; along < 3; along++) {
            struct room room = {.texels_per_metre = 8, .sky = 2};
            struct room_solution solution;
            const struct lw_vec3 axis[3] = {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}};
            room_quad(&room, lw_vec3(-1, -1, -1), axis[along], axis[(along + 1) % 3], 0.5f, 0);
            room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 2, .tracing_range_m = ranges[i]},
                       4);
            const struct sum sum = sum_of(&solution, 2 * acos(-1.0));
            assert_true(sum.count >= 14 * 14 && sum.indirect == 0);
            if (sum.worst > 1e-4) fail_msg("off by %g", sum.worst);
            room_finish(&solution);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_no_light_at_all),
        cmocka_unit_test(test_a_million_lights_of_no_power),
        cmocka_unit_test(test_a_texel_for_everything),
        cmocka_unit_test(test_charts_a_texel_wide),
        cmocka_unit_test(test_flat_scenes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
