/* scaling_options.h: the command line of lightwell-load scaling.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_SCALING_OPTIONS_H
#define LW_CLIENT_MEASURE_SCALING_OPTIONS_H

#include "client/measure/measure_options.h"
#include "client/measure/sides/views.h"
#include "client/paths/path_renderer.h"

#define LW_SCALING_USERS_MAX   4096u
#define LW_SCALING_COUNTS_MAX  32u /* user counts in one run */
#define LW_SCALING_REPEATS_MAX LW_MEASURE_OPTIONS_REPEATS_MAX

struct lw_scaling_options {
    struct lw_measure_options base;
    uint32_t users[LW_SCALING_COUNTS_MAX], user_counts; /* increasing */
    enum lw_views_kind views;
    double spread;
    /* The error that both sides must reach: a relMSE, or that of the path tracer with this number of paths
     * a pixel. */
    double error; /* > 0; 0: match_samples */
    uint32_t match_samples;
    /* Settings in place of a search, at any error. 0 samples: search. */
    uint32_t fixed_samples, fixed_direct, fixed_indirect;
    double fixed_density;      /* times the scene's default */
    double fixed_target_error; /* error at which blocks converge */
    bool one_error;            /* search for that error alone, not for the curve */
    enum lw_path_renderer_kind opponent;
    bool denoise;    /* the lightmaps are filtered */
    bool self_test;  /* a path tracer on both sides */
    bool whole;      /* the cache lights all of the scene */
    bool look_whole; /* it lights the interest set and its contributors; once also the whole scene */
};

/** Reads the command line; argv[0] is "scaling". --help and --version print and set *out_done.
 * Errors: LW_USAGE naming the option and what it accepts. */
LW_MUST_CHECK enum lw_status lw_scaling_options_parse(int argc, char **argv,
                                                      struct lw_scaling_options *out_options, bool *out_done,
                                                      struct lw_error *err);

#endif
