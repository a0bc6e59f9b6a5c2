/* The real lightwelld where memory runs out, or where light may not take all that it would: it says so, how
 * much it had, and what to set. */
#include "tests/support/process.h"

#include "common/base/sanitizer.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define SCENE                                                                                                \
    "builtin:cornell --texels-per-metre 140 --threads 1 --light whole --frames 1 --listen 127.0.0.1:0 "      \
    "--http none"

static int run_with(unsigned limit_mb, char **out_said) {
    struct lw_process daemon;
    struct rlimit before, limit;
    assert_int_equal(getrlimit(RLIMIT_AS, &before), 0);
    limit = before;
    limit.rlim_cur = (rlim_t)limit_mb << 20;
    assert_int_equal(setrlimit(RLIMIT_AS, &limit), 0);
    lw_process_start(&daemon, "lightwelld", SCENE);
    assert_int_equal(setrlimit(RLIMIT_AS, &before), 0);
    const int code = lw_process_finish(&daemon, LIMIT_S);
    *out_said = lw_process_err(&daemon);
    return code;
}

/* Whatever allocation it is that fails. */
static void test_out_of_memory(void **state) {
    (void)state;
    static const unsigned limits_mb[] = {250, 280, 300, 340};
    unsigned advised = 0;
    if (LW_SANITIZER) {
        print_message("skipped: a sanitizer needs address space without a limit\n");
        skip();
    }
    for (size_t i = 0; i < sizeof limits_mb / sizeof *limits_mb; i++) {
        char *said;
        const int code = run_with(limits_mb[i], &said);
        if (code != 71 || !strstr(said, "error: out of memory"))
            fail_msg("%u MB: %d: %s", limits_mb[i], code, said);
        advised += strstr(said, " texels and 32 triangles: fewer texels with --max-texels ") != NULL;
        free(said);
    }
    assert_int_equal(advised, sizeof limits_mb / sizeof *limits_mb);
}

#define CORNELL "builtin:cornell --http none --log-format text --texels-per-metre "
#define DENSE   CORNELL "140"

static void serve_with(const char *line, bool is_sparse) {
    struct lw_process daemon;
    lw_process_serve(&daemon, line);
    char *said = lw_process_err(&daemon);
    if ((strstr(said, "where nobody looks it is a quarter as dense") != NULL) != is_sparse)
        fail_msg("%s: %s", line, said);
    free(said);
    lw_process_end(&daemon);
}

static void serve_within(unsigned mb, bool is_sparse) {
    char line[300];
    snprintf(line, sizeof line, DENSE " --memory %u", mb);
    serve_with(line, is_sparse);
}

/* A refusal names the least with which there is light, and with that there is. With all that the light takes
 * it is whole. */
static void a_budget_is_kept_or_refused(void **state) {
    (void)state;
    const unsigned least = lw_process_needed_mb(DENSE), whole = lw_process_needed_mb(DENSE " --light whole");
    assert_true(least > 1 && least < whole);
    serve_within(least + 1, true);
    serve_within(whole + 1, false);
    struct lw_process daemon;
    char line[300];
    snprintf(line, sizeof line, DENSE " --listen 127.0.0.1:0 --light whole --memory %u", least + 1);
    lw_process_start(&daemon, "lightwelld", line);
    assert_int_equal(lw_process_finish(&daemon, LIMIT_S), 71);
    assert_true(lw_process_said(&daemon, "--light seen needs less"));
}

/* Light of over 2 GB is whole only if --memory says so. */
static void much_light_is_sparse(void **state) {
    (void)state;
    static const char much[] = CORNELL "700 --max-texels 100000000";
    assert_true(lw_process_needed_mb(CORNELL "700 --max-texels 100000000 --light whole") > 2000);
    serve_with(much, true);
    serve_with(DENSE, false);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_out_of_memory, lw_process_teardown),
        cmocka_unit_test_teardown(a_budget_is_kept_or_refused, lw_process_teardown),
        cmocka_unit_test_teardown(much_light_is_sparse, lw_process_teardown)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
