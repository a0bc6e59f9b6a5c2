#include "tests/support/support.h"

#include "client/measure/crossover_analysis.h"
#include "client/measure/crossover_report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define REPEATS 2u

static void put(struct lw_measure_store *store, const char *renderer, const char *setting, uint32_t repeat,
                double error, double alone_s, double all_s) {
    struct lw_measure_sample sample[LW_MEASURE_VIEWS];
    struct lw_measure_expense expense[LW_MEASURE_VIEWS + 1];
    struct lw_measure_unit unit = {.repeat = repeat};
    struct lw_error err = {0};
    const bool is_cache = strcmp(renderer, "cache") == 0;
    snprintf(unit.renderer, sizeof unit.renderer, "%s", renderer);
    snprintf(unit.setting, sizeof unit.setting, "%s", setting);
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        const double brighter = 1 + 0.1 * v; /* views differ by the same for all renderers */
        sample[v] = (struct lw_measure_sample){
            .unit = unit,
            .view = v,
            .frame = 61,
            .coin = {error * brighter, 2 * error, error / 2, 5 * error * brighter, (double)NAN}};
        expense[v] = lw_measure_store_expense(&unit, 1, v);
        expense[v].frames = 8;
        expense[v].cpu_s[is_cache ? LW_STAGE_SOLVE : LW_STAGE_TRACE] = alone_s * brighter;
    }
    /* every third view of the cache is seen alone */
    uint32_t count = 0;
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++)
        if (!isnan(alone_s) && (!is_cache || v % 3 == 0)) expense[count++] = expense[v];
    expense[count] = lw_measure_store_expense(&unit, is_cache ? LW_MEASURE_VIEWS : 1, LW_MEASURE_ALL);
    expense[count].samples = LW_MEASURE_VIEWS;
    expense[count].cpu_s[is_cache ? LW_STAGE_SOLVE : LW_STAGE_TRACE] = all_s;
    expense[count].extra[LW_MEASURE_EXTRA_START_CPU] = is_cache ? 6 : 0.5;
    lw_support_ok(lw_measure_store_append(store, sample, LW_MEASURE_VIEWS, expense, count + 1, &err), &err);
}

/* A row by hand: the cache's denser setting reaches svgf's error, none that of svgf-quarter. */
static const char *make_row(const char *name, double late) {
    const char *folder = lw_support_temporary(name);
    struct lw_measure_store store;
    struct lw_measure_late line = {.view = 0, .frame = 61, .late = 30, .relmse = late};
    struct lw_error err = {0};
    lw_support_ok(lw_measure_store_open(&store, folder, false, &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "scene", "builtin:hand", &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "motion", "lamp-walk", &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "dark views", "2 5", &err), &err);
    lw_support_ok(lw_measure_store_set_late(&store, &line, 1, &err), &err);
    for (uint32_t r = 0; r < REPEATS; r++) {
        put(&store, "svgf", "1 path", r, 0.04, 2, 0);
        put(&store, "svgf-quarter", "1 path", r, 0.01, 1, 0);
        put(&store, "cache", "x0.5 1+1 rest 0.2", r, 0.08, 0.2, 0.75);
        put(&store, "cache", "x1 1+1 rest 0.2", r, 0.03, 1, 3.2);
    }
    const struct lw_measure_unit failed = {"cache", "x2 1+1 rest 0.2", 0};
    lw_support_ok(lw_measure_store_fail(&store, &failed, "lightwelld has ended", &err), &err);
    lw_measure_store_finish(&store);
    return folder;
}

static void ratios_are_those_of_the_tables(void **state) {
    (void)state;
    const char *folder = make_row("hand", 1);
    struct lw_measure_store store;
    struct lw_crossover_analysis a;
    struct lw_error err = {0};
    lw_support_ok(lw_measure_store_open(&store, folder, true, &err), &err);
    lw_support_ok(lw_crossover_analysis_init(&a, &store, &err), &err);
    assert_int_equal(a.point_count, 4);
    assert_true(a.late_error == 1);
    const struct lw_crossover_point *svgf = lw_crossover_analysis_find(&a, "svgf", NULL),
                                    *quarter = lw_crossover_analysis_find(&a, "svgf-quarter", NULL);
    const double error = svgf->mean[LW_MEASURE_COIN_RELMSE].value;
    assert_true(fabs(error - 0.04 * 1.55) < 1e-9);
    const struct lw_crossover_point *cache =
        lw_crossover_analysis_cheapest(&a, LW_MEASURE_COIN_RELMSE, error);
    assert_non_null(cache);
    assert_string_equal(cache->setting, "x1 1+1 rest 0.2");
    assert_null(lw_crossover_analysis_cheapest(&a, LW_MEASURE_COIN_RELMSE,
                                               quarter->mean[LW_MEASURE_COIN_RELMSE].value));
    /* paired: views cost both sides the same share more, so that nothing is left to chance */
    const struct lw_crossover_ratio ratio =
        lw_crossover_analysis_compare(cache, svgf, LW_MEASURE_COIN_RELMSE);
    assert_true(fabs(ratio.r1.value - 0.5) < 1e-9 && fabs(ratio.r1.low - 0.5) < 1e-9 &&
                fabs(ratio.r1.high - 0.5) < 1e-9);
    assert_true(fabs(ratio.error.value - 0.75) < 1e-9 && fabs(ratio.error.high - 0.75) < 1e-9);
    /* C1: views 0, 3, 6, 9, which cost 1.45 in the mean; A: all views, 2 * 1.55 */
    assert_true(fabs(ratio.m.value - (3.2 - 1.45) / 11 / 3.1) < 1e-9);
    assert_true(ratio.m.low < ratio.m.value && ratio.m.value < ratio.m.high);
    /* 6 CPU s of start over 60 s of 30 frames */
    assert_true(fabs(lw_crossover_analysis_session(cache, 60, 1) - (1.45 + 6.0 / 1800)) < 1e-9);
    assert_true(fabs(lw_crossover_analysis_session(cache, 60, 12) - (3.2 + 6.0 / 1800) / 12) < 1e-9);
    assert_true(fabs(lw_crossover_analysis_session(svgf, 10, 12) - (3.1 + 0.5 / 300)) < 1e-9);
    const double at = lw_crossover_analysis_crossing(&a, LW_MEASURE_COIN_RELMSE, error);
    /* from (0.29 s, 0.124) to (1.45 s, 0.0465), as far as 0.062 */
    assert_true(fabs(at - 0.29 * pow(5, log(2) / log(8.0 / 3))) < 1e-9);
    lw_crossover_analysis_finish(&a);
    lw_measure_store_finish(&store);
}

static char *report_of(const char *folder) {
    struct lw_measure_store store;
    struct lw_error err = {0};
    char path[300];
    size_t size;
    lw_support_ok(lw_measure_store_open(&store, folder, true, &err), &err);
    lw_support_ok(lw_crossover_report_write(&store, &err), &err);
    lw_measure_store_finish(&store);
    snprintf(path, sizeof path, "%s/report.md", folder);
    return (char *)lw_support_read_file(path, &size);
}

static void assert_says(const char *report, const char *text) {
    if (!strstr(report, text)) fail_msg("no \"%s\" in %s", text, report);
}

static void first_lines_say_the_opponents_own_error(void **state) {
    (void)state;
    char *report = report_of(make_row("report", 1));
    assert_says(report, "* at the error of svgf, relMSE 0.062: r(1) = 0.5");
    assert_says(
        report,
        "* at the error of svgf-quarter, relMSE 0.0155: **not reached**: the best is relMSE 0.0465 at "
        "x1 1+1 rest 0.2");
    assert_says(report, "* at the error of svgf, FLIP 0.31: r(1) = 0.5");
    assert_says(report, "| 0.02 | svgf-quarter, 1 path: 1.55 CPU s | not reached |");
    assert_says(report, "| cache, x2 1+1 rest 0.2 | 1 | lightwelld has ended |");
    assert_says(report, "are not judged: 2 5.");
    assert_null(strstr(report, "void"));
    free(report);
}

/* What all cost is of the frames after the step, what one costs of later ones. */
static void a_step_has_no_ratios(void **state) {
    (void)state;
    const char *folder = make_row("step", 1);
    struct lw_measure_store store;
    struct lw_error err = {0};
    lw_support_ok(lw_measure_store_open(&store, folder, false, &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "motion", "lamp-switch", &err), &err);
    lw_measure_store_finish(&store);
    char *report = report_of(folder);
    assert_says(report,
                "* at the error of svgf, relMSE 0.062: r(1) = –, m = – (x1 1+1 rest 0.2, relMSE 0.0465)");
    assert_says(report, "the best is relMSE 0.0465 at x1 1+1 rest 0.2 (error 3 (3 to 3) times its)");
    assert_says(report, "No r(1) and no m: what a step costs belongs to all users together");
    assert_says(report, ") | – | – | – |\n| svgf, 1 path");
    assert_says(report, "x1 1+1 rest 0.2: 1.45 CPU s | – | – |");
    assert_null(strstr(report, "of its cost"));
    free(report);
}

/* Light that is a second late must err by three times the target: 3 * 0.062 = 0.186. */
static void a_row_that_does_not_test_motion_is_void(void **state) {
    (void)state;
    char *report = report_of(make_row("void", 0.18));
    assert_says(report, "has relMSE 0.18");
    assert_says(report, "times the error of svgf (1 path): **void** there");
    assert_null(strstr(report, "times the error of svgf-quarter"));
    assert_says(report, "| 0.1 (void) |");
    assert_says(report, "| 0.02 |");
    free(report);
}

/* Nobody was alone with it. */
static void a_setting_without_a_cost_is_not_the_cheapest(void **state) {
    (void)state;
    struct lw_measure_store store;
    struct lw_crossover_analysis a;
    struct lw_error err = {0};
    lw_support_ok(lw_measure_store_open(&store, lw_support_temporary("costless"), false, &err), &err);
    put(&store, "cache", "x0.5 1+1 rest 0.2", 0, 0.01, (double)NAN, 3);
    put(&store, "cache", "x1 1+1 rest 0.2", 0, 0.02, 1, 3.2);
    put(&store, "raw", "1 path", 0, 0.01, (double)NAN, 0);
    lw_support_ok(lw_crossover_analysis_init(&a, &store, &err), &err);
    assert_int_equal(a.point_count, 3);
    const struct lw_crossover_point *cache = lw_crossover_analysis_cheapest(&a, LW_MEASURE_COIN_RELMSE, 1);
    assert_non_null(cache);
    assert_string_equal(cache->setting, "x1 1+1 rest 0.2");
    assert_null(lw_crossover_analysis_opponent(&a, LW_MEASURE_COIN_RELMSE, 1));
    lw_crossover_analysis_finish(&a);
    lw_measure_store_finish(&store);
}

static void settings_beyond_the_limit_are_left_out(void **state) {
    (void)state;
    struct lw_measure_store store;
    struct lw_crossover_analysis a;
    struct lw_error err = {0};
    const char *folder = lw_support_temporary("many");
    lw_support_ok(lw_measure_store_open(&store, folder, false, &err), &err);
    for (uint32_t i = 0; i < LW_CROSSOVER_POINTS_MAX + 2; i++) {
        char setting[LW_MEASURE_NAME_SIZE];
        snprintf(setting, sizeof setting, "%u paths", i + 1);
        put(&store, "raw", setting, 0, 1.0 / (i + 1), i + 1, 0);
    }
    lw_support_ok(lw_crossover_analysis_init(&a, &store, &err), &err);
    assert_int_equal(a.point_count, LW_CROSSOVER_POINTS_MAX);
    const struct lw_crossover_point *last = lw_crossover_analysis_find(&a, "raw", "64 paths");
    assert_non_null(last);
    assert_true(fabs(last->cost_s.value - 64 * 1.55) < 1e-9);
    assert_null(lw_crossover_analysis_find(&a, "raw", "65 paths"));
    lw_crossover_analysis_finish(&a);
    lw_measure_store_finish(&store);
    free(report_of(folder));
}

/* One line of the table for each renderer and setting, three columns for each measure. */
static void curves_and_plots_are_of_all_measures(void **state) {
    (void)state;
    const char *folder = make_row("curves", 1);
    free(report_of(folder));
    char *curves = lw_support_read_text(folder, "curves.csv"),
         *plots = lw_support_read_text(folder, "crossover.gp"),
         *report = lw_support_read_text(folder, "report.md");
    assert_says(curves, "renderer,setting,cpu_s,relmse,relmse_low,relmse_high,relmse_1e-4,");
    assert_says(curves, ",relmse_999,relmse_999_low,relmse_999_high,flip,flip_low,flip_high,flicker,");
    assert_says(curves, "svgf,1 path,3.1,0.062,0.0543333,0.0696667,0.08,0.08,0.08,0.02,0.02,0.02,0.31,");
    assert_says(plots, "set output 'relmse_1e-4.png'");
    assert_says(plots, "set output 'flip.png'\nplot 'curves.csv' skip 1 using "
                       "(strcol(1) eq 'svgf' ? $3 : NaN):13:14:15");
    assert_null(strstr(plots, "flicker.png")); /* nothing is known of it */
    assert_says(report, "](relmse_999.png)");
    assert_null(strstr(report, "](flicker.png)"));
    free(report);
    free(plots);
    free(curves);
}

static void the_wall_clock_is_a_table(void **state) {
    (void)state;
    const char *folder = make_row("clock", 1);
    struct lw_measure_store store;
    struct lw_error err = {0};
    char *report = report_of(folder);
    assert_null(strstr(report, "wall clock"));
    free(report);
    lw_support_ok(lw_measure_store_open(&store, folder, false, &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "clock svgf 1 path", "1.5,0.8,0.25,9", &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "clock cache x1 1+1 rest 0.2", "8,0.2,nan,0", &err), &err);
    lw_measure_store_finish(&store);
    report = report_of(folder);
    assert_says(report, "## By the wall clock");
    assert_says(report, "| svgf, 1 path | 1.5 | 0.8 | 0.25 | 9 |");
    assert_says(report, "| cache, x1 1+1 rest 0.2 | 8 | 0.2 | nan | 0 |");
    free(report);
}

static void a_row_that_cannot_be_measured_says_why(void **state) {
    (void)state;
    const char *folder = lw_support_temporary("refused");
    struct lw_measure_store store;
    struct lw_error err = {0};
    lw_support_ok(lw_measure_store_open(&store, folder, false, &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "scene", "builtin:hand", &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "motion", "sun-swing", &err), &err);
    lw_support_ok(lw_crossover_report_refuse(&store, "it has no sun", &err), &err);
    lw_measure_store_finish(&store);
    char *report = lw_support_read_text(folder, "report.md");
    assert_string_equal(report, "# Crossover: builtin:hand, sun-swing\n\n**Not measured:** it has no sun\n");
    free(report);
}

static void nothing_measured_is_said(void **state) {
    (void)state;
    struct lw_measure_store store;
    struct lw_error err = {0};
    lw_support_ok(lw_measure_store_open(&store, lw_support_temporary("nothing"), false, &err), &err);
    lw_support_fails(lw_crossover_report_write(&store, &err), LW_BAD_DATA, &err, "nothing is measured");
    lw_measure_store_finish(&store);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(ratios_are_those_of_the_tables),
                                       cmocka_unit_test(first_lines_say_the_opponents_own_error),
                                       cmocka_unit_test(a_row_that_does_not_test_motion_is_void),
                                       cmocka_unit_test(a_step_has_no_ratios),
                                       cmocka_unit_test(a_setting_without_a_cost_is_not_the_cheapest),
                                       cmocka_unit_test(settings_beyond_the_limit_are_left_out),
                                       cmocka_unit_test(curves_and_plots_are_of_all_measures),
                                       cmocka_unit_test(the_wall_clock_is_a_table),
                                       cmocka_unit_test(a_row_that_cannot_be_measured_says_why),
                                       cmocka_unit_test(nothing_measured_is_said)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
