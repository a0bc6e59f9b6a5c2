/* crossover_figures.h: what measured costs say: means with their intervals, and where two lines cross.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_LOAD_CROSSOVER_FIGURES_H
#define LW_CLIENT_LOAD_CROSSOVER_FIGURES_H

#include <stdbool.h>
#include <stdint.h>

#define LW_CROSSOVER_PICTURES 3u /* frames that are compared with the truth */
#define LW_CROSSOVER_EYES     4u /* users who are, at most */

/** relMSE of what each eye saw in each picture's frame. From one view to another it differs by a factor of ten and more,
 * by random numbers by a few percent: two sides are compared over the same views. */
struct lw_crossover_errors {
    double of[LW_CROSSOVER_PICTURES][LW_CROSSOVER_EYES];
    bool judged[LW_CROSSOVER_PICTURES][LW_CROSSOVER_EYES];
};

/** Mean over the views that were judged in `where`, and in `errors` as well; NAN if there is none. */
double lw_crossover_figures_error(const struct lw_crossover_errors *errors,
                                  const struct lw_crossover_errors *where);

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
