/* The path renderers against converged paths: a camera moves and turns through a scene, one path per pixel
 * and frame. */
#include "client/measure/sides/path_world.h"
#include "client/paths/path_renderer.h"
#include "client/paths/svgf.h"
#include "common/builtin/builtin.h"
#include "tests/support/support.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* no multiple of two: the last column of a quarter has no pixel to its right */
#define WIDTH             163u
#define HEIGHT            90u
#define VALUES            (3 * WIDTH * HEIGHT)
#define FRAMES            10
#define STEP_M            0.01f /* the camera's step from picture to picture */
#define BOUNCES           2
#define REFERENCE_SAMPLES 128u /* samples; what their noise adds to the error is known and taken off */

struct set {
    struct lw_scene *scene;
    struct lw_path_world world;
    struct lw_camera_view camera; /* the first frame's */
};

static void set_up(struct set *set, unsigned threads) {
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &set->scene, &err), &err);
    lw_support_ok(lw_path_world_init(&set->world, set->scene, BOUNCES, threads, &err), &err);
    set->camera = lw_camera_of_scene(set->scene, &set->world.pose, 0);
}

static void tear_down(struct set *set) {
    lw_path_world_finish(&set->world);
    lw_scene_destroy(set->scene);
}

static struct lw_camera_view camera_at(const struct set *set, float way_m) {
    const struct lw_camera_view *c = &set->camera;
    struct lw_vec3 position = lw_vec3_mad(c->position, c->right, way_m);
    return lw_camera_look_at(position, lw_vec3_add(position, c->forward), c->fov_y);
}

/* The last picture of the way; to be freed. */
static float *render_by(struct set *set, enum lw_path_renderer_kind kind,
                        struct lw_instant_radiosity_terms vpl, uint32_t seed, float step_m,
                        unsigned threads) {
    struct lw_path_renderer *renderer;
    struct lw_error err = {0};
    struct lw_path_frame_cost cost = {0};
    const float *rgb = NULL;
    lw_support_ok(lw_path_renderer_create(&(struct lw_path_renderer_desc){.kind = kind,
                                                                          .scene = set->scene,
                                                                          .trace = set->world.trace,
                                                                          .tracer = set->world.tracer,
                                                                          .lights = &set->world.lights,
                                                                          .width = WIDTH,
                                                                          .height = HEIGHT,
                                                                          .bounces = BOUNCES,
                                                                          .vpl = vpl,
                                                                          .threads = threads},
                                          &renderer, &err),
                  &err);
    for (int frame = 0; frame < FRAMES; frame++)
        rgb = lw_path_renderer_frame(renderer,
                                     &(struct lw_path_frame){.pose = &set->world.pose,
                                                             .camera = camera_at(set, step_m * (float)frame),
                                                             .samples = 1,
                                                             .seed = seed,
                                                             .number = (uint32_t)frame},
                                     &cost);
    assert_true(cost.trace_s > 0);
    float *out = malloc(VALUES * sizeof *out);
    assert_non_null(out);
    memcpy(out, rgb, VALUES * sizeof *out);
    lw_path_renderer_destroy(renderer);
    return out;
}

static float *render(struct set *set, enum lw_path_renderer_kind kind, unsigned threads) {
    return render_by(set, kind, (struct lw_instant_radiosity_terms){.lights = 0}, 1, STEP_M, threads);
}

/* Measured: 0.101 twice, since there is one lamp, 0.0046, 0.0011, 0.0019, 0.0025. */
static void test_each_is_nearer_to_the_truth(void **state) {
    (void)state;
    struct set set;
    struct lw_error err = {0};
    struct lw_path_film film;
    double error[LW_PATH_RENDERER_COUNT];
    float reference[VALUES];
    set_up(&set, 0);
    lw_support_ok(lw_path_film_init(&film, WIDTH, HEIGHT, &err), &err);
    lw_path_world_render(&set.world,
                         &(struct lw_path_view){.camera = camera_at(&set, STEP_M * (FRAMES - 1)), .seed = 2},
                         REFERENCE_SAMPLES, &film);
    lw_path_film_resolve(&film, reference);
    const double of_reference = lw_path_film_error(&film) * lw_path_film_error(&film);
    for (int kind = 0; kind < LW_PATH_RENDERER_COUNT; kind++) {
        float *rgb = render(&set, (enum lw_path_renderer_kind)kind, 0);
        error[kind] = lw_support_relmse(rgb, reference, VALUES) - of_reference;
        print_message("%s: relMSE %.4g\n", lw_path_renderer_name((enum lw_path_renderer_kind)kind),
                      error[kind]);
        free(rgb);
    }
    assert_true(error[LW_PATH_RENDERER_LIGHTS] < 1.1 * error[LW_PATH_RENDERER_RAW]);
    assert_true(error[LW_PATH_RENDERER_REPROJECTED] < 0.15 * error[LW_PATH_RENDERER_LIGHTS]);
    assert_true(error[LW_PATH_RENDERER_SVGF] < 0.5 * error[LW_PATH_RENDERER_REPROJECTED]);
    assert_true(error[LW_PATH_RENDERER_SVGF_QUARTER] < 0.7 * error[LW_PATH_RENDERER_REPROJECTED]);
    assert_true(error[LW_PATH_RENDERER_VPL] < 0.7 * error[LW_PATH_RENDERER_REPROJECTED]);
    lw_path_film_finish(&film);
    tear_down(&set);
}

static void test_threads_do_not_matter(void **state) {
    (void)state;
    for (int kind = 0; kind < LW_PATH_RENDERER_COUNT; kind++) {
        float *rgb[2];
        for (unsigned threads = 1; threads <= 2; threads++) {
            struct set set;
            set_up(&set, threads);
            rgb[threads - 1] = render(&set, (enum lw_path_renderer_kind)kind, threads);
            tear_down(&set);
        }
        assert_memory_equal(rgb[0], rgb[1], VALUES * sizeof(float));
        free(rgb[0]), free(rgb[1]);
    }
}

static double mean_of(const float *rgb) {
    double sum = 0;
    for (size_t i = 0; i < VALUES; i++) sum += (double)rgb[i];
    return sum / VALUES;
}

/* The mean of the last picture, over seeds. */
static double of_bounces(struct set *set, struct lw_instant_radiosity_terms terms, uint32_t seeds) {
    double sum = 0;
    for (uint32_t seed = 1; seed <= seeds; seed++) {
        float *rgb = render_by(set, LW_PATH_RENDERER_VPL, terms, seed, 0, 0);
        sum += mean_of(rgb);
        free(rgb);
    }
    return sum / seeds;
}

/* Of all light by bounces; the lamp's own is the same in both. Many lights and a small d0 have the mean of
 * paths. The d0 of 512 lights, some 8 cm in a box of 2 m, takes under 5 % away, and never adds. */
static void test_mean_of_virtual_lights(void **state) {
    (void)state;
    struct set set;
    struct lw_error err = {0};
    struct lw_path_film film;
    set_up(&set, 0);
    float *part[2];
    for (int direct = 0; direct < 2; direct++) {
        lw_support_ok(lw_path_film_init(&film, WIDTH, HEIGHT, &err), &err);
        lw_path_world_render(
            &set.world,
            &(struct lw_path_view){.camera = set.camera,
                                   .seed = 2,
                                   .all_lights = true,
                                   .part = direct ? LW_PATH_PART_DIRECT : LW_PATH_PART_INDIRECT},
            REFERENCE_SAMPLES, &film);
        part[direct] = malloc(VALUES * sizeof(float));
        assert_non_null(part[direct]);
        lw_path_film_resolve(&film, part[direct]);
        lw_path_film_finish(&film);
    }
    const double indirect = mean_of(part[0]), direct = mean_of(part[1]);
    const double of_many = of_bounces(
                     &set, (struct lw_instant_radiosity_terms){.lights = 4096, .near_m = 0.02f}, 1),
                 of_few = of_bounces(&set, (struct lw_instant_radiosity_terms){.lights = 0}, 8);
    print_message("of the light by bounces: %.4f by 4096 lights, %.4f by 512\n",
                  (of_many - direct) / indirect, (of_few - direct) / indirect);
    assert_true(fabs((of_many - direct) / indirect - 1) < 0.02);
    assert_true((of_few - direct) / indirect > 0.95 && (of_few - direct) / indirect < 1.02);
    free(part[0]), free(part[1]);
    tear_down(&set);
}

/* With nothing moving, the sum of eight sets is what all lights give at once. What differs is the pixel of
 * 4 x 4 that a light is shaded at: shadows of single lights lie a pixel elsewhere. A set more or less would
 * be an eighth of the light by bounces, a fifth of all here. */
static void test_sets_add_up(void **state) {
    (void)state;
    struct set set;
    set_up(&set, 0);
    float *one =
              render_by(&set, LW_PATH_RENDERER_VPL, (struct lw_instant_radiosity_terms){.sets = 1}, 1, 0, 0),
          *eight =
              render_by(&set, LW_PATH_RENDERER_VPL, (struct lw_instant_radiosity_terms){.sets = 8}, 1, 0, 0);
    double off = 0;
    for (size_t i = 0; i < VALUES; i++) off += (double)fabsf(one[i] - eight[i]);
    const double mean = mean_of(one);
    print_message("off by %.4f; means by %.5f\n", off / VALUES / mean, mean_of(eight) / mean - 1);
    assert_true(off < 0.02 * VALUES * mean);
    assert_true(fabs(mean_of(eight) / mean - 1) < 0.005);
    free(one), free(eight);
    tear_down(&set);
}

/* What cannot be is refused by name, and a renderer without bounces is one of direct light. */
static void test_terms_of_virtual_lights(void **state) {
    (void)state;
    static const struct {
        struct lw_instant_radiosity_terms terms;
        const char *says;
    } bad[] = {
        {{.sets = LW_INSTANT_RADIOSITY_SETS_MAX + 1},
         "33 sets of virtual point lights; there are at most 32"},
        {{.lights = LW_INSTANT_RADIOSITY_LIGHTS_MAX + 1}, "there are at most 65536"},
        {{.lights = 15, .sets = 8}, "15 virtual point lights are too few for 8 sets of 2 bounces"},
        {{.near_m = -1}, "d0 is -1 m"},
    };
    struct set set;
    struct lw_path_renderer *renderer = NULL;
    set_up(&set, 1);
    struct lw_path_renderer_desc desc = {.kind = LW_PATH_RENDERER_VPL,
                                         .scene = set.scene,
                                         .trace = set.world.trace,
                                         .tracer = set.world.tracer,
                                         .lights = &set.world.lights,
                                         .width = 8,
                                         .height = 8,
                                         .bounces = BOUNCES};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct lw_error err = {0};
        desc.vpl = bad[i].terms;
        assert_int_equal(lw_path_renderer_create(&desc, &renderer, &err), LW_USAGE);
        assert_non_null(strstr(err.text, bad[i].says));
        assert_null(renderer);
    }
    desc.vpl = (struct lw_instant_radiosity_terms){.lights = 16, .sets = 8}; /* as few as may be */
    desc.bounces = 0;
    for (; desc.bounces <= BOUNCES; desc.bounces += BOUNCES) {
        lw_support_ok(lw_path_renderer_create(&desc, &renderer, NULL), NULL);
        for (uint32_t n = 0; n < 9; n++)
            assert_true(lw_path_renderer_frame(
                            renderer,
                            &(struct lw_path_frame){
                                .pose = &set.world.pose, .camera = set.camera, .samples = 1, .number = n},
                            NULL)[0] >= 0);
        lw_path_renderer_destroy(renderer);
    }
    tear_down(&set);
}

/* Light without noise comes through a quarter as it is where it is even, and each pixel has its own albedo
 * and emission, beside other surfaces as well; whichever pixel of the square is taken. */
static void test_a_quarter_tells_even_light(void **state) {
    (void)state;
    struct set set;
    struct lw_error err = {0};
    struct lw_gbuffer full, thin;
    struct lw_svgf *svgf;
    set_up(&set, 2);
    lw_support_ok(
        lw_gbuffer_init(&full,
                        &(struct lw_gbuffer_desc){
                            .scene = set.scene, .trace = set.world.trace, .width = WIDTH, .height = HEIGHT},
                        &err),
        &err);
    lw_support_ok(lw_gbuffer_init_thin(&thin, &full, 2, &err), &err);
    assert_int_equal(thin.width, (WIDTH + 1) / 2);
    assert_int_equal(thin.height, HEIGHT / 2);
    lw_support_ok(
        lw_svgf_create(&(struct lw_svgf_desc){.width = thin.width, .height = thin.height}, &svgf, &err),
        &err);
    float *radiance = malloc((size_t)3 * thin.width * thin.height * sizeof *radiance);
    float *out = malloc(VALUES * sizeof *out);
    assert_true(radiance && out);
    for (uint32_t k = 0; k < 4; k++) {
        lw_gbuffer_render(&full, &set.world.pose, &set.camera);
        /* every second square of 4 x 4 pixels is black: it tells its neighbours nothing */
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
            for (int c = 0; c < 3 && (i % WIDTH / 4 + i / WIDTH / 4) % 2; c++) full.plane.albedo[c][i] = 0;
        lw_gbuffer_thin(&thin, &full, k & 1, k >> 1);
        const struct lw_camera_plane aim = lw_gbuffer_aim(&thin),
                                     plane = lw_camera_plane(&set.camera, WIDTH, HEIGHT);
        const struct lw_vec3 here = lw_camera_direction(&aim, 3.5f, 5.5f),
                             there =
                                 lw_camera_direction(&plane, 6.5f + (float)(k & 1), 10.5f + (float)(k >> 1));
        assert_true(lw_vec3_length(lw_vec3_sub(here, there)) < 1e-6f);
        for (size_t i = 0; i < (size_t)thin.width * thin.height; i++)
            for (size_t c = 0; c < 3; c++)
                radiance[3 * i + c] = 0.7f * thin.plane.albedo[c][i] + thin.plane.emission[c][i];
        lw_svgf_filter_thin(svgf, &thin, &full, radiance, out);
        for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
            for (size_t c = 0; c < 3; c++) {
                const float light = full.plane.object[i] == LW_TRACE_MISS ? 0 : 0.7f,
                            want = light * full.plane.albedo[c][i] + full.plane.emission[c][i];
                /* a channel that reflects nothing follows from the others; emission is large beside light */
                assert_float_equal(out[3 * i + c], want, 1e-4f + 1e-5f * full.plane.emission[c][i]);
            }
        }
    }
    free(out);
    free(radiance);
    lw_svgf_destroy(svgf);
    lw_gbuffer_finish(&thin);
    lw_gbuffer_finish(&full);
    tear_down(&set);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_each_is_nearer_to_the_truth), cmocka_unit_test(test_threads_do_not_matter),
        cmocka_unit_test(test_mean_of_virtual_lights),      cmocka_unit_test(test_sets_add_up),
        cmocka_unit_test(test_terms_of_virtual_lights),     cmocka_unit_test(test_a_quarter_tells_even_light),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
