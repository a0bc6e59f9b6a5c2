#include "server/bake/forecast.h"

#include <math.h>

#define WINDOW   (1.0 / 3) /* share of the time so far */
#define WINDOW_S 60.0

/* Every other point goes; the first stays. */
static void thin_out(struct lw_forecast *f) {
    for (uint32_t i = 0; 2 * i < f->count; i++) f->point[i] = f->point[2 * i];
    f->count = (f->count + 1) / 2;
}

double lw_forecast_note(struct lw_forecast *f, double time_s, double left) {
    if (f->count == LW_FORECAST_POINTS) thin_out(f);
    f->point[f->count++] = (struct lw_forecast_point){time_s, left};
    if (!(left > 0)) return 0;
    const double since_s = time_s - fmin(WINDOW_S, WINDOW * (time_s - f->point[0].time_s));
    uint32_t from = 0; /* the last point before the window */
    while (from + 2 < f->count && f->point[from + 1].time_s <= since_s) from++;
    const struct lw_forecast_point *then = &f->point[from];
    const double fallen = then->left - left;
    return fallen > 0 && time_s > then->time_s ? left * (time_s - then->time_s) / fallen : (double)INFINITY;
}
