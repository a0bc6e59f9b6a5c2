/* The real lightwelld behind the real lightwell-relay: what clients of the relay get, and what happens when
 * parts die. */
#include "tests/support/certificate.h"
#include "tests/support/relays.h"

#include "common/base/clock.h"
#include "proto/message.h"

#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

static struct lw_process server, relay[2];

static int end_all(void **state) {
    (void)state;
    lw_relays_end();
    memset(relay, 0, sizeof relay);
    return 0;
}

/* A client of a relay, and one of a relay of that, see what a client of the daemon sees, before and after
 * changes that clients of either make; and an answer comes with the frame that shows it. */
static void clients_of_relays_get_the_same(void **state) {
    (void)state;
    char upstream[64];
    struct lw_client_answer answer;
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], upstream, "");
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[0].port);
    lw_relays_start(&relay[1], upstream, "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
    lw_relays_join_with(2, relay[1].port, (struct lw_client_desc){.control = true});
    lw_relays_expect_same();
    assert_true(lw_client_may_update(lw_relays_client[1]) && lw_client_may_update(lw_relays_client[2]));
    /* from each of the three, by the Unix sockets that are found by port */
    for (int i = 0; i < 3; i++) {
        const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 4 + (uint32_t)i};
        const uint64_t frame = lw_relays_update(i, &hide, &answer);
        assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
        assert_true(frame > 0 && lw_relays_stats(i).frame >= frame);
        assert_true(lw_client_object_hidden(lw_relays_client[i], 4 + (uint32_t)i));
    }
    const struct lw_scene_change wrong = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 1000};
    lw_relays_update(2, &wrong, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_UNKNOWN_TARGET);
    lw_relays_expect_same();
    for (uint32_t o = 4; o < 7; o++) assert_true(lw_client_object_hidden(lw_relays_client[2], o));
}

/* Both channels of irradiance, at one relay. */
static void channels_come_apart(void **state) {
    (void)state;
    char upstream[64];
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], upstream, "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.draws_direct = true});
    lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.draws_direct = true});
    lw_relays_expect_same();
    assert_non_null(lw_client_draws(lw_relays_client[1]));
    lw_relays_join_with(2, relay[0].port, (struct lw_client_desc){.draws_direct = false});
    lw_relays_wait(lw_relays_all_rest);
    assert_null(lw_client_draws(lw_relays_client[2]));
    lw_client_destroy(lw_relays_client[0]);
    lw_relays_client[0] = NULL;
    lw_relays_join(0, server.port);
    lw_client_destroy(lw_relays_client[1]);
    lw_relays_client[1] = NULL;
    lw_relays_expect_same();
}

/* Directions of light come through two relays as the daemon sends them; some objects have none. */
static void directions_come_through(void **state) {
    (void)state;
    const struct lw_client_desc desc = {.draws_direct = true, .channel_features = LW_TILE_CHANNELS_DIRECTION};
    char upstream[64];
    for (int some = 0; some < 2; some++) {
        lw_process_serve(&server, some ? "builtin:atrium --freeze 0 --texels-per-metre 1.5 --clock step "
                                         "--light whole --error 0.5 --http none"
                                       : LW_RELAYS_CORNELL " --directional on");
        for (int i = 0; i < 2; i++) {
            snprintf(upstream, sizeof upstream, "127.0.0.1:%u", i ? relay[0].port : server.port);
            lw_relays_start(&relay[i], upstream, "");
        }
        lw_relays_join_with(0, server.port, desc);
        lw_relays_join_with(1, relay[1].port, desc);
        lw_relays_expect_same_directions();
        lw_relays_end();
    }
}

static uint64_t frame_before;
static bool first_has_gone_on(void) { return lw_relays_stats(0).frame >= frame_before; }

/* Runs that a relay joins are 2^32 frames apart. */
static bool others_have_another_run(void) {
    for (int i = 1; i < LW_RELAYS_CLIENTS; i++)
        if (lw_relays_client[i] && lw_relays_stats(i).frame >> 32 <= frame_before >> 32) return false;
    return true;
}

#define TILES "lightwell_upstream_received_tiles_total"

static uint64_t tiles_due;
static bool first_has_as_many(void) { return lw_relays_stats(0).tiles >= tiles_due; }

/* The link of a relay breaks: clients keep their sessions, and get only what changed. Two addresses of one
 * daemon stand for two servers of the same run. */
static void a_link_that_breaks_costs_no_session(void **state) {
    (void)state;
    char upstream[128];
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], upstream, "");
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u,127.0.0.1:%u", relay[0].port, server.port);
    lw_relays_start(&relay[1], upstream, "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    lw_relays_join(1, relay[1].port);
    lw_relays_rest(&server);
    const uint64_t tiles_0 = lw_relays_stats(0).tiles, tiles = lw_relays_stats(1).tiles;
    const double received = lw_relays_figure(&relay[1], TILES);
    assert_true(received > 0);
    /* the relay between dies: the other goes on from the daemon, by versions */
    assert_int_equal(lw_process_stop(&relay[0], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_process_await_text(&relay[1], "is there: light goes on");
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    struct lw_client_answer answer;
    frame_before = lw_relays_update(0, &hide, &answer);
    lw_relays_wait(first_has_gone_on);
    lw_relays_expect_same();
    assert_true(lw_client_object_hidden(lw_relays_client[1], 5));
    /* no tile twice: the tiles of the daemon's own client are all that came, to the relay and from it. This
     * client reads what the daemon sent meanwhile. */
    tiles_due = tiles_0 + (uint64_t)(lw_relays_figure(&relay[1], TILES) - received);
    lw_relays_wait(first_has_as_many);
    assert_true(lw_relays_stats(1).tiles - tiles <= lw_relays_stats(0).tiles - tiles_0);
}

/* A client goes from a relay to the daemon, and back to another relay, and is sent nothing that it has. */
static void a_client_goes_from_one_to_another(void **state) {
    (void)state;
    char upstream[64];
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], upstream, "");
    lw_relays_join(0, server.port);
    lw_relays_join(1, relay[0].port);
    lw_relays_rest(&server);
    const uint64_t tiles = lw_relays_stats(1).tiles;
    /* another relay takes the place of the first, at its port */
    assert_int_equal(lw_process_stop(&relay[0], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_relays_start(&relay[0], upstream, "");
    lw_relays_reconnect(1);
    lw_relays_expect_same();
    assert_int_equal(lw_relays_stats(1).tiles, tiles);
}

/* A relay dies: its client tries the servers that the relay named, and goes on with the light it has. */
static void a_client_goes_where_the_server_sends_it(void **state) {
    (void)state;
    char upstream[64], servers[128];
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], upstream, "");
    /* the first is none, the second lights another scene, the third is the relay */
    struct lw_process other = {.port = 0};
    lw_process_serve(&other, "builtin:cornell --texels-per-metre 4 --http none");
    snprintf(servers, sizeof servers, "--servers 127.0.0.1:1,127.0.0.1:%u,127.0.0.1:%u", other.port,
             relay[0].port);
    lw_relays_start(&relay[1], upstream, servers);
    lw_relays_join(0, server.port);
    lw_relays_join(1, relay[1].port);
    lw_relays_rest(&server);
    const uint64_t tiles = lw_relays_stats(1).tiles;
    assert_int_equal(lw_process_stop(&relay[1], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_relays_reconnect(1);
    lw_process_await_text(&relay[0], "\"test\" joined");
    assert_false(lw_client_found_other_scene(lw_relays_client[1]));
    lw_relays_expect_same();
    assert_int_equal(lw_relays_stats(1).tiles, tiles);
    lw_process_refuses("lightwell-relay", "127.0.0.1 --servers a:1,b", 64, "--servers", LW_PROCESS_LIMIT_S);
    lw_process_refuses("lightwelld", "builtin:cornell --servers :7780", 64, "--servers", LW_PROCESS_LIMIT_S);
    /* servers for pages become a part of a header */
    static const char *const no_web_servers[] = {"ws://",           "ws://:1/ws",     "wss://a:0/ws",
                                                 "ws://a:65536/ws", "ws://a:+1/ws",   "ws://[::1]:1/ws",
                                                 "ws://a/ws?x",     "wss://a/ws;img", "wss://a:1x"};
    for (size_t i = 0; i < sizeof no_web_servers / sizeof *no_web_servers; i++) {
        char line[100];
        snprintf(line, sizeof line, "builtin:cornell --servers b:1,%s", no_web_servers[i]);
        lw_process_refuses("lightwelld", line, 64, "is not ws://HOST:PORT/PATH", LW_PROCESS_LIMIT_S);
    }
}

/* The daemon is gone: light stays, for newcomers too. It comes back as another run: clients keep their
 * sessions, and what they show is its light. */
static void light_stays_while_the_daemon_is_gone(void **state) {
    (void)state;
    char upstream[64], arguments[400];
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    const uint16_t port = server.port;
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", port);
    lw_relays_start(&relay[0], upstream, "");
    lw_relays_join(0, server.port);
    lw_relays_join(1, relay[0].port);
    lw_relays_expect_same();
    assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_process_await_text(&relay[0], "clients keep the light that they have");
    lw_relays_join(2, relay[0].port);
    struct lw_client *daemons = lw_relays_client[0];
    lw_relays_client[0] = lw_relays_client[1];
    lw_relays_client[1] = NULL;
    lw_relays_expect_same();
    lw_relays_client[1] = lw_relays_client[0];
    lw_relays_client[0] = NULL;
    const uint64_t tiles = lw_relays_stats(1).tiles;
    frame_before = lw_relays_stats(1).frame;
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --listen 127.0.0.1:%u", port);
    lw_process_serve(&server, arguments);
    lw_process_await_text(&relay[0], "Changes that they made before are gone, unless");
    lw_process_await_text(&relay[0], "is there: light goes on");
    lw_relays_wait(others_have_another_run);
    lw_relays_wait(lw_relays_all_rest);
    assert_true(lw_relays_stats(1).tiles > tiles);
    lw_client_destroy(daemons);
    lw_relays_join(0, server.port);
    lw_relays_expect_same();
    for (int i = 1; i < LW_RELAYS_CLIENTS; i++) lw_client_destroy(lw_relays_client[i]);
    lw_relays_client[2] = NULL;
    lw_relays_join(1, relay[0].port);
    lw_relays_expect_same();
    lw_process_end(&relay[0]);
}

/* Another scene at the same port: clients are asked to come back, and find it. */
static void clients_go_over_to_another_scene(void **state) {
    (void)state;
    char upstream[64], arguments[400];
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    const uint16_t port = server.port;
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", port);
    lw_relays_start(&relay[0], upstream, "");
    lw_relays_join(1, relay[0].port);
    lw_relays_wait(lw_relays_all_rest);
    assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --texels-per-metre 4 --listen 127.0.0.1:%u",
             port);
    lw_process_serve(&server, arguments);
    lw_process_await_text(&relay[0], "another scene now: clients go over to it");
    lw_relays_await_other_scene(1);
    lw_relays_join(0, server.port);
    lw_relays_join(1, relay[0].port);
    lw_relays_expect_same();
}

static void start_behind(const char *path) {
    char arguments[400];
    static char host[256];
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --texels-per-metre 8 --clock step --light whole --error 0.3 --frame-rate 200 "
             "--listen-unix %s",
             path);
    lw_process_start(&server, "lightwelld", arguments);
    lw_process_await_text(&server, "serving builtin:cornell at unix:");
    snprintf(host, sizeof host, "unix:%s", path);
    server.host = host;
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
    lw_relays_start(&relay[0], upstream, "");
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[0].port);
    snprintf(options, sizeof options, "--servers 127.0.0.1:%u", relay[0].port);
    lw_relays_start(&relay[1], upstream, options);
    lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
    lw_relays_join(2, relay[1].port);
    lw_relays_wait(lw_relays_all_rest);
    for (int crash = 0; crash < 2; crash++) {
        frame_before = lw_relays_stats(1).frame;
        assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
        start_behind(path);
        lw_relays_wait(others_have_another_run);
        lw_relays_wait(lw_relays_all_rest);
    }
    lw_relays_join_with(0, 0, (struct lw_client_desc){.host = server.host});
    lw_relays_rest(&server);
    lw_client_destroy(lw_relays_client[0]);
    lw_relays_client[0] = NULL;
    const uint64_t tiles = lw_relays_stats(2).tiles;
    assert_int_equal(lw_process_stop(&relay[1], SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_relays_reconnect(2);
    lw_process_await_text(&relay[0], "\"test\" joined");
    lw_relays_wait(lw_relays_all_rest);
    assert_int_equal(lw_relays_stats(2).tiles, tiles);
    /* an update, whose answer comes with the frame that shows it, by the numbers that clients have */
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    struct lw_client_answer answer;
    lw_relays_client[0] = lw_relays_client[1];
    lw_relays_client[1] = NULL;
    const uint64_t frame = lw_relays_update(0, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_true(frame > frame_before && lw_relays_stats(0).frame >= frame);
    assert_true(lw_client_object_hidden(lw_relays_client[0], 5));
    lw_relays_expect_same();
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
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], upstream, "");
    lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.control = true});
    lw_relays_join_with(2, relay[0].port, (struct lw_client_desc){.control = true});
    lw_relays_update(1, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_int_equal(kill(server.pid, SIGSTOP), 0);
    lw_support_ok(lw_client_update(lw_relays_client[1], &hide, 1, NULL, &err), &err);
    while (lw_relays_figure(&relay[0], "lightwell_passed_updates_total") < 2)
        lw_support_ok(lw_client_poll(lw_relays_client[1], 5, &err), &err);
    assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    enum lw_status status;
    while ((status = lw_client_poll(lw_relays_client[1], 100, &err)) == LW_OK) {
    }
    lw_support_fails(status, LW_CLOSED, &err, "an update may have been made or not");
    lw_client_destroy(lw_relays_client[1]);
    lw_relays_client[1] = NULL;
    lw_relays_update(2, &hide, &answer);
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
             LW_RELAYS_CORNELL " --control-socket none --tokens %s --tls-certificate %s --tls-key %s", tokens,
             certificate, key);
    lw_process_serve(&server, arguments);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    snprintf(arguments, sizeof arguments,
             "--control-socket none --tokens %s --tls-certificate %s --tls-key %s --ca %s --token-file %s",
             few, certificate, key, certificate, own);
    lw_relays_start(&relay[0], upstream, arguments);
    const struct lw_access with_view = access_with(view, certificate),
                           with_control = access_with(control, certificate),
                           with_own = access_with(relays, certificate);
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.access = &with_control, .control = true});
    lw_relays_join_with(1, relay[0].port, (struct lw_client_desc){.access = &with_control, .control = true});
    lw_relays_join_with(2, relay[0].port, (struct lw_client_desc){.access = &with_view, .control = true});
    lw_relays_wait(lw_relays_all_rest);
    struct lw_client_answer answer;
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    lw_relays_update(2, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_BUSY);
    assert_non_null(strstr(answer.text, "takes no updates from here"));
    const uint64_t frame = lw_relays_update(1, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_true(frame > 0 && lw_client_object_hidden(lw_relays_client[1], 5));
    lw_relays_expect_same();
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
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], upstream, "");
    const uint16_t port = relay[0].port;
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", port);
    lw_relays_start(&relay[1], upstream, "");
    lw_relays_join(0, relay[1].port);
    lw_relays_wait(lw_relays_all_rest);
    /* the first one comes again, and may take light from the second */
    lw_process_end(&relay[0]);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u,127.0.0.1:%u", server.port, relay[1].port);
    lw_relays_start(&relay[0], upstream, "");
    lw_process_await_text(&relay[1], "is there: light goes on");
    assert_int_equal(lw_process_stop(&server, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
    lw_process_await_text(&relay[0], "a loop of relays");
    lw_relays_poll();
    assert_true(lw_relays_is_at_rest(0)); /* and light stays */
    /* a relay of itself */
    struct lw_process alone = {.port = 0};
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[1].port);
    lw_relays_start(&alone, upstream, "");
    lw_process_refuses("lightwell-relay", "127.0.0.1:1,,x", 64, "UPSTREAM", LW_PROCESS_LIMIT_S);
}

/* Who feeds whom, as lightwellctl shows it at the daemon, and at a relay. A relay that listens everywhere has
 * its machine's name. A relay that ended is not shown. */
static void the_tree_is_shown(void **state) {
    (void)state;
    char upstream[64], host[HOST_NAME_MAX + 1], *text;
    assert_int_equal(gethostname(host, sizeof host), 0);
    lw_process_serve(&server, LW_RELAYS_CORNELL);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", server.port);
    lw_relays_start(&relay[0], upstream, "");
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u", relay[0].port);
    lw_relays_start(&relay[1], upstream, "--listen 0.0.0.0:0 --insecure");
    lw_relays_join(0, relay[1].port);
    lw_relays_join(1, relay[1].port);
    lw_relays_wait(lw_relays_all_rest);
    lw_relays_await_in_tree(&server, 4, host, relay[1].port, 2);
    lw_relays_await_in_tree(&server, 2, "127.0.0.1", relay[0].port, 0);
    lw_relays_await_in_tree(&relay[0], 4, host, relay[1].port, 2);
    text = lw_relays_show_tree(&relay[0]);
    snprintf(upstream, sizeof upstream, "127.0.0.1:%u\n  127.0.0.1:%u ", server.port, relay[0].port);
    assert_true(strncmp(text, upstream, strlen(upstream)) == 0); /* the server above, and itself */
    free(text);
    for (int i = 0; i < 2; i++) {
        lw_client_destroy(lw_relays_client[i]);
        lw_relays_client[i] = NULL;
    }
    lw_process_end(&relay[1]);
    lw_relays_await_not_in_tree(&server, host, relay[1].port);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(clients_of_relays_get_the_same, end_all),
        cmocka_unit_test_teardown(channels_come_apart, end_all),
        cmocka_unit_test_teardown(directions_come_through, end_all),
        cmocka_unit_test_teardown(a_link_that_breaks_costs_no_session, end_all),
        cmocka_unit_test_teardown(a_client_goes_from_one_to_another, end_all),
        cmocka_unit_test_teardown(a_client_goes_where_the_server_sends_it, end_all),
        cmocka_unit_test_teardown(light_stays_while_the_daemon_is_gone, end_all),
        cmocka_unit_test_teardown(clients_go_over_to_another_scene, end_all),
        cmocka_unit_test_teardown(a_crash_of_the_solver_costs_no_session, end_all),
        cmocka_unit_test_teardown(an_update_without_answer_ends_its_session, end_all),
        cmocka_unit_test_teardown(updates_go_up_with_their_token, end_all),
        cmocka_unit_test_teardown(a_loop_of_relays_is_refused, end_all),
        cmocka_unit_test_teardown(the_tree_is_shown, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
