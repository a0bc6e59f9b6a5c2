#include "client/measure/figures/bootstrap.h"

#include "common/base/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static uint32_t below(uint32_t count, uint32_t seed, uint32_t draw, uint32_t which) {
    return (uint32_t)((uint64_t)lw_random_hash3(seed, draw, which) * count >> 32);
}

/* The index of the n-th cell of a view that is there. */
static uint32_t cell_of(const struct lw_bootstrap_cells *cells, uint32_t view, uint32_t n) {
    const uint32_t first = view * cells->repeats;
    for (uint32_t r = 0;; r++)
        if (cells->there[first + r] && n-- == 0) return first + r;
}

static void draw_cells(const struct lw_bootstrap_cells *cells, const uint32_t *view, const uint32_t *count,
                       uint32_t views, uint32_t seed, uint32_t draw, double *weight) {
    memset(weight, 0, sizeof *weight * cells->views * cells->repeats);
    uint32_t which = 0;
    for (uint32_t i = 0; i < views; i++) {
        const uint32_t v = below(views, seed, draw, which++);
        for (uint32_t r = 0; r < count[v]; r++)
            weight[cell_of(cells, view[v], below(count[v], seed, draw, which++))]++;
    }
}

struct lw_bootstrap_interval lw_bootstrap(const struct lw_bootstrap_cells *cells,
                                          lw_bootstrap_statistic *statistic, const void *context,
                                          uint32_t seed) {
    struct lw_bootstrap_interval interval = {(double)NAN, (double)NAN, (double)NAN};
    const size_t size = (size_t)cells->views * cells->repeats;
    double *weight = calloc(size + 1, sizeof *weight), *value = calloc(LW_BOOTSTRAP_DRAWS, sizeof *value);
    uint32_t *view = calloc(cells->views + 1, sizeof *view), *count = calloc(cells->views + 1, sizeof *count);
    uint32_t views = 0, all = 0, good = 0;
    if (!weight || !value || !view || !count) goto done;
    for (uint32_t v = 0; v < cells->views; v++) {
        for (uint32_t r = 0; r < cells->repeats; r++)
            count[views] += cells->there[v * cells->repeats + r] != 0;
        all += count[views];
        if (count[views]) view[views++] = v;
    }
    for (size_t i = 0; i < size; i++) weight[i] = cells->there[i] != 0;
    if (all) interval.value = statistic(context, weight);
    for (uint32_t draw = 0; all && draw < LW_BOOTSTRAP_DRAWS; draw++) {
        draw_cells(cells, view, count, views, seed, draw, weight);
        const double x = statistic(context, weight);
        if (!isnan(x)) value[good++] = x;
    }
    if (good) {
        qsort(value, good, sizeof *value, compare);
        interval.low = value[(size_t)(0.025 * (good - 1))];
        interval.high = value[(size_t)ceil(0.975 * (good - 1))];
    }
done:
    free(weight);
    free(value);
    free(view);
    free(count);
    return interval;
}
