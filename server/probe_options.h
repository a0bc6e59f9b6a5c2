/* probe_options.h: which bounce rays ask probes instead of the scene, as options of the programs that solve.
 * Flow:    command line -> [settings] -> lw_solver_desc */
#ifndef LW_SERVER_PROBE_OPTIONS_H
#define LW_SERVER_PROBE_OPTIONS_H

#include "common/base/options.h"
#include "server/solve/solver.h"

#include <math.h>

struct lw_probe_options {
    double tracing_range_m;              /* INFINITY before options are parsed: it is the default */
    double cell_size_m, probe_spacing_m; /* 0: the solver's own */
    int form;                            /* enum lw_probe_form_kind */
};

/** The rows of an option table (common/base/options.h) that fill these settings.
 * probes  a pointer to them */
/* clang-format off */
#define LW_PROBE_OPTIONS(probes)                                                                            \
    {"tracing-range", "METRES", "bounce rays longer than this ask the probes; inf asks none (default {})", \
     LW_OPTION_REAL, &(probes)->tracing_range_m, 1e-6, (double)INFINITY, NULL},                             \
    {"cell-size", "METRES", "side of a radiance cell (default: a quarter of the scene's longest side)",     \
     LW_OPTION_REAL, &(probes)->cell_size_m, 1e-6, 1e9, NULL},                                              \
    {"probe-spacing", "METRES", "distance between probes (default: so that there are some 1,000)",          \
     LW_OPTION_REAL, &(probes)->probe_spacing_m, 1e-6, 1e9, NULL},                                          \
    {"probe-form", "octahedral|sh|cube",                                                                    \
     "how probes keep what they see: maps of 16 x 16 directions{octahedral}, nine spherical harmonics, or "  \
     "the faces of a cube, 7 x 7 each",                                                                     \
     LW_OPTION_CHOICE, &(probes)->form, 0, 0, NULL}

/** Fields of a struct lw_solver_desc's initialiser, by these settings. */
#define LW_PROBE_OPTIONS_DESC(probes)                                                                       \
    .tracing_range_m = (float)(probes)->tracing_range_m, .cell_size_m = (float)(probes)->cell_size_m,       \
    .probe_spacing_m = (float)(probes)->probe_spacing_m,                                                    \
    .probe_form = (enum lw_probe_form_kind)(probes)->form
/* clang-format on */

#endif
