#include "client/measure/sides/daemon_child.h"

#include "client/view/local_server.h"
#include "common/base/clock.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define LINE_MAX_BYTES 4096u
#define PATIENCE_S     600u /* for a frame, and for the solver's set-up before the first */
#define START_S        30u
#define POLL_MS        50

struct lw_daemon_child {
    struct lw_local_server local;
    int to, from; /* its stdin and stdout */
    uint16_t port;
    char line[LINE_MAX_BYTES];
    size_t line_size;
};

/* ---- starting ---- */

static void add_options(struct lw_local_server *l, const struct lw_daemon_child_desc *desc) {
    lw_local_server_option(l, "--cache", ""); /* figures do not depend on earlier runs */
    lw_local_server_option(l, "--clock", desc->real_clock ? "real" : "manual");
    lw_local_server_option(l, "--first-light", "whole"); /* no start is measured */
    lw_local_server_option(l, "--light", desc->seen ? "seen" : "whole");
    lw_local_server_option(l, "--denoise", desc->denoise ? "on" : "off");
    lw_local_server_number(l, "--bounces", desc->bounces);
    lw_local_server_number(l, "--direct-samples", desc->direct_samples);
    lw_local_server_number(l, "--indirect-samples", desc->indirect_samples);
    lw_local_server_number(l, "--seed", desc->seed);
    lw_local_server_number(l, "--error", desc->target_error);
    /* reports wait to be read: for those who step alone */
    if (!desc->real_clock) lw_local_server_option(l, "--json", NULL);
    if (desc->solver) lw_local_server_option(l, "--solver", desc->solver);
    if (desc->threads) lw_local_server_number(l, "--threads", desc->threads);
}

static enum lw_status spawn(struct lw_daemon_child *c, struct lw_error *err) {
    int in[2], out[2];
    if (pipe2(in, O_CLOEXEC) < 0)
        return lw_status_fail(err, LW_OS, "cannot make a pipe: %s", strerror(errno));
    if (pipe2(out, O_CLOEXEC) < 0) {
        close(in[0]), close(in[1]);
        return lw_status_fail(err, LW_OS, "cannot make a pipe: %s", strerror(errno));
    }
    /* our own stderr is for our own words; sessions that come and go are none */
    const int null = open("/dev/null", O_WRONLY | O_CLOEXEC);
    const enum lw_status status = lw_local_server_start(&c->local, in[0], out[1], null, err);
    if (null >= 0) close(null);
    close(in[0]);
    close(out[1]);
    c->to = in[1];
    c->from = out[0];
    return status;
}

static enum lw_status await_port(struct lw_daemon_child *c, struct lw_error *err) {
    for (uint64_t end_ns = lw_clock_ns() + START_S * 1000000000ull; lw_clock_ns() < end_ns;) {
        if ((c->port = lw_local_server_port(&c->local))) return LW_OK;
        if (lw_local_server_has_ended(&c->local))
            return lw_status_fail(err, LW_OS, "lightwelld ended before it served");
        nanosleep(&(struct timespec){.tv_nsec = POLL_MS * 1000000l}, NULL);
    }
    return lw_status_fail(err, LW_TIMED_OUT, "lightwelld does not serve after %u s", START_S);
}

enum lw_status lw_daemon_child_start(const struct lw_daemon_child_desc *desc,
                                     struct lw_daemon_child **out_child, struct lw_error *err) {
    struct lw_daemon_child *c = calloc(1, sizeof *c);
    if (!c) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a server");
    c->to = c->from = -1;
    signal(SIGPIPE, SIG_IGN); /* a server that is gone shows by the write's error */
    enum lw_status status = lw_local_server_init(&c->local, desc->package, err);
    if (status == LW_OK) {
        add_options(&c->local, desc);
        status = spawn(c, err);
    }
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
    if (!c->local.pid || clock_getcpuclockid(c->local.pid, &clock) != 0) return 0;
    return 1e-9 * (double)lw_clock_read_ns(clock);
}

uint64_t lw_daemon_child_memory_bytes(const struct lw_daemon_child *c) {
    char path[64], line[256];
    unsigned long long kilobytes = 0;
    snprintf(path, sizeof path, "/proc/%ld/status", (long)c->local.pid);
    FILE *f = c->local.pid ? fopen(path, "re") : NULL;
    while (f && fgets(line, sizeof line, f))
        if (sscanf(line, "VmHWM: %llu kB", &kilobytes) == 1) break;
    if (f) fclose(f);
    return 1024 * (uint64_t)kilobytes;
}

/* ---- the end ---- */

void lw_daemon_child_stop(struct lw_daemon_child *c) {
    if (!c) return;
    if (c->to >= 0) close(c->to); /* the end of its stdin ends it; so does the signal, under the real clock */
    lw_local_server_finish(&c->local);
    if (c->from >= 0) close(c->from);
    free(c);
}
