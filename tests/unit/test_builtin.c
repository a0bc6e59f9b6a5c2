#include "tests/support/support.h"

#include "common/scene/builtin.h"
#include "common/scene/package.h"
#include "common/scene/pose.h"

#include <stdlib.h>
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

static void test_atrium(void **state) {
    const struct lw_scene *scene = *state;
    check_scene(scene, 250000, 350000);
    check_normals(scene);
    check_albedo(scene);
    assert_in_range(scene->object_count, 19, 25);
    size_t texture_bytes = 0;
    for (uint32_t i = 0; i < scene->texture_count; i++)
        texture_bytes += (size_t)scene->texture[i].width * scene->texture[i].height * 4;
    assert_in_range(texture_bytes, 1, 16u << 20);
    static const char *const cameras[] = {"main", "gallery", "vase", "lamp"};
    assert_int_equal(scene->camera_count, 4);
    for (int i = 0; i < 4; i++) assert_string_equal(scene->camera[i].name, cameras[i]);
    assert_int_equal(scene->light_count, 1);
    assert_int_equal(scene->light[0].kind, LW_LIGHT_DIRECTIONAL);
}

static uint32_t find_object(const struct lw_scene *scene, const char *name) {
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (strcmp(scene->object[o].name, name) == 0) return o;
    fail_msg("no object %s", name);
    return 0;
}

static void test_atrium_has_what_it_promises(void **state) {
    const struct lw_scene *scene = *state;
    static const char *const names[] = {"floor",        "lower columns", "lower arcade", "red cloth",
                                        "plants",       "amphora",       "krater",       "jar",
                                        "hanging lamp", "lantern",       "armillary"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) find_object(scene, names[i]);
    unsigned masked = 0, emissive = 0;
    for (uint32_t i = 0; i < scene->material_count; i++) {
        masked += scene->material[i].alpha_mode == LW_ALPHA_MASK;
        emissive += scene->material[i].emission[0] > 0;
    }
    assert_int_equal(masked, 2);
    assert_int_equal(emissive, 2);
}

/** Whether any entry of two transforms differs by more than `tolerance`. */
static bool differ(const struct lw_affine *a, const struct lw_affine *b, float tolerance) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++)
            if (fabsf(a->m[i][j] - b->m[i][j]) > tolerance) return true;
    return false;
}

static void test_atrium_moves_lantern_and_rings_alone(void **state) {
    const struct lw_scene *scene = *state;
    struct lw_pose at_start, later;
    lw_support_ok(lw_pose_init(&at_start, scene), NULL);
    lw_support_ok(lw_pose_init(&later, scene), NULL);
    lw_pose_evaluate(&later, scene, 0.2 * (double)scene->duration_s);
    uint32_t lantern = find_object(scene, "lantern"), rings = find_object(scene, "armillary");
    for (uint32_t o = 0; o < scene->object_count; o++) {
        bool expected = o == lantern || o == rings;
        assert_int_equal(lw_pose_object_moves(&at_start, scene, o), expected);
        assert_int_equal(differ(&at_start.object_to_world[o], &later.object_to_world[o], 0.1f), expected);
    }
    lw_pose_finish(&at_start);
    lw_pose_finish(&later);
}

/* Neither a key nor the end of the loop may be felt: at 240 steps a second no step is longer than 4 m/s allow, and no
 * speed changes faster than 8 m/s^2. */
static void test_atrium_loop_is_smooth(void **state) {
    const struct lw_scene *scene = *state;
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_true(scene->duration_s == 20.0f);
    const int rate = 240, steps = rate * 20;
    uint32_t moving[2] = {find_object(scene, "lantern"), find_object(scene, "armillary")};
    for (int m = 0; m < 2; m++) {
        struct lw_vec3 before = {0, 0, 0}, speed_before = {0, 0, 0};
        for (int i = 0; i <= steps + rate; i++) { /* a second into the next round */
            lw_pose_evaluate(&pose, scene, (double)i / rate);
            struct lw_vec3 at = lw_affine_point(&pose.object_to_world[moving[m]], lw_vec3(0.3f, 0, 0.3f));
            struct lw_vec3 speed = lw_vec3_scale(lw_vec3_sub(at, before), (float)rate);
            if (i > 0) assert_true(lw_vec3_length(speed) < 4.0f);
            if (i > 1) assert_true(lw_vec3_length(lw_vec3_sub(speed, speed_before)) * (float)rate < 8.0f);
            before = at;
            speed_before = speed;
        }
    }
    lw_pose_finish(&pose);
}

static void test_same_bytes_every_time(void **state) {
    (void)state;
    for (unsigned i = 0; lw_builtin_name(i); i++) {
        uint8_t *bytes[2];
        size_t size[2];
        for (int k = 0; k < 2; k++) {
            struct lw_scene *scene = build(lw_builtin_name(i));
            struct lw_error err = {0};
            lw_support_ok(lw_package_write(scene, &bytes[k], &size[k], &err), &err);
            lw_scene_destroy(scene);
        }
        assert_int_equal(size[0], size[1]);
        assert_memory_equal(bytes[0], bytes[1], size[0]);
        free(bytes[0]);
        free(bytes[1]);
    }
}

static unsigned allocations_left = UINT32_MAX; /* before the one that fails */
void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *old, size_t size);
static bool allowed(void) {
    if (allocations_left == UINT32_MAX) return true;
    return allocations_left-- > 0; /* after the failure it has wrapped: all others succeed */
}
void *__wrap_malloc(size_t size) { return allowed() ? __real_malloc(size) : NULL; }
void *__wrap_calloc(size_t count, size_t size) { return allowed() ? __real_calloc(count, size) : NULL; }
void *__wrap_realloc(void *old, size_t size) { return allowed() ? __real_realloc(old, size) : NULL; }

/** Builds with one failing allocation, after `before` good ones. Returns false if the build needs no more than those. */
static bool fails_after(const char *name, unsigned before) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    allocations_left = before;
    enum lw_status status = lw_builtin_build(name, &scene, &err);
    bool failed = allocations_left == UINT32_MAX;
    allocations_left = UINT32_MAX;
    assert_int_equal(status, failed ? LW_NO_MEMORY : LW_OK);
    if (failed) {
        assert_null(scene);
        assert_non_null(strstr(err.text, "memory"));
    }
    lw_scene_destroy(scene);
    return failed;
}

/* Every allocation of the small scene fails in turn, and some of the large one's, which takes its time. */
static void test_out_of_memory(void **state) {
    (void)state;
    unsigned enough = 0;
    while (fails_after("builtin:cornell", enough)) enough++;
    assert_in_range(enough, 10, 1000);
    static const unsigned stops[] = {0, 4, 4000};
    for (size_t i = 0; i < sizeof stops / sizeof *stops; i++)
        assert_true(fails_after("builtin:atrium", stops[i]));
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
    struct lw_scene *atrium = build("builtin:atrium");
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cornell),
        cmocka_unit_test(test_cornell_faces_inward),
        cmocka_unit_test_prestate(test_atrium, atrium),
        cmocka_unit_test_prestate(test_atrium_has_what_it_promises, atrium),
        cmocka_unit_test_prestate(test_atrium_moves_lantern_and_rings_alone, atrium),
        cmocka_unit_test_prestate(test_atrium_loop_is_smooth, atrium),
        cmocka_unit_test(test_same_bytes_every_time),
        cmocka_unit_test(test_out_of_memory),
        cmocka_unit_test(test_unknown_name_lists_the_names),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    lw_scene_destroy(atrium);
    return failed;
}
