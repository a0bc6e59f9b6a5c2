/* fault_shim.c: a library for LD_PRELOAD under which the C library fails where the environment says so.
 *   FAULT_PROGRAM     of this program alone (its short name); others are left alone
 *   FAULT_ALLOCATION  the Nth allocation gives NULL, from 1 on
 *   FAULT_CONNECTION  one allocation of the main thread after each connection that it accepts gives NULL: of
 *                     the first connection the first, of each further one that many later than before. How
 *                     many there were until the next connection goes to stderr
 *   FAULT_CALLERS     who asked for the allocation that fails goes to stderr
 *   FAULT_KILL        at the Nth write to a regular file the process gets SIGKILL
 *   FAULT_WRITE       the Nth write to a regular file, and all after it, fail; with FAULT_ERRNO, or, where
 *                     that is 0, write one byte and no more
 *   FAULT_SIGNAL      at the Nth allocation the process gets SIGTERM
 *   FAULT_JOIN        pthread_timedjoin_np() has waited in vain at once
 *   FAULT_CLOCK       seconds by which the real clock jumps at the first connection
 *   FAULT_COUNT       both counts go to stderr when the process ends
 * Threads: [any]. */
#include <dlfcn.h>
#include <errno.h>
#include <execinfo.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *memory, size_t size);
void *__libc_memalign(size_t alignment, size_t size);

static _Atomic long allocations, writes;
static long failing_allocation, failing_write, killing_write, clock_jump_s, signalling_allocation;
static int write_errno;
static int joins_in_vain;
static _Atomic int ready;
static int tells_callers;
static long by_connection, connections, allocations_of_connection; /* the main thread's alone */
static _Atomic int has_accepted;

static long number_of(const char *name) {
    const char *text = getenv(name);
    return text ? strtol(text, NULL, 10) : 0;
}

static void tell(void) {
    char text[64];
    const int length = snprintf(text, sizeof text, "fault_shim: %ld %ld\n", allocations, writes);
    (void)!syscall(SYS_write, STDERR_FILENO, text, (size_t)length);
}

__attribute__((constructor)) static void begin(void) {
    const char *program = getenv("FAULT_PROGRAM");
    if (!program || strcmp(program, program_invocation_short_name) != 0) return;
    failing_allocation = number_of("FAULT_ALLOCATION");
    failing_write = number_of("FAULT_WRITE");
    write_errno = (int)number_of("FAULT_ERRNO");
    clock_jump_s = number_of("FAULT_CLOCK");
    signalling_allocation = number_of("FAULT_SIGNAL");
    killing_write = number_of("FAULT_KILL");
    joins_in_vain = getenv("FAULT_JOIN") != NULL;
    if (getenv("FAULT_COUNT")) atexit(tell);
    by_connection = number_of("FAULT_CONNECTION");
    tells_callers = getenv("FAULT_CALLERS") != NULL;
    void *caller;
    (void)backtrace(&caller, 1); /* the first call allocates */
    ready = 1;
}

/* ---- memory ---- */

/* A connection has failed: who visits need not wait for an answer. */
static int tell_failure(void) {
    static const char text[] = "fault_shim: failed\n";
    return syscall(SYS_write, STDERR_FILENO, text, sizeof text - 1) > 0;
}

static int tell_callers(void) {
    void *caller[32];
    if (tells_callers) backtrace_symbols_fd(caller, backtrace(caller, 32), STDERR_FILENO);
    return 1;
}

static int is_main(void) { return getpid() == syscall(SYS_gettid); }

static int fails(void) {
    if (!ready) return 0;
    if (by_connection)
        return connections && is_main() &&
               ++allocations_of_connection == (connections - 1) * by_connection + 1 && tell_failure() &&
               tell_callers();
    const long number = ++allocations;
    if (number == signalling_allocation) kill(getpid(), SIGTERM);
    return number == failing_allocation && tell_callers();
}

void *malloc(size_t size) { return fails() ? errno = ENOMEM, NULL : __libc_malloc(size); }
void *calloc(size_t count, size_t size) {
    return fails() ? errno = ENOMEM, NULL : __libc_calloc(count, size);
}
void *realloc(void *memory, size_t size) {
    return fails() ? errno = ENOMEM, NULL : __libc_realloc(memory, size);
}
void *aligned_alloc(size_t alignment, size_t size) {
    return fails() ? errno = ENOMEM, NULL : __libc_memalign(alignment, size);
}
int posix_memalign(void **out, size_t alignment, size_t size) {
    void *memory = fails() ? NULL : __libc_memalign(alignment, size);
    if (!memory) return ENOMEM;
    *out = memory;
    return 0;
}

/* ---- connections ---- */

int accept4(int listener, struct sockaddr *address, socklen_t *size, int flags) {
    const int fd = (int)syscall(SYS_accept4, listener, address, size, flags);
    if (fd >= 0) has_accepted = 1;
    if (fd < 0 || !by_connection || !is_main()) return fd;
    char text[64];
    const int length = snprintf(text, sizeof text, "fault_shim: connection %ld: %ld allocations\n",
                                connections, allocations_of_connection);
    if (connections) (void)!syscall(SYS_write, STDERR_FILENO, text, (size_t)length);
    connections++;
    allocations_of_connection = 0;
    return fd;
}

/* ---- files ---- */

static int is_file(int fd) {
    struct stat st;
    return fstat(fd, &st) == 0 && S_ISREG(st.st_mode);
}

/* 0: as ever. 1: it fails, errno is set. 2: it is cut short. */
static int write_fault(int fd) {
    if (!ready || fd <= STDERR_FILENO || !is_file(fd)) return 0;
    const long number = ++writes;
    if (number == killing_write) kill(getpid(), SIGKILL);
    if (!failing_write || number < failing_write) return 0;
    if (!write_errno) return 2;
    errno = write_errno;
    return 1;
}

ssize_t write(int fd, const void *bytes, size_t size) {
    const int fault = write_fault(fd);
    return fault == 1 ? -1 : syscall(SYS_write, fd, bytes, fault && size > 1 ? 1 : size);
}
ssize_t pwrite(int fd, const void *bytes, size_t size, off_t at) {
    const int fault = write_fault(fd);
    return fault == 1 ? -1 : syscall(SYS_pwrite64, fd, bytes, fault && size > 1 ? 1 : size, at);
}
ssize_t pwrite64(int fd, const void *bytes, size_t size, off_t at) { return pwrite(fd, bytes, size, at); }

/* ---- time ---- */

int clock_gettime(clockid_t clock, struct timespec *out) {
    const int result = (int)syscall(SYS_clock_gettime, clock, out);
    if (!result && clock == CLOCK_REALTIME && ready && has_accepted) out->tv_sec += clock_jump_s;
    return result;
}

int pthread_timedjoin_np(pthread_t thread, void **value, const struct timespec *until) {
    int (*real)(pthread_t, void **, const struct timespec *) = dlsym(RTLD_NEXT, "pthread_timedjoin_np");
    return ready && joins_in_vain ? ETIMEDOUT : real(thread, value, until);
}
