/* The real lightwelld loses its connection with NATS for less than 5 s: relays do not count it as gone. The
 * relay, whose own connection stays, gets the frames of the cut later. */
#include "tests/support/nats_case.h"
#include "tests/support/relays.h"
#include "tests/support/tcp_proxy.h"

#include "common/base/clock.h"

#include <stdio.h>

#define CUTS   3
#define HEAL_S 20 /* a relay asks for all tiles every 30 s: light that comes by that comes later than this */

static struct lw_nats_case nats;
static struct lw_process server, relay;
static struct lw_tcp_proxy *proxy;
static uint64_t frame_due;

static int end_all(void **state) {
    (void)state;
    lw_relays_end();
    lw_tcp_proxy_destroy(proxy);
    lw_nats_case_finish(&nats);
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

static void frames_of_a_short_cut_come_later(void **state) {
    (void)state;
    static const struct lw_scene_change change[2] = {{.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5},
                                                     {.kind = LW_SCENE_CHANGE_OBJECT_SHOW, .target = 5}};
    struct lw_client_answer answer;
    char arguments[300];
    lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.host = NULL});
    proxy = lw_tcp_proxy_create(nats.port);
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --nats nats://127.0.0.1:%u/room",
             lw_tcp_proxy_port(proxy));
    lw_process_serve(&server, arguments);
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

int main(void) {
    if (!lw_nats_case_is_possible()) return 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(frames_of_a_short_cut_come_later, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
