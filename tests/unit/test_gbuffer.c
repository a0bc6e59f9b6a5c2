/* First hits of scenes with known answers. */
#include "client/paths/gbuffer.h"
#include "tests/reference/room.h"

#include <stdlib.h>
#include <string.h>

#define WIDTH  41u
#define HEIGHT 23u

struct set {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_gbuffer g;
};

static void set_up(struct set *set, const struct room *room, unsigned threads) {
    struct lw_error err = {0};
    *set = (struct set){.scene = room_scene(room)};
    lw_support_ok(lw_pose_init(&set->pose, set->scene), NULL);
    for (uint32_t n = 0; n < set->scene->node_count; n++) set->pose.node_moves[n] = true;
    lw_support_ok(lw_trace_create(set->scene, &set->pose, &set->trace, &err), &err);
    lw_support_ok(lw_gbuffer_init(&set->g,
                                  &(struct lw_gbuffer_desc){.scene = set->scene,
                                                            .trace = set->trace,
                                                            .width = WIDTH,
                                                            .height = HEIGHT,
                                                            .threads = threads},
                                  &err),
                  &err);
}

static void tear_down(struct set *set) {
    lw_gbuffer_finish(&set->g);
    lw_trace_destroy(set->trace);
    lw_pose_finish(&set->pose);
    lw_scene_destroy(set->scene);
}

static const struct lw_camera_view *above(void) {
    static struct lw_camera_view view;
    view = lw_camera_look_at(lw_vec3(0, 1, 3), lw_vec3(0, 0, 0), 1);
    return &view;
}

static struct room floor_room(void) {
    struct room room = {.sky = 2};
    room_quad(&room, lw_vec3(-2, 0, -2), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.5f, 3);
    return room;
}

static struct lw_vec3 at3(float *const plane[3], size_t i) {
    return lw_vec3(plane[0][i], plane[1][i], plane[2][i]);
}

static void test_depth_is_linear_on_a_floor(void **state) {
    (void)state;
    struct room room = floor_room();
    struct set set;
    set_up(&set, &room, 2);
    lw_gbuffer_render(&set.g, &set.pose, above());
    const struct lw_gbuffer_planes *p = &set.g.plane;
    unsigned met = 0, sky = 0;
    for (uint32_t i = 0; i + WIDTH < WIDTH * HEIGHT; i++) {
        if (p->object[i] == LW_TRACE_MISS) {
            assert_true(p->depth[i] == 0 && p->albedo[0][i] == 0 && p->emission[1][i] == 2);
            sky++;
            continue;
        }
        met++;
        assert_true(p->object[i] == 0 && p->normal[1][i] > 0.9999f);
        assert_true(p->albedo[0][i] == 0.5f && p->emission[2][i] == 3);
        /* the point lies on the floor, where the ray at this depth ends */
        assert_true(fabsf(p->before[1][i]) < 1e-5f);
        const float z =
            lw_vec3_dot(lw_vec3_sub(at3(p->before, i), set.g.camera.position), set.g.camera.forward);
        expect_near((double)(z * p->depth[i]), 1, 1e-5);
        if (i % WIDTH + 1 < WIDTH && p->object[i + 1] == 0)
            assert_true(fabsf(p->depth[i] + p->slope[0][i] - p->depth[i + 1]) < 1e-6f);
        if (p->object[i + WIDTH] == 0)
            assert_true(fabsf(p->depth[i] + p->slope[1][i] - p->depth[i + WIDTH]) < 1e-6f);
        /* a point as far away, one pixel's breadth above the floor: its inverse depth is off by 1 / apart */
        const float pixel = lw_camera_plane(&set.g.camera, WIDTH, HEIGHT).pixel;
        const struct lw_vec3 away = lw_vec3_sub(at3(p->before, i), set.g.camera.position);
        expect_near((double)p->apart[i], (double)(fabsf(away.y) / pixel), 1e-4);
    }
    assert_true(met > 200 && sky > 50);
    tear_down(&set);
}

static void test_before_is_where_the_object_was(void **state) {
    (void)state;
    struct room room = floor_room();
    struct set set;
    struct lw_error err = {0};
    set_up(&set, &room, 2);
    lw_gbuffer_render(&set.g, &set.pose, above());
    assert_false(set.g.still);
    lw_gbuffer_render(&set.g, &set.pose, above());
    assert_true(set.g.still);
    struct lw_affine *to_world = &set.pose.object_to_world[0];
    to_world->m[0][3] += 0.25f, to_world->m[1][3] += 0.125f;
    lw_support_ok(lw_trace_set_pose(set.trace, &set.pose, &err), &err);
    for (int frame = 0; frame < 2; frame++) {
        lw_gbuffer_render(&set.g, &set.pose, above());
        assert_true(set.g.still == (frame == 1));
        const struct lw_camera_plane plane = lw_camera_plane(&set.g.camera, WIDTH, HEIGHT);
        unsigned met = 0;
        for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
            if (set.g.plane.object[i] == LW_TRACE_MISS) continue;
            struct lw_vec3 way =
                lw_camera_direction(&plane, (float)(i % WIDTH) + 0.5f, (float)(i / WIDTH) + 0.5f);
            struct lw_vec3 now = lw_vec3_mad(set.g.camera.position, way, 1 / set.g.plane.depth[i]);
            struct lw_vec3 moved = lw_vec3_sub(now, at3(set.g.plane.before, i));
            const float want = frame == 0 ? 1 : 0;
            assert_true(lw_vec3_length(lw_vec3_sub(moved, lw_vec3(0.25f * want, 0.125f * want, 0))) < 1e-5f);
            met++;
        }
        assert_true(met > 200);
    }
    struct lw_camera_view other = *above();
    other.position.x += 0.01f;
    lw_gbuffer_render(&set.g, &set.pose, &other);
    assert_false(set.g.still);
    tear_down(&set);
}

static void test_layers_are_blended(void **state) {
    (void)state;
    for (int heavy = 0; heavy < 2; heavy++) {
        struct room room = floor_room();
        const float alpha = heavy ? 0.75f : 0.25f;
        room_quad(&room, lw_vec3(-2, 0.25f, -2), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.5f, 8);
        room.quad[1].alpha_mode = LW_ALPHA_BLEND;
        room.quad[1].alpha = alpha;
        struct set set;
        set_up(&set, &room, 2);
        lw_gbuffer_render(&set.g, &set.pose, above());
        const uint32_t middle = HEIGHT / 2 * WIDTH + WIDTH / 2;
        expect_near((double)set.g.plane.albedo[0][middle], 0.5, 1e-5);
        expect_near((double)set.g.plane.emission[0][middle], (double)(alpha * 8 + (1 - alpha) * 3), 1e-5);
        assert_int_equal(set.g.plane.object[middle], heavy ? 1 : 0);
        tear_down(&set);
    }
}

static void test_backs_face_the_eye(void **state) {
    (void)state;
    struct room room = floor_room();
    room.quad[0].double_sided = true;
    struct set set;
    set_up(&set, &room, 2);
    struct lw_camera_view below = lw_camera_look_at(lw_vec3(0, -1, 2), lw_vec3(0, 0, 0), 1);
    lw_gbuffer_render(&set.g, &set.pose, &below);
    const uint32_t middle = HEIGHT / 2 * WIDTH + WIDTH / 2;
    assert_true(set.g.plane.object[middle] == 0 && set.g.plane.normal[1][middle] < -0.9999f);
    tear_down(&set);
}

static void test_threads_change_no_byte(void **state) {
    (void)state;
    struct room room = floor_room();
    struct set one, three;
    set_up(&one, &room, 1);
    set_up(&three, &room, 3);
    lw_gbuffer_render(&one.g, &one.pose, above());
    lw_gbuffer_render(&three.g, &three.pose, above());
    assert_memory_equal(one.g.memory, three.g.memory, 16 * WIDTH * HEIGHT * sizeof(float));
    assert_memory_equal(one.g.plane.object, three.g.plane.object, WIDTH * HEIGHT * sizeof(uint32_t));
    tear_down(&one);
    tear_down(&three);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_depth_is_linear_on_a_floor),
        cmocka_unit_test(test_before_is_where_the_object_was),
        cmocka_unit_test(test_layers_are_blended),
        cmocka_unit_test(test_backs_face_the_eye),
        cmocka_unit_test(test_threads_change_no_byte),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
