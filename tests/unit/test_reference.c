#include "tests/support/support.h"

#include "client/measure/figures/reference.h"
#include "client/measure/sides/lattice.h"
#include "common/base/random.h"
#include "common/builtin/builtin.h"

#include <math.h>
#include <stdlib.h>

enum { WIDTH = 256, HEIGHT = 128, VALUES = 3 * WIDTH * HEIGHT };

static void strides(void **state) {
    (void)state;
    assert_int_equal(lw_lattice_stride(1280, 720), 5);
    assert_int_equal(lw_lattice_stride(1920, 1080), 5);
    assert_int_equal(lw_lattice_stride(1344, 756), 7);
    assert_int_equal(lw_lattice_stride(1024, 768), 1);
    assert_int_equal(lw_lattice_stride(33, 63), 3);
}

static void the_lattice_is_in_the_middle_of_its_squares(void **state) {
    (void)state;
    float whole[3 * 9 * 6], lattice[3 * 3 * 2];
    for (int i = 0; i < 9 * 6; i++) whole[3 * i] = whole[3 * i + 1] = whole[3 * i + 2] = (float)i;
    lw_lattice_pick(whole, 9, 6, 3, lattice);
    static const float expected[] = {10, 13, 16, 37, 40, 43};
    for (int i = 0; i < 6; i++)
        assert_true(lattice[3 * i] == expected[i] && lattice[3 * i + 2] == expected[i]);
}

/* Uniform noise of variance 1. */
static float noise(uint32_t seed, uint32_t i) {
    return sqrtf(12) * (lw_random_unit(lw_random_hash2(seed, i)) - 0.5f);
}

static float signal_at(int i) { return 1 + (float)(i % 5); }

/* A picture with noise of its own, judged by a reference that is as noisy: the error is the picture's
 * alone. */
static void the_references_noise_is_taken_out(void **state) {
    (void)state;
    static float half[2][VALUES], picture[VALUES];
    struct lw_reference reference = {.width = WIDTH, .height = HEIGHT, .half = {half[0], half[1]}};
    const float sigma = 0.05f;
    double square = 0;
    for (int i = 0; i < VALUES; i++) square += (double)(signal_at(i) * signal_at(i)) / VALUES;
    reference.mean_square = square;
    double expected = 0;
    for (int i = 0; i < VALUES; i++) {
        half[0][i] = signal_at(i) + sigma * noise(1, (uint32_t)i);
        half[1][i] = signal_at(i) + sigma * noise(2, (uint32_t)i);
        picture[i] = signal_at(i) + sigma * noise(3, (uint32_t)i);
        expected +=
            (double)(sigma * sigma) / ((double)(signal_at(i) * signal_at(i)) + 0.01 * square) / VALUES;
    }
    /* Deviation of the mean of products of two noises: relative 1/sqrt(n) times a few. */
    assert_true(fabs(lw_reference_error(&reference, picture) / expected - 1) < 6 / sqrt(VALUES) + 3e-3);
    for (int i = 0; i < VALUES; i++) picture[i] = signal_at(i);
    assert_true(fabs(lw_reference_error(&reference, picture)) < 0.02 * expected);
    for (int i = 0; i < VALUES; i++) picture[i] = 1.2f * signal_at(i);
    double biased = 0;
    for (int i = 0; i < VALUES; i++) {
        double t2 = (double)(signal_at(i) * signal_at(i));
        biased += 0.04 * t2 / (t2 + 0.01 * square) / VALUES;
    }
    assert_true(fabs(lw_reference_error(&reference, picture) / biased - 1) < 0.01);
}

static void black_is_no_error(void **state) {
    (void)state;
    float zero[2][3] = {{0}}, picture[3] = {0};
    struct lw_reference reference = {.width = 1, .height = 1, .half = {zero[0], zero[1]}};
    assert_true(lw_reference_error(&reference, picture) == 0);
}

static void dark_views_are_known_by_the_others(void **state) {
    (void)state;
    assert_true(lw_reference_is_dark(&(struct lw_reference){.mean_square = 0.9e-4}, 1));
    assert_false(lw_reference_is_dark(&(struct lw_reference){.mean_square = 1.1e-4}, 1));
    assert_true(
        lw_reference_is_dark(&(struct lw_reference){.mean_square = 0}, 0)); /* where all is dark, too */
}

/* A Cornell box whose lamp is half as bright again at another moment: where it does not shine all light is
 * off by a half. */
static void light_that_is_late_is_off_by_what_has_changed(void **state) {
    (void)state;
    enum { SIDE = 32, SAMPLES = 512 };
    struct lw_reference reference;
    struct lw_error err = {0};
    static uint32_t object[SIDE * SIDE];
    double expected = 0, got = 0;
    unsigned count = 0;
    for (int late = 0; late < 2; late++) {
        struct lw_scene *scene;
        struct lw_path_world world;
        lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
        for (uint32_t m = 0; late && m < scene->material_count; m++)
            for (int c = 0; c < 3; c++) scene->material[m].emission[c] *= 1.5f;
        lw_support_ok(lw_path_world_init(&world, scene, 1, 0, &err), &err);
        const struct lw_camera_view camera = lw_camera_of_scene(scene, &world.pose, 0);
        if (late) {
            lw_support_ok(lw_reference_lag_error(&reference, object, &world, &camera, SAMPLES, 9, &got, &err),
                          &err);
        } else {
            lw_support_ok(lw_reference_init(&reference, &world, &camera, SIDE, SIDE, SAMPLES, 5, &err), &err);
            lw_support_ok(lw_reference_look(&world, &camera, SIDE, SIDE, object, &err), &err);
        }
        lw_path_world_finish(&world);
        lw_scene_destroy(scene);
    }
    for (int i = 0; i < 3 * SIDE * SIDE; i++) {
        if (object[i / 3] == LW_TRACE_MISS) continue;
        const double t = 0.5 * ((double)reference.half[0][i] + (double)reference.half[1][i]);
        expected += 0.25 * t * t / (t * t + 0.01 * reference.mean_square);
        count++;
    }
    expected /= count;
    assert_true(count > SIDE * SIDE &&
                count < 3 * SIDE * SIDE); /* the lamp is in the picture, and the dark beyond */
    assert_true(fabs(got / expected - 1) < 0.03);
    /* nothing is known of other objects */
    for (int i = 0; i < SIDE * SIDE; i++)
        object[i] = object[i] == LW_TRACE_MISS ? LW_TRACE_MISS : object[i] + 1;
    struct lw_scene *scene;
    struct lw_path_world world;
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    lw_support_ok(lw_path_world_init(&world, scene, 1, 0, &err), &err);
    const struct lw_camera_view camera = lw_camera_of_scene(scene, &world.pose, 0);
    lw_support_ok(lw_reference_lag_error(&reference, object, &world, &camera, 2, 9, &got, &err), &err);
    assert_true(got == 0);
    lw_path_world_finish(&world);
    lw_scene_destroy(scene);
    lw_reference_finish(&reference);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(strides),
        cmocka_unit_test(the_lattice_is_in_the_middle_of_its_squares),
        cmocka_unit_test(the_references_noise_is_taken_out),
        cmocka_unit_test(black_is_no_error),
        cmocka_unit_test(light_that_is_late_is_off_by_what_has_changed),
        cmocka_unit_test(dark_views_are_known_by_the_others),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
