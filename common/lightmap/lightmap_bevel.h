/* lightmap_bevel.h: corners that a bevel rounds off within a texel.
 * Flow:    topology -> [bevel] -> more hard edges -> charts
 * Threads: pure functions of a mesh; [any].
 *
 * A chart that ran around a bevel would have both sides of a corner in one texel, and light of one side would
 * show on the other. No edge of a bevel is hard: it bends in steps. So each narrow triangle belongs to the
 * nearest wide one, at most half a texel away, and where those of two neighbours face far apart, the edge
 * between them is hard: the bevel is cut along its middle. */
#ifndef LW_COMMON_LIGHTMAP_BEVEL_H
#define LW_COMMON_LIGHTMAP_BEVEL_H

#include "common/lightmap/lightmap_topology.h"

/* Walls that face over 50 degrees apart make a corner. */
#define LW_LIGHTMAP_CORNER_COS 0.64f

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_bevel_cut(struct lw_lightmap_topology *topology);

#endif
