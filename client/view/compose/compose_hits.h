/* compose_hits.h: the nearest hits of a packet's rays, shaded.
 * Flow:    rays -> [compose_hits: trace, look, shade] -> radiance; the rays that go on behind the hits
 * Threads: any rendering thread. */
#ifndef LW_CLIENT_VIEW_COMPOSE_COMPOSE_HITS_H
#define LW_CLIENT_VIEW_COMPOSE_COMPOSE_HITS_H

#include "client/view/compose/compose_finish.h"

/** Takes in the nearest hits of a packet's rays; returns the rays that go on behind them.
 * last        the last layer: it counts as opaque
 * look, hits  of the rays in `going`, written
 * f           the lanes with a finish, written */
uint16_t lw_compose_hits_meet(struct lw_compose *compose, struct lw_compose_packet *p, uint16_t going,
                              bool last, struct lw_compose_patches *patches,
                              struct lw_compose_look look[LW_TRACE_WIDTH], struct lw_hit16 *hits,
                              struct lw_compose_finished *f);

#endif
