#include "tests/support/serving.h"

#include "server/serve/server.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Relays below a server, as they report themselves. */

static int dial_relay(struct serving *f, uint64_t relay) {
    struct lw_message m;
    const int s = serving_dial(f);
    serving_put(s, &(struct lw_message){
                       .type = LW_MESSAGE_HELLO,
                       .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURE_TREE, .relay = relay}});
    serving_expect(s, LW_MESSAGE_WELCOME, &m);
    assert_int_equal(m.welcome.features, relay ? LW_FEATURE_TREE : 0);
    lw_message_finish(&m);
    return s;
}

static void report(int s, const char *text) {
    serving_put(s, &(struct lw_message){.type = LW_MESSAGE_REPORT,
                                        .report = {.data = (const uint8_t *)text, .size = strlen(text)}});
}

static uint32_t below(struct serving *f, struct lw_relay_tree_node *out_node) {
    return lw_server_get_relays_below(f->server, out_node, LW_RELAY_TREE_MAX);
}

static void test_a_relay_is_listed_while_it_is_there(void **state) {
    (void)state;
    static struct lw_relay_tree_node node[LW_RELAY_TREE_MAX];
    struct serving *f = serving_start(&(struct lw_server_desc){.relay = 5});
    const int first = dial_relay(f, 7), second = dial_relay(f, 8);
    report(first, "7 99 3 0 1000 first\n9 7 2 4000 0 below\n");
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 2);
    assert_true(node[0].relay == 7 && node[0].above == 5 && node[0].sessions == 3); /* this server feeds it */
    assert_true(node[1].relay == 9 && node[1].above == 7 && node[1].light_age_ms == 4000);
    assert_string_equal(node[1].name, "below");
    report(second, "8 0 0 0 0 second\n");
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 3);
    report(first, "7 0 4 0 0 first\n"); /* the newest counts */
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 2);
    close(first);
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 1);
    assert_int_equal(node[0].relay, 8);
    close(second);
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 0);
    serving_end(f);
}

/* A relay has a session for each irradiance: the last report of any of them counts. */
static void test_a_relay_is_listed_once(void **state) {
    (void)state;
    static struct lw_relay_tree_node node[LW_RELAY_TREE_MAX];
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    const int full = dial_relay(f, 7), split = dial_relay(f, 7);
    report(full, "7 0 3 0 0 relay\n");
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 1);
    report(split, "7 0 4 0 0 relay\n9 7 2 0 0 below\n");
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 2);
    assert_int_equal(node[0].sessions, 4);
    report(full, "7 0 5 0 0 relay\n");
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 1);
    assert_int_equal(node[0].sessions, 5);
    /* and so is one that reports through NATS, too */
    const struct lw_relay_tree_node outside[] = {{.relay = 7, .name = "relay"}, {.relay = 8, .name = "nats"}};
    lw_server_set_relays_outside(f->server, outside, 2);
    assert_int_equal(below(f, node), 2);
    assert_true(node[0].sessions == 5 && node[1].relay == 8);
    close(full);
    close(split);
    lw_server_set_relays_outside(f->server, NULL, 0);
    LW_SUPPORT_WAIT_UNTIL(below(f, node) == 0);
    serving_end(f);
}

static void test_reports_that_make_no_sense_end_the_session(void **state) {
    (void)state;
    static struct lw_relay_tree_node node[LW_RELAY_TREE_MAX];
    static const char *const bad[] = {"", "x\n", "8 0 0 0 0 another\n", "7 0 0 0 0 a\n7"};
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        const int s = dial_relay(f, 7);
        report(s, "7 0 0 0 0 good\n");
        report(s, bad[i]);
        serving_expect_refusal(s, LW_REFUSAL_PROTOCOL);
        LW_SUPPORT_WAIT_UNTIL(below(f, node) == 0);
    }
    const int s = dial_relay(f, 0); /* it is none */
    report(s, "7 0 0 0 0 good\n");
    serving_expect_refusal(s, LW_REFUSAL_NOT_ALLOWED);
    assert_int_equal(below(f, node), 0);
    serving_end(f);
}

/* A limited number of sessions may report. Others are served all the same. */
static void test_there_is_room_for_so_many(void **state) {
    (void)state;
    static struct lw_relay_tree_node node[LW_RELAY_TREE_MAX];
    char text[100];
    int s[LW_RELAY_TREE_SESSIONS_MAX + 1];
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    for (uint32_t i = 0; i <= LW_RELAY_TREE_SESSIONS_MAX; i++) {
        s[i] = dial_relay(f, i + 1);
        snprintf(text, sizeof text, "%x 0 0 0 0 r\n", i + 1);
        report(s[i], text);
        serving_expect_silence(s[i]); /* it was read */
    }
    assert_int_equal(below(f, node), LW_RELAY_TREE_SESSIONS_MAX);
    for (uint32_t i = 0; i <= LW_RELAY_TREE_SESSIONS_MAX; i++) close(s[i]);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_relay_is_listed_while_it_is_there),
        cmocka_unit_test(test_a_relay_is_listed_once),
        cmocka_unit_test(test_reports_that_make_no_sense_end_the_session),
        cmocka_unit_test(test_there_is_room_for_so_many),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
