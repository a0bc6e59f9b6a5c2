#include "tests/support/support.h"

#include "common/trace/trace.h"

#include <math.h>
#include <string.h>

struct fixture {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
};

static void start(struct fixture *f, struct lw_scene *scene) {
    struct lw_error err = {0};
    f->scene = scene;
    lw_support_ok(lw_pose_init(&f->pose, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &f->pose, &f->trace, &err), &err);
}

static void stop(struct fixture *f) {
    lw_trace_destroy(f->trace);
    lw_pose_finish(&f->pose);
    lw_scene_destroy(f->scene);
}

/* One ray in lane 3, the others at rest. */
static struct lw_hit16 shoot(const struct fixture *f, unsigned flags, struct lw_vec3 org,
                             struct lw_vec3 dir) {
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    memset(&rays, 0, sizeof rays);
    rays.org_x[3] = org.x, rays.org_y[3] = org.y, rays.org_z[3] = org.z;
    rays.dir_x[3] = dir.x, rays.dir_y[3] = dir.y, rays.dir_z[3] = dir.z;
    rays.t_far[3] = INFINITY;
    lw_trace_closest16(f->trace, flags, 1u << 3, &rays, &hits);
    for (int i = 0; i < 16; i++) assert_true(i == 3 || hits.object[i] == LW_TRACE_MISS);
    uint16_t occluded = lw_trace_occluded16(f->trace, flags, 1u << 3, &rays);
    assert_int_equal(occluded, hits.object[3] == LW_TRACE_MISS ? 0 : 1u << 3);
    return hits;
}

static const struct lw_vec3 down = {0, -1, 0}, up = {0, 1, 0};

static void test_front_and_back(void **state) {
    (void)state;
    struct fixture f;
    start(&f, lw_support_squares(2, 1));
    struct lw_hit16 hit = shoot(&f, LW_TRACE_LIGHT, lw_vec3(2.1f, 3, 0.2f), down);
    assert_int_equal(hit.object[3], 1);
    assert_float_equal(hit.t[3], 3, 1e-6);
    assert_int_equal(hit.back[3], 0);
    hit = shoot(&f, LW_TRACE_LIGHT, lw_vec3(0.1f, -3, 0.2f), up);
    assert_int_equal(hit.object[3], 0);
    assert_int_equal(hit.back[3], 1);
    /* View rays do not see the backs of single-sided surfaces. */
    assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0.1f, -3, 0.2f), up).object[3], LW_TRACE_MISS);
    f.scene->material[0].double_sided = 1;
    assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0.1f, -3, 0.2f), up).back[3], 1);
    stop(&f);
}

/* Gives object 0 an animation, so that it becomes an instance. */
static void animate(struct lw_scene *scene) {
    static const float times[] = {0, 1}, values[] = {0, 0, 0, 0, 5, 0};
    scene->channel = lw_scene_alloc(scene, 1, sizeof *scene->channel);
    scene->channel[0] = (struct lw_channel){.node = 0,
                                            .path = LW_CHANNEL_TRANSLATION,
                                            .interpolation = LW_INTERPOLATION_LINEAR,
                                            .key_count = 2,
                                            .time_s = times,
                                            .value = values};
    scene->channel_count = 1;
    scene->duration_s = 1;
}

static void test_mirrored_objects_keep_their_front(void **state) {
    (void)state;
    for (int moving = 0; moving < 2; moving++) {
        struct fixture f;
        struct lw_scene *scene = lw_support_squares(1, 1);
        scene->node[0].scale[0] = -2;
        if (moving) animate(scene);
        start(&f, scene);
        struct lw_hit16 hit = shoot(&f, LW_TRACE_LIGHT, lw_vec3(0.7f, 3, 0.2f), down);
        assert_int_equal(hit.object[3], 0);
        assert_int_equal(hit.back[3], 0);
        assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0.7f, 3, 0.2f), down).object[3], 0);
        assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(0.7f, -3, 0.2f), up).back[3], 1);
        assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0.7f, -3, 0.2f), up).object[3], LW_TRACE_MISS);
        stop(&f);
    }
}

static void test_moving_objects_follow_the_pose(void **state) {
    (void)state;
    struct fixture f;
    struct lw_error err = {0};
    struct lw_scene *scene = lw_support_squares(2, 1);
    animate(scene);
    start(&f, scene);
    assert_float_equal(shoot(&f, 0, lw_vec3(0.1f, 9, 0.2f), down).t[3], 9, 1e-5);
    lw_pose_evaluate(&f.pose, scene, 0.6);
    lw_support_ok(lw_trace_set_pose(f.trace, &f.pose, &err), &err);
    struct lw_hit16 hit = shoot(&f, 0, lw_vec3(0.1f, 9, 0.2f), down);
    assert_float_equal(hit.t[3], 6, 1e-4);
    assert_int_equal(hit.object[3], 0);
    assert_int_equal(shoot(&f, 0, lw_vec3(2.1f, 9, 0.2f), down).object[3], 1);
    stop(&f);
}

static void test_masked_surfaces_let_rays_pass(void **state) {
    (void)state;
    struct fixture f;
    struct lw_scene *scene = lw_support_squares(1, 1);
    scene->material[0].alpha_mode = LW_ALPHA_MASK;
    scene->material[0].base_colour[3] = 0.4f;
    start(&f, scene);
    for (unsigned flags = 0; flags < 2; flags++) {
        scene->material[0].alpha_cutoff = 0.5f;
        assert_int_equal(shoot(&f, flags, lw_vec3(0.1f, 3, 0.2f), down).object[3], LW_TRACE_MISS);
        scene->material[0].alpha_cutoff = 0.4f;
        assert_int_equal(shoot(&f, flags, lw_vec3(0.1f, 3, 0.2f), down).object[3], 0);
    }
    stop(&f);
}

static void test_blended_surfaces_stop_their_share_of_rays(void **state) {
    (void)state;
    struct fixture f;
    struct lw_scene *scene = lw_support_squares(1, 1);
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.3f;
    start(&f, scene);
    const int count = 4000;
    int stopped = 0;
    for (int i = 0; i < count; i++) {
        struct lw_vec3 dir = lw_vec3(0.0001f * (float)i - 0.2f, -1, 0.05f);
        stopped += shoot(&f, LW_TRACE_LIGHT, lw_vec3(0, 1, 0), dir).object[3] == 0;
        assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0, 1, 0), dir).object[3], 0);
    }
    /* four standard deviations of a binomial */
    assert_float_equal((float)stopped / (float)count, 0.3f, 4 * sqrtf(0.3f * 0.7f / (float)count));
    stop(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_front_and_back),
        cmocka_unit_test(test_mirrored_objects_keep_their_front),
        cmocka_unit_test(test_moving_objects_follow_the_pose),
        cmocka_unit_test(test_masked_surfaces_let_rays_pass),
        cmocka_unit_test(test_blended_surfaces_stop_their_share_of_rays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
