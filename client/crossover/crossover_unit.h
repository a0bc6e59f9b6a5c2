/* crossover_unit.h: one renderer at one setting in one repeat: all its frames, errors and costs.
 * Flow:    renderer, references -> [crossover_unit] -> samples, costs, pictures
 * Threads: main() only. */
#ifndef LW_CLIENT_CROSSOVER_CROSSOVER_UNIT_H
#define LW_CLIENT_CROSSOVER_CROSSOVER_UNIT_H

#include "client/crossover/crossover_run.h"

/** A renderer at a setting, as it is to be measured. */
struct lw_crossover_plan {
    struct lw_crossover_unit unit;
    bool is_cache;
    enum lw_path_renderer_kind kind; /* of a path renderer */
    struct lw_setting setting;
    uint32_t density, rung; /* of the cache: which in its ladder */
};

/** Measures and appends it. Pictures are kept of repeat 0.
 * Errors: LW_CLOSED with *run->cancel set: cancelled; LW_IO, LW_CANNOT_CREATE: what was measured before is
 * there; else the renderer's own. */
LW_MUST_CHECK enum lw_status lw_crossover_unit_measure(struct lw_crossover_run *run,
                                                       const struct lw_crossover_plan *plan,
                                                       struct lw_error *err);

#endif
