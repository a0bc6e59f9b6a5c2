#include "tests/support/serving.h"

#include "server/serve/server.h"
#include "server/serve/sessions/session.h"

#include <stdlib.h>
#include <unistd.h>

/* Tiles of finer levels. */

/* Lists tiles of the level that is twice as fine, by their numbers: a bit for each. */
static void want_fine(int s, uint32_t tiles) {
    struct lw_message_interest_tile tile[32];
    size_t count = 0;
    for (uint32_t t = 0; t < 32; t++)
        if (tiles >> t & 1) tile[count++] = (struct lw_message_interest_tile){0, LW_ATLAS_FINER + 1, t};
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                        .interest = {.tile = tile, .tile_count = count}});
}

static void expect_fine_tile(int s, uint32_t tile, uint64_t version) {
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_TILE, &m);
    assert_int_equal(m.tile.level, LW_ATLAS_FINER + 1);
    assert_int_equal(m.tile.tile, tile);
    assert_int_equal(m.tile.version, version);
    lw_message_finish(&m);
}

/* A client that does not offer them hears of none, gets none with everything, and may ask for none. */
static void test_who_knows_no_finer_levels_gets_none(void **state) {
    (void)state;
    struct lw_message m;
    serving_finer_levels = 2;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial(f);
    serving_put(s, &serving_hello);
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, 0);
    assert_int_equal(m.welcome.finer, 0);
    serving_ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    for (uint64_t frame = 1; frame < 4; frame++) {
        serving_publish(f, serving_make_snapshot(f, frame, 0));
        serving_expect_light(f, s, frame);
        serving_expect_silence(s);
    }
    want_fine(s, 0x8);
    serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
    serving_end(f);
    serving_finer_levels = 0;
}

/* A client that offers them gets the tiles that it lists, and nothing finer with everything; the solver hears
 * of them, and of level 0. */
static void test_finer_levels_are_sent_to_who_lists_them(void **state) {
    (void)state;
    struct lw_message m;
    serving_finer_levels = 2;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                        .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_FINER}});
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, LW_FEATURE_FINER);
    assert_int_equal(m.welcome.finer, 2);
    serving_ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_light(f, s, 1);
    want_fine(s, 0x8);
    struct lw_server_interest wanted;
    LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted) && !wanted.everything);
    for (uint32_t t = 0; t < f->map.tile_count; t++) {
        const struct lw_tile_place *p = &f->map.place[t];
        /* tile 3 of the level that is twice as fine is in the second column of the first row of level 0 */
        const bool listed = p->width && p->object == 0 && p->y == 0 && p->x == (p->level ? 3 : 1);
        assert_int_equal(wanted.levels[t], listed && (p->level == 0 || p->level == LW_ATLAS_FINER + 1));
    }
    free(wanted.levels);
    serving_publish(f, serving_make_snapshot(f, 2, 1));
    serving_expect_frame(s, 2, 2);
    expect_fine_tile(s, 3, 2);
    serving_expect_silence(s);
    close(s);
    serving_end(f);
    serving_finer_levels = 0;
}

/* The next list of interest, by the numbers of the fine tiles that are in it: a bit for each. */
static uint64_t take_fine(struct serving *f, uint32_t *out_tiles) {
    struct lw_server_interest wanted;
    LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted));
    *out_tiles = 0;
    for (uint32_t t = f->map.plain_count; wanted.levels && t < f->map.tile_count; t++)
        if (wanted.levels[t]) *out_tiles |= 1u << lw_atlas_map_number(&f->map, (lw_tile_id){t});
    free(wanted.levels);
    return wanted.number;
}

/* The solver has these tiles, and heard the list of that number. */
static void publish_fine(struct serving *f, uint64_t frame, uint64_t interest, uint32_t tiles) {
    struct lw_snapshot *snapshot = serving_make_snapshot(f, frame, frame - 1);
    snapshot->interest = interest;
    assert_non_null(snapshot->holds_fine = calloc(serving_fine_room, sizeof *snapshot->holds_fine));
    for (uint32_t i = 0; i < serving_fine_room; i++) {
        const lw_tile_id id = {f->map.plain_count + i};
        snapshot->holds_fine[i] =
            lw_atlas_map_is_used(&f->map, id) && tiles >> lw_atlas_map_number(&f->map, id) & 1;
        if (snapshot->holds_fine[i]) continue;
        lw_blob_unref(snapshot->tile[serving_channel][id.v].blob);
        snapshot->tile[serving_channel][id.v] = (struct lw_snapshot_tile){0};
    }
    serving_publish(f, snapshot);
}

/* Who lists more than a session may gets ids for as many: the first ones of its list. */
static void test_a_session_has_so_many_fine_tiles(void **state) {
    (void)state;
    struct lw_message m;
    struct lw_server_interest wanted;
    struct lw_message_interest_tile tile[LW_SESSION_FINE_MAX + 1];
    serving_finer_levels = LW_ATLAS_FINER_MAX;
    serving_fine_room = 4 * LW_SESSION_FINE_MAX;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                        .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_FINER}});
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    serving_ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    for (uint32_t t = 0; t <= LW_SESSION_FINE_MAX; t++)
        tile[t] = (struct lw_message_interest_tile){0, LW_ATLAS_FINER + LW_ATLAS_FINER_MAX, t};
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                        .interest = {.tile = tile, .tile_count = LW_SESSION_FINE_MAX + 1}});
    LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted) && !wanted.everything);
    for (uint32_t t = 0; t <= LW_SESSION_FINE_MAX; t++) {
        const lw_tile_id id = lw_atlas_map_find_tile(&f->map, 0, tile[t].level, t);
        assert_int_equal(id.v != UINT32_MAX && wanted.levels[id.v], t < LW_SESSION_FINE_MAX);
    }
    free(wanted.levels);
    close(s);
    serving_end(f);
    serving_finer_levels = 0;
    serving_fine_room = 3;
}

/* An id goes to another tile once nobody lists the first, and the solver knows and holds it no more. */
static void test_ids_of_fine_tiles_go_to_others(void **state) {
    (void)state;
    struct lw_message m;
    uint32_t tiles;
    serving_finer_levels = 2;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s = serving_dial(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                        .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_FINER}});
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    serving_ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_light(f, s, 1);
    want_fine(s, 0x7); /* as many as there are ids for */
    uint64_t number = take_fine(f, &tiles);
    while (!tiles) number = take_fine(f, &tiles);
    assert_int_equal(tiles, 0x7);
    publish_fine(f, 2, number, 0x7);
    serving_expect_frame(s, 2, 2);
    for (uint32_t t = 0; t < 3; t++) expect_fine_tile(s, t, 2);
    want_fine(s, 0x8); /* none is left */
    const uint64_t next = take_fine(f, &tiles);
    assert_int_equal(next, number + 1);
    assert_int_equal(tiles, 0);
    publish_fine(f, 3, number, 0); /* the solver may still make what the list before has */
    serving_expect_frame(s, 3, 2);
    want_fine(s, 0x8);
    serving_expect_silence(
        s); /* the server has heard that before the next snapshot, of which the solver holds one */
    publish_fine(f, 4, next, 0x1);
    serving_expect_frame(s, 4, 2);
    want_fine(s, 0x18);
    take_fine(f, &tiles);
    assert_int_equal(tiles, 0x18);
    publish_fine(f, 5, next, 0x19);
    serving_expect_frame(s, 5, 2);
    expect_fine_tile(s, 3, 5);
    expect_fine_tile(s, 4, 5);
    want_fine(s, 0); /* what it does not list it may drop, and gets whole when it comes back */
    want_fine(s, 0x10);
    expect_fine_tile(s, 4, 5);
    serving_expect_silence(s);
    close(s);
    serving_end(f);
    serving_finer_levels = 0;
}

static int dial_finer(struct serving *f) {
    struct lw_message m;
    const int s = serving_dial(f);
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                        .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_FINER}});
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    serving_ask_for_package(s, m.welcome.package_compressed_size);
    lw_message_finish(&m);
    return s;
}

/* Lists the first tiles of a finer level. */
static void want_first(int s, uint32_t level, uint32_t count) {
    static struct lw_message_interest_tile tile[LW_SESSION_FINE_MAX];
    for (uint32_t t = 0; t < count; t++)
        tile[t] = (struct lw_message_interest_tile){0, LW_ATLAS_FINER + level, t};
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                        .interest = {.tile = tile, .tile_count = count}});
}

/* A relay asks for fewer tiles than its clients list: a client that lists few has all of its own among the
 * first ones, whatever others list. */
static void test_sessions_take_turns_where_a_relay_asks_for_fewer(void **state) {
    (void)state;
    enum { GREEDY = LW_SESSION_FINE_MAX, MANY = 60, FEW = 3 };
    serving_finer_levels = LW_ATLAS_FINER_MAX;
    serving_fine_room = 4 * LW_SESSION_FINE_MAX;
    struct serving *f = serving_start(&(struct lw_server_desc){.relay = 1});
    const int s[3] = {dial_finer(f), dial_finer(f), dial_finer(f)};
    want_first(s[0], 4, GREEDY);
    want_first(s[1], 3, MANY);
    want_first(s[2], 2, FEW);
    struct lw_server_interest wanted = {0};
    do {
        free(wanted.tile);
        LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted));
    } while (wanted.everything || wanted.tile_count < GREEDY + MANY + FEW);
    assert_int_equal(wanted.tile_count, GREEDY + MANY + FEW);
    uint32_t found[LW_ATLAS_FINER_MAX + 1] = {0};
    for (uint32_t i = 0; i < wanted.tile_count; i++) {
        const uint32_t finer = lw_atlas_finer(f->map.place[wanted.tile[i]].level);
        assert_true(finer >= 2);
        found[finer]++;
        if (i == 3 * FEW - 1) assert_true(found[2] == FEW && found[3] == FEW && found[4] == FEW);
        if (i == 2 * MANY + FEW - 1) assert_true(found[3] == MANY && found[4] == MANY);
    }
    free(wanted.tile);
    for (int i = 0; i < 3; i++) close(s[i]);
    serving_end(f);
    serving_finer_levels = 0;
    serving_fine_room = 3;
}

/* LW_SESSION_FINE_MAX tiles of the two finest levels: others than those with another `part`. */
static struct lw_message_interest_tile *part_of(const struct serving *f, uint32_t part) {
    static struct lw_message_interest_tile tile[LW_SESSION_FINE_MAX];
    uint32_t at = 0;
    for (uint32_t finer = LW_ATLAS_FINER_MAX; finer >= LW_ATLAS_FINER_MAX - 1; finer--)
        for (uint32_t o = 0; o < SERVING_OBJECTS; o++)
            for (uint32_t t = 0; lw_atlas_map_has_tile(&f->map, o, LW_ATLAS_FINER + finer, t); t++, at++)
                if (at / LW_SESSION_FINE_MAX == part)
                    tile[at % LW_SESSION_FINE_MAX] =
                        (struct lw_message_interest_tile){o, LW_ATLAS_FINER + finer, t};
    assert_true(at >= (part + 1) * LW_SESSION_FINE_MAX);
    return tile;
}

enum { GREEDY = 4, FEW = 20, COARSE = LW_ATLAS_FINER_MAX - 2 };

/* Lists a part, with tiles of a coarser level in place of its last ones. */
static void want_part(const struct serving *f, int s, uint32_t part, uint32_t coarse) {
    struct lw_message_interest_tile *tile = part_of(f, part);
    for (uint32_t i = 0; i < coarse; i++)
        tile[LW_SESSION_FINE_MAX - coarse + i] =
            (struct lw_message_interest_tile){0, LW_ATLAS_FINER + COARSE, i};
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                        .interest = {.tile = tile, .tile_count = LW_SESSION_FINE_MAX}});
}

static void want_few(const struct serving *f, int s) {
    (void)f;
    want_first(s, COARSE, FEW);
}

/* Ids of lists are in the order of turns, not in that of the list. */
static void want_few_at_the_end(const struct serving *f, int s) { want_part(f, s, GREEDY - 1, FEW); }

/* Four sessions list as many tiles as there are ids. One that comes after them gets ids for its first tiles,
 * and they have the first turns. */
static void leave_ids_and_turns_to(void (*want)(const struct serving *f, int s)) {
    enum { TILES_A_TURN = 4 };
    serving_finer_levels = LW_ATLAS_FINER_MAX;
    serving_fine_room = GREEDY * LW_SESSION_FINE_MAX;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    int s[GREEDY + 1];
    for (uint32_t i = 0; i <= GREEDY; i++) s[i] = dial_finer(f);
    for (uint32_t i = 0; i < GREEDY; i++) {
        want_part(f, s[i], i, 0);
        serving_expect_silence(s[i]); /* the server has read it */
    }
    want(f, s[GREEDY]);
    serving_expect_silence(s[GREEDY]);
    const lw_tile_id last = lw_atlas_map_find_tile(&f->map, 0, LW_ATLAS_FINER + COARSE, FEW - 1);
    assert_true(last.v != UINT32_MAX);
    struct lw_server_interest wanted = {0};
    do {
        free(wanted.levels);
        LW_SUPPORT_WAIT_UNTIL(lw_server_take_interest(f->server, &wanted));
    } while (wanted.everything || !wanted.levels[last.v]);
    for (uint32_t t = 0; t < FEW; t++) {
        const lw_tile_id id = lw_atlas_map_find_tile(&f->map, 0, LW_ATLAS_FINER + COARSE, t);
        assert_true(id.v != UINT32_MAX);
        assert_int_equal(wanted.levels[id.v], 1 + t / TILES_A_TURN);
    }
    uint32_t early = 0, all = 0;
    for (uint32_t k = f->map.plain_count; k < f->map.tile_count; k++) {
        early += wanted.levels[k] && wanted.levels[k] <= FEW / TILES_A_TURN;
        all += wanted.levels[k] != 0;
    }
    assert_int_equal(early, (GREEDY + 1) * FEW);
    assert_in_range(all, GREEDY * LW_SESSION_FINE_MAX / 2, GREEDY * LW_SESSION_FINE_MAX);
    free(wanted.levels);
    for (uint32_t i = 0; i <= GREEDY; i++) close(s[i]);
    serving_end(f);
    serving_finer_levels = 0;
    serving_fine_room = 3;
}

static void test_greedy_sessions_leave_ids_and_turns_to_others(void **state) {
    (void)state;
    leave_ids_and_turns_to(want_few);
}

static void test_coarser_tiles_come_first_wherever_a_list_has_them(void **state) {
    (void)state;
    leave_ids_and_turns_to(want_few_at_the_end);
}

/* Numbers of finer levels and tiles that the scene does not have. */
static void test_no_such_fine_tile(void **state) {
    (void)state;
    serving_finer_levels = 2;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    const struct lw_message_interest_tile none[] = {
        {0, LW_ATLAS_FINER, 0},                      /* level 0 has another number */
        {0, LW_ATLAS_FINER + 3, 0},                  /* there are two levels */
        {0, LW_ATLAS_FINER + LW_ATLAS_FINER_ALL, 0}, /* a server's own */
        {0, LW_ATLAS_FINER + 1, 7 * 4},              /* 400 x 200 texels: 7 x 4 tiles */
        {SERVING_OBJECTS, LW_ATLAS_FINER + 1, 0},
    };
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        const int s = dial_finer(f);
        serving_put(s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                            .interest = {.tile = &none[i], .tile_count = 1}});
        serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
        close(s);
    }
    assert_int_equal(lw_fine_ids_free_count(f->map.fine), serving_fine_room);
    serving_end(f);
    serving_finer_levels = 0;
}

/* A relay drops a tile: in a snapshot it has no version. Then its id is another tile's, whose version may be
 * smaller. */
static void test_a_dropped_tile_leaves_nothing_to_the_next(void **state) {
    (void)state;
    uint32_t tiles;
    serving_finer_levels = 2;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    const int s = dial_finer(f);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_light(f, s, 1);
    want_fine(s, 0x7);
    uint64_t number = take_fine(f, &tiles);
    while (!tiles) number = take_fine(f, &tiles);
    publish_fine(f, 9, number, 0x7);
    serving_expect_frame(s, 9, 1);
    for (uint32_t t = 0; t < 3; t++) expect_fine_tile(s, t, 9);
    want_fine(s, 0);
    number = take_fine(f, &tiles);
    publish_fine(f, 10, number, 0);
    serving_expect_frame(s, 10, 2);
    want_fine(s, 0x8);
    number = take_fine(f, &tiles);
    assert_int_equal(tiles, 0x8);
    struct lw_snapshot *snapshot = serving_make_snapshot(f, 11, 10);
    snapshot->interest = number;
    assert_non_null(snapshot->holds_fine = calloc(serving_fine_room, sizeof *snapshot->holds_fine));
    for (uint32_t i = 0; i < serving_fine_room; i++) {
        struct lw_snapshot_tile *tile = &snapshot->tile[serving_channel][f->map.plain_count + i];
        if (lw_atlas_map_is_used(&f->map, (lw_tile_id){f->map.plain_count + i})) {
            snapshot->holds_fine[i] = true;
            tile->version = 4;
            continue;
        }
        lw_blob_unref(tile->blob);
        *tile = (struct lw_snapshot_tile){0};
    }
    serving_publish(f, snapshot);
    serving_expect_frame(s, 11, 2);
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_TILE, &m);
    assert_true(m.tile.level == LW_ATLAS_FINER + 1 && m.tile.tile == 3);
    lw_message_finish(&m);
    serving_expect_silence(s);
    close(s);
    serving_end(f);
    serving_finer_levels = 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_who_knows_no_finer_levels_gets_none),
        cmocka_unit_test(test_finer_levels_are_sent_to_who_lists_them),
        cmocka_unit_test(test_ids_of_fine_tiles_go_to_others),
        cmocka_unit_test(test_a_session_has_so_many_fine_tiles),
        cmocka_unit_test(test_sessions_take_turns_where_a_relay_asks_for_fewer),
        cmocka_unit_test(test_greedy_sessions_leave_ids_and_turns_to_others),
        cmocka_unit_test(test_coarser_tiles_come_first_wherever_a_list_has_them),
        cmocka_unit_test(test_no_such_fine_tile),
        cmocka_unit_test(test_a_dropped_tile_leaves_nothing_to_the_next),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
