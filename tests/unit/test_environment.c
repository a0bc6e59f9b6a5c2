/* The environment: where its picture lies, how it is read, and the directions that are drawn from it. */
#include "common/base/random.h"
#include "common/scene/environment.h"
#include "tests/support/support.h"

#include <math.h>
#include <stdlib.h>

static void expect_rgb(struct lw_vec3 got, float r, float g, float b, float tolerance) {
    if (fabsf(got.x - r) > tolerance || fabsf(got.y - g) > tolerance || fabsf(got.z - b) > tolerance)
        fail_msg("(%g, %g, %g), expected (%g, %g, %g)", (double)got.x, (double)got.y, (double)got.z,
                 (double)r, (double)g, (double)b);
}

static struct lw_vec3 at(const struct lw_environment *e, float x, float y, float z) {
    return lw_environment_radiance(e, lw_vec3_normalize(lw_vec3(x, y, z)));
}

/* Eight columns of one row, red their number, green its square: read at the centres, between them, around the
 * sides. */
static void columns_go_around(void **state) {
    (void)state;
    float rgb[8 * 3] = {0};
    for (int i = 0; i < 8; i++) rgb[3 * i] = (float)i, rgb[3 * i + 1] = (float)(i * i);
    const struct lw_environment e = {.width = 8, .height = 1, .rgb = rgb};
    for (int i = 0; i < 8; i++) {
        float centre = 2 * LW_PI * (((float)i + 0.5f) / 8 - 0.5f);
        expect_rgb(at(&e, cosf(centre), 0, sinf(centre)), (float)i, (float)(i * i), 0, 1e-4f);
        float next = (float)((i + 1) % 8), edge = centre + LW_PI / 8;
        expect_rgb(at(&e, cosf(edge), 0.5f, sinf(edge)), 0.5f * ((float)i + next),
                   0.5f * ((float)(i * i) + next * next), 0, 1e-4f);
    }
    /* the middle of the picture is +X, a quarter to the right of it +Z */
    expect_rgb(at(&e, 1, 0, 0), 3.5f, 12.5f, 0, 1e-4f);
    expect_rgb(at(&e, 0, 0, 1), 5.5f, 30.5f, 0, 1e-4f);
    expect_rgb(at(&e, -1, 0, 0), 3.5f, 24.5f, 0, 1e-4f); /* where the sides meet */
}

static void rows_go_down_and_stop_at_the_poles(void **state) {
    (void)state;
    float rgb[4 * 3] = {1, 0, 0, 2, 0, 0, 4, 0, 0, 8, 0, 0};
    const struct lw_environment e = {.width = 1, .height = 4, .rgb = rgb};
    expect_rgb(at(&e, 0, 1, 0), 1, 0, 0, 0);
    expect_rgb(at(&e, 0, -1, 0), 8, 0, 0, 0);
    for (int j = 0; j < 4; j++) {
        float centre = LW_PI * ((float)j + 0.5f) / 4;
        expect_rgb(at(&e, sinf(centre), cosf(centre), 0), rgb[3 * j], 0, 0, 1e-5f);
    }
    expect_rgb(at(&e, 1, 0, 0), 3, 0, 0, 1e-5f);
    expect_rgb(at(&e, 0.05f, 1, 0), 1, 0, 0, 0); /* above the first row of centres */
}

static void sky_and_environment_add_up(void **state) {
    (void)state;
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    const float rgb[3] = {1, 2, 3};
    assert_false(lw_scene_has_light(scene));
    scene->environment = (struct lw_environment){.width = 1, .height = 1, .rgb = rgb};
    assert_true(lw_scene_has_light(scene));
    scene->sky[0] = 0.5f;
    expect_rgb(lw_scene_sky(scene, lw_vec3(0, 1, 0)), 1.5f, 2, 3, 0);
    scene->environment = (struct lw_environment){0};
    expect_rgb(lw_scene_sky(scene, lw_vec3(0, 1, 0)), 0.5f, 0, 0, 0);
    expect_rgb(lw_environment_radiance(&scene->environment, lw_vec3(0, 1, 0)), 0, 0, 0, 0);
    lw_scene_destroy(scene);
}

/* No direction, not even a broken one, reads past the picture. */
static void odd_directions_are_safe(void **state) {
    (void)state;
    float *rgb = malloc(7 * 5 * 3 * sizeof *rgb); /* exactly as large as needed, for a sanitizer */
    assert_non_null(rgb);
    for (int i = 0; i < 7 * 5 * 3; i++) rgb[i] = 1;
    const struct lw_environment e = {.width = 7, .height = 5, .rgb = rgb};
    const float odd[] = {0, -0.0f, 1, -1, 1e-38f, -1e-38f, 1e30f, NAN, INFINITY};
    for (size_t x = 0; x < sizeof odd / sizeof *odd; x++)
        for (size_t y = 0; y < sizeof odd / sizeof *odd; y++)
            for (size_t z = 0; z < sizeof odd / sizeof *odd; z++)
                (void)lw_environment_radiance(&e, lw_vec3(odd[x], odd[y], odd[z]));
    for (uint32_t i = 0; i < 4096; i++) {
        float p[2];
        lw_random_sobol2(i, 5, p);
        float z = 1 - 2 * p[0], r = sqrtf(1 - z * z), angle = 2 * LW_PI * p[1];
        expect_rgb(at(&e, r * cosf(angle), z, r * sinf(angle)), 1, 1, 1, 1e-6f);
    }
    free(rgb);
}

/* A dim sky with a bright patch that goes around the side, bright poles, and a texel like a sun. */
enum { W = 24, H = 13 };
static void paint(float rgb[W * H * 3]) {
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++) {
            float value = 0.3f + 0.1f * (float)(x * 7 % 5);
            if (y == 4 && (x < 2 || x > 21)) value = 20;
            if (y == H - 1 || y == 0) value = 60;
            if (y == 2 && x == 9) value = 5000;
            for (uint32_t c = 0; c < 3; c++) rgb[3 * (y * W + x) + c] = value * (1 + 0.1f * (float)c);
        }
}

static void densities_are_what_is_drawn(void **state) {
    (void)state;
    float rgb[W * H * 3];
    paint(rgb);
    const struct lw_environment e = {.width = W, .height = H, .rgb = rgb};
    struct lw_environment_importance importance;
    lw_support_ok(lw_environment_importance_init(&importance, &e), NULL);
    assert_true(importance.excess > 0 && importance.excess < importance.mean);

    /* the density that comes with a draw is the density of its direction; they cover what they
     * should */
    enum { N = 1 << 17 };
    double inverse = 0, steps = 0;
    for (uint32_t i = 0; i < N; i++) {
        float p[2], pdf;
        lw_random_sobol2(i, 11, p);
        struct lw_vec3 d = lw_environment_importance_sample(&importance, p[0], p[1], &pdf);
        assert_true(pdf > 0 && fabsf(lw_vec3_length(d) - 1) < 1e-5f);
        float stated = lw_environment_importance_pdf(&importance, d);
        steps += fabsf(stated / pdf - 1) > 2e-3f;
        inverse += 1 / (double)pdf;
    }
    assert_true(steps == 0);

    /* over all directions the density sums up to 1, and 1/pdf to the solid angle of where it is not 0 */
    double total = 0, angle_sr = 0;
    enum { M = 1 << 20 };
    for (uint32_t i = 0; i < M; i++) {
        float p[2];
        lw_random_sobol2(i, 12, p);
        float z = 1 - 2 * p[0], r = sqrtf(1 - z * z), angle = 2 * LW_PI * p[1];
        double pdf =
            (double)lw_environment_importance_pdf(&importance, lw_vec3(r * cosf(angle), z, r * sinf(angle)));
        total += pdf * 4 * (double)LW_PI / M;
        angle_sr += pdf > 0 ? 4 * (double)LW_PI / M : 0;
    }
    assert_true(fabs(total - 1) < 0.005);
    assert_true(fabs(inverse / N / angle_sr - 1) < 0.03);

    /* most go to the sun, as most of the light that stands out comes from there */
    float sun = lw_environment_importance_pdf(
        &importance,
        lw_vec3(sinf(2.5f / H * LW_PI) * cosf(2 * LW_PI * (9.5f / W - 0.5f)), cosf(2.5f / H * LW_PI),
                sinf(2.5f / H * LW_PI) * sinf(2 * LW_PI * (9.5f / W - 0.5f))));
    assert_true(sun > 10);
    lw_environment_importance_finish(&importance);
}

/* Mixed with even directions, the draws give the integral of all look-ups: no direction is left out. */
static void mixture_is_unbiased(void **state) {
    (void)state;
    float rgb[W * H * 3];
    paint(rgb);
    const struct lw_environment e = {.width = W, .height = H, .rgb = rgb};
    struct lw_environment_importance importance;
    lw_support_ok(lw_environment_importance_init(&importance, &e), NULL);
    enum { N = 1 << 18 };
    double mixed = 0, even = 0;
    for (uint32_t i = 0; i < N; i++) {
        float p[2], pdf = 0;
        lw_random_sobol2(i, 21, p);
        float z = 1 - 2 * p[0], r = sqrtf(1 - z * z), angle = 2 * LW_PI * p[1];
        struct lw_vec3 d = lw_vec3(r * cosf(angle), z, r * sinf(angle));
        even += (double)lw_environment_radiance(&e, d).x * 4 * (double)LW_PI / N;
        if (i & 1) d = lw_environment_importance_sample(&importance, p[0], p[1], &pdf);
        pdf = 0.5f * lw_environment_importance_pdf(&importance, d) + 0.5f / (4 * LW_PI);
        mixed += (double)(lw_environment_radiance(&e, d).x / pdf) / N;
    }
    /* the even directions alone see the sun with a spread of 4 pi 5000 sqrt(its 0.008 of the sphere / N) =
     * 11 */
    assert_true(fabs(mixed / even - 1) < 0.05);
    assert_true(fabs(mixed / (4 * (double)LW_PI * (double)importance.mean) - 1) <
                0.1); /* luminance, not red */
    lw_environment_importance_finish(&importance);
}

static void an_even_environment_has_no_excess(void **state) {
    (void)state;
    float rgb[16 * 8 * 3];
    for (int i = 0; i < 16 * 8 * 3; i++) rgb[i] = 0.7f;
    const struct lw_environment e = {.width = 16, .height = 8, .rgb = rgb};
    struct lw_environment_importance importance;
    lw_support_ok(lw_environment_importance_init(&importance, &e), NULL);
    assert_true(importance.excess == 0 && fabsf(importance.mean - 0.7f) < 1e-6f);
    assert_true(lw_environment_importance_pdf(&importance, lw_vec3(0, 1, 0)) == 0);
    lw_environment_importance_finish(&importance);
    lw_support_ok(lw_environment_importance_init(&importance, &(struct lw_environment){0}), NULL);
    assert_true(importance.excess == 0 && importance.mean == 0);
    lw_environment_importance_finish(&importance);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(columns_go_around),
        cmocka_unit_test(rows_go_down_and_stop_at_the_poles),
        cmocka_unit_test(sky_and_environment_add_up),
        cmocka_unit_test(odd_directions_are_safe),
        cmocka_unit_test(densities_are_what_is_drawn),
        cmocka_unit_test(mixture_is_unbiased),
        cmocka_unit_test(an_even_environment_has_no_excess),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
