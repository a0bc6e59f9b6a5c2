/* The real lightwelld's options from a file and from the environment, and the file of its service. */
#include "tests/support/process.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT_S LW_PROCESS_LIMIT_S

static const char *file_of(const char *text) {
    static char path[512];
    snprintf(path, sizeof path, "%s", lw_support_temporary("lightwelld.conf"));
    lw_support_write_file(path, text, strlen(text));
    return path;
}

/* What it prints on stdout; it has to end with 0. */
static char *run(const char *arguments) {
    struct lw_process daemon;
    lw_process_run(&daemon, "lightwelld", arguments, 0);
    return lw_process_out(&daemon);
}

static void test_order(void **state) {
    (void)state;
    char line[1024];
    setenv("LIGHTWELL_FRAME_RATE", "7", 1);
    setenv("LIGHTWELL_SEED", "8", 1);
    setenv("LIGHTWELL_TOKEN", "which clients read", 1);
    snprintf(line, sizeof line, "--config %s --seed 9 --print-config",
             file_of("scene = builtin:cornell\nframe-rate = 5\nbounces = 3\nseed = 1\nsky = 0.1,0.2,0.3\n"));
    char *text = run(line);
    unsetenv("LIGHTWELL_FRAME_RATE");
    unsetenv("LIGHTWELL_SEED");
    unsetenv("LIGHTWELL_TOKEN");
    static const char *const has[] = {"scene = builtin:cornell\n", "\nframe-rate = 7\n",    "\nseed = 9\n",
                                      "\nbounces = 3\n",           "\nsky = 0.1,0.2,0.3\n", "\n# freeze =\n"};
    for (size_t i = 0; i < sizeof has / sizeof *has; i++)
        if (!strstr(text, has[i])) fail_msg("no %s in: %s", has[i], text);
    snprintf(line, sizeof line, "--config %s --print-config", file_of(text));
    char *again = run(line);
    assert_string_equal(text, again);
    free(text);
    free(again);
}

static void test_errors(void **state) {
    (void)state;
    char line[1024];
    snprintf(line, sizeof line, "--config %s --check-config",
             file_of("scene = builtin:cornell\nbounce = 3\n"));
    lw_process_refuses("lightwelld", line, 64,
                       "lightwelld.conf:2: unknown key \"bounce\"; did you mean \"bounces\"?", LIMIT_S);
    snprintf(line, sizeof line, "--config %s --check-config",
             file_of("scene = builtin:cornell\nsolver = none\n"));
    lw_process_refuses("lightwelld", line, 64, "--solver", LIMIT_S);
    lw_process_refuses("lightwelld", "--config /nowhere/lightwelld.conf", 66, "/nowhere/lightwelld.conf",
                       LIMIT_S);
    lw_process_refuses("lightwelld", "builtin:cornell --check-config --frame-budget-units 1000", 64,
                       "--clock real does not work with --frame-budget-units", LIMIT_S);
    setenv("LIGHTWELL_BOUNCE", "3", 1);
    lw_process_refuses("lightwelld", "builtin:cornell --check-config", 64,
                       "environment: LIGHTWELL_BOUNCE: unknown key \"bounce\"", LIMIT_S);
    unsetenv("LIGHTWELL_BOUNCE");
}

static void test_service_file(void **state) {
    (void)state;
    char line[1024];
    snprintf(line, sizeof line, "--config %s --check-config",
             lw_support_source("packaging/systemd/lightwelld.conf"));
    free(run(line));
}

/* It serves by what the file says. */
static void test_serves(void **state) {
    (void)state;
    struct lw_process daemon;
    char line[1024];
    snprintf(line, sizeof line, "--config %s",
             file_of("scene = builtin:cornell\ntexels-per-metre = 8\nhttp = none\nframes = 3\njson = true\n"
                     "light = whole\n"));
    lw_process_serve(&daemon, line);
    lw_process_expect(&daemon, lw_process_finish(&daemon, LIMIT_S), 0);
    assert_true(lw_process_newest(&daemon, "frame") == 3);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_order, lw_process_teardown),
        cmocka_unit_test_teardown(test_errors, lw_process_teardown),
        cmocka_unit_test_teardown(test_service_file, lw_process_teardown),
        cmocka_unit_test_teardown(test_serves, lw_process_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
