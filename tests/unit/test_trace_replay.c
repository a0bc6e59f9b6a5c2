#include "tests/support/support.h"

#include "common/trace/trace.h"
#include "common/trace/trace_replay.h"

#include <math.h>

#define ROOM 200u /* more than the packets between two looks at the clock */

struct fixture {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_trace_replay *replay;
};

static void start(struct fixture *f) {
    struct lw_error err = {0};
    f->scene = lw_support_squares(2, 1);
    lw_support_ok(lw_pose_init(&f->pose, f->scene), NULL);
    lw_support_ok(lw_trace_create(f->scene, &f->pose, &f->trace, &err), &err);
    lw_support_ok(lw_trace_replay_create(ROOM, &f->replay), NULL);
}

static void stop(struct fixture *f) {
    lw_trace_replay_record(NULL);
    lw_trace_replay_destroy(f->replay);
    lw_trace_destroy(f->trace);
    lw_pose_finish(&f->pose);
    lw_scene_destroy(f->scene);
}

static uint32_t shoot(const struct fixture *f, uint16_t active, bool closest) {
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++)
        lw_trace_set_ray(&rays, i, lw_vec3(0.1f, 3, 0.2f), lw_vec3(0, -1, 0), INFINITY);
    rays.salt = 0;
    if (!closest) return lw_trace_occluded16(f->trace, LW_TRACE_LIGHT, active, &rays);
    lw_trace_closest16(f->trace, LW_TRACE_LIGHT, active, &rays, &hits);
    return hits.object[0];
}

static struct lw_trace_replay_cost run(const struct fixture *f) {
    struct lw_trace_replay_cost cost = {0};
    lw_trace_replay_run(f->replay, &cost);
    return cost;
}

static void test_notes_what_goes_to_embree(void **state) {
    (void)state;
    struct fixture f;
    start(&f);
    shoot(&f, 0xffff, true); /* before: not noted */
    lw_trace_replay_record(f.replay);
    assert_int_equal(shoot(&f, 0x00ff, true), 0); /* the hits are the same */
    assert_int_equal(shoot(&f, 0x0007, false), 0x0007);
    lw_trace_replay_record(NULL);
    shoot(&f, 0xffff, false);
    struct lw_trace_replay_cost cost = run(&f);
    assert_int_equal(cost.packets, 2);
    assert_int_equal(cost.rays, 8 + 3);
    /* again: nothing of the first run is left in it */
    cost = run(&f);
    assert_int_equal(cost.rays, 8 + 3);
    lw_trace_replay_clear(f.replay);
    assert_int_equal(run(&f).packets, 0);
    stop(&f);
}

static void test_stops_when_full(void **state) {
    (void)state;
    struct fixture f;
    start(&f);
    lw_trace_replay_record(f.replay);
    for (uint32_t i = 0; i < ROOM + 1; i++) shoot(&f, 1, i % 2 == 0);
    const struct lw_trace_replay_cost cost = run(&f);
    assert_int_equal(cost.packets, ROOM);
    assert_int_equal(cost.rays, ROOM);
    assert_true(cost.cpu_ns > 0);
    stop(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_notes_what_goes_to_embree),
                                       cmocka_unit_test(test_stops_when_full)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
