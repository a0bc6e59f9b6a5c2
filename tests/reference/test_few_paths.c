/* The denoiser against converged paths: a camera moves and turns through a scene whose
 * objects move, one path per pixel. */
#include "client/measure/sides/path_world.h"
#include "client/paths/svgf.h"
#include "common/builtin/builtin.h"
#include "tests/support/support.h"

#include <math.h>
#include <stdlib.h>

#define WIDTH   320u
#define HEIGHT  180u
#define VALUES  (3 * WIDTH * HEIGHT)
#define FRAMES  8
#define BOUNCES 2

struct set {
    struct lw_scene *scene;
    struct lw_path_world world;
    struct lw_camera_view camera; /* the first frame's */
    struct lw_path_film film;
};

static void set_up(struct set *set, const char *name) {
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build(name, &set->scene, &err), &err);
    lw_support_ok(lw_path_world_init(&set->world, set->scene, BOUNCES, 0, &err), &err);
    lw_support_ok(lw_path_film_init(&set->film, WIDTH, HEIGHT, &err), &err);
    set->camera = lw_camera_of_scene(set->scene, &set->world.pose, 0);
}

static void tear_down(struct set *set) {
    lw_path_film_finish(&set->film);
    lw_path_world_finish(&set->world);
    lw_scene_destroy(set->scene);
}

/* 2 cm and half a degree a frame: most pixels move by one to two. */
static struct lw_camera_view camera_at(const struct set *set, int frame) {
    const struct lw_camera_view *c = &set->camera;
    const float turn = 0.5f * (float)frame * LW_PI / 180;
    struct lw_vec3 position = lw_vec3_mad(c->position, c->right, 0.02f * (float)frame);
    struct lw_vec3 forward = lw_vec3_mad(lw_vec3_scale(c->forward, cosf(turn)), c->right, -sinf(turn));
    return lw_camera_look_at(position, lw_vec3_add(position, forward), c->fov_y);
}

static void trace(struct set *set, int frame, uint32_t seed, uint32_t samples, float *out_rgb) {
    struct lw_error err = {0};
    lw_support_ok(lw_path_world_set_time(&set->world, frame / 30.0, &err), &err);
    const struct lw_path_view view = {.camera = camera_at(set, frame),
                                      .seed = seed,
                                      .first_sample = (uint32_t)frame * samples,
                                      .pattern = LW_PATH_PATTERN_INTERLEAVED};
    lw_path_film_clear(&set->film);
    lw_path_world_render(&set->world, &view, samples, &set->film);
    lw_path_film_resolve(&set->film, out_rgb);
}

/* How much less the error of the last picture of the way is than without the filter. What the noise of the
 * reference's samples adds to the error is known and taken off: the more is left of it, the more samples. */
static double gain(const char *name, uint32_t reference_samples) {
    struct set set;
    struct lw_error err = {0};
    struct lw_gbuffer gbuffer;
    struct lw_svgf *svgf;
    float *raw = malloc(VALUES * sizeof *raw), *out = malloc(VALUES * sizeof *out),
          *reference = malloc(VALUES * sizeof *reference);
    assert_true(raw && out && reference);
    set_up(&set, name);
    lw_support_ok(
        lw_gbuffer_init(&gbuffer,
                        &(struct lw_gbuffer_desc){
                            .scene = set.scene, .trace = set.world.trace, .width = WIDTH, .height = HEIGHT},
                        &err),
        &err);
    lw_support_ok(lw_svgf_create(&(struct lw_svgf_desc){.width = WIDTH, .height = HEIGHT}, &svgf, &err),
                  &err);
    for (int frame = 0; frame < FRAMES; frame++) {
        trace(&set, frame, 1, 1, raw);
        const struct lw_camera_view camera = camera_at(&set, frame);
        lw_gbuffer_render(&gbuffer, &set.world.pose, &camera);
        lw_svgf_filter(svgf, &gbuffer, raw, out);
    }
    trace(&set, FRAMES - 1, 2, reference_samples, reference);
    const double reference_error = lw_path_film_error(&set.film);
    const double before = lw_support_relmse(raw, reference, VALUES) - reference_error * reference_error,
                 after = lw_support_relmse(out, reference, VALUES) - reference_error * reference_error;
    print_message("%s: relMSE %.4g -> %.4g\n", name, before, after);
    lw_svgf_destroy(svgf);
    lw_gbuffer_finish(&gbuffer);
    tear_down(&set);
    free(reference), free(out), free(raw);
    return before / fmax(after, 1e-9);
}

/* Measured: 122 and 8.8. The atrium at this size is full of detail as small as a pixel, which has
 * few neighbours to learn from. */
static void test_cornell(void **state) {
    (void)state;
    assert_true(gain("builtin:cornell", 32) > 80);
}

static void test_atrium(void **state) {
    (void)state;
    assert_true(gain("builtin:atrium-matt", 8) > 6);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_cornell), cmocka_unit_test(test_atrium)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
