/* bootstrap.h: intervals of figures that are measured over views and repeats.
 * Flow:    cells (view, repeat), a statistic -> [bootstrap: draws with replacement] -> value, 95 %
 *          interval
 * Threads: pure functions, [any].
 * After:   Efron and Tibshirani 1993, ch. 13 (percentile intervals); Davison and Hinkley 1997, 3.8
 *          (clusters: views are drawn whole, then repeats within each).
 *
 * The draws are paired: each takes the same cells of all renderers, so that the effect of a view on all of
 * them cancels. */
#ifndef LW_CLIENT_MEASURE_FIGURES_BOOTSTRAP_H
#define LW_CLIENT_MEASURE_FIGURES_BOOTSTRAP_H

#include <stdint.h>

#define LW_BOOTSTRAP_DRAWS 2000u

struct lw_bootstrap_cells {
    uint32_t views, repeats;
    const uint8_t *there; /* views * repeats: whether the cell was measured */
};

/** A figure of weighted cells. weight: views * repeats; how often each cell was drawn, 0 where it is not
 * there.
 * NAN: the figure is not known from these cells; the draw is left out. */
typedef double lw_bootstrap_statistic(const void *context, const double *weight);

struct lw_bootstrap_interval {
    double value;     /* of all cells, once each; NAN: unknown */
    double low, high; /* the 95 % interval; equal to value where a single cell is there */
};

/** Same arguments, same figures. Without memory for the draws, low and high are NAN. */
struct lw_bootstrap_interval lw_bootstrap(const struct lw_bootstrap_cells *cells,
                                          lw_bootstrap_statistic *statistic, const void *context,
                                          uint32_t seed);

#endif
