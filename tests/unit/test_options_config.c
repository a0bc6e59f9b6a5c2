/* Options from a file, the environment and the command line: which counts, and errors. */
#include "tests/support/support.h"

#include "common/base/options_config.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static struct values {
    bool animate, freeze_given;
    const char *keep, *file;
    int64_t bounces, threads;
    double range, rate, freeze;
    float sky[3];
    int clock;
} values;
static struct lw_options_config config;
static const char *scene[1];
static bool done;
static struct lw_error err;

static const struct lw_option table[] = {
    {"animate", NULL, "Run.", LW_OPTION_FLAG, &values.animate, 0, 0, NULL},
    {"keep", "FOLDER", "Keep.", LW_OPTION_STRING, &values.keep, 0, 0, NULL},
    {"config", "FILE", "Read.", LW_OPTION_STRING, (void *)&config.path, 0, 0, NULL},
    {"bounces", "N", "Bounces.", LW_OPTION_INT, &values.bounces, 0, 16, NULL},
    {"threads", "N", "Threads.", LW_OPTION_INT, &values.threads, 1, 1024, NULL},
    {"tracing-range", "METRES", "Range.", LW_OPTION_REAL, &values.range, 0.01, (double)INFINITY, NULL},
    {"frame-rate", "HZ", "Rate.", LW_OPTION_REAL, &values.rate, 0.5, 240, NULL},
    {"freeze", "SECONDS", "Hold.", LW_OPTION_REAL, &values.freeze, 0, 1e9, &values.freeze_given},
    {"sky", "R,G,B", "Sky.", LW_OPTION_RGB, values.sky, 0, 100, NULL},
    {"clock", "real|step", "Time.", LW_OPTION_CHOICE, &values.clock, 0, 0, NULL},
};
static const struct lw_options options = {.program = "tester",
                                          .synopsis = "SCENE [OPTIONS]",
                                          .table = table,
                                          .count = sizeof table / sizeof *table,
                                          .positional = scene,
                                          .positional_min = 1,
                                          .positional_max = 1};
static const char *const command[] = {"config", NULL};
static const char *const foreign[] = {"token", NULL};

static enum lw_status parse(const char *line) {
    static char words[1024];
    char *argv[32] = {(char *)"tester"};
    int argc = 1;
    snprintf(words, sizeof words, "%s", line);
    for (char *word = strtok(words, " "); word; word = strtok(NULL, " ")) argv[argc++] = word;
    lw_options_config_finish(&config);
    values = (struct values){.bounces = 2, .range = (double)INFINITY, .rate = 30, .clock = 1};
    config = (struct lw_options_config){
        .prefix = "LWTEST", .positional = "scene", .command = command, .foreign = foreign};
    scene[0] = NULL;
    err = (struct lw_error){0};
    return lw_options_config_parse(&config, &options, argc, argv, &done, &err);
}

static const char *file_of(const char *text) {
    static char path[512];
    snprintf(path, sizeof path, "%s", lw_support_temporary("tester.conf"));
    lw_support_write_file(path, text, strlen(text));
    return path;
}

static enum lw_status parse_file(const char *text, const char *line) {
    char all[1024];
    snprintf(all, sizeof all, "--config %s %s", file_of(text), line);
    return parse(all);
}

static int clear(void **state) {
    (void)state;
    static const char *const names[] = {"LWTEST_BOUNCES", "LWTEST_FRAME_RATE", "LWTEST_SCENE",
                                        "LWTEST_CONFIG",  "LWTEST_BOUNCE",     "LWTEST_TOKEN",
                                        "LWTEST_",        "LWTESTX_A"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) unsetenv(names[i]);
    lw_options_config_finish(&config);
    return 0;
}

static void test_order(void **state) {
    (void)state;
    const char *file = "# a comment\nscene = a.glb\nbounces = 3 ; five\nframe-rate=5\n\nkeep = /var/a b;c\n"
                       "animate = yes\nsky = 1,2,0.5\nclock = real\ntracing-range = inf\n";
    lw_support_ok(parse_file(file, ""), &err);
    assert_string_equal(scene[0], "a.glb");
    assert_string_equal(values.keep, "/var/a b;c");
    assert_int_equal(values.bounces, 3);
    assert_true(values.rate == 5 && values.animate && values.clock == 0 && isinf(values.range));
    assert_true(values.sky[0] == 1 && values.sky[1] == 2 && values.sky[2] == 0.5f);
    setenv("LWTEST_BOUNCES", "4", 1);
    setenv("LWTEST_FRAME_RATE", "6", 1);
    setenv("LWTEST_SCENE", "b.glb", 1);
    setenv("LWTEST_TOKEN", "of a client", 1);
    setenv("LWTESTX_A", "of others", 1);
    lw_support_ok(parse_file(file, "--frame-rate 7"), &err);
    assert_int_equal(values.bounces, 4);
    assert_true(values.rate == 7);
    assert_string_equal(scene[0], "b.glb");
    lw_support_ok(parse_file(file, "--bounces 5 c.glb"), &err);
    assert_int_equal(values.bounces, 5);
    assert_string_equal(scene[0], "c.glb");
    setenv("LWTEST_CONFIG", file_of("bounces = 9\nkeep = x\n"), 1);
    lw_support_ok(parse(""), &err);
    assert_int_equal(values.bounces, 4);
    assert_string_equal(values.keep, "x");
}

static void refused(const char *text, const char *said) {
    char whole[1024];
    assert_int_equal(parse_file(text, "a.glb"), LW_USAGE);
    snprintf(whole, sizeof whole, "%s:%s", file_of(text), said);
    assert_string_equal(err.text, whole);
}

static void test_errors(void **state) {
    (void)state;
    refused("bounces = 2\nbounce = 3\n", "2: unknown key \"bounce\"; did you mean \"bounces\"?");
    refused("what-is-this = 3\n", "1: unknown key \"what-is-this\"; --help lists the options");
    refused("\nbounces = 17\n", "2: --bounces: \"17\" is not a whole number from 0 to 16");
    refused("animate = perhaps\n", "1: --animate: \"perhaps\" is neither true nor false");
    refused("bounces = 1\nkeep = a\nbounces = 2\n", "3: \"bounces\" twice; a line begins with its key");
    refused("keep = a\n   b\n", "2: \"keep\" twice; a line begins with its key");
    refused("[solver]\nbounces = 1\n", "2: there are no sections: [solver]");
    refused("bounces\n", "1: no line of the form KEY = VALUE, or too long");
    refused("config = a\n", "1: \"config\" is for the command line alone");
    assert_int_equal(parse("--config /nowhere/a.conf a.glb"), LW_NO_INPUT);
    assert_non_null(strstr(err.text, "/nowhere/a.conf: No such file"));
    assert_int_equal(parse_file("bounces = 1\n", ""), LW_USAGE);
    assert_non_null(strstr(err.text, "too few arguments; usage: tester SCENE [OPTIONS]"));
    assert_int_equal(parse("--bounce 3"), LW_USAGE);
    setenv("LWTEST_BOUNCE", "3", 1);
    assert_int_equal(parse("a.glb"), LW_USAGE);
    assert_string_equal(err.text,
                        "environment: LWTEST_BOUNCE: unknown key \"bounce\"; did you mean \"bounces\"?");
}

/* A line that is longer than libinih takes is no other line. */
static void test_long_lines(void **state) {
    (void)state;
    char text[600] = "keep = ";
    memset(text + 7, 'x', 191); /* 198, and the newline */
    text[198] = '\n';
    lw_support_ok(parse_file(text, "a.glb"), &err);
    assert_int_equal(strlen(values.keep), 191);
    memset(text + 7, 'x', 400);
    text[407] = '\n';
    assert_int_equal(parse_file(text, "a.glb"), LW_USAGE);
}

/* Printed options are read back as the same, and unset ones stay unset. */
static void test_print(void **state) {
    (void)state;
    lw_support_ok(parse("a.glb --sky 0.1,2,3 --frame-rate 29.97 --keep k --animate"), &err);
    char *text = lw_options_config_print(&config, &options), *again;
    assert_string_equal(text,
                        "scene = a.glb\nanimate = true\nkeep = k\nbounces = 2\n# threads =\n"
                        "tracing-range = inf\nframe-rate = 29.97\n# freeze =\nsky = 0.1,2,3\nclock = step\n");
    const struct values before = values;
    lw_support_ok(parse_file(text, ""), &err);
    again = lw_options_config_print(&config, &options);
    assert_string_equal(text, again);
    assert_true(values.rate == before.rate && !values.freeze_given && values.sky[0] == before.sky[0]);
    free(text);
    free(again);
}

static void differences_name_their_keys(void **state) {
    (void)state;
    char name[LW_OPTIONS_CONFIG_NAME_MAX];
    size_t at = 0;
    const char *before = "scene = a\n# keep =\nrate = 1\nanimate = true\n",
               *after = "scene = a\nkeep = here\nrate = 10\n# animate = false\n";
    assert_string_equal(lw_options_config_difference(before, after, &at, name), "keep");
    assert_string_equal(lw_options_config_difference(before, after, &at, name), "rate");
    assert_string_equal(lw_options_config_difference(before, after, &at, name), "animate");
    assert_null(lw_options_config_difference(before, after, &at, name));
    at = 0;
    assert_null(lw_options_config_difference(before, before, &at, name));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_order, clear),      cmocka_unit_test_teardown(test_errors, clear),
        cmocka_unit_test_teardown(test_long_lines, clear), cmocka_unit_test_teardown(test_print, clear),
        cmocka_unit_test(differences_name_their_keys),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
