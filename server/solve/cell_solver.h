/* cell_solver.h: the solver after Vandersanden 2023: radiance cells own tiles; direct pass, then per bounce probe
 * gathering and cell scattering, with barriers in between.
 * Implements server/solve/solver.h. */
#ifndef LW_SOLVE_CELL_SOLVER_H
#define LW_SOLVE_CELL_SOLVER_H

#include "server/solve/geometry.h"
#include "server/solve/solver.h"
#include "server/solve/state/tiles.h"

/* While something moves, probes remember so many frames. */
#define LW_CELL_SOLVER_HISTORY_PROBES 16
/* Frames after a movement until probes are taken to have forgotten the time before. */
#define LW_CELL_SOLVER_FADE_FRAMES 128u

/** Builds texels, cells and the rays' structure.
 * Errors: LW_NO_MEMORY, LW_INTERNAL; LW_BAD_DATA for more texels than fit. */
LW_MUST_CHECK enum lw_status lw_cell_solver_create(const struct lw_solver_desc *desc,
                                                   const struct lw_pose *pose, struct lw_solver **out_solver,
                                                   struct lw_error *err);

/** The same over a geometry that others share, which is at that pose and outlives it. desc->scene may have other emission and
 * another sky than the geometry's, nothing else. */
LW_MUST_CHECK enum lw_status lw_cell_solver_create_over(struct lw_geometry *geometry,
                                                        const struct lw_solver_desc *desc,
                                                        const struct lw_pose *pose,
                                                        struct lw_solver **out_solver, struct lw_error *err);

/** What it holds, between two frames. Of that, `beside` of blocks may be written. */
struct lw_tiles *lw_cell_solver_tiles(struct lw_solver *solver);

/** Gives the frames to come so much wall time for solving, about; 0: as long as it takes. yields: they solve
 * nothing, and only ask what has changed. hasty: something has begun to move, after a while in which nothing did: what follows from that comes
 * before all else. */
void lw_cell_solver_give(struct lw_solver *solver, double budget_s, bool yields, bool hasty);

/** How much has changed of what the last frame had no time for, in a few steps; 0: it had for all. The last one: its lights have moved, and not
 * all that is looked at knows. */
#define LW_CELL_SOLVER_HURRY_MOST 16u
unsigned lw_cell_solver_hurry(const struct lw_solver *solver);

/** Asks of every block at rest whether it may be, as `beside` is now. */
void lw_cell_solver_review(struct lw_solver *solver);

#endif
