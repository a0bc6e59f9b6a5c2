#include "tests/support/support.h"

#include "common/scene/package.h"
#include "common/scene/scene_spares.h"
#include "common/scene/scene_state.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const float there[12] = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7},
                   elsewhere[12] = {2, 0, 0, -1, 0, 2, 0, 0, 0, 0, 2, 9};

static struct lw_scene *with_spares(unsigned objects, const char *spares) {
    struct lw_scene *scene = lw_support_squares(objects, 1);
    struct lw_error err = {0};
    lw_support_ok(lw_scene_spares_add(scene, spares, &err), &err);
    return scene;
}

static struct lw_scene_change change_of(enum lw_scene_change_kind kind, uint32_t target,
                                        const float *values) {
    struct lw_scene_change change = {.kind = kind, .target = target, .value_count = values ? 12 : 0};
    if (values) memcpy(change.value, values, sizeof there);
    return change;
}

static enum lw_scene_change_code apply_change(struct lw_scene_roster *roster, enum lw_scene_change_kind kind,
                                              uint32_t target, uint32_t *out_object) {
    struct lw_error err = {0};
    const struct lw_scene_change change =
        change_of(kind, target, kind == LW_SCENE_CHANGE_OBJECT_ADD ? there : NULL);
    assert_int_equal(lw_scene_change_check(roster->scene, &change, &err), LW_SCENE_CHANGE_OK);
    const enum lw_scene_change_code code = lw_scene_roster_take(roster, &change, out_object, &err);
    assert_int_equal(code != LW_SCENE_CHANGE_OK, err.text[0] != 0);
    assert_true(strlen(err.text) < 200);
    return code;
}

static void expect_none_left(struct lw_scene_roster *roster, const char *text) {
    struct lw_error err = {0};
    uint32_t object;
    const struct lw_scene_change add = change_of(LW_SCENE_CHANGE_OBJECT_ADD, 0, there);
    assert_int_equal(lw_scene_roster_take(roster, &add, &object, &err), LW_SCENE_CHANGE_NO_SPARE);
    assert_string_equal(err.text, text);
}

static void expect_added(struct lw_scene_roster *roster, uint32_t object) {
    uint32_t added = UINT32_MAX;
    assert_int_equal(apply_change(roster, LW_SCENE_CHANGE_OBJECT_ADD, 0, &added), LW_SCENE_CHANGE_OK);
    assert_int_equal(added, object);
}

/* ---- spares ---- */

static void spares_follow_the_objects_and_have_names(void **state) {
    (void)state;
    struct lw_scene *scene = with_spares(2, "square=3");
    assert_int_equal(scene->object_count, 5);
    assert_false(lw_scene_is_spare(scene, 1));
    for (uint32_t o = 2; o < 5; o++) assert_true(lw_scene_is_spare(scene, o) && scene->object[o].mesh == 0);
    assert_string_equal(scene->object[1].name, "square 1");
    assert_string_equal(scene->object[2].name, "square#1");
    assert_string_equal(scene->object[4].name, "square#3");
    uint8_t *bytes;
    size_t size;
    struct lw_scene *again;
    struct lw_error err = {0};
    lw_support_ok(lw_package_write(scene, &bytes, &size, &err), &err); /* and are part of the package */
    lw_support_ok(lw_package_read(bytes, size, &again, &err), &err);
    assert_true(again->object_count == 5 && lw_scene_is_spare(again, 4) && !lw_scene_is_spare(again, 1));
    free(bytes);
    lw_scene_destroy(again);
    lw_scene_destroy(scene);
}

static void spares_are_counted_by_mesh(void **state) {
    (void)state;
    static const struct {
        const char *text;
        uint32_t spares;
    } fine[] = {{"2", 2},         {"0", 0}, {"#0=4", 4}, {"3,square=0", 0}, {"square=1,square=2", 2},
                {"square=1,3", 3}};
    for (size_t i = 0; i < sizeof fine / sizeof *fine; i++) {
        struct lw_scene *scene = with_spares(1, fine[i].text);
        assert_int_equal(scene->object_count, 1 + fine[i].spares);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = lw_support_everything();
    const uint32_t objects = scene->object_count;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_spares_add(scene, "1", &err), &err);
    assert_int_equal(scene->object_count, objects + scene->mesh_count);
    assert_int_equal(scene->object[objects + 1].mesh, 1);
    lw_scene_destroy(scene);
}

static void wrong_spares_leave_the_scene_alone(void **state) {
    (void)state;
    static const struct {
        const char *text, *why;
    } bad[] = {{"", "neither MESH=N nor N"},
               {"square", "neither"},
               {"square=", "neither"},
               {"square=-1", "neither"},
               {"square=1x", "neither"},
               {"square=65537", "from 0 to 65536"},
               {"square=99999999999999999999", "from 0 to 65536"},
               {"1,,2", "neither"},
               {"1,", "neither"},
               {"chair=1", "no mesh is called \"chair\""},
               {"=1", "no mesh is called \"\""},
               {"#1=1", "no mesh is called \"#1\""},
               {"#=1", "no mesh is called \"#\""}};
    struct lw_scene *scene = lw_support_squares(2, 1);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct lw_error err = {0};
        lw_support_fails(lw_scene_spares_add(scene, bad[i].text, &err), LW_USAGE, &err, bad[i].why);
        assert_int_equal(scene->object_count, 2);
    }
    struct lw_error err = {0};
    scene->mesh[0].lightmap_uv = lw_scene_alloc(scene, 4, sizeof *scene->mesh[0].lightmap_uv);
    scene->mesh[0].atlas_width = scene->mesh[0].atlas_height = 2048; /* 2^22 texels each */
    lw_support_fails(lw_scene_spares_add(scene, "square=63", &err), LW_BAD_DATA, &err,
                     "texels in its objects");
    assert_int_equal(scene->object_count, 2);
    err = (struct lw_error){0};
    lw_support_ok(lw_scene_spares_add(scene, "square=62", &err), &err);
    lw_scene_destroy(scene);
}

/* ---- the roster ---- */

static void the_first_spare_is_taken_until_none_is_left(void **state) {
    (void)state;
    struct lw_scene *scene = with_spares(130, "square=70"); /* over several words of bits */
    struct lw_scene_roster roster;
    uint32_t object = 77;
    lw_support_ok(lw_scene_roster_init(&roster, scene), NULL);
    for (uint32_t o = 130; o < 200; o++) expect_added(&roster, o);
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_ADD, 0, &object), LW_SCENE_CHANGE_NO_SPARE);
    assert_int_equal(object, 77);
    expect_none_left(
        &roster, "mesh \"square\": no spare of this mesh is left: start lightwelld with --spares square=N");
    scene->mesh[0].name = "a b";
    expect_none_left(&roster,
                     "mesh \"a b\": no spare of this mesh is left: start lightwelld with --spares \"a b=N\"");
    scene->mesh[0].name = "a,b";
    expect_none_left(&roster,
                     "mesh 0: no spare of this mesh is left: start lightwelld with --spares \"#0=N\"");
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_REMOVE, 190, &object), LW_SCENE_CHANGE_OK);
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_REMOVE, 3, &object), LW_SCENE_CHANGE_OK);
    assert_int_equal(object, 3);
    expect_added(&roster, 3);
    expect_added(&roster, 190);
    for (uint32_t o = 0; o < 200; o++) /* all of them, and all of them back */
        assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_REMOVE, o, &object),
                         LW_SCENE_CHANGE_OK);
    for (uint32_t o = 0; o < 200; o++) expect_added(&roster, o);
    lw_scene_roster_finish(&roster);
    lw_scene_roster_finish(&roster); /* twice is fine */
    lw_scene_destroy(scene);
}

static void what_is_absent_cannot_be_changed(void **state) {
    (void)state;
    struct lw_scene *scene = with_spares(2, "1");
    struct lw_scene_roster roster;
    uint32_t object = 77;
    lw_support_ok(lw_scene_roster_init(&roster, scene), NULL);
    static const enum lw_scene_change_kind kinds[] = {
        LW_SCENE_CHANGE_OBJECT_RESTORE, LW_SCENE_CHANGE_OBJECT_HIDE, LW_SCENE_CHANGE_OBJECT_SHOW,
        LW_SCENE_CHANGE_OBJECT_REMOVE};
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        assert_int_equal(apply_change(&roster, kinds[i], 2, &object), LW_SCENE_CHANGE_ABSENT);
    struct lw_error err = {0};
    const struct lw_scene_change move = change_of(LW_SCENE_CHANGE_OBJECT_TRANSFORM, 2, there);
    assert_int_equal(lw_scene_roster_take(&roster, &move, &object, &err), LW_SCENE_CHANGE_ABSENT);
    assert_non_null(strstr(err.text, "object 2"));
    assert_int_equal(object, 77);
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_REMOVE, 1, &object), LW_SCENE_CHANGE_OK);
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_REMOVE, 1, &object),
                     LW_SCENE_CHANGE_ABSENT);
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_RESET, 0, &object), LW_SCENE_CHANGE_OK);
    assert_true(!lw_scene_roster_is_spare(&roster, 1) && lw_scene_roster_is_spare(&roster, 2));
    lw_scene_roster_finish(&roster);
    lw_scene_destroy(scene);
}

static void an_update_that_is_refused_leaves_no_trace(void **state) {
    (void)state;
    struct lw_scene *scene = with_spares(2, "2");
    struct lw_scene_roster roster;
    uint32_t object;
    lw_support_ok(lw_scene_roster_init(&roster, scene), NULL);
    expect_added(&roster, 2);
    lw_scene_roster_save(&roster);
    expect_added(&roster, 3);
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_REMOVE, 0, &object), LW_SCENE_CHANGE_OK);
    lw_scene_roster_go_back(&roster);
    assert_false(lw_scene_roster_is_spare(&roster, 0));
    assert_true(lw_scene_roster_is_spare(&roster, 3));
    expect_added(&roster, 3);
    lw_scene_roster_finish(&roster);
    lw_scene_destroy(scene);
}

static void meshes_keep_their_spares_apart(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    struct lw_error err = {0};
    const uint32_t objects = scene->object_count;
    lw_support_ok(lw_scene_spares_add(scene, "0,#1=1", &err), &err);
    struct lw_scene_roster roster;
    uint32_t object;
    lw_support_ok(lw_scene_roster_init(&roster, scene), NULL);
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_ADD, 0, &object), LW_SCENE_CHANGE_NO_SPARE);
    assert_int_equal(apply_change(&roster, LW_SCENE_CHANGE_OBJECT_ADD, 1, &object), LW_SCENE_CHANGE_OK);
    assert_int_equal(object, objects);
    lw_scene_roster_finish(&roster);
    lw_scene_destroy(scene);
}

/* ---- the state of the scene, and its pose ---- */

struct fixture {
    struct lw_scene *scene;
    struct lw_scene_state state;
    struct lw_pose pose;
};

static void set_up(struct fixture *f) {
    f->scene = with_spares(2, "1");
    lw_support_ok(lw_scene_state_init(&f->state, f->scene, 0, false), NULL);
    lw_support_ok(lw_pose_init(&f->pose, f->scene), NULL);
}

static void tear_down(struct fixture *f) {
    lw_pose_finish(&f->pose);
    lw_scene_state_finish(&f->state);
    lw_scene_destroy(f->scene);
}

static void make(struct fixture *f, enum lw_scene_change_kind kind, uint32_t target, const float *values) {
    const struct lw_scene_change change = change_of(kind, target, values);
    lw_scene_state_change(&f->state, &change, 0);
    lw_scene_state_pose(&f->state, 0, &f->pose);
}

static void expect(const struct fixture *f, uint32_t object, bool spare, bool hidden, const float *values) {
    assert_int_equal(f->pose.object_spare[object], spare);
    assert_int_equal(f->pose.object_hidden[object], hidden);
    assert_true(lw_pose_object_moves(&f->pose, f->scene, object));
    if (values) assert_memory_equal(f->pose.object_to_world[object].m, values, sizeof there);
}

static void a_spare_is_nowhere_in_the_pose(void **state) {
    (void)state;
    struct fixture f;
    struct lw_vec3 low, high;
    set_up(&f);
    expect(&f, 2, true, true, NULL);
    assert_true(lw_pose_bounds(&f.pose, f.scene, &low, &high));
    assert_true(low.x == -0.5f && high.x == 2.5f);
    struct lw_pose other;
    lw_support_ok(lw_pose_init(&other, f.scene), NULL);
    lw_scene_state_pose(&f.state, 0, &f.pose); /* a scene that nothing has changed is the scene itself */
    assert_int_equal(lw_pose_difference(&f.pose, &other, f.scene), 0);
    make(&f, LW_SCENE_CHANGE_OBJECT_ADD, 0, there);
    assert_int_equal(lw_pose_difference(&f.pose, &other, f.scene), LW_POSE_OBJECTS); /* no new mover */
    lw_pose_copy(&other, &f.pose, f.scene);
    assert_int_equal(lw_pose_difference(&f.pose, &other, f.scene), 0);
    assert_false(other.object_spare[2]);
    lw_pose_finish(&other);
    tear_down(&f);
}

static void objects_are_added_moved_restored_and_removed(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f);
    make(&f, LW_SCENE_CHANGE_OBJECT_ADD, 0, there);
    expect(&f, 2, false, false, there);
    make(&f, LW_SCENE_CHANGE_OBJECT_TRANSFORM, 2, elsewhere);
    make(&f, LW_SCENE_CHANGE_OBJECT_HIDE, 2, NULL);
    expect(&f, 2, false, true, elsewhere);
    make(&f, LW_SCENE_CHANGE_OBJECT_RESTORE, 2, NULL); /* where it was added, and shown */
    expect(&f, 2, false, false, there);
    make(&f, LW_SCENE_CHANGE_OBJECT_HIDE, 2, NULL);
    make(&f, LW_SCENE_CHANGE_OBJECT_REMOVE, 2, NULL);
    expect(&f, 2, true, true, NULL);
    make(&f, LW_SCENE_CHANGE_OBJECT_ADD, 0, elsewhere); /* shown, though it was hidden when it went */
    expect(&f, 2, false, false, elsewhere);
    make(&f, LW_SCENE_CHANGE_RESET, 0, NULL);
    expect(&f, 2, true, true, NULL);
    tear_down(&f);
}

static void objects_of_the_file_are_spares_once_they_are_removed(void **state) {
    (void)state;
    struct fixture f;
    set_up(&f);
    lw_scene_state_pose(&f.state, 0, &f.pose);
    const struct lw_affine home = f.pose.object_to_world[1];
    make(&f, LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1, elsewhere);
    make(&f, LW_SCENE_CHANGE_OBJECT_REMOVE, 1, NULL);
    expect(&f, 1, true, true, NULL);
    make(&f, LW_SCENE_CHANGE_OBJECT_ADD, 0, there); /* before the one that was a spare from the start */
    expect(&f, 1, false, false, there);
    make(&f, LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1, elsewhere);
    make(&f, LW_SCENE_CHANGE_OBJECT_RESTORE, 1, NULL);
    expect(&f, 1, false, false, there);
    make(&f, LW_SCENE_CHANGE_RESET, 0, NULL); /* as the file has it */
    expect(&f, 1, false, false, &home.m[0][0]);
    make(&f, LW_SCENE_CHANGE_OBJECT_REMOVE, 0, NULL);
    make(&f, LW_SCENE_CHANGE_OBJECT_REMOVE, 1, NULL); /* all of them */
    for (uint32_t o = 0; o < 3; o++) assert_true(f.pose.object_hidden[o] && f.pose.object_spare[o]);
    struct lw_vec3 low, high;
    assert_false(lw_pose_bounds(&f.pose, f.scene, &low, &high));
    tear_down(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spares_follow_the_objects_and_have_names),
        cmocka_unit_test(spares_are_counted_by_mesh),
        cmocka_unit_test(wrong_spares_leave_the_scene_alone),
        cmocka_unit_test(the_first_spare_is_taken_until_none_is_left),
        cmocka_unit_test(what_is_absent_cannot_be_changed),
        cmocka_unit_test(an_update_that_is_refused_leaves_no_trace),
        cmocka_unit_test(meshes_keep_their_spares_apart),
        cmocka_unit_test(a_spare_is_nowhere_in_the_pose),
        cmocka_unit_test(objects_are_added_moved_restored_and_removed),
        cmocka_unit_test(objects_of_the_file_are_spares_once_they_are_removed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
