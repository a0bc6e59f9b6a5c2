/* daemon_child.h: a lightwelld of our own, driven frame by frame.
 * Flow:    options -> [lightwelld --clock manual --json] -> one report per frame
 * Threads: one thread at a time. Every wait has a limit. */
#ifndef LW_CLIENT_MEASURE_SIDES_DAEMON_CHILD_H
#define LW_CLIENT_MEASURE_SIDES_DAEMON_CHILD_H

#include "common/base/status.h"

#include <stdint.h>

struct lw_daemon_child_desc {
    const char *package; /* .lwscene */
    const char *solver;  /* by name; NULL: the default */
    uint32_t bounces, direct_samples, indirect_samples, seed;
    double target_error;
    unsigned threads; /* 0: all */
    bool denoise;
    bool seen;       /* light the interest set and its contributors, not the whole scene */
    bool real_clock; /* frames follow the wall clock instead of lw_daemon_child_step() */
};

/** Figures of one frame. */
struct lw_daemon_report {
    uint64_t frame, published; /* published: the newest frame that sessions get */
    double solve_cpu_s, publish_cpu_s;
    double loop_cpu_s; /* the network thread's, since the start */
    double rays;
    uint32_t tiles_solved, tiles;
    uint64_t texels_solved;
};

struct lw_daemon_child;

/** Starts a server on a free port of 127.0.0.1 and waits until it listens. The server ends when the
 * calling thread ends, in any way.
 * Errors: LW_OS if lightwelld, beside this program or in PATH, does not start; its own failure;
 *         LW_TIMED_OUT. */
LW_MUST_CHECK enum lw_status lw_daemon_child_start(const struct lw_daemon_child_desc *desc,
                                                   struct lw_daemon_child **out_child, struct lw_error *err);
uint16_t lw_daemon_child_port(const struct lw_daemon_child *child);

/** Lets it solve the next frame and waits for its end. Errors: LW_CLOSED if it ended; LW_TIMED_OUT;
 * LW_PROTOCOL. */
LW_MUST_CHECK enum lw_status lw_daemon_child_step(struct lw_daemon_child *child,
                                                  struct lw_daemon_report *out_report, struct lw_error *err);

/** CPU seconds of its process so far, all threads; 0 if it is gone. */
double lw_daemon_child_cpu_s(const struct lw_daemon_child *child);

/** The most memory that its process has held so far, bytes (VmHWM); 0 if it is gone. */
uint64_t lw_daemon_child_memory_bytes(const struct lw_daemon_child *child);

/** Ends it, by force if it does not within 5 s. NULL is fine. */
void lw_daemon_child_stop(struct lw_daemon_child *child);

#endif
