#include "client/load/load_report.h"

#include "common/base/log.h"

#include <errno.h>
#include <inttypes.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
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

/* Rate that 99 % of the users reach. */
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

/* A number that JSON can hold. */
static json_t *real(double x) { return isfinite(x) ? json_real(x) : json_null(); }

static json_t *count(uint64_t n) { return json_integer((json_int_t)n); }

static json_t *times(const struct lw_histogram *h) {
    return json_pack("{s:o, s:o, s:o, s:o, s:o, s:o}", "count", count(h->count), "mean",
                     real(1e-6 * lw_histogram_mean(h)), "p50", real(quantile_ms(h, 0.5)), "p95",
                     real(quantile_ms(h, 0.95)), "p99", real(quantile_ms(h, 0.99)), "max", real(ms(h->max)));
}

static void add_users(json_t *root, const struct lw_load_options *o, const struct lw_load_report *r) {
    const struct lw_load_figures *f = &r->figures;
    const struct {
        const char *key;
        uint64_t count;
    } counts[] = {{"asked", f->asked},     {"welcomed", f->welcomed},        {"refused", f->refused},
                  {"lost", f->lost},       {"followed", f->followed},        {"left", f->left},
                  {"broken", f->broken},   {"returned", f->returned},        {"stopped", f->stopped},
                  {"dropped", f->dropped}, {"users_at_end", r->users_at_end}};
    json_object_set_new(root, "users", count(o->users));
    json_object_set_new(root, "path", json_string(path_text[o->path]));
    json_object_set_new(root, "reader", json_string(reader_text[o->reader]));
    json_object_set_new(root, "odd_readers", count(o->odd_readers));
    json_object_set_new(root, "end", json_string(end_key[r->end]));
    json_object_set_new(root, "run_s", real(r->run_s));
    json_object_set_new(root, "measured_s", real(r->measured_s));
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        json_object_set_new(root, counts[i].key, count(counts[i].count));
}

static void add_times(json_t *root, const struct lw_load_report *r) {
    const struct lw_load_figures *f = &r->figures;
    const struct {
        const char *key;
        const struct lw_histogram *times;
    } all[] = {
        {"connect_ms", &f->connect}, {"download_ms", &f->download},   {"first_view_ms", &f->first_view},
        {"served_ms", &f->served},   {"next_view_ms", &f->next_view}, {"frame_ms", &f->frame},
        {"update_ms", &f->update},   {"whole_frame_ms", &f->whole},   {"light_age_ms", &f->age},
        {"ping_ms", &f->ping},       {"drop_ms", &f->drop},           {"lag_ms", &r->lag}};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        json_object_set_new(root, all[i].key, times(all[i].times));
}

static void add_rates(json_t *root, const struct lw_load_report *r) {
    json_object_set_new(root, "user_s", real(r->user_s));
    json_object_set_new(root, "bytes", count(r->bytes));
    json_object_set_new(root, "tiles", count(r->tiles));
    json_object_set_new(root, "frames", count(r->frames));
    json_object_set_new(root, "whole_frames", count(r->settled));
    json_object_set_new(root, "frames_published", count(r->frames_heard));
    json_object_set_new(root, "frames_per_s_p1", real(frames_hz_of_most(r)));
    json_object_set_new(root, "kbit_in_a_second_p99", real(kbit(&r->figures.second_bytes, 0.99)));
}

static void add_sides(json_t *root, const struct lw_load_report *r) {
    json_object_set_new(root, "server_cpu_s", real(r->server_cpu_s));
    json_object_set_new(root, "server_wall_s", real(r->server_wall_s));
    json_object_set_new(root, "own_cpu_s", real(r->own_cpu_s));
    json_object_set_new(root, "own_wait_s", real(r->own_wait_s));
    json_object_set_new(root, "own_memory_bytes", count(r->own_memory_bytes));
    json_object_set_new(root, "tiles_decoded", count(r->tiles_decoded));
    json_object_set_new(root, "saturated", json_boolean(lw_load_report_is_saturated(r)));
    json_object_set_new(root, "scene_tiles", count(r->tile_count));
    json_object_set_new(root, "package_bytes", count(r->package_bytes));
    json_object_set_new(root, "package_compressed_bytes", count(r->package_compressed_bytes));
    json_object_set_new(root, "package_ms", real(ms(r->download_ns)));
}

static enum lw_status print_json(const struct lw_load_options *o, const struct lw_load_report *r,
                                 struct lw_error *err) {
    json_t *root = json_object(), *errors = json_object();
    add_users(root, o, r);
    add_times(root, r);
    add_rates(root, r);
    add_sides(root, r);
    for (int i = 0; i < LW_LOAD_FAULT_COUNT; i++)
        json_object_set_new(errors, fault_key[i], count(r->figures.fault[i]));
    json_object_set_new(root, "errors", errors);
    char *text = json_dumps(root, JSON_INDENT(1) | JSON_PRESERVE_ORDER | JSON_REAL_PRECISION(6));
    json_decref(root);
    if (!text) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the report");
    puts(text);
    free(text);
    return LW_OK;
}

enum lw_status lw_load_report_print(const struct lw_load_options *options,
                                    const struct lw_load_report *report, struct lw_error *err) {
    enum lw_status status = LW_OK;
    if (options->json)
        status = print_json(options, report, err);
    else
        print_text(options, report);
    if (status != LW_OK) return status;
    if (fflush(stdout) || ferror(stdout))
        return lw_status_fail(err, LW_IO, "cannot write to standard output: %s", strerror(errno));
    return LW_OK;
}

/* ---- limits ---- */

/* A time without a measurement is no pass: a test without data shows nothing. */
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
    if (r->end == LW_LOAD_END_SERVER_GONE || r->end == LW_LOAD_END_OTHER_SCENE ||
        r->end == LW_LOAD_END_INTERRUPTED) {
        lw_log(LW_LOG_ERROR, "%s after %.3g of %g s", end_text[r->end], r->measured_s, o->seconds);
        held = false;
    }
    return held;
}
