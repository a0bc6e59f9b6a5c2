/* The path tracer against closed forms. Tolerances come from the spread over seeds: pixels of a picture share
 * random numbers, pictures of different seeds do not. */
#include "client/measure/sides/path_world.h"
#include "common/base/colour.h"
#include "common/builtin/builtin.h"
#include "tests/reference/effort.h"
#include "tests/reference/room.h"

#include <string.h>

#define SEEDS 16
#define SIGMA 4.5  /* standard errors; of a thousand such comparisons none fails by chance */
#define FLAT  1e-5 /* what float sums may be off by where nothing is random */

/* A scene with everything that a render needs. */
struct set {
    struct lw_scene *scene;
    struct lw_path_world world;
};

static void set_up(struct set *set, struct lw_scene *scene, unsigned threads) {
    struct lw_error err = {0};
    set->scene = scene;
    lw_support_ok(lw_path_world_init(&set->world, scene, 0, threads, &err), &err);
}

static void tear_down(struct set *set) {
    lw_path_world_finish(&set->world);
    lw_scene_destroy(set->scene);
}

static struct lw_path_film render(const struct set *set, const struct lw_path_view *view, uint32_t width,
                                  uint32_t height, uint32_t samples) {
    struct lw_path_film film;
    struct lw_error err = {0};
    lw_support_ok(lw_path_film_init(&film, width, height, &err), &err);
    lw_path_trace_render(set->world.tracer, view, samples, &film, NULL);
    return film;
}

struct mean {
    double value, error; /* standard error */
};

/* Mean of the red channel of a square picture. */
static struct mean mean_of(const struct set *set, struct lw_path_view view, uint32_t side, uint32_t samples) {
    double sum = 0, squares = 0;
    for (uint32_t seed = 1; seed <= SEEDS; seed++) {
        view.seed = seed;
        struct lw_path_film film = render(set, &view, side, side, samples);
        double value = 0;
        for (uint32_t i = 0; i < side * side; i++)
            value += (double)film.half[0][3 * i] + (double)film.half[1][3 * i];
        value /= side * side * samples;
        sum += value, squares += value * value;
        lw_path_film_finish(&film);
    }
    double mean = sum / SEEDS;
    return (struct mean){mean, sqrt(fmax(0, squares / SEEDS - mean * mean) / (SEEDS - 1))};
}

static void expect_mean(struct mean got, double want) {
    if (!(fabs(got.value - want) <= SIGMA * got.error + FLAT * fabs(want)))
        fail_msg("got %.7g +- %.2g, expected %.7g", got.value, got.error, want);
}

static struct lw_path_view view_of(struct lw_vec3 from, struct lw_vec3 to, float fov_deg, uint32_t bounces) {
    return (struct lw_path_view){.camera = lw_camera_look_at(from, to, fov_deg * LW_PI / 180),
                                 .bounces = bounces};
}

/* ---- furnaces ---- */

static void test_furnace_partial_sums(void **state) {
    (void)state;
    const double albedo[] = {0, 0.2, 0.5, 0.9};
    const uint32_t bounces[] = {0, 1, 3, 12};
    for (int a = 0; a < 4; a++) {
        struct room room = {0};
        struct set set;
        room_box(&room, lw_vec3(2, 1, 3), (float)albedo[a], 1.5f);
        set_up(&set, room_scene(&room), 2);
        for (int b = 0; b < 4; b++) {
            double want = 0;
            for (uint32_t k = 0; k <= bounces[b] + 1; k++) want += 1.5 * pow((double)(float)albedo[a], k);
            struct lw_path_view view =
                view_of(lw_vec3(1, 0.5f, 1.5f), lw_vec3(0.3f, 0.1f, 0), 100, bounces[b]);
            expect_mean(mean_of(&set, view, 16, 4), want);
            /* Every ray meets the same light, whatever its direction: nothing is random. */
            view.method = LW_PATH_METHOD_BOUNCE;
            struct mean certain = mean_of(&set, view, 16, 2);
            assert_true(certain.error <= FLAT * want);
            expect_mean(certain, want);
        }
        tear_down(&set);
    }
}

/* A square of 2 m takes a quarter of an orthographic picture of 4 m, however far it is. */
static void test_parallel(void **state) {
    (void)state;
    for (int far = 0; far < 3; far++) {
        struct room room = {0};
        struct set set;
        room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0, 1.5f);
        set_up(&set, room_scene(&room), 1);
        struct lw_path_view view = view_of(lw_vec3(0, powf(10, (float)far), 0), lw_vec3(0, 0, 0), 60, 0);
        view.camera.height_m = 4;
        view.pixel = LW_PATH_PIXEL_CENTRE;
        expect_mean(mean_of(&set, view, 16, 1), 1.5 / 4);
        tear_down(&set);
    }
}

/* ---- lamps over a floor ---- */

static struct room floor_room(void) {
    struct room room = {0};
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0.5f, 0);
    return room;
}

/* Straight down: pixel (x, y) of `side` sees ((x + 0.5) * 2 / side - 1) and z
 * likewise, of a floor of 2 m x 2 m. */
static struct lw_path_view floor_view(void) {
    struct lw_path_view view = view_of(lw_vec3(0, 4, 0), lw_vec3(0, 0, 0), 0, 0);
    view.camera.fov_y = 2 * atanf(0.25f);
    view.pixel = LW_PATH_PIXEL_CENTRE;
    return view;
}

/* Each pixel is albedo / pi E at its centre. */
static void expect_floor(const struct room *room, double (*e)(double x, double z), double tolerance) {
    enum { SIDE = 33 };
    struct set set;
    struct lw_path_view view = floor_view();
    set_up(&set, room_scene(room), 2);
    struct lw_path_film film = render(&set, &view, SIDE, SIDE, 4);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        /* `up` of a camera that looks down is +-Z, which mirrors nothing here: the lamps are on the axis. */
        double x = (i % SIDE + 0.5) * 2 / SIDE - 1, z = (i / SIDE + 0.5) * 2 / SIDE - 1;
        double want = 0.5 / acos(-1.0) * e(x, z),
               got = ((double)film.half[0][3 * i] + (double)film.half[1][3 * i]) / 4;
        if (!(fabs(got - want) <= tolerance * want + 1e-5 * e(0, 0)))
            fail_msg("at (%.3f, %.3f): %.7g, expected %.7g", x, z, got, want);
    }
    lw_path_film_finish(&film);
    tear_down(&set);
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
static double mean_floor_by(const struct room *room, bool all_lights, struct mean *out, uint32_t samples) {
    struct set set;
    set_up(&set, room_scene(room), 2);
    struct lw_path_view view = floor_view();
    view.pixel = LW_PATH_PIXEL_BOX;
    view.all_lights = all_lights;
    *out = mean_of(&set, view, 24, samples);
    tear_down(&set);
    return out->value;
}

static double mean_floor(const struct room *room, struct mean *out, uint32_t samples) {
    return mean_floor_by(room, false, out, samples);
}

/* Light is linear, however the one that is asked is chosen. */
static void test_all_lamps_together(void **state) {
    (void)state;
    double want = 0, variance = 0; /* variance: want's */
    struct lw_light lamp[3] = {point_light(), spot_light(), sun_light()};
    for (int c = 0; c < 3; c++) lamp[2].intensity[c] = 2;
    struct room all = floor_room();
    struct mean mean;
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
    struct set set;
    set_up(&set, scene, 1);
    struct lw_vec3 low, high;
    assert_true(lw_pose_bounds(&set.world.pose, scene, &low, &high));
    assert_float_equal(high.x - low.x, 2, 1e-6);
    struct lw_path_view view = floor_view();
    struct lw_path_film film = render(&set, &view, 1, 1, 2);
    expect_near((double)film.half[0][0], 0.5 / acos(-1.0) * point_e(0, 0), 1e-4);
    lw_path_film_finish(&film);
    tear_down(&set);
}

/* ---- form factors ---- */

static void test_parallel_squares(void **state) {
    (void)state;
    /* Unit squares at distance 1: F = 0.199825 (Howell, configuration factor C-11). The camera looks through
     * the lamp's back, which is not there for it, at just the square below. */
    struct room room = {0};
    room_quad(&room, lw_vec3(0, 1, 0), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, 3);
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
    struct set set;
    set_up(&set, room_scene(&room), 2);
    struct lw_path_view view = view_of(lw_vec3(0.5f, 4, 0.5f), lw_vec3(0.5f, 0, 0.5f), 0, 0);
    view.camera.fov_y = 2 * atanf(0.125f);
    for (int method = 0; method < 3; method++) {
        view.method = (enum lw_path_method)method;
        struct mean mean = mean_of(&set, view, 24, 64);
        assert_true(mean.error < 0.01 * mean.value);
        expect_mean(mean, 0.5 * 0.199825 * 3);
    }
    tear_down(&set);
}

static void test_perpendicular_squares(void **state) {
    (void)state;
    /* Unit squares with a common edge: F = 0.200044 (Howell, C-14); E is singular along the edge. */
    struct room room = {0};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0), 0, 3); /* facing +Z */
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
    struct set set;
    set_up(&set, room_scene(&room), 2);
    struct lw_path_view view = view_of(lw_vec3(0.5f, 40, 0.5f), lw_vec3(0.5f, 0, 0.5f), 0, 0);
    view.camera.fov_y = 2 * atanf(0.0125f); /* from high above: the wall's edge hides nothing */
    struct mean mean = mean_of(&set, view, 24, 64);
    assert_true(mean.error < 0.01 * mean.value);
    expect_mean(mean, 0.5 * 0.200044 * 3);
    tear_down(&set);
}

/* ---- alpha and sides ---- */

/* Looks along -Z from 5 m, the middle of a quad at each depth filling the view. */
static void add_pane(struct room *room, float z, float emission, uint8_t alpha_mode, float alpha) {
    room_quad(room, lw_vec3(-3.1f, -2.7f, z), lw_vec3(6, 0, 0), lw_vec3(0, 6, 0), 0, emission);
    room->quad[room->quad_count - 1].alpha_mode = alpha_mode;
    room->quad[room->quad_count - 1].alpha = alpha;
}

static void expect_seen(const struct room *room, double want, double tolerance) {
    struct set set;
    set_up(&set, room_scene(room), 1);
    struct mean mean = mean_of(&set, view_of(lw_vec3(0, 0, 5), lw_vec3(0, 0, 0), 10, 0), 8, 64);
    expect_mean(mean, want);
    assert_true(mean.error <= tolerance * want);
    tear_down(&set);
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
    struct mean open, closed;
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
            struct mean mean;
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
        struct set set;
        set_up(&set, room_scene(&room), 2);
        struct lw_path_view view = floor_view();
        view.all_lights = all_lights;
        struct lw_path_film film = render(&set, &view, SIDE, SIDE, 2);
        unsigned differ = 0;
        for (int i = 0; i < SIDE * SIDE; i++) differ += film.half[0][3 * i] != film.half[1][3 * i];
        assert_true(differ > SIDE * SIDE / 4 && differ < SIDE * SIDE * 3 / 4); /* a half, within many sigma */
        lw_path_film_finish(&film);
        tear_down(&set);
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
            struct set set;
            set_up(&set, room_scene(&room), 2);
            struct lw_path_view view = view_of(lw_vec3(0.5f, 4, 0.5f), lw_vec3(0.5f, 0, 0.5f), 0, 0);
            view.camera.fov_y = 2 * atanf(0.125f);
            view.method = (enum lw_path_method)method;
            struct mean mean = mean_of(&set, view, 24, 32 * effort);
            if (i == 0) whole = mean.value;
            if (i == 1) expect_near(mean.value, 0.25 * whole, noise(0.042)); /* 3 sigma of either */
            if (i == 2) assert_true(mean.value == 0);
            tear_down(&set);
        }
    }
}

/* ---- the estimator ---- */

static void test_methods_agree(void **state) {
    (void)state;
    static const struct {
        enum lw_path_method method;
        enum lw_path_pattern pattern;
        bool all_lights;
    } way[] = {{LW_PATH_METHOD_BOTH, LW_PATH_PATTERN_SQUARE, false},
               {LW_PATH_METHOD_LAMPS, LW_PATH_PATTERN_SQUARE, false},
               {LW_PATH_METHOD_BOUNCE, LW_PATH_PATTERN_SQUARE, false},
               {LW_PATH_METHOD_BOTH, LW_PATH_PATTERN_INTERLEAVED, false},
               {LW_PATH_METHOD_BOTH, LW_PATH_PATTERN_SQUARE, true},
               {LW_PATH_METHOD_BOTH, LW_PATH_PATTERN_INTERLEAVED, true}};
    enum { WAYS = sizeof way / sizeof *way };
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    scene->sky[0] = 0.1f; /* through the open front */
    struct set set;
    set_up(&set, scene, 2);
    struct lw_path_view view = {.camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2};
    struct mean mean[WAYS];
    for (int w = 0; w < WAYS; w++) {
        view.method = way[w].method;
        view.pattern = way[w].pattern;
        view.all_lights = way[w].all_lights;
        mean[w] = mean_of(&set, view, 32, (view.method == LW_PATH_METHOD_BOUNCE ? 64 : 16) * effort);
        assert_true(mean[w].error < noise(0.014) * mean[w].value);
    }
    for (int a = 0; a < WAYS; a++)
        for (int b = 0; b < a; b++) {
            double both = sqrt(mean[a].error * mean[a].error + mean[b].error * mean[b].error);
            if (!(fabs(mean[a].value - mean[b].value) <= SIGMA * both))
                fail_msg("way %d: %.6g +- %.2g, way %d: %.6g +- %.2g", a, mean[a].value, mean[a].error, b,
                         mean[b].value, mean[b].error);
        }
    tear_down(&set);
}

/* What the eye sees shine and what lights shine on, and what bounces bring there, are all of the same paths'
 * light. Without all lights at first hits the bounce rays that look for lights there are others' too: means
 * agree, not pixels. */
static void test_parts_add_up(void **state) {
    (void)state;
    enum { SIDE = 48 };
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    scene->sky[0] = 0.1f;
    struct set set;
    set_up(&set, scene, 2);
    struct lw_path_view view = {
        .camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2, .all_lights = true};
    struct lw_path_film film[3];
    for (int part = 0; part < 3; part++) {
        view.part = (enum lw_path_part)part;
        film[part] = render(&set, &view, SIDE, SIDE, 2);
    }
    double indirect = 0;
    for (int i = 0; i < SIDE * SIDE * 3; i++) {
        const float all = film[LW_PATH_PART_ALL].half[0][i], direct = film[LW_PATH_PART_DIRECT].half[0][i],
                    rest = film[LW_PATH_PART_INDIRECT].half[0][i];
        assert_float_equal(direct + rest, all, 1e-5f * (1 + all));
        assert_true(direct >= 0 && rest >= 0);
        indirect += (double)rest;
    }
    assert_true(indirect > 0);
    for (int part = 0; part < 3; part++) lw_path_film_finish(&film[part]);

    view.all_lights = false;
    struct mean mean[3];
    for (int part = 0; part < 3; part++) {
        view.part = (enum lw_path_part)part;
        mean[part] = mean_of(&set, view, 32, 16 * effort);
    }
    const double sum = mean[LW_PATH_PART_DIRECT].value + mean[LW_PATH_PART_INDIRECT].value;
    const double error = sqrt(pow(mean[0].error, 2) + pow(mean[1].error, 2) + pow(mean[2].error, 2));
    if (!(fabs(sum - mean[LW_PATH_PART_ALL].value) <= SIGMA * error))
        fail_msg("direct and indirect: %.6g, all: %.6g +- %.2g", sum, mean[LW_PATH_PART_ALL].value, error);
    view.bounces = 0;
    view.part = LW_PATH_PART_INDIRECT;
    assert_true(mean_of(&set, view, 16, 2).value == 0);
    tear_down(&set);
}

/* One path a pixel: what it brings beyond its first hit, which is what no bounce leaves out, is within the
 * limit; values within it stay as they were. */
static void test_clamp(void **state) {
    (void)state;
    enum { SIDE = 64 };
    const float limit = 0.02f;
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    struct set set;
    set_up(&set, scene, 2);
    struct lw_path_view view = {
        .camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2, .all_lights = true};
    struct lw_path_film free = render(&set, &view, SIDE, SIDE, 1);
    view.clamp = limit;
    struct lw_path_film clamped = render(&set, &view, SIDE, SIDE, 1);
    view.clamp = 0;
    view.bounces = 0;
    struct lw_path_film near = render(&set, &view, SIDE, SIDE, 1);
    unsigned brighter = 0, dimmer = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        struct lw_vec3 far[2];
        for (int k = 0; k < 2; k++) {
            const float *rgb = (k ? clamped : free).half[0] + 3 * i, *first = near.half[0] + 3 * i;
            far[k] = lw_vec3(rgb[0] - first[0], rgb[1] - first[1], rgb[2] - first[2]);
        }
        const float before = lw_colour_luminance(far[0]), after = lw_colour_luminance(far[1]);
        /* differences of floats as large as the radiance */
        const float rounding = 4e-6f * (limit + lw_colour_luminance(lw_vec3(1, 1, 1)) * near.half[0][3 * i]);
        assert_float_equal(after, fminf(before, limit), rounding);
        *(before > limit ? &brighter : &dimmer) += 1;
    }
    assert_true(brighter > 100 && dimmer > 100);
    lw_path_film_finish(&near);
    lw_path_film_finish(&clamped);
    lw_path_film_finish(&free);
    tear_down(&set);
}

static void same_bytes(enum lw_path_pattern pattern, bool all_lights) {
    struct lw_path_film film[3];
    const size_t size = (size_t)150 * 70 * 3 * sizeof(float);
    for (unsigned i = 0; i < 3; i++) {
        struct lw_scene *scene;
        struct lw_error err = {0};
        lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
        struct set set;
        set_up(&set, scene, i + 1);
        struct lw_path_view view = {.camera = lw_camera_of_scene(scene, &set.world.pose, 0),
                                    .bounces = 3,
                                    .seed = 5,
                                    .pattern = pattern,
                                    .all_lights = all_lights,
                                    .clamp = all_lights ? 0.1f : 0};
        film[i] = render(&set, &view, 150, 70, i == 2 ? 1 : 7);
        if (i == 2) lw_path_trace_render(set.world.tracer, &view, 6, &film[i], NULL); /* in two calls */
        tear_down(&set);
    }
    for (int half = 0; half < 2; half++)
        for (int i = 1; i < 3; i++) assert_memory_equal(film[0].half[half], film[i].half[half], size);
    /* the halves are samples of the same, but not the same samples */
    assert_memory_not_equal(film[0].half[0], film[0].half[1], size);
    for (int i = 0; i < 3; i++) lw_path_film_finish(&film[i]);
}

static void test_a_cancelled_render_adds_no_sample(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    struct set set;
    set_up(&set, scene, 2);
    _Atomic bool cancel = false;
    struct lw_path_view view = {
        .camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 1, .seed = 5, .cancel = &cancel};
    struct lw_path_film film = render(&set, &view, 150, 70, 2);
    assert_int_equal(film.samples, 2);
    cancel = true;
    struct lw_path_count count = {0};
    assert_false(lw_path_trace_render(set.world.tracer, &view, 1, &film, &count));
    assert_int_equal(film.samples, 2);
    assert_true(count.paths == 0 && count.rays_primary == 0);
    cancel = false;
    assert_true(lw_path_trace_render(set.world.tracer, &view, 1, &film, &count));
    assert_int_equal(film.samples, 3);
    assert_int_equal(count.paths, 150 * 70);
    lw_path_film_finish(&film);
    tear_down(&set);
}

static void test_same_bytes(void **state) {
    (void)state;
    same_bytes(LW_PATH_PATTERN_SQUARE, false);
    same_bytes(LW_PATH_PATTERN_INTERLEAVED, false);
    same_bytes(LW_PATH_PATTERN_INTERLEAVED, true);
}

/* Paths that start from first hits that are there already are the same paths, behind panes as well. */
static void test_first_hits_may_be_given(void **state) {
    (void)state;
    enum { SIDE = 48 };
    for (int panes = 0; panes < 2; panes++) {
        struct lw_scene *scene;
        struct lw_error err = {0};
        lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
        if (panes)
            for (uint32_t m = 0; m < scene->material_count; m += 2) {
                scene->material[m].alpha_mode = LW_ALPHA_BLEND;
                scene->material[m].base_colour[3] = 0.5f;
            }
        struct set set;
        set_up(&set, scene, 2);
        struct lw_path_view view = {.camera = lw_camera_of_scene(scene, &set.world.pose, 0),
                                    .bounces = 2,
                                    .pixel = LW_PATH_PIXEL_CENTRE};
        struct lw_gbuffer gbuffer;
        lw_support_ok(
            lw_gbuffer_init(&gbuffer,
                            &(struct lw_gbuffer_desc){
                                .scene = scene, .trace = set.world.trace, .width = SIDE, .height = SIDE},
                            &err),
            &err);
        lw_gbuffer_render(&gbuffer, &set.world.pose, &view.camera);
        unsigned layered = 0;
        for (int i = 0; i < SIDE * SIDE; i++) layered += gbuffer.from_eye[i];
        assert_true(panes ? layered > SIDE : layered == 0);
        struct lw_path_film film[2];
        for (int given = 0; given < 2; given++) {
            struct lw_path_count count = {0};
            view.first_hits = given ? &gbuffer : NULL;
            lw_support_ok(lw_path_film_init(&film[given], SIDE, SIDE, &err), &err);
            lw_path_trace_render(set.world.tracer, &view, 2, &film[given], &count);
            assert_int_equal(count.paths, 2 * SIDE * SIDE);
            if (given && !panes) assert_int_equal(count.rays_primary, 0);
        }
        for (int half = 0; half < 2; half++)
            assert_memory_equal(film[0].half[half], film[1].half[half],
                                (size_t)SIDE * SIDE * 3 * sizeof(float));
        for (int i = 0; i < 2; i++) lw_path_film_finish(&film[i]);
        lw_gbuffer_finish(&gbuffer);
        tear_down(&set);
    }
}

static void test_pictures_go_on_with_the_sequence(void **state) {
    (void)state;
    enum { SIDE = 40 };
    for (int pattern = 0; pattern < 2; pattern++) {
        struct lw_scene *scene;
        struct lw_error err = {0};
        lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
        struct set set;
        set_up(&set, scene, 2);
        struct lw_path_view view = {.camera = lw_camera_of_scene(scene, &set.world.pose, 0),
                                    .bounces = 1,
                                    .pattern = (enum lw_path_pattern)pattern};
        struct lw_path_film all = render(&set, &view, SIDE, SIDE, 4),
                            first = render(&set, &view, SIDE, SIDE, 2);
        view.first_sample = 2;
        struct lw_path_film second = render(&set, &view, SIDE, SIDE, 2);
        for (int half = 0; half < 2; half++)
            for (int i = 0; i < 3 * SIDE * SIDE; i++)
                assert_true(all.half[half][i] == first.half[half][i] + second.half[half][i]);
        lw_path_film_finish(&second);
        lw_path_film_finish(&first);
        lw_path_film_finish(&all);
        tear_down(&set);
    }
}

/* Edges of a shining square across pixels: these show the share of their square that it covers. */
static void test_a_pixel_is_its_square(void **state) {
    (void)state;
    enum { SIDE = 16, SAMPLES = 1024 };
    const float half_m = 5.3f * 2 / SIDE; /* 5 pixels from the middle and 0.3 of the next */
    struct room room = {0};
    room_quad(&room, lw_vec3(-half_m, 0, -half_m), lw_vec3(0, 0, 2 * half_m), lw_vec3(2 * half_m, 0, 0), 0,
              2);
    struct set set;
    set_up(&set, room_scene(&room), 2);
    for (int centre = 0; centre < 2; centre++) {
        struct lw_path_view view = floor_view();
        view.pixel = centre ? LW_PATH_PIXEL_CENTRE : LW_PATH_PIXEL_BOX;
        struct lw_path_film film = render(&set, &view, SIDE, SIDE, SAMPLES);
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++) {
                double share = 1;
                for (int axis = 0; axis < 2; axis++) {
                    const double from_middle = fabs((axis ? y : x) + 0.5 - SIDE / 2);
                    if (from_middle > 6)
                        share = 0;
                    else if (from_middle > 5)
                        share *= centre ? 0 : 0.3;
                }
                const size_t i = 3 * ((size_t)y * SIDE + (size_t)x);
                const double got = ((double)film.half[0][i] + (double)film.half[1][i]) / SAMPLES;
                /* a sequence of low discrepancy: its error falls about as 1 / n */
                if (!(fabs(got - 2 * share) <= 0.02)) fail_msg("(%d, %d): %g, not %g", x, y, got, 2 * share);
            }
        lw_path_film_finish(&film);
    }
    tear_down(&set);
}

static size_t differences(const struct lw_path_film *whole, const struct lw_path_film *part, uint32_t left,
                          uint32_t top) {
    size_t count = 0;
    for (int half = 0; half < 2; half++)
        for (uint32_t y = 0; y < part->height; y++)
            for (uint32_t x = 0; x < 3 * part->width; x++)
                count += part->half[half][(size_t)y * 3 * part->width + x] !=
                         whole->half[half][(size_t)(top + y) * 3 * whole->width + 3 * left + x];
    return count;
}

static void test_a_part_is_like_the_whole(void **state) {
    (void)state;
    enum { WIDTH = 150, HEIGHT = 70 };
    static const struct {
        uint32_t left, top, width, height;
        bool same;
    } part[] = {
        {0, 0, WIDTH, HEIGHT, true},     {64, 16, 32, 16, true}, {112, 48, WIDTH - 112, HEIGHT - 48, true},
        {0, 48, WIDTH, 16, true},        {75, 35, 1, 1, false},  {61, 13, 37, 21, false},
        {WIDTH - 1, 0, 1, HEIGHT, false}};
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    struct set set;
    set_up(&set, scene, 2);
    struct lw_gbuffer gbuffer;
    lw_support_ok(
        lw_gbuffer_init(&gbuffer,
                        &(struct lw_gbuffer_desc){
                            .scene = scene, .trace = set.world.trace, .width = WIDTH, .height = HEIGHT},
                        &err),
        &err);
    const struct lw_camera_view camera = lw_camera_of_scene(scene, &set.world.pose, 0);
    lw_gbuffer_render(&gbuffer, &set.world.pose, &camera);
    for (int kind = 0; kind < 3; kind++) {
        struct lw_path_view view = {.camera = camera,
                                    .bounces = 2,
                                    .seed = 3,
                                    .pattern = kind ? LW_PATH_PATTERN_INTERLEAVED : LW_PATH_PATTERN_SQUARE,
                                    .first_hits = kind == 2 ? &gbuffer : NULL};
        struct lw_path_film whole = render(&set, &view, WIDTH, HEIGHT, 4);
        for (size_t i = 0; i < sizeof part / sizeof part[0]; i++) {
            view.crop = (struct lw_path_crop){part[i].left, part[i].top, WIDTH, HEIGHT};
            struct lw_path_film film = render(&set, &view, part[i].width, part[i].height, 3);
            struct lw_path_count count = {0};
            lw_path_trace_render(set.world.tracer, &view, 1, &film, &count);
            assert_int_equal(count.paths, part[i].width * part[i].height);
            const size_t off = differences(&whole, &film, part[i].left, part[i].top);
            const size_t bound = part[i].same ? 0 : 6 * part[i].width * part[i].height / 100;
            if (off > bound) fail_msg("part %zu: %zu values are not the whole picture's", i, off);
            lw_path_film_finish(&film);
        }
        lw_path_film_finish(&whole);
    }
    lw_gbuffer_finish(&gbuffer);
    tear_down(&set);
}

/* Root of relMSE against a picture that is as good as the reference. */
static double true_error(const struct lw_path_film *film, const struct lw_path_film *reference) {
    const size_t count = (size_t)film->width * film->height * 3;
    double square = 0, sum = 0;
    for (size_t i = 0; i < count; i++) {
        double t = ((double)reference->half[0][i] + (double)reference->half[1][i]) / reference->samples;
        square += t * t;
    }
    square /= (double)count;
    for (size_t i = 0; i < count; i++) {
        double t = ((double)reference->half[0][i] + (double)reference->half[1][i]) / reference->samples;
        double x = ((double)film->half[0][i] + (double)film->half[1][i]) / film->samples;
        sum += (x - t) * (x - t) / (t * t + 0.01 * square);
    }
    return sqrt(sum / (double)count);
}

static void test_convergence(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    struct set set;
    set_up(&set, scene, 2);
    struct lw_path_view view = {
        .camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2, .seed = 9};
    struct lw_path_film reference = render(&set, &view, 48, 48, 512 * effort);
    view.seed = 1;
    double last = 0;
    for (uint32_t n = 4; n <= 32; n *= 8) {
        struct lw_path_film film = render(&set, &view, 48, 48, n);
        double error = true_error(&film, &reference), estimate = lw_path_film_error(&film);
        /* 48 x 48 pixels: the estimate of a variance is good to some 10 % */
        expect_near(estimate, error, 0.25);
        /* at least as the root of 8; low discrepancy makes it better, not past 8^0.75 */
        if (last > 0 && !(last / error > 2.2 && last / error < 5))
            fail_msg("%u samples: %.4g after %.4g", n, error, last);
        last = error;
        lw_path_film_finish(&film);
    }
    lw_path_film_finish(&reference);
    tear_down(&set);
}

/* With an argument: the same of more samples. */
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
        cmocka_unit_test(test_methods_agree),
        cmocka_unit_test(test_parts_add_up),
        cmocka_unit_test(test_clamp),
        cmocka_unit_test(test_first_hits_may_be_given),
        cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_a_cancelled_render_adds_no_sample),
        cmocka_unit_test(test_pictures_go_on_with_the_sequence),
        cmocka_unit_test(test_a_pixel_is_its_square),
        cmocka_unit_test(test_a_part_is_like_the_whole),
        cmocka_unit_test(test_convergence),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
