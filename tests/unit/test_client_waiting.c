#include "tests/support/client_case.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "server/serve/server.h"

/* Why there is no light yet. */

static void poll_until_waiting(struct lw_client *client, enum lw_waiting_stage stage, float share) {
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS;
    for (struct lw_waiting_state now;
         now = lw_client_waiting(client), now.stage != stage || now.share != share;) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
    }
}

/* Why there is no light yet, from the server's own account to its first frame, and again in a new session. */
static void test_waiting(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_waiting waiting = {0};
    struct client_case_running r =
        client_case_start_server_with(&w, (struct lw_server_desc){.first_light = &waiting});
    const struct lw_client_desc desc = {.host = "127.0.0.1", .port = lw_server_port(r.server)};
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    assert_int_equal(lw_client_waiting(client).stage, LW_WAITING_UNKNOWN);
    lw_waiting_raise(&waiting, LW_WAITING_PLACING_TEXELS, 1, 10);
    poll_until_waiting(client, LW_WAITING_PLACING_TEXELS, 0.1f);
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 42, 100);
    poll_until_waiting(client, LW_WAITING_LOOKING_INSIDE, 0.42f);
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 17, 100);
    poll_until_waiting(client, LW_WAITING_FIRST_LIGHT, 0.17f);
    assert_true(lw_client_scene(client) != NULL); /* which has come meanwhile */
    struct lw_snapshot *snapshot = client_case_make_snapshot(&w, 1);
    lw_server_publish(r.server, snapshot);
    lw_snapshot_unref(snapshot);
    poll_until_waiting(client, LW_WAITING_READY, 1);
    client_case_poll_until_tiles(client, w.map.tile_count);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    assert_int_equal(lw_client_waiting(client).stage, LW_WAITING_UNKNOWN); /* nothing in this session */
    poll_until_waiting(client, LW_WAITING_READY, 1);                       /* by its first frame */
    lw_client_destroy(client);
    client_case_stop_server(&r);
    client_case_finish_world(&w);
}

/* Stages of a newer server, and messages that come too early or too late. */
static void test_waiting_for_what_is_new(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {0};
    struct lw_client *client;
    struct lw_error err = {0};
    const struct lw_message welcome = client_case_welcome_of(&w),
                            first = {.type = LW_MESSAGE_WAITING, .waiting = {2, 0.5f}},
                            later = {.type = LW_MESSAGE_WAITING, .waiting = {77, 0.5f}},
                            frame = {.type = LW_MESSAGE_FRAME, .frame = {.frame = 5}};
    client_case_say(&s, &first);
    client_case_expect_failure(&s, LW_PROTOCOL, "message WAITING: out of order", false);
    client_case_say(&s, &welcome);
    client_case_say(&s, &first);
    client_case_say(&s, &later);
    client_case_begin(&s);
    const struct lw_client_desc desc = {.host = "127.0.0.1", .port = s.port};
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    poll_until_waiting(client, LW_WAITING_UNKNOWN, 0.5f);
    lw_client_destroy(client);
    client_case_end(&s);
    client_case_say(&s, &welcome);
    client_case_say_package(&s, &w);
    client_case_say(&s, &frame);
    client_case_say(&s, &first);
    client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = 5});
    client_case_begin(&s);
    const struct lw_client_desc again = {.host = "127.0.0.1", .port = s.port};
    lw_support_ok(lw_client_create(&again, &client, &err), &err);
    for (struct lw_client_stats stats = {0}; stats.settled_frame != 5; lw_client_get_stats(client, &stats))
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
    assert_int_equal(lw_client_waiting(client).stage, LW_WAITING_READY);
    lw_client_destroy(client);
    client_case_end(&s);
    client_case_finish_world(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_waiting),
        cmocka_unit_test(test_waiting_for_what_is_new),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
