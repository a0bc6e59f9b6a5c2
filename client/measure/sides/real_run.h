/* real_run.h: the shared cache, or a renderer for one user, by the wall clock. Frames come as fast as the
 * machine allows, and light is as late as it then is.
 * Flow:    scene package, cameras -> [lightwelld, clients, compose, all at once] -> pictures and when they
 *          were shown
 *          renderer -> [frames, each of the moment at which it begins] -> the same
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_MEASURE_SIDES_REAL_RUN_H
#define LW_CLIENT_MEASURE_SIDES_REAL_RUN_H

#include "client/measure/sides/renderer.h"
#include "client/paths/path_renderer.h"

#define LW_REAL_RUN_PICTURES 3u

struct lw_real_run_desc {
    const struct lw_renderer_desc *side;
    struct lw_setting setting;
    uint32_t seed;
    double seconds; /* measured */
    double warm_s;  /* not measured, before that; of the cache, at most */
    /* Cache: it warms up until the server has spent this CPU time. Wall time alone does not determine the
     * amount of light. With 3 s of it many texels had one sample, and fireflies among them made 60 to 80 % of
     * the error (an object turning in the atrium). */
    double warm_cpu_s;
    uint32_t users; /* the cache's */
    /* a path renderer, for one user */
    enum lw_path_renderer_kind kind;
    uint32_t user;
    double first_s; /* scene time at which it begins; 0 or more */
    const _Atomic bool *cancel;
};

struct lw_real_picture {
    double time_s;       /* scene time when it was ready to be seen */
    uint64_t view_frame; /* the frame of the camera that it was composed with */
    uint32_t user;
    double light_age_s;
    float *lattice; /* width / stride x height / stride, 3 floats each */
};

struct lw_real_run {
    struct lw_real_picture picture[LW_REAL_RUN_PICTURES];
    uint32_t picture_count;
    double frames_hz;    /* the server's; 0: there is none */
    double views_hz;     /* composed, of all users together */
    double server_cpu_s; /* per second; 0: there is none */
    double light_age_s;  /* mean over pictures composed */
};

/** Runs the cache. Errors: the server's and the clients'; LW_CLOSED if cancelled. Finish it after success. */
LW_MUST_CHECK enum lw_status lw_real_run(const struct lw_real_run_desc *desc, struct lw_real_run *out_run,
                                         struct lw_error *err);

/** The same of a path renderer for one user: it begins a frame when the one before is done, at most
 * LW_VIEWS_HZ in a second, and leaves out moments that it is too slow for. Errors: the renderer's; LW_CLOSED
 * if cancelled. Finish it after success. */
LW_MUST_CHECK enum lw_status lw_real_run_paths(const struct lw_real_run_desc *desc,
                                               struct lw_real_run *out_run, struct lw_error *err);
void lw_real_run_finish(struct lw_real_run *run);

#endif
