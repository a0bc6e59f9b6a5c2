/* real_run.h: the shared cache, or a renderer for one user, by the wall clock. Frames come as fast as the
 * machine allows, and light is as late as it then is.
 * Flow:    scene package, cameras -> [lightwelld, clients, compose, all at once] -> pictures and when they
 *          were shown
 *          renderer -> [frames, each of the moment at which it begins] -> the same
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_MEASURE_SIDES_REAL_RUN_H
#define LW_CLIENT_MEASURE_SIDES_REAL_RUN_H

#include "client/measure/sides/renderer.h"

#define LW_REAL_RUN_PICTURES 3u

struct lw_real_run_desc {
    const char *package;
    struct lw_renderer_cameras cameras;
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
    const _Atomic bool *cancel;
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
    double frames_hz;    /* of the server; 0: there is none */
    double views_hz;     /* composed, of all users together */
    double server_cpu_s; /* per second; 0: there is none */
    double light_age_s;  /* mean over pictures composed */
};

/** Runs it. Errors: the server's and the clients'; LW_CLOSED if cancelled. Finish it after success. */
LW_MUST_CHECK enum lw_status lw_real_run(const struct lw_real_run_desc *desc, struct lw_real_run *out_run,
                                         struct lw_error *err);

struct lw_real_paths_desc {
    struct lw_renderer *renderer; /* of per_user_renderer.h, of pictures of this size */
    struct lw_setting setting;
    uint32_t user, width, height, stride, seed;
    double first_s; /* scene time at which it begins; 0 or more */
    double warm_s;  /* before the seconds that are measured: for its history */
    double seconds;
    const _Atomic bool *cancel;
};

/** The same of a renderer for one user: it begins a frame when the one before is done, at most LW_VIEWS_HZ
 * in a second, and leaves out moments that it is too slow for. Errors: the renderer's; LW_CLOSED if
 * cancelled. Finish it after success. */
LW_MUST_CHECK enum lw_status lw_real_run_paths(const struct lw_real_paths_desc *desc,
                                               struct lw_real_run *out_run, struct lw_error *err);
void lw_real_run_finish(struct lw_real_run *run);

#endif
