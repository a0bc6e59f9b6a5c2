/* The real lightwelld, nats-server and lightwell-relay: light through NATS, light kept there, and parts
 * that die. */
#include "tests/support/nats_case.h"
#include "tests/support/relays.h"

#include "common/nats/nats_link.h"
#include "proto/nats_wire.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define RELAYS 3
#define TILES  "lightwell_upstream_received_tiles_total"

static struct lw_process server, relay[RELAYS];
static struct lw_nats_case nats;

static int end_all(void **state) {
    (void)state;
    lw_relays_end();
    lw_nats_case_finish(&nats);
    memset(relay, 0, sizeof relay);
    return 0;
}

/* limit: of JetStream's files, bytes; 0: none */
static void start_nats(bool jetstream, unsigned limit) {
    lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.no_jetstream = !jetstream, .limit = limit});
}

static const char *address(const char *scene) { return lw_nats_case_address(&nats, scene); }

static void serve(const char *options) {
    char arguments[500];
    snprintf(arguments, sizeof arguments, "%s --nats %s", options, address("room"));
    lw_process_serve(&server, arguments);
}

static void kill_it(struct lw_process *process) {
    assert_int_equal(lw_process_stop(process, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
}

static const struct lw_scene_change hide_5 = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5},
                                    show_5 = {.kind = LW_SCENE_CHANGE_OBJECT_SHOW, .target = 5};

static uint64_t frame_due;
static bool all_went_on(void) {
    for (int i = 0; i < LW_RELAYS_CLIENTS; i++)
        if (lw_relays_client[i] && lw_relays_stats(i).frame < frame_due) return false;
    return true;
}

static void change(const struct lw_scene_change *what) {
    struct lw_client_answer answer;
    frame_due = lw_relays_update(0, what, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    lw_relays_wait(all_went_on);
    lw_relays_expect_same();
}

/* Runs that a relay joins are 2^32 frames apart. */
static bool relays_have_another_run(void) {
    for (int i = 1; i < LW_RELAYS_CLIENTS; i++)
        if (lw_relays_client[i] && !(lw_relays_stats(i).frame >> 32)) return false;
    return true;
}

static bool all_relays_want(void) { return lw_relays_figure(&server, "lightwell_nats_relays") >= RELAYS; }

/* Clients of three relays see what a client of the daemon sees. Each part dies in turn: a relay, NATS, the
 * daemon. Sessions of others go on, and nobody is sent what it has. */
static void each_part_dies_in_turn(void **state) {
    (void)state;
    struct lw_client_answer answer;
    start_nats(true, 0);
    serve(LW_RELAYS_CORNELL);
    for (int i = 0; i < RELAYS; i++) lw_relays_start(&relay[i], address("room"), "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    for (int i = 0; i < RELAYS; i++)
        lw_relays_join_with(1 + i, relay[i].port, (struct lw_client_desc){.control = true});
    lw_relays_rest(&server);
    /* each relay, and another one at its port, which finds all in NATS */
    for (int i = 0; i < RELAYS; i++) {
        const uint64_t tiles = lw_relays_stats(1 + i).tiles;
        kill_it(&relay[i]);
        lw_relays_start(&relay[i], address("room"), "");
        lw_relays_reconnect(1 + i);
        lw_relays_expect_same();
        assert_int_equal(lw_relays_stats(1 + i).tiles, tiles);
    }
    change(&hide_5);
    lw_relays_update(1, &show_5, &answer); /* NATS carries none */
    assert_int_equal(answer.code, LW_SCENE_CHANGE_BUSY);
    assert_non_null(strstr(answer.text, "--updates"));
    change(&show_5);
    /* NATS: the daemon serves on, relays keep their light, and have the rest once it is back */
    lw_nats_case_kill(&nats);
    lw_process_await_text(&server, "is gone: its relays get no light");
    frame_due = lw_relays_update(0, &hide_5, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_true(lw_relays_figure(&server, "lightwell_nats_connected") == 0);
    for (int i = 1; i < LW_RELAYS_CLIENTS; i++) {
        assert_true(lw_relays_stats(i).frame < frame_due);
        assert_false(lw_client_object_hidden(lw_relays_client[i], 5));
    }
    start_nats(true, 0);
    lw_process_await_text(&server, "is there again");
    lw_relays_wait(all_went_on);
    lw_relays_expect_same();
    assert_true(lw_relays_figure(&server, "lightwell_nats_connected") == 1);
    lw_relays_wait(all_relays_want);
    /* the daemon: another run of it */
    struct lw_client *of_daemon = lw_relays_client[0];
    lw_relays_client[0] = NULL;
    kill_it(&server);
    for (int i = 0; i < RELAYS; i++)
        lw_process_await_text(&relay[i], "clients keep the light that they have");
    serve(LW_RELAYS_CORNELL);
    lw_relays_wait(relays_have_another_run);
    lw_relays_wait(lw_relays_all_rest);
    lw_client_destroy(of_daemon);
    lw_relays_join(0, server.port);
    lw_relays_expect_same();
    for (int i = 0; i < RELAYS; i++) lw_process_end(&relay[i]);
    lw_process_end(&server);
}

/* Kept light may be some seconds older than the light that clients saw. */
static bool first_has_light(void) {
    const struct lw_atlas_map *map = lw_client_atlas_map(lw_relays_client[0]);
    for (uint32_t t = 0; map && t < map->plain_count; t++)
        if (!lw_client_get_tile(lw_relays_client[0], (lw_tile_id){t}).version) return false;
    return map && lw_relays_stats(0).frame;
}

static bool first_relay_is_lost(void) {
    return lw_relays_figure(&relay[0], "lightwell_upstream_lost_seconds") > 0;
}

/* Tiles of a channel that JetStream has. */
static uint32_t count_kept(uint32_t channel) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    natsConnection *connection = NULL;
    jsCtx *jetstream = NULL;
    jsStreamInfo *info = NULL;
    jsOptions options;
    jsErrCode code = 0;
    jsOptions_Init(&options);
    lw_nats_wire_subject(subject, "room", "kept.%u.*.*.*", channel);
    options.Stream.Info.SubjectsFilter = subject;
    assert_int_equal(natsConnection_ConnectTo(&connection, address("")), NATS_OK);
    assert_int_equal(natsConnection_JetStream(&jetstream, connection, NULL), NATS_OK);
    assert_int_equal(js_GetStreamInfo(&info, jetstream, "lightwell-room", &options, &code), NATS_OK);
    const uint32_t count = info->State.Subjects ? (uint32_t)info->State.Subjects->Count : 0;
    jsStreamInfo_Destroy(info);
    jsCtx_Destroy(jetstream);
    natsConnection_Destroy(connection);
    return count;
}

/* A relay that joins when the daemon is gone has the light that is kept, and says that it is old. Relays of
 * both irradiances. */
static void what_is_kept_serves_newcomers(void **state) {
    (void)state;
    start_nats(true, 0);
    serve(LW_RELAYS_CORNELL);
    lw_relays_start(&relay[1], address("room"), "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.draws_direct = true});
    lw_relays_join_with(1, relay[1].port, (struct lw_client_desc){.draws_direct = true});
    lw_relays_expect_same();
    assert_non_null(lw_client_draws(lw_relays_client[1]));
    lw_relays_join(2, relay[1].port);
    lw_relays_wait(lw_relays_all_rest);
    assert_null(lw_client_draws(lw_relays_client[2]));
    /* until all of it is kept: as many whole tiles as there are, of each channel, and their FRAMEs */
    const struct lw_atlas_map *map = lw_client_atlas_map(lw_relays_client[0]);
    const double all = 2.0 * (map->plain_count + 1);
    while (lw_relays_figure(&server, "lightwell_nats_kept_messages_total") < all) lw_relays_poll();
    assert_int_equal(count_kept(LW_TILE_CHANNEL_DIRECTION), 0); /* the scene looks the same without them */
    assert_int_equal(count_kept(LW_TILE_CHANNEL_DIRECTION_SPLIT), 0);
    lw_client_destroy(lw_relays_client[0]);
    lw_relays_client[0] = NULL;
    kill_it(&server);
    lw_relays_start(&relay[0], address("room"), "");
    lw_relays_join(0, relay[0].port);
    lw_relays_wait(first_has_light);
    while (!first_relay_is_lost()) lw_relays_poll();
    lw_process_await_text(&relay[0], "no lightwelld publishes there now");
    assert_true(first_has_light());
}

/* ---- updates ---- */

/* Light by NATS, changes to the daemon itself. The answer comes with the frame that shows the change, by the
 * numbers that the relay's clients have, in another run of the daemon, too. */
static void updates_go_to_the_daemon(void **state) {
    (void)state;
    char options[64], again[200];
    struct lw_client_answer answer;
    start_nats(true, 0);
    serve(LW_RELAYS_CORNELL);
    snprintf(options, sizeof options, "--updates 127.0.0.1:%u", server.port);
    snprintf(again, sizeof again, LW_RELAYS_CORNELL " --listen 127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], address("room"), options);
    for (int run = 0; run < 2; run++) {
        lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = false});
        if (!run) lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
        if (run) lw_relays_wait(relays_have_another_run);
        lw_relays_rest(&server);
        uint64_t frame = 0;
        for (int tries = 0; tries < 1000; tries++) { /* after a failure it does not connect for a second */
            frame = lw_relays_update(1, &hide_5, &answer);
            if (!run || answer.code != LW_SCENE_CHANGE_BUSY) break;
            lw_relays_poll();
        }
        assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
        assert_true(lw_relays_stats(1).frame >= frame && lw_client_object_hidden(lw_relays_client[1], 5));
        lw_relays_expect_same();
        lw_client_destroy(lw_relays_client[0]);
        lw_relays_client[0] = NULL;
        if (run) continue;
        kill_it(&server);
        lw_process_await_text(&relay[0], "clients keep the light that they have");
        lw_relays_update(1, &show_5, &answer);
        assert_int_equal(answer.code, LW_SCENE_CHANGE_BUSY);
        assert_non_null(strstr(answer.text, "nothing was changed"));
        serve(again);
    }
    lw_process_refuses("lightwell-relay", "nats://127.0.0.1:4222/a --updates nats://127.0.0.1:4222/a", 64,
                       "--updates", LW_PROCESS_LIMIT_S);
}

/* Light does not wait for a server that takes connections and says nothing. */
static void light_goes_on_while_an_update_waits(void **state) {
    (void)state;
    char options[64];
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof at;
    struct lw_error err = {0};
    struct lw_client_answer answer;
    const int silent = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(silent, (struct sockaddr *)&at, size), 0);
    assert_int_equal(listen(silent, 8), 0);
    assert_int_equal(getsockname(silent, (struct sockaddr *)&at, &size), 0);
    start_nats(true, 0);
    serve(LW_RELAYS_CORNELL);
    snprintf(options, sizeof options, "--updates 127.0.0.1:%u", ntohs(at.sin_port));
    lw_relays_start(&relay[0], address("room"), options);
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
    lw_relays_rest(&server);
    lw_support_ok(lw_client_update(lw_relays_client[1], &show_5, 1, NULL, &err), &err);
    const int waits = accept(silent, NULL, NULL);
    assert_true(waits >= 0);
    change(&hide_5);
    change(&show_5);
    assert_false(lw_client_next_answer(lw_relays_client[1], &answer));
    close(waits);
    while (!lw_client_next_answer(lw_relays_client[1], &answer)) lw_relays_poll();
    assert_int_equal(answer.code, LW_SCENE_CHANGE_BUSY);
    close(silent);
}

/* ---- where light comes from ---- */

static uint32_t count_directions(int i) {
    const struct lw_atlas_map *map = lw_client_atlas_map(lw_relays_client[i]);
    uint32_t count = 0;
    for (uint32_t t = 0; map && t < map->plain_count; t++)
        count += lw_client_get_tile(lw_relays_client[i], (lw_tile_id){t}).direction_version > 0;
    return count;
}

static uint32_t directions_due;
static bool directions_are_kept(void) {
    return count_kept(LW_TILE_CHANNEL_DIRECTION_SPLIT) >= directions_due;
}
static bool third_has_settled(void) { return lw_relays_stats(2).settled_frame > 0; }
static bool first_has_directions(void) { return count_directions(0) >= directions_due; }

/* Clients get directions as from the daemon. A relay that joins without a daemon finds them in NATS. */
static void directions_come_through(void **state) {
    (void)state;
    const struct lw_client_desc desc = {.draws_direct = true, .channel_features = LW_TILE_CHANNELS_DIRECTION};
    start_nats(true, 0);
    for (int some = 0; some < 2; some++) {
        serve(some ? "builtin:atrium --freeze 0 --texels-per-metre 1.5 --clock step --light whole "
                     "--error 0.5 --http none"
                   : LW_RELAYS_CORNELL " --directional on");
        lw_relays_start(&relay[0], address("room"), "");
        lw_relays_join_with(0, server.port, desc);
        lw_relays_join_with(1, relay[0].port, desc);
        lw_relays_expect_same_directions();
        lw_relays_join(2, relay[0].port); /* all light, without directions */
        lw_relays_wait(third_has_settled);
        assert_int_equal(count_directions(2), 0);
        directions_due = count_directions(0);
        lw_relays_wait(directions_are_kept);
        for (int i = 0; i < 3; i++) {
            lw_client_destroy(lw_relays_client[i]);
            lw_relays_client[i] = NULL;
        }
        kill_it(&server);
        kill_it(&relay[0]);
        lw_relays_start(&relay[0], address("room"), "");
        lw_relays_join_with(0, relay[0].port, desc);
        lw_relays_wait(first_has_directions);
        lw_client_destroy(lw_relays_client[0]);
        lw_relays_client[0] = NULL;
        kill_it(&relay[0]);
    }
}

/* ---- interest ---- */

/* By the relay's session of the client's channel alone: the one that the relay began with is forgotten. */
static bool is_wanted(void) {
    return lw_relays_figure(&server, "lightwell_interest_tiles") >= 8 &&
           lw_relays_figure(&server, "lightwell_nats_relays") == 1;
}
static bool nobody_wants(void) { return lw_relays_figure(&server, "lightwell_interest_tiles") == 0; }

/* The solver works for what clients of relays look at, for as long as they do. */
static void interest_goes_up(void **state) {
    (void)state;
    start_nats(true, 0);
    serve("builtin:cornell --texels-per-metre 8 --error 0.0001 --prepare 0 --http none");
    lw_relays_start(&relay[0], address("room"), "");
    lw_relays_join(1, relay[0].port);
    lw_relays_wait(is_wanted);
    frame_due = lw_relays_stats(1).frame + 10;
    lw_relays_wait(all_went_on);
    /* the relay dies without a word: after a while nobody is asked for */
    lw_client_destroy(lw_relays_client[1]);
    lw_relays_client[1] = NULL;
    kill_it(&relay[0]);
    lw_relays_wait(nobody_wants);
    assert_true(lw_relays_figure(&server, "lightwell_nats_relays") == 0);
}

static void bad_starts_end_with_a_line(void **state) {
    (void)state;
    char arguments[300];
    start_nats(false, 0);
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --listen 127.0.0.1:0 --nats %s",
             address("room"));
    lw_process_refuses("lightwelld", arguments, 69, "has no JetStream: start it with", LW_PROCESS_LIMIT_S);
    lw_nats_case_kill(&nats);
    lw_process_refuses("lightwelld", arguments, 69, "is nats-server running?", LW_PROCESS_LIMIT_S);
    start_nats(true, 0);
    serve(LW_RELAYS_CORNELL);
    lw_process_refuses("lightwelld", arguments, 69, "another lightwelld publishes", LW_PROCESS_LIMIT_S);
    struct lw_process other = {.port = 0};
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --nats %s", address("another"));
    lw_process_serve(&other, arguments);
    static const char *const bad[] = {"nats://", "nats://127.0.0.1:4222/a/b", "nats://127.0.0.1:4222/a*",
                                      "http://127.0.0.1:4222/a"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        snprintf(arguments, sizeof arguments, "builtin:cornell --nats %s", bad[i]);
        lw_process_refuses("lightwelld", arguments, 64, "--nats", LW_PROCESS_LIMIT_S);
    }
    lw_process_refuses("lightwell-relay", "nats://127.0.0.1:4222/a.b", 64, "UPSTREAM", LW_PROCESS_LIMIT_S);
}

/* JetStream is full: of the packages: no start; of the light: a line, and live light goes on. */
static void a_full_jetstream_is_reported(void **state) {
    (void)state;
    char arguments[300];
    start_nats(false, 500);
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --listen 127.0.0.1:0 --nats %s",
             address("room"));
    lw_process_refuses("lightwelld", arguments, 69, "JetStream is full", LW_PROCESS_LIMIT_S);
    lw_nats_case_kill(&nats);
    lw_nats_case_finish(&nats);
    start_nats(false, 5000);
    serve(LW_RELAYS_CORNELL);
    lw_process_await_text(&server, "JetStream is full: relays that join find older light there");
    lw_relays_start(&relay[0], address("room"), "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    lw_relays_join(1, relay[0].port);
    lw_relays_expect_same();
    change(&hide_5);
}

/* ---- the tree ---- */

/* The daemon lists relays that take light from NATS, and relays below them. Nobody says that one died: after
 * a silence it is gone, and so is the relay below it. */
static void relays_report_through_nats(void **state) {
    (void)state;
    char upstream[64];
    start_nats(true, 0);
    serve(LW_RELAYS_CORNELL);
    for (int i = 0; i < 2; i++) lw_relays_start(&relay[i], address("room"), "");
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[0].port);
    lw_relays_start(&relay[2], upstream, "");
    lw_relays_join(0, relay[2].port);
    lw_relays_join(1, relay[2].port);
    lw_relays_await_in_tree(&server, 2, "127.0.0.1", relay[0].port, 0);
    lw_relays_await_in_tree(&server, 2, "127.0.0.1", relay[1].port, 0);
    lw_relays_await_in_tree(&server, 4, "127.0.0.1", relay[2].port, 2);
    for (int i = 0; i < 2; i++) {
        lw_client_destroy(lw_relays_client[i]);
        lw_relays_client[i] = NULL;
    }
    kill_it(&relay[0]);
    lw_relays_await_not_in_tree(&server, "127.0.0.1", relay[0].port);
    lw_relays_await_not_in_tree(&server, "127.0.0.1", relay[2].port);
    lw_relays_await_in_tree(&server, 2, "127.0.0.1", relay[1].port, 0);
}

/* ---- anybody ---- */

static int stranger;

static void say(const void *bytes, size_t size) {
    for (size_t at = 0; at < size;) {
        const ssize_t sent = send(stranger, (const char *)bytes + at, size - at, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR) continue;
        assert_true(sent > 0);
        at += (size_t)sent;
    }
}

static void become_stranger(void) {
    static const char hello[] = "CONNECT {\"verbose\":false,\"pedantic\":false,\"echo\":false}\r\n";
    struct sockaddr_in to = {
        .sin_family = AF_INET, .sin_port = htons(nats.port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    stranger = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(connect(stranger, (struct sockaddr *)&to, sizeof to), 0);
    say(hello, strlen(hello));
}

static void publish(const char *rest, const uint8_t *bytes, size_t size) {
    char line[300];
    const int length =
        snprintf(line, sizeof line, "PUB lightwell.room.%s stranger.answer %zu\r\n", rest, size);
    say(line, (size_t)length);
    say(bytes, size);
    say("\r\n", 2);
}

/* What nats-server has had: it answers a PING in turn. */
static void await_pong(void) {
    char text[4096];
    size_t filled = 0;
    say("PING\r\n", 6);
    for (;;) {
        const ssize_t got = recv(stranger, text + filled, sizeof text - 1 - filled, 0);
        assert_true(got > 0);
        filled += (size_t)got;
        text[filled] = '\0';
        if (strstr(text, "PONG\r\n")) return;
        if (filled > sizeof text / 2) filled = 0;
    }
}

static uint32_t chance = 1;
static uint8_t some_byte(void) {
    chance = chance * 1664525u + 1013904223u;
    return (uint8_t)(chance >> 24);
}

/* A stranger has seen the run of the scene, and says anything in its name. */
static void publish_anything(const char *rest, uint64_t run, unsigned n) {
    uint8_t bytes[600];
    const size_t size = n % 5 == 0 ? n % LW_NATS_WIRE_PREFIX_SIZE : 16 + some_byte() * 2u;
    for (size_t i = 0; i < sizeof bytes; i++) bytes[i] = some_byte();
    lw_nats_wire_write_prefix(bytes, (struct lw_nats_wire_prefix){n % 7 == 0 ? n : 0, run});
    if (n % 3 == 0) { /* a header of the protocol, at least */
        const struct lw_framing_header header = {(uint32_t)(size > 24 ? size - 24 : 0), (uint16_t)(n % 21),
                                                 0};
        lw_framing_write_header(bytes + LW_NATS_WIRE_PREFIX_SIZE, header);
    }
    publish(rest, bytes, size);
}

static uint64_t run_of_kept(void) {
    /* the run in the prefix of the welcome */
    char line[200], text[8192];
    static const char request[] = "{\"last_by_subj\":\"lightwell.room.kept.welcome\"}";
    size_t filled = 0;
    say("SUB stranger.kept 1\r\n", 21);
    const int length =
        snprintf(line, sizeof line, "PUB $JS.API.STREAM.MSG.GET.lightwell-room stranger.kept %zu\r\n",
                 strlen(request));
    say(line, (size_t)length);
    say(request, strlen(request));
    say("\r\n", 2);
    const char *data = NULL;
    while (!data || !strstr(data, "\",")) {
        const ssize_t got = recv(stranger, text + filled, sizeof text - 1 - filled, 0);
        assert_true(got > 0);
        filled += (size_t)got;
        text[filled] = '\0';
        data = strstr(text, "\"data\":\"");
        if (data) data += 8;
    }
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    uint8_t bytes[18];
    for (int i = 0; i < 6; i++) {
        uint32_t word = 0;
        for (int k = 0; k < 4; k++) word = word << 6 | (uint32_t)(strchr(letters, data[4 * i + k]) - letters);
        for (int k = 0; k < 3; k++) bytes[3 * i + k] = (uint8_t)(word >> (16 - 8 * k));
    }
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader reader;
    assert_int_equal(lw_nats_wire_read_prefix(bytes, sizeof bytes, &prefix, &reader), LW_OK);
    return prefix.run;
}

/* Bytes of anybody, to the daemon and to relays, under every subject: all go on, and after a while all see
 * the same. */
static void bytes_of_anybody_harm_nothing(void **state) {
    (void)state;
    static const char *const rest[] = {
        "want",           "sync",         "who",          "live.0.frame",
        "live.0.0.0",     "live.0.1.0",   "live.1.0.0",   "live.0.4000000000.9",
        "live.0.frame.x", "kept.0.0.0.0", "kept.0.frame", "live.2.0.0",
        "fine.0.0.65",    "fine.2.0.66",  "kept.2.0.0.0", "report"};
    start_nats(true, 0);
    serve(LW_RELAYS_CORNELL);
    lw_relays_start(&relay[0], address("room"), "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    lw_relays_join(1, relay[0].port);
    lw_relays_expect_same();
    become_stranger();
    const uint64_t run = run_of_kept();
    for (unsigned n = 0; n < 4000; n++)
        publish_anything(rest[n % (sizeof rest / sizeof *rest)], n % 4 ? run : n, n);
    await_pong();
    lw_relays_start(&relay[1], address("room"), ""); /* it reads the kept messages */
    lw_relays_join(2, relay[1].port);
    change(&hide_5);
    change(&show_5);
    assert_true(lw_relays_figure(&server, "lightwell_nats_refused_messages_total") > 0);
    /* light of another scene in the place of the welcome: no relay takes it */
    for (unsigned n = 0; n < 50; n++) publish_anything("kept.welcome", n % 4 ? run : n, n);
    await_pong();
    struct lw_process none = {.port = 0};
    lw_process_start(&none, "lightwell-relay", address("room"));
    lw_process_await_text(&none, "is no welcome");
    change(&hide_5);
    close(stranger);
}

/* ---- libnats ---- */

/* It calls this for each message, in the thread that reads; up to 3.6.0 that is when it has looked the
 * subscription up, and does not hold it. No part of its interface. */
extern void natsConn_setFilterWithClosure(natsConnection *connection,
                                          void (*filter)(natsConnection *, natsMsg **, void *), void *context)
    __attribute__((weak));

static _Atomic bool message_is_in, subscription_has_ended;

static void hold_message(natsConnection *connection, natsMsg **message, void *context) {
    (void)connection, (void)message, (void)context;
    message_is_in = true;
    LW_SUPPORT_WAIT_UNTIL(subscription_has_ended);
}

static void await_message(struct lw_nats_link *link) {
    natsMsg *message = NULL;
    while (lw_nats_link_take(link, &message) != LW_NATS_LINK_MESSAGE) {
        struct pollfd polled = {.fd = lw_nats_link_descriptor(link), .events = POLLIN};
        assert_int_equal(poll(&polled, 1, LW_PROCESS_LIMIT_S * 1000), 1);
    }
    natsMsg_Destroy(message);
}

/* A subscription ends while a message for it comes: the link reads on, and can be closed. */
static void a_subscription_ends_in_a_message(void **state) {
    (void)state;
    static const char to_ending[] = "PUB ending 0\r\n\r\n", to_other[] = "PUB other 0\r\n\r\n";
    struct lw_error err = {0};
    struct lw_nats_link *link;
    natsSubscription *ending, *other;
    if (!natsConn_setFilterWithClosure) skip();
    start_nats(false, 0);
    const struct lw_nats_link_desc desc = {
        .url = address(""), .name = "nats", .client = "test", .timeout_ms = 5000, .queue_max = 16};
    lw_support_ok(lw_nats_link_create(&desc, &link, &err), &err);
    natsConnection *connection = lw_nats_link_connection(link);
    assert_int_equal(natsConnection_SubscribeSync(&ending, connection, "ending"), NATS_OK);
    assert_int_equal(lw_nats_link_subscribe(link, "other", &other), LW_OK);
    assert_int_equal(natsConnection_Flush(connection), NATS_OK);
    natsConn_setFilterWithClosure(connection, hold_message, NULL);
    become_stranger();
    say(to_ending, strlen(to_ending));
    LW_SUPPORT_WAIT_UNTIL(message_is_in);
    lw_nats_link_unsubscribe(link, ending);
    natsConn_setFilterWithClosure(connection, NULL, NULL);
    subscription_has_ended = true;
    say(to_other, strlen(to_other));
    await_message(link);
    lw_nats_link_unsubscribe(link, other);
    lw_nats_link_destroy(link);
    close(stranger);
}

int main(void) {
    if (!lw_nats_case_is_possible()) return 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(each_part_dies_in_turn, end_all),
        cmocka_unit_test_teardown(what_is_kept_serves_newcomers, end_all),
        cmocka_unit_test_teardown(updates_go_to_the_daemon, end_all),
        cmocka_unit_test_teardown(light_goes_on_while_an_update_waits, end_all),
        cmocka_unit_test_teardown(directions_come_through, end_all),
        cmocka_unit_test_teardown(interest_goes_up, end_all),
        cmocka_unit_test_teardown(relays_report_through_nats, end_all),
        cmocka_unit_test_teardown(bad_starts_end_with_a_line, end_all),
        cmocka_unit_test_teardown(a_full_jetstream_is_reported, end_all),
        cmocka_unit_test_teardown(bytes_of_anybody_harm_nothing, end_all),
        cmocka_unit_test_teardown(a_subscription_ends_in_a_message, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
