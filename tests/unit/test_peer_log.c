#include "tests/support/support.h"

#include "server/serve/admission/peer_log.h"

#include <string.h>

#define SECOND_NS 1000000000ull

static struct lw_peer_log peer_log;

static unsigned allowed(uint8_t last, unsigned count, uint64_t now_ns) {
    const struct lw_address address = {.bytes = {10, 0, 0, last}};
    unsigned lines = 0;
    for (unsigned i = 0; i < count; i++)
        lines += lw_peer_log_allows(&peer_log, &address, "10.0.0.x:5", now_ns);
    return lines;
}

static uint64_t left_out(void) {
    uint64_t sum = 0;
    for (unsigned i = 0; i < LW_PEER_LOG_SLOTS; i++) sum += peer_log.slot[i].left_out;
    return sum;
}

static void test_one_address(void **state) {
    (void)state;
    uint64_t now_ns = 100 * SECOND_NS;
    memset(&peer_log, 0, sizeof peer_log);
    assert_int_equal(allowed(1, LW_PEER_LOG_BURST, now_ns), LW_PEER_LOG_BURST);
    assert_int_equal(allowed(1, 1000, now_ns), 0); /* one past the limit, and on */
    assert_int_equal(left_out(), 1000);
    assert_int_equal(allowed(2, 1, now_ns), 1); /* other addresses have lines */
    assert_int_equal(allowed(1, 1000, now_ns + 10 * SECOND_NS), 10 * LW_PEER_LOG_HZ);
    lw_peer_log_tell(&peer_log, now_ns + 10 * SECOND_NS);
    assert_int_equal(left_out(), 0);
    allowed(1, 1000, now_ns + 10 * SECOND_NS);
    lw_peer_log_tell(&peer_log, now_ns + 11 * SECOND_NS); /* not so soon again */
    assert_int_equal(left_out(), 1000);
}

static void test_all_addresses(void **state) {
    (void)state;
    unsigned lines = 0;
    memset(&peer_log, 0, sizeof peer_log);
    for (unsigned i = 0; i < 200; i++) lines += allowed((uint8_t)i, 10, SECOND_NS);
    assert_int_equal(lines, 10 * LW_PEER_LOG_ALL_HZ);
}

static void test_quotes(void **state) {
    (void)state;
    char text[32];
    lw_peer_log_quote(text, sizeof text, "viewer");
    assert_string_equal(text, "\"viewer\"");
    lw_peer_log_quote(text, sizeof text, "\") left: bye; \\");
    assert_string_equal(text, "\"\\\") left: bye; \\\\\"");
    char small[8];
    lw_peer_log_quote(small, sizeof small, "abcdefghij");
    assert_string_equal(small, "\"abcd\"");
    lw_peer_log_quote(small, sizeof small, "\"\"\"\"\"\"");
    assert_true(strlen(small) < sizeof small && small[strlen(small) - 1] == '"');
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_address),
        cmocka_unit_test(test_all_addresses),
        cmocka_unit_test(test_quotes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
