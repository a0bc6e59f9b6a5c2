#include "tests/support/support.h"

#include "common/base/invariant.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

/* What builds of each level check. */
#undef LW_INVARIANT_LEVEL
#define LW_INVARIANT_LEVEL 2
static void check_all(int count) { LW_INVARIANT(count > 0); }
static const int line_of_all = __LINE__ - 1;
static void check_all_dear(int count) { LW_INVARIANT_DEAR(count > 0 && "a loop"); }
static const int line_of_all_dear = __LINE__ - 1;
#undef LW_INVARIANT_LEVEL
#define LW_INVARIANT_LEVEL 1
static void check_cheap(int count) { LW_INVARIANT(count > 0); }
static const int line_of_cheap = __LINE__ - 1;
static void check_cheap_dear(int count) { LW_INVARIANT_DEAR(count > 0); }
static void count_cheap(int *calls) {
    LW_INVARIANT(++*calls > 0);
    LW_INVARIANT_DEAR(++*calls > 0);
}
#undef LW_INVARIANT_LEVEL
#define LW_INVARIANT_LEVEL 0
static void check_none(int count) {
    LW_INVARIANT(count > 0);
    LW_INVARIANT_DEAR(count > 0);
}

/* Runs a check in a process of its own. Its status; out_said: its stderr. */
static int run(void (*check)(int), int count, char *out_said, size_t capacity) {
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    const pid_t child = fork();
    assert_true(child >= 0);
    if (!child) {
        setrlimit(RLIMIT_CORE, &(struct rlimit){0});
        signal(SIGABRT, SIG_DFL);
        dup2(ends[1], STDERR_FILENO);
        close(ends[0]);
        close(ends[1]);
        check(count);
        _exit(0);
    }
    close(ends[1]);
    size_t size = 0;
    for (ssize_t got; size + 1 < capacity && (got = read(ends[0], out_said + size, capacity - 1 - size)) > 0;)
        size += (size_t)got;
    out_said[size] = '\0';
    close(ends[0]);
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    return status;
}

static void assert_aborts(void (*check)(int), int line, const char *condition) {
    char said[500], expected[500];
    const int status = run(check, 0, said, sizeof said);
    assert_true(WIFSIGNALED(status));
    assert_int_equal(WTERMSIG(status), SIGABRT);
    snprintf(expected, sizeof expected, "%s:%d: broken invariant: %s\n", __FILE__, line, condition);
    assert_string_equal(said, expected);
}

static void assert_goes_on(void (*check)(int), int count) {
    char said[500];
    const int status = run(check, count, said, sizeof said);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    assert_string_equal(said, "");
}

static void test_a_broken_invariant_aborts_with_its_line(void **state) {
    (void)state;
    assert_aborts(check_all, line_of_all, "count > 0");
    assert_aborts(check_all_dear, line_of_all_dear, "count > 0 && \"a loop\"");
    assert_aborts(check_cheap, line_of_cheap, "count > 0");
}

static void test_one_that_holds_says_nothing(void **state) {
    (void)state;
    assert_goes_on(check_all, 1);
    assert_goes_on(check_all_dear, 1);
    assert_goes_on(check_cheap, 1);
}

static void test_levels_leave_out(void **state) {
    (void)state;
    int calls = 0;
    count_cheap(&calls);
    assert_int_equal(calls, 1); /* the cheap one, once */
    assert_goes_on(check_cheap_dear, 0);
    assert_goes_on(check_none, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_broken_invariant_aborts_with_its_line),
        cmocka_unit_test(test_one_that_holds_says_nothing),
        cmocka_unit_test(test_levels_leave_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
