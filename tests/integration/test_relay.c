/* The real lightwelld behind the real lightwell-relay: what clients of the relay get, and what happens when
 * parts die. */
#include "tests/support/certificate.h"
#include "tests/support/process.h"

#include "client/lib/client.h"
#include "common/clock.h"
#include "proto/message.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define CORNELL                                                                                              \
    "builtin:cornell --texels-per-metre 8 --clock step --light whole --error 0.3 --frame-rate 200 --http "   \
    "none"
#define CLIENTS 3

static struct lw_client *client[CLIENTS];
static struct lw_process server, relay[2];

static int end_all(void **state) {
    (void)state;
    for (int i = 0; i < CLIENTS; i++) {
        lw_client_destroy(client[i]);
        client[i] = NULL;
    }
    lw_process_kill_all();
    memset(relay, 0, sizeof relay);
    return 0;
}

static uint16_t read_port(const char *path) {
    size_t size;
    char *text = (char *)lw_support_read_file(path, &size);
    const int port = atoi(text);
    free(text);
    assert_true(port > 0);
    return (uint16_t)port;
}

/* On a free port, or on the one it had. */
static void start_relay(struct lw_process *process, const char *upstream, const char *options) {
    static unsigned number;
    char arguments[900], file[64];
    const unsigned port = process->port;
    snprintf(file, sizeof file, "relay%u.port", number++);
    const char *path = lw_support_temporary(file);
    snprintf(arguments, sizeof arguments, "%s --listen 127.0.0.1:%u --port-file %s --http none %s", upstream,
             port, path, options);
    lw_process_start(process, "lightwell-relay", arguments);
    if (!lw_process_await_file(process, path)) lw_process_expect(process, -1, 0);
    process->port = read_port(path);
}

static void join_with(int i, uint16_t port, struct lw_client_desc desc) {
    struct lw_error err = {0};
    desc.host = "127.0.0.1";
    desc.port = port;
    desc.name = "test_relay";
    desc.timeout_ms = LW_PROCESS_LIMIT_S * 1000;
    lw_support_ok(lw_client_create(&desc, &client[i], &err), &err);
}

static void join(int i, uint16_t port) { join_with(i, port, (struct lw_client_desc){.draws_direct = false}); }

static void poll_all(void) {
    struct lw_error err = {0};
    for (int i = 0; i < CLIENTS; i++)
        if (client[i]) lw_support_ok(lw_client_poll(client[i], 5, &err), &err);
}

static struct lw_client_stats stats_of(int i) {
    struct lw_client_stats stats;
    lw_client_get_stats(client[i], &stats);
    return stats;
}

/* The client has every tile, converged, and the server has nothing left to send. */
static bool is_at_rest(int i) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client[i]);
    const struct lw_client_stats stats = stats_of(i);
    if (!map || !stats.frame || stats.settled_frame != stats.frame) return false;
    for (uint32_t t = 0; t < map->tile_count; t++) {
        const struct lw_client_tile tile = lw_client_get_tile(client[i], (lw_tile_id){t});
        if (!tile.version || tile.error > 0.3f) return false;
    }
    return true;
}

static void wait_for(bool (*is_so)(void)) {
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    while (!is_so()) {
        poll_all();
        if (lw_clock_ns() > end_ns) fail_msg("it did not come within %u s", LW_PROCESS_LIMIT_S);
    }
}

static bool all_rest(void) {
    for (int i = 0; i < CLIENTS; i++)
        if (client[i] && !is_at_rest(i)) return false;
    return true;
}

/* Every client has every tile in the version of the first, which the daemon serves. Tiles of hidden objects
 * need not converge. */
static bool all_have_the_same(void) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client[0]);
    for (int i = 0; i < CLIENTS; i++)
        if (client[i] && (!lw_client_atlas_map(client[i]) || stats_of(i).frame != stats_of(0).frame ||
                          stats_of(i).settled_frame != stats_of(i).frame))
            return false;
    for (int i = 0; i < CLIENTS; i++)
        for (uint32_t t = 0; client[i] && t < map->tile_count; t++)
            if (!lw_client_get_tile(client[i], (lw_tile_id){t}).version ||
                lw_client_get_tile(client[i], (lw_tile_id){t}).version !=
                    lw_client_get_tile(client[0], (lw_tile_id){t}).version)
                return false;
    return true;
}

static void expect_the_same_texels(void) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client[0]);
    for (int i = 1; i < CLIENTS; i++)
        for (uint32_t o = 0; client[i] && o < map->object_count; o++)
            for (uint32_t l = 0; l < map->atlas[o].level_count; l++) {
                const struct lw_client_level ours = lw_client_get_level(client[i], o, l),
                                             theirs = lw_client_get_level(client[0], o, l);
                assert_true(ours.width == theirs.width && ours.height == theirs.height);
                assert_memory_equal(ours.rgb, theirs.rgb,
                                    3 * sizeof(float) * (size_t)ours.width * ours.height);
            }
}

static void expect_the_same(void) {
    wait_for(all_have_the_same);
    expect_the_same_texels();
    for (int i = 1; i < CLIENTS; i++)
        for (uint32_t o = 0; client[i] && o < lw_client_scene(client[0])->object_count; o++) {
            assert_memory_equal(lw_client_object_to_world(client[i], o),
                                lw_client_object_to_world(client[0], o), sizeof(struct lw_affine));
            assert_int_equal(lw_client_object_state(client[i], o), lw_client_object_state(client[0], o));
        }
}

static uint64_t update(int i, const struct lw_scene_change *change, struct lw_client_answer *out_answer) {
    struct lw_error err = {0};
    uint64_t request;
    lw_support_ok(lw_client_update(client[i], change, 1, &request, &err), &err);
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    while (!lw_client_next_answer(client[i], out_answer)) {
        poll_all();
        assert_true(lw_clock_ns() < end_ns);
    }
    assert_int_equal(out_answer->request, request);
    return out_answer->frame;
}

/* A client of a relay, and one of a relay of that, see what a client of the daemon sees, before and after
 * changes that clients of either make; and an answer comes with the frame that shows it. */
static void clients_of_relays_get_the_same(void **state) {
    (void)state;
    char upstream[64];
    struct lw_client_answer answer;
    lw_process_serve(&server, CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    start_relay(&relay[0], upstream, "");
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[0].port);
    start_relay(&relay[1], upstream, "");
    join_with(0, server.port, (struct lw_client_desc){.control = true});
    join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
    join_with(2, relay[1].port, (struct lw_client_desc){.control = true});
    expect_the_same();
    assert_true(lw_client_may_update(client[1]) && lw_client_may_update(client[2]));
    /* from each of the three, by the Unix sockets that are found by port */
    for (int i = 0; i < CLIENTS; i++) {
        const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 4 + (uint32_t)i};
        const uint64_t frame = update(i, &hide, &answer);
        assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
        assert_true(frame > 0 && stats_of(i).frame >= frame);
        assert_true(lw_client_object_hidden(client[i], 4 + (uint32_t)i));
    }
    const struct lw_scene_change wrong = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 1000};
    update(2, &wrong, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_UNKNOWN_TARGET);
    expect_the_same();
    for (uint32_t o = 4; o < 7; o++) assert_true(lw_client_object_hidden(client[2], o));
}

/* Both forms of light, at one relay. */
static void forms_of_light_come_apart(void **state) {
    (void)state;
    char upstream[64];
    lw_process_serve(&server, CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    start_relay(&relay[0], upstream, "");
    join_with(0, server.port, (struct lw_client_desc){.draws_direct = true});
    join_with(1, relay[0].port, (struct lw_client_desc){.draws_direct = true});
    expect_the_same();
    assert_non_null(lw_client_draws(client[1]));
    join_with(2, relay[0].port, (struct lw_client_desc){.draws_direct = false});
    wait_for(all_rest);
    assert_null(lw_client_draws(client[2]));
    lw_client_destroy(client[0]);
    client[0] = NULL;
    join(0, server.port);
    lw_client_destroy(client[1]);
    client[1] = NULL;
    expect_the_same();
}

static uint64_t frame_before;
static bool first_has_gone_on(void) { return stats_of(0).frame >= frame_before; }

/* Runs that a relay joins are 2^32 frames apart. */
static bool others_have_another_run(void) {
    for (int i = 1; i < CLIENTS; i++)
        if (client[i] && stats_of(i).frame >> 32 <= frame_before >> 32) return false;
    return true;
}

static bool all_went_on(void) {
    for (int i = 1; i < CLIENTS; i++)
        if (client[i] && stats_of(i).frame < stats_of(1).frame) return false;
    return true;
}

static bool all_rest_but_hidden(void) {
    for (int i = 1; i < CLIENTS; i++)
        if (client[i] &&
            (!lw_client_object_hidden(client[i], 5) || stats_of(i).settled_frame != stats_of(i).frame ||
             stats_of(i).frame != stats_of(1).frame))
            return false;
    return true;
}

static void reconnect(int i) {
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    while (lw_client_poll(client[i], 10, &err) == LW_OK) assert_true(lw_clock_ns() < end_ns);
    do {
        err = (struct lw_error){0};
        assert_true(lw_clock_ns() < end_ns);
        lw_support_pause();
    } while (lw_client_reconnect(client[i], &err) != LW_OK);
}

/* A figure of a relay, as its operator reads it. */
static double figure(const struct lw_process *process, const char *name) {
    struct lw_client *operator_ = NULL;
    struct lw_error err = {0};
    uint32_t code;
    char *text;
    const struct lw_client_desc desc = {
        .host = "127.0.0.1", .port = process->port, .operate = true, .timeout_ms = LW_PROCESS_LIMIT_S * 1000};
    lw_support_ok(lw_client_create(&desc, &operator_, &err), &err);
    lw_support_ok(lw_client_ask(operator_, LW_ASK_STATS, 0, &err), &err);
    while (!lw_client_take_report(operator_, &code, &text))
        lw_support_ok(lw_client_poll(operator_, 100, &err), &err);
    lw_client_destroy(operator_);
    char line[100];
    snprintf(line, sizeof line, "\n%s ", name);
    const char *at = strstr(text, line);
    assert_true(code == LW_REPORT_DONE && at);
    const double value = atof(at + strlen(line));
    free(text);
    return value;
}

#define TILES "lightwell_upstream_received_tiles_total"

static uint64_t tiles_due;
static bool first_has_as_many(void) { return stats_of(0).tiles >= tiles_due; }

/* The link of a relay breaks: clients keep their sessions, and get only what changed. Two addresses of one
 * daemon stand for two servers of the same run. */
static void a_link_that_breaks_costs_no_session(void **state) {
    (void)state;
    char upstream[128];
    lw_process_serve(&server, CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    start_relay(&relay[0], upstream, "");
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u,127.0.0.1:%u", relay[0].port, server.port);
    start_relay(&relay[1], upstream, "");
    join_with(0, server.port, (struct lw_client_desc){.control = true});
    join(1, relay[1].port);
    wait_for(all_rest);
    expect_the_same();
    const uint64_t tiles_0 = stats_of(0).tiles, tiles = stats_of(1).tiles;
    const double received = figure(&relay[1], TILES);
    assert_true(received > 0);
    /* the relay between dies: the other goes on from the daemon, by versions */
    assert_int_equal(lw_process_stop(&relay[0], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_process_await_text(&relay[1], "is there: light goes on");
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    struct lw_client_answer answer;
    frame_before = update(0, &hide, &answer);
    wait_for(first_has_gone_on);
    expect_the_same();
    assert_true(lw_client_object_hidden(client[1], 5));
    /* no tile twice: the tiles of the daemon's own client are all that came, to the relay and from it. This
     * client reads what the daemon sent meanwhile. */
    tiles_due = tiles_0 + (uint64_t)(figure(&relay[1], TILES) - received);
    wait_for(first_has_as_many);
    assert_true(stats_of(1).tiles - tiles <= stats_of(0).tiles - tiles_0);
}

/* A client goes from a relay to the daemon, and back to another relay, and is sent nothing that it has. */
static void a_client_goes_from_one_to_another(void **state) {
    (void)state;
    char upstream[64];
    lw_process_serve(&server, CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    start_relay(&relay[0], upstream, "");
    join(0, server.port);
    join(1, relay[0].port);
    wait_for(all_rest);
    expect_the_same();
    const uint64_t tiles = stats_of(1).tiles;
    /* another relay takes the place of the first, at its port */
    assert_int_equal(lw_process_stop(&relay[0], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    start_relay(&relay[0], upstream, "");
    reconnect(1);
    expect_the_same();
    assert_int_equal(stats_of(1).tiles, tiles);
}

/* A relay dies: its client tries the servers that the relay named, and goes on with the light it has. */
static void a_client_goes_where_it_was_told(void **state) {
    (void)state;
    char upstream[64], servers[128];
    lw_process_serve(&server, CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    start_relay(&relay[0], upstream, "");
    /* the first is none, the second lights another scene, the third is the relay */
    struct lw_process other = {.port = 0};
    lw_process_serve(&other, "builtin:cornell --texels-per-metre 4 --http none");
    snprintf(servers, sizeof servers, "--servers 127.0.0.1:1,127.0.0.1:%u,127.0.0.1:%u", other.port,
             relay[0].port);
    start_relay(&relay[1], upstream, servers);
    join(0, server.port);
    join(1, relay[1].port);
    wait_for(all_rest);
    expect_the_same();
    const uint64_t tiles = stats_of(1).tiles;
    assert_int_equal(lw_process_stop(&relay[1], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    reconnect(1);
    lw_process_await_text(&relay[0], "\"test_relay\" joined");
    assert_false(lw_client_found_other_scene(client[1]));
    expect_the_same();
    assert_int_equal(stats_of(1).tiles, tiles);
    lw_process_refuses("lightwell-relay", "127.0.0.1 --servers a:1,b", 64, "--servers", LW_PROCESS_LIMIT_S);
    lw_process_refuses("lightwelld", "builtin:cornell --servers :7780", 64, "--servers", LW_PROCESS_LIMIT_S);
}

/* The daemon is gone: light stays, for newcomers too. It comes back as another run: clients keep their
 * sessions, and what they show is its light. */
static void light_stays_while_the_daemon_is_gone(void **state) {
    (void)state;
    char upstream[64], arguments[400];
    lw_process_serve(&server, CORNELL);
    const uint16_t port = server.port;
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", port);
    start_relay(&relay[0], upstream, "");
    join(0, server.port);
    join(1, relay[0].port);
    expect_the_same();
    assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_process_await_text(&relay[0], "clients keep the light that they have");
    join(2, relay[0].port);
    struct lw_client *daemons = client[0];
    client[0] = client[1];
    client[1] = NULL;
    expect_the_same();
    client[1] = client[0];
    client[0] = NULL;
    const uint64_t tiles = stats_of(1).tiles;
    frame_before = stats_of(1).frame;
    snprintf(arguments, sizeof arguments, CORNELL " --listen 127.0.0.1:%u", port);
    lw_process_serve(&server, arguments);
    lw_process_await_text(&relay[0], "clients go on with it");
    lw_process_await_text(&relay[0], "is there: light goes on");
    wait_for(others_have_another_run);
    wait_for(all_rest);
    assert_true(stats_of(1).tiles > tiles);
    lw_client_destroy(daemons);
    join(0, server.port);
    wait_for(all_rest);
    expect_the_same_texels();
    for (int i = 1; i < CLIENTS; i++) lw_client_destroy(client[i]);
    client[2] = NULL;
    join(1, relay[0].port);
    wait_for(all_rest);
    expect_the_same_texels();
    assert_int_equal(lw_process_stop(&relay[0], SIGTERM, LW_PROCESS_LIMIT_S), 0);
}

/* Another scene at the same port: clients are asked to come back, and find it. */
static void clients_go_over_to_another_scene(void **state) {
    (void)state;
    char upstream[64], arguments[400];
    lw_process_serve(&server, CORNELL);
    const uint16_t port = server.port;
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", port);
    start_relay(&relay[0], upstream, "");
    join(1, relay[0].port);
    wait_for(all_rest);
    assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    snprintf(arguments, sizeof arguments, CORNELL " --texels-per-metre 4 --listen 127.0.0.1:%u", port);
    lw_process_serve(&server, arguments);
    lw_process_await_text(&relay[0], "another scene now: clients go over to it");
    struct lw_error err = {0};
    while (lw_client_poll(client[1], 10, &err) == LW_OK) {
    }
    while (lw_client_reconnect(client[1], &err) != LW_OK && !lw_client_found_other_scene(client[1]))
        lw_support_pause();
    assert_true(lw_client_found_other_scene(client[1]));
    lw_client_destroy(client[1]);
    client[1] = NULL;
    join(0, server.port);
    join(1, relay[0].port);
    expect_the_same();
}

static void start_behind(const char *path) {
    char arguments[400];
    server = (struct lw_process){.port = 0};
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --texels-per-metre 8 --clock step --light whole --error 0.3 --frame-rate 200 "
             "--listen-unix %s",
             path);
    lw_process_start(&server, "lightwelld", arguments);
    lw_process_await_text(&server, "serving builtin:cornell at unix:");
}

/* A daemon that listens on a Unix socket alone, behind a relay and a relay of that. It is killed, twice: no
 * client loses its session, and all get the light of the new run. One whose relay dies then goes to the other
 * relay, and is sent nothing that it has: both know the runs by one name. */
static void a_crash_of_the_solver_costs_no_session(void **state) {
    (void)state;
    char path[200], upstream[256], options[64];
    snprintf(path, sizeof path, "%s", lw_support_temporary("daemon.sock"));
    start_behind(path);
    snprintf(upstream, sizeof upstream, "unix:%s", path);
    start_relay(&relay[0], upstream, "");
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[0].port);
    snprintf(options, sizeof options, "--servers 127.0.0.1:%u", relay[0].port);
    start_relay(&relay[1], upstream, options);
    join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
    join(2, relay[1].port);
    wait_for(all_rest);
    for (int crash = 0; crash < 2; crash++) {
        frame_before = stats_of(1).frame;
        assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
        start_behind(path);
        wait_for(others_have_another_run);
        wait_for(all_rest);
    }
    /* an update, whose answer comes with the frame that shows it, by the numbers that clients have */
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    struct lw_client_answer answer;
    const uint64_t frame = update(1, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_true(frame > frame_before && stats_of(1).frame >= frame);
    assert_true(lw_client_object_hidden(client[1], 5));
    wait_for(all_went_on);
    wait_for(all_rest_but_hidden);
    const uint64_t tiles = stats_of(2).tiles;
    assert_int_equal(lw_process_stop(&relay[1], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    reconnect(2);
    lw_process_await_text(&relay[0], "\"test_relay\" joined");
    wait_for(all_rest_but_hidden);
    assert_int_equal(stats_of(2).tiles, tiles);
    struct lw_client *of_relay = client[1];
    client[1] = NULL;
    client[0] = of_relay;
    expect_the_same_texels();
    client[1] = of_relay;
    client[0] = NULL;
    lw_process_refuses("lightwelld", "builtin:cornell --listen-unix a --listen 127.0.0.1:1", 64,
                       "--listen-unix", LW_PROCESS_LIMIT_S);
    lw_process_refuses("lightwelld", "builtin:cornell --listen-unix a --control-socket b", 64,
                       "--listen-unix", LW_PROCESS_LIMIT_S);
    lw_process_refuses("lightwelld", "builtin:cornell --listen-unix /no/folder/a.sock", 69, "--listen-unix",
                       LW_PROCESS_LIMIT_S);
}

/* The server above dies with an update: who made it is sent away, since nobody knows what became of it. All
 * others stay, and a further update is refused. */
static void an_update_without_answer_ends_its_session(void **state) {
    (void)state;
    char upstream[64];
    struct lw_error err = {0};
    struct lw_client_answer answer;
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    lw_process_serve(&server, CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    start_relay(&relay[0], upstream, "");
    join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
    join_with(2, relay[0].port, (struct lw_client_desc){.control = true});
    update(1, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_int_equal(kill(server.pid, SIGSTOP), 0);
    lw_support_ok(lw_client_update(client[1], &hide, 1, NULL, &err), &err);
    while (figure(&relay[0], "lightwell_passed_updates_total") < 2)
        lw_support_ok(lw_client_poll(client[1], 5, &err), &err);
    assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    enum lw_status status;
    while ((status = lw_client_poll(client[1], 100, &err)) == LW_OK) {
    }
    lw_support_fails(status, LW_CLOSED, &err, "an update may have been made or not");
    lw_client_destroy(client[1]);
    client[1] = NULL;
    update(2, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_BUSY);
    assert_non_null(strstr(answer.text, "nothing was changed"));
}

static struct lw_access access_with(struct lw_token token, const char *certificate) {
    return (struct lw_access){
        .has_token = true, .token = token, .tls = {.wanted = true, .ca = certificate, .trusts_all = false}};
}

/* By TLS and with tokens, as one goes from another machine: an update goes up with the token of the session
 * that made it, and a token for looking alone changes nothing. */
static void updates_go_up_with_their_token(void **state) {
    (void)state;
    struct lw_token view, control, relays;
    struct lw_error err = {0};
    char text[3][LW_TOKEN_TEXT_SIZE], certificate[200], key[200], tokens[200], own[200], few[200], line[400],
        arguments[1200], upstream[64];
    lw_support_ok(lw_token_make(&view, &err), &err);
    lw_support_ok(lw_token_make(&control, &err), &err);
    lw_support_ok(lw_token_make(&relays, &err), &err);
    lw_token_format(&view, text[0]);
    lw_token_format(&control, text[1]);
    lw_token_format(&relays, text[2]);
    snprintf(certificate, sizeof certificate, "%s", lw_support_temporary("certificate.pem"));
    snprintf(key, sizeof key, "%s", lw_support_temporary("key.pem"));
    lw_certificate_make(certificate, key, "DNS:localhost,IP:127.0.0.1", 10);
    snprintf(tokens, sizeof tokens, "%s", lw_support_temporary("all.tokens"));
    snprintf(few, sizeof few, "%s", lw_support_temporary("some.tokens"));
    snprintf(own, sizeof own, "%s", lw_support_temporary("own.token"));
    /* the daemon knows no control token but one; the relay believes that view has control, too */
    snprintf(line, sizeof line, "view %s\nview %s\ncontrol %s\n", text[0], text[2], text[1]);
    lw_support_write_file(tokens, line, strlen(line));
    snprintf(line, sizeof line, "control %s\ncontrol %s\n", text[0], text[1]);
    lw_support_write_file(few, line, strlen(line));
    lw_support_write_file(own, text[2], strlen(text[2]));
    assert_true(!chmod(tokens, 0600) && !chmod(few, 0600) && !chmod(own, 0600));
    snprintf(arguments, sizeof arguments,
             CORNELL " --control-socket none --tokens %s --tls-certificate %s --tls-key %s", tokens,
             certificate, key);
    lw_process_serve(&server, arguments);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    snprintf(arguments, sizeof arguments,
             "--control-socket none --tokens %s --tls-certificate %s --tls-key %s --ca %s --token-file %s",
             few, certificate, key, certificate, own);
    start_relay(&relay[0], upstream, arguments);
    const struct lw_access with_view = access_with(view, certificate),
                           with_control = access_with(control, certificate),
                           with_own = access_with(relays, certificate);
    join_with(0, server.port, (struct lw_client_desc){.access = &with_control, .control = true});
    join_with(1, relay[0].port, (struct lw_client_desc){.access = &with_control, .control = true});
    join_with(2, relay[0].port, (struct lw_client_desc){.access = &with_view, .control = true});
    wait_for(all_rest);
    struct lw_client_answer answer;
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    update(2, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_BUSY);
    assert_non_null(strstr(answer.text, "takes no updates from here"));
    const uint64_t frame = update(1, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_true(frame > 0 && lw_client_object_hidden(client[1], 5));
    expect_the_same();
    /* the relay's own tokens decide who comes in */
    struct lw_client *refused = NULL;
    lw_support_fails(
        lw_client_create(
            &(struct lw_client_desc){.host = "127.0.0.1", .port = relay[0].port, .access = &with_own},
            &refused, &err),
        LW_NOT_ALLOWED, &err, "token");
}

/* Two relays, each of which could take the other's light. */
static void a_loop_of_relays_is_refused(void **state) {
    (void)state;
    char upstream[128];
    lw_process_serve(&server, CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    start_relay(&relay[0], upstream, "");
    const uint16_t port = relay[0].port;
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", port);
    start_relay(&relay[1], upstream, "");
    join(0, relay[1].port);
    wait_for(all_rest);
    /* the first one comes again, and may take light from the second */
    assert_int_equal(lw_process_stop(&relay[0], SIGTERM, LW_PROCESS_LIMIT_S), 0);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u,127.0.0.1:%u", server.port, relay[1].port);
    start_relay(&relay[0], upstream, "");
    lw_process_await_text(&relay[1], "is there: light goes on");
    assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_process_await_text(&relay[0], "a loop of relays");
    poll_all();
    assert_true(is_at_rest(0)); /* and light stays */
    /* a relay of itself */
    struct lw_process alone = {.port = 0};
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[1].port);
    start_relay(&alone, upstream, "");
    lw_process_refuses("lightwell-relay", "127.0.0.1:1,,x", 64, "UPSTREAM", LW_PROCESS_LIMIT_S);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(clients_of_relays_get_the_same, end_all),
        cmocka_unit_test_teardown(forms_of_light_come_apart, end_all),
        cmocka_unit_test_teardown(a_link_that_breaks_costs_no_session, end_all),
        cmocka_unit_test_teardown(a_client_goes_from_one_to_another, end_all),
        cmocka_unit_test_teardown(a_client_goes_where_it_was_told, end_all),
        cmocka_unit_test_teardown(light_stays_while_the_daemon_is_gone, end_all),
        cmocka_unit_test_teardown(clients_go_over_to_another_scene, end_all),
        cmocka_unit_test_teardown(a_crash_of_the_solver_costs_no_session, end_all),
        cmocka_unit_test_teardown(an_update_without_answer_ends_its_session, end_all),
        cmocka_unit_test_teardown(updates_go_up_with_their_token, end_all),
        cmocka_unit_test_teardown(a_loop_of_relays_is_refused, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
