/* lightmap_split.h: cuts charts that are mostly holes.
 * Flow:    charts: grow -> [split] -> merge -> pack
 * Threads: one mesh at a time per thread. */
#ifndef LW_COMMON_LIGHTMAP_SPLIT_H
#define LW_COMMON_LIGHTMAP_SPLIT_H

#include "common/lightmap/lightmap_chart.h"

/** Cuts rings, frames and arcs across, where the pieces' rectangles cost clearly less than that of the whole.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_split(struct lw_lightmap_charts *charts,
                                               const struct lw_lightmap_topology *topology);

#endif
