/* Rules of finer levels: moved objects, saved light, spares, seams and gutters (docs/solve_levels.md). */
#include "tests/reference/fine_room.h"

#include "common/base/log.h"
#include "server/solve/surface/hidden_points.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FINER 1u
#define TILES 64u

enum { FLOOR, END_FRAME = 20 };

static const uint8_t key[16] = {7};
static const struct lw_solver_desc terms = {.bounces = 2,
                                            .direct_samples = 1,
                                            .indirect_samples = 2,
                                            .target_error = 0.001f,
                                            .fine_tiles = TILES,
                                            .fine_when = LW_FINE_AFTER_FRAMES,
                                            .threads = 1,
                                            .seed = 3};

/* Log lines about room for detail, and the last one. */
static struct {
    char text[256];
    uint32_t count;
} room_line;

void __wrap_lw_log(enum lw_log_level level, const char *format, ...) LW_PRINTF(2, 3);
void __wrap_lw_log(enum lw_log_level level, const char *format, ...) {
    va_list arguments;
    if (level != LW_LOG_WARNING || !strstr(format, "no room for all detail")) return;
    va_start(arguments, format);
    vsnprintf(room_line.text, sizeof room_line.text, format, arguments);
    va_end(arguments);
    room_line.count++;
}

static _Atomic uint32_t searches;

void __real_lw_hidden_points_find(const struct lw_hidden_points_search *search, uint32_t object,
                                  const uint32_t *texel, uint32_t count, uint8_t *usable);
void __wrap_lw_hidden_points_find(const struct lw_hidden_points_search *search, uint32_t object,
                                  const uint32_t *texel, uint32_t count, uint8_t *usable);
void __wrap_lw_hidden_points_find(const struct lw_hidden_points_search *search, uint32_t object,
                                  const uint32_t *texel, uint32_t count, uint8_t *usable) {
    searches++;
    __real_lw_hidden_points_find(search, object, texel, count, usable);
}

static uint64_t step_to(struct room_solution *s, uint64_t from, uint64_t to) {
    for (uint64_t frame = from + 1; frame <= to; frame++) room_frame(s, frame);
    return to;
}

static struct lw_solver_tile read(const struct room_solution *s, lw_tile_id id) {
    struct lw_solver_tile tile;
    s->solver->ops->read_tile(s->solver, id, &tile);
    return tile;
}

static bool holds(const struct room_solution *s, uint32_t id) {
    return s->solver->ops->holds_fine(s->solver, (lw_tile_id){id});
}

/* Texels of the tiles of finer levels of an object that the room's light does not reach, and tiles that are
 * there. */
static uint32_t count_lost(const struct room_solution *s, uint32_t object, uint32_t *out_tiles) {
    const uint32_t level0 = s->map.plain_count;
    uint32_t lost = 0;
    *out_tiles = 0;
    for (uint32_t id = level0; id < s->map.tile_count; id++) {
        if (s->map.place[id].object != object || !holds(s, id)) continue;
        const struct lw_solver_tile tile = read(s, (lw_tile_id){id});
        for (uint32_t i = 0; i < tile.width * tile.height; i++) lost += !tile.covered[i];
        ++*out_tiles;
    }
    return lost;
}

/* The plate lies on the floor. */
static void put_down(struct lw_pose *pose, float by_m) {
    pose->object_dynamic[ROOM_PLATE] = true;
    pose->object_to_world[ROOM_PLATE].m[1][3] -= by_m;
}

/* ---- objects ---- */

/* Sums of light of the covered texels of an object's tiles of finer levels. */
static double mean_of(const struct room_solution *s, uint32_t object) {
    double sum = 0, texels = 0;
    for (uint32_t id = s->map.plain_count; id < s->map.tile_count; id++) {
        if (s->map.place[id].object != object || !holds(s, id)) continue;
        const struct lw_solver_tile tile = read(s, (lw_tile_id){id});
        for (uint32_t i = 0; i < tile.width * tile.height; i++)
            if (tile.covered[i]) sum += (double)tile.shown[LW_TILE_CHANNEL_FULL][1][i], texels++;
    }
    return sum / texels;
}

/* Ends the test unless two solvers have the same tiles of finer levels, with the same texels covered. */
static void expect_same_cover(const struct room_solution *a, const struct room_solution *b) {
    for (uint32_t id = a->map.plain_count; id < a->map.tile_count; id++) {
        assert_int_equal(holds(a, id), holds(b, id));
        if (!holds(a, id)) continue;
        const struct lw_solver_tile x = read(a, (lw_tile_id){id}), y = read(b, (lw_tile_id){id});
        assert_memory_equal(x.covered, y.covered, (size_t)x.width * x.height);
        assert_memory_equal(x.filled, y.filled, (size_t)x.width * x.height);
    }
}

/* A plate that is put down on the floor hides points of it. The tiles of both are made again, and are those
 * of a solver that knows it nowhere else. Once it is lifted, they are those of before. */
static void what_is_put_down_has_its_tiles_made_again(void **state) {
    (void)state;
    const float by_m = 0.399f;
    struct room_solution s, fresh;
    uint32_t tiles, again;
    fine_room_begin(&s, fine_room_scene(0), FINER, terms);
    fine_room_begin(&fresh, fine_room_scene(0), FINER, terms);
    put_down(&fresh.pose, by_m);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, 0, s.scene->object_count);
    fine_room_look_at(&fresh, LW_ATLAS_FINER + FINER, 0, s.scene->object_count);
    uint64_t frame = step_to(&s, 0, END_FRAME);
    const uint32_t lost = count_lost(&s, FLOOR, &tiles);
    assert_true(tiles > 1);
    put_down(&s.pose, by_m);
    frame = step_to(&s, frame, 3 * END_FRAME);
    step_to(&fresh, 0, 2 * END_FRAME);
    assert_true(count_lost(&s, FLOOR, &again) > lost + 16 && again == tiles);
    expect_same_cover(&s, &fresh);
    for (uint32_t object = 0; object < s.scene->object_count; object++)
        expect_near(mean_of(&s, object), mean_of(&fresh, object), 0.02);
    put_down(&s.pose, -by_m);
    step_to(&s, frame, 4 * END_FRAME);
    assert_int_equal(count_lost(&s, FLOOR, &again), lost);
    assert_int_equal(again, tiles);
    room_finish(&s);
    room_finish(&fresh);
}

/* Tiles of a plate that moves in each frame stay: once it no longer counts as standing, their texels are the
 * same ones. */
static void what_moves_keeps_its_tiles(void **state) {
    (void)state;
    struct room_solution s;
    uint32_t tiles, there;
    fine_room_begin(&s, fine_room_scene(0), FINER, terms);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, ROOM_PLATE, ROOM_PLATE + 1);
    uint64_t frame = step_to(&s, 0, END_FRAME);
    count_lost(&s, ROOM_PLATE, &tiles);
    assert_true(tiles > 0);
    for (uint32_t k = 0; k < 20; k++) {
        put_down(&s.pose, 0.01f);
        frame = step_to(&s, frame, frame + 1);
        count_lost(&s, ROOM_PLATE, &there);
        if (k > 4) assert_int_equal(there, tiles);
    }
    assert_true(mean_of(&s, ROOM_PLATE) > 0);
    room_finish(&s);
}

/* A spare, and anything else that is hidden, takes no slot. Its tiles are made once it is shown. */
static void what_is_hidden_gets_no_tiles(void **state) {
    (void)state;
    struct room_solution s;
    uint32_t tiles;
    fine_room_begin(&s, fine_room_scene(0), FINER + 1, terms);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, ROOM_PLATE, ROOM_PLATE + 1);
    s.pose.object_dynamic[ROOM_PLATE] = s.pose.object_hidden[ROOM_PLATE] = true;
    uint64_t frame = step_to(&s, 0, END_FRAME);
    count_lost(&s, ROOM_PLATE, &tiles);
    assert_int_equal(tiles, 0);
    assert_int_equal(s.stats.tiles_fine, 0);
    s.pose.object_hidden[ROOM_PLATE] = false;
    frame = step_to(&s, frame, frame + END_FRAME);
    count_lost(&s, ROOM_PLATE, &tiles);
    assert_true(tiles > 0 && mean_of(&s, ROOM_PLATE) > 0);
    fine_room_look_at(&s, LW_ATLAS_READ_MAX, 0, 0);
    s.pose.object_hidden[ROOM_PLATE] = true;
    frame = step_to(&s, frame, frame + 2);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER + 1, ROOM_PLATE,
                      ROOM_PLATE + 1); /* other tiles, of a plate with light */
    step_to(&s, frame, frame + END_FRAME);
    for (uint32_t id = s.map.plain_count; id < s.map.tile_count; id++)
        assert_false(s.map.place[id].level == LW_ATLAS_FINER + FINER + 1 && holds(&s, id));
    room_finish(&s);
}

/* ---- room ---- */

/* There is room for the floor's tiles. They give way to others, come back, and are not searched again. */
static void what_comes_back_is_not_searched(void **state) {
    (void)state;
    struct room_solution s;
    struct lw_solver_desc desc = terms;
    uint32_t tiles, again;
    uint64_t frame = 0;
    fine_room_begin(&s, fine_room_scene(0), FINER, terms);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, FLOOR, FLOOR + 1);
    step_to(&s, 0, END_FRAME);
    count_lost(&s, FLOOR, &desc.fine_tiles);
    room_finish(&s);
    fine_room_begin(&s, fine_room_scene(0), FINER, desc);
    put_down(&s.pose, 0.399f);
    frame = step_to(&s, frame, END_FRAME); /* the plate stands */
    const uint32_t before = searches;
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, FLOOR, FLOOR + 1);
    frame = step_to(&s, frame, frame + END_FRAME);
    const uint32_t lost = count_lost(&s, FLOOR, &tiles), made = searches;
    assert_true(tiles == desc.fine_tiles && made > before);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, FLOOR + 1, FLOOR + 2);
    frame = step_to(&s, frame, frame + END_FRAME);
    count_lost(&s, FLOOR, &again);
    assert_int_equal(again, 0);
    const uint32_t others = searches;
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, FLOOR, FLOOR + 1);
    step_to(&s, frame, frame + END_FRAME);
    assert_int_equal(count_lost(&s, FLOOR, &again), lost);
    assert_int_equal(again, tiles);
    assert_int_equal(searches, others);
    room_finish(&s);
}

/* The log says once how many tiles there is no room for, and which option gives more. */
static void the_log_says_that_there_is_no_room(void **state) {
    (void)state;
    struct room_solution s;
    struct lw_solver_desc desc = terms;
    char wanted[256];
    desc.fine_tiles = 2;
    room_line.count = 0;
    fine_room_begin(&s, fine_room_scene(0), FINER, desc);
    uint64_t frame = step_to(&s, 0, 2);
    assert_int_equal(room_line.count, 0);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, 0, s.scene->object_count);
    for (uint32_t k = 0; k < 3; k++) {
        frame = step_to(&s, frame, frame + 1);
        assert_int_equal(room_line.count, 1);
    }
    snprintf(wanted, sizeof wanted,
             "there is no room for all detail that is asked for: for 2 of %u tiles, coarser levels of each "
             "client first (--memory)",
             s.stats.tiles_fine_wanted);
    assert_string_equal(room_line.text, wanted);
    assert_true(s.stats.tiles_fine_wanted > 2);
    fine_room_look_at(&s, LW_ATLAS_READ_MAX, 0, 0);
    frame = step_to(&s, frame, frame + 2);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, 0, s.scene->object_count);
    step_to(&s, frame, frame + 2);
    assert_int_equal(room_line.count, 1);
    room_finish(&s);
}

/* ---- saved light ---- */

static void save(const struct room_solution *s, const char *path, uint8_t **out_bytes, size_t *out_size) {
    struct lw_error err = {0};
    lw_support_ok(s->solver->ops->save(s->solver, path, key, &err), &err);
    *out_bytes = lw_support_read_file(path, out_size);
}

/* A checkpoint of a solver with tiles of finer levels is that of one without. A solver that loads it makes
 * them again. */
static void saved_light_leaves_them_out(void **state) {
    (void)state;
    const char *path = lw_support_temporary("state");
    struct room_solution with, without, loaded;
    struct lw_error err = {0};
    const lw_tile_id *id;
    uint8_t *bytes[2];
    size_t size[2];
    uint64_t frames;
    fine_room_begin(&without, fine_room_scene(0), FINER, terms);
    fine_room_begin(&with, fine_room_scene(0), FINER, terms);
    fine_room_look_at(&with, LW_ATLAS_FINER + FINER, 0, 3);
    fine_room_look_at(&without, LW_ATLAS_READ_MAX, 0, 0);
    step_to(&with, 0, END_FRAME);
    step_to(&without, 0, END_FRAME);
    const uint32_t count = with.solver->ops->list_fine(with.solver, &id);
    assert_true(count > 1 && without.solver->ops->list_fine(without.solver, &id) == 0);
    save(&without, path, &bytes[0], &size[0]);
    save(&with, path, &bytes[1], &size[1]);
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    fine_room_begin(&loaded, fine_room_scene(0), FINER, terms);
    lw_support_ok(loaded.solver->ops->load(loaded.solver, path, key, &frames, &err), &err);
    assert_true(frames == END_FRAME && loaded.solver->ops->list_fine(loaded.solver, &id) == 0);
    fine_room_look_at(&loaded, LW_ATLAS_FINER + FINER, 0, 3);
    step_to(&loaded, frames, 2 * END_FRAME);
    step_to(&with, END_FRAME, 2 * END_FRAME);
    assert_int_equal(loaded.solver->ops->list_fine(loaded.solver, &id), count);
    room_expect_same(&loaded, &with); /* level 0 */
    free(bytes[0]);
    free(bytes[1]);
    room_finish(&with);
    room_finish(&without);
    room_finish(&loaded);
}

/* ---- seams and gutters ---- */

/* Texels that show other light than the solved one. */
static uint32_t count_welded(const struct lw_solver_tile *tile) {
    uint32_t welded = 0;
    for (uint32_t i = 0; i < tile->width * tile->height; i++)
        welded += tile->covered[i] &&
                  tile->shown[LW_TILE_CHANNEL_FULL][1][i] != tile->direct[1][i] + tile->indirect[1][i];
    return welded;
}

/* Level 0 of a ball is welded along its seams. Its tiles of finer levels show the solved light. */
static void seams_are_not_welded(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct lw_scene *scene = room_scene(&room);
    struct room_solution s;
    struct lw_error err = {0};
    uint32_t welded[2] = {0};
    room_make_ball(scene, ROOM_PLATE, lw_vec3(1.4f, 0.8f, 0.8f), 0.3f);
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 9}, NULL, &err),
                  &err);
    fine_room_begin(&s, scene, FINER, terms);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, ROOM_PLATE, ROOM_PLATE + 1);
    step_to(&s, 0, END_FRAME);
    for (uint32_t id = 0; id < s.map.tile_count; id++) {
        const struct lw_tile_place *place = &s.map.place[id];
        const bool is_fine = id >= s.map.plain_count;
        if (place->object != ROOM_PLATE || (is_fine ? !holds(&s, id) : place->level != 0)) continue;
        const struct lw_solver_tile tile = read(&s, (lw_tile_id){id});
        welded[is_fine] += count_welded(&tile);
    }
    assert_true(welded[0] > 16);
    assert_int_equal(welded[1], 0);
    room_finish(&s);
}

static bool has_light(const struct lw_solver_tile *tile, float light, bool covered) {
    for (uint32_t i = 0; i < tile->width * tile->height; i++)
        if ((covered ? tile->covered[i] : tile->covered[i] || tile->filled[i]) &&
            tile->shown[LW_TILE_CHANNEL_FULL][1][i] == light)
            return true;
    return false;
}

/* Whether a texel of level 0 of an object shows that light. */
static bool is_of_level_0(const struct room_solution *s, uint32_t object, float light) {
    for (uint32_t id = 0; id < s->map.plain_count; id++) {
        if (s->map.place[id].level || s->map.place[id].object != object) continue;
        const struct lw_solver_tile tile = read(s, (lw_tile_id){id});
        if (has_light(&tile, light, false)) return true;
    }
    return false;
}

/* Each gutter shows the light of a texel of its tile, or of one of level 0 where the chart lies beyond. */
static void gutters_are_of_the_tile_or_of_level_0(void **state) {
    (void)state;
    struct room_solution s;
    uint32_t from[2] = {0};
    fine_room_begin(&s, fine_room_scene(0), FINER, terms);
    fine_room_look_at(&s, LW_ATLAS_FINER + FINER, FLOOR, FLOOR + 1);
    step_to(&s, 0, END_FRAME);
    for (uint32_t id = s.map.plain_count; id < s.map.tile_count; id++) {
        if (!holds(&s, id)) continue;
        const struct lw_solver_tile tile = read(&s, (lw_tile_id){id});
        assert_int_equal(tile.solved_frame, END_FRAME); /* as level 0 is */
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            const float light = tile.shown[LW_TILE_CHANNEL_FULL][1][i];
            if (!tile.filled[i]) continue;
            const bool own = has_light(&tile, light, true);
            if (!own && !is_of_level_0(&s, s.map.place[id].object, light))
                fail_msg("tile %u, texel %u: %g", id, i, (double)light);
            from[own]++;
        }
    }
    assert_true(from[0] > 0 && from[1] > 0);
    room_finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_put_down_has_its_tiles_made_again),
        cmocka_unit_test(what_moves_keeps_its_tiles),
        cmocka_unit_test(what_is_hidden_gets_no_tiles),
        cmocka_unit_test(what_comes_back_is_not_searched),
        cmocka_unit_test(the_log_says_that_there_is_no_room),
        cmocka_unit_test(saved_light_leaves_them_out),
        cmocka_unit_test(seams_are_not_welded),
        cmocka_unit_test(gutters_are_of_the_tile_or_of_level_0),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
