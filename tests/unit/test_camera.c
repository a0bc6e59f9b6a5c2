#include "tests/support/support.h"

#include "client/view/camera.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static void assert_vec(struct lw_vec3 v, float x, float y, float z) {
    assert_float_equal(v.x, x, 1e-5f);
    assert_float_equal(v.y, y, 1e-5f);
    assert_float_equal(v.z, z, 1e-5f);
}

static void test_parse(void **state) {
    (void)state;
    struct lw_camera_view view;
    struct lw_error err = {0};
    lw_support_ok(lw_camera_parse("1,2,3:1,2,-7:90", &view, &err), &err);
    assert_vec(view.position, 1, 2, 3);
    assert_vec(view.forward, 0, 0, -1);
    assert_vec(view.right, 1, 0, 0);
    assert_vec(view.up, 0, 1, 0);
    assert_float_equal(view.fov_y, LW_PI / 2, 1e-6f);
    lw_support_ok(lw_camera_parse("0,5,0:0,-1e1,0:1", &view, &err), &err); /* straight down */
    assert_vec(view.forward, 0, -1, 0);
    assert_float_equal(lw_vec3_length(view.right), 1, 1e-5f);
    assert_float_equal(lw_vec3_dot(view.right, view.up), 0, 1e-5f);
}

static void test_parse_names_the_part(void **state) {
    (void)state;
    const struct {
        const char *text, *part;
    } cases[] = {
        {"", "position"},
        {"1,2:3,4,5:60", "position"},
        {"1,2,x:3,4,5:60", "position"},
        {"1,2,3,4:3,4,5:60", "position"},
        {"nan,2,3:3,4,5:60", "position"},
        {"1,2,3", "position"},
        {"1,2,3:4,5", "target"},
        {"1,2,3:4,5,inf:60", "target"},
        {"1,2,3:1,2,3:60", "target"},
        {"1,2,3:4,5,6", "target"},
        {"1,2,3:4,5,6:", "field of view"},
        {"1,2,3:4,5,6:0.9", "field of view"},
        {"1,2,3:4,5,6:179.1", "field of view"},
        {"1,2,3:4,5,6:60 ", "field of view"},
        {"1,2,3:4,5,6:60:1", "field of view"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct lw_error err = {0};
        struct lw_camera_view view;
        assert_int_equal(lw_camera_parse(cases[i].text, &view, &err), LW_USAGE);
        if (strstr(err.text, cases[i].part) == NULL) fail_msg("\"%s\" gave \"%s\"", cases[i].text, err.text);
    }
    struct lw_camera_view view;
    struct lw_error err = {0};
    lw_support_ok(lw_camera_parse("1,2,3:4,5,6:179", &view, &err), &err);
}

static void test_direction(void **state) {
    (void)state;
    struct lw_camera_view view = lw_camera_look_at(lw_vec3(0, 0, 0), lw_vec3(0, 0, -1), LW_PI / 2);
    struct lw_camera_plane plane = lw_camera_plane(&view, 200, 100);
    /* 90 degrees: the picture's upper edge is at 45; twice as wide as high */
    assert_vec(lw_camera_direction(&plane, 100, 50), 0, 0, -1);
    assert_vec(lw_camera_direction(&plane, 100, 0), 0, 1, -1);
    assert_vec(lw_camera_direction(&plane, 0, 50), -2, 0, -1);
    assert_vec(lw_camera_direction(&plane, 200, 100), 2, -1, -1);
}

static struct lw_scene *scene_with_cameras(unsigned count) {
    struct lw_scene *scene = lw_support_squares(1, 4);
    scene->camera = lw_scene_alloc(scene, count, sizeof *scene->camera);
    scene->camera_count = count;
    for (unsigned i = 0; i < count; i++) {
        char name[48];
        snprintf(name, sizeof name, "a camera with a long name, number %u", i);
        scene->camera[i] = (struct lw_camera){.name = lw_scene_string(scene, name), .node = 1, .fov_y = 1.0f};
    }
    return scene;
}

static void test_find(void **state) {
    (void)state;
    struct lw_scene *scene = scene_with_cameras(3);
    struct lw_error err = {0};
    uint32_t camera = 99;
    lw_support_ok(lw_camera_find(scene, "a camera with a long name, number 2", &camera, &err), &err);
    assert_int_equal(camera, 2);
    assert_int_equal(lw_camera_find(scene, "nobody", &camera, &err), LW_USAGE);
    assert_non_null(strstr(err.text, "\"nobody\""));
    for (unsigned i = 0; i < 3; i++) assert_non_null(strstr(err.text, scene->camera[i].name));
    lw_scene_destroy(scene);

    scene = scene_with_cameras(1000); /* more names than a line holds: says how many it leaves out */
    err = (struct lw_error){0};
    assert_int_equal(lw_camera_find(scene, "nobody", &camera, &err), LW_USAGE);
    assert_non_null(strstr(err.text, "more"));
    assert_true(strlen(err.text) < LW_ERROR_TEXT_SIZE - 1);
    lw_scene_destroy(scene);

    scene = lw_support_squares(1, 4);
    err = (struct lw_error){0};
    assert_int_equal(lw_camera_find(scene, "nobody", &camera, &err), LW_USAGE);
    assert_non_null(strstr(err.text, "--camera"));
    lw_scene_destroy(scene);
}

static void test_of_scene(void **state) {
    (void)state;
    struct lw_scene *scene = scene_with_cameras(1);
    /* a quarter turn to the left about +Y: -Z becomes -X; scaled and mirrored, which must not show */
    scene->node[1].translation[0] = 7;
    scene->node[1].rotation[1] = sqrtf(0.5f), scene->node[1].rotation[3] = sqrtf(0.5f);
    scene->node[1].scale[0] = -3, scene->node[1].scale[1] = 2, scene->node[1].scale[2] = 2;
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    struct lw_camera_view view = lw_camera_of_scene(scene, &pose, 0);
    assert_vec(view.position, 7, 2, 0);
    assert_vec(view.forward, -1, 0, 0);
    assert_vec(view.up, 0, 1, 0);
    assert_vec(view.right, 0, 0, -1);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static struct lw_camera_view default_view(struct lw_scene *scene, float aspect) {
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_error err = {0};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &pose, &trace, &err), &err);
    struct lw_camera_view view = lw_camera_default(scene, &pose, trace, aspect);
    lw_trace_destroy(trace);
    lw_pose_finish(&pose);
    return view;
}

static void test_default_from_outside(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(3, 4); /* a row of 20 x 4 m, open to all sides */
    for (float aspect = 0.5f; aspect <= 2.0f; aspect += 0.5f) {
        struct lw_camera_view view = default_view(scene, aspect);
        assert_true(view.position.y > 0);
        for (int i = 0; i < 4; i++) { /* all corners of the bounds are in the picture */
            struct lw_vec3 corner = lw_vec3(i & 1 ? 18.0f : -2.0f, 0, i & 2 ? 2.0f : -2.0f);
            struct lw_vec3 to = lw_vec3_sub(corner, view.position);
            float depth = lw_vec3_dot(to, view.forward), edge = tanf(view.fov_y / 2);
            assert_true(depth > 0);
            assert_true(fabsf(lw_vec3_dot(to, view.up)) < edge * depth);
            assert_true(fabsf(lw_vec3_dot(to, view.right)) < edge * aspect * depth);
        }
    }
    lw_scene_destroy(scene);
}

static void test_default_inside_a_room(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(6, 4); /* six sides of a 4 m cube, facing inwards */
    const float h = sqrtf(0.5f);
    const float place[6][3] = {{0, 0, 0}, {0, 4, 0}, {2, 2, 0}, {-2, 2, 0}, {0, 2, 2}, {0, 2, -2}};
    const float turn[6][4] = {{0, 0, 0, 1},  {1, 0, 0, 0},  {0, 0, h, h},
                              {0, 0, -h, h}, {-h, 0, 0, h}, {h, 0, 0, h}};
    for (int i = 0; i < 6; i++) {
        for (int k = 0; k < 3; k++) scene->node[i].translation[k] = place[i][k];
        for (int k = 0; k < 4; k++) scene->node[i].rotation[k] = turn[i][k];
    }
    struct lw_camera_view view = default_view(scene, 1.5f);
    assert_true(fabsf(view.position.x) < 2 && fabsf(view.position.z) < 2);
    assert_true(view.position.y > 0 && view.position.y < 4);
    /* looks across the room, not at the wall beside it */
    struct lw_vec3 ahead = lw_vec3_mad(view.position, view.forward, 2.0f);
    assert_true(fabsf(ahead.x) < 2 && fabsf(ahead.z) < 2);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_parse),
        cmocka_unit_test(test_parse_names_the_part),
        cmocka_unit_test(test_direction),
        cmocka_unit_test(test_find),
        cmocka_unit_test(test_of_scene),
        cmocka_unit_test(test_default_from_outside),
        cmocka_unit_test(test_default_inside_a_room),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
