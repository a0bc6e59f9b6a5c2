/* The tree of relays in lines for people. */
#include "tests/support/support.h"

#include "client/control/ctl_tree.h"

#include <stdlib.h>
#include <string.h>

/* Figures of one server, twice, a second apart; what lightwellctl prints. The caller frees it. */
static char *text_of_tree(const char *before_text, const char *now_text) {
    struct lw_ctl_figures before, now;
    struct lw_ctl_tree tree;
    struct lw_error err = {0};
    char *shown = NULL;
    size_t size;
    lw_support_ok(lw_ctl_figures_read(&before, strdup(before_text), 1000000000, &err), &err);
    lw_support_ok(lw_ctl_figures_read(&now, strdup(now_text), 2000000000, &err), &err);
    lw_support_ok(lw_ctl_tree_read(&tree, "here", &before, &now, &err), &err);
    FILE *stream = open_memstream(&shown, &size);
    assert_non_null(stream);
    lw_support_ok(lw_ctl_tree_write(&tree, stream), NULL);
    assert_int_equal(fclose(stream), 0);
    lw_ctl_tree_finish(&tree);
    lw_ctl_figures_finish(&before);
    lw_ctl_figures_finish(&now);
    return shown;
}

#define RELAY(relay, above, name) "{relay=\"" relay "\",above=\"" above "\",name=\"" name "\"} "
#define LINES(relay, above, name, sessions, age, sent)                                                       \
    "lightwell_below_sessions" RELAY(relay, above, name) sessions                                            \
        "\n"                                                                                                 \
        "lightwell_below_light_age_seconds" RELAY(relay, above, name) age                                    \
        "\n"                                                                                                 \
        "lightwell_below_sent_bytes_per_second" RELAY(relay, above, name) sent "\n"

static void relays_stand_below_what_feeds_them(void **state) {
    (void)state;
    char *text = text_of_tree("lightwell_sent_bytes_total 1000\n",
                              "lightwell_sent_bytes_total 251000\n"
                              "lightwell_sessions 4\n" LINES("b", "a", "second:1", "7", "0", "125000")
                                  LINES("a", "0", "first:1", "3", "12", "0"));
    assert_string_equal(
        text, "here                                      clients 2          2.00 Mbit/s  light current\n"
              "  first:1                                 clients 2          0.00 Mbit/s  light 12 s old\n"
              "    second:1                              clients 7          1.00 Mbit/s  light 12 s old\n");
    free(text);
}

/* A relay says who feeds it, and how long it has been without. */
static void a_relay_names_the_server_above(void **state) {
    (void)state;
    char *text = text_of_tree("lightwell_sessions 1\n",
                              "lightwell_sessions 1\n"
                              "lightwell_upstream_connected{address=\"10.0.0.1:7780\"} 0\n"
                              "lightwell_upstream_lost_seconds 5\n" LINES("b", "77", "below", "0", "0", "0"));
    assert_string_equal(
        text, "10.0.0.1:7780\n"
              "  here                                    clients 0          0.00 Mbit/s  light 5 s old\n"
              "    below                                 clients 0          0.00 Mbit/s  light 5 s old\n");
    free(text);
}

/* Relays may say anything: each is shown once. */
static void circles_end(void **state) {
    (void)state;
    char *text = text_of_tree("", LINES("a", "b", "one", "0", "0", "0") LINES("b", "a", "two", "0", "0", "0")
                                      LINES("c", "c", "three", "0", "0", "0"));
    for (const char *const *name = (const char *const[]){"one ", "two ", "three ", NULL}; *name; name++) {
        const char *at = strstr(text, *name);
        assert_non_null(at);
        assert_null(strstr(at + 1, *name));
    }
    free(text);
}

static void what_is_no_relay_is_refused(void **state) {
    (void)state;
    struct lw_ctl_figures figures;
    struct lw_ctl_tree tree;
    struct lw_error err = {0};
    lw_support_ok(lw_ctl_figures_read(&figures, strdup("lightwell_below_sessions{relay=\"x\"} 1\n"), 1, &err),
                  &err);
    lw_support_fails(lw_ctl_tree_read(&tree, "here", &figures, &figures, &err), LW_PROTOCOL, &err,
                     "no relay");
    lw_ctl_tree_finish(&tree);
    lw_ctl_figures_finish(&figures);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(relays_stand_below_what_feeds_them),
        cmocka_unit_test(a_relay_names_the_server_above),
        cmocka_unit_test(circles_end),
        cmocka_unit_test(what_is_no_relay_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
