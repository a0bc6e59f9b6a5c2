#include "tests/support/support.h"

#include "common/builtin/builtin.h"
#include "common/open/scene_open.h"
#include "common/scene/pose.h"
#include "common/scene/scene_motion.h"

#include <math.h>
#include <string.h>

static struct lw_scene *build(const char *name) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build(name, &scene, &err), &err);
    return scene;
}

/* The atrium and the city, each built once. */
static struct built {
    const char *name;
    struct lw_scene *scene;
} large[] = {{"builtin:atrium-matt", NULL}, {"builtin:city", NULL}};

static void *copy(struct lw_scene *scene, const void *array, size_t count, size_t size) {
    void *copied = lw_scene_alloc(scene, count, size);
    assert_non_null(copied);
    if (count) memcpy(copied, array, count * size);
    return copied;
}

/* One of them as it was built. All that a motion may write to is its own; the original, which ends with the
 * program, owns the memory. */
static struct lw_scene *fresh(const char *name) {
    struct built *b = large;
    while (strcmp(b->name, name) != 0) b++;
    if (!b->scene) b->scene = build(name);
    struct lw_scene *scene = copy(b->scene, b->scene, 1, sizeof *scene);
    scene->node = copy(scene, scene->node, scene->node_count, sizeof *scene->node);
    scene->object = copy(scene, scene->object, scene->object_count, sizeof *scene->object);
    scene->light = copy(scene, scene->light, scene->light_count, sizeof *scene->light);
    scene->channel = copy(scene, scene->channel, scene->channel_count, sizeof *scene->channel);
    return scene;
}

static int destroy_large(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof large / sizeof *large; i++) lw_scene_destroy(large[i].scene);
    return 0;
}

static struct lw_scene_motion_report set(struct lw_scene *scene, enum lw_scene_motion motion) {
    struct lw_scene_motion_report report;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_motion_set(scene, motion, &report, &err), &err);
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    return report;
}

static bool shines(const struct lw_scene *scene, uint32_t object) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int c = 0; c < 3; c++)
            if (scene->material[mesh->material[t]].emission[c] > 0) return true;
    return false;
}

/* How many objects without light, lamps and lights are elsewhere half a second on. */
struct moved {
    uint32_t objects, lamps, lights;
};

static struct moved moved_in(const struct lw_scene *scene) {
    struct lw_pose before, after;
    struct moved moved = {0};
    lw_support_ok(lw_pose_init(&before, scene), NULL);
    lw_support_ok(lw_pose_init(&after, scene), NULL);
    lw_pose_evaluate(&after, scene, 0.5);
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (memcmp(&before.object_to_world[o], &after.object_to_world[o], sizeof before.object_to_world[o]) !=
            0)
            *(shines(scene, o) ? &moved.lamps : &moved.objects) += 1;
    for (uint32_t l = 0; l < scene->light_count; l++)
        moved.lights += memcmp(&before.light[l], &after.light[l], sizeof before.light[l]) != 0;
    lw_pose_finish(&after);
    lw_pose_finish(&before);
    return moved;
}

/* Three squares and a lamp; the second square moves, and the lamp with the third hanging on it. */
static struct lw_scene *build_moving(void) {
    static const float time_s[] = {0, 1}, value[] = {0, 0, 0, 1, 0, 0};
    struct lw_scene *scene = lw_support_squares(3, 1);
    const uint32_t lamp = scene->light[0].node;
    scene->object[2].node = lamp;
    scene->duration_s = 1;
    scene->channel = lw_scene_alloc(scene, 2, sizeof *scene->channel);
    scene->channel_count = 2;
    const uint32_t mover[] = {scene->object[1].node, lamp};
    for (int c = 0; c < 2; c++)
        scene->channel[c] = (struct lw_channel){.node = mover[c],
                                                .path = LW_CHANNEL_TRANSLATION,
                                                .interpolation = LW_INTERPOLATION_LINEAR,
                                                .key_count = 2,
                                                .time_s = time_s,
                                                .value = value};
    return scene;
}

static void a_scene_keeps_what_belongs(void **state) {
    (void)state;
    static const struct {
        enum lw_scene_motion motion;
        uint32_t kept, lights, objects;
    } cases[] = {{LW_SCENE_MOTION_STATIC, 0, 0, 0},
                 {LW_SCENE_MOTION_LIGHT, 1, 1, 1}, /* what hangs on a lamp goes with it */
                 {LW_SCENE_MOTION_OBJECT, 1, 0, 1},
                 {LW_SCENE_MOTION_ALL, 2, 1, 2}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = build_moving();
        struct lw_scene_motion_report report = set(scene, cases[i].motion);
        struct moved moved = moved_in(scene);
        assert_null(report.light);
        assert_null(report.object);
        assert_int_equal(report.kept, cases[i].kept);
        assert_int_equal(report.dropped, 2 - cases[i].kept);
        assert_int_equal(moved.lights, cases[i].lights);
        assert_int_equal(moved.objects, cases[i].objects);
        lw_scene_destroy(scene);
    }
}

static void a_still_scene_gets_one_mover(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell");
    struct lw_scene_motion_report report = set(scene, LW_SCENE_MOTION_LIGHT);
    struct moved moved = moved_in(scene);
    assert_non_null(report.light);
    assert_int_equal(moved.lamps, 1);
    assert_int_equal(moved.objects, 0);
    assert_true(scene->duration_s == 4);
    lw_scene_destroy(scene);

    scene = build("builtin:cornell");
    report = set(scene, LW_SCENE_MOTION_ALL);
    moved = moved_in(scene);
    assert_non_null(report.light);
    assert_non_null(report.object);
    assert_int_equal(moved.lamps, 1);
    assert_int_equal(moved.objects, 1);
    lw_scene_destroy(scene);
}

/* The point light of the squares, under a turned and scaled matrix: its circle lies level in the world. */
static void a_light_goes_round_level(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(2, 5);
    const uint32_t node = scene->light[0].node;
    scene->node[node].has_matrix = 1;
    scene->node[node].matrix = (struct lw_affine){{{0, -2, 0, 1}, {2, 0, 0, 3}, {0, 0, 2, -1}}};
    set(scene, LW_SCENE_MOTION_LIGHT);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    struct lw_vec3 low, high;
    assert_true(lw_pose_bounds(&pose, scene, &low, &high));
    const float radius = 0.05f * (high.x - low.x);
    for (int k = 0; k < 16; k++) {
        lw_pose_evaluate(&pose, scene, 0.25 * k);
        struct lw_vec3 at = lw_vec3_sub(pose.light[0].position_ws, lw_vec3(1, 3, -1));
        assert_float_equal(at.y, 0, 1e-4f);
        assert_float_equal(lw_vec3_length(at), radius, 1e-2f * radius);
    }
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

/* About its own middle, so that it stays where it is. */
static void an_object_turns_in_place(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell");
    set(scene, LW_SCENE_MOTION_OBJECT);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (!lw_pose_object_moves(&pose, scene, o)) continue;
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        struct lw_vec3 low = mesh->position[0], high = low;
        for (uint32_t v = 1; v < mesh->vertex_count; v++) {
            struct lw_vec3 p = mesh->position[v];
            low = lw_vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
            high = lw_vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
        }
        struct lw_vec3 middle = lw_vec3_scale(lw_vec3_add(low, high), 0.5f);
        lw_pose_evaluate(&pose, scene, 0);
        struct lw_vec3 first = lw_affine_point(&pose.object_to_world[o], middle);
        for (int k = 1; k < 16; k++) {
            lw_pose_evaluate(&pose, scene, 0.25 * k);
            struct lw_vec3 at = lw_affine_point(&pose.object_to_world[o], middle);
            assert_true(lw_vec3_length(lw_vec3_sub(at, first)) < 1e-4f);
        }
    }
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

/* Beside an upright square: a full circle would pass through it. */
static void a_light_keeps_clear_of_surfaces(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(3, 1);
    const uint32_t o = scene->object[1].node, l = scene->light[0].node;
    const float wide[3] = {40, 1, 40}, up[4] = {0, 0, 0.70710678f, 0.70710678f}; /* upright, 40 m long */
    memcpy(scene->node[o].scale, wide, sizeof wide);
    memcpy(scene->node[o].rotation, up, sizeof up);
    memcpy(scene->node[l].translation, scene->node[o].translation, sizeof wide);
    scene->node[l].translation[0] += 0.6f; /* off its plane */
    set(scene, LW_SCENE_MOTION_LIGHT);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    float nearest = INFINITY, farthest = 0;
    for (int k = 0; k < 64; k++) {
        lw_pose_evaluate(&pose, scene, k * (double)scene->duration_s / 64);
        const float off = pose.light[0].position_ws.x - scene->node[o].translation[0];
        nearest = fminf(nearest, off);
        farthest = fmaxf(farthest, off);
    }
    const float radius = (farthest - nearest) / 2;
    assert_true(radius > 0.53f && radius < 0.56f);
    assert_true(nearest > 0.99f * radius / 10);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void a_scene_that_cannot_is_refused(void **state) {
    (void)state;
    struct lw_scene_motion_report report;
    struct lw_error err = {0};
    struct lw_scene *scene = lw_support_squares(1, 1); /* one object: it is the scene */
    enum lw_status status = lw_scene_motion_set(scene, LW_SCENE_MOTION_OBJECT, &report, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "none is small enough");
    scene->light_count = 0;
    scene->sky[0] = 1;
    err = (struct lw_error){0};
    status = lw_scene_motion_set(scene, LW_SCENE_MOTION_LIGHT, &report, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "no light of it moves");
    lw_scene_destroy(scene);
}

/* ---- one mover of a stated speed ---- */

static struct lw_scene *build_sponza(void) {
    const struct lw_scene_open open = {.path = lw_support_scene("sponza/Sponza_lit.gltf"),
                                       .sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG,
                                       .texels_per_metre = 2};
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_open(&open, &scene, &err), &err);
    return scene;
}

/* The one that is named, in the middle of its box; or its light. */
static struct lw_vec3 place_of(const struct lw_scene *scene, const struct lw_pose *pose, const char *name) {
    for (uint32_t l = 0; l < scene->light_count; l++)
        if (strcmp(scene->light[l].name, name) == 0) return pose->light[l].position_ws;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (strcmp(scene->object[o].name, name) != 0) continue;
        struct lw_vec3 low = lw_vec3(INFINITY, INFINITY, INFINITY), high = lw_vec3_scale(low, -1);
        lw_pose_object_bounds(pose, scene, o, &low, &high);
        return lw_vec3_scale(lw_vec3_add(low, high), 0.5f);
    }
    fail_msg("no %s", name);
    return lw_vec3(0, 0, 0);
}

static struct lw_vec3 sun_of(const struct lw_scene *scene, const struct lw_pose *pose, const char *name) {
    for (uint32_t l = 0; l < scene->light_count; l++)
        if (strcmp(scene->light[l].name, name) == 0) return pose->light[l].direction_ws;
    fail_msg("no %s", name);
    return lw_vec3(0, 0, 0);
}

/* Its speed is the one that is reported, all the time from 2 to 6 s; sets what else moves to still. */
static void check_speed(struct lw_scene *scene, enum lw_scene_motion motion, float least, float most) {
    const bool sun = motion == LW_SCENE_MOTION_SUN_SWING;
    const struct lw_scene_motion_report report = set(scene, motion);
    const char *name = motion == LW_SCENE_MOTION_CARRY ? report.object : report.light;
    assert_non_null(name);
    const float promised = sun ? report.speed_deg_s : report.speed_m_s;
    assert_true(promised >= least && promised <= most);
    struct lw_pose pose;
    struct lw_vec3 before = lw_vec3(0, 0, 0);
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    for (int k = 0; k <= 40; k++) {
        lw_pose_evaluate(&pose, scene, 2 + 0.1 * k);
        const struct lw_vec3 at = sun ? sun_of(scene, &pose, name) : place_of(scene, &pose, name);
        if (!sun && motion == LW_SCENE_MOTION_LAMP_WALK) { /* on its way */
            const struct lw_vec3 way = lw_vec3_sub(report.to_ws, report.from_ws);
            const float share = lw_vec3_dot(lw_vec3_sub(at, report.from_ws), way) / lw_vec3_dot(way, way);
            assert_true(share > 0.1f && share < 0.9f);
            assert_true(lw_vec3_length(lw_vec3_sub(at, lw_vec3_mad(report.from_ws, way, share))) < 0.01f);
        }
        const float step = sun ? 2 * asinf(0.5f * lw_vec3_length(lw_vec3_sub(at, before))) * 180 / LW_PI
                               : lw_vec3_length(lw_vec3_sub(at, before));
        if (k > 0) assert_float_equal(step / 0.1f, promised, 0.02f * promised);
        before = at;
    }
    lw_pose_finish(&pose);
}

static void movers_keep_their_speed(void **state) {
    (void)state;
    static const struct {
        const char *scene;
        enum lw_scene_motion motion;
        float least, most;
    } cases[] = {
        {"builtin:atrium-matt", LW_SCENE_MOTION_LAMP_WALK, 1.5f, 1.5f},
        {"builtin:atrium-matt", LW_SCENE_MOTION_SUN_SWING, 6, 6},
        {"builtin:atrium-matt", LW_SCENE_MOTION_CARRY, 1, 1},
        {"builtin:city", LW_SCENE_MOTION_LAMP_WALK, 1.5f, 1.5f},
        {"builtin:city", LW_SCENE_MOTION_SUN_SWING, 6, 6},
        {"builtin:cornell", LW_SCENE_MOTION_LAMP_WALK, 0.01f, 1.5f}, /* no room for a walker's pace */
        {"builtin:cornell", LW_SCENE_MOTION_CARRY, 0.001f, 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const bool small = strcmp(cases[i].scene, "builtin:cornell") == 0;
        struct lw_scene *scene = small ? build(cases[i].scene) : fresh(cases[i].scene);
        check_speed(scene, cases[i].motion, cases[i].least, cases[i].most);
        if (small) lw_scene_destroy(scene);
    }
}

static void movers_of_sponza_keep_their_speed(void **state) {
    (void)state;
    struct lw_scene *scene = build_sponza();
    check_speed(scene, LW_SCENE_MOTION_LAMP_WALK, 1.5f, 1.5f);
    lw_scene_destroy(scene);
    scene = build_sponza();
    check_speed(scene, LW_SCENE_MOTION_SUN_SWING, 6, 6);
    lw_scene_destroy(scene);
}

/* Nothing but cameras and the mover moves. */
static void other_movers_stand(void **state) {
    (void)state;
    struct lw_scene *scene = fresh("builtin:atrium-matt");
    set(scene, LW_SCENE_MOTION_LAMP_WALK);
    struct moved moved = moved_in(scene);
    assert_int_equal(moved.lamps, 1);
    assert_int_equal(moved.objects + moved.lights, 0);
    scene = fresh("builtin:city");
    set(scene, LW_SCENE_MOTION_SUN_SWING);
    moved = moved_in(scene);
    assert_int_equal(moved.lights, 1);
    assert_int_equal(moved.objects + moved.lamps, 0);
    scene = fresh("builtin:atrium-matt");
    set(scene, LW_SCENE_MOTION_CARRY);
    moved = moved_in(scene);
    assert_int_equal(moved.objects, 1);
    assert_int_equal(moved.lamps + moved.lights, 0);
}

static bool same_at(const struct lw_scene *scene, struct lw_pose *a, struct lw_pose *b, double first_s,
                    double second_s) {
    lw_pose_evaluate(a, scene, first_s);
    lw_pose_evaluate(b, scene, second_s);
    return lw_pose_equal(a, b, scene);
}

/* Nothing changes but at 3 and 5 s, and then it is dark, and as it was. */
static void check_switch(struct lw_scene *scene, bool shrinks) {
    const struct lw_scene_motion_report report = set(scene, LW_SCENE_MOTION_LAMP_SWITCH);
    struct lw_pose a, b;
    lw_support_ok(lw_pose_init(&a, scene), NULL);
    lw_support_ok(lw_pose_init(&b, scene), NULL);
    assert_true(same_at(scene, &a, &b, 0, 2.99));
    assert_false(same_at(scene, &a, &b, 2.99, 3));
    assert_true(same_at(scene, &a, &b, 3, 4.99));
    assert_true(same_at(scene, &a, &b, 0, 5));
    assert_true(same_at(scene, &a, &b, 5, 7.9));
    lw_pose_evaluate(&a, scene, 1);
    lw_pose_evaluate(&b, scene, 4);
    const struct lw_vec3 lit = place_of(scene, &a, report.light), dark = place_of(scene, &b, report.light);
    const float off = lw_vec3_length(lw_vec3_sub(lit, dark));
    assert_int_equal(report.switch_m == 0, shrinks);
    assert_float_equal(off, report.switch_m, 1e-3f + 1e-3f * report.switch_m);
    if (!shrinks) assert_true(off > 1000);
    for (uint32_t o = 0; shrinks && o < scene->object_count; o++) {
        if (strcmp(scene->object[o].name, report.light) != 0) continue;
        struct lw_vec3 low = lw_vec3(INFINITY, INFINITY, INFINITY), high = lw_vec3_scale(low, -1);
        lw_pose_object_bounds(&b, scene, o, &low, &high);
        assert_true(lw_vec3_length(lw_vec3_sub(high, low)) < 0.01f);
    }
    lw_pose_finish(&b);
    lw_pose_finish(&a);
}

static void a_lamp_goes_off_and_on(void **state) {
    (void)state;
    struct lw_scene *scene = fresh("builtin:atrium-matt");
    check_switch(scene, true);
    scene = lw_support_squares(3, 1);
    check_switch(scene, false);
    lw_scene_destroy(scene);
}

static void a_scene_without_the_mover_is_refused(void **state) {
    (void)state;
    struct lw_scene_motion_report report;
    struct lw_error err = {0};
    struct lw_scene *scene = lw_support_squares(1, 1);
    enum lw_status status = lw_scene_motion_set(scene, LW_SCENE_MOTION_SUN_SWING, &report, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "no sun");
    err = (struct lw_error){0};
    status = lw_scene_motion_set(scene, LW_SCENE_MOTION_CARRY, &report, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "small enough to be carried");
    scene->light_count = 0;
    scene->sky[0] = 1;
    for (int m = LW_SCENE_MOTION_LAMP_WALK; m <= LW_SCENE_MOTION_LAMP_SWITCH; m += 2) {
        err = (struct lw_error){0};
        status = lw_scene_motion_set(scene, (enum lw_scene_motion)m, &report, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, "no lamp");
    }
    lw_scene_destroy(scene);
}

static void motions_have_names(void **state) {
    (void)state;
    char choices[200] = "";
    for (int m = 0; m < LW_SCENE_MOTION_COUNT; m++) {
        if (m) strcat(choices, "|");
        strcat(choices, lw_scene_motion_name((enum lw_scene_motion)m));
    }
    assert_string_equal(choices, LW_SCENE_MOTION_CHOICES); /* in the order of the enum */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_scene_keeps_what_belongs),
        cmocka_unit_test(a_still_scene_gets_one_mover),
        cmocka_unit_test(a_light_goes_round_level),
        cmocka_unit_test(an_object_turns_in_place),
        cmocka_unit_test(a_light_keeps_clear_of_surfaces),
        cmocka_unit_test(a_scene_that_cannot_is_refused),
        cmocka_unit_test(movers_keep_their_speed),
        cmocka_unit_test(movers_of_sponza_keep_their_speed),
        cmocka_unit_test(other_movers_stand),
        cmocka_unit_test(a_lamp_goes_off_and_on),
        cmocka_unit_test(a_scene_without_the_mover_is_refused),
        cmocka_unit_test(motions_have_names),
    };
    return cmocka_run_group_tests(tests, NULL, destroy_large);
}
