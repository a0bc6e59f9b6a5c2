#include "client/measure/figures/scaling_figures.h"

#include <math.h>

/* Student's t, two-sided 95 %, by degrees of freedom; the last one for more. */
static double student(uint32_t freedom) {
    static const double t[] = {0,     12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262,
                               2.228, 2.201,  2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093};
    const uint32_t last = sizeof t / sizeof *t - 1;
    return t[freedom < last ? freedom : last];
}

double lw_scaling_figures_error(const struct lw_scaling_errors *errors,
                                const struct lw_scaling_errors *where) {
    double sum = 0;
    uint32_t count = 0;
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        for (uint32_t eye = 0; eye < LW_SCALING_EYES; eye++) {
            if (!errors->judged[p][eye] || !where->judged[p][eye]) continue;
            sum += errors->of[p][eye];
            count++;
        }
    return count ? sum / count : (double)NAN;
}

struct lw_scaling_figure lw_scaling_figures_mean(const double *value, uint32_t count) {
    struct lw_scaling_figure f = {0};
    double square = 0;
    for (uint32_t i = 0; i < count; i++) f.mean += value[i] / count;
    if (count < 2 || !isfinite(f.mean)) return f;
    for (uint32_t i = 0; i < count; i++) square += (value[i] - f.mean) * (value[i] - f.mean);
    f.half = student(count - 1) * sqrt(square / (count - 1) / count);
    return f;
}

void lw_scaling_figures_line(const uint32_t *users, const double *cost, uint32_t count, double *out_fixed,
                             double *out_slope) {
    double w = 0, wn = 0, wc = 0, wnn = 0, wnc = 0;
    for (uint32_t i = 0; i < count; i++) {
        double n = users[i], weight = 1 / n;
        w += weight, wn += weight * n, wc += weight * cost[i], wnn += weight * n * n,
            wnc += weight * n * cost[i];
    }
    double determinant = w * wnn - wn * wn;
    *out_slope = determinant > 1e-12 * w * wnn ? (w * wnc - wn * wc) / determinant : 0;
    *out_fixed = (wc - *out_slope * wn) / w;
}

double lw_scaling_figures_cross(double fixed, double slope, double alone) {
    return alone > slope ? fmax(0, fixed) / (alone - slope) : (double)INFINITY;
}
