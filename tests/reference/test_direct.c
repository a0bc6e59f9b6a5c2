/* Direct light against closed forms: point, spot, sun, sky, and the form factors of squares. */
#include "tests/reference/room.h"

#include <math.h>

static const struct lw_vec3 up_corner = {-1, 0, -1}, edge_x = {2, 0, 0}, edge_z = {0, 0, 2};

/* A floor of 2 m x 2 m about the origin, facing up. */
static struct room floor_room(void) {
    struct room room = {.texels_per_metre = 16};
    room_quad(&room, up_corner, edge_z, edge_x, 0.5f, 0);
    return room;
}

struct expectation {
    double (*value)(struct lw_vec3 p);
    double tolerance, floor; /* relative; absolute */
    unsigned count;
};

static void expect_texel(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)area;
    struct expectation *e = user;
    double want = e->value(p);
    if (fabs(direct - want) > e->tolerance * want + e->floor)
        fail_msg("E at (%g, %g, %g) is %.6g, expected %.6g", (double)p.x, (double)p.y, (double)p.z, direct,
                 want);
    assert_true(indirect == 0);
    e->count++;
}

static void expect_floor(const struct room *room, unsigned samples, unsigned frames,
                         double (*value)(struct lw_vec3), double tolerance) {
    struct room_solution solution;
    struct expectation expectation = {
        .value = value, .tolerance = tolerance, .floor = 1e-5 * value(lw_vec3(0, 0, 0))};
    room_solve(&solution, room, (struct lw_solver_desc){.direct_samples = samples}, frames);
    room_each_texel(&solution, 0, expect_texel, &expectation);
    assert_true(expectation.count >= 32 * 32);
    room_finish(&solution);
}

static double point_value(struct lw_vec3 p) {
    double d2 = (double)(p.x * p.x + p.z * p.z) + 1.5 * 1.5;
    return 10 * 1.5 / (d2 * sqrt(d2)); /* I cos / d^2 */
}

static void test_point(void **state) {
    (void)state;
    struct room room = floor_room();
    room.light[room.light_count] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {10, 10, 10}};
    room.light_position[room.light_count++] = lw_vec3(0, 1.5f, 0);
    expect_floor(&room, 1, 1, point_value, 1e-4);
}

static double spot_value(struct lw_vec3 p) {
    double d2 = (double)(p.x * p.x + p.z * p.z) + 1.5 * 1.5, cosine = 1.5 / sqrt(d2);
    double s = (cosine - cos(0.5)) / (cos(0.2) - cos(0.5));
    s = s < 0 ? 0 : s > 1 ? 1 : s;
    return 10 * cosine / d2 * s * s;
}

static void test_spot(void **state) {
    (void)state;
    struct room room = floor_room();
    room.light[room.light_count] = (struct lw_light){
        .kind = LW_LIGHT_SPOT, .intensity = {10, 10, 10}, .inner_cone = 0.2f, .outer_cone = 0.5f};
    room.light_position[room.light_count++] = lw_vec3(0, 1.5f, 0);
    expect_floor(&room, 1, 1, spot_value, 2e-4);
}

static double sun_value(struct lw_vec3 p) {
    (void)p;
    return 1000;
}

static void test_sun(void **state) {
    (void)state;
    struct room room = floor_room();
    room.light[room.light_count++] = (struct lw_light){
        .kind = LW_LIGHT_DIRECTIONAL, .intensity = {1000, 1000, 1000}, .angular_diameter = 0.0093f};
    /* The mean cosine over the sun's disc is 1 - 5e-6. */
    expect_floor(&room, 1, 4, sun_value, 2e-5);
}

static double sky_value(struct lw_vec3 p) {
    (void)p;
    return 2 * acos(-1.0);
}

static void test_sky(void **state) {
    (void)state;
    struct room room = floor_room();
    room.sky = 2;
    expect_floor(&room, 1, 1, sky_value, 1e-5); /* cosine-weighted: no variance */
}

/* Mean E on `object` from the emissive quad 0, with its tolerance k sigma / sqrt(n) from the spread of frames. */
static double mean_from_emitter(const struct room *room) {
    struct room_solution solution;
    room_solve(&solution, room, (struct lw_solver_desc){.direct_samples = 4}, 64);
    double mean = room_object_mean(&solution, 1).direct;
    room_finish(&solution);
    return mean;
}

static void test_parallel_squares(void **state) {
    (void)state;
    /* Unit squares at distance 1: F = 0.199825 (Howell, configuration factor C-11). */
    struct room room = {.texels_per_metre = 64};
    room_quad(&room, lw_vec3(0, 1, 0), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, 3); /* facing down */
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0, 0); /* facing up */
    double want = 0.199825 * 3 * acos(-1.0);
    /* 64 texels a side put the rim's texels half a texel inside: an error of about (1/64)^2. */
    expect_near(mean_from_emitter(&room), want, 0.003);
}

static void test_perpendicular_squares(void **state) {
    (void)state;
    /* Unit squares with a common edge: F = 0.200044 (Howell, C-14). E is singular along the edge. */
    struct room room = {.texels_per_metre = 64};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0), 0, 3); /* facing +Z */
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0, 0); /* facing up */
    double want = 0.200044 * 3 * acos(-1.0);
    expect_near(mean_from_emitter(&room), want, 0.01);
}

static void test_emitter_shines_forward_only(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 16};
    room_quad(&room, lw_vec3(0, 1, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0, 3); /* facing up, away */
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0, 0);
    assert_true(mean_from_emitter(&room) == 0);
    room.quad[0].double_sided = true;
    assert_true(mean_from_emitter(&room) > 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_point),
        cmocka_unit_test(test_spot),
        cmocka_unit_test(test_sun),
        cmocka_unit_test(test_sky),
        cmocka_unit_test(test_parallel_squares),
        cmocka_unit_test(test_perpendicular_squares),
        cmocka_unit_test(test_emitter_shines_forward_only),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
