#include "tests/support/support.h"

#include "common/scene/scene_spares.h"
#include "server/solve/surface/standing.h"

/* Two squares; one is moved. */
struct fixture {
    struct lw_scene *scene;
    struct lw_pose was, is;
    struct lw_standing standing;
    uint64_t frame;
};
enum { FLOOR, DOOR };

static void set_up(struct fixture *f) {
    *f = (struct fixture){.scene = lw_support_squares(2, 2)};
    lw_support_ok(lw_pose_init(&f->was, f->scene), NULL);
    lw_support_ok(lw_pose_init(&f->is, f->scene), NULL);
    lw_support_ok(lw_standing_init(&f->standing, f->scene, &f->was), NULL);
}

static void tear_down(struct fixture *f) {
    lw_standing_finish(&f->standing);
    lw_pose_finish(&f->is);
    lw_pose_finish(&f->was);
    lw_scene_destroy(f->scene);
}

/* A frame in which it is moved by that much; whether something else stands. */
static bool go_on(struct fixture *f, float by_m) {
    f->is.object_dynamic[DOOR] |= by_m != 0;
    f->is.object_to_world[DOOR].m[0][3] += by_m;
    const bool changed = lw_standing_take(&f->standing, &f->was, &f->is, ++f->frame);
    lw_pose_copy(&f->was, &f->is, f->scene);
    assert_true(f->standing.stands[FLOOR]);
    return changed;
}

static void what_is_put_down_stands_at_once(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f);
    assert_true(f.standing.stands[DOOR]);
    assert_false(go_on(&f, 0));
    for (unsigned k = 0; k < 3; k++) {
        assert_true(go_on(&f, 1)); /* elsewhere */
        assert_true(f.standing.stood[DOOR] && f.standing.stands[DOOR]);
        for (unsigned rest = 1; rest < LW_STANDING_FRAMES; rest++) assert_false(go_on(&f, 0));
    }
    tear_down(&f);
}

static void what_moves_on_stands_once_it_has_rested(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f);
    assert_true(go_on(&f, 1));
    assert_true(go_on(&f, 1));
    assert_false(f.standing.stands[DOOR]);
    for (unsigned k = 0; k < 2 * LW_STANDING_FRAMES; k++) {
        assert_false(go_on(&f, 1));
        assert_false(f.standing.stands[DOOR]);
    }
    for (unsigned rest = 1; rest < LW_STANDING_FRAMES; rest++) {
        assert_false(go_on(&f, 0));
        assert_false(f.standing.stands[DOOR]);
    }
    assert_true(go_on(&f, 0));
    assert_true(f.standing.stands[DOOR] && !f.standing.stood[DOOR]);
    assert_false(go_on(&f, 0));
    tear_down(&f);
}

static void what_is_hidden_does_not(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f);
    f.is.object_dynamic[DOOR] = f.is.object_hidden[DOOR] = true;
    assert_true(go_on(&f, 0));
    assert_false(f.standing.stands[DOOR]);
    for (unsigned k = 0; k < 2 * LW_STANDING_FRAMES; k++) assert_false(go_on(&f, 0));
    assert_false(f.standing.stands[DOOR]);
    f.is.object_hidden[DOOR] = false;
    assert_true(go_on(&f, 0));
    assert_true(f.standing.stands[DOOR]);
    tear_down(&f);
}

static void nor_what_the_animation_moves(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f);
    f.was.node_moves[f.scene->object[DOOR].node] = f.is.node_moves[f.scene->object[DOOR].node] = true;
    lw_standing_finish(&f.standing);
    lw_support_ok(lw_standing_init(&f.standing, f.scene, &f.was), NULL);
    assert_false(f.standing.stands[DOOR]);
    for (unsigned k = 0; k < 2 * LW_STANDING_FRAMES; k++) assert_false(go_on(&f, 0));
    assert_false(f.standing.stands[DOOR]);
    tear_down(&f);
}

/* A spare hangs on no node. */
static void what_is_added_stands(void **state) {
    (void)state;
    struct fixture f = {.scene = lw_support_squares(2, 2)};
    struct lw_error err = {0};
    lw_support_ok(lw_scene_spares_add(f.scene, "1", &err), &err);
    const uint32_t spare = f.scene->object_count - 1;
    assert_true(lw_scene_is_spare(f.scene, spare));
    lw_support_ok(lw_pose_init(&f.was, f.scene), NULL);
    lw_support_ok(lw_pose_init(&f.is, f.scene), NULL);
    lw_support_ok(lw_standing_init(&f.standing, f.scene, &f.was), NULL);
    assert_false(f.standing.stands[spare]);
    f.is.object_spare[spare] = f.is.object_hidden[spare] = false;
    assert_true(lw_standing_take(&f.standing, &f.was, &f.is, 1));
    assert_true(f.standing.stands[spare]);
    tear_down(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_put_down_stands_at_once),
        cmocka_unit_test(what_moves_on_stands_once_it_has_rested),
        cmocka_unit_test(what_is_hidden_does_not),
        cmocka_unit_test(nor_what_the_animation_moves),
        cmocka_unit_test(what_is_added_stands),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
