#include "tests/support/support.h"

#include "common/scene/scene_spares.h"
#include "common/scene/scene_state.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct fixture {
    struct lw_scene *scene;
    struct lw_scene_state state;
    struct lw_pose pose;
};

static void set_up_scene(struct fixture *f, double start_s, bool paused) {
    lw_support_ok(lw_scene_state_init(&f->state, f->scene, start_s, paused), NULL);
    lw_support_ok(lw_pose_init(&f->pose, f->scene), NULL);
}

static void set_up(struct fixture *f, double start_s, bool paused) {
    f->scene = lw_support_everything();
    set_up_scene(f, start_s, paused);
}

static void tear_down(struct fixture *f) {
    lw_pose_finish(&f->pose);
    lw_scene_state_finish(&f->state);
    lw_scene_state_finish(&f->state); /* twice is fine */
    lw_scene_destroy(f->scene);
}

static void change(struct fixture *f, double wall_s, enum lw_scene_change_kind kind, uint32_t target,
                   uint32_t count, const float *value) {
    struct lw_scene_change c = {.kind = kind, .target = target, .value_count = count};
    struct lw_error err = {0};
    if (count) memcpy(c.value, value, count * sizeof *value);
    assert_int_equal(lw_scene_change_check(f->scene, &c, &err), LW_SCENE_CHANGE_OK);
    lw_scene_state_change(&f->state, &c, wall_s);
}

/* What differs from the scene as its file has it, at that moment of its animation. */
static unsigned difference(struct fixture *f, double wall_s) {
    struct lw_pose plain;
    lw_support_ok(lw_pose_init(&plain, f->scene), NULL);
    lw_pose_evaluate(&plain, f->scene, lw_scene_state_time(&f->state, wall_s));
    lw_scene_state_pose(&f->state, wall_s, &f->pose);
    assert_true(f->pose.time_s == plain.time_s);
    unsigned difference = lw_pose_difference(&f->pose, &plain, f->scene);
    lw_pose_finish(&plain);
    return difference;
}

static const float moved[12] = {2, 0, 0, 5, 0, 2, 0, 6, 0, 0, -2, 7};

static void nothing_changed_is_the_scene_itself(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, 0, false);
    for (double t = 0; t < 3; t += 0.25) assert_int_equal(difference(&f, t), 0);
    tear_down(&f);
}

static void objects_go_and_come_back(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, 0, false);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1, 12, moved);
    for (double t = 0; t < 3; t += 0.5) { /* whatever the animation does */
        assert_int_equal(difference(&f, t), LW_POSE_OBJECTS);
        assert_memory_equal(f.pose.object_to_world[1].m, moved, sizeof moved);
    }
    assert_true(lw_pose_object_moves(&f.pose, f.scene, 1));
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_HIDE, 0, 0, NULL);
    lw_scene_state_pose(&f.state, 0, &f.pose);
    assert_true(f.pose.object_hidden[0] && !f.pose.object_hidden[1]);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_SHOW, 0, 0, NULL);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_RESTORE, 1, 0, NULL);
    assert_int_equal(difference(&f, 0.5), 0);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_HIDE, 0, 0, NULL);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_RESTORE, 0, 0, NULL); /* shows it, too */
    assert_int_equal(difference(&f, 0), 0);
    tear_down(&f);
}

/* It is reported once, and only for objects that no channel moves. */
static void what_stood_still_becomes_dynamic(void **state) {
    (void)state;
    struct fixture f;
    f.scene = lw_support_everything();
    f.scene->channel_count = 0;
    set_up_scene(&f, 0, false);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1, 12, moved);
    assert_int_equal(difference(&f, 0), LW_POSE_OBJECTS | LW_POSE_DYNAMIC);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_RESTORE, 1, 0, NULL);
    assert_int_equal(difference(&f, 0), LW_POSE_DYNAMIC); /* a released object stays so */
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_HIDE, 0, 0, NULL);
    assert_int_equal(difference(&f, 0), LW_POSE_OBJECTS | LW_POSE_DYNAMIC);
    change(&f, 0, LW_SCENE_CHANGE_RESET, 0, 0, NULL);
    assert_int_equal(difference(&f, 0), LW_POSE_DYNAMIC);
    tear_down(&f);
}

static void lights_change_in_each_respect_alone(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, 0, false);
    lw_scene_state_pose(&f.state, 0, &f.pose);
    const struct lw_light_state before = f.pose.light[0];
    change(&f, 0, LW_SCENE_CHANGE_LIGHT_INTENSITY, 0, 3, (float[]){0, 0, 0});
    assert_int_equal(difference(&f, 0), LW_POSE_LIGHTS);
    assert_true(f.pose.light[0].intensity.x == 0 && f.pose.light[0].position_ws.x == before.position_ws.x);
    change(&f, 0, LW_SCENE_CHANGE_LIGHT_DIRECTION, 0, 3, (float[]){0, -4, 0});
    change(&f, 0, LW_SCENE_CHANGE_LIGHT_POSITION, 0, 3, (float[]){1, 2, 3});
    lw_scene_state_pose(&f.state, 0, &f.pose);
    assert_true(f.pose.light[0].direction_ws.y == -1 && f.pose.light[0].position_ws.z == 3);
    change(&f, 0, LW_SCENE_CHANGE_LIGHT_RESTORE, 0, 0, NULL);
    assert_int_equal(difference(&f, 0), 0);
    tear_down(&f);
}

static void materials_and_sky_change_in_a_scene_of_its_own(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, 0, false);
    const struct lw_material before = f.scene->material[1];
    change(&f, 0, LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR, 1, 3, (float[]){0.125f, 0.25f, 0.75f});
    assert_int_equal(difference(&f, 0), LW_POSE_MATERIALS);
    assert_true(f.state.scene.material[1].base_colour[2] == 0.75f);
    assert_true(f.state.scene.material[1].base_colour[3] == before.base_colour[3]); /* alpha */
    assert_true(f.pose.material[1].base_colour[1] == 0.25f);
    change(&f, 0, LW_SCENE_CHANGE_MATERIAL_EMISSION, 1, 3, (float[]){7, 8, 9});
    change(&f, 0, LW_SCENE_CHANGE_SKY, 0, 3, (float[]){3, 2, 1});
    assert_int_equal(difference(&f, 0), LW_POSE_MATERIALS | LW_POSE_SKY);
    assert_true(f.pose.material[1].emission[2] == 9 && f.pose.sky[0] == 3 && f.state.scene.sky[1] == 2);
    assert_memory_equal(&f.scene->material[1], &before, sizeof before);
    change(&f, 0, LW_SCENE_CHANGE_MATERIAL_RESTORE, 1, 0, NULL);
    assert_int_equal(difference(&f, 0), LW_POSE_SKY);
    change(&f, 0, LW_SCENE_CHANGE_SKY_RESTORE, 0, 0, NULL);
    assert_int_equal(difference(&f, 0), 0);
    tear_down(&f);
}

static double time_at(const struct fixture *f, double wall_s) {
    return lw_scene_state_time(&f->state, wall_s);
}

static void the_clock_never_jumps_but_when_set(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, 0, false);
    assert_true(time_at(&f, 4) == 4);
    change(&f, 4, LW_SCENE_CHANGE_CLOCK_RATE, 0, 1, (float[]){0.5f});
    assert_true(time_at(&f, 4) == 4 && time_at(&f, 6) == 5);
    change(&f, 6, LW_SCENE_CHANGE_CLOCK_PAUSE, 0, 0, NULL);
    assert_true(time_at(&f, 6) == 5 && time_at(&f, 100) == 5);
    change(&f, 100, LW_SCENE_CHANGE_CLOCK_SEEK, 0, 1, (float[]){1.5f}); /* and stays paused */
    assert_true(time_at(&f, 100) == 1.5 && time_at(&f, 200) == 1.5);
    change(&f, 200, LW_SCENE_CHANGE_CLOCK_PLAY, 0, 0, NULL);
    assert_true(time_at(&f, 200) == 1.5 && time_at(&f, 201) == 2); /* at half the rate still */
    change(&f, 202, LW_SCENE_CHANGE_CLOCK_RATE, 0, 1, (float[]){-1});
    assert_true(time_at(&f, 203) == 1.5);
    change(&f, 203, LW_SCENE_CHANGE_CLOCK_PLAY, 0, 0, NULL); /* it plays already */
    assert_true(time_at(&f, 204) == 0.5);
    change(&f, 300, LW_SCENE_CHANGE_RESET, 0, 0, NULL);
    assert_true(time_at(&f, 300) == 0 && time_at(&f, 301) == 1);
    tear_down(&f);
    set_up(&f, 7, true); /* --freeze 7 */
    assert_true(time_at(&f, 50) == 7);
    change(&f, 50, LW_SCENE_CHANGE_CLOCK_PLAY, 0, 0, NULL);
    assert_true(time_at(&f, 51) == 8);
    change(&f, 60, LW_SCENE_CHANGE_RESET, 0, 0, NULL);
    assert_true(time_at(&f, 99) == 7);
    tear_down(&f);
}

static void a_reset_takes_all_back(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, 0, true);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_TRANSFORM, 0, 12, moved);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_HIDE, 1, 0, NULL);
    change(&f, 0, LW_SCENE_CHANGE_LIGHT_INTENSITY, 1, 3, (float[]){1, 2, 3});
    change(&f, 0, LW_SCENE_CHANGE_MATERIAL_EMISSION, 0, 3, (float[]){1, 2, 3});
    change(&f, 0, LW_SCENE_CHANGE_SKY, 0, 3, (float[]){5, 5, 5});
    change(&f, 0, LW_SCENE_CHANGE_CLOCK_SEEK, 0, 1, (float[]){1});
    assert_int_equal(difference(&f, 0), LW_POSE_OBJECTS | LW_POSE_LIGHTS | LW_POSE_MATERIALS | LW_POSE_SKY);
    change(&f, 0, LW_SCENE_CHANGE_RESET, 0, 0, NULL);
    assert_int_equal(difference(&f, 0), 0);
    tear_down(&f);
}

static void the_later_of_two_changes_counts(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f, 0, true);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_HIDE, 0, 0, NULL);
    change(&f, 0, LW_SCENE_CHANGE_OBJECT_SHOW, 0, 0, NULL);
    change(&f, 0, LW_SCENE_CHANGE_SKY, 0, 3, (float[]){1, 1, 1});
    change(&f, 0, LW_SCENE_CHANGE_SKY, 0, 3, (float[]){2, 2, 2});
    lw_scene_state_pose(&f.state, 0, &f.pose);
    assert_true(!f.pose.object_hidden[0] && f.pose.sky[0] == 2);
    tear_down(&f);
}

/* ---- as changes ---- */

static uint32_t seed;
static uint32_t draw(uint32_t count) { /* Numerical Recipes' generator; its high bits */
    seed = 1664525u * seed + 1013904223u;
    return (uint32_t)((uint64_t)(seed >> 8) * count >> 24);
}

static struct lw_scene_change draw_change(const struct lw_scene *scene) {
#define X(name, number, of, values) {LW_SCENE_CHANGE_##name, LW_SCENE_CHANGE_OF_##of, values},
    static const struct {
        uint32_t kind;
        enum lw_scene_change_of of;
        uint32_t values;
    } kinds[] = {LW_SCENE_CHANGE_MAP(X)};
#undef X
    const uint32_t k = draw(sizeof kinds / sizeof *kinds);
    struct lw_scene_change c = {.kind = kinds[k].kind, .value_count = kinds[k].values};
    c.target = draw(lw_scene_change_targets(scene, kinds[k].of));
    if (kinds[k].of == LW_SCENE_CHANGE_OF_SCENE) c.target = 0;
    for (uint32_t i = 0; i < c.value_count; i++) c.value[i] = (float)draw(1000) / 1000;
    for (uint32_t i = 0; c.value_count == 12 && i < 3; i++) c.value[5 * i] += 3;
    return c;
}

/* Makes a change as a server does. False: the server would refuse it. */
static bool apply_change(struct lw_scene_state *state, struct lw_scene_roster *roster,
                         const struct lw_scene_change *c, double wall_s) {
    struct lw_error err = {0};
    uint32_t object;
    if (lw_scene_change_check(state->original, c, &err) || lw_scene_roster_take(roster, c, &object, &err))
        return false;
    lw_scene_state_change(state, c, wall_s);
    return true;
}

static void expect_same_again(struct fixture *f, const struct lw_scene_state *now, double wall_s) {
    struct lw_scene_roster roster;
    struct lw_scene_change *change;
    struct lw_pose pose;
    size_t count;
    lw_support_ok(lw_scene_state_changes(now, wall_s, &change, &count), NULL);
    set_up_scene(f, now->start_scene_s, now->start_paused);
    lw_support_ok(lw_pose_init(&pose, f->scene), NULL);
    lw_support_ok(lw_scene_roster_init(&roster, f->scene), NULL);
    for (size_t i = 0; i < count; i++) assert_true(apply_change(&f->state, &roster, &change[i], 0));
    /* the clock, to a float's digits, and then everything at one moment of it */
    const double time_s = lw_scene_state_time(now, wall_s), again_s = lw_scene_state_time(&f->state, 0);
    if (count &&
        change[count - 1].kind == LW_SCENE_CHANGE_CLOCK_SEEK) /* else nobody has set it: it starts again */
        assert_true(fabs(again_s - fmax(time_s, 0)) <= 1e-6 * fabs(time_s));
    else
        assert_true(again_s == now->start_scene_s);
    assert_true(f->state.rate == (double)(float)now->rate && f->state.paused == now->paused);
    lw_scene_state_pose(now, wall_s, &pose);
    lw_pose_evaluate(&f->pose, &f->state.scene, time_s);
    f->state.anchor_scene_s = time_s;
    f->state.anchor_s = 0;
    lw_scene_state_pose(&f->state, 0, &f->pose);
    for (uint32_t i = 0; i < f->scene->light_count; i++) { /* made unit twice: the last bit */
        const struct lw_vec3 off = lw_vec3_sub(pose.light[i].direction_ws, f->pose.light[i].direction_ws);
        assert_true(lw_vec3_dot(off, off) < 1e-12f);
        f->pose.light[i].direction_ws = pose.light[i].direction_ws;
    }
    assert_int_equal(lw_pose_difference(&pose, &f->pose, f->scene) & ~(unsigned)LW_POSE_DYNAMIC, 0);
    lw_scene_roster_finish(&roster);
    free(change);
    lw_pose_finish(&pose);
    lw_pose_finish(&f->pose);
    lw_scene_state_finish(&f->state);
}

/* The list of changes makes the same state again from a new one. A server accepts each of them. */
static void its_changes_make_it_again(void **state) {
    (void)state;
    struct lw_error err = {0};
    struct fixture f = {.scene = lw_support_everything()};
    lw_support_ok(lw_scene_spares_add(f.scene, "2", &err), &err);
    unsigned taken = 0;
    for (uint32_t round = 0; round < 40; round++) {
        struct lw_scene_state now;
        struct lw_scene_roster roster;
        seed = round;
        lw_support_ok(lw_scene_state_init(&now, f.scene, 0.5 * round, round % 2), NULL);
        lw_support_ok(lw_scene_roster_init(&roster, f.scene), NULL);
        expect_same_again(&f, &now, 0);
        for (unsigned i = 0; i < 150; i++) {
            const double wall_s = i * 0.125;
            const struct lw_scene_change c = draw_change(f.scene);
            if (c.kind == LW_SCENE_CHANGE_RESET && draw(8)) continue; /* now and then */
            taken += apply_change(&now, &roster, &c, wall_s);
            if (i % 10 == 0) expect_same_again(&f, &now, wall_s);
        }
        lw_scene_roster_finish(&roster);
        lw_scene_state_finish(&now);
    }
    assert_true(taken > 3000);
    lw_scene_destroy(f.scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_changed_is_the_scene_itself),
        cmocka_unit_test(objects_go_and_come_back),
        cmocka_unit_test(what_stood_still_becomes_dynamic),
        cmocka_unit_test(lights_change_in_each_respect_alone),
        cmocka_unit_test(materials_and_sky_change_in_a_scene_of_its_own),
        cmocka_unit_test(the_clock_never_jumps_but_when_set),
        cmocka_unit_test(a_reset_takes_all_back),
        cmocka_unit_test(the_later_of_two_changes_counts),
        cmocka_unit_test(its_changes_make_it_again),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
