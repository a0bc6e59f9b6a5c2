#include "tests/support/support.h"

#include "common/scene/builtin.h"

#include <string.h>

static struct lw_scene *build(const char *name) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build(name, &scene, &err), &err);
    return scene;
}

static struct lw_vec3 corner(const struct lw_mesh *mesh, uint32_t triangle, int c) {
    return mesh->position[mesh->triangle[triangle][c]];
}

/** Twice the area, along the front's normal. */
static struct lw_vec3 face(const struct lw_mesh *mesh, uint32_t triangle) {
    struct lw_vec3 a = corner(mesh, triangle, 0);
    return lw_vec3_cross(lw_vec3_sub(corner(mesh, triangle, 1), a),
                         lw_vec3_sub(corner(mesh, triangle, 2), a));
}

static void check_scene(const struct lw_scene *scene, uint32_t triangles_min, uint32_t triangles_max) {
    struct lw_error err = {0};
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    assert_true(lw_scene_has_light(scene));
    uint32_t triangles = 0;
    for (uint32_t o = 0; o < scene->object_count; o++)
        triangles += scene->mesh[scene->object[o].mesh].triangle_count;
    assert_in_range(triangles, triangles_min, triangles_max);
    assert_string_equal(scene->camera[0].name, "main");
}

static void check_normals(const struct lw_scene *scene) {
    uint64_t agree = 0, all = 0;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        for (uint32_t v = 0; v < mesh->vertex_count; v++)
            if (fabsf(lw_vec3_length(mesh->normal[v]) - 1.0f) > 1e-4f)
                fail_msg("%s: normal %u", mesh->name, v);
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            struct lw_vec3 n = face(mesh, t);
            if (lw_vec3_length(n) < 1e-9f) fail_msg("%s: triangle %u has no area", mesh->name, t);
            bool outward = true;
            for (int c = 0; c < 3; c++) outward &= lw_vec3_dot(n, mesh->normal[mesh->triangle[t][c]]) > 0;
            agree += outward;
            all++;
        }
    }
    assert_true((double)agree > 0.999 * (double)all);
}

/** Reflects at most what plaster reflects, whatever texture and factor say together. */
static void check_albedo(const struct lw_scene *scene) {
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            struct lw_surface surface;
            lw_scene_surface(scene, mesh, t, 1 / 3.0f, 1 / 3.0f, &surface);
            float high = fmaxf(surface.albedo.x, fmaxf(surface.albedo.y, surface.albedo.z));
            if (high > 0.86f || high < 0.01f) fail_msg("%s: albedo %g", mesh->name, (double)high);
        }
    }
}

static void test_cornell(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell");
    check_scene(scene, 32, 32);
    check_normals(scene);
    check_albedo(scene);
    assert_int_equal(scene->object_count, 8);
    assert_true(scene->duration_s == 0);
    lw_scene_destroy(scene);
}

static void test_cornell_faces_inward(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell");
    struct lw_vec3 middle = lw_vec3(0, 1, 0);
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        bool block = strstr(scene->object[o].name, "block") != NULL;
        for (uint32_t t = 0; t < mesh->triangle_count && !block; t++)
            assert_true(lw_vec3_dot(face(mesh, t), lw_vec3_sub(middle, corner(mesh, t, 0))) > 0);
    }
    lw_scene_destroy(scene);
}

static void test_unknown_name_lists_the_names(void **state) {
    (void)state;
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    assert_int_equal(lw_builtin_build("builtin:teapot", &scene, &err), LW_NO_INPUT);
    assert_null(scene);
    assert_non_null(strstr(err.text, "builtin:teapot"));
    unsigned count = 0;
    for (; lw_builtin_name(count); count++) {
        assert_non_null(strstr(err.text, lw_builtin_name(count)));
        assert_true(strlen(lw_builtin_about(count)) > 0);
    }
    assert_true(count >= 1);
    assert_null(lw_builtin_about(count));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cornell),
        cmocka_unit_test(test_cornell_faces_inward),
        cmocka_unit_test(test_unknown_name_lists_the_names),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
