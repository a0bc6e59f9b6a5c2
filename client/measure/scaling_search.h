/* scaling_search.h: the cheapest setting of each side that reaches an error.
 * Threads: main() only. For scaling_*.c alone. */
#ifndef LW_CLIENT_MEASURE_SCALING_SEARCH_H
#define LW_CLIENT_MEASURE_SCALING_SEARCH_H

#include "client/measure/scaling_run.h"

/** Tries settings and fills in points and targets.
 * The path tracer's samples are doubled until they reach a target, then found between the last two.
 * The cache starts with a quarter of the default density. At each density it goes up its rungs: more
 * samples, with blocks that converge at a higher error below the first rung. In a still scene a rung is a
 * lower target error. It goes on until the hardest target is reached or a rung gains nothing, then to the
 * next density, up to twice the default.
 * Errors: the sides'. */
LW_MUST_CHECK enum lw_status lw_scaling_search(struct lw_scaling *x, struct lw_error *err);

#endif
