/* scaling_figures.h: statistics of measured costs: means with intervals, and where two lines cross.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_MEASURE_FIGURES_SCALING_FIGURES_H
#define LW_CLIENT_MEASURE_FIGURES_SCALING_FIGURES_H

#include <stdbool.h>
#include <stdint.h>

#define LW_SCALING_PICTURES 3u /* frames that are compared with the reference */
#define LW_SCALING_EYES     4u /* users who are, at most */

/** relMSE of each eye in each picture's frame. It differs by a factor of ten and more between views, by a
 * few percent between random numbers. So two sides are compared over the same views. */
struct lw_scaling_errors {
    double of[LW_SCALING_PICTURES][LW_SCALING_EYES];
    bool judged[LW_SCALING_PICTURES][LW_SCALING_EYES];
};

/** Mean over the views that were judged in `where`, and in `errors` as well; NAN if there is none. */
double lw_scaling_figures_error(const struct lw_scaling_errors *errors,
                                const struct lw_scaling_errors *where);

/** A mean and the half width of its 95 % interval, by Student's t; 0 for a single value. */
struct lw_scaling_figure {
    double mean, half;
};
struct lw_scaling_figure lw_scaling_figures_mean(const double *value, uint32_t count);

/** Fits cost = fixed + users * slope by least squares, weighted by 1 / users since deviations grow with
 * users.
 * With one count of users, all cost is fixed. */
void lw_scaling_figures_line(const uint32_t *users, const double *cost, uint32_t count, double *out_fixed,
                             double *out_slope);

/** The number of users above which fixed + users * slope is less than users * alone; INFINITY if it never
 * is. */
double lw_scaling_figures_cross(double fixed, double slope, double alone);

/** Number of rungs to try at the next, higher density. rung: the last one that gained. One more than the
 * rungs that gained, but no more than before. */
static inline uint32_t lw_scaling_figures_rungs(uint32_t rung, uint32_t rung_count) {
    return rung + 2 < rung_count ? rung + 2 : rung_count;
}

#endif
