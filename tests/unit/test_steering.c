#include "tests/support/support.h"

#include "client/camera/steering.h"

#include <math.h>

enum { GROUND, STEP, WALL };

static struct lw_scene *scene;
static struct lw_pose pose;
static struct lw_trace *trace;

/* A ground of 4 m, a step of 0.3 m beside it at x from 2 m to 6 m, and a wall across that at 5 m. */
static int start(void **state) {
    (void)state;
    struct lw_error err = {0};
    scene = lw_support_squares(3, 4);
    for (int i = 0; i < 3; i++)
        for (int c = 0; c < 3; c++) scene->node[scene->object[i].node].translation[c] = 0;
    scene->node[scene->object[STEP].node].translation[0] = 4;
    scene->node[scene->object[STEP].node].translation[1] = 0.3f;
    struct lw_node *wall = &scene->node[scene->object[WALL].node];
    wall->translation[0] = 5;
    wall->rotation[2] = wall->rotation[3] = sqrtf(0.5f); /* a quarter about Z: it faces -X */
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &pose, &trace, &err), &err);
    return 0;
}

static int stop(void **state) {
    (void)state;
    lw_trace_destroy(trace);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    return 0;
}

static struct lw_steering begin(float x, float y) {
    struct lw_steering s;
    const struct lw_camera_view view = lw_camera_look_at(lw_vec3(x, y, 0), lw_vec3(x + 1, y, 0), 1);
    lw_steering_start(&s, &view, 10, 10);
    return s;
}

static void test_reach(void **state) {
    (void)state;
    assert_float_equal(lw_steering_reach(trace, lw_vec3(0, 3, 0), lw_vec3(0, -2, 0)), 1.5f, 1e-5f);
    assert_true(isinf(lw_steering_reach(trace, lw_vec3(0, 3, 0), lw_vec3(0, 1, 0))));
}

static void test_start(void **state) {
    (void)state;
    struct lw_steering s = begin(0, 1);
    assert_float_equal(s.eye_m, LW_STEERING_EYE_M, 0);
    assert_float_equal(s.flight.speed, 1, 1e-6f);
    const struct lw_camera_view view = lw_flight_view(&s.flight);
    lw_steering_start(&s, &view, 0, 0.5f); /* a doll's house */
    assert_float_equal(s.eye_m, 0.2f, 1e-6f);
    assert_true(s.flight.speed > 0);
}

static void test_walks(void **state) {
    (void)state;
    struct lw_steering s = begin(0, 3);
    lw_steering_set(&s, LW_STEERING_WALK, trace, 10);
    int moves = 0;
    while (lw_steering_move(&s, trace, 0, 0, 0, 0.05f) && moves < 200) moves++; /* down to the ground */
    assert_true(moves > 2 && moves < 200);
    assert_float_equal(s.flight.position.y, LW_STEERING_EYE_M, 1e-3f);
    for (int i = 0; i < 70; i++) lw_steering_move(&s, trace, 0, 1, 1, 0.05f); /* up is no way to walk */
    assert_float_equal(s.flight.position.x, 3.5f, 1e-3f);
    assert_float_equal(s.flight.position.y, LW_STEERING_EYE_M + 0.3f, 0.02f);
    for (int i = 0; i < 100; i++) lw_steering_move(&s, trace, 0, 0, 1, 0.05f); /* against the wall */
    assert_true(s.flight.position.x > 4.5f && s.flight.position.x < 5);
    s.flight.position.x = -7; /* where there is no ground one hovers */
    s.standing = false;
    assert_false(lw_steering_move(&s, trace, 0, 0, 0, 0.05f));
    assert_true(isfinite(s.flight.position.y));
}

static void test_orbits(void **state) {
    (void)state;
    struct lw_steering s = begin(0, 1);
    lw_steering_set(&s, LW_STEERING_ORBIT, trace, 10);
    assert_float_equal(s.distance_m, 5, 1e-4f); /* the wall */
    lw_steering_turn(&s, 0.5f, -0.5f);
    struct lw_camera_view view = lw_flight_view(&s.flight);
    assert_float_equal(lw_vec3_length(lw_vec3_sub(view.position, lw_vec3(5, 1, 0))), 5, 1e-3f);
    lw_steering_wheel(&s, 4);
    view = lw_flight_view(&s.flight);
    assert_float_equal(s.distance_m, 2.5f, 1e-3f);
    assert_float_equal(lw_vec3_length(lw_vec3_sub(view.position, lw_vec3(5, 1, 0))), 2.5f, 1e-3f);
    assert_true(lw_steering_move(&s, trace, 1, 0, -1, 1));
    view = lw_flight_view(&s.flight);
    assert_float_equal(s.distance_m, 5, 1e-3f);
    assert_float_equal(lw_vec3_length(lw_vec3_sub(view.position, lw_vec3(5, 1, 0))), 5, 1e-3f);
    struct lw_steering away = begin(0, 1); /* towards nothing */
    lw_steering_turn(&away, LW_PI, 0);
    lw_steering_set(&away, LW_STEERING_ORBIT, trace, 10);
    assert_float_equal(away.distance_m, 10, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_reach),
        cmocka_unit_test(test_start),
        cmocka_unit_test(test_walks),
        cmocka_unit_test(test_orbits),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
