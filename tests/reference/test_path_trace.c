/* test_path_trace.c: the path tracer against closed forms. Tolerances come from the spread over seeds: pixels
 * of a picture share random numbers, pictures of different seeds do not. */
#include "common/base/colour.h"
#include "tests/reference/effort.h"
#include "tests/reference/path_case.h"
#include "tests/reference/room.h"

static void expect_mean(struct path_case_mean got, double want) {
    if (!(fabs(got.value - want) <= SIGMA * got.error + FLAT * fabs(want)))
        fail_msg("got %.7g +- %.2g, expected %.7g", got.value, got.error, want);
}

/* ---- furnaces ---- */

static void test_furnace_partial_sums(void **state) {
    (void)state;
    const double albedo[] = {0, 0.2, 0.5, 0.9};
    const uint32_t bounces[] = {0, 1, 3, 12};
    for (int a = 0; a < 4; a++) {
        struct room room = {0};
        struct path_case_set set;
        room_box(&room, lw_vec3(2, 1, 3), (float)albedo[a], 1.5f);
        path_case_set_up(&set, room_scene(&room), 2);
        for (int b = 0; b < 4; b++) {
            double want = 0;
            for (uint32_t k = 0; k <= bounces[b] + 1; k++) want += 1.5 * pow((double)(float)albedo[a], k);
            struct lw_path_view view =
                path_case_view_of(lw_vec3(1, 0.5f, 1.5f), lw_vec3(0.3f, 0.1f, 0), 100, bounces[b]);
            expect_mean(path_case_mean_of(&set, view, 16, 4), want);
            /* Every ray meets the same light, whatever its direction: nothing is random. */
            view.method = LW_PATH_METHOD_BOUNCE;
            struct path_case_mean certain = path_case_mean_of(&set, view, 16, 2);
            assert_true(certain.error <= FLAT * want);
            expect_mean(certain, want);
        }
        path_case_tear_down(&set);
    }
}

/* A square of 2 m takes a quarter of an orthographic picture of 4 m, however far it is. */
static void test_parallel(void **state) {
    (void)state;
    for (int far = 0; far < 3; far++) {
        struct room room = {0};
        struct path_case_set set;
        room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0, 1.5f);
        path_case_set_up(&set, room_scene(&room), 1);
        struct lw_path_view view =
            path_case_view_of(lw_vec3(0, powf(10, (float)far), 0), lw_vec3(0, 0, 0), 60, 0);
        view.camera.height_m = 4;
        view.pixel = LW_PATH_PIXEL_CENTRE;
        expect_mean(path_case_mean_of(&set, view, 16, 1), 1.5 / 4);
        path_case_tear_down(&set);
    }
}

/* ---- lamps over a floor ---- */

static struct room floor_room(void) {
    struct room room = {0};
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0.5f, 0);
    return room;
}

/* Each pixel is albedo / pi E at its centre. */
static void expect_floor(const struct room *room, double (*e)(double x, double z), double tolerance) {
    enum { SIDE = 33 };
    struct path_case_set set;
    struct lw_path_view view = path_case_floor_view();
    path_case_set_up(&set, room_scene(room), 2);
    struct lw_path_film film = path_case_render(&set, &view, SIDE, SIDE, 4);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        /* `up` of a camera that looks down is +-Z, which mirrors nothing here: the lamps are on the axis. */
        double x = (i % SIDE + 0.5) * 2 / SIDE - 1, z = (i / SIDE + 0.5) * 2 / SIDE - 1;
        double want = 0.5 / acos(-1.0) * e(x, z),
               got = ((double)film.half[0][3 * i] + (double)film.half[1][3 * i]) / 4;
        if (!(fabs(got - want) <= tolerance * want + 1e-5 * e(0, 0)))
            fail_msg("at (%.3f, %.3f): %.7g, expected %.7g", x, z, got, want);
    }
    lw_path_film_finish(&film);
    path_case_tear_down(&set);
}

static double point_e(double x, double z) {
    double d2 = x * x + z * z + 1.5 * 1.5;
    return 10 * 1.5 / (d2 * sqrt(d2)); /* I cos / d^2 */
}
static double spot_e(double x, double z) {
    double d2 = x * x + z * z + 1.5 * 1.5, cosine = 1.5 / sqrt(d2);
    double s = (cosine - cos(0.5)) / (cos(0.2) - cos(0.5));
    s = s < 0 ? 0 : s > 1 ? 1 : s;
    return 10 * cosine / d2 * s * s;
}
static double sun_e(double x, double z) {
    (void)x, (void)z;
    return 1000;
}
static double sky_e(double x, double z) {
    (void)x, (void)z;
    return 2 * acos(-1.0);
}

static struct lw_light point_light(void) {
    return (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {10, 10, 10}};
}
static struct lw_light spot_light(void) {
    return (struct lw_light){
        .kind = LW_LIGHT_SPOT, .intensity = {10, 10, 10}, .inner_cone = 0.2f, .outer_cone = 0.5f};
}
static struct lw_light sun_light(void) {
    return (struct lw_light){
        .kind = LW_LIGHT_DIRECTIONAL, .intensity = {1000, 1000, 1000}, .angular_diameter = 0.0093f};
}

static void add_light(struct room *room, struct lw_light light) {
    room->light[room->light_count] = light;
    room->light_position[room->light_count++] = lw_vec3(0, 1.5f, 0);
}

static void test_point(void **state) {
    (void)state;
    struct room room = floor_room();
    add_light(&room, point_light());
    expect_floor(&room, point_e, 1e-4);
}

static void test_spot(void **state) {
    (void)state;
    struct room room = floor_room();
    add_light(&room, spot_light());
    expect_floor(&room, spot_e, 2e-4);
}

static void test_sun(void **state) {
    (void)state;
    struct room room = floor_room();
    add_light(&room, sun_light());
    expect_floor(&room, sun_e, 3e-5); /* the mean cosine over the disc is 1 - 5e-6 */
}

static void test_sky(void **state) {
    (void)state;
    struct room room = floor_room();
    room.sky = 2;
    expect_floor(&room, sky_e, 1e-5);
}

/* By one sample of all lights, or by one of each. */
static double mean_floor_by(const struct room *room, bool all_lights, struct path_case_mean *out,
                            uint32_t samples) {
    struct path_case_set set;
    path_case_set_up(&set, room_scene(room), 2);
    struct lw_path_view view = path_case_floor_view();
    view.pixel = LW_PATH_PIXEL_BOX;
    view.all_lights = all_lights;
    *out = path_case_mean_of(&set, view, 24, samples);
    path_case_tear_down(&set);
    return out->value;
}

static double mean_floor(const struct room *room, struct path_case_mean *out, uint32_t samples) {
    return mean_floor_by(room, false, out, samples);
}

/* Light is linear, however the one that is asked is chosen. */
static void test_all_lamps_together(void **state) {
    (void)state;
    double want = 0, variance = 0; /* variance: want's */
    struct lw_light lamp[3] = {point_light(), spot_light(), sun_light()};
    for (int c = 0; c < 3; c++) lamp[2].intensity[c] = 2;
    struct room all = floor_room();
    struct path_case_mean mean;
    for (int i = 0; i < 3; i++) {
        struct room one = floor_room();
        add_light(&one, lamp[i]);
        add_light(&all, lamp[i]);
        want += mean_floor(&one, &mean, 16);
        variance += mean.error * mean.error;
    }
    all.sky = 0.5f;
    want += 0.5 * 0.5; /* albedo times its radiance */
    for (int all_lights = 0; all_lights < 2; all_lights++) {
        mean_floor_by(&all, all_lights, &mean, 64);
        assert_true(mean.error < 0.01 * want);
        mean.error = sqrt(mean.error * mean.error + variance);
        expect_mean(mean, want);
    }
}

/* A floor that a mirroring, shearing, stretching transform has put there is the same floor. */
static void test_transforms(void **state) {
    (void)state;
    struct room room = floor_room();
    room.quad[0].corner = lw_vec3(-1.5f, 0, -0.5f); /* x' = -2 x - 4 z - 6, y' = 3 y, z' = 2 z */
    room.quad[0].edge_u = lw_vec3(-1, 0, 0);
    room.quad[0].edge_v = lw_vec3(-2, 0, 1);
    add_light(&room, point_light());
    struct lw_scene *scene = room_scene(&room);
    scene->node[0].has_matrix = true;
    scene->node[0].matrix = (struct lw_affine){{{-2, 0, -4, -6}, {0, 3, 0, 0}, {0, 0, 2, 0}}};
    struct path_case_set set;
    path_case_set_up(&set, scene, 1);
    struct lw_vec3 low, high;
    assert_true(lw_pose_bounds(&set.world.pose, scene, &low, &high));
    assert_float_equal(high.x - low.x, 2, 1e-6);
    struct lw_path_view view = path_case_floor_view();
    struct lw_path_film film = path_case_render(&set, &view, 1, 1, 2);
    expect_near((double)film.half[0][0], 0.5 / acos(-1.0) * point_e(0, 0), 1e-4);
    lw_path_film_finish(&film);
    path_case_tear_down(&set);
}

/* ---- form factors ---- */

static void test_parallel_squares(void **state) {
    (void)state;
    /* Unit squares at distance 1: F = 0.199825 (Howell, configuration factor C-11). The camera looks through
     * the lamp's back, which is not there for it, at just the square below. */
    struct room room = {0};
    room_quad(&room, lw_vec3(0, 1, 0), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, 3);
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
    struct path_case_set set;
    path_case_set_up(&set, room_scene(&room), 2);
    struct lw_path_view view = path_case_view_of(lw_vec3(0.5f, 4, 0.5f), lw_vec3(0.5f, 0, 0.5f), 0, 0);
    view.camera.fov_y = 2 * atanf(0.125f);
    for (int method = 0; method < 3; method++) {
        view.method = (enum lw_path_method)method;
        struct path_case_mean mean = path_case_mean_of(&set, view, 24, 64);
        assert_true(mean.error < 0.01 * mean.value);
        expect_mean(mean, 0.5 * 0.199825 * 3);
    }
    path_case_tear_down(&set);
}

static void test_perpendicular_squares(void **state) {
    (void)state;
    /* Unit squares with a common edge: F = 0.200044 (Howell, C-14); E is singular along the edge. */
    struct room room = {0};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0), 0, 3); /* facing +Z */
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
    struct path_case_set set;
    path_case_set_up(&set, room_scene(&room), 2);
    struct lw_path_view view = path_case_view_of(lw_vec3(0.5f, 40, 0.5f), lw_vec3(0.5f, 0, 0.5f), 0, 0);
    view.camera.fov_y = 2 * atanf(0.0125f); /* from high above: the wall's edge hides nothing */
    struct path_case_mean mean = path_case_mean_of(&set, view, 24, 64);
    assert_true(mean.error < 0.01 * mean.value);
    expect_mean(mean, 0.5 * 0.200044 * 3);
    path_case_tear_down(&set);
}

/* ---- alpha and sides ---- */

/* Looks along -Z from 5 m, the middle of a quad at each depth filling the view. */
static void add_pane(struct room *room, float z, float emission, uint8_t alpha_mode, float alpha) {
    room_quad(room, lw_vec3(-3.1f, -2.7f, z), lw_vec3(6, 0, 0), lw_vec3(0, 6, 0), 0, emission);
    room->quad[room->quad_count - 1].alpha_mode = alpha_mode;
    room->quad[room->quad_count - 1].alpha = alpha;
}

static void expect_seen(const struct room *room, double want, double tolerance) {
    struct path_case_set set;
    path_case_set_up(&set, room_scene(room), 1);
    struct path_case_mean mean =
        path_case_mean_of(&set, path_case_view_of(lw_vec3(0, 0, 5), lw_vec3(0, 0, 0), 10, 0), 8, 64);
    expect_mean(mean, want);
    assert_true(mean.error <= tolerance * want);
    path_case_tear_down(&set);
}

static void test_blend_is_seen_front_to_back(void **state) {
    (void)state;
    struct room room = {0};
    add_pane(&room, 0, 1, LW_ALPHA_OPAQUE, 1);
    add_pane(&room, 1, 8, LW_ALPHA_BLEND, 0.5f);
    add_pane(&room, 2, 4, LW_ALPHA_BLEND, 0.25f);
    add_pane(&room, 3, 100, LW_ALPHA_MASK, 0.25f); /* cut out under 0.5 */
    expect_seen(&room, 0.25 * 4 + 0.75 * (0.5 * 8 + 0.5 * 1), 0.002);
    /* behind the last layer that counts there is nothing */
    struct room many = {0};
    add_pane(&many, -9, 1000, LW_ALPHA_OPAQUE, 1);
    for (unsigned i = 0; i < 15; i++) add_pane(&many, (float)i * 0.1f, 0, LW_ALPHA_BLEND, 0.0f);
    expect_seen(&many, 1000, 1e-5);
}

static void test_backs_are_not_there_for_the_eye(void **state) {
    (void)state;
    struct room room = {.sky = 7};
    room_quad(&room, lw_vec3(-3, -3, 0), lw_vec3(0, 6, 0), lw_vec3(6, 0, 0), 0.5f, 1); /* facing -Z */
    expect_seen(&room, 7, 1e-5);
    room.quad[0].double_sided = true; /* now it shines and reflects to both sides */
    expect_seen(&room, 1 + 0.5 * 7, 1e-3);
}

static void test_backs_are_black_for_light(void **state) {
    (void)state;
    struct room room = floor_room();
    room.sky = 1;
    struct path_case_mean open, closed;
    mean_floor(&room, &open, 4);
    expect_mean(open, 0.5);
    /* a roof that shows its back to the floor, wide enough to leave 1e-5 of the sky */
    room_quad(&room, lw_vec3(-2000, 5, -2000), lw_vec3(0, 0, 4000), lw_vec3(4000, 0, 0), 0.9f, 5);
    assert_true(mean_floor(&room, &closed, 16) < 0.001);
}

static void test_panes_pass_their_share(void **state) {
    (void)state;
    for (unsigned panes = 0; panes <= 2; panes++) {
        struct room room = floor_room();
        add_light(&room, sun_light());
        for (unsigned i = 0; i < panes; i++) {
            /* off centre: a ray through the edge that two triangles share may meet both */
            room_quad(&room, lw_vec3(-40.3f, 0.5f + 0.2f * (float)i, -4.1f), lw_vec3(44, 0, 0),
                      lw_vec3(0, 0, 8), 0, 0); /* facing down: not there for the eye */
            room.quad[1 + i].alpha_mode = LW_ALPHA_BLEND;
            room.quad[1 + i].alpha = 0.5f;
        }
        for (int all_lights = 0; all_lights < 2; all_lights++) {
            struct path_case_mean mean;
            mean_floor_by(&room, all_lights, &mean, 16);
            expect_mean(mean, 0.5 / acos(-1.0) * 1000 * pow(0.5, panes));
            assert_true(mean.error < 0.01 * mean.value);
        }
    }
}

/* Each sample of a light that always lies in one direction meets a decision of its own at a pane. */
static void test_samples_meet_panes_apart(void **state) {
    (void)state;
    enum { SIDE = 24 };
    struct room room = floor_room();
    add_light(&room, point_light());
    room_quad(&room, lw_vec3(-40.3f, 0.5f, -4.1f), lw_vec3(44, 0, 0), lw_vec3(0, 0, 8), 0, 0);
    room.quad[1].alpha_mode = LW_ALPHA_BLEND;
    room.quad[1].alpha = 0.5f;
    for (int all_lights = 0; all_lights < 2; all_lights++) {
        struct path_case_set set;
        path_case_set_up(&set, room_scene(&room), 2);
        struct lw_path_view view = path_case_floor_view();
        view.all_lights = all_lights;
        struct lw_path_film film = path_case_render(&set, &view, SIDE, SIDE, 2);
        unsigned differ = 0;
        for (int i = 0; i < SIDE * SIDE; i++) differ += film.half[0][3 * i] != film.half[1][3 * i];
        assert_true(differ > SIDE * SIDE / 4 && differ < SIDE * SIDE * 3 / 4); /* a half, within many sigma */
        lw_path_film_finish(&film);
        path_case_tear_down(&set);
    }
}

static void test_a_transparent_lamp_shines_its_share(void **state) {
    (void)state;
    for (int method = 0; method < 3; method++) {
        double whole = 0;
        for (int i = 0; i < 3; i++) {
            struct room room = {0};
            room_quad(&room, lw_vec3(0, 1, 0), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, 3);
            room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
            room.quad[0].alpha_mode = i == 1 ? LW_ALPHA_BLEND : i == 2 ? LW_ALPHA_MASK : LW_ALPHA_OPAQUE;
            room.quad[0].alpha = 0.25f;
            struct path_case_set set;
            path_case_set_up(&set, room_scene(&room), 2);
            struct lw_path_view view =
                path_case_view_of(lw_vec3(0.5f, 4, 0.5f), lw_vec3(0.5f, 0, 0.5f), 0, 0);
            view.camera.fov_y = 2 * atanf(0.125f);
            view.method = (enum lw_path_method)method;
            struct path_case_mean mean = path_case_mean_of(&set, view, 24, 32 * effort);
            if (i == 0) whole = mean.value;
            if (i == 1) expect_near(mean.value, 0.25 * whole, noise(0.042)); /* 3 sigma of either */
            if (i == 2) assert_true(mean.value == 0);
            path_case_tear_down(&set);
        }
    }
}

int main(int argc, char **argv) {
    (void)argv;
    set_effort(argc);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_parallel),
        cmocka_unit_test(test_furnace_partial_sums),
        cmocka_unit_test(test_point),
        cmocka_unit_test(test_spot),
        cmocka_unit_test(test_sun),
        cmocka_unit_test(test_sky),
        cmocka_unit_test(test_all_lamps_together),
        cmocka_unit_test(test_transforms),
        cmocka_unit_test(test_parallel_squares),
        cmocka_unit_test(test_perpendicular_squares),
        cmocka_unit_test(test_blend_is_seen_front_to_back),
        cmocka_unit_test(test_backs_are_not_there_for_the_eye),
        cmocka_unit_test(test_backs_are_black_for_light),
        cmocka_unit_test(test_panes_pass_their_share),
        cmocka_unit_test(test_samples_meet_panes_apart),
        cmocka_unit_test(test_a_transparent_lamp_shines_its_share),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
