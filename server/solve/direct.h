/* direct.h: the direct light of a packet's texels. The estimators are in passes.h.
 * Flow:    launch, lights -> [direct] -> passes
 * Threads: [any worker] */
#ifndef LW_SOLVE_DIRECT_H
#define LW_SOLVE_DIRECT_H

#include "server/solve/launch.h"
#include "server/solve/passes.h"

/** Of E, W/m^2, of each lane. */
struct lw_direct_estimate {
    float all[3][LW_TRACE_WIDTH], drawn[3][LW_TRACE_WIDTH]; /* drawn: what client lights give of it */
};

/** One frame's estimate, of each lane by itself. Needs the launch's places for the frame's first sample and
 * the site's frame; further samples choose places of their own. Adds the shadow rays to the count. */
void lw_direct_light(const struct lw_passes *passes, const struct lw_solve_tile *tile,
                     struct lw_launch *launch, struct lw_launch_site *site,
                     struct lw_direct_estimate *out_estimate, struct lw_passes_count *count);

#endif
