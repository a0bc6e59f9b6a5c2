/* crossover_analysis.h: errors of a row, ratios of costs at equal error, and their intervals.
 * Flow:    measure_store -> [crossover_analysis: by renderer and setting, paired over views and repeats]
 *          -> report
 * Threads: pure functions of the store, [any].
 *
 *     r(1)  the cost of a user who has the cache alone, over an opponent's frame
 *     m     the cost of one more of twelve users, over an opponent's frame: ((C12 - C1) / 11) / A */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_ANALYSIS_H
#define LW_CLIENT_MEASURE_CROSSOVER_ANALYSIS_H

#include "client/measure/figures/bootstrap.h"
#include "client/measure/measure_store.h"

#define LW_CROSSOVER_POINTS_MAX 64u
#define LW_CROSSOVER_GATE_LATE  30u /* frames; for LW_MEASURE_GATE_TIMES */

/** A renderer at a setting. Cells are [view * repeats + repeat]. */
struct lw_crossover_point {
    char renderer[LW_MEASURE_NAME_SIZE], setting[LW_MEASURE_NAME_SIZE];
    bool is_cache;
    uint32_t repeats; /* the row's */
    uint8_t there[LW_MEASURE_VIEWS * LW_MEASURE_REPEATS_MAX];
    double error[LW_MEASURE_COIN_COUNT][LW_MEASURE_VIEWS * LW_MEASURE_REPEATS_MAX]; /* NAN: none */
    double alone_s[LW_MEASURE_VIEWS * LW_MEASURE_REPEATS_MAX]; /* CPU s a frame, one user; NAN: none */
    double all_s[LW_MEASURE_REPEATS_MAX]; /* cache: CPU s a frame, twelve users; NAN: none */
    struct lw_measure_expense all;        /* mean over repeats of the lines that end units */
    struct lw_measure_expense one;        /* mean over lines of one user */
    struct lw_bootstrap_interval mean[LW_MEASURE_COIN_COUNT];
    struct lw_bootstrap_interval cost_s; /* CPU s a frame for one user, alone */
};

struct lw_crossover_analysis {
    struct lw_crossover_point *point;
    uint32_t point_count, repeats;
    /* relMSE of light that is a second late, mean over views; NAN: nothing moves, or it is not known */
    double late_error;
};

/** Settings beyond the first LW_CROSSOVER_POINTS_MAX are left out, with a line of log.
 * Errors: LW_NO_MEMORY, LW_BAD_DATA (nothing measured). */
LW_MUST_CHECK enum lw_status lw_crossover_analysis_init(struct lw_crossover_analysis *analysis,
                                                        const struct lw_measure_store *store,
                                                        struct lw_error *err);
void lw_crossover_analysis_finish(struct lw_crossover_analysis *analysis);

/** NULL: there is none. */
const struct lw_crossover_point *lw_crossover_analysis_find(const struct lw_crossover_analysis *analysis,
                                                            const char *renderer, const char *setting);

/** The cache's cheapest setting with at most this error, of those with a known cost; NULL: none reaches
 * it. */
const struct lw_crossover_point *lw_crossover_analysis_cheapest(const struct lw_crossover_analysis *analysis,
                                                                enum lw_measure_coin coin, double error);
/** The cache's setting with the least error; NULL: there is none. */
const struct lw_crossover_point *lw_crossover_analysis_best(const struct lw_crossover_analysis *analysis,
                                                            enum lw_measure_coin coin);
/** The cheapest opponent that reaches an error; NULL: none. */
const struct lw_crossover_point *lw_crossover_analysis_opponent(const struct lw_crossover_analysis *analysis,
                                                                enum lw_measure_coin coin, double error);

/** The cache over an opponent. */
struct lw_crossover_ratio {
    struct lw_bootstrap_interval r1, m, error;
};
struct lw_crossover_ratio lw_crossover_analysis_compare(const struct lw_crossover_point *cache,
                                                        const struct lw_crossover_point *opponent,
                                                        enum lw_measure_coin coin);

/** CPU s of a user's frame when all start-up is spread over a session of this length, of 30 frames a
 * second.
 * `users` share the server's part. NAN: not known. */
double lw_crossover_analysis_session(const struct lw_crossover_point *point, double session_s,
                                     uint32_t users);

/** CPU s a frame of one user at which the cache's settings, by increasing cost, first reach an error.
 * Between two settings it follows a line in logarithms. NAN: they do not reach it. */
double lw_crossover_analysis_crossing(const struct lw_crossover_analysis *analysis, enum lw_measure_coin coin,
                                      double error);

#endif
