/* Opening scenes with an environment: the EXR is read by the importer's process, for scene files and for
 * packages. */
#include "common/image/image.h"
#include "common/open/scene_open.h"
#include "common/scene/package.h"
#include "tests/support/support.h"

#include <math.h>
#include <string.h>

static const char *save_environment(const char *name, float value) {
    float rgb[8 * 4 * 3];
    for (int i = 0; i < 8 * 4 * 3; i++) rgb[i] = value;
    struct lw_error err = {0};
    const char *path = lw_support_temporary(name);
    lw_support_ok(lw_image_write_exr(path, rgb, 8, 4, NULL, &err), &err);
    return path;
}

static void with_an_environment(void **state) {
    (void)state;
    struct lw_scene_open open = {.path = "builtin:cornell",
                                 .texels_per_metre = 2,
                                 .sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG,
                                 .environment = save_environment("sky.exr", 1.5f)};
    struct lw_scene *scene, *again;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_open(&open, &scene, &err), &err);
    assert_int_equal(scene->environment.width, 8);
    assert_int_equal(scene->environment.height, 4);
    assert_true(scene->environment.rgb[5] == 1.5f);
    const char *package = lw_support_temporary("with.lwscene");
    lw_support_ok(lw_package_save(scene, package, &err), &err);

    /* a package has its environment; another one replaces it and leaves the lightmaps alone */
    open.path = package;
    open.environment = NULL;
    open.texels_per_metre = 0;
    lw_support_ok(lw_scene_open(&open, &again, &err), &err);
    assert_true(again->environment.rgb[5] == 1.5f);
    lw_scene_destroy(again);
    open.environment = save_environment("other.exr", 4);
    lw_support_ok(lw_scene_open(&open, &again, &err), &err);
    assert_true(again->environment.rgb[5] == 4);
    assert_int_equal(again->mesh_count, scene->mesh_count);
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        assert_int_equal(again->mesh[m].atlas_width, scene->mesh[m].atlas_width);
        assert_memory_equal(again->mesh[m].lightmap_uv, scene->mesh[m].lightmap_uv,
                            scene->mesh[m].vertex_count * sizeof(struct lw_vec2));
    }
    lw_scene_destroy(again);
    lw_scene_destroy(scene);
}

static void failures_name_the_environment(void **state) {
    (void)state;
    struct lw_scene_open open = {.path = "builtin:cornell",
                                 .texels_per_metre = 2,
                                 .sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG,
                                 .environment = "/nonexistent/sky.exr"};
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_fails(lw_scene_open(&open, &scene, &err), LW_NO_INPUT, &err, "/nonexistent/sky.exr");
    open.environment = lw_support_source("README.md");
    err = (struct lw_error){0};
    lw_support_fails(lw_scene_open(&open, &scene, &err), LW_BAD_DATA, &err, "README.md");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(with_an_environment),
        cmocka_unit_test(failures_name_the_environment),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
