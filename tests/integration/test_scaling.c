/* lightwell-load scaling with the real lightwelld, on the smallest scene and pictures. */
#include "tests/support/process.h"

#include <dirent.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LIMIT_S  LW_PROCESS_LIMIT_S
#define SMALLEST "builtin:cornell --texels-per-metre 8 --size 64x36 --seconds 0.2 --reference-samples 16 "
#define SMALL    SMALLEST "--users 1,2,4 --repeats 2 "

static int run(const char *arguments, struct lw_process *process) {
    char all[600];
    snprintf(all, sizeof all, "scaling %s", arguments);
    lw_process_start(process, "lightwell-load", all);
    return lw_process_finish(process, LIMIT_S);
}

static double number_after(const char *text, const char *key) {
    const char *at = strstr(text, key);
    if (!at) fail_msg("no %s in %.200s", key, text);
    return atof(at + strlen(key));
}

static void measures_reports_and_goes_on(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("scaling");
    snprintf(arguments, sizeof arguments, SMALL "-o %s", folder);
    int code = run(arguments, &process);
    char *said = lw_process_err(&process), *result = lw_process_out(&process);
    if (code != 0) fail_msg("%s", said);
    const double ratio = number_after(result, "r(1) = "), marginal = number_after(result, "m = ");
    /* frames of so little work are noisy: one more user may seem to cost nothing */
    assert_true(ratio > 0 && isfinite(ratio) && isfinite(marginal));
    free(said);

    char *report = lw_support_read_text(folder, "report.md");
    assert_non_null(strstr(report, "one shared solve over path tracers, 1 user"));
    assert_non_null(strstr(report, "Light that is a second late has relMSE"));
    assert_non_null(strstr(report, "| solve |"));
    /* errors of a repeat stand beside the path tracer's for the same views */
    assert_non_null(strstr(report, "where the path tracer has"));
    assert_non_null(strstr(report, "with all of the scene lit"));
    assert_non_null(strstr(report, "| compose |"));
    free(report);
    char *csv = lw_support_read_text(folder, "scaling.csv");
    unsigned lines = 0;
    for (const char *c = csv; *c; c++) lines += *c == '\n';
    assert_int_equal(lines, 1 + 3 * 2);
    free(csv);
    char *json = lw_support_read_text(folder, "scaling.json");
    assert_non_null(strstr(json, "\"crossover_users\""));
    free(json);
    lw_process_left_nothing();

    /* nothing is measured again, and the result is the same, but for the digits that tables leave out */
    lw_process_expect(&process, run(arguments, &process), 0);
    char *again = lw_process_out(&process);
    said = lw_process_err(&process);
    assert_true(fabs(number_after(again, "r(1) = ") - ratio) <= 2e-3 * ratio);
    assert_true(fabs(number_after(again, "m = ") - marginal) <= 2e-3 * fabs(marginal));
    assert_null(strstr(said, "shared cache, 1 user"));
    free(said);
    free(again);
    free(result);

    /* other users do not mix with these */
    snprintf(arguments, sizeof arguments, SMALLEST "--users 1,2 --repeats 2 -o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 64);
    said = lw_process_err(&process);
    assert_non_null(strstr(said, "holds a row whose users is 1,2,4, not 1,2"));
    free(said);

    /* nor does a row of the crossover take the folder, or its report */
    snprintf(arguments, sizeof arguments, "crossover --report-only -o %s", folder);
    lw_process_refuses("lightwell-load", arguments, 64, "holds a run of lightwell-load scaling", LIMIT_S);
    snprintf(arguments, sizeof arguments, "crossover builtin:cornell --size 64x32 -o %s", folder);
    lw_process_refuses("lightwell-load", arguments, 64, "choose another folder", LIMIT_S);
    report = lw_support_read_text(folder, "report.md");
    assert_non_null(strstr(report, "# Scaling run"));
    free(report);
}

/* The harness against itself: with the same path tracer on both sides nobody wins. CPU time of so little
 * work is noisy on a busy machine: the bound is wide, but mistakes (costs counted twice, users
 * forgotten) is a factor of 2. */
static void equals_are_equal(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --texels-per-metre 12 --size 320x180 --seconds 0.2 --reference-samples 16 "
             "--users 1,2,4 "
             "--repeats 4 --self-test -o %s",
             lw_support_temporary("self"));
    assert_int_equal(run(arguments, &process), 0);
    char *result = lw_process_out(&process);
    const double ratio = number_after(result, "r(1) = "), half = number_after(result, "+- ");
    print_message("r(1) = %g +- %g\n", ratio, half);
    free(result);
    assert_true(fabs(ratio - 1) < fmax(half, 0.3));
}

static void settings_may_be_given_and_plots_missing(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("given");
    snprintf(arguments, sizeof arguments,
             SMALLEST "--users 1,2 --repeats 1 --settings 2:1+1 --motion static --views centre -o %s",
             folder);
    const char *path = getenv("PATH");
    char *kept = strdup(path ? path : "");
    setenv("PATH", "/nowhere", 1); /* and no gnuplot */
    int code = run(arguments, &process);
    setenv("PATH", kept, 1);
    free(kept);
    char *said = lw_process_err(&process);
    if (code != 0) fail_msg("%s", said);
    assert_non_null(strstr(said, "no plots: cannot run gnuplot"));
    free(said);
    char *report = lw_support_read_text(folder, "report.md");
    assert_non_null(strstr(report, "At given settings: 2 paths per pixel"));
    free(report);
}

/* Where the whole scene is lit, given settings take one sequence of the server's frames a repeat, and all
 * eyes judge. */
static void given_settings_of_the_whole_take_one_sequence(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("whole");
    snprintf(arguments, sizeof arguments,
             SMALL "--opponent raw --settings 2:1+1@0.5,0.1 --light whole --views centre -o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 0);
    char *said = lw_process_err(&process);
    assert_null(strstr(said, "shared cache, density")); /* the line of a setting that is tried */
    free(said);
    char *report = lw_support_read_text(folder, "report.md"),
         *csv = lw_support_read_text(folder, "settings.csv");
    const char *shared = strstr(csv, "\nshared,");
    assert_non_null(strstr(report, "density ×0.5, 1 + 1 samples, target error 0.1"));
    assert_non_null(strstr(report, "over the same 12 views"));
    assert_non_null(shared);
    double error = 0, cost_s = 0;
    assert_int_equal(sscanf(shared, "\nshared,%*[^,],%*[^,],%*[^,],%*[^,],%*[^,],%lf,%lf", &error, &cost_s),
                     2);
    assert_true(error > 0 && error < 1 && cost_s > 0);
    free(csv);
    free(report);
}

static void both_sides_may_be_filtered(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("filtered");
    snprintf(arguments, sizeof arguments, SMALL "--opponent svgf --settings 1:1+1 --views centre -o %s",
             folder);
    lw_process_expect(&process, run(arguments, &process), 0);
    char *said = lw_process_err(&process);
    free(said);
    /* one path per pixel is off by 0.1 and more here; filtered, by a tenth of that at most */
    char *csv = lw_support_read_text(folder, "settings.csv");
    const char *paths = strstr(csv, "\npaths,1,");
    assert_non_null(paths);
    double error = -1;
    assert_int_equal(sscanf(paths, "\npaths,1,%*[^,],%*[^,],%*[^,],%*[^,],%lf", &error), 1);
    assert_true(error >= 0 && error < 0.02);
    free(csv);
}

static bool has_begun(void *context) {
    char *said = lw_process_err(context);
    const bool begun = strstr(said, "shared cache") || strstr(said, "svgf, 1 path");
    free(said);
    return begun;
}

static void an_interruption_keeps_what_is_there(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[600];
    const char *folder = lw_support_temporary("interrupted");
    snprintf(arguments, sizeof arguments,
             "scaling builtin:cornell --texels-per-metre 12 --size 80x45 --seconds 60 --reference-samples 16 "
             "-o %s",
             folder);
    lw_process_start(&process, "lightwell-load", arguments);
    assert_true(lw_process_await(&process, has_begun, &process));
    kill(process.pid, SIGINT); /* timeout(1) sends two at once, which are one */
    assert_int_equal(lw_process_stop(&process, SIGINT, LIMIT_S), 0);
    char *report = lw_support_read_text(folder, "report.md"),
         *csv = lw_support_read_text(folder, "settings.csv");
    assert_non_null(strstr(report, "interrupted"));
    assert_non_null(strstr(csv, "paths,1,"));
    free(csv);
    free(report);
    lw_process_left_nothing();
}

static void fails_with_one_line(void **state) {
    (void)state;
    char arguments[500];
    static const struct {
        const char *scene, *folder, *text; /* folder: NULL is a good one */
        int code;
    } bad[] = {
        {"builtin:cornell", "/proc/nowhere", "cannot make the folder", 73},
        {"builtin:cornell", "/proc", "/proc/samples.csv", 73},
        {"builtin:cornell", "/dev/null", "/dev/null: cannot make the folder", 73},
        {"builtin:nothing", NULL, "builtin:nothing", 66},
        {"builtin:cornell --users 0", NULL, "--users", 64},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        snprintf(arguments, sizeof arguments, "scaling %s -o %s", bad[i].scene,
                 bad[i].folder ? bad[i].folder : lw_support_temporary("bad"));
        lw_process_refuses("lightwell-load", arguments, bad[i].code, bad[i].text, LIMIT_S);
    }
}

/* Each whole run takes seconds by the clock. With an argument: the long tests alone. */
int main(int argc, char **argv) {
    const struct CMUnitTest long_tests[] = {
        cmocka_unit_test_teardown(given_settings_of_the_whole_take_one_sequence, lw_process_teardown),
        cmocka_unit_test_teardown(both_sides_may_be_filtered, lw_process_teardown),
        cmocka_unit_test_teardown(equals_are_equal, lw_process_teardown),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(measures_reports_and_goes_on, lw_process_teardown),
        cmocka_unit_test_teardown(settings_may_be_given_and_plots_missing, lw_process_teardown),
        cmocka_unit_test_teardown(an_interruption_keeps_what_is_there, lw_process_teardown),
        cmocka_unit_test_teardown(fails_with_one_line, lw_process_teardown),
    };
    (void)argv;
    if (argc > 1) return cmocka_run_group_tests(long_tests, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
