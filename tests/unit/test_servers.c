/* Where a client looks for its light when its server is gone. */
#include "tests/support/support.h"

#include "client/lib/servers.h"

#include <string.h>

static struct lw_servers servers;

static int end(void **state) {
    (void)state;
    lw_servers_finish(&servers);
    return 0;
}

static void expect_next(const char *host, uint16_t port, bool is_announced) {
    lw_support_ok(lw_servers_next(&servers), NULL);
    assert_string_equal(servers.host, host);
    assert_int_equal(servers.port, port);
    assert_int_equal(lw_servers_is_announced(&servers), is_announced);
}

static void those_that_are_reported_are_tried_in_turn(void **state) {
    (void)state;
    lw_support_ok(lw_servers_init(&servers, "a", 1), NULL);
    assert_false(lw_servers_is_announced(&servers));
    lw_support_ok(lw_servers_found(&servers, "b:2,[::1]:3"), NULL);
    for (int round = 0; round < 2; round++) {
        expect_next("a", 1, false);
        expect_next("b", 2, true);
        expect_next("::1", 3, true);
        expect_next("a", 1, false); /* the one that was given */
    }
    expect_next("a", 1, false);
    expect_next("b", 2, true);
    lw_support_ok(lw_servers_found(&servers, "c:4"), NULL); /* b welcomed us */
    assert_false(lw_servers_is_announced(&servers));
    expect_next("b", 2, false);
    expect_next("c", 4, true);
    expect_next("a", 1, false);
    expect_next("b", 2, false);
}

/* A server may say anything. */
static void what_is_no_address_is_left_out(void **state) {
    (void)state;
    static const char *const announced[] = {
        "", ",", ",,,", "unix:/run/other", "b:99999", "b:0", "[::1", ":x", NULL, "\n", "a:b:c"};
    char longest[1025];
    memset(longest, 'x', sizeof longest - 1);
    longest[sizeof longest - 1] = '\0';
    lw_support_ok(lw_servers_init(&servers, "a", 1), NULL);
    for (size_t i = 0; i <= sizeof announced / sizeof *announced; i++) {
        lw_support_ok(
            lw_servers_found(&servers, i < sizeof announced / sizeof *announced ? announced[i] : longest),
            NULL);
        for (int k = 0; k < 5; k++) expect_next("a", 1, false);
    }
    lw_support_ok(lw_servers_found(&servers, ",unix:/x,b:2,"), NULL);
    expect_next("a", 1, false);
    expect_next("b", 2, true);
    expect_next("a", 1, false);
}

/* A path may be given, and stays. */
static void a_path_may_be_given(void **state) {
    (void)state;
    lw_support_ok(lw_servers_init(&servers, "unix:/run/here", 0), NULL);
    expect_next("unix:/run/here", 0, false);
    expect_next("unix:/run/here", 0, false);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(those_that_are_reported_are_tried_in_turn, end),
        cmocka_unit_test_teardown(what_is_no_address_is_left_out, end),
        cmocka_unit_test_teardown(a_path_may_be_given, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
