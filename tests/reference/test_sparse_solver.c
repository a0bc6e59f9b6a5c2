/* Level 0 where somebody looks, and a coarse scene beside: light is that of the whole density there. Tiles
 * come and go as interest does. */
#include "tests/reference/room.h"

#include "common/base/colour.h"
#include "common/lightmap/lightmap.h"
#include "server/solve/memory_forecast.h"
#include "server/solve/sparse_solver.h"

#include <stdlib.h>
#include <string.h>

#define DENSITY 24
#define FINER   1u
#define IDS     512u
#define FRAMES  40u
#define TILES   64u

static const struct lw_solver_desc terms = {.bounces = 2,
                                            .direct_samples = 1,
                                            .indirect_samples = 4,
                                            .target_error = 0.02f,
                                            .denoise = true,
                                            .fine_tiles = TILES,
                                            .threads = 2,
                                            .seed = 3};

static void begin(struct room_solution *s, bool sparse, struct lw_solver_desc desc) {
    const struct room room = room_with_two_lamps();
    const struct lw_solvers_entry *entry = lw_solvers_at(0);
    struct lw_error err = {0};
    *s = (struct room_solution){.scene = room_scene(&room)};
    lw_support_ok(
        lw_lightmap_build(s->scene, &(struct lw_lightmap_desc){.texels_per_metre = DENSITY}, NULL, &err),
        &err);
    lw_support_ok(lw_atlas_map_init_finer(&s->map, s->scene, FINER, IDS), NULL);
    lw_support_ok(lw_pose_init(&s->pose, s->scene), NULL);
    lw_pose_evaluate(&s->pose, s->scene, 0);
    desc.scene = s->scene;
    desc.atlas_map = &s->map;
    lw_support_ok(sparse ? lw_sparse_solver_create(entry, &desc, &s->pose, &s->solver, &err)
                         : entry->create(&desc, &s->pose, &s->solver, &err),
                  &err);
}

/* Somebody looks at the floor, object 0, at a level: of it alone, or at level 0 of all objects, too. */
static void look_at(struct room_solution *s, uint32_t level, bool all) {
    uint8_t *interest = calloc(s->map.tile_count + 1ul, 1);
    assert_non_null(interest);
    for (uint32_t id = 0; id < s->map.plain_count; id++) {
        const struct lw_tile_place *place = &s->map.place[id];
        if (place->level == 0 && (all || place->object == 0))
            interest[id] = lw_atlas_finer(level) ? 1 : 1 + (uint8_t)level;
    }
    for (uint32_t t = 0; lw_atlas_finer(level) && lw_atlas_map_has_tile(&s->map, 0, level, t); t++)
        interest[lw_atlas_map_claim_tile(&s->map, 0, level, t).v] = 1;
    lw_support_ok(s->solver->ops->set_interest(s->solver, interest, NULL), NULL);
    free(interest);
}

static uint64_t step(struct room_solution *s, uint64_t from, uint32_t frames) {
    for (uint64_t frame = from; frame < from + frames; frame++) room_frame(s, frame);
    return from + frames;
}

/* Its planes hold until the next one is read. */
static struct lw_solver_tile read(const struct room_solution *s, uint32_t id) {
    static struct lw_solver_room room;
    struct lw_solver_tile tile;
    lw_solver_read_light(s->solver, (lw_tile_id){id}, &room, &tile);
    return tile;
}

/* How many tiles of level 0 of the floor read as coarse light, and how many do not. */
static void count_floor(const struct room_solution *s, uint32_t *out_coarse, uint32_t *out_lit) {
    *out_coarse = *out_lit = 0;
    for (uint32_t id = 0; id < s->map.plain_count; id++) {
        if (s->map.place[id].level || s->map.place[id].object) continue;
        ++*(read(s, id).error == LW_ATLAS_COARSE_ERROR ? out_coarse : out_lit);
    }
}

/* Sum of light over covered texels of a tile, and their number. */
static void add_light(const struct lw_solver_tile *tile, double *sum, double *texels) {
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        if (!tile->covered[i]) continue;
        *sum += (double)tile->shown[LW_TILE_CHANNEL_FULL][1][i];
        ++*texels;
    }
}

/* Adds the cosine moment over covered texels of a tile, and the luminance that it belongs to. */
static void add_moment(const struct lw_solver_tile *tile, struct lw_vec3 *moment, float *light) {
    const float *const *e = (const float *const *)tile->shown[LW_TILE_CHANNEL_FULL],
                       *const *v = (const float *const *)tile->shown[LW_TILE_CHANNEL_DIRECTION];
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        if (!tile->covered[i]) continue;
        const float luminance = lw_colour_luminance(lw_vec3(e[0][i], e[1][i], e[2][i]));
        const struct lw_vec3 own = lw_vec3(v[0][i], v[1][i], v[2][i]);
        assert_true(lw_vec3_length(own) <= 1.0001f * luminance + 1e-6f);
        *moment = lw_vec3_add(*moment, own);
        *light += luminance;
    }
}

/* r of all light of a tile. */
static struct lw_vec3 direction_of(const struct room_solution *s, uint32_t id) {
    const struct lw_solver_tile tile = read(s, id);
    struct lw_vec3 moment = lw_vec3(0, 0, 0);
    float light = 0;
    add_moment(&tile, &moment, &light);
    return light > 0 ? lw_vec3_scale(moment, 1 / light) : moment;
}

/* ---- tests ---- */

/* Tiles of the floor, which somebody looks at, and coarse ones elsewhere: where their light comes from is
 * what a solve of the whole density says. */
static void directions_are_those_of_the_whole_density(void **state) {
    (void)state;
    struct room_solution sparse, whole;
    struct lw_solver_desc desc = terms;
    const uint32_t channels = LW_TILE_CHANNELS_FULL | lw_tile_channel_bit(LW_TILE_CHANNEL_DIRECTION);
    uint32_t lit = 0, coarse = 0;
    desc.directions = true;
    begin(&sparse, true, desc);
    begin(&whole, false, desc);
    sparse.solver->ops->choose_channels(sparse.solver, channels);
    whole.solver->ops->choose_channels(whole.solver, channels);
    look_at(&sparse, 0, false);
    step(&sparse, 1, 20);
    step(&whole, 1, 20);
    for (uint32_t id = 0; id < whole.map.plain_count; id++) {
        if (whole.map.place[id].level) continue;
        const bool is_coarse = read(&sparse, id).error == LW_ATLAS_COARSE_ERROR;
        const struct lw_vec3 r = direction_of(&whole, id), off = lw_vec3_sub(direction_of(&sparse, id), r);
        if (lw_vec3_length(r) < 0.1f) continue;
        if (lw_vec3_length(off) > (is_coarse ? 0.1f : 0.03f))
            fail_msg("tile %u, coarse %d: %.3f apart", id, is_coarse, (double)lw_vec3_length(off));
        ++*(is_coarse ? &coarse : &lit);
    }
    assert_true(lit > 1 && coarse > 1);
    room_finish(&sparse);
    room_finish(&whole);
}

/* Each tile of the floor has the mean of that of a solve of the whole density, and so has each texel, within
 * noise. */
static void what_is_looked_at_is_lit_as_densely_as_asked_for(void **state) {
    (void)state;
    struct room_solution sparse, whole;
    uint32_t coarse, lit;
    begin(&sparse, true, terms);
    begin(&whole, false, terms);
    look_at(&sparse, 0, false);
    step(&sparse, 1, FRAMES);
    step(&whole, 1, FRAMES);
    count_floor(&sparse, &coarse, &lit);
    assert_true(coarse == 0 && lit > 1);
    double square = 0, texels = 0;
    for (uint32_t id = 0; id < whole.map.plain_count; id++) {
        if (whole.map.place[id].level || whole.map.place[id].object) continue;
        const struct lw_solver_tile a = read(&sparse, id), b = read(&whole, id);
        double sum[2] = {0}, count[2] = {0};
        assert_true(a.width == b.width && a.height == b.height);
        add_light(&a, &sum[0], &count[0]);
        add_light(&b, &sum[1], &count[1]);
        expect_near(count[0], count[1], 0.001);
        expect_near(sum[0] / count[0], sum[1] / count[1], 0.03);
        for (uint32_t i = 0; i < a.width * a.height; i++) {
            const float *e[2] = {a.shown[LW_TILE_CHANNEL_FULL][1], b.shown[LW_TILE_CHANNEL_FULL][1]};
            if (!a.covered[i] || !b.covered[i]) continue;
            const double off = (double)(e[0][i] - e[1][i]) / (0.05 * sum[1] / count[1] + (double)e[1][i]);
            square += off * off;
            texels++;
        }
    }
    if (sqrt(square / texels) > 0.08) fail_msg("texels differ by %.3g", sqrt(square / texels));
    room_finish(&sparse);
    room_finish(&whole);
}

/* Nobody looks at the walls: they are coarse, and light the floor. So is level 2 of it. */
static void the_rest_is_coarse(void **state) {
    (void)state;
    struct room_solution s;
    uint32_t coarse, lit;
    begin(&s, true, terms);
    look_at(&s, LW_ATLAS_READ_MAX, false);
    const uint64_t next = step(&s, 1, 20);
    count_floor(&s, &coarse, &lit);
    assert_true(coarse > 1 && lit == 0 && s.stats.tiles_fine == 0);
    look_at(&s, 0, false);
    step(&s, next, 20);
    for (uint32_t id = 0; id < s.map.plain_count; id++) {
        const struct lw_solver_tile tile = s.map.place[id].level ? (struct lw_solver_tile){0} : read(&s, id);
        if (s.map.place[id].level || !tile.has_surface) continue;
        assert_int_equal(tile.error == LW_ATLAS_COARSE_ERROR, s.map.place[id].object != 0);
    }
    room_finish(&s);
}

static void want_ceiling(struct room_solution *s) {
    uint8_t *interest = calloc(s->map.tile_count + 1ul, 1);
    assert_non_null(interest);
    for (uint32_t id = 0; id < s->map.plain_count; id++)
        interest[id] = s->map.place[id].level == 0 && s->map.place[id].object == 1;
    lw_support_ok(s->solver->ops->set_interest(s->solver, interest, NULL), NULL);
    free(interest);
}

/* A tile whose room others take is coarse light again, which counts as a change. */
static void what_gives_way_is_coarse_again(void **state) {
    (void)state;
    struct room_solution s;
    uint32_t coarse, lit, others = 0, changed_tiles = 0;
    struct lw_solver_desc desc = terms;
    desc.fine_tiles = 1;
    begin(&s, true, desc);
    look_at(&s, 0, false);
    uint64_t next = step(&s, 1, FRAMES);
    count_floor(&s, &coarse, &lit);
    assert_true(lit == 1 && coarse == 1); /* as many as there is room for */
    look_at(&s, LW_ATLAS_READ_MAX, false);
    next = step(&s, next, 2);
    count_floor(&s, &coarse, &lit);
    assert_int_equal(lit, 1); /* nobody needs its room */
    want_ceiling(&s);
    step(&s, next, FRAMES);
    count_floor(&s, &coarse, &lit);
    assert_true(lit == 0 && coarse == 2);
    for (uint32_t id = 0; id < s.map.plain_count; id++) {
        if (s.map.place[id].level) continue;
        others += s.map.place[id].object == 1 && read(&s, id).error != LW_ATLAS_COARSE_ERROR;
        changed_tiles += s.map.place[id].object == 0 && read(&s, id).solved_frame >= next;
    }
    assert_true(others == 1 && changed_tiles >= 1);
    room_finish(&s);
}

/* Finer levels have the names that clients know, and light of their own. */
static void finer_levels_are_there(void **state) {
    (void)state;
    struct room_solution s;
    const lw_tile_id *listed;
    begin(&s, true, terms);
    look_at(&s, LW_ATLAS_FINER + 1, false);
    step(&s, 1, FRAMES);
    const uint32_t count = s.solver->ops->list_fine(s.solver, &listed);
    assert_true(count > 4);
    for (uint32_t i = 0; i < count; i++) {
        const struct lw_tile_place *place = &s.map.place[listed[i].v];
        const struct lw_solver_tile tile = read(&s, listed[i].v),
                                    below = read(&s, lw_atlas_map_below(&s.map, listed[i]).v);
        assert_true(place->object == 0 && place->level == LW_ATLAS_FINER + 1);
        assert_true(s.solver->ops->holds_fine(s.solver, listed[i]));
        assert_true(i == 0 || listed[i].v > listed[i - 1].v);
        assert_true(tile.width == place->width && tile.height == place->height);
        double sum[2] = {0}, texels[2] = {0};
        add_light(&tile, &sum[0], &texels[0]);
        add_light(&below, &sum[1], &texels[1]);
        if (texels[0] && below.width == tile.width) assert_true(sum[0] / texels[0] < 4 * sum[1] / texels[1]);
    }
    look_at(&s, 0, false);
    step(&s, FRAMES + 1, 1);
    room_finish(&s);
}

/* --keep has the sums of the coarse scene: who loads them shows coarse light at once, and tiles are made
 * again. */
static void kept_light_is_the_coarse_scene(void **state) {
    (void)state;
    static const uint8_t key[16] = {5};
    const char *path = lw_support_temporary("state");
    struct room_solution s, loaded;
    struct lw_error err = {0};
    uint32_t coarse, lit;
    uint64_t frames;
    begin(&s, true, terms);
    look_at(&s, 0, false);
    step(&s, 1, FRAMES);
    count_floor(&s, &coarse, &lit);
    assert_true(coarse == 0 && lit > 1);
    lw_support_ok(s.solver->ops->save(s.solver, path, key, &err), &err);
    begin(&loaded, true, terms);
    lw_support_ok(loaded.solver->ops->load(loaded.solver, path, key, &frames, &err), &err);
    assert_int_equal(frames, FRAMES);
    count_floor(&loaded, &coarse, &lit);
    assert_true(coarse > 1 && lit == 0);
    for (uint32_t id = 0; id < s.map.plain_count; id++) {
        if (s.map.place[id].level || s.map.place[id].object == 0) continue; /* walls are coarse in both */
        double sum[2] = {0}, texels[2] = {0};
        struct lw_solver_tile tile = read(&s, id);
        add_light(&tile, &sum[0], &texels[0]);
        tile = read(&loaded, id);
        add_light(&tile, &sum[1], &texels[1]);
        assert_true(texels[0] == texels[1] && sum[0] == sum[1]);
    }
    look_at(&loaded, 0, false);
    step(&loaded, frames + 1, 20);
    count_floor(&loaded, &coarse, &lit);
    assert_true(coarse == 0 && lit > 1);
    room_finish(&s);
    room_finish(&loaded);
}

/* The same interest and frames give the same bytes at any thread count. */
static void bytes_are_the_same(void **state) {
    (void)state;
    struct room_solution s[2];
    for (int k = 0; k < 2; k++) {
        struct lw_solver_desc desc = terms;
        desc.threads = k ? 2 : 1;
        begin(&s[k], true, desc);
        look_at(&s[k], 0, false);
        const uint64_t next = step(&s[k], 1, 12);
        look_at(&s[k], LW_ATLAS_FINER + 1, true);
        step(&s[k], next, 12);
    }
    for (uint32_t id = 0; id < s[0].map.plain_count; id++) {
        if (s[0].map.place[id].level) continue;
        const struct lw_solver_tile a = read(&s[0], id), b = read(&s[1], id);
        assert_true(a.solved_frame == b.solved_frame && a.sample_count == b.sample_count);
        for (int c = 0; c < 3; c++)
            assert_memory_equal(a.shown[LW_TILE_CHANNEL_FULL][c], b.shown[LW_TILE_CHANNEL_FULL][c],
                                a.width * a.height * sizeof(float));
    }
    room_finish(&s[0]);
    room_finish(&s[1]);
}

/* It takes less than the whole density would. */
static void memory_is_less(void **state) {
    (void)state;
    struct room_solution s[2];
    struct lw_solver_desc desc = terms;
    desc.fine_tiles = 1;
    begin(&s[0], true, desc);
    desc.fine_tiles = 0;
    begin(&s[1], false, desc);
    const size_t sparse = s[0].solver->ops->memory_bytes(s[0].solver),
                 whole = s[1].solver->ops->memory_bytes(s[1].solver);
    if (sparse > whole / 2) fail_msg("%zu bytes, and %zu for all", sparse, whole);
    desc.scene = s[1].scene;
    assert_true(lw_memory_forecast_coarse(&desc, 1) * 4 <= lw_memory_forecast_whole(&desc, 1));
    room_finish(&s[0]);
    room_finish(&s[1]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_looked_at_is_lit_as_densely_as_asked_for),
        cmocka_unit_test(directions_are_those_of_the_whole_density),
        cmocka_unit_test(the_rest_is_coarse),
        cmocka_unit_test(what_gives_way_is_coarse_again),
        cmocka_unit_test(finer_levels_are_there),
        cmocka_unit_test(kept_light_is_the_coarse_scene),
        cmocka_unit_test(bytes_are_the_same),
        cmocka_unit_test(memory_is_less),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
