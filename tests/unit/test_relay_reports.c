/* Reports of relays through NATS: places, and relays that say nothing more. The test moves the clock. */
#include "tests/support/support.h"

#include "proto/nats_wire.h"
#include "server/nats/relay_reports.h"

#include <stdio.h>
#include <string.h>

#define MS         1000000ull
#define SILENCE_NS (LW_NATS_WIRE_SILENCE_MS * MS)

static struct lw_relay_reports reports;
static struct lw_relay_tree_node node[LW_RELAY_TREE_MAX];

static void report(const char *lines, uint64_t now_ns) {
    lw_support_ok(lw_relay_reports_take(&reports, (const uint8_t *)lines, strlen(lines), now_ns), NULL);
}

static uint32_t list(void) { return lw_relay_reports_list(&reports, node); }

static int end(void **state) {
    (void)state;
    lw_relay_reports_finish(&reports);
    reports = (struct lw_relay_reports){.count = 0};
    return 0;
}

/* A relay is listed until it is silent for LW_NATS_WIRE_SILENCE_MS; those below it leave with it. */
static void relays_are_listed_while_they_report(void **state) {
    (void)state;
    report("7 99 3 0 1000 first\n9 7 2 0 0 below\n", 1);
    report("8 0 2 0 0 second\n", 2);
    assert_int_equal(list(), 3);
    assert_int_equal(node[0].relay, 8);
    assert_true(node[1].relay == 7 && node[1].above == 0); /* the daemon feeds it */
    assert_true(node[2].relay == 9 && node[2].above == 7);
    report("8 0 2 0 0 second\n", MS);
    assert_false(lw_relay_reports_forget_silent(&reports, SILENCE_NS));
    assert_true(lw_relay_reports_forget_silent(&reports, SILENCE_NS + 1));
    assert_int_equal(list(), 1);
    assert_int_equal(node[0].relay, 8);
    assert_true(lw_relay_reports_forget_silent(&reports, SILENCE_NS + MS));
    assert_int_equal(list(), 0);
}

/* It takes light from another relay no more, but from NATS. */
static void the_newest_report_of_a_relay_holds(void **state) {
    (void)state;
    report("7 0 3 0 0 first\n9 7 2 0 0 below\n", 1);
    report("9 0 2 0 0 moved\n", 2);
    assert_int_equal(list(), 2);
    assert_true(node[0].relay == 9 && node[0].above == 0);
    assert_string_equal(node[0].name, "moved");
    assert_int_equal(node[1].relay, 7);
}

/* There is a limited number of places. A relay that has one keeps it. */
static void there_is_room_for_so_many_relays(void **state) {
    (void)state;
    char text[100];
    for (unsigned i = 1; i <= LW_RELAY_TREE_MAX + 5; i++) {
        snprintf(text, sizeof text, "%x 0 0 0 0 r\n", i);
        report(text, i);
    }
    assert_int_equal(list(), LW_RELAY_TREE_MAX);
    assert_int_equal(node[0].relay, LW_RELAY_TREE_MAX);
    report("1 0 0 0 0 last\n7777 1 0 0 0 below\n", MS); /* for whom there is no room */
    assert_int_equal(list(), LW_RELAY_TREE_MAX);
    assert_int_equal(node[0].relay, 1);
    assert_string_equal(node[0].name, "last");
    for (uint32_t i = 0; i < LW_RELAY_TREE_MAX; i++) assert_int_not_equal(node[i].relay, 0x7777);
}

static void what_is_no_report_changes_nothing(void **state) {
    (void)state;
    static const char *const bad[] = {"", "x\n", "0 0 0 0 0 a\n", "7 0 0 0 0 a\n7"};
    report("7 0 3 0 0 first\n", 1);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(lw_relay_reports_take(&reports, (const uint8_t *)bad[i], strlen(bad[i]), 2),
                         LW_PROTOCOL);
    assert_int_equal(list(), 1);
    assert_int_equal(reports.report[0].heard_ns, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(relays_are_listed_while_they_report, end),
        cmocka_unit_test_teardown(the_newest_report_of_a_relay_holds, end),
        cmocka_unit_test_teardown(there_is_room_for_so_many_relays, end),
        cmocka_unit_test_teardown(what_is_no_report_changes_nothing, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
