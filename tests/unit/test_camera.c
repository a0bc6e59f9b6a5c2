#include "tests/support/support.h"

#include "client/camera/camera.h"
#include "client/paths/camera_default.h"

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

/* A written view is read as the same view, near the origin and far from it. */
static void test_format(void **state) {
    (void)state;
    static const struct lw_vec3 place[] = {{0, 0, 0}, {1, 2, 3}, {-1234.5f, 0.02f, 4000}};
    for (size_t i = 0; i < 30; i++) {
        const float yaw = 0.7f * (float)i, pitch = 1.4f * sinf((float)i);
        const struct lw_vec3 way = lw_vec3(sinf(yaw) * cosf(pitch), sinf(pitch), -cosf(yaw) * cosf(pitch));
        const struct lw_vec3 from = place[i % 3];
        const struct lw_camera_view view =
            lw_camera_look_at(from, lw_vec3_add(from, lw_vec3_scale(way, 1e4f)), 0.9f);
        struct lw_camera_view again;
        struct lw_error err = {0};
        char text[LW_CAMERA_TEXT_SIZE];
        lw_camera_format(&view, text);
        lw_support_ok(lw_camera_parse(text, &again, &err), &err);
        assert_true(lw_vec3_length(lw_vec3_sub(again.position, view.position)) < 1e-3f);
        assert_true(lw_vec3_length(lw_vec3_sub(again.forward, view.forward)) < 2e-4f);
        assert_float_equal(again.fov_y, view.fov_y, 1e-4f);
    }
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

/* Rays of an orthographic view are parallel, and a pixel is as large at every depth. */
static void test_parallel(void **state) {
    (void)state;
    struct lw_camera_view view, again;
    struct lw_error err = {0};
    char text[LW_CAMERA_TEXT_SIZE];
    lw_support_ok(lw_camera_parse("1,2,3:1,2,0:10m", &view, &err), &err);
    struct lw_camera_plane plane = lw_camera_plane(&view, 200, 100);
    const float corner[][2] = {{100, 50}, {0, 0}, {200, 100}};
    const float at[][3] = {{1, 2, 3}, {-9, 7, 3}, {11, -3, 3}};
    for (int i = 0; i < 3; i++) {
        assert_vec(lw_camera_direction(&plane, corner[i][0], corner[i][1]), 0, 0, -1);
        assert_vec(lw_camera_origin(&plane, corner[i][0], corner[i][1]), at[i][0], at[i][1], at[i][2]);
    }
    assert_float_equal(lw_camera_pixel_at(&plane, 1), 0.1f, 1e-7f);
    assert_float_equal(lw_camera_pixel_at(&plane, 77), 0.1f, 1e-7f);
    lw_camera_format(&view, text);
    lw_support_ok(lw_camera_parse(text, &again, &err), &err);
    assert_float_equal(again.height_m, 10, 1e-4f);
    lw_support_fails(lw_camera_parse("1,2,3:1,2,0:0m", &again, &err), LW_USAGE, &err, "must be above 0 m");
    err = (struct lw_error){0};
    lw_support_fails(lw_camera_parse("1,2,3:1,2,0:4mm", &again, &err), LW_USAGE, &err,
                     "height: \"m\" is too much");
    view = lw_camera_look_at(lw_vec3(1, 2, 3), lw_vec3(1, 2, 0), LW_PI / 2);
    plane = lw_camera_plane(&view, 200, 100);
    assert_vec(lw_camera_origin(&plane, 0, 100), 1, 2, 3);
    assert_float_equal(lw_camera_pixel_at(&plane, 10), 0.2f, 1e-6f);
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

/* ---- the default view ---- */

static struct lw_camera_view default_view(struct lw_scene *scene, float aspect) {
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_error err = {0};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &pose, &trace, &err), &err);
    struct lw_camera_view view = lw_camera_default(scene, &pose, trace, aspect);
    struct lw_camera_view again = lw_camera_default(scene, &pose, trace, aspect);
    assert_memory_equal(&view, &again, sizeof view);
    assert_float_equal(lw_vec3_length(view.forward), 1, 1e-5f);
    lw_trace_destroy(trace);
    lw_pose_finish(&pose);
    return view;
}

/* Which way squares face once they are turned, from +Y: a cube's top, bottom, left, right, back, front. */
static const struct lw_vec3 facing[6] = {{0, 1, 0}, {0, -1, 0}, {-1, 0, 0}, {1, 0, 0}, {0, 0, -1}, {0, 0, 1}};
static void turn(struct lw_node *node, int side) {
    const float h = sqrtf(0.5f);
    const float rotation[6][4] = {{0, 0, 0, 1},  {1, 0, 0, 0},  {0, 0, h, h},
                                  {0, 0, -h, h}, {-h, 0, 0, h}, {h, 0, 0, h}};
    memcpy(node->rotation, rotation[side], sizeof node->rotation);
}

static void move(struct lw_node *node, struct lw_vec3 to) {
    node->translation[0] = to.x;
    node->translation[1] = to.y;
    node->translation[2] = to.z;
}

/* Puts squares of a scene together as sides of a cube that face outwards, or inwards. */
static void make_cube(struct lw_scene *scene, uint32_t first, uint32_t count, struct lw_vec3 centre,
                      float side_m, bool inwards) {
    for (uint32_t i = 0; i < count; i++) {
        turn(&scene->node[first + i], (int)i);
        move(&scene->node[first + i],
             lw_vec3_mad(centre, facing[i], inwards ? -0.5f * side_m : 0.5f * side_m));
    }
}

/* How much of the picture's width or height a box takes, whichever is more; all of it must be in the
 * picture. */
static float extent_of(const struct lw_camera_view *view, float aspect, struct lw_vec3 low,
                       struct lw_vec3 high) {
    float left = 1, right = -1, bottom = 1, top = -1, edge = tanf(view->fov_y / 2);
    for (int i = 0; i < 8; i++) {
        struct lw_vec3 corner =
            lw_vec3(i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z);
        struct lw_vec3 to = lw_vec3_sub(corner, view->position);
        float depth = lw_vec3_dot(to, view->forward);
        assert_true(depth > 0);
        float x = lw_vec3_dot(to, view->right) / (depth * edge * aspect),
              y = lw_vec3_dot(to, view->up) / (depth * edge);
        assert_true(fabsf(x) < 1 && fabsf(y) < 1);
        left = fminf(left, x), right = fmaxf(right, x);
        bottom = fminf(bottom, y), top = fmaxf(top, y);
    }
    return 0.5f * fmaxf(right - left, top - bottom);
}

static void test_default_from_outside(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(3, 4); /* a row of 20 x 4 m, open to all sides */
    for (float aspect = 0.5f; aspect <= 2.0f; aspect += 0.5f) {
        struct lw_camera_view view = default_view(scene, aspect);
        assert_true(view.position.y > 1); /* in front of the squares, not on edge */
        assert_in_range(extent_of(&view, aspect, lw_vec3(-2, 0, -2), lw_vec3(18, 0, 2)) * 100, 80, 100);
    }
    lw_scene_destroy(scene);
}

static void test_default_fits_any_size(void **state) {
    (void)state;
    for (float side_m = 1e-3f; side_m < 1e6f; side_m *= 100) {
        struct lw_scene *scene = lw_support_squares(6, side_m);
        struct lw_vec3 centre = lw_vec3(3 * side_m, side_m, -side_m), half = lw_vec3(side_m, side_m, side_m);
        half = lw_vec3_scale(half, 0.5f);
        make_cube(scene, 0, 6, centre, side_m, false);
        scene->sky[0] = scene->sky[1] = scene->sky[2] = 1;
        for (float aspect = 0.5f; aspect <= 2.0f; aspect += 0.5f) {
            struct lw_camera_view view = default_view(scene, aspect);
            float extent = extent_of(&view, aspect, lw_vec3_sub(centre, half), lw_vec3_add(centre, half));
            assert_in_range(extent * 100, 80, 100);
            int sides = 0; /* visible ones */
            for (int i = 0; i < 6; i++) {
                struct lw_vec3 from = lw_vec3_mad(centre, facing[i], 0.5f * side_m);
                sides += lw_vec3_dot(lw_vec3_sub(view.position, from), facing[i]) > 0;
            }
            assert_int_equal(sides, 3);
            assert_true(view.position.y > centre.y);
        }
        lw_scene_destroy(scene);
    }
}

static void test_default_inside_a_closed_room(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(6, 4);
    make_cube(scene, 0, 6, lw_vec3(0, 2, 0), 4, true);
    struct lw_camera_view view = default_view(scene, 1.5f);
    assert_true(fabsf(view.position.x) < 2 && fabsf(view.position.z) < 2);
    assert_true(view.position.y > 1 && view.position.y < 3);
    assert_float_equal(view.right.y, 0, 1e-5f);
    /* looks across the room, not at the wall beside it */
    struct lw_vec3 ahead = lw_vec3_mad(view.position, view.forward, 2.0f);
    assert_true(fabsf(ahead.x) < 2 && fabsf(ahead.z) < 2);
    lw_scene_destroy(scene);
}

static void test_default_into_an_open_room(void **state) {
    (void)state;
    /* A side is taken out of the room: one that faces -X, which is at its right. */
    struct lw_scene *scene = lw_support_squares(6, 4);
    make_cube(scene, 0, 6, lw_vec3(0, 2, 0), 4, true);
    scene->object[2] = scene->object[--scene->object_count];
    for (int both = 0; both < 2; both++) { /* whether or not the walls' outer sides can be seen */
        scene->material[0].double_sided = both != 0;
        struct lw_camera_view view = default_view(scene, 16.0f / 9);
        assert_true(view.position.x > 2 && view.forward.x < -0.8f);
        assert_in_range(extent_of(&view, 16.0f / 9, lw_vec3(-2, 0, -2), lw_vec3(2, 4, 2)) * 100, 80, 100);
    }
    lw_scene_destroy(scene);
}

static void test_default_sees_fronts(void **state) {
    (void)state;
    for (int side = 0; side < 6; side++) {
        struct lw_scene *scene = lw_support_squares(1, 4);
        turn(&scene->node[0], side);
        scene->sky[0] = scene->sky[1] = scene->sky[2] = 1;
        struct lw_camera_view view = default_view(scene, 1);
        assert_true(lw_vec3_dot(view.position, facing[side]) > 1);
        lw_scene_destroy(scene);
    }
}

static void test_default_sees_the_lit_side(void **state) {
    (void)state;
    for (float z = -5; z <= 5; z += 10) {
        struct lw_scene *scene = lw_support_squares(1, 4);
        turn(&scene->node[0], 5);
        scene->material[0].double_sided = true;
        struct lw_vec3 lamp = lw_vec3(1, 1, z);
        move(&scene->node[1], lamp);
        struct lw_camera_view view = default_view(scene, 1);
        assert_true(view.position.z * z > 0);
        lw_scene_destroy(scene);
    }
}

static void test_default_finds_what_stands_on_wide_ground(void **state) {
    (void)state;
    /* Twenty cubes of 2 m in 10 x 8 m, and a kilometre of ground. */
    struct lw_scene *scene = lw_support_squares(121, 2);
    for (uint32_t i = 0; i < 20; i++)
        make_cube(scene, 6 * i, 6, lw_vec3(100 + 2.5f * (float)(i % 4), 1, 50 + 2.5f * (float)(i / 4)), 2,
                  false);
    move(&scene->node[120], lw_vec3(0, 0, 0));
    for (int i = 0; i < 3; i++) scene->node[120].scale[i] = 500;
    scene->sky[0] = scene->sky[1] = scene->sky[2] = 1;
    struct lw_camera_view view = default_view(scene, 1.5f);
    assert_in_range(extent_of(&view, 1.5f, lw_vec3(99, 0, 49), lw_vec3(108.5f, 2, 61)) * 100, 50, 100);
    lw_scene_destroy(scene);
}

static void test_default_of_nothing(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 4);
    scene->object_count = 0;
    struct lw_camera_view view = default_view(scene, 1);
    assert_true(lw_vec3_is_finite(view.position));
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_format),
        cmocka_unit_test(test_parse),
        cmocka_unit_test(test_parse_names_the_part),
        cmocka_unit_test(test_direction),
        cmocka_unit_test(test_parallel),
        cmocka_unit_test(test_find),
        cmocka_unit_test(test_of_scene),
        cmocka_unit_test(test_default_from_outside),
        cmocka_unit_test(test_default_fits_any_size),
        cmocka_unit_test(test_default_inside_a_closed_room),
        cmocka_unit_test(test_default_into_an_open_room),
        cmocka_unit_test(test_default_sees_fronts),
        cmocka_unit_test(test_default_sees_the_lit_side),
        cmocka_unit_test(test_default_finds_what_stands_on_wide_ground),
        cmocka_unit_test(test_default_of_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
