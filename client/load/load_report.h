/* load_report.h: the results of a load test: as text, as JSON, and checked against the options' limits.
 * Flow:    load_test -> [load_report] -> stdout, exit code
 * Threads: main() only. */
#ifndef LW_CLIENT_LOAD_LOAD_REPORT_H
#define LW_CLIENT_LOAD_LOAD_REPORT_H

#include "client/load/load_figures.h"
#include "client/load/load_options.h"

#define LW_LOAD_SATURATED_CPU    0.9 /* over one core, the most that one loop can use */
#define LW_LOAD_SATURATED_LAG_MS 20.0

/* name in JSON, text for people */
#define LW_LOAD_END_MAP(X)                                                                                   \
    X(TIME, "time", "the measured time is over")                                                             \
    X(NOBODY_LEFT, "nobody_left", "the server closed everybody who stopped reading")                         \
    X(SERVER_GONE, "server_gone", "the server is gone")                                                      \
    X(OTHER_SCENE, "other_scene", "the server lights another scene now")                                     \
    X(INTERRUPTED, "interrupted", "interrupted")

enum lw_load_end {
#define X(name, key, text) LW_LOAD_END_##name,
    LW_LOAD_END_MAP(X)
#undef X
};

struct lw_load_report {
    enum lw_load_end end;
    double run_s, measured_s; /* the whole run; its measured part */
    double user_s;            /* integral over the measured time of the number of users that get frames */
    uint32_t users_at_end;    /* users that still got frames */
    uint32_t tile_count;      /* the scene's */
    uint64_t package_bytes, package_compressed_bytes,
        download_ns;                        /* the first download; all others are compared with it */
    uint64_t bytes, tiles, frames, settled; /* measured, received */
    uint64_t frames_heard;                  /* measured, different ones */
    double server_cpu_s, server_wall_s;     /* from a frame to a later one; wall 0: not known */
    double own_cpu_s, own_wait_s; /* measured; wait: ready to run but without a core; below 0: not known */
    uint64_t own_memory_bytes;    /* most that was resident */
    uint64_t tiles_decoded;       /* in the whole run; the others had the bytes of one of these */
    struct lw_histogram lag;      /* measured: how late our own timers were */
    struct lw_load_figures figures;
};

/** Whether this process was too busy, or got too little of the machine, for its times to be the server's. */
bool lw_load_report_is_saturated(const struct lw_load_report *report);

/** Prints to stdout. Errors: LW_IO, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_load_report_print(const struct lw_load_options *options,
                                                  const struct lw_load_report *report, struct lw_error *err);

/** Logs each limit that does not hold. Returns whether all hold. */
bool lw_load_report_check(const struct lw_load_options *options, const struct lw_load_report *report);

#endif
