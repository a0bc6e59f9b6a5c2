/* real_run.h: the shared cache by the wall clock. Frames come as fast as the machine allows, and light is
 * as late as it then is.
 * Flow:    scene package, views -> [lightwelld, clients, compose, all at once] -> pictures and when they
 *          were shown
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_SCALING_REAL_RUN_H
#define LW_CLIENT_SCALING_REAL_RUN_H

#include "client/measure/renderer.h"
#include "client/measure/views.h"

#include <signal.h>

#define LW_REAL_RUN_PICTURES 3u

struct lw_real_run_desc {
    const char *package;
    const struct lw_views *views;
    struct lw_setting setting;
    uint32_t users, width, height, stride, bounces, seed;
    unsigned threads; /* 0: all */
    bool denoise;
    const char *solver; /* by name; NULL: the default */
    double seconds;     /* measured */
    /* It warms up until the server has spent this CPU time, or for this wall time at most. Wall time alone
     * does not tell how much light there is. With 3 s of it many texels had one sample, and fireflies
     * among them made 60 to 80 % of the error (an object turning in the atrium). */
    double warm_cpu_s, warm_s;
    const volatile sig_atomic_t *cancel;
};

struct lw_real_picture {
    double time_s;       /* scene time when it was ready to be seen */
    uint64_t view_frame; /* whose camera it was composed with */
    uint32_t user;
    double light_age_s;
    float *lattice; /* width / stride x height / stride, 3 floats each */
};

struct lw_real_run {
    struct lw_real_picture picture[LW_REAL_RUN_PICTURES];
    uint32_t picture_count;
    double frames_hz;    /* of the server */
    double views_hz;     /* composed, of all users together */
    double server_cpu_s; /* per second */
    double light_age_s;  /* mean over pictures composed */
};

/** Runs it. Errors: the server's and the clients'; LW_CLOSED if cancelled. Finish it after success. */
LW_MUST_CHECK enum lw_status lw_real_run(const struct lw_real_run_desc *desc, struct lw_real_run *out_run,
                                         struct lw_error *err);
void lw_real_run_finish(struct lw_real_run *run);

#endif
