/* crossover_plan.h: which renderers and settings a row measures.
 * Flow:    options, lightmap sizes, errors of repeat 0 -> [crossover_plan] -> crossover_run
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_PLAN_H
#define LW_CLIENT_MEASURE_CROSSOVER_PLAN_H

#include "client/measure/crossover_row.h"

#define LW_CROSSOVER_PLANS_MAX 128u
#define LW_CROSSOVER_GAIN_MIN  0.9 /* more samples must bring the error below this share of it */

/** A renderer at a setting that shall be measured. */
struct lw_crossover_plan {
    struct lw_measure_unit unit;
    bool is_cache;
    enum lw_path_renderer_kind kind; /* a path renderer's */
    struct lw_setting setting;
    uint32_t density, rung; /* the cache's: index of its density, index of its sample counts */
};

/** Lists all plans: path renderers, then the cache by growing density. Notes in the row which densities have
 * too many texels. Errors: those of lw_measure_row_note(). */
LW_MUST_CHECK enum lw_status lw_crossover_plan_all(struct lw_crossover_row *row,
                                                   struct lw_crossover_plan out_plan[LW_CROSSOVER_PLANS_MAX],
                                                   uint32_t *out_count, struct lw_error *err);

/** Whether more samples gained nothing at a lower density. At a higher one they cost four times as much.
 * Only repeat 0 counts, so all repeats, and a run that goes on, leave out the same plans. */
bool lw_crossover_plan_is_idle(const struct lw_crossover_row *row, const struct lw_crossover_plan *plan,
                               uint32_t count, const struct lw_crossover_plan *next);

#endif
