/* coarse_first.h: a solver that has light soon: first that of a coarse scene (coarse_scene.h), then that of a
 * solver of the whole density, which a thread builds meanwhile.
 * Flow:    scene, pose -> coarse solver -> [coarse_first] -> tiles of level 0 -> publish
 *                      -> whole solver  ->
 * Threads: those of solver.h, and one that builds.
 *
 *     frames:    | coarse ... coarse, and a thread builds | both, LW_COARSE_TILES_FRAMES times | whole ...
 *     tiles of:  | coarse                                 | coarse                             | each
 *
 * In the end a tile is the whole solver's once that has solved it LW_COARSE_TILES_FRAMES times; all are once
 * something moves, once another channel is shown, or after LW_COARSE_FIRST_KEPT frames.
 *
 * The frame at which the whole solver takes over follows the clock, so runs that are to be repeatable do
 * without. Until then all objects are solved, of interest or not, and there are no tiles of finer levels.
 * Saving writes nothing before it. Loading waits for the whole solver, if there is a file. */
#ifndef LW_SOLVE_COARSE_FIRST_H
#define LW_SOLVE_COARSE_FIRST_H

#include "server/solve/solvers.h"

/** Frames that the coarse solver solves before the other one is built, for a smooth first picture. */
#define LW_COARSE_FIRST_ALONE 4u
/** Frames after which no tile is coarse: half a minute of the daemon's. */
#define LW_COARSE_FIRST_KEPT 900u
/** A scene with fewer texels is lit as soon without. */
#define LW_COARSE_FIRST_TEXELS_MIN 65536u

/** Whether a scene has texels enough. */
bool lw_coarse_first_pays(const struct lw_scene *scene);

/** Builds the coarse solver.
 * entry   both solvers: one that shows tiles by channels, as the cell solver does
 * desc    of the whole solver; what it points to outlives the solver. Its saved texels are copied.
 * Errors  as entry->create(). Later frames return what the building of the whole solver does. */
LW_MUST_CHECK enum lw_status lw_coarse_first_create(const struct lw_solvers_entry *entry,
                                                    const struct lw_solver_desc *desc,
                                                    const struct lw_pose *pose, struct lw_solver **out_solver,
                                                    struct lw_error *err);

/** Waits until the whole solver is built; the next frame is the first one that it solves. solver: of
 * lw_coarse_first_create(), after LW_COARSE_FIRST_ALONE frames */
void lw_coarse_first_wait(struct lw_solver *solver);

#endif
