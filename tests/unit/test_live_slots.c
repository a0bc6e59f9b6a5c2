/* Which tiles have slots of an engine's pool, how they fade, and the reports to the engine. */
#include "tests/support/support.h"

#include "client/lib/live_slots.h"

#include <stdlib.h>
#include <string.h>

enum { SLOTS = 4, ROOM = 16, FINER = 2, ALL = 2 * ROOM };

#define LEVEL (LW_LIVE_FINER + 2) /* most tiles here: 800 x 288 texels, 13 x 5 tiles */
#define MS    1000000ull

static struct {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_client_tile *tile; /* per id */
    uint64_t version;            /* the newest version of any tile */
    struct lw_live_tiles tiles;
    struct lw_live_slots slots;
    struct lw_live_slot reported[ALL];
    float texels[3 * LW_TILE_TEXELS_MAX];
} w;

const struct lw_atlas_map *__wrap_lw_client_atlas_map(const struct lw_client *client);
struct lw_client_tile __wrap_lw_client_get_tile(const struct lw_client *client, lw_tile_id tile);
void __wrap_lw_client_get_stats(const struct lw_client *client, struct lw_client_stats *out_stats);

const struct lw_atlas_map *__wrap_lw_client_atlas_map(const struct lw_client *client) {
    (void)client;
    return &w.map;
}

struct lw_client_tile __wrap_lw_client_get_tile(const struct lw_client *client, lw_tile_id tile) {
    (void)client;
    return w.tile[tile.v];
}

void __wrap_lw_client_get_stats(const struct lw_client *client, struct lw_client_stats *out_stats) {
    (void)client;
    *out_stats = (struct lw_client_stats){.noise_shown = 1};
}

static int start(void **state) {
    (void)state;
    w.scene = lw_support_squares(2, 1);
    w.scene->mesh[0].atlas_width = 200;
    w.scene->mesh[0].atlas_height = 72;
    lw_support_ok(lw_atlas_map_init_finer(&w.map, w.scene, FINER, ROOM), NULL);
    w.tile = calloc(w.map.tile_count, sizeof *w.tile);
    assert_non_null(w.tile);
    lw_support_ok(lw_live_tiles_init(&w.tiles, NULL, false, true), NULL);
    lw_support_ok(lw_live_slots_init(&w.slots, &w.tiles, SLOTS), NULL);
    return 0;
}

static int end(void **state) {
    (void)state;
    lw_live_slots_finish(&w.slots);
    lw_live_tiles_finish(&w.tiles);
    free(w.tile);
    lw_atlas_map_finish(&w.map);
    lw_scene_destroy(w.scene);
    memset(&w, 0, sizeof w);
    return 0;
}

/* A tile comes, or a newer version of it does. */
static lw_tile_id put(uint32_t x, uint32_t y) {
    const lw_tile_id id = lw_atlas_map_claim(&w.map, 1, LEVEL, x, y);
    assert_int_not_equal(id.v, UINT32_MAX);
    w.tile[id.v].version = ++w.version;
    w.tile[id.v].rgb = w.texels;
    return id;
}

static void withdraw(lw_tile_id id) { w.tile[id.v] = (struct lw_client_tile){0}; }

static size_t take_slots(uint64_t now_ns) { return lw_live_slots_take(&w.slots, now_ns, 0, w.reported, ALL); }

static void is_reported(size_t at, uint32_t slot, uint32_t x, uint32_t y, bool has_texels, float share) {
    const struct lw_live_slot *s = &w.reported[at];
    const struct lw_atlas *atlas = w.map.atlas[1];
    assert_int_equal(s->slot, slot);
    assert_int_equal(s->has_texels, has_texels);
    assert_true(s->share > share - 1e-4f && s->share < share + 1e-4f);
    assert_int_equal(s->rect.object, 1);
    assert_int_equal(s->rect.level, LEVEL);
    assert_int_equal(s->rect.x, 64 * x);
    assert_int_equal(s->rect.y, 64 * y);
    assert_int_equal(s->page,
                     w.map.first_finer[1] + atlas->finer[1].first_tile + y * atlas->finer[1].tiles_x + x);
}

static void test_tiles_fade_in_and_out(void **state) {
    (void)state;
    assert_int_equal(take_slots(1000 * MS), 0);
    const lw_tile_id id = put(3, 1);
    assert_int_equal(take_slots(1100 * MS), 1);
    is_reported(0, 0, 3, 1, true, 0);
    assert_int_equal(w.reported[0].rect.width, 65);
    assert_int_equal(w.reported[0].rect.height, 65);
    assert_int_equal(w.slots.used, 1);
    assert_int_equal(w.slots.waiting, 1);
    assert_int_equal(take_slots(1150 * MS), 1);
    is_reported(0, 0, 3, 1, false, 0.2f);
    assert_int_equal(take_slots(2000 * MS), 1);
    is_reported(0, 0, 3, 1, false, 1);
    assert_int_equal(w.slots.waiting, 0);
    assert_int_equal(take_slots(2100 * MS), 0); /* all is reported */
    withdraw(id);
    assert_int_equal(take_slots(2200 * MS), 0); /* it turns: nobody has drawn since */
    assert_int_equal(take_slots(2300 * MS), 1);
    is_reported(0, 0, 3, 1, false, 0.6f);
    put(3, 1); /* it is there again: the same slot, and all of it */
    assert_int_equal(take_slots(2350 * MS), 1);
    is_reported(0, 0, 3, 1, true, 0.6f);
    assert_int_equal(take_slots(2400 * MS), 1);
    is_reported(0, 0, 3, 1, false, 0.8f);
    withdraw(id);
    lw_atlas_map_release(&w.map, id); /* the id goes to another tile */
    (void)take_slots(2410 * MS);
    assert_int_equal(take_slots(2510 * MS), 1);
    is_reported(0, 0, 3, 1, false, 0.4f);
    assert_int_equal(take_slots(2700 * MS), 1);
    is_reported(0, 0, 3, 1, false, 0);
    assert_int_equal(w.slots.used, 0);
    assert_int_equal(w.slots.waiting, 0);
    assert_int_equal(take_slots(2800 * MS), 0);
}

static void test_without_a_clock_tiles_come_and_go_at_once(void **state) {
    (void)state;
    const lw_tile_id id = put(0, 0);
    assert_int_equal(take_slots(0), 1);
    is_reported(0, 0, 0, 0, true, 1);
    assert_int_equal(w.slots.waiting, 0);
    withdraw(id);
    assert_int_equal(take_slots(0), 1);
    is_reported(0, 0, 0, 0, false, 0);
    assert_int_equal(take_slots(0), 0);
}

/* A rectangle has the next column and row, but at the edge of the level; it is reported again when the tiles
 * beside change, or level 0 below them where they are not there. */
static void test_borders(void **state) {
    (void)state;
    put(12, 4);
    assert_int_equal(take_slots(0), 1);
    assert_int_equal(w.reported[0].rect.width, 800 - 12 * 64);
    assert_int_equal(w.reported[0].rect.height, 288 - 4 * 64);
    put(11, 4);
    assert_int_equal(take_slots(0), 1);
    is_reported(0, 1, 11, 4, true, 1);
    assert_int_equal(w.reported[0].rect.width, 65);
    assert_int_equal(w.reported[0].rect.height, 288 - 4 * 64);
    put(12, 4);
    assert_int_equal(take_slots(0), 2); /* and the tile to its left */
    is_reported(0, 0, 12, 4, true, 1);
    is_reported(1, 1, 11, 4, true, 1);
    put(10, 3);
    assert_int_equal(take_slots(0), 1);
    is_reported(0, 2, 10, 3, true, 1);
    w.tile[lw_atlas_map_find(&w.map, 1, 0, 2, 0).v].version++; /* below (11, 3), which is not there */
    assert_int_equal(take_slots(0), 1);
    is_reported(0, 2, 10, 3, true, 1);
}

/* More tiles than slots: those that came first keep theirs; the others wait. */
static void test_slots_run_out(void **state) {
    (void)state;
    lw_tile_id id[SLOTS + 2];
    for (uint32_t i = 0; i < SLOTS + 2; i++) id[i] = put(2 * i, 0);
    assert_int_equal(take_slots(0), SLOTS);
    assert_int_equal(w.slots.used, SLOTS);
    assert_int_equal(take_slots(0), 0);
    withdraw(id[1]);
    assert_int_equal(take_slots(0), 2); /* the slot has another tile: first the old one goes */
    is_reported(0, 1, 2, 0, false, 0);
    is_reported(1, 1, 2 * SLOTS, 0, true, 1);
    withdraw(id[SLOTS]);
    withdraw(id[SLOTS + 1]);
    assert_int_equal(take_slots(0), 1);
    is_reported(0, 1, 2 * SLOTS, 0, false, 0);
}

/* A new tile waits until the tile whose slot it gets has faded out. */
static void test_full_slots_wait_for_a_fade(void **state) {
    (void)state;
    lw_tile_id id[SLOTS];
    for (uint32_t i = 0; i < SLOTS; i++) id[i] = put(2 * i, 0);
    assert_int_equal(take_slots(1000 * MS), SLOTS);
    assert_int_equal(take_slots(2000 * MS), SLOTS);
    withdraw(id[1]);
    put(2 * SLOTS, 0);
    assert_int_equal(take_slots(2100 * MS), 0);
    assert_int_equal(take_slots(2200 * MS), 1);
    is_reported(0, 1, 2, 0, false, 0.6f);
    assert_int_equal(take_slots(2400 * MS), 2);
    is_reported(0, 1, 2, 0, false, 0);
    is_reported(1, 1, 2 * SLOTS, 0, true, 0);
    assert_int_equal(take_slots(2500 * MS), 1);
    is_reported(0, 1, 2 * SLOTS, 0, false, 0.4f);
}

/* Changes that are left stay for the next calls, and none waits for ever. */
static void test_limits_of_a_call(void **state) {
    (void)state;
    for (uint32_t i = 0; i < SLOTS; i++) put(2 * i, 2);
    bool had[SLOTS] = {0};
    for (int call = 0; call < SLOTS; call++) {
        for (uint32_t i = 0; i < SLOTS; i++) put(2 * i, 2); /* they change faster than they are taken */
        assert_int_equal(lw_live_slots_take(&w.slots, 0, 1, w.reported, ALL), 1);
        assert_true(w.reported[0].has_texels);
        had[w.reported[0].slot] = true;
        assert_int_equal(w.slots.used, SLOTS);
        assert_int_equal(w.slots.waiting, SLOTS - 1);
    }
    for (uint32_t i = 0; i < SLOTS; i++) assert_true(had[i]);
    size_t count = 0;
    for (int call = 0; call < SLOTS; call++) count += lw_live_slots_take(&w.slots, 0, 0, w.reported, 1);
    assert_int_equal(count, SLOTS - 1); /* the last call's is up to date */
    assert_int_equal(lw_live_slots_take(&w.slots, 0, 0, w.reported, 0), 0);
    for (uint32_t i = 0; i < SLOTS; i++) withdraw(lw_atlas_map_find(&w.map, 1, LEVEL, 2 * i, 2));
    assert_int_equal(lw_live_slots_take(&w.slots, 0, 1, w.reported, 3), 3);
    assert_int_equal(lw_live_slots_take(&w.slots, 0, 1, w.reported, 3), 1);
    assert_int_equal(lw_live_slots_take(&w.slots, 0, 1, w.reported, 3), 0);
}

/* A tile that is noisier than level 0 may be is read as level 0, unless all is read as it came. */
static void test_noisy_tiles(void **state) {
    (void)state;
    const lw_tile_id id = put(5, 1);
    w.tile[id.v].error = 0.5f;
    assert_int_equal(take_slots(0), 0);
    w.tile[id.v].error = 0.01f;
    assert_int_equal(take_slots(0), 1);
    w.tile[id.v].error = 0.5f;
    assert_int_equal(take_slots(0), 1);
    is_reported(0, 0, 5, 1, false, 0);
    w.tiles.as_it_is = true;
    assert_int_equal(take_slots(0), 1);
    is_reported(0, 0, 5, 1, true, 1);
}

/* Without slots nothing is reported. */
static void test_no_slots(void **state) {
    (void)state;
    struct lw_live_slots none;
    put(0, 0);
    lw_support_ok(lw_live_slots_init(&none, &w.tiles, 0), NULL);
    assert_int_equal(lw_live_slots_take(&none, 0, 0, w.reported, ALL), 0);
    lw_live_slots_finish(&none);
    struct lw_live_slots zeroed = {0};
    lw_live_slots_finish(&zeroed);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_tiles_fade_in_and_out, start, end),
        cmocka_unit_test_setup_teardown(test_without_a_clock_tiles_come_and_go_at_once, start, end),
        cmocka_unit_test_setup_teardown(test_borders, start, end),
        cmocka_unit_test_setup_teardown(test_slots_run_out, start, end),
        cmocka_unit_test_setup_teardown(test_full_slots_wait_for_a_fade, start, end),
        cmocka_unit_test_setup_teardown(test_limits_of_a_call, start, end),
        cmocka_unit_test_setup_teardown(test_noisy_tiles, start, end),
        cmocka_unit_test_setup_teardown(test_no_slots, start, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
