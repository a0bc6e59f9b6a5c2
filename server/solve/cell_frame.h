/* cell_frame.h: a frame of the cell solver, in seven stages.
 * Flow:    pose -> [pose, plan, verify, plan again, light, show, note] -> tiles
 * Threads: one thread calls; each stage runs its own workers (adapt/work.h). */
#ifndef LW_SOLVE_CELL_FRAME_H
#define LW_SOLVE_CELL_FRAME_H

#include "server/solve/cell_data.h"

/** Runs a frame; as lw_solver_ops.frame(). */
LW_MUST_CHECK enum lw_status lw_cell_frame_run(struct lw_cell_solver *s, const struct lw_pose *pose,
                                               uint64_t number, struct lw_solver_stats *out_stats,
                                               struct lw_error *err);

/** Whether lights have moved, and not all tiles of interest were verified since. */
bool lw_cell_frame_is_behind(const struct lw_cell_solver *s);

/** Sets what all tiles send out, from their sums. */
void lw_cell_frame_radiate_all(struct lw_cell_solver *s);

/** What passes of this solver work on. */
struct lw_transport lw_cell_frame_transport(struct lw_cell_solver *s);

/** A tile of a finer level comes, or goes (lw_fine_tiles_layer). */
void lw_cell_frame_forget_tile(void *solver, lw_tile_id id);
/** After that. */
void lw_cell_frame_place_tiles(void *solver);

#endif
