#include "tests/support/support.h"

#include "client/measure/sides/views.h"
#include "common/builtin/builtin.h"

struct place {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
};

static struct place open_place(const char *name) {
    struct place p;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build(name, &p.scene, &err), &err);
    lw_support_ok(lw_pose_init(&p.pose, p.scene), NULL);
    lw_support_ok(lw_trace_create(p.scene, &p.pose, &p.trace, &err), &err);
    return p;
}

static void close_place(struct place *p) {
    lw_trace_destroy(p->trace);
    lw_pose_finish(&p->pose);
    lw_scene_destroy(p->scene);
}

static struct lw_views *views_of(const struct place *p, enum lw_views_kind kind, uint32_t users,
                                 float spread) {
    struct lw_views *views;
    struct lw_error err = {0};
    lw_support_ok(lw_views_create(&(struct lw_views_desc){.scene = p->scene,
                                                          .trace = p->trace,
                                                          .kind = kind,
                                                          .users = users,
                                                          .spread = spread,
                                                          .seed = 1,
                                                          .aspect = 1.6f},
                                  &views, &err),
                  &err);
    return views;
}

static float apart(const struct lw_views *views, uint32_t a, uint32_t b, uint64_t frame) {
    return lw_vec3_length(
        lw_vec3_sub(lw_views_at(views, a, frame).position, lw_views_at(views, b, frame).position));
}

static float widest(const struct lw_views *views, uint32_t users) {
    float most = 0;
    for (uint32_t a = 0; a < users; a++)
        for (uint32_t b = 0; b < a; b++) most = fmaxf(most, apart(views, a, b, 1));
    return most;
}

static void walkers_walk_inside(void **state) {
    (void)state;
    struct place p = open_place("builtin:atrium-matt");
    struct lw_vec3 low, high;
    assert_true(lw_pose_bounds(&p.pose, p.scene, &low, &high));
    struct lw_views *views = views_of(&p, LW_VIEWS_WALK, 8, 1);
    assert_false(lw_views_rest(views));
    float way = 0;
    for (uint64_t f = 1; f < 300; f++) {
        struct lw_camera_view view = lw_views_at(views, 0, f), next = lw_views_at(views, 0, f + 1);
        assert_true(lw_vec3_is_finite(view.position) && fabsf(lw_vec3_length(view.forward) - 1) < 1e-4f);
        assert_true(view.position.x > low.x && view.position.x < high.x && view.position.z > low.z &&
                    view.position.z < high.z);
        float step = lw_vec3_length(lw_vec3_sub(next.position, view.position));
        assert_true(step < 0.2f); /* m in 1/30 s */
        way += step;
    }
    assert_true(way > 2);
    lw_views_destroy(views);
    close_place(&p);
}

static void spread_parts_users(void **state) {
    (void)state;
    struct place p = open_place("builtin:atrium-matt");
    for (int kind = LW_VIEWS_WALK; kind <= LW_VIEWS_CENTRE; kind++) {
        struct lw_views *together = views_of(&p, (enum lw_views_kind)kind, 8, 0),
                        *over_all = views_of(&p, (enum lw_views_kind)kind, 8, 1);
        assert_true(widest(together, 8) < 0.5f * widest(over_all, 8));
        assert_true(widest(together, 8) > 0);
        /* the first four are spread almost as far as all eight */
        assert_true(widest(over_all, 4) > 0.4f * widest(over_all, 8));
        lw_views_destroy(over_all);
        lw_views_destroy(together);
    }
    close_place(&p);
}

/* In Cornell's box, whose walls and blocks are closed: nobody stands in a block or looks elsewhere. */
static void standing_users_look_at_the_centre(void **state) {
    (void)state;
    struct place p = open_place("builtin:cornell");
    struct lw_vec3 low, high;
    assert_true(lw_pose_bounds(&p.pose, p.scene, &low, &high));
    struct lw_vec3 centre = lw_vec3_scale(lw_vec3_add(low, high), 0.5f);
    struct lw_views *views = views_of(&p, LW_VIEWS_CENTRE, 64, 1);
    assert_true(lw_views_rest(views));
    for (uint32_t u = 0; u < 64; u++) {
        struct lw_camera_view view = lw_views_at(views, u, 1), later = lw_views_at(views, u, 100);
        assert_memory_equal(&view, &later, sizeof view);
        struct lw_vec3 to = lw_vec3_normalize(lw_vec3_sub(centre, view.position));
        assert_true(lw_vec3_dot(to, view.forward) > 0.9999f);
        /* every ray of a free place meets fronts */
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        for (uint32_t i = 0; i < 16; i++) {
            float phi = 0.3f + (float)i * 0.3927f;
            lw_trace_set_ray(&rays, i, view.position, lw_vec3(cosf(phi), 0.1f, sinf(phi)), INFINITY);
        }
        lw_trace_closest16(p.trace, LW_TRACE_LIGHT, 0xffff, &rays, &hits);
        int backs = 0;
        for (uint32_t i = 0; i < 16; i++) backs += hits.object[i] != LW_TRACE_MISS && hits.back[i];
        assert_true(backs <= 8);
    }
    lw_views_destroy(views);
    close_place(&p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(walkers_walk_inside),
                                       cmocka_unit_test(spread_parts_users),
                                       cmocka_unit_test(standing_users_look_at_the_centre)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
