/* What signals do, in processes of their own. */
#include "tests/support/support.h"

#include "common/base/interrupt.h"
#include "common/base/log.h"

#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define LIMIT_MS 600000 /* ends what hangs */

/* The time, s, in the test's process and in its children: signals are as far apart as the test says, however
 * busy the machine is. */
/* Shared with children: the time, and how often they have read it. */
static volatile time_t *seconds, *readings;

int __wrap_clock_gettime(clockid_t clock, struct timespec *time);
int __wrap_clock_gettime(clockid_t clock, struct timespec *time) {
    (void)clock;
    *time = (struct timespec){.tv_sec = *seconds};
    *readings += 1;
    return 0;
}

static _Atomic int signalled;

static void on_signal(int number) { signalled = number; }

struct child {
    pid_t pid;
    int said; /* what it writes on stderr; first of all "ready" */
    char text[512];
    size_t size;
};

static void read_more(struct child *child) {
    struct pollfd end = {.fd = child->said, .events = POLLIN};
    assert_int_equal(poll(&end, 1, LIMIT_MS), 1);
    ssize_t got = read(child->said, child->text + child->size, sizeof child->text - 1 - child->size);
    assert_true(got >= 0);
    child->size += (size_t)got;
    child->text[child->size] = '\0';
}

/* A program that never looks at what its handler has set. */
static struct child start(const struct lw_interrupt_phase *first, const struct lw_interrupt_phase *then) {
    struct child child = {0};
    int ends[2];
    const pid_t parent = getpid();
    assert_int_equal(pipe(ends), 0);
    child.pid = fork();
    assert_true(child.pid >= 0);
    if (child.pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (getppid() != parent) _exit(1);
        dup2(ends[1], STDERR_FILENO);
        lw_log_init("tester", LW_LOG_INFO);
        lw_interrupt_watch(on_signal, first);
        if (then) lw_interrupt_enter(then);
        lw_log(LW_LOG_INFO, "ready");
        for (;;) {
        }
    }
    close(ends[1]);
    child.said = ends[0];
    while (!strchr(child.text, '\n')) read_more(&child);
    assert_string_equal(child.text, "tester: ready\n");
    child.text[child.size = 0] = '\0';
    return child;
}

/* How it ended: its exit code, or minus the signal. */
static int await_exit(struct child *child) {
    int status;
    for (size_t before = 1; before != child->size;) { /* to the end of the pipe */
        before = child->size;
        read_more(child);
    }
    assert_int_equal(waitpid(child->pid, &status, 0), child->pid);
    close(child->said);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

static void a_busy_program_answers_and_the_second_signal_ends_it(void **state) {
    (void)state;
    static const struct lw_interrupt_phase busy = {.answer = "stopping: a moment"};
    struct child child = start(&busy, NULL);
    kill(child.pid, SIGINT);
    while (!strchr(child.text, '\n')) read_more(&child);
    assert_string_equal(child.text, "tester: stopping: a moment\n");
    const time_t before = *readings;
    kill(child.pid, SIGINT); /* at once: counts as the first */
    LW_SUPPORT_WAIT_UNTIL(*readings != before);
    assert_int_equal(waitpid(child.pid, NULL, WNOHANG), 0);
    *seconds += 1;
    kill(child.pid, SIGTERM);
    assert_int_equal(await_exit(&child), -SIGTERM);
    assert_string_equal(child.text, "tester: stopping: a moment\n");
}

static void a_program_with_nothing_to_finish_ends_at_once(void **state) {
    (void)state;
    static const struct lw_interrupt_phase busy = {.answer = "stopping"};
    static const struct lw_interrupt_phase idle = {.answer = "stopped; nothing is written", .ends = true};
    const int signals[] = {SIGINT, SIGTERM};
    for (int i = 0; i < 2; i++) {
        struct child child = start(&busy, &idle);
        kill(child.pid, signals[i]);
        assert_int_equal(await_exit(&child), LW_INTERRUPT_EXIT_CODE);
        assert_string_equal(child.text, "tester: stopped; nothing is written\n");
    }
}

int main(void) {
    seconds = mmap(NULL, 2 * sizeof *seconds, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (seconds == MAP_FAILED) return 1;
    readings = seconds + 1;
    *seconds = 1;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_busy_program_answers_and_the_second_signal_ends_it),
        cmocka_unit_test(a_program_with_nothing_to_finish_ends_at_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
