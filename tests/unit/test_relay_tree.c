/* Reports of relays: lines that are read as they were written, and lines that are none. */
#include "tests/support/support.h"

#include "server/serve/metrics/relay_tree.h"

#include <stdlib.h>
#include <string.h>

static struct lw_relay_tree_node node[LW_RELAY_TREE_MAX], again[LW_RELAY_TREE_MAX];
static char text[LW_RELAY_TREE_TEXT_MAX + 1];

static enum lw_status read_lines(const char *lines, uint32_t *out_count, struct lw_error *err) {
    return lw_relay_tree_read((const uint8_t *)lines, strlen(lines), again, LW_RELAY_TREE_MAX, out_count,
                              err);
}

/* The longest lines, and as many as there may be. */
static void lines_are_read_as_they_were_written(void **state) {
    (void)state;
    uint32_t count = 0;
    struct lw_error err = {0};
    for (uint32_t i = 0; i < LW_RELAY_TREE_MAX; i++) {
        node[i] = (struct lw_relay_tree_node){.relay = UINT64_MAX - i,
                                              .above = i,
                                              .sessions = 10000,
                                              .light_age_ms = 999999999999999999u,
                                              .sent_bytes_hz = 999999999999999999u};
        memset(node[i].name, 'x', LW_MESSAGE_NAME_MAX);
    }
    const size_t size = lw_relay_tree_write(node, LW_RELAY_TREE_MAX, text, sizeof text);
    assert_true(size <= LW_RELAY_TREE_TEXT_MAX && size < LW_FRAMING_CLIENT_BODY_MAX);
    lw_support_ok(read_lines(text, &count, &err), &err);
    assert_int_equal(count, LW_RELAY_TREE_MAX);
    assert_memory_equal(node, again, sizeof node);
    lw_support_ok(read_lines("", &count, &err), &err);
    assert_int_equal(count, 0);
    memcpy(text + size, "1 0 0 0 0 a\n", 13);
    lw_support_fails(read_lines(text, &count, &err), LW_PROTOCOL, &err, "none of a relay");
}

static void what_is_no_line_is_refused(void **state) {
    (void)state;
    static const char *const bad[] = {"\n",
                                      "1 0 0 0 0 a",
                                      "1 0 0 0 0 \n",
                                      "0 0 0 0 0 a\n",
                                      "1  0 0 0 0 a\n",
                                      "-1 0 0 0 0 a\n",
                                      "1 0 -1 0 0 a\n",
                                      "1 0 0 0 a\n",
                                      "1 0 0 0 0 a b\n",
                                      "1 0 0 0 0 a\"\n",
                                      "11111111111111111 0 0 0 0 a\n",
                                      "1 0 1111111111111111111 0 0 a\n",
                                      "1 0 0 0 0 a\n\n"};
    uint32_t count = 77;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct lw_error err = {0};
        lw_support_fails(read_lines(bad[i], &count, &err), LW_PROTOCOL, &err, "none of a relay");
        assert_int_equal(count, 77);
    }
    struct lw_error err = {0};
    lw_support_fails(lw_relay_tree_read((const uint8_t *)"1 0 0 0 0 a\0\n", 13, again, 4, &count, &err),
                     LW_PROTOCOL, &err, "no list of relays");
    memset(text, '1', sizeof text);
    lw_support_fails(lw_relay_tree_read((const uint8_t *)text, sizeof text, again, 4, &count, &err),
                     LW_PROTOCOL, &err, "no list of relays");
}

/* Whatever a relay is called, the server above can read it. */
static void names_are_made_fit(void **state) {
    (void)state;
    char name[LW_MESSAGE_NAME_MAX + 1], long_name[200];
    memset(long_name, 'y', sizeof long_name - 1);
    long_name[sizeof long_name - 1] = '\0';
    lw_relay_tree_name(name, "unix:/run/a b\"\n");
    assert_string_equal(name, "unix:/run/a_b__");
    lw_relay_tree_name(name, "");
    assert_string_equal(name, "_");
    lw_relay_tree_name(name, long_name);
    assert_int_equal(strlen(name), LW_MESSAGE_NAME_MAX);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lines_are_read_as_they_were_written),
        cmocka_unit_test(what_is_no_line_is_refused),
        cmocka_unit_test(names_are_made_fit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
