#include "tests/support/client_case.h"

#include "client/lib/client.h"
#include "client/lib/link.h"
#include "client/lib/replica.h"
#include "common/base/clock.h"
#include "server/serve/server.h"

#include <pthread.h>
#include <stdlib.h>

/* What a client says that it wants. */

/* Polls until the server has news of the interest sets; expects `tiles` level-0 tiles in their union. */
static void expect_wanted(struct lw_server *server, struct lw_client *client,
                          const struct client_case_world *w, bool everything, uint32_t tiles) {
    struct lw_server_interest wanted;
    for (uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS; !lw_server_take_interest(server, &wanted);) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 5, NULL), NULL);
    }
    uint32_t count = 0;
    for (uint32_t t = 0; !wanted.everything && t < w->map.tile_count; t++) count += wanted.levels[t] > 0;
    assert_int_equal(wanted.everything, everything);
    assert_int_equal(count, tiles);
    free(wanted.levels);
}

static void test_want(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_server *server;
    struct lw_client *client;
    struct lw_error err = {0};
    struct lw_server_desc desc = {
        .host = "127.0.0.1", .atlas_map = &w.map, .package = w.package, .package_size = w.package_size};
    lw_support_ok(lw_server_create(&desc, &server, &err), &err);
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, client_case_serve, server), 0);
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = lw_server_port(server),
                                                            .wants_nothing = true},
                                   &client, &err),
                  &err);
    const lw_tile_id tile[] = {{w.map.first_tile[0] + 1}, {w.map.first_tile[0]}, {w.map.first_tile[0] + 1}},
                     none = {w.map.tile_count};
    assert_int_equal(lw_client_want(client, tile, 1), LW_USAGE); /* there is no scene yet */
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    struct lw_server_interest nothing;
    assert_false(lw_server_take_interest(server, &nothing)); /* not for a moment was everything wanted */
    assert_int_equal(lw_client_want(client, &none, 1), LW_USAGE);
    lw_support_ok(lw_client_want(client, tile, 3), NULL);
    expect_wanted(server, client, &w, false, 2);
    lw_client_want_everything(client);
    expect_wanted(server, client, &w, true, 0);
    lw_support_ok(lw_client_want(client, NULL, 0), NULL);
    expect_wanted(server, client, &w, false, 0);
    struct lw_snapshot *snapshot = client_case_make_snapshot(&w, 1);
    lw_server_publish(server, snapshot);
    lw_snapshot_unref(snapshot);
    struct lw_client_stats stats = {0};
    for (uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS; !stats.first_ns;
         lw_client_get_stats(client, &stats)) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 10, NULL), NULL);
    }
    uint32_t coarsest = 0;
    for (uint32_t o = 0; o < w.map.object_count; o++)
        coarsest += w.map.atlas[o]->level_count > 0; /* 200 x 140: the coarsest level is one tile */
    assert_int_equal(stats.tiles, coarsest);
    lw_server_stop(server);
    assert_int_equal(pthread_join(thread, NULL), 0);
    lw_client_destroy(client);
    lw_server_destroy(server);
    client_case_finish_world(&w);
}

/* Gives ids to `count` tiles of the finest level of object 0, from number `first` on. */
static void claim(const struct lw_client *client, uint32_t first, uint32_t count, lw_tile_id *out_id) {
    for (uint32_t i = 0; i < count; i++) {
        out_id[i] = lw_atlas_map_claim_tile(lw_client_atlas_map(client), 0,
                                            LW_ATLAS_FINER + LW_ATLAS_FINER_MAX, first + i);
        assert_true(out_id[i].v != UINT32_MAX);
    }
}

/* How many of some tiles have their ids. */
static uint32_t count_used(const struct lw_client *client, const lw_tile_id *id, uint32_t count) {
    uint32_t used = 0;
    for (uint32_t i = 0; i < count; i++) used += lw_atlas_map_is_used(lw_client_atlas_map(client), id[i]);
    return used;
}

/* Tiles of finer levels lose their ids, and their light, once the server has a list without them; where
 * ids are about to run out, with the next list. A tile that has lost its id may still be listed, and is left
 * out. */
static void test_ids_that_nobody_wants_go(void **state) {
    (void)state;
    enum { MANY = LW_REPLICA_FINE_MAX / 4 * 3 + 1, FEW = 10 };
    struct client_case_world w = client_case_make_world();
    struct lw_server *server;
    struct lw_client *client;
    struct lw_error err = {0};
    struct lw_atlas_map map;
    lw_support_ok(lw_atlas_map_init_finer(&map, w.scene, LW_ATLAS_FINER_MAX, MANY), NULL);
    struct lw_server_desc desc = {
        .host = "127.0.0.1", .atlas_map = &map, .package = w.package, .package_size = w.package_size};
    lw_support_ok(lw_server_create(&desc, &server, &err), &err);
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, client_case_serve, server), 0);
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = lw_server_port(server),
                                                            .finer = LW_ATLAS_FINER_MAX,
                                                            .wants_nothing = true},
                                   &client, &err),
                  &err);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    static lw_tile_id id[MANY];
    claim(client, 0, MANY - 1, id);
    lw_support_ok(lw_client_want(client, id, FEW), NULL);
    assert_int_equal(count_used(client, id, MANY - 1), MANY - 1); /* there are enough */
    struct lw_server_interest wanted = {.everything = true};
    for (uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS; !lw_server_take_interest(server, &wanted);) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 10, NULL), NULL);
    }
    free(wanted.levels);
    assert_int_equal(count_used(client, id, MANY - 1), FEW);
    assert_int_equal(count_used(client, id, FEW), FEW);
    claim(client, 0, MANY, id);
    lw_support_ok(lw_client_want(client, id + MANY - FEW, FEW), NULL);
    assert_int_equal(count_used(client, id, FEW), FEW); /* the server has them in its list */
    assert_int_equal(count_used(client, id + MANY - FEW, FEW), FEW);
    assert_int_equal(count_used(client, id, MANY), 2 * FEW);
    assert_int_equal(lw_client_want(client, id, MANY), LW_OK);
    assert_int_equal(count_used(client, id, MANY), 2 * FEW);
    lw_server_stop(server);
    assert_int_equal(pthread_join(thread, NULL), 0);
    lw_client_destroy(client);
    lw_server_destroy(server);
    lw_atlas_map_finish(&map);
    client_case_finish_world(&w);
}

static void test_longest_want_fits_the_outbox(void **state) {
    (void)state;
    static const struct lw_message_interest_tile tile[LW_CLIENT_INTEREST_MAX];
    const struct lw_message message = {
        .type = LW_MESSAGE_INTEREST,
        .interest = {.stand_ins = true, .tile = tile, .tile_count = LW_CLIENT_INTEREST_MAX}};
    assert_true(lw_message_size(&message) <= LW_LINK_OUTBOX_SIZE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_want),
        cmocka_unit_test(test_ids_that_nobody_wants_go),
        cmocka_unit_test(test_longest_want_fits_the_outbox),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
