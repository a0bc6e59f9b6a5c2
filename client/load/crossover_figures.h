/* crossover_figures.h: what measured costs say: means with their intervals, and where two lines cross.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_LOAD_CROSSOVER_FIGURES_H
#define LW_CLIENT_LOAD_CROSSOVER_FIGURES_H

#include <stdint.h>

/** A mean and the half width of its 95 % interval, by Student's t; 0 for a single value. */
struct lw_crossover_figure {
    double mean, half;
};
struct lw_crossover_figure lw_crossover_figures_mean(const double *value, uint32_t count);

/** cost = fixed + users * slope, by least squares weighted by 1 / users, since deviations grow with them. With one count
 * of users, all is fixed. */
void lw_crossover_figures_line(const uint32_t *users, const double *cost, uint32_t count, double *out_fixed,
                               double *out_slope);

/** Users from which on fixed + users * slope is less than users * alone; INFINITY if it never is. */
double lw_crossover_figures_cross(double fixed, double slope, double alone);

#endif
