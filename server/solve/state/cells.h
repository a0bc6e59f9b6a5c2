/* cells.h: the regular grid of radiance cells: who owns which tile, in which order tiles are solved.
 * Threads: built by one thread; then [any].
 * After:   Vandersanden 2023, 3.3 (grid over the scene), with tiles instead of
 *          texels as the unit of ownership. */
#ifndef LW_STATE_CELLS_H
#define LW_STATE_CELLS_H

#include "common/base/status.h"
#include "common/base/vec.h"

#include <stdint.h>

#define LW_CELLS_PER_AXIS_MAX 32u /* a smaller cell size than this allows is enlarged */

struct lw_cells {
    struct lw_vec3 minimum_ws, maximum_ws; /* the scene's box, a little enlarged */
    struct lw_vec3 size_m; /* one cell's; cubes but for rounding, an axis of no extent has one cell */
    uint32_t count[3];
};

/** Lays the grid over a box. cell_size_m 0: a quarter of the longest side. */
void lw_cells_init(struct lw_cells *cells, struct lw_vec3 minimum_ws, struct lw_vec3 maximum_ws,
                   float cell_size_m);
uint32_t lw_cells_total(const struct lw_cells *cells);
/** The cell that holds a point; the nearest one for a point outside. */
uint32_t lw_cells_at(const struct lw_cells *cells, struct lw_vec3 point_ws);
struct lw_vec3 lw_cells_centre(const struct lw_cells *cells, uint32_t cell);
/** Whether a point lies in the box; NaN does not. */
bool lw_cells_contain(const struct lw_cells *cells, struct lw_vec3 point_ws);
/** Where a ray from a point inside leaves the scene's box (the point itself if it is outside). */
struct lw_vec3 lw_cells_project(const struct lw_cells *cells, struct lw_vec3 point_ws,
                                struct lw_vec3 direction);

#endif
