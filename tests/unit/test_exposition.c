#include "tests/support/support.h"

#include "server/serve/metrics/exposition.h"

#include <stdlib.h>
#include <string.h>

static void test_text(void **state) {
    (void)state;
    struct lw_exposition e;
    struct lw_durations d = {0};
    char *text;
    size_t size;
    lw_durations_add(&d, 0);
    lw_durations_add(&d, 500000); /* a bound is its own bucket's */
    lw_durations_add(&d, 500001);
    lw_durations_add(&d, 11000000000);
    assert_int_equal(lw_exposition_begin(&e), LW_OK);
    lw_exposition_counter(&e, "a_total", 9007199254740991.0, "Counts.");
    lw_exposition_gauge(&e, "b", 0.25, "Is.");
    lw_exposition_metric(&e, "c", "histogram", "Lasts.");
    lw_exposition_durations(&e, "c", "k=\"v\"", &d);
    lw_exposition_durations(&e, "c", NULL, &(struct lw_durations){0});
    assert_int_equal(lw_exposition_end(&e, &text, &size), LW_OK);
    assert_int_equal(strlen(text), size);
    static const char begin[] = "# HELP a_total Counts.\n# TYPE a_total counter\na_total 9007199254740991\n"
                                "# HELP b Is.\n# TYPE b gauge\nb 0.25\n"
                                "# HELP c Lasts.\n# TYPE c histogram\n"
                                "c_bucket{k=\"v\",le=\"0.0005\"} 2\nc_bucket{k=\"v\",le=\"0.001\"} 3\n";
    if (strncmp(text, begin, strlen(begin)) != 0) fail_msg("%s", text);
    if (!strstr(text, "c_bucket{k=\"v\",le=\"10\"} 3\nc_bucket{k=\"v\",le=\"+Inf\"} 4\n"
                      "c_sum{k=\"v\"} 11.001000001\nc_count{k=\"v\"} 4\nc_bucket{le=\"0.0005\"} 0\n"))
        fail_msg("%s", text);
    if (!strstr(text, "\nc_sum 0\nc_count 0\n")) fail_msg("%s", text);
    free(text);
}

static void test_escape(void **state) {
    (void)state;
    char text[16];
    lw_exposition_escape(text, sizeof text, "a\"b\\c\nd");
    assert_string_equal(text, "a\\\"b\\\\c\\nd");
    lw_exposition_escape(text, 4, "abcdef"); /* cut off, and never within an escape */
    assert_string_equal(text, "ab");
    lw_exposition_escape(text, 4, "a\"\"");
    assert_string_equal(text, "a\\\"");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_text), cmocka_unit_test(test_escape)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
