#include "common/base/progress.h"

#include "common/base/clock.h"
#include "common/base/log.h"

#include <inttypes.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define SECOND_NS       1000000000u
#define QUIET_NS        SECOND_NS        /* a stage shorter than this prints nothing */
#define BAR_EVERY_NS    (SECOND_NS / 10) /* redrawing faster only costs terminal time */
#define LINE_EVERY_NS   (2ull * SECOND_NS)
#define BAR_CELLS_MAX   40u
#define COLUMNS_UNKNOWN 80u

static unsigned terminal_columns(void) {
    struct winsize size;
    return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col ? size.ws_col : COLUMNS_UNKNOWN;
}

static void write_duration(char *out, size_t out_size, double seconds) {
    if (seconds < 10)
        snprintf(out, out_size, "%.1f s", seconds);
    else if (seconds < 100)
        snprintf(out, out_size, "%.0f s", seconds);
    else if (seconds < 100 * 60)
        snprintf(out, out_size, "%.0f min", seconds / 60);
    else
        snprintf(out, out_size, "%.1f h", seconds / 3600);
}

static bool foretells(const struct lw_progress *p) { return !isnan(p->left_s); }

/* Its steps say how far it is where it cannot foretell the end. */
static bool counts(const struct lw_progress *p) { return p->unit && p->total && isinf(p->left_s); }

/* 0 to 1. What a stage foretells is a share of time, and not all before its end. */
static double share_done(const struct lw_progress *p, uint64_t done, double elapsed_s) {
    if (foretells(p) && !isinf(p->left_s)) return fmin(0.99, elapsed_s / (elapsed_s + p->left_s));
    if (foretells(p) && !counts(p)) return 0;
    return (double)done / (double)p->total;
}

/* "43 %", or "397 of 403 tiles" */
static void write_share(char *out, size_t out_size, const struct lw_progress *p, uint64_t done,
                        double share) {
    if (counts(p))
        snprintf(out, out_size, "%" PRIu64 " of %" PRIu64 " %s", done, p->total, p->unit);
    else
        snprintf(out, out_size, "%.0f %%", 100 * share);
}

/* "43 %, 12 s left", or the count of steps and the time so far where the total is unknown. */
static void write_state(char *out, size_t out_size, const struct lw_progress *p, uint64_t done,
                        uint64_t elapsed_ns) {
    char time[32], far[64];
    const double elapsed_s = (double)elapsed_ns / SECOND_NS;
    if (!p->total && !foretells(p)) {
        write_duration(time, sizeof time, elapsed_s);
        snprintf(out, out_size, "%" PRIu64 " so far, %s", done, time);
        return;
    }
    const double share = share_done(p, done, elapsed_s);
    double left_s = foretells(p) ? p->left_s : share > 0 ? elapsed_s * (1 - share) / share : (double)INFINITY;
    const bool limited = p->limit_s > 0 && p->limit_s - elapsed_s < left_s && (share > 0 || foretells(p));
    if (limited) left_s = fmax(p->limit_s - elapsed_s, 0);
    write_duration(time, sizeof time, isinf(left_s) ? elapsed_s : left_s);
    write_share(far, sizeof far, p, done, share);
    if (isinf(left_s))
        snprintf(out, out_size, "%s, %s so far", far, time);
    else
        snprintf(out, out_size, "%s, %s left%s", far, time, limited ? " by the time limit" : "");
}

static bool is_wanted(const struct lw_progress *p) {
    return (!p->wanted || *p->wanted) && lw_log_shows(LW_LOG_INFO);
}

static void show_bar(const struct lw_progress *p, double share, const char *state) {
    unsigned columns = terminal_columns();
    size_t text =
        strlen(p->stage) + strlen(state) + sizeof "  [] "; /* the last column stays free: no line wrap */
    unsigned cells = text < columns ? columns - (unsigned)text : 0;
    if (cells > BAR_CELLS_MAX) cells = BAR_CELLS_MAX;
    if ((!p->total && !foretells(p)) || cells < 4) {
        fprintf(stderr, "\r\033[K%.*s", (int)columns - 1, p->stage);
        if (text < columns) fprintf(stderr, "  %s", state);
        return;
    }
    unsigned full = (unsigned)((double)cells * share);
    char bar[BAR_CELLS_MAX + 1];
    memset(bar, '#', full);
    memset(bar + full, '.', cells - full);
    bar[cells] = 0;
    fprintf(stderr, "\r\033[K%s  [%s] %s", p->stage, bar, state);
}

void lw_progress_init(struct lw_progress *p, const char *stage, uint64_t total) {
    p->stage = stage;
    p->total = total;
    p->started_ns = lw_clock_ns();
    atomic_init(&p->done, 0);
    atomic_init(&p->shown_ns, 0);
    p->left_s = (double)NAN;
    p->unit = NULL;
    p->limit_s = 0;
    p->wanted = NULL;
    p->waiting = NULL;
}

void lw_progress_init_waiting(struct lw_progress *p, const char *stage, uint64_t total,
                              struct lw_waiting *waiting, enum lw_waiting_stage waiting_stage) {
    lw_progress_init(p, stage, total);
    p->waiting = waiting;
    p->waiting_stage = waiting_stage;
    lw_waiting_raise(waiting, waiting_stage, 0, total);
}

static void show_when_due(struct lw_progress *p, uint64_t done) {
    if (!is_wanted(p)) return; /* first: the clock costs more */
    uint64_t now = lw_clock_ns(), elapsed = now - p->started_ns;
    if (elapsed < QUIET_NS) return;
    uint64_t shown = atomic_load_explicit(&p->shown_ns, memory_order_relaxed);
    bool bar = lw_log_is_drawn();
    /* another thread may have read the clock later and shown since: then shown > now */
    if (shown && (shown > now || now - shown < (bar ? BAR_EVERY_NS : LINE_EVERY_NS))) return;
    /* several threads may find it due: one shows */
    if (!atomic_compare_exchange_strong_explicit(&p->shown_ns, &shown, now, memory_order_relaxed,
                                                 memory_order_relaxed))
        return;
    if (p->total && done > p->total) done = p->total; /* more steps than announced: stay at 100 % */
    char state[96];
    write_state(state, sizeof state, p, done, elapsed);
    if (bar)
        show_bar(p, share_done(p, done, (double)elapsed / SECOND_NS), state);
    else
        lw_log(LW_LOG_INFO, "%s: %s", p->stage, state);
}

static void report(struct lw_progress *p, uint64_t done) {
    lw_waiting_raise(p->waiting, p->waiting_stage, done, p->total);
    show_when_due(p, done);
}

void lw_progress_step(struct lw_progress *p, uint64_t steps) {
    report(p, atomic_fetch_add_explicit(&p->done, steps, memory_order_relaxed) + steps);
}

void lw_progress_set(struct lw_progress *p, uint64_t done) {
    atomic_store_explicit(&p->done, done, memory_order_relaxed);
    report(p, done);
}

void lw_progress_finish(struct lw_progress *p) {
    uint64_t elapsed = lw_clock_ns() - p->started_ns;
    if (elapsed < QUIET_NS || !is_wanted(p)) return;
    char time[32];
    write_duration(time, sizeof time, (double)elapsed / SECOND_NS);
    lw_log(LW_LOG_INFO, "%s: done in %s", p->stage, time); /* wipes the bar */
}

void lw_progress_stop(struct lw_progress *p) {
    uint64_t elapsed = lw_clock_ns() - p->started_ns, done = p->done;
    if (elapsed < QUIET_NS || !is_wanted(p)) return;
    char time[32], far[64];
    write_duration(time, sizeof time, (double)elapsed / SECOND_NS);
    if (p->total || foretells(p)) { /* rounded down: 99.9 % is not all */
        const double share = fmin(1, share_done(p, done, (double)elapsed / SECOND_NS));
        write_share(far, sizeof far, p, done, 0.01 * floor(100 * share));
        lw_log(LW_LOG_INFO, "%s: stopped at %s after %s", p->stage, far, time);
    } else {
        lw_log(LW_LOG_INFO, "%s: stopped at %" PRIu64 " after %s", p->stage, done, time);
    }
}

void lw_progress_end(struct lw_progress *p, bool done) {
    if (done)
        lw_progress_finish(p);
    else
        lw_progress_stop(p);
}
