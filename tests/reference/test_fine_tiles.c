/* Tiles of finer levels: their texels and their light are those of a scene whose lightmaps are as fine. */
#include "tests/reference/fine_room.h"

#include "common/base/colour.h"
#include "server/solve/surface/fine_texels.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FINER 2u

enum { DIRECTIONS = LW_TILE_CHANNELS_FULL | 1u << LW_TILE_CHANNEL_DIRECTION };

static const struct lw_solver_desc terms = {
    .bounces = 2, .direct_samples = 1, .indirect_samples = 4, .target_error = 0.02f, .threads = 2, .seed = 3};

/* ---- texels ---- */

static void expect_same_texels(const struct lw_fine_texels *fine, const struct lw_texels *all,
                               const struct lw_tile_place *place) {
    const struct lw_mesh_texels *mesh = &all->mesh[all->scene->object[place->object].mesh];
    assert_int_equal(fine->mesh.width, place->width);
    assert_int_equal(fine->mesh.height, place->height);
    for (uint32_t i = 0; i < fine->mesh.texel_count; i++) {
        const uint32_t j = lw_texels_index(mesh, place->x * LW_TILE_SIDE + i % place->width,
                                           place->y * LW_TILE_SIDE + i / place->width);
        assert_int_equal(fine->mesh.covered[i], mesh->covered[j]);
        if (!mesh->covered[j]) continue;
        assert_true(lw_vec3_length(lw_vec3_sub(lw_packed_normal_unpack(fine->mesh.normal[i]),
                                               lw_packed_normal_unpack(mesh->normal[j]))) < 1e-3f);
        assert_true(lw_vec3_length(lw_vec3_sub(lw_packed_albedo_unpack(fine->mesh.albedo[i]),
                                               lw_packed_albedo_unpack(mesh->albedo[j]))) < 1e-3f);
        for (int c = 0; c < 3; c++) {
            assert_true(fabsf(fine->mesh.position[c][i] - mesh->position[c][j]) < 1e-4f);
        }
        assert_int_equal(lw_sample_points_all(&fine->mesh.sample_points, i),
                         lw_sample_points_all(&mesh->sample_points, j));
    }
}

static void texels_are_those_of_a_finer_atlas(void **state) {
    (void)state;
    struct lw_scene *scene = fine_room_scene(0), *magnified = fine_room_scene(FINER);
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_texels texels, all;
    struct lw_fine_texels_maker *maker;
    fine_room_name_all(&map, scene, FINER);
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_texels_init(&texels, scene, 1, NULL, NULL, NULL), NULL);
    lw_support_ok(lw_texels_init(&all, magnified, 1, NULL, NULL, NULL), NULL);
    lw_support_ok(lw_fine_texels_maker_create(&texels, true, &maker), NULL);
    uint32_t tiles = 0;
    const struct lw_hidden_points_search points = {.pose = &pose}; /* nothing is known to stand */
    for (uint32_t id = 0; id < map.tile_count; id++) {
        const struct lw_tile_place *place = &map.place[id];
        struct lw_fine_texels fine;
        if (lw_atlas_finer(place->level) != FINER || !place->width) continue;
        lw_support_ok(lw_fine_texels_prepare(maker, place->object), NULL);
        lw_support_ok(lw_fine_texels_make(maker, &points, place, &fine), NULL);
        expect_same_texels(&fine, &all, place);
        lw_fine_texels_finish(&fine);
        tiles++;
    }
    assert_true(tiles > 8);
    lw_fine_texels_maker_destroy(maker);
    lw_texels_finish(&texels);
    lw_texels_finish(&all);
    lw_pose_finish(&pose);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
    lw_scene_destroy(magnified);
}

/* ---- light ---- */

static double luminance_of(const struct lw_solver_tile *tile, uint32_t i) {
    const float *const *e = (const float *const *)tile->shown[LW_TILE_CHANNEL_FULL];
    return (double)lw_colour_luminance(lw_vec3(e[0][i], e[1][i], e[2][i]));
}

static struct lw_vec3 moment_of(const struct lw_solver_tile *tile, uint32_t i) {
    const float *const *v = (const float *const *)tile->shown[LW_TILE_CHANNEL_DIRECTION];
    return lw_vec3(v[0][i], v[1][i], v[2][i]);
}

/* Sums over covered texels of two solutions, a and b: luminance, its squares in a, squared differences of
 * luminance and of the cosine moment. */
struct difference {
    double sum_a, sum_b, all, square, moment_square;
};

/* Adds two tiles of the same size. */
static void compare(const struct lw_solver_tile *a, const struct lw_solver_tile *b, struct difference *d) {
    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
    for (uint32_t i = 0; i < a->width * a->height; i++) {
        if (!a->covered[i] || !b->covered[i]) continue;
        const double x = luminance_of(a, i), y = luminance_of(b, i);
        const struct lw_vec3 off = lw_vec3_sub(moment_of(a, i), moment_of(b, i));
        d->sum_a += x;
        d->sum_b += y;
        d->square += (x - y) * (x - y);
        d->all += x * x;
        d->moment_square += (double)lw_vec3_dot(off, off);
        assert_true((double)lw_vec3_length(moment_of(a, i)) <= 1.0001 * x + 1e-6);
    }
}

static void light_is_that_of_a_finer_atlas(void **state) {
    (void)state;
    struct room_solution coarse, fine;
    struct lw_solver_desc desc = terms;
    desc.denoise = desc.directions = true;
    fine_room_begin(&fine, fine_room_scene(FINER), 0, desc);
    desc.fine_tiles = 64;
    fine_room_begin(&coarse, fine_room_scene(0), FINER, desc);
    fine.solver->ops->choose_channels(fine.solver, DIRECTIONS);
    coarse.solver->ops->choose_channels(coarse.solver, DIRECTIONS);
    fine_room_look_at(&coarse, LW_ATLAS_FINER + FINER, 0, coarse.scene->object_count);
    for (uint64_t frame = 1; frame <= 30; frame++) room_frame(&coarse, frame), room_frame(&fine, frame);
    const lw_tile_id *id;
    const uint32_t count = coarse.solver->ops->list_fine(coarse.solver, &id);
    assert_true(count > 8);
    struct difference d = {0};
    for (uint32_t k = 0; k < count; k++) {
        const struct lw_tile_place *place = &coarse.map.place[id[k].v];
        const lw_tile_id other = lw_atlas_map_find(&fine.map, place->object, 0, place->x, place->y);
        struct lw_solver_tile a, b;
        coarse.solver->ops->read_tile(coarse.solver, id[k], &a);
        fine.solver->ops->read_tile(fine.solver, other, &b);
        compare(&a, &b, &d);
    }
    expect_near(d.sum_a, d.sum_b, 0.01);
    assert_true(d.square < 0.05 * 0.05 * d.all);
    printf("moments differ by %.3f of the light\n", sqrt(d.moment_square / d.all));
    assert_true(d.moment_square < 0.06 * 0.06 * d.all);
    room_finish(&coarse);
    room_finish(&fine);
}

/* ---- which are there ---- */

static uint32_t list(const struct room_solution *s, uint32_t object, uint32_t *out_all) {
    const lw_tile_id *id;
    uint32_t count = 0;
    *out_all = s->solver->ops->list_fine(s->solver, &id);
    for (uint32_t k = 0; k < *out_all; k++) count += s->map.place[id[k].v].object == object;
    return count;
}

static uint32_t tiles_of(const struct room_solution *s, uint32_t object, uint32_t finer) {
    const struct lw_atlas_level *level = lw_atlas_level(s->map.atlas[object], LW_ATLAS_FINER + finer);
    return level->tiles_x * level->tiles_y;
}

/* There is room for one object's tiles: those that somebody looks at take it from those that nobody does. */
static void those_that_are_looked_at_have_the_room(void **state) {
    (void)state;
    struct room_solution s;
    struct lw_solver_desc desc = terms;
    uint32_t all;
    uint64_t frame = 0;
    struct lw_scene *scene = fine_room_scene(0);
    struct lw_atlas_map map;
    fine_room_name_all(&map, scene, FINER);
    desc.fine_tiles = lw_atlas_level(map.atlas[0], LW_ATLAS_FINER + FINER)->tiles_x *
                      lw_atlas_level(map.atlas[0], LW_ATLAS_FINER + FINER)->tiles_y;
    lw_atlas_map_finish(&map);
    fine_room_begin(&s, scene, FINER, desc);
    const uint32_t first = tiles_of(&s, 0, FINER), second = tiles_of(&s, 1, FINER);
    assert_true(first > 1 && second > 1);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, 0, 1);
    for (uint32_t k = 0; k < 20; k++) room_frame(&s, ++frame);
    assert_int_equal(list(&s, 0, &all), first);
    assert_int_equal(all, first);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, 0, 2); /* no room for the second's */
    for (uint32_t k = 0; k < 20; k++) room_frame(&s, ++frame);
    assert_int_equal(list(&s, 0, &all), first);
    assert_int_equal(all, first);
    assert_int_equal(s.stats.tiles_fine, first);
    assert_int_equal(s.stats.tiles_fine_wanted, first + second);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, 1, 2);
    for (uint32_t k = 0; k < 20; k++) room_frame(&s, ++frame);
    assert_int_equal(list(&s, 1, &all), second < first ? second : first);
    assert_int_equal(all, first); /* the rest stays while nobody needs the room */
    room_finish(&s);
}

/* Interest that does not fit: tiles of the coarser level take the room of those of the finer one. */
static void coarser_levels_come_first(void **state) {
    (void)state;
    struct room_solution s;
    struct lw_solver_desc desc = terms;
    const lw_tile_id *id;
    uint64_t frame = 0;
    desc.fine_tiles = 4;
    fine_room_begin(&s, fine_room_scene(0), FINER, desc);
    assert_true(tiles_of(&s, 0, FINER) >= 4 && tiles_of(&s, 0, 1) < 4);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, 0, 1);
    for (uint32_t k = 0; k < 24; k++) room_frame(&s, ++frame);
    assert_int_equal(s.solver->ops->list_fine(s.solver, &id), 4);
    uint8_t *interest = calloc(s.map.tile_count, 1);
    assert_non_null(interest);
    for (uint32_t i = 0; i < s.map.tile_count; i++)
        interest[i] = s.map.place[i].level == 0 || (s.map.place[i].width && s.map.place[i].object == 0);
    lw_support_ok(s.solver->ops->set_interest(s.solver, interest, NULL), NULL);
    free(interest);
    for (uint32_t k = 0; k < 24; k++) room_frame(&s, ++frame);
    const uint32_t count = s.solver->ops->list_fine(s.solver, &id);
    uint32_t coarser = 0;
    for (uint32_t k = 0; k < count; k++) coarser += s.map.place[id[k].v].level == LW_ATLAS_FINER + 1;
    assert_int_equal(count, 4); /* the rest of the room is the finer level's */
    assert_int_equal(coarser, tiles_of(&s, 0, 1));
    room_finish(&s);
}

/* Somebody lists all tiles of the coarser finer level, another one six of the finest: there is room for
 * fewer. Turns, four tiles each, come before levels. The second one has all of its tiles once those of the
 * first two turns have been made, two a frame. */
static void turns_come_before_levels(void **state) {
    (void)state;
    enum { MODEST = 6, TURN = 4, SLOTS = 2 * 2 * TURN, WAIT = 8, FRAMES = WAIT + SLOTS / 2 + 1 };
    struct room_solution s;
    struct lw_solver_desc desc = terms;
    uint32_t at[2] = {0};
    desc.fine_tiles = SLOTS;
    desc.fine_when = LW_FINE_AFTER_FRAMES;
    fine_room_begin(&s, fine_room_scene(0), FINER, desc);
    uint8_t *interest = calloc(s.map.tile_count, 1);
    assert_non_null(interest);
    for (uint32_t id = 0; id < s.map.tile_count; id++) {
        const struct lw_tile_place *place = &s.map.place[id];
        const uint32_t finer = lw_atlas_finer(place->level);
        interest[id] = place->level == 0;
        if (!place->width || !finer || (finer == FINER && at[1] == MODEST)) continue;
        interest[id] = (uint8_t)(1 + at[finer == FINER]++ / TURN);
    }
    assert_true(at[0] + MODEST > SLOTS && at[1] == MODEST);
    lw_support_ok(s.solver->ops->set_interest(s.solver, interest, NULL), NULL);
    for (uint64_t frame = 1; frame <= FRAMES; frame++) room_frame(&s, frame);
    uint32_t there = 0;
    for (uint32_t id = 0; id < s.map.tile_count; id++)
        there += interest[id] && lw_atlas_finer(s.map.place[id].level) == FINER &&
                 s.solver->ops->holds_fine(s.solver, (lw_tile_id){id});
    assert_int_equal(there, MODEST);
    assert_int_equal(s.stats.tiles_fine, SLOTS);
    free(interest);
    room_finish(&s);
}

/* Interest that is elsewhere in each frame: no frame makes more than two tiles. Tiles never
 * outnumber the slots, and memory never exceeds that of all slots. */
static void interest_that_jumps_is_bounded(void **state) {
    (void)state;
    enum { SLOTS = 6, FRAMES = 60, MAKE_MAX = 2, TILE_BYTES = 1 << 20 };
    struct room_solution s;
    struct lw_solver_desc desc = terms;
    desc.fine_tiles = SLOTS;
    desc.fine_when = LW_FINE_AFTER_FRAMES;
    fine_room_begin(&s, fine_room_scene(0), FINER, desc);
    const size_t empty_bytes = s.solver->ops->memory_bytes(s.solver);
    uint8_t *held = calloc(s.map.tile_count, 1);
    assert_non_null(held);
    uint32_t made_in_all = 0;
    for (uint64_t frame = 1; frame <= FRAMES; frame++) {
        const uint32_t object = (uint32_t)frame % ROOM_FACES;
        fine_room_look_at(&s, LW_ATLAS_FINER + 1 + (uint32_t)frame % FINER, object, object + 1);
        room_frame(&s, frame);
        uint32_t there = 0, made = 0;
        for (uint32_t id = s.map.plain_count; id < s.map.tile_count; id++) {
            const bool holds = s.solver->ops->holds_fine(s.solver, (lw_tile_id){id});
            there += holds;
            made += holds && !held[id];
            held[id] = holds;
        }
        assert_in_range(there, 0, SLOTS);
        assert_in_range(made, 0, MAKE_MAX);
        made_in_all += made;
        assert_true(s.solver->ops->memory_bytes(s.solver) <= empty_bytes + SLOTS * TILE_BYTES);
    }
    assert_true(made_in_all > 4 * SLOTS);
    free(held);
    room_finish(&s);
}

/* ---- the same bytes ---- */

static void expect_same(const struct room_solution *a, const struct room_solution *b) {
    const lw_tile_id *id, *other;
    const uint32_t count = a->solver->ops->list_fine(a->solver, &id);
    assert_int_equal(b->solver->ops->list_fine(b->solver, &other), count);
    assert_memory_equal(id, other, count * sizeof *id);
    for (uint32_t k = 0; k < count; k++) {
        struct lw_solver_tile x, y;
        a->solver->ops->read_tile(a->solver, id[k], &x);
        b->solver->ops->read_tile(b->solver, other[k], &y);
        for (int c = 0; c < 3; c++)
            assert_memory_equal(x.shown[LW_TILE_CHANNEL_FULL][c], y.shown[LW_TILE_CHANNEL_FULL][c],
                                (size_t)x.width * x.height * sizeof(float));
    }
    assert_true(count > 0);
}

/* A script of who looks at what, with a lamp that moves: at one thread and at two. */
static void threads_change_nothing(void **state) {
    (void)state;
    struct room_solution s[2];
    for (unsigned k = 0; k < 2; k++) {
        struct lw_solver_desc desc = terms;
        desc.fine_tiles = 12;
        desc.threads = k + 1;
        desc.denoise = true;
        desc.frame_budget_units = 8000;
        fine_room_begin(&s[k], fine_room_scene(0), FINER, desc);
        for (uint64_t frame = 1; frame <= 40; frame++) {
            if (frame % 8 == 1)
                fine_room_look_at(&s[k], LW_ATLAS_FINER + 1 + frame / 8 % FINER, (uint32_t)frame / 8,
                                  (uint32_t)frame / 8 + 2);
            if (frame > 20) s[k].pose.light[0].position_ws.x += 0.01f;
            room_frame(&s[k], frame);
        }
    }
    expect_same(&s[0], &s[1]);
    room_expect_same(&s[0], &s[1]);
    room_finish(&s[0]);
    room_finish(&s[1]);
}

/* Level 0 is lit as if there were no finer one. */
static void level_0_does_not_depend_on_them(void **state) {
    (void)state;
    struct room_solution with, without;
    struct lw_solver_desc desc = terms;
    fine_room_begin(&without, fine_room_scene(0), FINER, desc);
    desc.fine_tiles = 32;
    fine_room_begin(&with, fine_room_scene(0), FINER, desc);
    fine_room_look_at(&with, LW_ATLAS_FINER + FINER, 0, 3);
    fine_room_look_at(&without, LW_ATLAS_FINER + FINER, 0, 3);
    for (uint64_t frame = 1; frame <= 12; frame++) room_frame(&with, frame), room_frame(&without, frame);
    const lw_tile_id *id;
    assert_true(with.solver->ops->list_fine(with.solver, &id) > 0);
    assert_int_equal(without.solver->ops->list_fine(without.solver, &id), 0);
    room_expect_same(&with, &without);
    room_finish(&with);
    room_finish(&without);
}

/* ---- light that changes ---- */

/* Layers have the same tiles, and a lamp that goes out leaves those that are there, in their sum too. */
static void layers_share_them(void **state) {
    (void)state;
    struct room_solution alone, layered;
    struct lw_light_groups groups;
    struct lw_error err = {0};
    struct lw_solver_desc desc = terms;
    desc.fine_tiles = 64;
    desc.directions = true;
    fine_room_begin(&alone, fine_room_scene(0), FINER, desc);
    layered.scene = NULL;
    struct lw_scene *scene = fine_room_scene(0);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_light_groups_init(&groups, scene, &pose, "left", &err), &err);
    desc.light_groups = &groups;
    fine_room_begin(&layered, scene, FINER, desc);
    alone.solver->ops->choose_channels(alone.solver, DIRECTIONS);
    layered.solver->ops->choose_channels(layered.solver, DIRECTIONS);
    fine_room_look_at(&alone, LW_ATLAS_FINER + FINER, 0, 1);
    fine_room_look_at(&layered, LW_ATLAS_FINER + FINER, 0, 1);
    for (uint64_t frame = 1; frame <= 60; frame++) {
        if (frame == 30) alone.pose.light[0].intensity = layered.pose.light[0].intensity = lw_vec3(1, 1, 1);
        room_frame(&alone, frame);
        room_frame(&layered, frame);
    }
    const lw_tile_id *id, *other;
    const uint32_t count = alone.solver->ops->list_fine(alone.solver, &id);
    assert_int_equal(count, tiles_of(&alone, 0, FINER));
    assert_int_equal(layered.solver->ops->list_fine(layered.solver, &other), count);
    struct difference d = {0};
    for (uint32_t k = 0; k < count; k++) {
        struct lw_solver_tile a, b;
        alone.solver->ops->read_tile(alone.solver, id[k], &a);
        layered.solver->ops->read_tile(layered.solver, other[k], &b);
        compare(&a, &b, &d);
    }
    expect_near(d.sum_a, d.sum_b, 0.01);
    assert_true(d.moment_square < 0.08 * 0.08 * d.all);
    room_finish(&alone);
    room_finish(&layered);
    lw_light_groups_finish(&groups);
    lw_pose_finish(&pose);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(texels_are_those_of_a_finer_atlas),
        cmocka_unit_test(light_is_that_of_a_finer_atlas),
        cmocka_unit_test(those_that_are_looked_at_have_the_room),
        cmocka_unit_test(coarser_levels_come_first),
        cmocka_unit_test(turns_come_before_levels),
        cmocka_unit_test(interest_that_jumps_is_bounded),
        cmocka_unit_test(threads_change_nothing),
        cmocka_unit_test(level_0_does_not_depend_on_them),
        cmocka_unit_test(layers_share_them),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
