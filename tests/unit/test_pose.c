#include "tests/support/support.h"

#include "common/base/clock.h"
#include "common/scene/pose.h"

#include <string.h>

#define TOLERANCE 1e-5f
#define HALF_ROOT 0.70710678f /* sine and cosine of 45 degrees */

#define assert_near(a, b) assert_float_equal(a, b, TOLERANCE)

static void assert_point(struct lw_vec3 p, float x, float y, float z) {
    assert_near(p.x, x);
    assert_near(p.y, y);
    assert_near(p.z, z);
}

/* One object on the last of `count` nodes, and that many channels. */
static struct lw_scene *build(const struct lw_node *nodes, uint32_t count, const struct lw_channel *channels,
                              uint32_t channel_count, float duration_s) {
    struct lw_scene *scene = lw_support_squares(1, 1);
    scene->node = lw_scene_alloc(scene, count, sizeof *nodes);
    scene->channel = lw_scene_alloc(scene, channel_count, sizeof *channels);
    assert_non_null(scene->node);
    assert_non_null(scene->channel);
    memcpy(scene->node, nodes, count * sizeof *nodes);
    if (channel_count) memcpy(scene->channel, channels, channel_count * sizeof *channels);
    scene->node_count = count;
    scene->channel_count = channel_count;
    scene->object[0].node = scene->light[0].node = count - 1;
    scene->duration_s = duration_s;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    return scene;
}

/* Where the object's point p is at a time. */
static struct lw_vec3 point_at(const struct lw_scene *scene, double time_s, struct lw_vec3 p) {
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_pose_evaluate(&pose, scene, time_s);
    p = lw_affine_point(&pose.object_to_world[0], p);
    lw_pose_finish(&pose);
    return p;
}

static const struct lw_node still = {
    .name = "", .parent = LW_SCENE_NONE, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};

static void scale_comes_before_rotation_before_translation(void **state) {
    (void)state;
    struct lw_node node = still;
    memcpy(node.translation, (float[]){10, 20, 30}, sizeof node.translation);
    memcpy(node.rotation, (float[]){0, 0, HALF_ROOT, HALF_ROOT},
           sizeof node.rotation); /* 90 degrees about z */
    memcpy(node.scale, (float[]){2, 3, 4}, sizeof node.scale);
    struct lw_scene *scene = build(&node, 1, NULL, 0, 0);
    /* (1, 1, 1) scaled is (2, 3, 4); x turns to y and y to -x: (-3, 2, 4) */
    assert_point(point_at(scene, 0, lw_vec3(1, 1, 1)), 7, 22, 34);
    lw_scene_destroy(scene);
}

static void quaternions_turn_as_they_should_about_every_axis(void **state) {
    (void)state;
    const struct {
        float rotation[4];
        struct lw_vec3 from, to;
    } turns[] = {
        {{HALF_ROOT, 0, 0, HALF_ROOT}, {0, 1, 0}, {0, 0, 1}},
        {{0, HALF_ROOT, 0, HALF_ROOT}, {0, 0, 1}, {1, 0, 0}},
        {{0, 0, HALF_ROOT, HALF_ROOT}, {1, 0, 0}, {0, 1, 0}},
        {{0.5f, 0.5f, 0.5f, 0.5f},
         {1, 0, 0},
         {0, 1, 0}}, /* 120 degrees about (1, 1, 1): x to y, y to z, z to x */
        {{0.5f, 0.5f, 0.5f, 0.5f}, {0, 1, 0}, {0, 0, 1}},
        {{0.5f, 0.5f, 0.5f, 0.5f}, {0, 0, 1}, {1, 0, 0}},
    };
    for (size_t i = 0; i < sizeof turns / sizeof *turns; i++) {
        struct lw_node node = still;
        memcpy(node.rotation, turns[i].rotation, sizeof node.rotation);
        struct lw_scene *scene = build(&node, 1, NULL, 0, 0);
        assert_point(point_at(scene, 0, turns[i].from), turns[i].to.x, turns[i].to.y, turns[i].to.z);
        lw_scene_destroy(scene);
    }
}

static void parents_carry_children_and_mirrors_mirror(void **state) {
    (void)state;
    struct lw_node nodes[3] = {still, still, still};
    nodes[0].translation[1] = 5;
    nodes[1].parent = 0;
    nodes[1].has_matrix = 1;
    nodes[1].matrix = (struct lw_affine){{{-1, 0, 0, 1}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    nodes[2].parent = 1;
    nodes[2].translation[0] = 3;
    struct lw_scene *scene = build(nodes, 3, NULL, 0, 0);
    /* (1, 2, 3) moves to (4, 2, 3), is mirrored to (-3, 2, 3), and is lifted by 5 */
    assert_point(point_at(scene, 0, lw_vec3(1, 2, 3)), -3, 7, 3);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_near(lw_affine_determinant(&pose.object_to_world[0]), -1);
    /* a light in a mirror shines the mirrored way: its -z is kept by a mirror in x, its place is not */
    assert_point(pose.light[0].position_ws, -2, 5, 0);
    assert_point(pose.light[0].direction_ws, 0, 0, -1);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void lights_and_cameras_look_along_minus_z(void **state) {
    (void)state;
    struct lw_node node = still;
    memcpy(node.translation, (float[]){1, 2, 3}, sizeof node.translation);
    memcpy(node.rotation, (float[]){-HALF_ROOT, 0, 0, HALF_ROOT},
           sizeof node.rotation); /* -90 degrees about x */
    memcpy(node.scale, (float[]){3, 3, 3}, sizeof node.scale);
    struct lw_scene *scene = build(&node, 1, NULL, 0, 0);
    scene->light[0].intensity[1] = 7;
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_point(pose.light[0].position_ws, 1, 2, 3);
    assert_point(pose.light[0].direction_ws, 0, -1, 0); /* unit in spite of the scale: straight down */
    assert_point(pose.light[0].intensity, 10, 7, 10);   /* and as strong */
    /* a camera there: looks down, and its up is -z */
    assert_point(lw_affine_vector(&pose.node_to_world[0], lw_vec3(0, 0, -1)), 0, -3, 0);
    assert_point(lw_affine_vector(&pose.node_to_world[0], lw_vec3(0, 1, 0)), 0, 0, -3);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void steps_hold_and_lines_are_straight(void **state) {
    (void)state;
    static const float times[] = {1, 2, 4}, values[] = {10, 0, 0, 20, 0, 0, 40, 8, 0};
    struct lw_channel channel = {0, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_STEP, 3, times, values};
    const struct {
        double time_s;
        float step, linear;
    } samples[] = {{0, 10, 10}, {0.5, 10, 10}, {1, 10, 10},    {1.5, 10, 15}, {1.999, 10, 19.99f},
                   {2, 20, 20}, {3, 20, 30},   {3.5, 20, 35},  {4, 40, 40},   {4.5, 40, 40},
                   {5, 10, 10}, {6.5, 10, 15}, {-3.5, 10, 15}, {-1, 40, 40},  {5e6 + 3, 20, 30}};
    for (size_t i = 0; i < sizeof samples / sizeof *samples; i++) {
        channel.interpolation = LW_INTERPOLATION_STEP;
        struct lw_scene *scene = build(&still, 1, &channel, 1, 5);
        assert_near(point_at(scene, samples[i].time_s, lw_vec3(0, 0, 0)).x, samples[i].step);
        lw_scene_destroy(scene);
        channel.interpolation = LW_INTERPOLATION_LINEAR;
        scene = build(&still, 1, &channel, 1, 5);
        assert_near(point_at(scene, samples[i].time_s, lw_vec3(0, 0, 0)).x, samples[i].linear);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = build(&still, 1, &channel, 1, 5);
    assert_point(point_at(scene, 3, lw_vec3(0, 0, 0)), 30, 4, 0);
    assert_point(point_at(scene, (double)NAN, lw_vec3(0, 0, 0)), 10, 0, 0); /* time 0 */
    assert_point(point_at(scene, (double)INFINITY, lw_vec3(0, 0, 0)), 10, 0, 0);
    assert_point(point_at(scene, -1e-300, lw_vec3(0, 0, 0)), 10, 0,
                 0); /* wraps to the duration, which is 0 again */
    scene->duration_s = 0;
    assert_point(point_at(scene, 3, lw_vec3(0, 0, 0)), 10, 0, 0); /* no animation: rests at time 0 */
    lw_scene_destroy(scene);
}

/* At a quarter of a turn of `degrees` about z, x points a quarter of the angle up. */
static void linear_rotations_turn_evenly_the_shorter_way(void **state) {
    (void)state;
    static const float degrees[] = {170, 90, 10, 1, 0.01f, -120, 200};
    static const float times[] = {0, 4};
    for (size_t i = 0; i < sizeof degrees / sizeof *degrees; i++) {
        for (int sign = -1; sign <= 1; sign += 2) { /* q and -q are the same rotation */
            float half = degrees[i] * LW_PI / 360, s = (float)sign;
            float values[] = {0, 0, 0, 1, 0, 0, s * sinf(half), s * cosf(half)};
            struct lw_channel channel = {0, LW_CHANNEL_ROTATION, LW_INTERPOLATION_LINEAR, 2, times, values};
            struct lw_scene *scene = build(&still, 1, &channel, 1, 8);
            float shorter = degrees[i] > 180 ? degrees[i] - 360 : degrees[i];
            for (int quarter = 0; quarter <= 4; quarter++) {
                float angle = shorter * LW_PI / 180 * (float)quarter / 4;
                assert_point(point_at(scene, quarter, lw_vec3(1, 0, 0)), cosf(angle), sinf(angle), 0);
            }
            lw_scene_destroy(scene);
        }
    }
}

/* A Hermite spline through samples of a cubic with the cubic's own tangents is that cubic, whatever the
 * intervals. */
static float cubic(float t) { return t * t * t - 2 * t * t + 3 * t - 4; }
static float cubic_slope(float t) { return 3 * t * t - 4 * t + 3; }

static void cubic_splines_reproduce_a_cubic(void **state) {
    (void)state;
    static const float times[] = {0.5f, 1, 3};
    float values[3 * 9] = {0};
    for (int k = 0; k < 3; k++) {
        values[9 * k + 1] = values[9 * k + 7] = cubic_slope(times[k]);
        values[9 * k + 4] = cubic(times[k]);
    }
    struct lw_channel channel = {0, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_CUBIC, 3, times, values};
    struct lw_scene *scene = build(&still, 1, &channel, 1, 10);
    for (float t = 0.5f; t <= 3; t += 0.125f)
        assert_float_equal(point_at(scene, (double)t, lw_vec3(0, 0, 0)).y, cubic(t), 1e-4f);
    assert_near(point_at(scene, 0, lw_vec3(0, 0, 0)).y, cubic(0.5f));
    assert_near(point_at(scene, 7, lw_vec3(0, 0, 0)).y, cubic(3));
    lw_scene_destroy(scene);
}

static void in_tangents_and_out_tangents_are_reported_apart(void **state) {
    (void)state;
    static const float times[] = {0, 2};
    /* in-tangent, value, out-tangent of each key; the outer two must not matter */
    static const float values[] = {99, 99, 99, 0, 0, 0, 1, 0, 0, 0, 4, 0, 0, 0, 0, 99, 99, 99};
    struct lw_channel channel = {0, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_CUBIC, 2, times, values};
    struct lw_scene *scene = build(&still, 1, &channel, 1, 4);
    /* at the middle the tangents weigh +1/8 and -1/8, times the interval of 2 s */
    assert_point(point_at(scene, 1, lw_vec3(0, 0, 0)), 0.25f, -1, 0);
    lw_scene_destroy(scene);
}

static void cubic_rotations_are_unit_and_scales_scale(void **state) {
    (void)state;
    static const float times[] = {0, 1};
    static const float turn[] = {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0};
    static const float grow[] = {1, 1, 1, 3, 5, 1};
    const struct lw_channel channels[] = {
        {0, LW_CHANNEL_ROTATION, LW_INTERPOLATION_CUBIC, 2, times, turn},
        {0, LW_CHANNEL_SCALE, LW_INTERPOLATION_LINEAR, 2, times, grow},
    };
    struct lw_scene *scene = build(&still, 1, channels, 2, 2);
    /* half way between identity and a half turn about z: (0, 0, 1/2, 1/2) before it is made unit, a quarter
     * turn */
    assert_point(point_at(scene, 0.5, lw_vec3(1, 0, 0)), 0, 2, 0);
    assert_point(point_at(scene, 0.5, lw_vec3(0, 1, 0)), -3, 0, 0);
    lw_scene_destroy(scene);
}

static bool moves(const struct lw_scene *scene, uint32_t object) {
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    bool answer = lw_pose_object_moves(&pose, scene, object);
    lw_pose_finish(&pose);
    return answer;
}

/* A copy has what a moment of the scene shows, and follows others. */
static void a_copy_has_no_nodes(void **state) {
    (void)state;
    static const float times[] = {0, 2}, ways[] = {0, 0, 0, 4, 0, 0};
    struct lw_channel channels[] = {
        {0, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_LINEAR, 2, times, ways},
    };
    struct lw_scene *scene = build(&still, 1, channels, 1, 2);
    struct lw_pose pose, copy;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_pose_evaluate(&pose, scene, 1);
    lw_support_ok(lw_pose_init_copy(&copy, &pose, scene), NULL);
    assert_null(copy.node_to_world);
    assert_true(lw_pose_equal(&pose, &copy, scene));
    assert_true(lw_pose_object_moves(&copy, scene, 0));
    lw_pose_evaluate(&pose, scene, 2);
    assert_false(lw_pose_equal(&pose, &copy, scene));
    lw_pose_copy(&copy, &pose, scene);
    assert_true(lw_pose_equal(&pose, &copy, scene));
    lw_pose_finish(&copy);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

/* Colour times factor, whatever the order of the channels; a curve that dips below 0 is dark there. */
static void lights_are_dimmed_and_coloured(void **state) {
    (void)state;
    static const float times[] = {0, 2}, colours[] = {1, 1, 1, 0, 1, 0.5f}, factors[] = {0, 100},
                       dip[] = {0, 1, -8, 8, 1, 0};
    struct lw_channel channels[] = {
        {0, LW_CHANNEL_FACTOR, LW_INTERPOLATION_LINEAR, 2, times, factors},
        {0, LW_CHANNEL_INTENSITY, LW_INTERPOLATION_LINEAR, 2, times, colours},
    };
    struct lw_scene *scene = build(&still, 1, NULL, 0, 2);
    struct lw_pose pose;
    scene->light_channel = channels;
    scene->light_channel_count = 2;
    lw_support_ok(lw_scene_validate(scene, NULL), NULL);
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_point(pose.light[0].intensity, 0, 0, 0);
    lw_pose_evaluate(&pose, scene, 1);
    assert_point(pose.light[0].intensity, 50 * 0.5f, 50, 50 * 0.75f);
    channels[0] = (struct lw_channel){0, LW_CHANNEL_FACTOR, LW_INTERPOLATION_CUBIC, 2, times, dip};
    lw_support_ok(lw_scene_validate(scene, NULL), NULL);
    /* at the middle of 2 s: 1 by the values, 2 (-8 - 8) / 8 by the tangents */
    lw_pose_evaluate(&pose, scene, 1);
    assert_point(pose.light[0].intensity, 0, 0, 0);
    scene->light_channel_count = 1; /* without a colour of its own: times what the light has */
    scene->light[0].intensity[0] = 3;
    lw_pose_evaluate(&pose, scene, 0);
    assert_near(pose.light[0].intensity.x, 3);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void what_moves_is_what_has_a_channel_above_it(void **state) {
    (void)state;
    static const float times[] = {0}, values[] = {0, 0, 0};
    struct lw_scene *scene = lw_support_squares(4, 1);
    struct lw_channel channel = {1, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_STEP, 1, times, values};
    scene->channel = &channel;
    assert_false(moves(scene, 1)); /* the channel is not counted yet */
    scene->channel_count = 1;
    scene->node[2].parent = 1;
    assert_false(moves(scene, 0));
    assert_true(moves(scene, 1));
    assert_true(moves(scene, 2));
    assert_false(moves(scene, 3));
    scene->node[3].parent = 2;
    assert_true(moves(scene, 3));
    lw_scene_destroy(scene);
}

/* A chain of nodes, each with its object, its lower half animated: a package of a few MB. */
static void what_moves_is_found_fast(void **state) {
    (void)state;
    enum { COUNT = 20000 };
    static const float times[] = {0}, values[] = {1, 1, 1};
    static struct lw_node nodes[COUNT];
    static struct lw_channel channels[COUNT];
    for (uint32_t i = 0; i < COUNT; i++) {
        nodes[i] = still;
        nodes[i].parent = i > 0 ? i - 1 : LW_SCENE_NONE;
        channels[i] = (struct lw_channel){COUNT / 2 + i / 2,
                                          i % 2 ? LW_CHANNEL_TRANSLATION : LW_CHANNEL_SCALE,
                                          LW_INTERPOLATION_STEP,
                                          1,
                                          times,
                                          values};
    }
    struct lw_scene *scene = build(nodes, COUNT, channels, COUNT, 1);
    struct lw_object *objects = lw_scene_alloc(scene, COUNT, sizeof *objects);
    assert_non_null(objects);
    for (uint32_t i = 0; i < COUNT; i++) {
        objects[i] = scene->object[0];
        objects[i].node = i;
    }
    scene->object = objects;
    scene->object_count = COUNT;
    struct lw_pose pose;
    uint64_t start_ns = lw_clock_process_cpu_ns();
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    for (uint32_t i = 0; i < COUNT; i++)
        assert_int_equal(lw_pose_object_moves(&pose, scene, i), i >= COUNT / 2);
    /* looking at every channel for every node above every object would take minutes */
    assert_true(lw_clock_process_cpu_ns() - start_ns < 2000000000);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void bounds_hold_all_objects(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(3, 2); /* centres at x = 0, 4, 8 */
    struct lw_pose pose;
    struct lw_vec3 low = {7, 7, 7}, high = {7, 7, 7};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_true(lw_pose_bounds(&pose, scene, &low, &high));
    assert_point(low, -1, 0, -1);
    assert_point(high, 9, 0, 1);
    scene->object_count = 0;
    assert_false(lw_pose_bounds(&pose, scene, &low, &high));
    assert_point(high, 9, 0, 1); /* untouched */
    lw_pose_finish(&pose);
    lw_pose_finish(&pose); /* twice is fine */
    lw_scene_destroy(scene);
}

static void moments_are_equal_until_anything_but_the_time_differs(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(3, 2);
    struct lw_pose a, b;
    lw_support_ok(lw_pose_init(&a, scene), NULL);
    lw_support_ok(lw_pose_init(&b, scene), NULL);
    assert_true(lw_pose_equal(&a, &b, scene));
    b.time_s = 1;
    assert_true(lw_pose_equal(&a, &b, scene));
    float *const value[] = {&b.object_to_world[2].m[2][3], &b.light[0].position_ws.x,
                            &b.light[0].intensity.z,       &b.material[0].base_colour[2],
                            &b.material[0].emission[2],    &b.sky[2]};
    for (size_t i = 0; i < sizeof value / sizeof value[0]; i++) {
        *value[i] += 1;
        assert_false(lw_pose_equal(&a, &b, scene));
        lw_pose_copy(&b, &a, scene);
        assert_true(lw_pose_equal(&a, &b, scene));
    }
    b.object_hidden[2] = true;
    assert_false(lw_pose_equal(&a, &b, scene));
    lw_pose_copy(&a, &b, scene);
    assert_true(a.object_hidden[2] && lw_pose_equal(&a, &b, scene));
    lw_pose_evaluate(&a, scene, 0); /* the scene itself hides nothing */
    assert_false(a.object_hidden[2]);
    lw_pose_finish(&a);
    lw_pose_finish(&b);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(scale_comes_before_rotation_before_translation),
        cmocka_unit_test(quaternions_turn_as_they_should_about_every_axis),
        cmocka_unit_test(parents_carry_children_and_mirrors_mirror),
        cmocka_unit_test(lights_and_cameras_look_along_minus_z),
        cmocka_unit_test(steps_hold_and_lines_are_straight),
        cmocka_unit_test(linear_rotations_turn_evenly_the_shorter_way),
        cmocka_unit_test(cubic_splines_reproduce_a_cubic),
        cmocka_unit_test(in_tangents_and_out_tangents_are_reported_apart),
        cmocka_unit_test(cubic_rotations_are_unit_and_scales_scale),
        cmocka_unit_test(a_copy_has_no_nodes),
        cmocka_unit_test(lights_are_dimmed_and_coloured),
        cmocka_unit_test(what_moves_is_what_has_a_channel_above_it),
        cmocka_unit_test(what_moves_is_found_fast),
        cmocka_unit_test(bounds_hold_all_objects),
        cmocka_unit_test(moments_are_equal_until_anything_but_the_time_differs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
