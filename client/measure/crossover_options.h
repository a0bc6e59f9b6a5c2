/* crossover_options.h: the command line of lightwell-load crossover.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_OPTIONS_H
#define LW_CLIENT_MEASURE_CROSSOVER_OPTIONS_H

#include "client/measure/measure_options.h"
#include "client/measure/measure_store.h"
#include "client/paths/path_renderer.h"

#define LW_CROSSOVER_DENSITIES_MAX 8u
#define LW_CROSSOVER_PATHS_MAX     8u

struct lw_crossover_options {
    struct lw_measure_options base; /* seconds: of the frames that are counted as cost, the judged included */
    enum lw_path_renderer_kind opponent[LW_PATH_RENDERER_COUNT];
    uint32_t opponent_count;
    uint32_t paths[LW_CROSSOVER_PATHS_MAX], paths_count; /* per pixel, of opponents that do not filter */
    double density[LW_CROSSOVER_DENSITIES_MAX];          /* times the scene's default; growing */
    uint32_t density_count;
    /* the cache's forms: users draw the direct light of client lights; tiles hold all light */
    bool pixels, tiles;
    bool by_rays, by_gl; /* how the cache's users draw */
    uint32_t alone;      /* views of a repeat that one user sees alone */
    double warm_s;       /* scene time before the first judged frame */
    double minutes_max;  /* no unit begins later; INFINITY: no limit */
    bool report_only;
    bool real_clock; /* also measure by the wall clock (crossover_clock.h) */
};

/** Reads the command line; argv[0] is "crossover". --help and --version print and set *out_done.
 * Errors: LW_USAGE naming the option and what it accepts. */
LW_MUST_CHECK enum lw_status lw_crossover_options_parse(int argc, char **argv,
                                                        struct lw_crossover_options *out_options,
                                                        bool *out_done, struct lw_error *err);

#endif
