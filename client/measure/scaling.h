/* scaling.h: all figures of a run of lightwell-load scaling.
 * Flow:    scaling_measure, scaling_search, scaling_users -> [scaling] -> scaling_report
 * Threads: main() only.
 *
 * Cost is CPU seconds per frame. In a moving scene the first second is not measured: then caches are warm and
 * histories long, as in a running world. In a still scene everything is measured from the first frame on: the
 * cache pays that once, a path tracer in every frame. */
#ifndef LW_CLIENT_MEASURE_SCALING_H
#define LW_CLIENT_MEASURE_SCALING_H

#include "client/measure/figures/reference.h"
#include "client/measure/figures/scaling_figures.h"
#include "client/measure/measure_row.h"
#include "client/measure/scaling_options.h"
#include "client/measure/sides/renderer.h"

#define LW_SCALING_POINTS_MAX  64u /* settings tried per side */
#define LW_SCALING_TARGETS_MAX 4u
/* pictures per frame and side while users are added; more are scaled from those */
#define LW_SCALING_SHOWN_MAX 4u
/* error at which blocks converge, where nothing else is tried: lightwelld's own */
#define LW_SCALING_REST 0.02

enum lw_scaling_side_id { LW_SCALING_PATHS, LW_SCALING_SHARED, LW_SCALING_SIDES };

/** A setting that was tried. */
struct lw_scaling_point {
    struct lw_setting setting;
    double error;                    /* relMSE, mean over pictures and users */
    struct lw_scaling_errors errors; /* relMSE of each picture and eye */
    struct lw_cost cost;             /* per frame, for one user */
    bool later;                      /* error and cost come from the repeats, and are not known before */
};

struct lw_scaling_side {
    const char *name;
    struct lw_renderer *renderer;
    bool traces; /* a path tracer: cost is linear in samples and users */
    struct lw_scaling_point point[LW_SCALING_POINTS_MAX];
    uint32_t point_count;
    /* for a path tracer: CPU seconds per user and frame = fixed_s + samples * per_sample_s */
    double fixed_s, per_sample_s;
};

/** An error to reach, and each side's cheapest setting that does; -1: none did. */
struct lw_scaling_target {
    double error;
    int best[LW_SCALING_SIDES]; /* index into point */
};

/** A number of users, at the settings of the primary target. */
struct lw_scaling_count {
    uint32_t users;
    double cost_s[LW_SCALING_SIDES][LW_SCALING_REPEATS_MAX];
    struct lw_cost shared[LW_SCALING_REPEATS_MAX]; /* by stage */
    struct lw_cost cost;                           /* the shared side's, mean over repeats */
    struct lw_scaling_figure ratio;                /* shared over paths */
};

/** The shared side once by the wall clock, at the settings of the primary target. */
struct lw_scaling_real {
    bool done;
    uint32_t users;
    double frames_hz, views_hz; /* solved; composed, of all users */
    double server_cpu_s;        /* per second */
    double light_age_s;
    /* relMSE against the reference of the time at which a picture was ready; the same of the path tracer,
     * unfiltered, for the same views and times. The rest of the measurement has other views. */
    double error, paths_error;
};

struct lw_scaling {
    struct lw_measure_row base;
    struct lw_scaling_options options;
    struct lw_views *views;
    bool still; /* neither scene nor views move */
    uint32_t stride, lattice_width, lattice_height;
    uint64_t warm_frames, frames; /* not measured; measured */
    uint64_t picture[LW_SCALING_PICTURES];
    uint32_t eyes;
    struct lw_reference reference[LW_SCALING_PICTURES][LW_SCALING_EYES];
    double mean_square; /* of all references */
    double lag_error;   /* relMSE of light a second late, in judged views; NAN: nothing moves, or not known */
    bool dark[LW_SCALING_PICTURES][LW_SCALING_EYES]; /* nearly black: not judged */
    uint32_t dark_count;
    struct lw_scaling_side side[LW_SCALING_SIDES];
    struct lw_scaling_target target[LW_SCALING_TARGETS_MAX]; /* the first is the primary */
    uint32_t target_count;

    struct lw_setting chosen[LW_SCALING_SIDES];
    double chosen_error[LW_SCALING_SIDES]; /* by which they were chosen */
    /* with the first count of users; and the chosen path tracer's, for the same views */
    double shared_error[LW_SCALING_REPEATS_MAX], paths_error[LW_SCALING_REPEATS_MAX];
    struct lw_scaling_count count[LW_SCALING_COUNTS_MAX];
    double warm_cpu_s; /* the solve's, in the frames of a repeat that are not measured */
    uint32_t count_done, repeats_done;
    struct lw_scaling_figure first_ratio; /* r(1), or of the first count */
    bool whole_done;
    double whole_ratio, whole_error, whole_paths_error; /* for the first count, with all of the scene lit */
    struct lw_scaling_figure marginal;                  /* m: one more user over one more path tracer */
    struct lw_scaling_figure crossover; /* number of users above which sharing is cheaper; INFINITY: none */
    struct lw_scaling_real real;
    const char *shortfall; /* why there are no figures for counts of users; NULL: there are */
};

#endif
