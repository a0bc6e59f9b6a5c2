/* Environments from EXR files: values that are no light are cleaned, large pictures filtered down, files that
 * are no EXR refused. */
#include "common/base/random.h"
#include "common/image/image.h"
#include "server/import/images/environment_file.h"
#include "tests/support/support.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static struct lw_scene *empty_scene(void) {
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    return scene;
}

static const char *save(const char *name, const float *rgb, uint32_t width, uint32_t height) {
    struct lw_error err = {0};
    const char *path = lw_support_temporary(name);
    lw_support_ok(lw_image_write_exr(path, rgb, width, height, NULL, &err), &err);
    return path;
}

static void texels_come_as_they_are(void **state) {
    (void)state;
    float rgb[4 * 2 * 3];
    for (int i = 0; i < 24; i++) rgb[i] = 0.5f * (float)i;
    struct lw_scene *scene = empty_scene();
    struct lw_error err = {0};
    lw_support_ok(lw_environment_file_load(scene, save("plain.exr", rgb, 4, 2), &err), &err);
    assert_int_equal(scene->environment.width, 4);
    assert_int_equal(scene->environment.height, 2);
    assert_memory_equal(scene->environment.rgb, rgb, sizeof rgb);
    lw_scene_destroy(scene);
}

static void what_is_no_light_is_clamped(void **state) {
    (void)state;
    float rgb[6 * 3] = {1, 2, 3, NAN, 1, 1, -1, 0, 5, INFINITY, 1, 1, -INFINITY, 1, 1, 2e12f, 1, 1};
    struct lw_scene *scene = empty_scene();
    struct lw_error err = {0};
    lw_support_ok(lw_environment_file_load(scene, save("odd.exr", rgb, 6, 1), &err), &err);
    const float red[6] = {1, 0, 0, 65504, 0, 1e12f};
    for (int i = 0; i < 6; i++) assert_true(scene->environment.rgb[3 * i] == red[i]);
    assert_true(scene->environment.rgb[8] == 5 && scene->environment.rgb[4] == 1);
    scene->name = "odd";
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    lw_scene_destroy(scene);
}

static void refused(const char *path, enum lw_status expected, const char *text) {
    struct lw_scene *scene = empty_scene();
    struct lw_error err = {0};
    lw_support_fails(lw_environment_file_load(scene, path, &err), expected, &err, text);
    assert_int_equal(scene->environment.width, 0);
    lw_scene_destroy(scene);
}

static void what_is_no_environment_is_refused_by_name(void **state) {
    (void)state;
    refused("/nonexistent/sky.exr", LW_NO_INPUT, "/nonexistent/sky.exr");
    const char *text = lw_support_temporary("text.exr");
    lw_support_write_file(text, "#?RADIANCE, say\n", 16);
    refused(text, LW_BAD_DATA, "text.exr");
    /* cut off */
    float rgb[16 * 8 * 3] = {0};
    const char *whole = save("whole.exr", rgb, 16, 8);
    size_t size;
    uint8_t *bytes = lw_support_read_file(whole, &size);
    const char *cut = lw_support_temporary("cut.exr");
    lw_support_write_file(cut, bytes, size - 40);
    free(bytes);
    refused(cut, LW_BAD_DATA, "cut.exr");
}

/* What a picture sends, per channel: the sum of radiance times solid angle. */
static double flux(const float *rgb, uint32_t width, uint32_t height, int channel) {
    double sum = 0;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            sum += (double)rgb[3 * (y * width + x) + (uint32_t)channel] *
                   (cos(acos(-1.0) * y / height) - cos(acos(-1.0) * (y + 1) / height)) * 2 * acos(-1.0) /
                   width;
    return sum;
}

static void the_filter_keeps_the_light(void **state) {
    (void)state;
    enum { W = 23, H = 14 };
    float rgb[W * H * 3], smaller[W * H * 3];
    for (uint32_t i = 0; i < W * H * 3; i++) rgb[i] = lw_random_unit(lw_random_hash(i));
    rgb[3 * (2 * W + 5)] = 900;
    const uint32_t sizes[][2] = {{W, H}, {11, 7}, {8, 4}, {22, 13}, {1, 1}, {23, 2}, {2, 14}};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        lw_environment_file_filter(rgb, W, H, smaller, sizes[k][0], sizes[k][1]);
        for (int c = 0; c < 3; c++) {
            double before = flux(rgb, W, H, c), after = flux(smaller, sizes[k][0], sizes[k][1], c);
            if (fabs(after / before - 1) > 1e-5)
                fail_msg("%u x %u: %g of %g", sizes[k][0], sizes[k][1], after, before);
        }
    }
    /* an even picture stays even */
    for (uint32_t i = 0; i < W * H * 3; i++) rgb[i] = 0.75f;
    lw_environment_file_filter(rgb, W, H, smaller, 9, 5);
    for (uint32_t i = 0; i < 9 * 5 * 3; i++) assert_float_equal(smaller[i], 0.75f, 1e-6f);
}

static void pictures_are_filtered_from_one_past_the_limit(void **state) {
    (void)state;
    for (uint32_t past = 0; past < 2; past++) {
        const uint32_t width = LW_SCENE_ENVIRONMENT_SIDE_MAX + past, height = 3;
        float *rgb = calloc(3ul * width * height, sizeof *rgb);
        assert_non_null(rgb);
        for (uint32_t i = 0; i < 3 * width * height; i++) rgb[i] = lw_random_unit(lw_random_hash(i));
        struct lw_scene *scene = empty_scene();
        struct lw_error err = {0};
        lw_support_ok(lw_environment_file_load(scene, save("wide.exr", rgb, width, height), &err), &err);
        assert_int_equal(scene->environment.width, LW_SCENE_ENVIRONMENT_SIDE_MAX);
        assert_int_equal(scene->environment.height, height);
        double before = flux(rgb, width, height, 1),
               after = flux(scene->environment.rgb, scene->environment.width, height, 1);
        assert_true(fabs(after / before - 1) < 1e-5);
        lw_scene_destroy(scene);
        free(rgb);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(texels_come_as_they_are),
        cmocka_unit_test(what_is_no_light_is_clamped),
        cmocka_unit_test(what_is_no_environment_is_refused_by_name),
        cmocka_unit_test(the_filter_keeps_the_light),
        cmocka_unit_test(pictures_are_filtered_from_one_past_the_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
