/* crossover_clock.h: a row by the wall clock: each side at the rate that it attains on this machine.
 * Flow:    row, its best setting of the cache -> [crossover_clock: real_run] -> notes of the row -> report
 * Threads: main() only.
 *
 * Under the manual clock a frame lasts 1/30 s of scene time, however long it takes. Here scene time is the
 * wall's, so that a slow side shows an old picture. One user sees some of the views alone, one after the
 * other, on all cores; the server and that user share them. Pictures are judged against light of the moment
 * at which they were ready, with the camera of the moment at which they were begun. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_CLOCK_H
#define LW_CLIENT_MEASURE_CROSSOVER_CLOCK_H

#include "client/measure/crossover_row.h"

/* what a note of a renderer by the wall clock begins with; then renderer and setting */
#define LW_CROSSOVER_CLOCK_KEY "clock "

struct lw_crossover_clock {
    double views_hz;    /* pictures a second */
    double light_age_s; /* mean, when a picture is ready */
    double relmse;      /* mean over pictures that are judged; NAN: none is */
    uint32_t pictures;
};

/** Measures the opponents that filter, and of the cache the cheapest setting that reaches svgf's relMSE, or
 * else the best; figures that the row has already are not measured again.
 * Errors: those of the server and the renderers; LW_CLOSED if cancelled; the store's. */
LW_MUST_CHECK enum lw_status lw_crossover_clock_measure(struct lw_crossover_row *row, struct lw_error *err);

/** Reads the figures that a row has of a renderer at a setting. Returns false if it has none. */
bool lw_crossover_clock_read(const struct lw_measure_store *store, const char *renderer, const char *setting,
                             struct lw_crossover_clock *out);

#endif
