#include "server/import/guard.h"

#include "common/base/sanitizer.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#define STACK_SIZE 65536 /* the handler's: an overflow of the stack is one of the crashes */

#define GRACE_S 10 /* from the soft limit of all, which ends with a line, to the hard one */

enum { CRASHED, ABORTED, OVERDUE, ALL_OVERDUE, LINE_COUNT };
static const int watched[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGXCPU};
#define WATCHED_COUNT (sizeof watched / sizeof *watched)

/* A signal handler has no argument of ours: the one place where the program keeps a global. Its lines are
 * ready before anything can go wrong, because a handler may neither format nor allocate. */
static struct {
    char line[LINE_COUNT][LW_ERROR_TEXT_SIZE];
    size_t length[LINE_COUNT];
    int fd;
    int memory_fd;        /* /proc/self/statm; 0: not open */
    bool reader_is_bound; /* the next SIGXCPU is for the reader, not for the process */
    struct sigaction before[WATCHED_COUNT];
    struct rlimit processor_before, memory_before;
    stack_t stack_before;
    _Alignas(16) char stack[STACK_SIZE];
} guard;

static void end(int number) {
    int which = number == SIGXCPU   ? guard.reader_is_bound ? OVERDUE : ALL_OVERDUE
                : number == SIGABRT ? ABORTED
                                    : CRASHED;
    ssize_t ignored = write(guard.fd, guard.line[which], guard.length[which]);
    (void)ignored;
    _exit(lw_status_exit_code(LW_BAD_DATA));
}

/* "court.fbx: the FBX reader WHAT", as a program's last line or as the text for the one that started it. */
static void prepare(const struct lw_guard_desc *desc, int which, const char *what) {
    bool to_person = desc->failure_fd == 0;
    const char *clear =
        to_person && isatty(STDERR_FILENO) ? "\r\033[K" : ""; /* a progress line may stand there */
    char text[LW_ERROR_TEXT_SIZE - 64];
    snprintf(text, sizeof text, "%.200s: %s%s%s", desc->scene, desc->reader ? desc->reader : "",
             desc->reader ? " " : "", what);
    lw_status_one_line(text);
    snprintf(guard.line[which], sizeof guard.line[which], "%s%s%s%s", clear,
             to_person ? "lightwell-import: error: " : "", text, to_person ? "\n" : "");
    guard.length[which] = strlen(guard.line[which]);
}

static double processor_time_s(void) {
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
           1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

int lw_guard_prepare(void) {
    const int fd = guard.memory_fd ? guard.memory_fd : open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    guard.memory_fd = fd > 0 ? fd : 0;
    return guard.memory_fd;
}

static uint64_t address_space_bytes(void) {
    char text[256] = "";
    if (!lw_guard_prepare() || pread(guard.memory_fd, text, sizeof text - 1, 0) <= 0) return 0;
    return strtoull(text, NULL, 10) * (uint64_t)sysconf(_SC_PAGESIZE);
}

/* Lowers the soft limit alone, so that leave() may raise it again. */
static void limit(int resource, struct rlimit *before, rlim_t most) {
    getrlimit(resource, before);
    struct rlimit now = *before;
    if (now.rlim_cur == RLIM_INFINITY || most < now.rlim_cur) now.rlim_cur = most;
    setrlimit(resource, &now);
}

void lw_guard_bound(const struct lw_guard_desc *desc) {
    struct rlimit now;
    char overdue[160];
    guard.fd = desc->failure_fd ? desc->failure_fd : STDERR_FILENO;
    snprintf(
        overdue, sizeof overdue,
        "importing it took more than %.0f s of processor time, so it was stopped; --import-seconds gives "
        "it more",
        desc->processor_s);
    prepare(desc, ALL_OVERDUE, overdue);
    sigaction(SIGXCPU, &(struct sigaction){.sa_handler = end}, NULL);
    getrlimit(RLIMIT_CPU, &now);
    const rlim_t most = (rlim_t)(processor_time_s() + desc->processor_s + 1);
    if (now.rlim_max > most + GRACE_S) now.rlim_max = most + GRACE_S;
    now.rlim_cur = most < now.rlim_max ? most : now.rlim_max;
    setrlimit(RLIMIT_CPU, &now);
}

void lw_guard_enter(const struct lw_guard_desc *desc) {
    guard.fd = desc->failure_fd ? desc->failure_fd : STDERR_FILENO;
    char overdue[128];
    snprintf(overdue, sizeof overdue,
             "took more than %.0f s of processor time, so it was stopped; --read-seconds gives it more",
             desc->processor_s);
    prepare(desc, CRASHED, "crashed on it: the file is broken, or hits a bug there");
    prepare(desc, ABORTED, "gave up on it: the file is broken, or needs too much memory");
    prepare(desc, OVERDUE, overdue);
    const stack_t stack = {.ss_sp = guard.stack, .ss_size = sizeof guard.stack};
    sigaltstack(&stack, &guard.stack_before);
    for (size_t i = 0; i < WATCHED_COUNT; i++) {
        struct sigaction action = {.sa_handler = end, .sa_flags = SA_ONSTACK};
        sigfillset(&action.sa_mask);
        if (LW_SANITIZER && watched[i] != SIGXCPU)
            sigaction(watched[i], NULL, &guard.before[i]);
        else
            sigaction(watched[i], &action, &guard.before[i]);
    }
    getrlimit(RLIMIT_CPU, &guard.processor_before);
    getrlimit(RLIMIT_AS, &guard.memory_before);
    const rlim_t most = (rlim_t)(processor_time_s() + desc->processor_s + 1);
    guard.reader_is_bound = desc->processor_s > 0 && most < guard.processor_before.rlim_cur;
    if (guard.reader_is_bound) limit(RLIMIT_CPU, &guard.processor_before, most);
    if (desc->memory_bytes && !LW_SANITIZER)
        limit(RLIMIT_AS, &guard.memory_before, address_space_bytes() + desc->memory_bytes);
}

void lw_guard_lift(void) {
    setrlimit(RLIMIT_AS, &guard.memory_before);
    setrlimit(RLIMIT_CPU, &guard.processor_before);
    guard.reader_is_bound = false;
}

void lw_guard_leave(void) {
    lw_guard_lift();
    for (size_t i = 0; i < WATCHED_COUNT; i++) sigaction(watched[i], &guard.before[i], NULL);
    sigaltstack(&guard.stack_before, NULL);
}
