/* Direct light against closed forms: point, spot, sun, sky, and the form factors of squares. */
#include "common/light/lights.h"
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

/* The mean of a value over a texel of the floor, 1/16 m square. */
static double texel_mean(double (*value)(struct lw_vec3), struct lw_vec3 centre) {
    double sum = 0;
    for (int i = 0; i < 16; i++)
        for (int j = 0; j < 16; j++)
            sum += value(
                lw_vec3(centre.x + ((float)i - 7.5f) / 256, centre.y, centre.z + ((float)j - 7.5f) / 256));
    return sum / 256;
}

static void expect_texel(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    struct expectation *e = user;
    assert_true(indirect == 0);
    if (area < 0.999) return;
    double want = texel_mean(e->value, p);
    if (fabs(direct - want) > e->tolerance * want + e->floor)
        fail_msg("E at (%g, %g, %g) is %.6g, expected %.6g", (double)p.x, (double)p.y, (double)p.z, direct,
                 want);
    e->count++;
}

static void expect_floor(const struct room *room, unsigned samples, unsigned frames,
                         double (*value)(struct lw_vec3), double tolerance, double floor) {
    struct room_solution solution;
    struct expectation expectation = {
        .value = value, .tolerance = tolerance, .floor = floor * value(lw_vec3(0, 0, 0))};
    room_solve(&solution, room, (struct lw_solver_desc){.direct_samples = samples}, frames);
    room_each_texel(&solution, 0, expect_texel, &expectation);
    assert_true(expectation.count >= 31 * 31);
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
    expect_floor(&room, 1, 8, point_value, 1e-4, 1e-5);
}

/* A hundred over the floor and around it, some weak, some near. */
static struct lw_vec3 lamp_at(unsigned i) {
    return lw_vec3(0.4f * (float)(i % 10) - 1.8f, 0.5f + 0.15f * (float)(i % 7),
                   0.4f * (float)(i / 10) - 1.8f);
}
static float lamp_power(unsigned i) { return 0.1f + (float)(i * i % 11); }

static double lamps_value(struct lw_vec3 p) {
    double sum = 0;
    for (unsigned i = 0; i < 100; i++) {
        const struct lw_vec3 to = lw_vec3_sub(lamp_at(i), p);
        const double d2 = (double)lw_vec3_dot(to, to);
        sum += (double)lamp_power(i) * (double)to.y / (d2 * sqrt(d2));
    }
    return sum;
}

static double floor_mean(double (*value)(struct lw_vec3)) {
    double sum = 0;
    for (int i = 0; i < 256; i++)
        for (int j = 0; j < 256; j++)
            sum += value(lw_vec3(((float)i + 0.5f) / 128 - 1, 0, ((float)j + 0.5f) / 128 - 1));
    return sum / (256.0 * 256.0);
}

/* Groups stand for all points (light_tree.h): the result equals a ray for each, within the noise of the
 * choice in a group. */
static void test_many_points(void **state) {
    (void)state;
    struct room room = floor_room();
    struct room_solution solution;
    for (unsigned i = 0; i < 100; i++) {
        const float power = lamp_power(i);
        room.light[i] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {power, power, power}};
        room.light_position[i] = lamp_at(i);
    }
    room.light_count = 100;
    room_solve(&solution, &room, (struct lw_solver_desc){0}, 16);
    /* under a third of a ray in the light is of a choice: 1024 texels x 16 frames x 32 groups, sigma of the
     * mean 0.05 % */
    expect_near(room_object_mean(&solution, 0).direct, floor_mean(lamps_value), 0.002);
    /* a ray for each of a hundred would be 1024 x 16 x 100 */
    assert_true(solution.rays <= 1024ul * 16 * LW_LIGHTS_EXACT_MAX);
    room_finish(&solution);
    expect_floor(&room, 1, 256, lamps_value, 0.02, 0.002);
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
    /* eight places resolve the cone's rim, where its curve has a kink, to this */
    expect_floor(&room, 1, 8, spot_value, 1e-3, 2e-3);
}

/* The cosines of this cone differ by 5e-5, some hundred roundings of a float. */
static double searchlight_value(struct lw_vec3 p) {
    double d2 = (double)(p.x * p.x + p.z * p.z) + 150.0 * 150, cosine = 150 / sqrt(d2);
    double s = (cosine - cos(0.01)) / (1 - cos(0.01));
    return 1e5 * cosine / d2 * s * s;
}

static void test_searchlight(void **state) {
    (void)state;
    struct room room = floor_room();
    room.light[room.light_count] =
        (struct lw_light){.kind = LW_LIGHT_SPOT, .intensity = {1e5f, 1e5f, 1e5f}, .outer_cone = 0.01f};
    room.light_position[room.light_count++] = lw_vec3(0, 150, 0);
    expect_floor(&room, 1, 8, searchlight_value, 3e-3, 1e-3);
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
    expect_floor(&room, 1, 4, sun_value, 2e-5, 1e-5);
    room.light[0].angular_diameter = 1; /* a disc that fills much of the sky gives what it says, too */
    expect_floor(&room, 1, 4, sun_value, 2e-5, 1e-5);
}

static double sky_value(struct lw_vec3 p) {
    (void)p;
    return 2 * acos(-1.0);
}

static void test_sky(void **state) {
    (void)state;
    struct room room = floor_room();
    room.sky = 2;
    expect_floor(&room, 1, 1, sky_value, 1e-5, 1e-5); /* cosine-weighted: no variance */
}

/* Environments over a floor that faces up. E = integral of L cos over the upper half. */
enum { ENVIRONMENT_WIDTH = 64, ENVIRONMENT_HEIGHT = 32 };
static float environment_texels[ENVIRONMENT_WIDTH * ENVIRONMENT_HEIGHT * 3];

static struct room environment_room(float (*radiance)(int x, int y)) {
    struct room room = floor_room();
    for (int y = 0; y < ENVIRONMENT_HEIGHT; y++)
        for (int x = 0; x < ENVIRONMENT_WIDTH; x++)
            for (int c = 0; c < 3; c++)
                environment_texels[3 * (y * ENVIRONMENT_WIDTH + x) + c] = radiance(x, y);
    room.environment = (struct lw_environment){
        .width = ENVIRONMENT_WIDTH, .height = ENVIRONMENT_HEIGHT, .rgb = environment_texels};
    return room;
}

/* Every texel within 5 sigma of one, and the mean within 5 sigma of 1024 independent ones. */
static void expect_environment(const struct room *room, unsigned samples, unsigned frames,
                               double (*value)(struct lw_vec3), double sigma) {
    struct room_solution solution;
    struct expectation expectation = {.value = value, .tolerance = 5 * sigma};
    room_solve(&solution, room, (struct lw_solver_desc){.direct_samples = samples}, frames);
    room_each_texel(&solution, 0, expect_texel, &expectation);
    assert_true(expectation.count >= 32 * 32);
    expect_near(room_object_mean(&solution, 0).direct, value(lw_vec3(0, 0, 0)), 5 * sigma / 32);
    room_finish(&solution);
}

static float even_radiance(int x, int y) {
    (void)x, (void)y;
    return 1.25f;
}

/* With 0.75 of sky it is the same as a sky of 2, and has no more noise. */
static void test_even_environment(void **state) {
    (void)state;
    struct room room = environment_room(even_radiance);
    room.sky = 0.75f;
    expect_floor(&room, 1, 1, sky_value, 1e-5, 1e-5);
}

static float half_radiance(int x, int y) {
    (void)y;
    return x >= ENVIRONMENT_WIDTH / 4 && x < 3 * ENVIRONMENT_WIDTH / 4 ? 4.0f : 0.0f;
}

/* All that lies towards +X is white: half of pi L, 4 / 2 = 2. */
static void test_half_an_environment(void **state) {
    (void)state;
    struct room room = environment_room(half_radiance);
    /* 256 samples of on and off, about half each: sigma 1 / 16 */
    expect_environment(&room, 4, 64, sky_value, 1.0 / 16);
}

static float gradient_radiance(int x, int y) {
    (void)x;
    return 6 * (1 - ((float)y + 0.5f) / ENVIRONMENT_HEIGHT);
}

static double gradient_value(struct lw_vec3 p) {
    (void)p;
    return 6 * acos(-1.0) * 0.75; /* 2 pi a integral (1 - t / pi) cos t sin t dt over 0..pi/2 = 3/4 pi a */
}

static void test_gradient_environment(void **state) {
    (void)state;
    struct room room = environment_room(gradient_radiance);
    /* L cos / p has a spread of 0.15 about its mean */
    expect_environment(&room, 4, 64, gradient_value, 0.15 / 16);
}

enum { SPOT_X = 11, SPOT_Y = 9 };
static float spot_radiance(int x, int y) { return x == SPOT_X && y == SPOT_Y ? 1e6f : 0.01f; }

/* The look-up of one texel is a tent two texels wide: L times the integral of tent x cos sin, and the width
 * of a column. The same everywhere, and summed up once. */
static double spot_environment_value(struct lw_vec3 p) {
    static double value;
    (void)p;
    if (value > 0) return value;
    const double pi = acos(-1.0), step = pi / ENVIRONMENT_HEIGHT;
    double sum = 0;
    enum { STEPS = 1000 };
    for (int i = 0; i < STEPS; i++) {
        double off = ((i + 0.5) / STEPS) * 2 - 1, theta = (SPOT_Y + 0.5 + off) * step;
        sum += (1 - fabs(off)) * cos(theta) * sin(theta) * 2 * step / STEPS;
    }
    return value = 1e6 * sum * 2 * pi / ENVIRONMENT_WIDTH + 0.01 * pi;
}

/* A sun of 0.01 sr in the picture, a hundred million times brighter than the rest: half of the samples go
 * there, and find E / p of about 2 E; so 64 of them have sigma 1 / 8. Cosine-weighted ones alone would find
 * it in 2 of 1000, sigma 290 %. */
static void test_bright_spot(void **state) {
    (void)state;
    struct room room = environment_room(spot_radiance);
    expect_environment(&room, 1, 64, spot_environment_value, 1.0 / 8);
}

/* Mean E on `object` from the emissive quad 0, with its tolerance k sigma / sqrt(n) from the spread of
 * frames. */
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

/* Panes of alpha 0.5 between a lamp and the floor, each an object of its own. Off centre: a ray through the
 * edge that two triangles share may meet both. */
static void expect_through_panes(unsigned panes, double passes) {
    struct room room = floor_room();
    for (unsigned i = 0; i < panes; i++) {
        room_quad(&room, lw_vec3(-4.3f, 0.5f + 0.2f * (float)i, -4.1f), lw_vec3(0, 0, 8), lw_vec3(8, 0, 0), 0,
                  0);
        room.quad[1 + i].double_sided = true;
        room.quad[1 + i].alpha_mode = LW_ALPHA_BLEND;
        room.quad[1 + i].alpha = 0.5f;
    }
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL, .intensity = {100, 100, 100}};
    room.light_count = 1;
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){0}, 64);
    /* 32 x 32 texels of 64 choices each: sigma of the mean is 0.7 % for two panes */
    expect_near(room_object_mean(&solution, 0).direct, 100 * passes, 0.02);
    /* and no texel is lit or dark for good */
    struct lw_solver_tile tile;
    solution.solver->ops->read_tile(solution.solver, (lw_tile_id){0}, &tile);
    for (uint32_t i = 0; i < tile.width * tile.height; i++)
        assert_true(!tile.covered[i] || (tile.direct[0][i] > 0 && tile.direct[0][i] < 100));
    room_finish(&solution);
}

static void test_transparent_panes_pass_their_share(void **state) {
    (void)state;
    expect_through_panes(1, 0.5);
    expect_through_panes(2, 0.25);
}

static void test_a_lamp_that_is_cut_out_is_dark(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 16};
    room_quad(&room, lw_vec3(0, 1, 0), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, 3);
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0, 0);
    double whole = mean_from_emitter(&room);
    room.quad[0].alpha = 0.25f;
    room.quad[0].alpha_mode = LW_ALPHA_MASK;
    assert_true(mean_from_emitter(&room) == 0);
    room.quad[0].alpha_mode = LW_ALPHA_BLEND;
    expect_near(mean_from_emitter(&room), 0.25 * whole, 0.001);
}

/* A roof that is modelled from outside only shows its back to the floor; the lamp below it still lights the
 * floor. */
static void test_a_floor_under_a_one_sided_roof_is_lit(void **state) {
    (void)state;
    struct room room = floor_room();
    room_quad(&room, lw_vec3(-9, 2, -9), lw_vec3(0, 0, 18), lw_vec3(18, 0, 0), 0.5f, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {10, 10, 10}};
    room.light_position[0] = lw_vec3(0, 1.5f, 0);
    room.light_count = 1;
    expect_floor(&room, 1, 8, point_value, 1e-4, 1e-5);
}

static uint32_t covered_floor_texels(const struct room *room) {
    struct room_solution solution;
    uint32_t covered = 0;
    room_solve(&solution, room, (struct lw_solver_desc){0}, 1);
    for (uint32_t t = 0;
         t < solution.map.atlas[0]->level[0].tiles_x * solution.map.atlas[0]->level[0].tiles_y; t++) {
        struct lw_solver_tile tile;
        solution.solver->ops->read_tile(solution.solver, (lw_tile_id){t}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) covered += tile.covered[i];
    }
    room_finish(&solution);
    return covered;
}

/* How many of 64 texels a metre a box covers on a floor of 2 x 2 m; half_m: of its side. */
static uint32_t left_out_under_a_box(float half_m) {
    struct room room = floor_room();
    room.texels_per_metre = 64;
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {10, 10, 10}};
    room.light_position[0] = lw_vec3(0, 1.5f, 0);
    room.light_count = 1;
    uint32_t open = covered_floor_texels(&room);
    const float a = half_m; /* seen from outside, without a bottom */
    const struct lw_vec3 x = lw_vec3(2 * a, 0, 0), y = lw_vec3(0, 2 * a, 0), z = lw_vec3(0, 0, 2 * a);
    room_quad(&room, lw_vec3(-a, 2 * a, -a), z, x, 0.5f, 0);
    room_quad(&room, lw_vec3(-a, 0, -a), y, x, 0.5f, 0);
    room_quad(&room, lw_vec3(-a, 0, a), x, y, 0.5f, 0);
    room_quad(&room, lw_vec3(-a, 0, -a), z, y, 0.5f, 0);
    room_quad(&room, lw_vec3(a, 0, -a), y, z, 0.5f, 0);
    return open - covered_floor_texels(&room);
}

/* What stands on a floor leaves no dark rim: the texels under it are not solved, of something large those
 * that a look-up from beside it may read, and no texel beside it. */
static void test_texels_under_a_box_are_left_out(void **state) {
    (void)state;
    const uint32_t under_small = left_out_under_a_box(0.05f); /* 6.4 texels wide */
    assert_true(under_small >= 5 * 5 && under_small <= 7 * 7);
    const uint32_t under_large = left_out_under_a_box(0.5f), four_wide = 64 * 64 - 56 * 56;
    assert_true(under_large >= 0.8 * four_wide && under_large <= 65 * 65);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_point),
        cmocka_unit_test(test_many_points),
        cmocka_unit_test(test_spot),
        cmocka_unit_test(test_searchlight),
        cmocka_unit_test(test_sun),
        cmocka_unit_test(test_sky),
        cmocka_unit_test(test_even_environment),
        cmocka_unit_test(test_half_an_environment),
        cmocka_unit_test(test_gradient_environment),
        cmocka_unit_test(test_bright_spot),
        cmocka_unit_test(test_parallel_squares),
        cmocka_unit_test(test_perpendicular_squares),
        cmocka_unit_test(test_emitter_shines_forward_only),
        cmocka_unit_test(test_transparent_panes_pass_their_share),
        cmocka_unit_test(test_a_lamp_that_is_cut_out_is_dark),
        cmocka_unit_test(test_a_floor_under_a_one_sided_roof_is_lit),
        cmocka_unit_test(test_texels_under_a_box_are_left_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
