#include "client/load/load_test.h"

#include "client/load/load_series.h"
#include "common/base/clock.h"
#include "common/base/random.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#define TICK_MS 50u
#define LAG_MS  10u
#define SHOW_MS 1000u
/* file descriptors needed besides one per user: the loop's own, files, sessions that are about to close */
#define DESCRIPTORS 64u

/* Totals at a moment; the measured time lies between two of them. */
struct totals {
    uint64_t at_ns, bytes, tiles, frames, settled, heard, own_cpu_ns;
    int64_t own_wait_ns; /* below 0: not known */
};

struct load_test {
    uv_loop_t loop;
    uv_timer_t tick, lag, show, sample;
    uv_signal_t interrupt, terminate;
    const struct lw_load_options *options;
    struct lw_load_scene scene;
    struct lw_load_shared shared;
    struct lw_load_report *report;
    struct lw_load_series *series; /* NULL: none is written */
    uint64_t began_ns, ticked_ns, lagged_ns;
    uint32_t begun;   /* users of the ramp that have begun to connect */
    uint32_t number;  /* the last session's */
    uint64_t churned; /* users that were made to leave */
    bool over;
    struct totals from;
    struct totals shown; /* at the last line of progress */
};

/* ---- what we cost ---- */

/* Time that this thread was ready to run and did not: the second number of the kernel's schedstat. */
static int64_t read_wait_ns(void) {
    char text[96];
    int64_t wait_ns = -1;
    int descriptor = open("/proc/thread-self/schedstat", O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) return -1;
    ssize_t size = read(descriptor, text, sizeof text - 1);
    close(descriptor);
    if (size <= 0) return -1;
    text[size] = '\0';
    return sscanf(text, "%*s %" SCNd64, &wait_ns) == 1 ? wait_ns : -1;
}

static struct totals total(const struct load_test *s, uint64_t now_ns) {
    const struct lw_load_figures *f = &s->report->figures;
    return (struct totals){.at_ns = now_ns,
                           .bytes = f->bytes,
                           .tiles = f->tiles,
                           .frames = f->frames,
                           .settled = f->settled,
                           .heard = s->shared.heard_before + s->shared.clock.count,
                           .own_cpu_ns = lw_clock_process_cpu_ns(),
                           .own_wait_ns = read_wait_ns()};
}

/* ---- the measured time ---- */

static void begin_measuring(struct load_test *s, uint64_t now_ns) {
    s->from = s->shown = total(s, now_ns);
    s->shared.measured_from_ns = now_ns;
    s->report->figures.measuring = true;
}

/* The server's CPU time comes with frames only: from the last one before the measured time, if there was one,
 * to the last one in it. */
static void report_server(struct load_test *s) {
    const struct lw_frame_clock *clock = &s->shared.clock;
    if (clock->count < 2 || s->shared.heard_before) return; /* a clock of one run of the server */
    const struct lw_frame_clock_entry *first, *last;
    first = lw_frame_clock_at(clock, s->from.heard ? s->from.heard - 1 : 0);
    last = lw_frame_clock_at(clock, clock->count - 1);
    if (!first || first == last || !first->server_cpu_ns || last->server_cpu_ns < first->server_cpu_ns)
        return;
    s->report->server_cpu_s = 1e-9 * (double)(last->server_cpu_ns - first->server_cpu_ns);
    s->report->server_wall_s = 1e-9 * (double)(last->heard_ns - first->heard_ns);
}

static void end_measuring(struct load_test *s, uint64_t now_ns) {
    struct lw_load_report *r = s->report;
    struct totals to = total(s, now_ns);
    for (struct lw_load_session *u = s->shared.first; u; u = lw_load_session_next(u)) {
        lw_load_session_conclude(u, now_ns);
        r->users_at_end += lw_load_session_is_streaming(u);
    }
    if (r->figures.measuring) {
        r->measured_s = 1e-9 * (double)(now_ns - s->from.at_ns);
        r->bytes = to.bytes - s->from.bytes;
        r->tiles = to.tiles - s->from.tiles;
        r->frames = to.frames - s->from.frames;
        r->settled = to.settled - s->from.settled;
        r->frames_heard = to.heard - s->from.heard;
        r->own_cpu_s = 1e-9 * (double)(to.own_cpu_ns - s->from.own_cpu_ns);
        bool known = to.own_wait_ns >= 0 && s->from.own_wait_ns >= 0;
        r->own_wait_s = known ? 1e-9 * (double)(to.own_wait_ns - s->from.own_wait_ns) : -1;
        report_server(s);
    }
    r->figures.measuring = false;
    r->run_s = 1e-9 * (double)(now_ns - s->began_ns);
    r->tiles_decoded = lw_tile_check_decoded(s->shared.check);
    struct rusage usage;
    if (getrusage(RUSAGE_SELF, &usage) == 0) r->own_memory_bytes = (uint64_t)usage.ru_maxrss * 1024;
}

static void end_test(struct load_test *s, enum lw_load_end end) {
    if (s->over) return;
    s->over = true;
    s->report->end = end;
    end_measuring(s, lw_clock_ns());
    uv_stop(&s->loop);
}

/* ---- who comes and goes ---- */

static void start_session(struct load_test *s, enum lw_load_reader reader) {
    /* a session that cannot start is counted; the run goes on without it */
    (void)!lw_load_session_start(&s->shared, ++s->number, reader);
}

/* The odd readers are spread evenly over the ramp. */
static enum lw_load_reader reader_of(const struct lw_load_options *o, uint32_t user) {
    uint64_t before = (uint64_t)user * o->odd_readers / o->users,
             after = ((uint64_t)user + 1) * o->odd_readers / o->users;
    return after > before ? o->reader : LW_LOAD_FAST;
}

static void ramp(struct load_test *s, double elapsed_s) {
    double due = s->options->ramp_hz * elapsed_s + 1;
    while (s->begun < s->options->users && (double)s->begun < due)
        start_session(s, reader_of(s->options, s->begun++));
}

static struct lw_load_session *pick_user(struct load_test *s) {
    uint32_t index = lw_random_hash2((uint32_t)s->options->seed, (uint32_t)s->churned) % s->shared.live_count;
    for (struct lw_load_session *u = s->shared.first; u; u = lw_load_session_next(u))
        if (lw_load_session_is_live(u) && index-- == 0) return u;
    return NULL;
}

static void churn(struct load_test *s, double measured_s) {
    for (; (double)s->churned < s->options->churn_hz * measured_s && s->shared.live_count; s->churned++) {
        struct lw_load_session *user = pick_user(s);
        enum lw_load_reader reader = lw_load_session_reader(user);
        lw_load_session_leave(user, s->churned % 2 == 0);
        start_session(s, reader);
    }
}

static void tick_sessions(struct load_test *s, uint64_t now_ns, double since_s) {
    uint32_t streaming = 0;
    for (struct lw_load_session *u = s->shared.first, *next; u; u = next) {
        next = lw_load_session_next(u); /* ticking may close it */
        streaming += lw_load_session_is_streaming(u);
        lw_load_session_tick(u, now_ns);
    }
    if (s->report->figures.measuring) s->report->user_s += streaming * since_s;
}

static void on_tick(uv_timer_t *timer) {
    struct load_test *s = timer->data;
    const struct lw_load_figures *f = &s->report->figures;
    uint64_t now_ns = lw_clock_ns();
    tick_sessions(s, now_ns, 1e-9 * (double)(now_ns - s->ticked_ns));
    lw_load_session_return_due(&s->shared, now_ns);
    s->ticked_ns = now_ns;
    ramp(s, 1e-9 * (double)(now_ns - s->began_ns));
    if (s->shared.other_scene) {
        end_test(s, LW_LOAD_END_OTHER_SCENE);
        return;
    }
    bool all_begun = s->begun == s->options->users;
    if (all_begun && !f->measuring) begin_measuring(s, now_ns);
    if (s->shared.live_count == 0 && !s->shared.returning && (all_begun || f->lost)) {
        end_test(s, f->lost || f->refused ? LW_LOAD_END_SERVER_GONE : LW_LOAD_END_NOBODY_LEFT);
        return;
    }
    if (!f->measuring) return;
    double measured_s = 1e-9 * (double)(now_ns - s->from.at_ns);
    if (measured_s >= s->options->seconds)
        end_test(s, LW_LOAD_END_TIME);
    else
        churn(s, measured_s);
}

/* ---- our own delays, progress, signals ---- */

static void on_lag(uv_timer_t *timer) {
    struct load_test *s = timer->data;
    uint64_t now_ns = lw_clock_ns(), due_ns = s->lagged_ns + LAG_MS * 1000000u;
    if (s->report->figures.measuring)
        lw_histogram_add(&s->report->lag, now_ns > due_ns ? now_ns - due_ns : 0);
    s->lagged_ns = now_ns;
}

static void on_show(uv_timer_t *timer) {
    struct load_test *s = timer->data;
    const struct lw_load_figures *f = &s->report->figures;
    struct totals now = total(s, lw_clock_ns());
    double since_s = 1e-9 * (double)(now.at_ns - s->shown.at_ns),
           users = s->shared.live_count ? s->shared.live_count : 1;
    uint64_t errors = 0;
    for (int i = 0; i < LW_LOAD_FAULT_COUNT; i++) errors += f->fault[i];
    fprintf(stderr,
            "\r%4.0f s  %u users  %.3g frames/s each  %.4g Mbit/s  update p99 %.3g ms  %" PRIu64
            " errors  own CPU %.0f %% \033[K",
            1e-9 * (double)(now.at_ns - s->began_ns), s->shared.live_count,
            (double)(now.frames - s->shown.frames) / since_s / users,
            8e-6 * (double)(now.bytes - s->shown.bytes) / since_s,
            1e-6 * (double)lw_histogram_quantile(&f->update, 0.99), errors,
            100e-9 * (double)(now.own_cpu_ns - s->shown.own_cpu_ns) / since_s);
    s->shown = now;
}

static void on_sample(uv_timer_t *timer) {
    struct load_test *s = timer->data;
    lw_load_series_add(s->series, &s->shared, lw_clock_ns());
}

static void on_signal(uv_signal_t *handle, int number) {
    struct load_test *s = handle->data;
    (void)number;
    /* without a watcher the next signal has its default effect: a second Ctrl-C ends the program at once */
    uv_signal_stop(&s->interrupt);
    uv_signal_stop(&s->terminate);
    end_test(s, LW_LOAD_END_INTERRUPTED);
}

/* ---- the whole run ---- */

/* Every user is a descriptor. */
static enum lw_status raise_descriptor_limit(uint32_t users, struct lw_error *err) {
    struct rlimit limit;
    rlim_t needed = users + DESCRIPTORS;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= needed) return LW_OK;
    rlim_t allowed = limit.rlim_max;
    limit.rlim_cur = needed < allowed ? needed : allowed;
    if (needed > allowed || setrlimit(RLIMIT_NOFILE, &limit) != 0)
        return lw_status_fail(
            err, LW_OS,
            "%u users need %llu open files and the limit is %llu: raise it (ulimit -Hn), or take fewer users",
            users, (unsigned long long)needed, (unsigned long long)allowed);
    return LW_OK;
}

static enum lw_status start_loop(struct load_test *s, struct lw_error *err) {
    int result = uv_loop_init(&s->loop);
    if (result < 0) return lw_status_fail(err, LW_OS, "cannot start an event loop: %s", uv_strerror(result));
    s->shared.loop = &s->loop; /* says that there is a loop to close */
    uv_timer_init(&s->loop, &s->tick);
    uv_timer_init(&s->loop, &s->lag);
    uv_timer_init(&s->loop, &s->show);
    uv_timer_init(&s->loop, &s->sample);
    s->tick.data = s->lag.data = s->show.data = s->sample.data = s->interrupt.data = s->terminate.data = s;
    if ((result = uv_signal_init(&s->loop, &s->interrupt)) < 0 ||
        (result = uv_signal_init(&s->loop, &s->terminate)) < 0 ||
        (result = uv_signal_start(&s->interrupt, on_signal, SIGINT)) < 0 ||
        (result = uv_signal_start(&s->terminate, on_signal, SIGTERM)) < 0)
        return lw_status_fail(err, LW_OS, "cannot watch signals: %s", uv_strerror(result));
    s->began_ns = s->ticked_ns = s->lagged_ns = lw_clock_ns();
    uv_timer_start(&s->tick, on_tick, 0, TICK_MS);
    uv_timer_start(&s->lag, on_lag, LAG_MS, LAG_MS);
    if (s->series) uv_timer_start(&s->sample, on_sample, LW_LOAD_SERIES_MS, LW_LOAD_SERIES_MS);
    if (isatty(STDERR_FILENO)) uv_timer_start(&s->show, on_show, SHOW_MS, SHOW_MS);
    return LW_OK;
}

static void close_handle(uv_handle_t *handle, void *unused) {
    (void)unused;
    if (!uv_is_closing(handle)) uv_close(handle, NULL);
}

static void stop_loop(struct load_test *s) {
    if (!s->shared.loop) return;
    for (struct lw_load_session *u = s->shared.first, *next; u; u = next) {
        next = lw_load_session_next(u);
        lw_load_session_close(u);
    }
    uv_walk(&s->loop, close_handle, NULL); /* sessions are closing already: timers and signals are left */
    uv_run(&s->loop, UV_RUN_DEFAULT);
    int result = uv_loop_close(&s->loop);
    (void)result;
}

static enum lw_status prepare(struct load_test *s, struct lw_error *err) {
    const struct lw_load_options *o = s->options;
    enum lw_status status = raise_descriptor_limit(o->users, err);
    if (status == LW_OK)
        status = lw_load_scene_fetch(o->host, o->port, &o->access, o->download, o->path != LW_LOAD_EVERYTHING,
                                     &s->scene, err);
    if (status != LW_OK) return status;
    s->shared.scene = &s->scene;
    s->shared.options = o;
    s->shared.figures = &s->report->figures;
    s->report->tile_count = s->scene.map.tile_count;
    s->report->package_bytes = s->scene.package_size;
    s->report->package_compressed_bytes = s->scene.compressed_size;
    s->report->download_ns = s->scene.download_ns;
    status = lw_tile_check_create(&s->scene.map, o->decode_all, &s->shared.check);
    if (status == LW_OK) status = lw_frame_clock_init(&s->shared.clock);
    if (status != LW_OK) return lw_status_fail(err, status, "%s", lw_status_text(status));
    if (o->series) status = lw_load_series_create(o->series, &s->series, err);
    return status == LW_OK ? start_loop(s, err) : status;
}

enum lw_status lw_load_test_run(const struct lw_load_options *options, struct lw_load_report **out_report,
                                struct lw_error *err) {
    struct load_test *s = calloc(1, sizeof *s);
    struct lw_load_report *report = calloc(1, sizeof *report);
    if (!s || !report) {
        free(s);
        free(report);
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    }
    s->options = options;
    s->report = report;
    signal(SIGPIPE, SIG_IGN); /* libuv writes to closed sockets without asking for silence */
    enum lw_status status = prepare(s, err);
    if (status == LW_OK) {
        uv_run(&s->loop, UV_RUN_DEFAULT);
        if (isatty(STDERR_FILENO)) fprintf(stderr, "\r\033[K");
    }
    stop_loop(s);
    const enum lw_status written = lw_load_series_finish(s->series, err);
    if (status == LW_OK) status = written;
    lw_load_session_forget_returning(&s->shared);
    lw_tile_check_destroy(s->shared.check);
    lw_frame_clock_finish(&s->shared.clock);
    lw_tls_output_finish(&s->shared.output);
    lw_load_scene_finish(&s->scene);
    free(s);
    if (status == LW_OK)
        *out_report = report;
    else
        free(report);
    return status;
}
