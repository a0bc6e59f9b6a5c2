/* NATS in a network namespace of its own, with a cable to the daemon and one to a relay. Either is cut, and
 * mended. */
#include "tests/support/nats_case.h"
#include "tests/support/net_space.h"
#include "tests/support/relays.h"

#include <stdio.h>

enum { OF_DAEMON, OF_RELAY, CABLES };

static struct lw_net_space space;
static struct lw_nats_case nats;
static struct lw_process server, relay;

static int end_all(void **state) {
    (void)state;
    lw_relays_end();
    lw_nats_case_finish(&nats);
    lw_net_space_remove(&space);
    server = relay = (struct lw_process){.port = 0};
    return 0;
}

static const char *address_by(unsigned cable) {
    static char text[64];
    snprintf(text, sizeof text, "nats://%s:%u/room", space.cable[cable].there, nats.port);
    return text;
}

/* Client 0 is the daemon's, client 1 the relay's. */
static void start(void) {
    char arguments[400];
    if (!lw_net_space_make(&space, CABLES)) skip();
    lw_nats_case_start(&nats, &(struct lw_nats_case_desc){.host = "0.0.0.0", .space = space.name});
    snprintf(arguments, sizeof arguments, LW_RELAYS_CORNELL " --nats %s", address_by(OF_DAEMON));
    lw_process_serve(&server, arguments);
    lw_relays_start(&relay, address_by(OF_RELAY), "");
    lw_relays_join_with(0, server.port, (struct lw_client_desc){.control = true});
    lw_relays_join(1, relay.port);
    lw_relays_rest(&server);
}

static const struct lw_scene_change hide_5 = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 5},
                                    show_5 = {.kind = LW_SCENE_CHANGE_OBJECT_SHOW, .target = 5};

static uint64_t frame_due;

static void change(const struct lw_scene_change *what) {
    struct lw_client_answer answer;
    frame_due = lw_relays_update(0, what, &answer);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
}

static bool is_settled(int i) { return lw_relays_stats(i).settled_frame == lw_relays_stats(i).frame; }
static bool daemon_goes_on(void) { return lw_relays_stats(0).frame >= frame_due && is_settled(0); }

/* The relay's client has the light of the change. With the SETTLED of a frame it has all of that frame: no
 * earlier light passes for it. */
static bool light_goes_on(void) {
    const uint64_t frame = lw_relays_stats(1).frame;
    if (!is_settled(1) || !is_settled(0) || frame != lw_relays_stats(0).frame) return false;
    assert_true(lw_relays_all_same());
    return frame >= frame_due;
}

static bool relay_is_lost(void) { return lw_relays_figure(&relay, "lightwell_upstream_lost_seconds") > 0; }
static bool relay_is_back(void) { return lw_relays_figure(&relay, "lightwell_upstream_lost_seconds") == 0; }

/* Cuts a cable, and changes the scene. The daemon serves on. The relay says that its light is old, and its
 * client has what there was. */
static void cut(unsigned cable, const struct lw_scene_change *what) {
    const uint64_t frame = lw_relays_stats(1).frame;
    lw_net_space_plug(&space, cable, false);
    change(what);
    lw_relays_wait(daemon_goes_on);
    lw_relays_wait(relay_is_lost);
    assert_true(lw_relays_stats(1).frame == frame && frame < frame_due);
    assert_true(lw_client_object_hidden(lw_relays_client[1], 5) !=
                lw_client_object_hidden(lw_relays_client[0], 5));
}

static void mend(unsigned cable) {
    lw_net_space_plug(&space, cable, true);
    lw_relays_wait(light_goes_on);
    lw_relays_wait(relay_is_back);
    lw_relays_expect_same();
}

/* Until the relay has heard nothing for so long that it says so. Sessions of clients go on. */
static void a_relay_is_cut_off(void **state) {
    (void)state;
    start();
    cut(OF_RELAY, &hide_5);
    mend(OF_RELAY);
    change(&show_5);
    lw_relays_wait(light_goes_on);
}

static bool nats_is_gone(void) { return lw_relays_figure(&server, "lightwell_nats_connected") == 0; }

static void the_daemon_is_cut_off(void **state) {
    (void)state;
    start();
    cut(OF_DAEMON, &hide_5);
    lw_relays_wait(nats_is_gone);
    mend(OF_DAEMON);
    change(&show_5);
    lw_relays_wait(light_goes_on);
}

/* A short cut: messages on their way come late, or are asked for. */
static void a_short_cut_is_not_felt(void **state) {
    (void)state;
    start();
    for (unsigned cable = 0; cable < CABLES; cable++) {
        lw_net_space_plug(&space, cable, false);
        change(cable == OF_DAEMON ? &hide_5 : &show_5);
        lw_relays_wait(daemon_goes_on);
        lw_net_space_plug(&space, cable, true);
        lw_relays_wait(light_goes_on);
        lw_relays_expect_same();
    }
}

int main(void) {
    if (!lw_nats_case_is_possible()) return 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(a_relay_is_cut_off, end_all),
        cmocka_unit_test_teardown(the_daemon_is_cut_off, end_all),
        cmocka_unit_test_teardown(a_short_cut_is_not_felt, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
