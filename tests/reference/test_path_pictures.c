/* test_path_pictures.c: pictures of the path tracer: methods agree, parts add up, bytes do not depend on
 * threads, the sequence goes on, and the error falls with samples. */
#include "common/base/colour.h"
#include "common/builtin/builtin.h"
#include "tests/reference/effort.h"
#include "tests/reference/path_case.h"
#include "tests/reference/room.h"

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
    struct path_case_set set;
    path_case_set_up(&set, scene, 2);
    struct lw_path_view view = {.camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2};
    struct path_case_mean mean[WAYS];
    for (int w = 0; w < WAYS; w++) {
        view.method = way[w].method;
        view.pattern = way[w].pattern;
        view.all_lights = way[w].all_lights;
        mean[w] =
            path_case_mean_of(&set, view, 32, (view.method == LW_PATH_METHOD_BOUNCE ? 64 : 16) * effort);
        assert_true(mean[w].error < noise(0.014) * mean[w].value);
    }
    path_case_expect_same(mean, WAYS);
    path_case_tear_down(&set);
}

/* Emission that is seen, light of lamps at the first hit and light of bounces there add up to the light of
 * the same paths. Without all lights at first hits the bounce rays that look for lights there are others'
 * too: means agree, not pixels. */
static void test_parts_add_up(void **state) {
    (void)state;
    enum { SIDE = 48 };
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    scene->sky[0] = 0.1f;
    struct path_case_set set;
    path_case_set_up(&set, scene, 2);
    struct lw_path_view view = {
        .camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2, .all_lights = true};
    struct lw_path_film film[3];
    for (int part = 0; part < 3; part++) {
        view.part = (enum lw_path_part)part;
        film[part] = path_case_render(&set, &view, SIDE, SIDE, 2);
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
    struct path_case_mean mean[3];
    for (int part = 0; part < 3; part++) {
        view.part = (enum lw_path_part)part;
        mean[part] = path_case_mean_of(&set, view, 32, 16 * effort);
    }
    const double sum = mean[LW_PATH_PART_DIRECT].value + mean[LW_PATH_PART_INDIRECT].value;
    const double error = sqrt(pow(mean[0].error, 2) + pow(mean[1].error, 2) + pow(mean[2].error, 2));
    if (!(fabs(sum - mean[LW_PATH_PART_ALL].value) <= SIGMA * error))
        fail_msg("direct and indirect: %.6g, all: %.6g +- %.2g", sum, mean[LW_PATH_PART_ALL].value, error);
    view.bounces = 0;
    view.part = LW_PATH_PART_INDIRECT;
    assert_true(path_case_mean_of(&set, view, 16, 2).value == 0);
    path_case_tear_down(&set);
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
    struct path_case_set set;
    path_case_set_up(&set, scene, 2);
    struct lw_path_view view = {
        .camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2, .all_lights = true};
    struct lw_path_film free = path_case_render(&set, &view, SIDE, SIDE, 1);
    view.clamp = limit;
    struct lw_path_film clamped = path_case_render(&set, &view, SIDE, SIDE, 1);
    view.clamp = 0;
    view.bounces = 0;
    struct lw_path_film near = path_case_render(&set, &view, SIDE, SIDE, 1);
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
    path_case_tear_down(&set);
}

static void same_bytes(enum lw_path_pattern pattern, bool all_lights) {
    struct lw_path_film film[3];
    const size_t size = (size_t)150 * 70 * 3 * sizeof(float);
    for (unsigned i = 0; i < 3; i++) {
        struct lw_scene *scene;
        struct lw_error err = {0};
        lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
        struct path_case_set set;
        path_case_set_up(&set, scene, i + 1);
        struct lw_path_view view = {.camera = lw_camera_of_scene(scene, &set.world.pose, 0),
                                    .bounces = 3,
                                    .seed = 5,
                                    .pattern = pattern,
                                    .all_lights = all_lights,
                                    .clamp = all_lights ? 0.1f : 0};
        film[i] = path_case_render(&set, &view, 150, 70, i == 2 ? 1 : 7);
        if (i == 2) lw_path_trace_render(set.world.tracer, &view, 6, &film[i], NULL); /* in two calls */
        path_case_tear_down(&set);
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
    struct path_case_set set;
    path_case_set_up(&set, scene, 2);
    _Atomic bool cancel = false;
    struct lw_path_view view = {
        .camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 1, .seed = 5, .cancel = &cancel};
    struct lw_path_film film = path_case_render(&set, &view, 150, 70, 2);
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
    path_case_tear_down(&set);
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
        struct path_case_set set;
        path_case_set_up(&set, scene, 2);
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
        path_case_tear_down(&set);
    }
}

static void test_pictures_go_on_with_the_sequence(void **state) {
    (void)state;
    enum { SIDE = 40 };
    for (int pattern = 0; pattern < 2; pattern++) {
        struct lw_scene *scene;
        struct lw_error err = {0};
        lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
        struct path_case_set set;
        path_case_set_up(&set, scene, 2);
        struct lw_path_view view = {.camera = lw_camera_of_scene(scene, &set.world.pose, 0),
                                    .bounces = 1,
                                    .pattern = (enum lw_path_pattern)pattern};
        struct lw_path_film all = path_case_render(&set, &view, SIDE, SIDE, 4),
                            first = path_case_render(&set, &view, SIDE, SIDE, 2);
        view.first_sample = 2;
        struct lw_path_film second = path_case_render(&set, &view, SIDE, SIDE, 2);
        for (int half = 0; half < 2; half++)
            for (int i = 0; i < 3 * SIDE * SIDE; i++)
                assert_true(all.half[half][i] == first.half[half][i] + second.half[half][i]);
        lw_path_film_finish(&second);
        lw_path_film_finish(&first);
        lw_path_film_finish(&all);
        path_case_tear_down(&set);
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
    struct path_case_set set;
    path_case_set_up(&set, room_scene(&room), 2);
    for (int centre = 0; centre < 2; centre++) {
        struct lw_path_view view = path_case_floor_view();
        view.pixel = centre ? LW_PATH_PIXEL_CENTRE : LW_PATH_PIXEL_BOX;
        struct lw_path_film film = path_case_render(&set, &view, SIDE, SIDE, SAMPLES);
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
    path_case_tear_down(&set);
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
    struct path_case_set set;
    path_case_set_up(&set, scene, 2);
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
        struct lw_path_film whole = path_case_render(&set, &view, WIDTH, HEIGHT, 4);
        for (size_t i = 0; i < sizeof part / sizeof part[0]; i++) {
            view.crop = (struct lw_path_crop){part[i].left, part[i].top, WIDTH, HEIGHT};
            struct lw_path_film film = path_case_render(&set, &view, part[i].width, part[i].height, 3);
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
    path_case_tear_down(&set);
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
    struct path_case_set set;
    path_case_set_up(&set, scene, 2);
    struct lw_path_view view = {
        .camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2, .seed = 9};
    struct lw_path_film reference = path_case_render(&set, &view, 48, 48, 512 * effort);
    view.seed = 1;
    double last = 0;
    for (uint32_t n = 4; n <= 32; n *= 8) {
        struct lw_path_film film = path_case_render(&set, &view, 48, 48, n);
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
    path_case_tear_down(&set);
}

int main(int argc, char **argv) {
    (void)argv;
    set_effort(argc);
    const struct CMUnitTest tests[] = {
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
