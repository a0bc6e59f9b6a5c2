/* forecast.h: how long work takes that says again and again how much of it is left.
 * Flow:    (time, work left) -> [forecast] -> seconds left -> progress
 * Threads: one.
 *
 * The work left of a bake is an estimate by errors that are estimates themselves: it may grow, and the last
 * tiles take longer than the first. So the rate is measured over the last third of the time, and over a
 * minute at most. */
#ifndef LW_BAKE_FORECAST_H
#define LW_BAKE_FORECAST_H

#include <stdint.h>

#define LW_FORECAST_POINTS 128u

struct lw_forecast {
    uint32_t count; /* 0: a forecast that has not begun */
    struct lw_forecast_point {
        double time_s, left;
    } point[LW_FORECAST_POINTS];
};

/** Notes the work left now, in any unit. Returns the seconds that are left: infinite while it has not
 * fallen. */
double lw_forecast_note(struct lw_forecast *forecast, double time_s, double left);

#endif
