/* estimates.h: the noise of a tile's estimates, and the error of its light.
 * Flow:    sums and estimates of a frame -> [estimates] -> error of blocks and tile -> converged.h, schedule
 * Threads: each call works on one tile. [any worker] */
#ifndef LW_ADAPT_ESTIMATES_H
#define LW_ADAPT_ESTIMATES_H

#include "server/solve/transport/transport.h"

/** Sets the errors of a tile and its blocks. A block's noise is measured against its own light or the
 * tile's, whichever is more, so that a dark corner of a lit tile need not be known better than the others;
 * light from other layers counts too. */
void lw_estimates_judge(const struct lw_transport *transport, struct lw_solve_tile *tile);

/** After the last bounce: sums the orders, updates the noise estimates, judges. */
void lw_estimates_finish_tile(const struct lw_transport *transport, struct lw_solve_tile *tile);

#endif
