/* lightmap_merge.h: joins charts where that saves room in the atlas.
 * Flow:    charts: grow -> [merge] -> pack
 * Threads: one mesh at a time per thread. */
#ifndef LW_COMMON_LIGHTMAP_MERGE_H
#define LW_COMMON_LIGHTMAP_MERGE_H

#include "common/lightmap/lightmap_apart.h"
#include "common/lightmap/lightmap_chart.h"
#include "common/lightmap/lightmap_plane.h"

/** Joins two charts that share an edge where one rectangle around both costs less than two. The remaining
 * charts are numbered without gaps. plane: room for all triangles of the mesh. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_merge(struct lw_lightmap_charts *charts,
                                               const struct lw_lightmap_topology *topology,
                                               struct lw_lightmap_plane *plane,
                                               struct lw_lightmap_apart *apart);

#endif
