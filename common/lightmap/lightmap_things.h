/* lightmap_things.h: how large the things are that a mesh shows.
 * Flow:    mesh -> topology -> [things] -> the default density
 * Threads: pure functions of a mesh; [any]. */
#ifndef LW_COMMON_LIGHTMAP_THINGS_H
#define LW_COMMON_LIGHTMAP_THINGS_H

#include "common/scene/scene.h"

/** The length of a mesh's edges, in its units. An edge where the surface ends or turns by a right angle or
 * more counts in full, a gentler one by its share of a right angle. So a round thing has the same length
 * however finely it is divided (the integral of absolute mean curvature, times 4 / pi). By this length, twice
 * the area is a size: the side of a cube, the side of a square.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_things_edges(const struct lw_mesh *mesh, double *out_length);

#endif
