/* scaling_users.h: the cost of growing numbers of users, at the chosen settings.
 * Threads: main() only. For scaling_*.c alone. */
#ifndef LW_CLIENT_MEASURE_SCALING_USERS_H
#define LW_CLIENT_MEASURE_SCALING_USERS_H

#include "client/measure/scaling_run.h"

/** Measures all counts of users, as many times as the options say, and computes the figures. Each repeat
 * has other random numbers and begins with another user. Where a side reached no setting it sets the
 * shortfall.
 * Errors: the sides'. */
LW_MUST_CHECK enum lw_status lw_scaling_users(struct lw_scaling *x, struct lw_error *err);

#endif
