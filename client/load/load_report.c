#include "client/load/load_report.h"

#include "common/log.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const char *const fault_key[] = {
#define X(name, key, text) key,
    LW_LOAD_FAULT_MAP(X)
#undef X
};
static const char *const fault_text[] = {
#define X(name, key, text) text,
    LW_LOAD_FAULT_MAP(X)
#undef X
};
static const char *const end_key[] = {
#define X(name, key, text) key,
    LW_LOAD_END_MAP(X)
#undef X
};
static const char *const end_text[] = {
#define X(name, key, text) text,
    LW_LOAD_END_MAP(X)
#undef X
};
static const char *const path_text[] = {"everything", "walk", "still", "teleport"};
static const char *const reader_text[] = {"fast", "slow", "never"};

static double ms(uint64_t ns) { return 1e-6 * (double)ns; }
static double quantile_ms(const struct lw_histogram *h, double q) { return ms(lw_histogram_quantile(h, q)); }
static double ratio(double a, double b) { return b > 0 ? a / b : 0; }

static uint64_t fault_count(const struct lw_load_report *r) {
    uint64_t sum = 0;
    for (int i = 0; i < LW_LOAD_FAULT_COUNT; i++) sum += r->figures.fault[i];
    return sum;
}

/* What 99 % of the users get at least. */
static double frames_hz_of_most(const struct lw_load_report *r) {
    return 1e-3 * (double)lw_histogram_quantile(&r->figures.rate_mhz, 0.01);
}

static double own_cpu_share(const struct lw_load_report *r) { return ratio(r->own_cpu_s, r->measured_s); }

bool lw_load_report_is_saturated(const struct lw_load_report *r) {
    return own_cpu_share(r) > LW_LOAD_SATURATED_CPU || quantile_ms(&r->lag, 0.99) > LW_LOAD_SATURATED_LAG_MS;
}

/* ---- text ---- */

/* Three digits or more, and never an exponent. */
static const char *number(char out[16], double value) {
    snprintf(out, 16, value < 9.995 ? "%.2f" : value < 99.95 ? "%.1f" : "%.0f", value);
    return out;
}
#define NUMBER(value) number((char[16]){0}, value)

static void print_times(const char *name, const struct lw_histogram *h, const char *what) {
    if (h->count == 0) return;
    printf("  %-12s p50 %s  p95 %s  p99 %s  max %s ms: %s (%" PRIu64 ")\n", name, NUMBER(quantile_ms(h, 0.5)),
           NUMBER(quantile_ms(h, 0.95)), NUMBER(quantile_ms(h, 0.99)), NUMBER(ms(h->max)), what, h->count);
}

static void print_users(const struct lw_load_options *o, const struct lw_load_report *r) {
    const struct lw_load_figures *f = &r->figures;
    printf("  users        %" PRIu64 " asked, %" PRIu64 " welcomed, %" PRIu64 " refused, %" PRIu64 " lost",
           f->asked, f->welcomed, f->refused, f->lost);
    printf("; %" PRIu64 " followed", f->followed);
    if (o->churn_hz > 0) printf("; %" PRIu64 " left and were replaced", f->left);
    if (o->reconnect) printf("; %" PRIu64 " broken, %" PRIu64 " came back", f->broken, f->returned);
    printf("\n");
    if (o->reader == LW_LOAD_SLOW)
        printf("  slow         %u of them read %.6g kB/s\n", o->odd_readers, 1e-3 * o->slow_bytes_hz);
    if (o->reader == LW_LOAD_NEVER) {
        printf("  never        %" PRIu64 " of them stopped reading; the server closed %" PRIu64, f->stopped,
               f->dropped);
        if (f->drop.count)
            printf(" after %.1f to %.1f s", 1e-9 * (double)f->drop.min, 1e-9 * (double)f->drop.max);
        printf("%s\n", f->dropped < f->stopped ? " (it does so 15 s after the link is full)" : "");
    }
}

static void print_all_times(const struct lw_load_report *r) {
    const struct lw_load_figures *f = &r->figures;
    print_times("connect", &f->connect, "from connect to the welcome");
    print_times("download", &f->download, "from connect to the whole scene package");
    print_times("first view", &f->first_view, "from connect to every tile asked for");
    print_times("came back", &f->served,
                "from the server's first welcome, or the break, to every tile asked for");
    print_times("next view", &f->next_view, "from asking for other tiles to having them");
    print_times("frame", &f->frame, "a frame's news, after the first user's");
    print_times("update", &f->update, "a tile, after the first user heard of its frame");
    print_times("whole frame", &f->whole, "a frame's last tile, after the first user heard of the frame");
    print_times("light age", &f->age, "an updated tile's light at arrival: the solve and the update");
    print_times("ping", &f->ping, "there and back, through the server's loop");
}

static double kbit(const struct lw_histogram *bytes, double q) {
    return 8e-3 * (double)lw_histogram_quantile(bytes, q);
}

static void print_rates(const struct lw_load_report *r) {
    double mbit = 8e-6 * (double)r->bytes, users = ratio(r->user_s, r->measured_s);
    printf("  per user     %s frames/s (99 %% of the users: at least %s), %s whole frames/s, %s tiles/s, %s "
           "Mbit/s\n",
           NUMBER(ratio((double)r->frames, r->user_s)), NUMBER(frames_hz_of_most(r)),
           NUMBER(ratio((double)r->settled, r->user_s)), NUMBER(ratio((double)r->tiles, r->user_s)),
           NUMBER(ratio(mbit, r->user_s)));
    if (r->figures.second_bytes.count)
        printf("  in a second  p50 %s  p95 %s  p99 %s  max %s kbit to a user that had its first view before "
               "(%" PRIu64 ")\n",
               NUMBER(kbit(&r->figures.second_bytes, 0.5)), NUMBER(kbit(&r->figures.second_bytes, 0.95)),
               NUMBER(kbit(&r->figures.second_bytes, 0.99)), NUMBER(kbit(&r->figures.second_bytes, 1)),
               r->figures.second_bytes.count);
    printf("  in all       %s users on average, %s MB, %s Mbit/s, %s tiles/s; %s frames/s were published\n",
           NUMBER(users), NUMBER(1e-6 * (double)r->bytes), NUMBER(ratio(mbit, r->measured_s)),
           NUMBER(ratio((double)r->tiles, r->measured_s)),
           NUMBER(ratio((double)r->frames_heard, r->measured_s)));
    double cores = ratio(r->server_cpu_s, r->server_wall_s);
    if (r->server_wall_s > 0)
        printf("  server       %s cores; %s ms of CPU per user and second, the solve included\n",
               NUMBER(cores), NUMBER(1e3 * ratio(cores, users)));
    else
        printf("  server       CPU time not known: it comes with frames, and two are needed\n");
}

static void print_own_side(const struct lw_load_report *r) {
    printf("  this side    %s of a core", NUMBER(own_cpu_share(r)));
    if (r->own_wait_s >= 0)
        printf(", waited for one %s of the time", NUMBER(ratio(r->own_wait_s, r->measured_s)));
    printf("; timers late by p99 %s ms; %s MB; decoded %" PRIu64 " tiles\n",
           NUMBER(quantile_ms(&r->lag, 0.99)), NUMBER(1e-6 * (double)r->own_memory_bytes), r->tiles_decoded);
    if (lw_load_report_is_saturated(r))
        printf("  SATURATED    this side was too busy, or got too little of the machine: the times above "
               "include its own "
               "delays\n");
}

static void print_faults(const struct lw_load_report *r) {
    if (fault_count(r) == 0) printf("  errors       none\n");
    for (int i = 0; i < LW_LOAD_FAULT_COUNT; i++)
        if (r->figures.fault[i])
            printf("  error        %" PRIu64 " %s; the first: %s\n", r->figures.fault[i], fault_text[i],
                   r->figures.first_fault[i]);
}

static void print_text(const struct lw_load_options *o, const struct lw_load_report *r) {
    printf("%s:%u: %u users (%s, %s), %.1f s measured after %.1f s: %s\n", o->host, (unsigned)o->port,
           o->users, path_text[o->path], reader_text[o->reader], r->measured_s, r->run_s - r->measured_s,
           end_text[r->end]);
    print_users(o, r);
    print_all_times(r);
    print_rates(r);
    print_own_side(r);
    print_faults(r);
}

/* ---- JSON ---- */

static void print_json_times(const char *name, const struct lw_histogram *h) {
    printf(" \"%s\": {\"count\": %" PRIu64
           ", \"mean\": %.6g, \"p50\": %.6g, \"p95\": %.6g, \"p99\": %.6g, \"max\": %.6g},\n",
           name, h->count, 1e-6 * lw_histogram_mean(h), quantile_ms(h, 0.5), quantile_ms(h, 0.95),
           quantile_ms(h, 0.99), ms(h->max));
}

static void print_json(const struct lw_load_options *o, const struct lw_load_report *r) {
    const struct lw_load_figures *f = &r->figures;
    printf("{\"users\": %u, \"path\": \"%s\", \"reader\": \"%s\", \"odd_readers\": %u, \"end\": \"%s\", "
           "\"run_s\": %.6g, "
           "\"measured_s\": %.6g,\n",
           o->users, path_text[o->path], reader_text[o->reader], o->odd_readers, end_key[r->end], r->run_s,
           r->measured_s);
    printf(" \"asked\": %" PRIu64 ", \"welcomed\": %" PRIu64 ", \"refused\": %" PRIu64 ", \"lost\": %" PRIu64
           ", \"followed\": %" PRIu64 ", \"left\": %" PRIu64 ", \"broken\": %" PRIu64
           ", \"returned\": %" PRIu64 ", \"stopped\": %" PRIu64 ", \"dropped\": %" PRIu64
           ", \"users_at_end\": %u,\n",
           f->asked, f->welcomed, f->refused, f->lost, f->followed, f->left, f->broken, f->returned,
           f->stopped, f->dropped, r->users_at_end);
    print_json_times("connect_ms", &f->connect);
    print_json_times("download_ms", &f->download);
    print_json_times("first_view_ms", &f->first_view);
    print_json_times("served_ms", &f->served);
    print_json_times("next_view_ms", &f->next_view);
    print_json_times("frame_ms", &f->frame);
    print_json_times("update_ms", &f->update);
    print_json_times("whole_frame_ms", &f->whole);
    print_json_times("light_age_ms", &f->age);
    print_json_times("ping_ms", &f->ping);
    print_json_times("drop_ms", &f->drop);
    print_json_times("lag_ms", &r->lag);
    printf(" \"user_s\": %.6g, \"bytes\": %" PRIu64 ", \"tiles\": %" PRIu64 ", \"frames\": %" PRIu64
           ", \"whole_frames\": %" PRIu64 ", \"frames_published\": %" PRIu64
           ", \"frames_per_s_p1\": %.6g, \"kbit_in_a_second_p99\": %.6g,\n",
           r->user_s, r->bytes, r->tiles, r->frames, r->settled, r->frames_heard, frames_hz_of_most(r),
           kbit(&f->second_bytes, 0.99));
    printf(" \"server_cpu_s\": %.6g, \"server_wall_s\": %.6g, \"own_cpu_s\": %.6g, \"own_wait_s\": %.6g, "
           "\"own_memory_bytes\": %" PRIu64 ", \"tiles_decoded\": %" PRIu64 ", \"saturated\": %s,\n",
           r->server_cpu_s, r->server_wall_s, r->own_cpu_s, r->own_wait_s, r->own_memory_bytes,
           r->tiles_decoded, lw_load_report_is_saturated(r) ? "true" : "false");
    printf(" \"scene_tiles\": %u, \"package_bytes\": %" PRIu64 ", \"package_compressed_bytes\": %" PRIu64
           ", \"package_ms\": %.6g,\n \"errors\": {",
           r->tile_count, r->package_bytes, r->package_compressed_bytes, ms(r->download_ns));
    for (int i = 0; i < LW_LOAD_FAULT_COUNT; i++)
        printf("%s\"%s\": %" PRIu64, i ? ", " : "", fault_key[i], f->fault[i]);
    printf("}}\n");
}

enum lw_status lw_load_report_print(const struct lw_load_options *options,
                                    const struct lw_load_report *report, struct lw_error *err) {
    if (options->json)
        print_json(options, report);
    else
        print_text(options, report);
    if (fflush(stdout) || ferror(stdout))
        return lw_status_fail(err, LW_IO, "cannot write to standard output: %s", strerror(errno));
    return LW_OK;
}

/* ---- what was to hold ---- */

/* A time that nobody measured does not hold: a test that saw nothing has shown nothing. */
static bool check_time(const char *option, const struct lw_histogram *h, double max_ms) {
    double found_ms = quantile_ms(h, 0.99);
    if (max_ms == (double)INFINITY || (h->count && found_ms <= max_ms)) return true;
    if (h->count)
        lw_log(LW_LOG_ERROR, "--%s %g does not hold: p99 is %.4g ms", option, max_ms, found_ms);
    else
        lw_log(LW_LOG_ERROR, "--%s %g does not hold: none was measured", option, max_ms);
    return false;
}

bool lw_load_report_check(const struct lw_load_options *o, const struct lw_load_report *r) {
    bool held = check_time("max-latency-ms", &r->figures.update, o->latency_max_ms);
    held &= check_time("max-first-view-ms", &r->figures.first_view, o->first_view_max_ms);
    if (o->frames_min_hz > 0 && !(frames_hz_of_most(r) >= o->frames_min_hz)) {
        lw_log(LW_LOG_ERROR, "--min-frames-per-s %g does not hold: 1 %% of the users get %.4g or fewer",
               o->frames_min_hz, frames_hz_of_most(r));
        held = false;
    }
    if (fault_count(r) > (uint64_t)o->errors_max) {
        lw_log(LW_LOG_ERROR, "--max-errors %lld does not hold: there were %" PRIu64, (long long)o->errors_max,
               fault_count(r));
        held = false;
    }
    if (r->end == LW_LOAD_END_SERVER_GONE || r->end == LW_LOAD_END_INTERRUPTED) {
        lw_log(LW_LOG_ERROR, "%s after %.3g of %g s", end_text[r->end], r->measured_s, o->seconds);
        held = false;
    }
    return held;
}
