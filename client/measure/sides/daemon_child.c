#include "client/measure/sides/daemon_child.h"

#include "common/clock.h"
#include "common/folders.h"
#include "common/program_path.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define LINE_MAX_BYTES 4096u
#define PATIENCE_S     600u /* for a frame, and for the solver's set-up before the first */
#define START_S        30u
#define STOP_NS        5000000000ull
#define POLL_MS        50

struct lw_daemon_child {
    pid_t pid;
    int to, from; /* its stdin and stdout */
    uint16_t port;
    char line[LINE_MAX_BYTES];
    size_t line_size;
    char port_file[PATH_MAX];
};

/* ---- starting ---- */

/* Its port comes by a file of its own. */
static enum lw_status make_port_file(struct lw_daemon_child *c, struct lw_error *err) {
    snprintf(c->port_file, sizeof c->port_file, "%s/lightwell-port-XXXXXX", lw_folders_temporary());
    int file = mkstemp(c->port_file);
    if (file < 0) {
        c->port_file[0] = 0;
        return lw_status_fail(err, LW_CANNOT_CREATE, "cannot create a temporary file: %s", strerror(errno));
    }
    close(file);
    return LW_OK;
}

/* In the child; what fails goes to `failure`. Only what signal handlers may call: other threads may hold any
 * lock. */
static _Noreturn void become(const char *program, char *const *arguments, int in, int out, int failure,
                             pid_t parent) {
    setpgid(0, 0); /* Ctrl-C is for our parent, who ends us when what is measured has been kept */
    prctl(PR_SET_PDEATHSIG, SIGTERM);  /* whatever ends it, if only SIGKILL */
    if (getppid() != parent) _exit(1); /* it ended before */
    /* what we say on stderr is for those who look for why we ended; sessions that come and go are not */
    const int null = open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (null >= 0 && dup2(in, STDIN_FILENO) >= 0 && dup2(out, STDOUT_FILENO) >= 0 &&
        dup2(null, STDERR_FILENO) >= 0)
        execvp(program, arguments);
    const int error = errno;
    (void)!write(failure, &error, sizeof error);
    _exit(1);
}

/* posix_spawn() cannot bind the child's life to ours. Returns errno, 0: it runs. The signal comes when the
 * thread that calls this ends. */
static int fork_and_exec(struct lw_daemon_child *c, const char *program, const char *const *arguments, int in,
                         int out) {
    int failure[2], error = 0;
    if (pipe2(failure, O_CLOEXEC) < 0) return errno;
    const pid_t parent = getpid(), pid = fork();
    if (pid == 0) become(program, (char *const *)arguments, in, out, failure[1], parent);
    if (pid < 0) error = errno;
    close(failure[1]);
    while (pid > 0 && read(failure[0], &error, sizeof error) < 0 && errno == EINTR) continue;
    close(failure[0]);
    if (pid > 0 && error) waitpid(pid, NULL, 0);
    c->pid = error ? 0 : pid;
    return error;
}

static enum lw_status spawn(struct lw_daemon_child *c, const struct lw_daemon_child_desc *desc,
                            struct lw_error *err) {
    char program[PATH_MAX], text[8][64];
    lw_program_path("lightwelld", program, sizeof program);
    snprintf(text[0], sizeof text[0], "%u", desc->bounces);
    snprintf(text[1], sizeof text[1], "%u", desc->direct_samples);
    snprintf(text[2], sizeof text[2], "%u", desc->indirect_samples);
    snprintf(text[3], sizeof text[3], "%u", desc->seed);
    snprintf(text[4], sizeof text[4], "%.9g", desc->target_error);
    snprintf(text[5], sizeof text[5], "%u", desc->threads);
    const char *arguments[40] = {program,
                                 desc->package,
                                 "--listen",
                                 "127.0.0.1:0",
                                 "--http",
                                 "none",
                                 "--cache",
                                 "", /* what it measures does not hang on earlier runs */
                                 "--port-file",
                                 c->port_file,
                                 "--clock",
                                 desc->real_clock ? "real" : "manual",
                                 "--first-light",
                                 "whole", /* what it measures is not a start */
                                 "--light",
                                 desc->seen ? "seen" : "whole",
                                 "--denoise",
                                 desc->denoise ? "on" : "off",
                                 "--bounces",
                                 text[0],
                                 "--direct-samples",
                                 text[1],
                                 "--indirect-samples",
                                 text[2],
                                 "--seed",
                                 text[3],
                                 "--error",
                                 text[4]};
    size_t count = 0;
    while (arguments[count]) count++;
    if (!desc->real_clock)
        arguments[count++] = "--json"; /* reports wait to be read: for those who step alone */
    if (desc->solver) arguments[count++] = "--solver", arguments[count++] = desc->solver;
    if (desc->threads) arguments[count++] = "--threads", arguments[count++] = text[5];
    int in[2], out[2];
    if (pipe2(in, O_CLOEXEC) < 0)
        return lw_status_fail(err, LW_OS, "cannot make a pipe: %s", strerror(errno));
    if (pipe2(out, O_CLOEXEC) < 0) {
        close(in[0]), close(in[1]);
        return lw_status_fail(err, LW_OS, "cannot make a pipe: %s", strerror(errno));
    }
    const int failed = fork_and_exec(c, program, arguments, in[0], out[1]);
    close(in[0]);
    close(out[1]);
    c->to = in[1];
    c->from = out[0];
    return failed ? lw_status_fail(err, LW_OS, "cannot start %.300s: %s", program, strerror(failed)) : LW_OK;
}

static bool has_ended(struct lw_daemon_child *c) {
    if (c->pid && waitpid(c->pid, NULL, WNOHANG) == c->pid) c->pid = 0;
    return c->pid == 0;
}

static enum lw_status await_port(struct lw_daemon_child *c, struct lw_error *err) {
    for (uint64_t end_ns = lw_clock_ns() + START_S * 1000000000ull; lw_clock_ns() < end_ns;) {
        FILE *file = fopen(c->port_file, "re");
        unsigned port = 0;
        if (file) {
            if (fscanf(file, "%u", &port) != 1) port = 0;
            fclose(file);
        }
        c->port = (uint16_t)port;
        if (port) return LW_OK;
        if (has_ended(c)) return lw_status_fail(err, LW_OS, "lightwelld ended before it served");
        nanosleep(&(struct timespec){.tv_nsec = POLL_MS * 1000000l}, NULL);
    }
    return lw_status_fail(err, LW_TIMED_OUT, "lightwelld does not serve after %u s", START_S);
}

enum lw_status lw_daemon_child_start(const struct lw_daemon_child_desc *desc,
                                     struct lw_daemon_child **out_child, struct lw_error *err) {
    struct lw_daemon_child *c = calloc(1, sizeof *c);
    if (!c) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a server");
    c->to = c->from = -1;
    signal(SIGPIPE, SIG_IGN); /* a server that is gone is told by the write's error */
    enum lw_status status = make_port_file(c, err);
    if (status == LW_OK) status = spawn(c, desc, err);
    if (status == LW_OK) status = await_port(c, err);
    if (status == LW_OK)
        *out_child = c;
    else
        lw_daemon_child_stop(c);
    return status;
}

uint16_t lw_daemon_child_port(const struct lw_daemon_child *c) { return c->port; }

/* ---- frames ---- */

/* The next line of its output, without the newline; NULL if there is none yet. */
static bool take_line(struct lw_daemon_child *c, char *out_line) {
    char *end = memchr(c->line, '\n', c->line_size);
    if (!end) return false;
    size_t size = (size_t)(end - c->line);
    memcpy(out_line, c->line, size);
    out_line[size] = 0;
    c->line_size -= size + 1;
    memmove(c->line, end + 1, c->line_size);
    return true;
}

static enum lw_status read_line(struct lw_daemon_child *c, char *out_line, struct lw_error *err) {
    for (uint64_t end_ns = lw_clock_ns() + PATIENCE_S * 1000000000ull; !take_line(c, out_line);) {
        struct pollfd wait = {.fd = c->from, .events = POLLIN};
        int ready = poll(&wait, 1, POLL_MS);
        if (lw_clock_ns() > end_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "lightwelld has not solved a frame in %u s", PATIENCE_S);
        if (ready <= 0) continue;
        if (c->line_size == sizeof c->line)
            return lw_status_fail(err, LW_PROTOCOL, "lightwelld reports a line of over %u bytes",
                                  LINE_MAX_BYTES);
        ssize_t size = read(c->from, c->line + c->line_size, sizeof c->line - c->line_size);
        if (size < 0 && errno == EINTR) continue;
        if (size <= 0) return lw_status_fail(err, LW_CLOSED, "lightwelld has ended");
        c->line_size += (size_t)size;
    }
    return LW_OK;
}

static bool number_of(const char *line, const char *key, double *out) {
    char quoted[40];
    snprintf(quoted, sizeof quoted, "\"%s\":", key);
    const char *at = strstr(line, quoted);
    if (at) *out = strtod(at + strlen(quoted), NULL);
    return at != NULL;
}

enum lw_status lw_daemon_child_step(struct lw_daemon_child *c, struct lw_daemon_report *out_report,
                                    struct lw_error *err) {
    char line[LINE_MAX_BYTES];
    if (write(c->to, "\n", 1) != 1) return lw_status_fail(err, LW_CLOSED, "lightwelld has ended");
    enum lw_status status = read_line(c, line, err);
    if (status != LW_OK) return status;
    enum { KEYS = 9 };
    static const char *const key[KEYS] = {"frame",          "published",   "solve_cpu_ms",
                                          "publish_cpu_ms", "loop_cpu_ms", "rays_total",
                                          "tiles_solved",   "tiles",       "texels_solved"};
    double value[KEYS];
    for (int k = 0; k < KEYS; k++)
        if (!number_of(line, key[k], &value[k]))
            return lw_status_fail(err, LW_PROTOCOL, "lightwelld reports no %s", key[k]);
    *out_report = (struct lw_daemon_report){.frame = (uint64_t)value[0],
                                            .published = (uint64_t)value[1],
                                            .solve_cpu_s = 1e-3 * value[2],
                                            .publish_cpu_s = 1e-3 * value[3],
                                            .loop_cpu_s = 1e-3 * value[4],
                                            .rays = value[5],
                                            .tiles_solved = (uint32_t)value[6],
                                            .tiles = (uint32_t)value[7],
                                            .texels_solved = (uint64_t)value[8]};
    return LW_OK;
}

double lw_daemon_child_cpu_s(const struct lw_daemon_child *c) {
    clockid_t clock;
    if (!c->pid || clock_getcpuclockid(c->pid, &clock) != 0) return 0;
    return 1e-9 * (double)lw_clock_read_ns(clock);
}

uint64_t lw_daemon_child_memory_bytes(const struct lw_daemon_child *c) {
    char path[64], line[256];
    unsigned long long kilobytes = 0;
    snprintf(path, sizeof path, "/proc/%ld/status", (long)c->pid);
    FILE *f = c->pid ? fopen(path, "re") : NULL;
    while (f && fgets(line, sizeof line, f))
        if (sscanf(line, "VmHWM: %llu kB", &kilobytes) == 1) break;
    if (f) fclose(f);
    return 1024 * (uint64_t)kilobytes;
}

/* ---- the end ---- */

void lw_daemon_child_stop(struct lw_daemon_child *c) {
    if (!c) return;
    if (c->to >= 0) close(c->to); /* the end of its stdin ends it; so does the signal, under the real clock */
    if (c->pid) kill(c->pid, SIGTERM);
    for (uint64_t end_ns = lw_clock_ns() + STOP_NS; !has_ended(c);) {
        if (lw_clock_ns() > end_ns) {
            kill(c->pid, SIGKILL);
            waitpid(c->pid, NULL, 0);
            break;
        }
        nanosleep(&(struct timespec){.tv_nsec = POLL_MS * 100000l}, NULL);
    }
    if (c->from >= 0) close(c->from);
    if (c->port_file[0]) unlink(c->port_file);
    free(c);
}
