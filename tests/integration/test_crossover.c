/* lightwell-load crossover with the real lightwelld, on the smallest scene and pictures. */
#include "tests/support/process.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define SMALL                                                                                                \
    "crossover builtin:cornell --texels-per-metre 8 --size 64x32 --reference-samples 8 --repeats 1 "         \
    "--warm 1 --seconds 0.1 --densities 1 --alone 1 "
/* One opponent, one path. */
#define SMALLEST SMALL "--opponents svgf --bounces 1 "

static int run(const char *arguments, struct lw_process *process) {
    lw_process_start(process, "lightwell-load", arguments);
    return lw_process_finish(process, LIMIT_S);
}

static unsigned count_lines(const char *text, const char *start) {
    unsigned count = 0;
    for (const char *line = text; *line; line = strchr(line, '\n') ? strchr(line, '\n') + 1 : "")
        count += strncmp(line, start, strlen(start)) == 0;
    return count;
}

/* Mean relMSE of the lines of samples.csv that begin so. */
static double mean_relmse(const char *samples, const char *start) {
    const char *header = strstr(samples, ",relmse,");
    unsigned column = 1, count = 0;
    double sum = 0;
    assert_non_null(header);
    for (const char *c = samples; c < header; c++) column += *c == ',';
    for (const char *line = samples; *line; line = strchr(line, '\n') ? strchr(line, '\n') + 1 : "") {
        if (strncmp(line, start, strlen(start)) != 0) continue;
        const char *at = line;
        for (unsigned i = 0; i < column; i++) at = strchr(at, ',') + 1;
        sum += atof(at);
        count++;
    }
    return count ? sum / count : 0;
}

static void measures_reports_and_goes_on(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("row");
    snprintf(arguments, sizeof arguments, SMALL "-o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 0);
    char *result = lw_process_out(&process);
    assert_non_null(strstr(result, "at the error of svgf, relMSE"));
    free(result);

    char *report = lw_support_read_text(folder, "report.md"),
         *costs = lw_support_read_text(folder, "costs.csv"),
         *samples = lw_support_read_text(folder, "samples.csv");
    assert_non_null(strstr(report, "* at the error of svgf-quarter, FLIP"));
    assert_non_null(strstr(report, "Light that is a second late has relMSE"));
    assert_non_null(strstr(report, "![Strips](strips.png)"));
    assert_null(strstr(report, "traced no ray"));
    /* twelve views and the line of all; the cache's one view alone, at each of two settings */
    assert_int_equal(count_lines(costs, "svgf,1 path,0,"), 13);
    assert_int_equal(count_lines(costs, "cache,x1 1+1 rest 0.2,0,"), 2);
    assert_int_equal(count_lines(samples, "svgf-quarter,1 path,0,"), 24);
    assert_int_equal(count_lines(samples, "cache,x1 1+2 rest 0.02,0,"), 24);
    free(samples);
    lw_process_left_nothing();

    /* the last line is torn off: that unit, and no other, is measured again */
    char path[300];
    snprintf(path, sizeof path, "%s/costs.csv", folder);
    lw_support_write_file(path, costs, strlen(costs) - 5);
    lw_process_expect(&process, run(arguments, &process), 0);
    char *said = lw_process_err(&process), *again = lw_support_read_text(folder, "costs.csv");
    assert_non_null(strstr(said, "repeat 1, cache, x1 1+2 rest 0.02:"));
    assert_null(strstr(said, "repeat 1, svgf"));
    assert_null(strstr(said, "repeat 1, cache, x1 1+1"));
    assert_int_equal(count_lines(again, "cache,x1 1+2 rest 0.02,0,"), 2);
    assert_int_equal(count_lines(again, "svgf,1 path,0,"), 13);
    free(said);

    /* from the tables alone */
    snprintf(path, sizeof path, "%s/report.md", folder);
    assert_int_equal(unlink(path), 0);
    snprintf(arguments, sizeof arguments, "crossover --report-only -o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 0);
    free(report);
    report = lw_support_read_text(folder, "report.md");
    assert_non_null(strstr(report, "lamp-walk"));
    free(report);
    free(again);
    free(costs);

    /* another row does not mix with it */
    snprintf(arguments, sizeof arguments, SMALL "--motion static -o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 64);
    said = lw_process_err(&process);
    assert_non_null(strstr(said, "holds a row whose motion is lamp-walk, not static"));
    free(said);
}

/* Users who draw by OpenGL join the row of those who draw by rays, and see the same light. */
static void users_of_opengl_join_the_row(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("opengl");
    snprintf(arguments, sizeof arguments, SMALL "-o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 0);
    snprintf(arguments, sizeof arguments, SMALL "--renderer gl -o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 0);
    assert_false(lw_process_said(&process, "repeat 1, svgf"));
    char *samples = lw_support_read_text(folder, "samples.csv");
    assert_int_equal(count_lines(samples, "cache,x1 1+1 rest 0.2 gl,0,"), 24);
    const double by_rays = mean_relmse(samples, "cache,x1 1+1 rest 0.2,0,"),
                 by_gl = mean_relmse(samples, "cache,x1 1+1 rest 0.2 gl,0,");
    if (!(by_rays > 0 && by_gl < 1.5 * by_rays && by_rays < 1.5 * by_gl))
        fail_msg("relMSE %g by rays, %g by OpenGL", by_rays, by_gl);
    free(samples);
    lw_process_left_nothing();
}

static void an_interruption_keeps_what_is_there(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("interrupted");
    snprintf(arguments, sizeof arguments, SMALLEST "-o %s", folder);
    lw_process_start(&process, "lightwell-load", arguments);
    lw_process_await_text(&process, "repeat 1, svgf, 1 path:");
    assert_int_equal(lw_process_stop(&process, SIGINT, LIMIT_S), 75);
    char *costs = lw_support_read_text(folder, "costs.csv");
    assert_int_equal(count_lines(costs, "svgf,1 path,0,"), 13);
    free(costs);
    lw_process_left_nothing();
}

/* The lightwelld that a process has started; 0: none. */
static pid_t server_of(pid_t parent) {
    DIR *folder = opendir("/proc");
    pid_t found = 0;
    for (struct dirent *entry; folder && !found && (entry = readdir(folder));) {
        char path[300], name[64] = "";
        long of = 0;
        snprintf(path, sizeof path, "/proc/%.200s/stat", entry->d_name);
        FILE *f = entry->d_name[0] >= '1' && entry->d_name[0] <= '9' ? fopen(path, "r") : NULL;
        if (f && fscanf(f, "%*d %63s %*c %ld", name, &of) == 2 && of == parent &&
            strcmp(name, "(lightwelld)") == 0)
            found = (pid_t)atol(entry->d_name);
        if (f) fclose(f);
    }
    if (folder) closedir(folder);
    return found;
}

struct server {
    pid_t parent, pid;
};

static bool has_server(void *context) {
    struct server *server = context;
    return (server->pid = server_of(server->parent)) != 0;
}

static void a_server_that_dies_is_reported_and_the_rest_measured(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("dies");
    snprintf(arguments, sizeof arguments, SMALL "-o %s", folder);
    lw_process_start(&process, "lightwell-load", arguments);
    struct server server = {.parent = process.pid};
    assert_true(lw_process_await(&process, has_server, &server));
    kill(server.pid, SIGKILL); /* the first setting's */
    assert_int_equal(lw_process_finish(&process, LIMIT_S) == 0, 0);
    char *said = lw_process_err(&process), *report = lw_support_read_text(folder, "report.md");
    assert_non_null(strstr(said, "cache, x1 1+1 rest 0.2: not measured: "));
    assert_non_null(strstr(said, "repeat 1, cache, x1 1+2 rest 0.02:"));
    assert_non_null(strstr(report, "## What failed"));
    assert_non_null(strstr(report, "| cache, x1 1+1 rest 0.2 | 1 | "));
    free(report);
    free(said);
    lw_process_expect(&process, run(arguments, &process), 0); /* and the next time it does not */
    report = lw_support_read_text(folder, "report.md");
    assert_null(strstr(report, "## What failed"));
    free(report);
}

static void a_scene_without_motion_is_a_report(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("sunless");
    snprintf(arguments, sizeof arguments, SMALLEST "--motion sun-swing -o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 65);
    char *said = lw_process_err(&process), *report = lw_support_read_text(folder, "report.md");
    assert_non_null(strstr(said, "it has no sun"));
    assert_non_null(strstr(report, "**Not measured:** "));
    assert_non_null(strstr(report, "it has no sun"));
    free(report);
    free(said);
}

/* How good it is depends on the machine; that each side is there, and is judged, does not. */
static void by_the_wall_clock_each_side_is_judged(void **state) {
    (void)state;
    struct lw_process process;
    char arguments[500];
    const char *folder = lw_support_temporary("clock");
    snprintf(arguments, sizeof arguments, SMALL "--real-clock -o %s", folder);
    lw_process_expect(&process, run(arguments, &process), 0);
    char *report = lw_support_read_text(folder, "report.md"), *row = lw_support_read_text(folder, "row.csv");
    const char *table = strstr(report, "## By the wall clock");
    assert_non_null(table);
    assert_non_null(strstr(table, "| svgf, 1 path | "));
    assert_non_null(strstr(table, "| svgf-quarter, 1 path | "));
    assert_non_null(strstr(table, "| cache, x1 1+"));
    assert_int_equal(count_lines(row, "clock "), 3);
    assert_null(strstr(row, "nan"));
    free(row);
    free(report);
}

static void fails_with_one_line(void **state) {
    (void)state;
    char arguments[500];
    static const struct {
        const char *scene, *folder, *text; /* folder: NULL is a good one */
        int code;
    } bad[] = {
        {"builtin:cornell", "/proc/nowhere", "cannot make the folder", 73},
        {"builtin:nothing", NULL, "builtin:nothing", 66},
        {"builtin:cornell --size 8x8", NULL, "--size", 64},
        {"--report-only", "/nowhere/at/all", "/nowhere/at/all", 66},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        snprintf(arguments, sizeof arguments, "crossover %s -o %s", bad[i].scene,
                 bad[i].folder ? bad[i].folder : lw_support_temporary("bad"));
        lw_process_refuses("lightwell-load", arguments, bad[i].code, bad[i].text, LIMIT_S);
    }
}

/* Each whole run takes seconds by the clock. With an argument: the long tests alone. */
int main(int argc, char **argv) {
    const struct CMUnitTest long_tests[] = {
        cmocka_unit_test_teardown(a_server_that_dies_is_reported_and_the_rest_measured, lw_process_teardown),
        cmocka_unit_test_teardown(by_the_wall_clock_each_side_is_judged, lw_process_teardown),
        cmocka_unit_test_teardown(users_of_opengl_join_the_row, lw_process_teardown),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(measures_reports_and_goes_on, lw_process_teardown),
        cmocka_unit_test_teardown(an_interruption_keeps_what_is_there, lw_process_teardown),
        cmocka_unit_test_teardown(a_scene_without_motion_is_a_report, lw_process_teardown),
        cmocka_unit_test_teardown(fails_with_one_line, lw_process_teardown),
    };
    (void)argv;
    if (argc > 1) return cmocka_run_group_tests(long_tests, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
