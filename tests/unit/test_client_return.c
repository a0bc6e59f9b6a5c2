#include "tests/support/client_case.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "server/serve/server.h"

#include <sys/socket.h>

/* Connections that break, and what a client keeps. */

/* ---- coming back ---- */

/* A frame in which tile 0 alone has changed. */
static struct lw_snapshot *make_next_snapshot(const struct client_case_world *w,
                                              const struct lw_snapshot *before) {
    struct lw_snapshot *snapshot = client_case_make_snapshot(w, before->frame + 1);
    for (uint32_t t = 1; t < w->map.tile_count; t++) {
        lw_blob_unref(snapshot->tile[LW_TILE_CHANNEL_FULL][t].blob);
        snapshot->tile[LW_TILE_CHANNEL_FULL][t] = before->tile[LW_TILE_CHANNEL_FULL][t];
        lw_blob_ref(snapshot->tile[LW_TILE_CHANNEL_FULL][t].blob);
    }
    return snapshot;
}

static void test_reconnect(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_client *client;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    struct client_case_running r = client_case_start_server(&w, 0);
    const uint16_t port = lw_server_port(r.server);
    struct lw_snapshot *seventh = client_case_make_snapshot(&w, 7);
    lw_snapshot_ref(seventh);
    client_case_publish(&r, seventh);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port}, &client, &err), &err);
    client_case_poll_until_tiles(client, w.map.tile_count);
    const struct lw_scene *scene = lw_client_scene(client);

    /* the link breaks: no tile that the client has is sent again */
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    client_case_lose_connection(client);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    client_case_publish(&r, make_next_snapshot(&w, seventh));
    lw_snapshot_unref(seventh);
    client_case_poll_until_tiles(client, w.map.tile_count + 1);
    lw_support_ok(lw_client_poll(client, 100, &err), &err);
    lw_client_get_stats(client, &stats);
    assert_int_equal(stats.tiles, w.map.tile_count + 1);
    client_case_expect_tile(client, &w, 0, 8);
    client_case_expect_tile(client, &w, 1, 7);

    /* the server starts again: its light replaces the old, however small its numbers are */
    client_case_stop_server(&r);
    client_case_lose_connection(client);
    lw_support_fails(lw_client_reconnect(client, &err), LW_UNAVAILABLE, &err, "is lightwelld running?");
    err = (struct lw_error){0};
    r = client_case_start_server(&w, port);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    client_case_expect_tile(client, &w, 1, 7);            /* until then it stays */
    lw_support_ok(lw_client_poll(client, 0, &err), &err); /* there is no frame to say anything of */
    client_case_publish(&r, client_case_make_snapshot(&w, 2));
    client_case_poll_until_tiles(client, 2 * w.map.tile_count + 1);
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        client_case_expect_texels(client, &w, t, 2);
        assert_int_equal(lw_client_get_tile(client, (lw_tile_id){t}).version, 8 + 2);
    }
    lw_client_get_stats(client, &stats);
    assert_int_equal(stats.frame, 2);
    assert_ptr_equal(lw_client_scene(client), scene);

    /* and a third time, within that run */
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    client_case_lose_connection(client);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    client_case_publish(&r, client_case_make_snapshot(&w, 3));
    client_case_poll_until_tiles(client, 3 * w.map.tile_count + 1);
    client_case_expect_texels(client, &w, 0, 3);

    /* another scene needs another client */
    client_case_stop_server(&r);
    client_case_lose_connection(client);
    w.package[w.package_size - 1] ^= 1;
    r = client_case_start_server(&w, port);
    lw_support_fails(lw_client_reconnect(client, &err), LW_BAD_DATA, &err, "another scene");
    client_case_expect_texels(client, &w, 0, 3);
    lw_client_destroy(client);
    client_case_stop_server(&r);
    client_case_finish_world(&w);
}

/* Every other tile is as it was in frame 1. */
static struct lw_snapshot *change_half(const struct client_case_world *w, const struct lw_snapshot *first,
                                       uint64_t frame) {
    struct lw_snapshot *snapshot = client_case_make_snapshot(w, frame);
    for (uint32_t t = 1; t < w->map.tile_count; t += 2) {
        lw_blob_unref(snapshot->tile[LW_TILE_CHANNEL_FULL][t].blob);
        snapshot->tile[LW_TILE_CHANNEL_FULL][t] = (struct lw_snapshot_tile){
            .version = 1, .blob = lw_blob_ref(first->tile[LW_TILE_CHANNEL_FULL][t].blob)};
    }
    return snapshot;
}

/* A client that reads nothing for longer than the server waits is closed; it comes back and gets the tiles
 * that have changed, not what it has. */
static void test_who_stopped_reading_comes_back(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_server_stats served;
    struct lw_client_stats before, after;
    struct lw_client *client;
    struct lw_error err = {0};
    struct client_case_running r = client_case_start_server_with(
        &w, (struct lw_server_desc){.bounces = 3, .target_error = 0.25f, .stall_timeout_ms = 300});
    struct lw_server *server = r.server;
    struct lw_snapshot *first = client_case_make_snapshot(&w, 1);
    lw_server_publish(server, first);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = lw_server_port(server)},
                         &client, &err),
        &err);
    const int little = 1;
    assert_int_equal(setsockopt(lw_client_descriptor(client), SOL_SOCKET, SO_RCVBUF, &little, sizeof little),
                     0);
    client_case_poll_until_tiles(client, w.map.tile_count);
    uint64_t frame = 1;
    const uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS;
    do { /* nobody polls */
        struct lw_snapshot *snapshot = change_half(&w, first, ++frame);
        lw_server_publish(server, snapshot);
        lw_snapshot_unref(snapshot);
        lw_support_pause();
        lw_server_get_stats(server, &served);
    } while (served.sessions_now);
    while (lw_client_poll(client, 100, &err) == LW_OK) assert_true(lw_clock_ns() < end_ns);
    lw_client_get_stats(client, &before);
    err = (struct lw_error){0};
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    do {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &after);
    } while (after.settled_frame < frame);
    assert_int_equal(after.tiles - before.tiles, (w.map.tile_count + 1) / 2);
    for (uint32_t t = 0; t < w.map.tile_count; t++) client_case_expect_tile(client, &w, t, t % 2 ? 1 : frame);
    lw_client_destroy(client);
    lw_snapshot_unref(first);
    client_case_stop_server(&r);
    client_case_finish_world(&w);
}

/* ---- against a peer that reads from a script ---- */

/* A welcome of a new run that fails half-way does not make the next one a session of the same run. */
static void test_a_welcome_that_fails(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {.closes = true};
    struct lw_client *client;
    struct lw_error err = {0};
    struct lw_message welcome = client_case_welcome_of(&w);
    welcome.welcome.run = 77;
    client_case_say(&s, &welcome);
    client_case_say_package(&s, &w);
    client_case_say_all_light(&s, &w, 5);
    client_case_begin(&s);
    const uint16_t port = s.port;
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port}, &client, &err), &err);
    client_case_lose_connection(client);
    client_case_end(&s);
    client_case_expect_tile(client, &w, 0, 5);
    s = (struct client_case_script){.port = port, .closes = true};
    welcome.welcome.run = 78;
    welcome.welcome.features = LW_FEATURE_DRAWS; /* was not offered */
    client_case_say(&s, &welcome);
    client_case_begin(&s);
    lw_support_fails(lw_client_reconnect(client, &err), LW_PROTOCOL, &err, "not offered");
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    client_case_end(&s);
    err = (struct lw_error){0};
    s = (struct client_case_script){.port = port};
    welcome.welcome.features = 0;
    client_case_say(&s, &welcome);
    client_case_say_all_light(&s, &w, 1);
    client_case_begin(&s);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    client_case_poll_until_tiles(client, 2 * w.map.tile_count);
    for (uint32_t t = 0; t < w.map.tile_count; t++) client_case_expect_texels(client, &w, t, 1);
    lw_client_destroy(client);
    client_case_end(&s);
    client_case_finish_world(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_reconnect),
        cmocka_unit_test(test_who_stopped_reading_comes_back),
        cmocka_unit_test(test_a_welcome_that_fails),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
