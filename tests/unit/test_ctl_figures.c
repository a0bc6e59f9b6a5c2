/* Figures as Prometheus gets them, read by lightwellctl. */
#include "tests/support/support.h"

#include "client/control/ctl_figures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static struct lw_ctl_figures read_text(const char *text, uint64_t as_of_ns) {
    struct lw_ctl_figures figures;
    struct lw_error err = {0};
    assert_int_equal(lw_ctl_figures_read(&figures, strdup(text), as_of_ns, &err), LW_OK);
    return figures;
}

static void test_reads(void **state) {
    (void)state;
    struct lw_ctl_figures f = read_text("# HELP a What it is.\n# TYPE a counter\na 3\n\n"
                                        "b{kind=\"two words\"} 1.5e+09\nc{le=\"+Inf\"} +Inf\nd NaN",
                                        7);
    assert_int_equal(f.count, 4);
    assert_true(lw_ctl_figures_get(&f, "a") == 3);
    assert_true(lw_ctl_figures_get(&f, "b{kind=\"two words\"}") == 1.5e9);
    assert_true(isinf(lw_ctl_figures_get(&f, "c{le=\"+Inf\"}")));
    assert_true(isnan(lw_ctl_figures_get(&f, "d")));
    assert_true(lw_ctl_figures_get(&f, "nothing") == 0);
    lw_ctl_figures_finish(&f);
    lw_ctl_figures_finish(&f);
}

static void test_refuses(void **state) {
    (void)state;
    static const char *const wrong[] = {"a", "a b", " 3", "a 3x", "a 3\nb"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct lw_ctl_figures f;
        struct lw_error err = {0};
        assert_int_equal(lw_ctl_figures_read(&f, strdup(wrong[i]), 0, &err), LW_PROTOCOL);
        lw_ctl_figures_finish(&f);
    }
}

#define BEFORE                                                                                               \
    "lightwell_ready 1\nlightwell_sessions 2\nlightwell_frame_duration_seconds_count 10\n"                   \
    "lightwell_frame_duration_seconds_sum 1\nlightwell_rays_total{kind=\"shadow\"} 1000000\n"                \
    "lightwell_sent_bytes_total 1000\nprocess_cpu_seconds_total 5\n"
#define NOW                                                                                                  \
    "lightwell_ready 1\nlightwell_sessions 3\nlightwell_frame_duration_seconds_count 40\n"                   \
    "lightwell_frame_duration_seconds_sum 1.6\nlightwell_rays_total{kind=\"shadow\"} 3400000\n"              \
    "lightwell_sent_bytes_total 5000\nprocess_cpu_seconds_total 8\n"

static void test_lines(void **state) {
    (void)state;
    struct lw_ctl_figures before = read_text(BEFORE, 0), now = read_text(NOW, 2000000000);
    char text[1024], small[10];
    lw_ctl_figures_line(&before, &now, text, sizeof text);
    assert_string_equal(text, "sessions 3  frames 15.0/s of 20.0 ms  rays 1.2 M/s  sent 2 kB/s  waiting 0 B  "
                              "cores 1.50");
    /* a server that was started again counts from 0: nothing is negative */
    lw_ctl_figures_line(&now, &before, text, sizeof text);
    assert_null(strchr(text, '-'));
    lw_ctl_figures_table(&now, text, sizeof text);
    assert_non_null(strstr(text, "ready      yes\n"));
    assert_non_null(strstr(text, "frames     40, newest 0, mean 40.0 ms\n"));
    lw_ctl_figures_table(&now, small, sizeof small);
    assert_int_equal(strlen(small), sizeof small - 1);
    lw_ctl_figures_finish(&before);
    lw_ctl_figures_finish(&now);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_reads),
        cmocka_unit_test(test_refuses),
        cmocka_unit_test(test_lines),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
