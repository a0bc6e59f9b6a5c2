/* crossover_unit.h: one renderer at one setting in one repeat: all its frames, errors and costs.
 * Flow:    renderer, references -> [crossover_unit] -> samples, costs, pictures
 * Threads: main() only.
 *
 * Path renderers draw the frames that their histories need, one user after another. The cache is one server
 * with twelve clients, one a view, from frame 1 on. After the judged frames all clients but one leave, and
 * that one views some of the views alone. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_UNIT_H
#define LW_CLIENT_MEASURE_CROSSOVER_UNIT_H

#include "client/measure/crossover_plan.h"

/** Measures a plan and appends it to the store. Pictures of repeat 0 are kept.
 * Errors: LW_CLOSED with *row->cancel set: cancelled; LW_IO, LW_CANNOT_CREATE: earlier units are still
 *         there; else the renderer's own. */
LW_MUST_CHECK enum lw_status lw_crossover_unit_measure(struct lw_crossover_row *row,
                                                       const struct lw_crossover_plan *plan,
                                                       struct lw_error *err);

#endif
