/* Light that changes is right again soon, and unchanged light costs nothing. */
#include "common/base/random.h"
#include "common/builtin/builtin.h"
#include "server/solve/adapt/gradient.h"
#include "server/solve/cell_frame.h"
#include "server/solve/state/tiles.h"
#include "server/solve/surface/standing.h"
#include "tests/reference/house.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PLATE = 6 }; /* after the six faces of room_box() */

/* A long room with a lamp at one end and a small plate over the floor beside it. */
static struct room make_room(float length, float plate_x) {
    struct room room = {.texels_per_metre = 12};
    room_box(&room, lw_vec3(length, 2, 2), 0.5f, 0);
    room_quad(&room, lw_vec3(plate_x, 0.4f, 0.8f), lw_vec3(0, 0, 0.4f), lw_vec3(0.4f, 0, 0), 0.5f, 0);
    room.quad[PLATE].double_sided = true;
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {4, 4, 4}};
    room.light_position[0] = lw_vec3(1, 1.6f, 1);
    room.light_count = 1;
    return room;
}

static const struct lw_solver_desc desc = {
    .bounces = 2, .direct_samples = 1, .indirect_samples = 4, .target_error = 0.03f};

static void shift(struct room_solution *s, uint32_t object, float x) {
    s->pose.object_dynamic[object] = true;
    s->pose.object_to_world[object].m[0][3] += x;
}

/* ---- what changed ---- */

/* Light of the floor in squares of half a metre. */
#define SQUARES 64
struct squares {
    double light[SQUARES], area[SQUARES];
};

static void add_texel(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    struct squares *squares = user;
    const int i = (int)(p.x * 2) * 4 + (int)(p.z * 2);
    squares->light[i] += area * (direct + indirect);
    squares->area[i] += area;
}

static struct squares light_of_floor(const struct room_solution *s) {
    struct squares squares = {0};
    room_each_texel(s, 0, add_texel, &squares);
    for (int i = 0; i < SQUARES; i++) squares.light[i] /= squares.area[i] > 0 ? squares.area[i] : 1;
    return squares;
}

/* Squares that agree: 36 texels each, known to 3 %, of their tile's light where they are darker than that. */
static double off(const struct squares *got, const struct squares *want, int i) {
    double mean = 0;
    unsigned count = 0;
    for (int k = 0; k < SQUARES; k++) mean += want->light[k], count += want->area[k] > 0;
    mean /= count;
    return fabs(got->light[i] - want->light[i]) / fmax(want->light[i], mean);
}

static void expect_squares(const struct squares *got, const struct squares *want) {
    for (int i = 0; i < SQUARES; i++)
        if (off(got, want, i) > 0.045) /* 36 texels, each known and up to date to 3 % */
            fail_msg("square %d: %g, expected %g within 4.5 %%", i, got->light[i], want->light[i]);
}

/* Moved and moved on: neither shadow stays, and the light is that of a room where the plate has always been
 * there. */
static void test_no_ghost_stays(void **state) {
    (void)state;
    const struct room here = make_room(6, 1.4f), there = make_room(6, 2.4f);
    struct room_solution s, fresh;
    uint64_t frame = 400; /* long means, which forget slowly when asked to remember */
    room_solve(&s, &here, desc, 400);
    const struct squares before = light_of_floor(&s);
    for (unsigned i = 0; i < 10; i++) {
        shift(&s, PLATE, 0.1f);
        room_solve_on(&s, &frame, 1);
    }
    s.rays = 0;
    room_solve_on(&s, &frame, 300);
    room_solve(&fresh, &there, desc, 400);
    const struct squares after = light_of_floor(&s), want = light_of_floor(&fresh);
    unsigned changed = 0;
    expect_squares(&after, &want);
    for (int i = 0; i < SQUARES; i++) changed += off(&before, &want, i) > 0.1;
    assert_true(changed >= 3);
    room_finish(&fresh);
    room_finish(&s);
}

/* A change that is undone leaves no trace. */
static void test_there_and_back(void **state) {
    (void)state;
    const struct room room = make_room(8, 1.4f);
    struct room_solution s;
    uint64_t frame = 400;
    room_solve(&s, &room, desc, 400);
    const struct squares before = light_of_floor(&s);
    shift(&s, PLATE, 1);
    room_solve_on(&s, &frame, 30);
    shift(&s, PLATE, -1);
    room_solve_on(&s, &frame, 300);
    const struct squares after = light_of_floor(&s);
    expect_squares(&after, &before);
    room_finish(&s);
}

/* Frames that have time for next to nothing: each asks one tile and solves one; in the end nothing has been
 * overlooked. */
static void test_asked_in_many_frames(void **state) {
    (void)state;
    const struct room here = make_room(6, 1.4f), there = make_room(6, 2.4f);
    struct lw_solver_desc slow = desc;
    struct room_solution s, fresh;
    uint64_t frame = 0;
    slow.frame_budget_s = 1e-12;
    room_solve(&s, &here, slow, 0);
    room_solve_on(&s, &frame, 1);
    const unsigned tiles = s.stats.tiles_solved;
    room_solve_on(&s, &frame, 200 * tiles);
    shift(&s, PLATE, 1);
    room_solve_on(&s, &frame, 1);
    assert_true(s.stats.rays_shadow > 0);
    room_solve_on(&s, &frame, 200 * tiles);
    room_solve(&fresh, &there, desc, 400);
    const struct squares after = light_of_floor(&s), want = light_of_floor(&fresh);
    expect_squares(&after, &want);
    room_finish(&fresh);
    room_finish(&s);
}

struct sides {
    double light[2], area[2];
};

/* The plate's two sides, its front up: by half the atlas. */
static struct sides light_of_plate(const struct room_solution *s) {
    struct sides sides = {{0}, {0}};
    const struct lw_mesh *mesh = &s->scene->mesh[PLATE];
    struct lw_solver_tile tile;
    s->solver->ops->read_tile(s->solver, (lw_tile_id){s->map.first_tile[PLATE]}, &tile);
    for (uint32_t i = 0; i < tile.width * tile.height; i++) {
        if (!tile.covered[i]) continue;
        const int side = i / tile.width >= mesh->back_offset;
        sides.light[side] += (double)tile.direct[0][i];
        sides.area[side] += 1;
    }
    for (int side = 0; side < 2; side++) sides.light[side] /= sides.area[side];
    return sides;
}

/* Two surfaces in one block, in the midst of movement: each has what it alone is lit by. */
static void test_both_sides_of_a_plate(void **state) {
    (void)state;
    struct room room = make_room(3, 1.4f);
    room.light[1] = room.light[0];
    room.light_position[1] = lw_vec3(1.6f, 0.1f, 1); /* below the plate */
    room.light_count = 2;
    room.quad[PLATE].edge_u.z = room.quad[PLATE].edge_v.x = 0.6f; /* some three packets a side */
    struct lw_solver_desc d = desc;
    d.target_error = 1e-3f;                     /* nothing converges */
    for (unsigned when = 0; when < 7; when++) { /* at any point of the rotation of asked packets */
        struct room_solution s;
        uint64_t frame = 0;
        room_solve(&s, &room, d, 0);
        room_solve_on(&s, &frame, 50);
        assert_true(s.scene->mesh[PLATE].back_offset > 0);
        const struct sides before = light_of_plate(&s);
        for (unsigned i = 0; i < 11; i++) {
            s.pose.light[0].position_ws.x += 1e-4f;
            if (i == 3 + when) s.pose.light[1].intensity = lw_vec3(0, 0, 0);
            room_solve_on(&s, &frame, 1);
        }
        room_solve_on(&s, &frame, 30);
        const struct sides after = light_of_plate(&s);
        unsigned lit = 0;
        for (int side = 0; side < 2; side++) {
            if (after.light[side] > 0.1 * before.light[side])
                lit++;
            else
                assert_true(after.light[side] < 0.03 * before.light[side]);
        }
        assert_int_equal(lit, 1);
        room_finish(&s);
    }
}

/* ---- unchanged light ---- */

/* At the far end of the room a small thing moves: what it can be seen from is solved, little else. */
static void test_little_is_solved_for_a_small_change(void **state) {
    (void)state;
    struct room room = make_room(24, 21.5f);
    room.light[1] = room.light[0];
    room.light_position[1] = lw_vec3(21, 1.6f, 1);
    room.light_count = 2;
    struct room_solution s;
    uint64_t frame = 800;
    struct lw_solver_desc d = desc;
    d.target_error = 0.1f;
    room_solve(&s, &room, d, 800);
    const uint64_t first_rays = s.rays;
    assert_int_equal(s.stats.tiles_solved, 0); /* converged */
    s.rays = 0;
    shift(&s, PLATE, 0.2f);
    assert_true(room_solve_on(&s, &frame, 16) > 0);
    for (unsigned i = 0; i < 40; i++) room_solve_on(&s, &frame, 20);
    assert_int_equal(s.stats.tiles_solved, 0);
    if (2 * s.rays >= first_rays)
        fail_msg("%llu rays, %llu for all of it", (unsigned long long)s.rays, (unsigned long long)first_rays);
    room_finish(&s);
}

/* A lamp whose light does not reach anything changes nothing. */
static void test_nothing_is_solved_for_what_lights_nothing(void **state) {
    (void)state;
    struct room room = make_room(8, 1.4f);
    room.light[1] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {1e-6f, 1e-6f, 1e-6f}};
    room.light_position[1] = lw_vec3(5, 1, 1);
    room.light_count = 2;
    struct room_solution s;
    uint64_t frame = 800;
    struct lw_solver_desc d = desc;
    d.target_error = 0.1f;
    room_solve(&s, &room, d, 800);
    assert_int_equal(s.stats.tiles_solved, 0);
    for (unsigned i = 0; i < 20; i++) {
        s.pose.light[1].position_ws.x += 0.01f;
        room_solve_on(&s, &frame, 1);
        assert_true(s.stats.moved);
        assert_int_equal(s.stats.tiles_solved, 0);
    }
    room_finish(&s);
}

/* ---- how soon ---- */

/* How much of the change from one light to another has come: 0 none of it, 1 all. */
static double share_of_change(const struct squares *now, const struct squares *from,
                              const struct squares *to) {
    double came = 0, all = 0;
    for (int i = 0; i < SQUARES; i++) {
        const double change = to->light[i] - from->light[i];
        came += (now->light[i] - from->light[i]) * change;
        all += change * change;
    }
    return came / all;
}

/* The plate's shadow under a broad lamp, six frames after it has moved. */
static double share_after_six_frames(bool filtered, uint32_t seed) {
    struct room here = make_room(6, 1.4f), there = make_room(6, 1.55f);
    struct lw_solver_desc settings = desc;
    struct room_solution s, fresh;
    uint64_t frame = 400;
    settings.denoise = filtered;
    settings.seed = seed;
    here.light_count = there.light_count = 0;
    room_quad(&here, lw_vec3(1.2f, 1.6f, 0.4f), lw_vec3(1.2f, 0, 0), lw_vec3(0, 0, 1.2f), 0, 10);
    room_quad(&there, lw_vec3(1.2f, 1.6f, 0.4f), lw_vec3(1.2f, 0, 0), lw_vec3(0, 0, 1.2f), 0, 10);
    room_solve(&s, &here, settings, 400);
    room_solve(&fresh, &there, settings, 200);
    const struct squares before = light_of_floor(&s), after = light_of_floor(&fresh);
    shift(&s, PLATE, 0.15f);
    room_solve_on(&s, &frame, 6);
    const struct squares now = light_of_floor(&s);
    room_finish(&fresh);
    room_finish(&s);
    return share_of_change(&now, &before, &after);
}

/* A filter takes noise off, and so stale light may lose more weight. One seed scatters by 0.09 (one sigma, 21
 * seeds). */
static void test_filtered_light_changes_sooner(void **state) {
    (void)state;
    enum { SEEDS = 4 };
    double plain = 0, filtered = 0;
    for (uint32_t seed = 1; seed <= SEEDS; seed++) {
        plain += share_after_six_frames(false, seed) / SEEDS;
        filtered += share_after_six_frames(true, seed) / SEEDS;
    }
    printf("after six frames: %.3f of the change, %.3f where the filter runs\n", plain, filtered);
    assert_true(plain > 0.8 && plain < filtered + 0.1);
    assert_true(filtered > 0.83 && filtered < 1.1);
}

/* ---- steadily ---- */

/* A lamp that dims by 2 % a frame: the light follows it, and does not boil. */
static void test_follows_a_lamp(void **state) {
    (void)state;
    const struct room room = make_room(8, 1.4f);
    struct room_solution s;
    uint64_t frame = 100;
    room_solve(&s, &room, desc, 100);
    const double before = room_object_mean(&s, 0).direct;
    for (unsigned i = 0; i < 40; i++) {
        s.pose.light[0].intensity = lw_vec3_scale(s.pose.light[0].intensity, 0.98f);
        room_solve_on(&s, &frame, 1);
    }
    const double now = room_object_mean(&s, 0).direct / (before * pow(0.98, 40));
    assert_true(now > 0.99 && now < 1.08); /* a memory of four frames lags by three */
    room_solve_on(&s, &frame, 100);
    expect_near(room_object_mean(&s, 0).direct, before * pow(0.98, 40), 0.005);
    room_finish(&s);
}

/* A lamp that goes out leaves no glow: bounces follow within a frame or two. */
static void test_a_lamp_goes_out(void **state) {
    (void)state;
    const struct room room = make_room(8, 1.4f);
    struct room_solution s;
    uint64_t frame = 200;
    room_solve(&s, &room, desc, 200);
    const struct room_mean before = room_object_mean(&s, 0);
    s.pose.light[0].intensity = lw_vec3(0, 0, 0);
    room_solve_on(&s, &frame, 1);
    assert_true(room_object_mean(&s, 0).direct < 0.01 * before.direct);
    assert_true(room_object_mean(&s, 0).indirect < 0.4 * before.indirect);
    room_solve_on(&s, &frame, 5);
    assert_true(room_object_mean(&s, 0).indirect < 0.02 * before.indirect);
    room_solve_on(&s, &frame, 20);
    assert_true(room_object_mean(&s, 0).total < 0.001 * before.total);
    room_finish(&s);
}

/* ---- memories of other light ---- */

#define SEEDS 4u

/* The room's lamp, which may be off, and one at the far end, a quarter as strong. */
static struct room room_of_two_lamps(void) {
    struct room room = make_room(8, 1.4f);
    room.texels_per_metre = 8;
    for (int c = 0; c < 3; c++) room.light[0].intensity[c] = 20;
    room.light[1] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {5, 5, 5}};
    room.light_position[1] = lw_vec3(6, 1.2f, 0.8f);
    room.light_count = 2;
    return room;
}

static void light_up(struct room_solution *s, bool lit) {
    s->pose.light[0].intensity = lit ? lw_vec3(20, 20, 20) : lw_vec3(0, 0, 0);
}

/* Mean square by which texels of the floor are off, each relative to its square's light. */
struct errors {
    const struct squares *reference;
    double square, area;
};

static void add_error(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    struct errors *errors = user;
    const double light = errors->reference->light[(int)(p.x * 2) * 4 + (int)(p.z * 2)],
                 off = light > 0 ? (direct + indirect) / light - 1 : 0;
    errors->square += area * off * off;
    errors->area += area;
}

/* After six frames with the lamp on or off; before, for `before` frames, it was the other way round. */
static double error_after(const struct squares *reference, bool lit, unsigned before, uint32_t seed) {
    struct lw_solver_desc seeded = desc;
    struct room_solution s;
    uint64_t frame = 0;
    seeded.seed = seed;
    const struct room room = room_of_two_lamps();
    room_solve(&s, &room, seeded, 0);
    light_up(&s, !lit);
    room_solve_on(&s, &frame, before);
    light_up(&s, lit);
    room_solve_on(&s, &frame, 6);
    struct errors errors = {.reference = reference};
    room_each_texel(&s, 0, add_error, &errors);
    room_finish(&s);
    return errors.square / errors.area;
}

/* The floor with the lamp on or off. */
static struct squares light_of_two_lamps(bool lit) {
    struct lw_solver_desc exact = desc;
    struct room_solution s;
    exact.target_error = -1;
    exact.seed = 1000;
    uint64_t frame = 0;
    const struct room room = room_of_two_lamps();
    room_solve(&s, &room, exact, 0);
    light_up(&s, lit);
    room_solve_on(&s, &frame, 60); /* a square: 360 times the samples of a texel in six frames */
    const struct squares light = light_of_floor(&s);
    room_finish(&s);
    return light;
}

static double mean_error_after(const struct squares *reference, bool lit, unsigned before) {
    double sum = 0;
    for (uint32_t seed = 1; seed <= SEEDS; seed++) sum += error_after(reference, lit, before, seed);
    return sum / SEEDS;
}

static void expect_about_as_fresh(const struct squares *reference, bool lit, unsigned before, double fresh,
                                  double times) {
    const double was = mean_error_after(reference, lit, before);
    if (!(was <= times * fresh))
        fail_msg("%g times the error of a solve that begins: the lamp was %s after %u frames", was / fresh,
                 lit ? "lit" : "put out", before);
}

/* The history of other light should be worth something, or at least do no harm: a solve that has just
 * begun and must forget is a frame behind. */
static void test_memory_does_no_harm(void **state) {
    (void)state;
    const struct squares dark = light_of_two_lamps(false), lit = light_of_two_lamps(true);
    const double dark_anew = mean_error_after(&dark, false, 0), lit_anew = mean_error_after(&lit, true, 0);
    expect_about_as_fresh(&dark, false, 1, dark_anew, 2.2);
    expect_about_as_fresh(&dark, false, 30, dark_anew, 1.2);
    expect_about_as_fresh(&lit, true, 30, lit_anew, 1.1);
}

/* A converged block whose texels' indirect light comes out otherwise, by `each` up or down, in
 * the mean over a region by 1/8. */
static bool wakes(float each) {
    struct lw_packet packet[LW_PACKETS_MAX];
    struct lw_change_packet change[LW_PACKETS_MAX] = {0};
    struct lw_solve_block block = {.covered_count = 256,
                                   .packet = packet,
                                   .packet_count = LW_PACKETS_MAX,
                                   .change = {.packet = change},
                                   .state = LW_BLOCK_CONVERGED,
                                   .weight = {1, 1, 1, 1},
                                   .reference_luminance = 1};
    for (uint32_t set = 0; set < LW_PACKETS_MAX; set++) {
        packet[set].count = LW_TRACE_WIDTH;
        memset(packet[set].lanes, LW_TRACE_WIDTH / LW_REGIONS, sizeof packet[set].lanes);
        for (uint32_t k = 0; k < LW_TRACE_WIDTH; k++) /* every fourth texel in both directions */
            packet[set].texel[k] = (uint8_t)((set / 4 + k / 4 * 4) * LW_TILE_BLOCK + set % 4 + k % 4 * 4);
        for (uint32_t r = 0; r < LW_REGIONS; r++) {
            block.change.packet[set].indirect[0][r].y = 4 * 0.125f;
            block.change.packet[set].indirect_square[r] = 4 * each * each;
        }
    }
    lw_gradient_invalidate(&block, 0.02f, &(struct lw_budget){0});
    return block.state != LW_BLOCK_CONVERGED;
}

/* What each texel finds for itself is noise of others' light; what they find together has changed. */
static void test_noise_is_no_change(void **state) {
    (void)state;
    assert_true(wakes(0.125f));
    assert_true(wakes(0.5f));
    assert_false(wakes(1)); /* the mean of 64 is off by 1/8 */
}

/* Movements that put tiles in another order, between frames that solve a few of them each. */
static void test_what_is_not_solved_is_not_due(void **state) {
    (void)state;
    const struct room room = make_room(8, 1.4f);
    struct lw_solver_desc small_cells = desc;
    struct room_solution s;
    uint64_t frame = 4;
    small_cells.cell_size_m = 0.5f;
    room_solve(&s, &room, small_cells, 4);
    uint8_t *interest = calloc(s.map.tile_count + 1u, 1);
    assert_non_null(interest);
    for (uint32_t i = 0; i < s.map.tile_count; i++) interest[i] = s.map.place[i].object == PLATE;
    lw_support_ok(s.solver->ops->set_interest(s.solver, interest, NULL), NULL);
    for (unsigned i = 0; i < 20; i++) {
        shift(&s, PLATE, i & 1 ? -5 : 5);
        s.pose.object_hidden[PLATE] = i & 2;
        room_solve_on(&s, &frame, 1);
        const struct lw_tiles *tiles = &((const struct lw_cell_solver *)s.solver)->tiles;
        for (uint32_t k = 0; k < tiles->count; k++)
            LW_TILES_EACH_BLOCK (&tiles->tile[k], block)
                assert_true(lw_cell_layer_solved(s.solver, tiles->tile[k].id) || !block->due);
    }
    free(interest);
    room_finish(&s);
}

/* Every object goes and comes back, one after another: what one has hidden comes to light as it goes, and
 * texels beside it that yielded to it do no more. */
static void move_each(struct room_solution *s, uint64_t *frame) {
    for (uint32_t o = 0; o < s->scene->object_count; o++) {
        shift(s, o, 0.05f);
        room_solve_on(s, frame, 1);
        shift(s, o, -0.05f);
        room_solve_on(s, frame, 1);
    }
    for (uint32_t id = 0; id < s->map.tile_count; id++) {
        struct lw_solver_tile tile;
        if (s->map.place[id].level) continue;
        s->solver->ops->read_tile(s->solver, (lw_tile_id){id}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            const float light = tile.direct[0][i] + tile.indirect[0][i];
            assert_true(isfinite(light) && light >= 0);
        }
    }
}

static void test_each_object_may_begin_to_move(void **state) {
    (void)state;
    struct lw_error err = {0};
    struct lw_scene *scene;
    struct room_solution s;
    uint64_t frame = 1;
    lw_support_ok(lw_builtin_build("builtin:atrium-matt", &scene, &err), &err);
    room_solve_scene(&s, scene, 2, desc, 1);
    move_each(&s, &frame);
    room_finish(&s);
}

/* One object after the other is shifted by up to half of `reach`, hidden or shown, `changes` times, a frame
 * each; then all are where they were. */
static void change_and_put_back(struct room_solution *s, uint64_t *frame, uint32_t changes, float reach) {
    const uint32_t objects = s->scene->object_count;
    struct lw_affine *before = malloc(objects * sizeof *before);
    assert_non_null(before);
    memcpy(before, s->pose.object_to_world, objects * sizeof *before);
    for (uint32_t i = 0; i < changes; i++) {
        const uint32_t o = lw_random_hash2(i, 0) % objects;
        if (lw_random_hash2(i, 1) & 1)
            shift(s, o, reach * (lw_random_unit(lw_random_hash2(i, 2)) - 0.5f));
        else
            s->pose.object_hidden[o] = !s->pose.object_hidden[o];
        s->pose.object_dynamic[o] = true;
        room_solve_on(s, frame, 1);
    }
    memcpy(s->pose.object_to_world, before, objects * sizeof *before);
    for (uint32_t o = 0; o < objects; o++) s->pose.object_hidden[o] = false;
    free(before);
}

static void let_all_move(struct room_solution *s) {
    for (uint32_t o = 0; o < s->scene->object_count; o++) s->pose.object_dynamic[o] = true;
}

/* The walls of a house hide ground, which comes to light while they move. */
static void test_objects_may_begin_to_move(void **state) {
    (void)state;
    const struct house house = {.kind = HOUSE_BOXES, .thick = 0.6f, .angle = 0.3f, .density = 2};
    const struct room room = house_build(&house);
    const double whole = pow((double)(HOUSE_FIELD * house.density), 2);
    struct room_solution s;
    uint64_t frame = 1;
    room_solve(&s, &room, desc, 1);
    assert_true(room_object_mean(&s, 0).texels < 0.95 * whole);
    for (int i = 0; i < 2; i++) { /* an object that moves once stands at once */
        for (uint32_t o = 1; o < room.quad_count; o++) shift(&s, o, 0.05f);
        room_solve_on(&s, &frame, 1);
    }
    expect_near(room_object_mean(&s, 0).texels, whole, 1e-3);
    room_solve_on(&s, &frame, LW_STANDING_FRAMES + 1);
    assert_true(room_object_mean(&s, 0).texels < 0.95 * whole);
    move_each(&s, &frame);
    room_finish(&s);
}

/* Whatever happened: once all objects are back, the light is that of the scene in which all of them may move
 * and none has. */
static void test_whatever_happened_the_light_comes_back(void **state) {
    (void)state;
    const struct room room = make_room(2, 1.4f);
    struct room_solution s[2];
    uint64_t frame[2] = {1, 1};
    for (int k = 0; k < 2; k++) room_solve(&s[k], &room, desc, 1);
    change_and_put_back(&s[0], &frame[0], 40, 1);
    for (int k = 0; k < 2; k++) {
        let_all_move(&s[k]);
        room_solve_until_rest(&s[k], &frame[k]);
    }
    for (uint32_t o = 0; o < room.quad_count; o++)
        expect_near(room_object_mean(&s[0], o).total, room_object_mean(&s[1], o).total, 0.05);
    room_finish(&s[1]);
    room_finish(&s[0]);
}

/* The same where objects hide much of one another. */
static void test_an_atrium_comes_back(void **state) {
    (void)state;
    enum { FRAMES = 400 };
    struct room_solution s[2];
    uint64_t frame[2] = {1, 1};
    for (int k = 0; k < 2; k++) {
        struct lw_scene *scene;
        struct lw_error err = {0};
        lw_support_ok(lw_builtin_build("builtin:atrium-matt", &scene, &err), &err);
        room_solve_scene(&s[k], scene, 1, desc, 1);
    }
    change_and_put_back(&s[0], &frame[0], 150, 2);
    for (int k = 0; k < 2; k++) {
        let_all_move(&s[k]);
        room_solve_on(&s[k], &frame[k], FRAMES);
    }
    for (uint32_t o = 0; o < s[0].scene->object_count; o++)
        expect_near(room_object_mean(&s[0], o).total, room_object_mean(&s[1], o).total, 0.05);
    room_finish(&s[1]);
    room_finish(&s[0]);
}

/* With an argument: the long tests alone. */
int main(int argc, char **argv) {
    const struct CMUnitTest long_tests[] = {cmocka_unit_test(test_an_atrium_comes_back),
                                            cmocka_unit_test(test_each_object_may_begin_to_move)};
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_what_is_not_solved_is_not_due),
        cmocka_unit_test(test_whatever_happened_the_light_comes_back),
        cmocka_unit_test(test_objects_may_begin_to_move),
        cmocka_unit_test(test_a_lamp_goes_out),
        cmocka_unit_test(test_no_ghost_stays),
        cmocka_unit_test(test_there_and_back),
        cmocka_unit_test(test_asked_in_many_frames),
        cmocka_unit_test(test_both_sides_of_a_plate),
        cmocka_unit_test(test_little_is_solved_for_a_small_change),
        cmocka_unit_test(test_nothing_is_solved_for_what_lights_nothing),
        cmocka_unit_test(test_filtered_light_changes_sooner),
        cmocka_unit_test(test_follows_a_lamp),
        cmocka_unit_test(test_memory_does_no_harm),
        cmocka_unit_test(test_noise_is_no_change),
    };
    (void)argv;
    if (argc > 1) return cmocka_run_group_tests(long_tests, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
