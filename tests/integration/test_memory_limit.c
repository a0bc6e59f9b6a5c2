/* The real lightwelld where memory runs out: it says so, how much it had, and what to set. */
#include "tests/support/process.h"

#include "common/sanitizer.h"

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

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test_teardown(test_out_of_memory, lw_process_teardown)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
