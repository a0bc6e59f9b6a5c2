/* The real lightwelld loses its connection with NATS for less than 5 s: relays do not count it as gone. The
 * relay, whose own connection stays, gets the frames of the cut later. */
#include "tests/support/nats_case.h"
#include "tests/support/relays.h"
#include "tests/support/tcp_proxy.h"

#include "common/base/clock.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CUTS   3
#define HEAL_S 20 /* a relay asks for all tiles every 30 s: light that comes by that comes later than this */

static struct lw_nats_case nats;
static struct lw_process server, relay, other;
static struct lw_tcp_proxy *proxy;
static uint64_t frame_due;

static int end_all(void **state) {
    (void)state;
    lw_relays_end();
    lw_tcp_proxy_destroy(proxy);
    lw_nats_case_finish(&nats);
    proxy = NULL;
    server = relay = other = (struct lw_process){.port = 0};
    return 0;
}

static bool is_settled(int i) { return lw_relays_stats(i).settled_frame == lw_relays_stats(i).frame; }
static bool nats_is_gone(void) { return lw_relays_figure(&server, "lightwell_nats_connected") == 0; }

/* No later frame tells the relay that it missed one. */
static bool daemon_rests(void) {
    return lw_relays_stats(0).frame >= frame_due && is_settled(0) &&
           lw_relays_figure(&server, "lightwell_converged_tiles") ==
               lw_relays_figure(&server, "lightwell_tiles");
}

static bool light_goes_on(void) {
    return lw_relays_stats(1).frame >= frame_due && is_settled(1) &&
           lw_relays_stats(1).frame == lw_relays_stats(0).frame;
}

/* A daemon whose way to NATS can be cut. */
static void serve_through_proxy(void) {
    char arguments[300];
    lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.host = NULL});
    proxy = lw_tcp_proxy_create(nats.port);
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --nats nats://127.0.0.1:%u/room",
             lw_tcp_proxy_port(proxy));
    lw_process_serve(&server, arguments);
}

static void frames_of_a_short_cut_come_later(void **state) {
    (void)state;
    static const struct lw_scene_change change[2] = {{.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5},
                                                     {.kind = LW_SCENE_CHANGE_OBJECT_SHOW, .target = 5}};
    struct lw_client_answer answer;
    serve_through_proxy();
    lw_relays_start(&relay, lw_nats_case_address(&nats, "room"), "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    lw_relays_join(1, relay.port);
    lw_relays_rest(&server);
    for (int i = 0; i < CUTS; i++) {
        lw_tcp_proxy_cut(proxy);
        lw_relays_wait(nats_is_gone);
        frame_due = lw_relays_update(0, &change[i % 2], &answer);
        assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
        lw_relays_wait(daemon_rests);
        assert_true(lw_relays_stats(1).frame < frame_due);
        lw_tcp_proxy_open(proxy);
        const uint64_t open_ns = lw_clock_ns();
        lw_relays_wait(light_goes_on);
        lw_relays_expect_same();
        assert_true(lw_clock_ns() - open_ns < HEAL_S * 1000000000ull);
    }
}

static bool stands_down(const struct lw_process *daemon) {
    char *said = lw_process_err(daemon);
    const bool does = strstr(said, "another lightwelld publishes there: this one does no longer") != NULL;
    free(said);
    return does;
}
static bool one_stands_down(void) { return stands_down(&server) != stands_down(&other); }
static bool relay_has_light(void) { return lw_relays_stats(1).frame >= frame_due && is_settled(1); }

/* Two daemons publish under one name after a cut, which has kept them from hearing each other. Then one of
 * them stands down. Relays have the light of the one that stays. Both daemons serve their own clients on. */
static void one_of_two_daemons_stands_down(void **state) {
    (void)state;
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5};
    struct lw_client_answer answer;
    char arguments[300];
    serve_through_proxy();
    lw_tcp_proxy_cut(proxy);
    lw_process_await_text(&server, "is gone: its relays get no light");
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --nats %s",
             lw_nats_case_address(&nats, "room"));
    lw_process_serve(&other, arguments);
    lw_tcp_proxy_open(proxy);
    lw_process_await_text(&server, "is there again");
    lw_relays_wait(one_stands_down);
    const struct lw_process *leaves = stands_down(&server) ? &server : &other,
                            *stays = leaves == &server ? &other : &server;
    lw_relays_start(&relay, lw_nats_case_address(&nats, "room"), "");
    lw_relays_join(1, relay.port);
    lw_relays_join_with(0, stays->port, (struct lw_client_desc){.control = true});
    frame_due = lw_relays_update(0, &hide, &answer);
    lw_relays_wait(relay_has_light);
    lw_relays_expect_same();
    lw_relays_join_with(2, leaves->port, (struct lw_client_desc){.control = true});
    lw_relays_update(2, &hide, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
}

int main(void) {
    if (!lw_nats_case_is_possible()) return 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(frames_of_a_short_cut_come_later, end_all),
        cmocka_unit_test_teardown(one_of_two_daemons_stands_down, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
