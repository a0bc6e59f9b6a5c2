/* sparse_solver.h: a live solver for scenes whose lightmaps do not fit into memory: it holds a coarse scene
 * (coarse_scene.h), and level 0 and finer levels where somebody looks.
 * Flow:    coarse scene -> solver with finer levels -> [sparse_solver] -> tiles -> publish
 * Threads: those of solver.h.
 *
 *     the scene:         level 2 and coarser | level 0, 1      | finer by 2^k
 *     the inner solver:  level 0 and coarser | finer by 2^2    | finer by 2^(k + 2)
 *     there:             always              | of interest     | of interest
 *
 * Rays end on the coarse scene. Until a tile of level 0 has LW_COARSE_TILES_FRAMES frames it reads as coarse
 * light, interpolated (coarse_tiles.h), and so it does when it has made room for another. Which tiles are
 * there, and which go first, follows fine_tiles.h. */
#ifndef LW_SOLVE_SPARSE_SOLVER_H
#define LW_SOLVE_SPARSE_SOLVER_H

#include "server/solve/solvers.h"

/** Builds the solver of the coarse scene.
 * entry   of a solver with finer levels, as the cell solver is
 * desc    of the whole scene, and as many fine_tiles as are to be held, of level 0 and of finer levels, above
 *         0. Its saved texels are read here. Its other pointers outlive the solver
 * Errors  as entry->create() */
LW_MUST_CHECK enum lw_status lw_sparse_solver_create(const struct lw_solvers_entry *entry,
                                                     const struct lw_solver_desc *desc,
                                                     const struct lw_pose *pose,
                                                     struct lw_solver **out_solver, struct lw_error *err);

#endif
