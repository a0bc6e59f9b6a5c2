/* scaling_users.h: what more and more users cost, at settings that were chosen.
 * Threads: main() only. For scaling_*.c alone. */
#ifndef LW_CLIENT_SCALING_SCALING_USERS_H
#define LW_CLIENT_SCALING_SCALING_USERS_H

#include "client/scaling/scaling_run.h"

/** Measures all counts of users, as often as the options say, and draws the figures from it. Each repeat
 * has other random numbers and begins with another user. A side that reached no setting leaves a shortfall.
 * Errors: the sides'. */
LW_MUST_CHECK enum lw_status lw_scaling_users(struct lw_scaling_run *run, struct lw_error *err);

#endif
