/* Time is ours: clock_gettime is replaced, so hours pass in no time and the test never depends on the
 * machine. */
#include "tests/support/support.h"

#include "common/base/log.h"
#include "common/base/progress.h"

#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

static uint64_t now_ns;
int __wrap_clock_gettime(clockid_t clock, struct timespec *out);
int __wrap_clock_gettime(clockid_t clock, struct timespec *out) {
    (void)clock;
    *out =
        (struct timespec){.tv_sec = (time_t)(now_ns / 1000000000u), .tv_nsec = (long)(now_ns % 1000000000u)};
    return 0;
}
static void pass_ms(uint64_t ms) { now_ns += ms * 1000000u; }

static char text[1 << 16];
static int real_stderr, reading;

static int start(void **state) {
    (void)state;
    now_ns = 5000000000u;
    lw_log_init("tester", LW_LOG_INFO);
    real_stderr = dup(STDERR_FILENO);
    return 0;
}

static int capture_plain(void **state) {
    start(state);
    int ends[2];
    if (pipe2(ends, O_NONBLOCK)) return -1;
    dup2(ends[1], STDERR_FILENO);
    close(ends[1]);
    reading = ends[0];
    return 0;
}

static int capture_terminal(void **state) {
    start(state);
    reading = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (reading < 0 || grantpt(reading) || unlockpt(reading)) return -1;
    int terminal = open(ptsname(reading), O_RDWR | O_NOCTTY);
    struct winsize size = {.ws_row = 24, .ws_col = 60};
    if (terminal < 0 || ioctl(terminal, TIOCSWINSZ, &size)) return -1;
    dup2(terminal, STDERR_FILENO);
    close(terminal);
    return 0;
}

/* All that was shown since the last call. */
static const char *shown(void) {
    ssize_t size = read(reading, text, sizeof text - 1);
    text[size > 0 ? size : 0] = 0;
    return text;
}

static int end_capture(void **state) {
    (void)state;
    dup2(real_stderr, STDERR_FILENO);
    close(real_stderr);
    close(reading);
    return 0;
}

static void fast_work_is_quiet(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "packing", 10);
    for (int i = 0; i < 10; i++) {
        pass_ms(99);
        lw_progress_step(&p, 1);
    }
    lw_progress_finish(&p);
    assert_string_equal(shown(), "");
}

static void plain_lines_come_every_two_seconds(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "packing", 100);
    for (int i = 0; i < 100; i++) {
        pass_ms(100);
        lw_progress_step(&p, 1);
    }
    lw_progress_finish(&p);
    assert_string_equal(shown(), "tester: packing: 10 %, 9.0 s left\n"
                                 "tester: packing: 30 %, 7.0 s left\n"
                                 "tester: packing: 50 %, 5.0 s left\n"
                                 "tester: packing: 70 %, 3.0 s left\n"
                                 "tester: packing: 90 %, 1.0 s left\n"
                                 "tester: packing: done in 10 s\n");
}

/* The nearer one of two ends is reported. */
static void a_time_limit_is_an_end(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "baking", 100);
    p.limit_s = 60;
    pass_ms(4000);
    lw_progress_step(&p, 2);
    assert_string_equal(shown(), "tester: baking: 2 %, 56 s left by the time limit\n");
    pass_ms(26000);
    lw_progress_step(&p, 58);
    assert_string_equal(shown(), "tester: baking: 60 %, 20 s left\n");
    pass_ms(34000);
    lw_progress_step(&p, 0);
    assert_string_equal(shown(), "tester: baking: 60 %, 0.0 s left by the time limit\n");
    lw_progress_stop(&p);
    assert_string_equal(shown(), "tester: baking: stopped at 60 % after 64 s\n");
}

/* A stage that foretells its end: percent, time left and done are of one measure. */
static void a_stage_may_foretell_its_end(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "baking", 0);
    p.left_s = HUGE_VAL;
    pass_ms(2000);
    lw_progress_step(&p, 1);
    assert_string_equal(shown(), "tester: baking: 0 %, 2.0 s so far\n");
    p.left_s = 6;
    pass_ms(2000);
    lw_progress_step(&p, 1);
    assert_string_equal(shown(), "tester: baking: 40 %, 6.0 s left\n");
    p.left_s = 0.001;
    pass_ms(6000);
    lw_progress_step(&p, 1);
    assert_string_equal(shown(), "tester: baking: 99 %, 0.0 s left\n");
    lw_progress_finish(&p);
    assert_string_equal(shown(), "tester: baking: done in 10 s\n");
    lw_progress_init(&p, "baking", 0);
    p.left_s = 30;
    p.limit_s = 20;
    pass_ms(10000);
    lw_progress_step(&p, 1);
    assert_string_equal(shown(), "tester: baking: 25 %, 10 s left by the time limit\n");
    lw_progress_stop(&p);
    assert_string_equal(shown(), "tester: baking: stopped at 25 % after 10 s\n");
}

/* Where it cannot, its steps say how far it is, also when they become fewer. */
static void a_stage_may_count_what_it_cannot_foretell(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "baking", 403);
    p.unit = "tiles";
    p.left_s = HUGE_VAL;
    pass_ms(2000);
    lw_progress_set(&p, 398);
    assert_string_equal(shown(), "tester: baking: 398 of 403 tiles, 2.0 s so far\n");
    p.limit_s = 20;
    pass_ms(3000);
    lw_progress_set(&p, 397);
    assert_string_equal(shown(), "tester: baking: 397 of 403 tiles, 15 s left by the time limit\n");
    lw_progress_stop(&p);
    assert_string_equal(shown(), "tester: baking: stopped at 397 of 403 tiles after 5.0 s\n");
    p.left_s = 15;
    pass_ms(3000);
    lw_progress_set(&p, 399);
    assert_string_equal(shown(), "tester: baking: 35 %, 12 s left by the time limit\n");
}

static void long_times_change_their_unit(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "baking", 10);
    pass_ms(60000);
    lw_progress_step(&p, 1);
    assert_string_equal(shown(), "tester: baking: 10 %, 9 min left\n");
    pass_ms(10 * 3600 * 1000);
    lw_progress_finish(&p);
    assert_string_equal(shown(), "tester: baking: done in 10.0 h\n");
}

static void an_unknown_total_shows_the_count(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "reading", 0);
    pass_ms(3000);
    lw_progress_step(&p, 7);
    assert_string_equal(shown(), "tester: reading: 7 so far, 3.0 s\n");
    lw_progress_init(&p, "waiting", 5);
    pass_ms(3000);
    lw_progress_step(&p, 0);
    assert_string_equal(shown(), "tester: waiting: 0 %, 3.0 s so far\n");
}

static void more_steps_than_announced_stay_at_the_end(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "packing", 2);
    pass_ms(2000);
    lw_progress_step(&p, 9);
    assert_string_equal(shown(), "tester: packing: 100 %, 0.0 s left\n");
}

static void a_stage_that_is_stopped_is_not_done(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "baking", 100);
    lw_progress_step(&p, 12);
    pass_ms(30000);
    lw_progress_stop(&p);
    assert_string_equal(shown(), "tester: baking: stopped at 12 % after 30 s\n");
    lw_progress_init(&p, "baking", 1000);
    lw_progress_step(&p, 999);
    pass_ms(2000);
    lw_progress_stop(&p);
    assert_string_equal(shown(), "tester: baking: stopped at 99 % after 2.0 s\n");
    lw_progress_init(&p, "reading", 0);
    lw_progress_step(&p, 7);
    pass_ms(2000);
    lw_progress_stop(&p);
    assert_string_equal(shown(), "tester: reading: stopped at 7 after 2.0 s\n");
    lw_progress_init(&p, "packing", 2);
    pass_ms(999);
    lw_progress_stop(&p);
    assert_string_equal(shown(), "");
}

static void nothing_is_shown_before_somebody_waits(void **state) {
    (void)state;
    _Atomic bool wanted = false;
    struct lw_progress p;
    lw_progress_init(&p, "finishing", 10);
    p.wanted = &wanted;
    pass_ms(4000);
    lw_progress_step(&p, 4);
    lw_progress_finish(&p);
    lw_progress_stop(&p);
    assert_string_equal(shown(), "");
    wanted = true;
    lw_progress_step(&p, 1);
    assert_string_equal(shown(), "tester: finishing: 50 %, 4.0 s left\n");
    lw_progress_finish(&p);
    assert_string_equal(shown(), "tester: finishing: done in 4.0 s\n");
}

static void a_quiet_program_shows_none(void **state) {
    (void)state;
    lw_log_init("tester", LW_LOG_WARNING);
    struct lw_progress p;
    lw_progress_init(&p, "packing", 2);
    pass_ms(5000);
    lw_progress_step(&p, 1);
    lw_progress_finish(&p);
    assert_string_equal(shown(), "");
}

static void a_terminal_gets_a_bar_that_is_redrawn(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "packing", 100);
    for (int i = 0; i < 50; i++) {
        pass_ms(10);
        lw_progress_step(&p, 1);
    }
    assert_string_equal(shown(), "");
    pass_ms(500);
    lw_progress_step(&p, 0);
    const char *bar = shown();
    assert_memory_equal(bar, "\r\033[Kpacking  [", 13);
    assert_non_null(strstr(bar, "#....")); /* half and half */
    assert_non_null(strstr(bar, "] 50 %, 1.0 s left"));
    assert_null(strchr(bar, '\n'));
    assert_true(strlen(bar) - 4 < 60); /* the terminal's columns: no wrap */
    /* at most ten times a second */
    for (int i = 0; i < 10; i++) {
        pass_ms(9);
        lw_progress_step(&p, 1);
    }
    assert_string_equal(shown(), "");
    pass_ms(11);
    lw_progress_step(&p, 0);
    assert_non_null(strstr(shown(), "60 %"));
    lw_progress_finish(&p);
    assert_memory_equal(shown(), "\r\033[Ktester: packing: done in 1.1 s", 34);
}

static void a_narrow_terminal_loses_the_bar_not_the_line(void **state) {
    (void)state;
    struct winsize size = {.ws_row = 24, .ws_col = 20};
    assert_int_equal(ioctl(STDERR_FILENO, TIOCSWINSZ, &size), 0);
    struct lw_progress p;
    lw_progress_init(&p, "a stage with a long name", 100);
    pass_ms(2000);
    lw_progress_step(&p, 50);
    assert_string_equal(shown(), "\r\033[Ka stage with a long");
}

static void *step_often(void *p) {
    for (int i = 0; i < 1000; i++) lw_progress_step(p, 1);
    return NULL;
}

static void of_many_threads_one_shows(void **state) {
    (void)state;
    struct lw_progress p;
    lw_progress_init(&p, "packing", 4000);
    pass_ms(2000);
    pthread_t threads[4];
    for (int t = 0; t < 4; t++) pthread_create(&threads[t], NULL, step_often, &p);
    for (int t = 0; t < 4; t++) pthread_join(threads[t], NULL);
    shown();
    char *newline = strchr(text, '\n');
    assert_non_null(newline);
    assert_ptr_equal(newline, text + strlen(text) - 1); /* one line */
    assert_int_equal(p.done, 4000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define PLAIN(name)    cmocka_unit_test_setup_teardown(name, capture_plain, end_capture)
#define TERMINAL(name) cmocka_unit_test_setup_teardown(name, capture_terminal, end_capture)
        PLAIN(fast_work_is_quiet),
        PLAIN(plain_lines_come_every_two_seconds),
        PLAIN(a_time_limit_is_an_end),
        PLAIN(a_stage_may_foretell_its_end),
        PLAIN(a_stage_may_count_what_it_cannot_foretell),
        PLAIN(long_times_change_their_unit),
        PLAIN(an_unknown_total_shows_the_count),
        PLAIN(more_steps_than_announced_stay_at_the_end),
        PLAIN(a_stage_that_is_stopped_is_not_done),
        PLAIN(nothing_is_shown_before_somebody_waits),
        PLAIN(a_quiet_program_shows_none),
        TERMINAL(a_terminal_gets_a_bar_that_is_redrawn),
        TERMINAL(a_narrow_terminal_loses_the_bar_not_the_line),
        PLAIN(of_many_threads_one_shows),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
