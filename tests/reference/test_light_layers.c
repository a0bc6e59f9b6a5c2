/* Light in layers: the same light as in one, switched and coloured without a ray. */
#include "common/base/colour.h"
#include "server/solve/cell_layer.h"
#include "tests/reference/room.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct lw_solver_desc desc = {
    .bounces = 2, .direct_samples = 1, .indirect_samples = 4, .target_error = 0.05f};
/* An object's light after a change: blocks converge with up to target_error of it out of date, in direct
 * and in indirect light each. */
#define AFTER_CHANGE 0.05

static void begin(struct room_solution *s, const char *groups, unsigned frames) {
    const struct room room = room_with_two_lamps();
    room_solve_layers(s, room_scene(&room), room.texels_per_metre, desc, groups, frames);
}

/* One frame; returns its rays. */
static uint64_t step(struct room_solution *s, uint64_t *frame) {
    room_frame(s, ++*frame);
    return s->stats.rays_shadow + s->stats.rays_bounce;
}

/* The floor's shown light. */
struct picture {
    float *light[3];
    size_t count;
};

static struct picture picture_of(const struct room_solution *s) {
    struct picture picture = {.count = 0};
    const struct lw_atlas_level *level = &s->map.atlas[0]->level[0];
    for (int c = 0; c < 3; c++)
        picture.light[c] =
            malloc(level->tiles_x * level->tiles_y * LW_TILE_SIDE * LW_TILE_SIDE * sizeof(float));
    for (uint32_t t = 0; t < level->tiles_x * level->tiles_y; t++) {
        struct lw_solver_tile tile;
        s->solver->ops->read_tile(s->solver, (lw_tile_id){s->map.first_tile[0] + t}, &tile);
        const size_t texels = tile.width * tile.height;
        for (int c = 0; c < 3; c++)
            memcpy(picture.light[c] + picture.count, tile.shown[LW_TILE_CHANNEL_FULL][c],
                   texels * sizeof(float));
        picture.count += texels;
    }
    return picture;
}

static void forget(struct picture *picture) {
    for (int c = 0; c < 3; c++) free(picture->light[c]);
}

static bool same(const struct picture *a, const struct picture *b, int c) {
    return memcmp(a->light[c], b->light[c], a->count * sizeof(float)) == 0;
}

/* Means of the objects of two solves agree, direct and indirect apart, within a share of all of the object's
 * light: so a block may be out of date when it has converged (is_too_much() of gradient.c). */
static void expect_same_light(const struct room_solution *a, const struct room_solution *b,
                              double tolerance) {
    for (uint32_t o = 0; o < ROOM_PLATE; o++) {
        const struct room_mean x = room_object_mean(a, o), y = room_object_mean(b, o);
        expect_near(x.direct + y.indirect, y.total, tolerance);
        expect_near(y.direct + x.indirect, y.total, tolerance);
    }
}

/* The light is that of a room solved from the start, in one layer. */
static void expect_light_of(const struct room_solution *s, const struct room *room, double tolerance) {
    struct room_solution fresh;
    uint64_t frame = 0;
    room_solve_scene(&fresh, room_scene(room), room->texels_per_metre, desc, 0);
    room_solve_until_rest(&fresh, &frame);
    expect_same_light(s, &fresh, tolerance);
    room_finish(&fresh);
}

/* Each layer is a part of the wait: none of them begins it again. */
static void test_layers_wait_together(void **state) {
    (void)state;
    struct room_solution s;
    struct lw_waiting waiting = {0};
    struct lw_solver_desc reporting = desc;
    const struct room room = room_with_two_lamps();
    uint64_t frame = 0;
    reporting.waiting = &waiting;
    room_solve_layers(&s, room_scene(&room), room.texels_per_metre, reporting, "left;right", 0);
    assert_int_equal(lw_waiting_read(&waiting).stage, LW_WAITING_LOOKING_INSIDE);
    assert_true(lw_waiting_read(&waiting).share == 1);
    step(&s, &frame);
    assert_int_equal(lw_waiting_read(&waiting).stage, LW_WAITING_FIRST_LIGHT);
    assert_true(lw_waiting_read(&waiting).share == 1);
    assert_true(waiting.part == 2 && waiting.parts == 3);
    room_finish(&s);
}

/* However it is parted, light is the same. */
static void test_the_sum_is_the_light_of_all(void **state) {
    (void)state;
    const char *const groups[] = {"right", "left;right", "grey,left", NULL};
    struct room_solution one;
    uint64_t frame = 0;
    begin(&one, "none", 0);
    room_solve_until_rest(&one, &frame);
    for (unsigned i = 0; i < sizeof groups / sizeof *groups; i++) {
        struct room_solution parted;
        begin(&parted, groups[i], 0);
        frame = 0;
        room_solve_until_rest(&parted, &frame);
        expect_same_light(&parted, &one, 0.01);
        room_finish(&parted);
    }
    room_finish(&one);
}

/* Off, dimmed, in another colour, and as before: no ray, and the last to the bit. */
static void test_another_weight_takes_no_ray(void **state) {
    (void)state;
    struct room_solution s;
    uint64_t frame = 0;
    begin(&s, "right", 0);
    room_solve_until_rest(&s, &frame);
    struct picture before = picture_of(&s);
    const struct lw_vec3 on = s.pose.light[1].intensity;

    s.pose.light[1].intensity = lw_vec3(0, 0, 0);
    assert_int_equal(step(&s, &frame), 0);
    assert_true(s.stats.tiles_shown > 0 && s.stats.moved);
    assert_int_equal(step(&s, &frame), 0);
    assert_int_equal(s.stats.tiles_shown, 0);
    struct room room = room_with_two_lamps();
    room.light_count = 1;
    expect_light_of(&s, &room, 0.01);
    struct picture off = picture_of(&s);

    s.pose.light[1].intensity = lw_vec3(0, 2, 0); /* a channel in which it never shone */
    assert_int_equal(step(&s, &frame), 0);
    struct picture green = picture_of(&s);
    assert_true(same(&green, &off, 0) && !same(&green, &off, 1) && same(&green, &off, 2));
    for (size_t i = 0; i < green.count; i++) /* as much of green as it gave of red, by 2 / 3 */
        assert_true(fabsf(3 * (green.light[1][i] - off.light[1][i]) -
                          2 * (before.light[0][i] - off.light[0][i])) <= 1e-5f * (before.light[0][i] + 1));

    s.pose.light[1].intensity = on;
    assert_int_equal(step(&s, &frame), 0);
    struct picture after = picture_of(&s);
    for (int c = 0; c < 3; c++) assert_true(same(&after, &before, c));
    struct lw_solver_tile tile;
    s.solver->ops->read_tile(s.solver, (lw_tile_id){s.map.first_tile[0]}, &tile);
    assert_int_equal(tile.solved_frame, frame);

    forget(&before), forget(&off), forget(&green), forget(&after);
    room_finish(&s);
}

/* ---- where light comes from ---- */

enum { DIRECTIONS = LW_TILE_CHANNELS_FULL | 1u << LW_TILE_CHANNEL_DIRECTION };

/* A warm lamp and a cold one. coloured: two walls are, too. */
static struct lw_scene *warm_and_cold(bool coloured, struct lw_vec3 right) {
    struct room room = room_with_two_lamps();
    room.texels_per_metre = 6;
    memcpy(&room.light[0].intensity, (float[]){4, 2, 1}, 3 * sizeof(float));
    memcpy(&room.light[1].intensity, &right, 3 * sizeof(float));
    room.quad[ROOM_PANEL].emission = 0;
    struct lw_scene *scene = room_scene(&room);
    const float red[3] = {0.8f, 0.1f, 0.1f}, green[3] = {0.1f, 0.7f, 0.1f};
    if (coloured) memcpy(scene->material[2].base_colour, red, sizeof red);
    if (coloured) memcpy(scene->material[3].base_colour, green, sizeof green);
    return scene;
}

static void solve_directions(struct room_solution *s, struct lw_scene *scene, const char *groups,
                             uint64_t seed, uint64_t *frame) {
    struct lw_solver_desc with = desc;
    with.directions = with.denoise = true;
    with.seed = seed;
    with.target_error = -1;
    room_solve_layers(s, scene, 6, with, groups, 0);
    s->solver->ops->choose_channels(s->solver, DIRECTIONS);
    for (unsigned i = 0; i < 60; i++) step(s, frame);
}

/* Root mean square of the difference of r, over covered texels, each by its luminance; r no longer than 1. */
static double directions_apart(const struct room_solution *a, const struct room_solution *b) {
    double square = 0, light = 0;
    for (uint32_t id = 0; id < a->map.plain_count; id++) {
        if (a->map.place[id].level) continue;
        struct lw_solver_tile tile[2];
        a->solver->ops->read_tile(a->solver, (lw_tile_id){id}, &tile[0]);
        b->solver->ops->read_tile(b->solver, (lw_tile_id){id}, &tile[1]);
        for (uint32_t i = 0; i < tile->width * tile->height; i++) {
            float luminance[2];
            struct lw_vec3 r[2];
            for (int k = 0; k < 2; k++) {
                const float *const *e = tile[k].shown[0], *const *v =
                                                              tile[k].shown[LW_TILE_CHANNEL_DIRECTION];
                luminance[k] = lw_colour_luminance(lw_vec3(e[0][i], e[1][i], e[2][i]));
                r[k] = lw_vec3_scale(lw_vec3(v[0][i], v[1][i], v[2][i]), 1 / fmaxf(luminance[k], 1e-6f));
                assert_true(lw_vec3_length(r[k]) < 1.0001f);
            }
            if (!tile->covered[i] || !(luminance[0] > 1e-3f)) continue;
            const double off = (double)lw_vec3_length(lw_vec3_sub(r[0], r[1]));
            square += off * off * (double)luminance[0];
            light += (double)luminance[0];
        }
    }
    return sqrt(square / light);
}

/* The cold lamp, a layer of its own, turns red: without a ray, r is that of a solve from the start. Where
 * walls are coloured, light of several colours arrives from several sides, and r is a little off. */
static void expect_directions(bool coloured, double most) {
    const struct lw_vec3 cold = lw_vec3(1, 2, 4), red = lw_vec3(4, 0.5f, 0.2f);
    struct room_solution layered, fresh, other;
    uint64_t frame = 0, fresh_frame = 0, other_frame = 0;
    solve_directions(&layered, warm_and_cold(coloured, cold), "right", 0, &frame);
    solve_directions(&fresh, warm_and_cold(coloured, red), "none", 0, &fresh_frame);
    solve_directions(&other, warm_and_cold(coloured, red), "none", 7, &other_frame);
    const double before = directions_apart(&layered, &fresh);
    layered.pose.light[1].intensity = red;
    assert_true(step(&layered, &frame) > 0); /* no target: frames always solve */
    const double after = directions_apart(&layered, &fresh), noise = directions_apart(&fresh, &other);
    printf("coloured walls %d: r off by %.4f, before the lamp turned %.4f, noise %.4f\n", coloured, after,
           before, noise);
    assert_true(before > 0.05 && after < most);
    room_finish(&other);
    room_finish(&fresh);
    room_finish(&layered);
}

static void test_a_recoloured_group_has_its_direction(void **state) {
    (void)state;
    expect_directions(false, 0.025); /* layers are filtered apart: so a solve of layers is 0.018 off */
    expect_directions(true, 0.05);
}

/* Two lamps of a group dim together without a ray. One of them alone is solved again, correctly. */
/* All light in one layer, switched off at once: everything that was lit is shown dark in that frame, and
 * light comes back. */
static void test_the_last_light_goes_out(void **state) {
    (void)state;
    struct room_solution s;
    uint64_t frame = 0;
    struct room room = room_with_two_lamps();
    room.light_count = 1;
    room.quad[ROOM_PANEL].emission = 0;
    room_solve_layers(&s, room_scene(&room), room.texels_per_metre, desc, "none", 0);
    room_solve_until_rest(&s, &frame);
    struct picture before = picture_of(&s);
    const struct lw_vec3 on = s.pose.light[0].intensity;
    s.pose.light[0].intensity = lw_vec3(0, 0, 0);
    assert_int_equal(step(&s, &frame), 0);
    assert_true(s.stats.tiles_shown > 0);
    struct picture off = picture_of(&s);
    for (int c = 0; c < 3; c++)
        for (size_t i = 0; i < off.count; i++) assert_true(off.light[c][i] == 0);
    s.pose.light[0].intensity = on;
    step(&s, &frame);
    assert_true(s.stats.tiles_shown > 0);
    struct picture again = picture_of(&s);
    for (int c = 0; c < 3; c++) assert_true(same(&before, &again, c));
    forget(&again);
    forget(&off);
    forget(&before);
    room_finish(&s);
}

static void test_a_group_has_one_weight(void **state) {
    (void)state;
    struct room_solution s;
    uint64_t frame = 0;
    begin(&s, "left,right", 0);
    room_solve_until_rest(&s, &frame);
    for (int i = 0; i < 2; i++) s.pose.light[i].intensity = lw_vec3_scale(s.pose.light[i].intensity, 0.3f);
    assert_int_equal(step(&s, &frame), 0);
    s.pose.light[1].intensity = lw_vec3(0, 0, 0);
    assert_true(step(&s, &frame) > 0);
    room_solve_until_rest(&s, &frame);
    struct room room = room_with_two_lamps();
    room.light[0].intensity[0] = room.light[0].intensity[1] = room.light[0].intensity[2] = 1.2f;
    room.light_count = 1;
    expect_light_of(&s, &room, AFTER_CHANGE);
    room_finish(&s);
}

/* While a lamp of another layer moves, light that stands stays converged. When both have converged the sum is
 * right. */
static void test_light_that_stands_stays_converged(void **state) {
    (void)state;
    struct room_solution s, joint;
    uint64_t frame = 0, rays = 0, joint_rays = 0;
    begin(&s, "right", 0);
    room_solve_until_rest(&s, &frame);
    begin(&joint, "none", 0);
    uint64_t joint_frame = 0;
    room_solve_until_rest(&joint, &joint_frame);
    for (unsigned i = 0; i < 20; i++) {
        s.pose.light[1].position_ws.x -= 0.02f;
        joint.pose.light[1].position_ws.x -= 0.02f;
        rays += step(&s, &frame);
        joint_rays += step(&joint, &joint_frame);
    }
    assert_true(rays < joint_rays);
    s.pose.light[1].intensity = lw_vec3(0, 0, 0); /* the rest is not touched */
    assert_int_equal(step(&s, &frame), 0);
    s.pose.light[1].intensity = lw_vec3(3, 0, 1);
    room_solve_until_rest(&s, &frame);
    struct room room = room_with_two_lamps();
    room.light_position[1] = s.pose.light[1].position_ws;
    expect_light_of(&s, &room, AFTER_CHANGE);
    room_finish(&joint);
    room_finish(&s);
}

/* Hidden objects are not solved, also not when a movement ends and errors are measured again. */
static void test_what_is_hidden_costs_nothing(void **state) {
    (void)state;
    struct room_solution s;
    struct lw_solver_tile tile;
    uint64_t frame = 0;
    begin(&s, "right", 0);
    s.pose.object_hidden[ROOM_PLATE] = true;
    room_solve_until_rest(&s, &frame);
    s.pose.light[1].position_ws.x -= 0.2f;
    for (unsigned i = 0; i < LW_CELL_LAYER_FADE_FRAMES + 8; i++) step(&s, &frame);
    s.solver->ops->read_tile(s.solver, (lw_tile_id){s.map.first_tile[ROOM_PLATE]}, &tile);
    assert_int_equal(tile.sample_count, 0);
    room_finish(&s);
}

/* What moved while a lamp was off is in its light when it is on again. */
static void test_switched_off_in_between(void **state) {
    (void)state;
    struct room_solution s;
    uint64_t frame = 0;
    begin(&s, "left", 0);
    room_solve_until_rest(&s, &frame);
    const struct lw_vec3 on = s.pose.light[0].intensity;
    s.pose.light[0].intensity = lw_vec3(0, 0, 0);
    for (unsigned i = 0; i < 8; i++) {
        s.pose.object_dynamic[ROOM_PLATE] = true;
        s.pose.object_to_world[ROOM_PLATE].m[0][3] += 0.1f;
        step(&s, &frame);
    }
    s.pose.light[0].intensity = on;
    room_solve_until_rest(&s, &frame);
    struct room room = room_with_two_lamps();
    room.quad[ROOM_PLATE].corner.x += 0.8f;
    expect_light_of(&s, &room, AFTER_CHANGE);
    room_finish(&s);
}

/* All is dark, then something shines that never did. */
static void test_out_of_the_dark(void **state) {
    (void)state;
    struct room_solution s;
    uint64_t frame = 0;
    struct room room = room_with_two_lamps();
    room.light_count = 1;
    for (int c = 0; c < 3; c++) room.light[0].intensity[c] = 0;
    room.quad[ROOM_PANEL].emission = 0;
    room_solve_layers(&s, room_scene(&room), room.texels_per_metre, desc, NULL, 0);
    step(&s, &frame);
    assert_true(s.stats.tiles_shown > 0);
    assert_true(room_object_mean(&s, 0).total == 0);
    assert_int_equal(step(&s, &frame), 0);
    for (int c = 0; c < 3; c++) s.pose.material[ROOM_PANEL].emission[c] = 6;
    room_solve_until_rest(&s, &frame);
    room.quad[ROOM_PANEL].emission = 6;
    expect_light_of(&s, &room, AFTER_CHANGE);
    room_finish(&s);
}

/* Saved and read again, it goes on as before. */
static void test_comes_back(void **state) {
    (void)state;
    struct room_solution first, second;
    const uint8_t key[16] = {7};
    const char *path = lw_support_temporary("layers");
    uint64_t frames, frame = 12;
    begin(&first, "right", 12);
    lw_support_ok(first.solver->ops->save(first.solver, path, key, NULL), NULL);
    begin(&second, "right", 0);
    lw_support_ok(second.solver->ops->load(second.solver, path, key, &frames, NULL), NULL);
    assert_int_equal(frames, 12);
    struct picture a = picture_of(&first), b = picture_of(&second);
    for (int c = 0; c < 3; c++) assert_true(same(&a, &b, c));
    forget(&a), forget(&b);
    uint64_t other = frame;
    for (unsigned i = 0; i < 4; i++) step(&first, &frame), step(&second, &other);
    a = picture_of(&first), b = picture_of(&second);
    for (int c = 0; c < 3; c++) assert_true(same(&a, &b, c));
    forget(&a), forget(&b);
    room_finish(&second);
    begin(&second, "left", 0); /* other layers: other sums */
    struct lw_error err = {0};
    lw_support_ok(second.solver->ops->load(second.solver, path, key, &frames, &err), &err);
    room_finish(&second);
    room_finish(&first);
}

/* ---- groups ---- */

/* dims: the right lamp does. */
static void expect_groups_of(bool dims, const char *names, uint32_t count, uint32_t left, uint32_t right,
                             uint32_t sky) {
    static const float time_s[] = {0, 1}, factor[] = {1, 0.25f};
    struct lw_channel channel = {1, LW_CHANNEL_FACTOR, LW_INTERPOLATION_LINEAR, 2, time_s, factor};
    const struct room room = room_with_two_lamps();
    struct lw_scene *scene = room_scene(&room);
    if (dims) scene->light_channel = &channel, scene->light_channel_count = 1;
    struct lw_pose pose;
    struct lw_light_groups groups;
    struct lw_error err = {0};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_light_groups_init(&groups, scene, &pose, names, &err), &err);
    assert_int_equal(groups.count, count);
    assert_int_equal(groups.light[0], left);
    assert_int_equal(groups.light[1], right);
    assert_int_equal(groups.sky, sky);
    lw_light_groups_finish(&groups);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void expect_groups(const char *names, uint32_t count, uint32_t left, uint32_t right, uint32_t sky) {
    expect_groups_of(false, names, count, left, right, sky);
}

/* A light that its animation dims is summed by a weight of its own. */
static void test_groups_of_what_dims(void **state) {
    (void)state;
    expect_groups_of(true, NULL, 2, 0, 1, 0);
    expect_groups_of(true, "none", 1, 0, 0, 0);
}

static void test_groups_by_name(void **state) {
    (void)state;
    expect_groups("none", 1, 0, 0, 0);
    expect_groups(NULL, 1, 0, 0, 0); /* nothing moves */
    expect_groups("right", 2, 0, 1, 0);
    expect_groups("left;right", 3, 1, 2, 0);
    expect_groups("right;left,sky", 3, 2, 1, 2);
    expect_groups("grey,left,right", 1, 0, 0, 0); /* nothing else shines */
}

static void test_bad_names(void **state) {
    (void)state;
    static const struct {
        const char *names, *text;
    } bad[] = {{"lamp", "\"lamp\""},
               {"left,,right", "\"\""},
               {"", "\"\""},
               {"left;", "\"\""},
               {"left;right;sky;grey", "more than 3"}};
    const struct room room = room_with_two_lamps();
    struct lw_scene *scene = room_scene(&room);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    for (unsigned i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct lw_light_groups groups;
        struct lw_error err = {0};
        lw_support_fails(lw_light_groups_init(&groups, scene, &pose, bad[i].names, &err), LW_USAGE, &err,
                         bad[i].text);
    }
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_groups_by_name),
        cmocka_unit_test(test_groups_of_what_dims),
        cmocka_unit_test(test_bad_names),
        cmocka_unit_test(test_layers_wait_together),
        cmocka_unit_test(test_the_sum_is_the_light_of_all),
        cmocka_unit_test(test_another_weight_takes_no_ray),
        cmocka_unit_test(test_a_recoloured_group_has_its_direction),
        cmocka_unit_test(test_the_last_light_goes_out),
        cmocka_unit_test(test_a_group_has_one_weight),
        cmocka_unit_test(test_light_that_stands_stays_converged),
        cmocka_unit_test(test_what_is_hidden_costs_nothing),
        cmocka_unit_test(test_switched_off_in_between),
        cmocka_unit_test(test_out_of_the_dark),
        cmocka_unit_test(test_comes_back),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
