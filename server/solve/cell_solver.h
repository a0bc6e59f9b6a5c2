/* cell_solver.h: the solver after Vandersanden 2023: radiance cells own tiles; direct pass, then per bounce probe
 * gathering and cell scattering, with barriers in between.
 * Implements server/solve/solver.h. */
#ifndef LW_SOLVE_CELL_SOLVER_H
#define LW_SOLVE_CELL_SOLVER_H

#include "server/solve/solver.h"

/* While something moves, sums forget: short for direct light, whose noise is small and whose shadows must follow;
 * longer for the smooth, noisy rest. */
#define LW_CELL_SOLVER_HISTORY_DIRECT   4u
#define LW_CELL_SOLVER_HISTORY_INDIRECT 16u
/* A tile rests at the target error, but never before it has seen this many frames. */
#define LW_CELL_SOLVER_FRAMES_MIN 16u
/* Nor sooner than this many frames after a movement: by then under 1/25 of the sums is of the time before. */
#define LW_CELL_SOLVER_FADE_FRAMES 128u

/** Builds texels, cells and the rays' structure.
 * Errors: LW_NO_MEMORY, LW_INTERNAL; LW_BAD_DATA for more texels than fit. */
LW_MUST_CHECK enum lw_status lw_cell_solver_create(const struct lw_solver_desc *desc,
                                                   const struct lw_pose *pose, struct lw_solver **out_solver,
                                                   struct lw_error *err);

#endif
