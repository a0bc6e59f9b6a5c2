/* cell_layer.h: the cell solver, alone or as one layer of light: beside solver.h, its
 * blocks and its turn in a frame.
 * Flow:    solvers, light_layers -> [cell_layer] -> solver.h
 * Threads: those of solver.h.
 *
 * The solver is that of Vandersanden 2023: radiance cells own tiles; direct pass, then for each bounce probes
 * gather and cells scatter, with barriers in between. For solvers.c, light_layers.c and tests of its inside
 * alone: everybody else takes solvers.h. */
#ifndef LW_SOLVE_CELL_LAYER_H
#define LW_SOLVE_CELL_LAYER_H

#include "server/solve/geometry.h"
#include "server/solve/solver.h"
#include "server/solve/state/tiles.h"

/* Frames that probes' histories stand for while something moves. */
#define LW_CELL_LAYER_HISTORY_PROBES 16
/* Frames after a movement until probes are taken to have forgotten the time before. */
#define LW_CELL_LAYER_FADE_FRAMES 128u

/** Builds a cell solver.
 * geometry  NULL: one of its own; else one that layers share, which is at that pose and outlives it.
 *           desc->scene may have other emission and another sky than the geometry's, nothing else
 * Errors    as lw_solvers_entry.create() */
LW_MUST_CHECK enum lw_status lw_cell_layer_create(struct lw_geometry *geometry,
                                                  const struct lw_solver_desc *desc,
                                                  const struct lw_pose *pose, struct lw_solver **out_solver,
                                                  struct lw_error *err);

/** Its blocks and sums, between two frames. Only `beside` of blocks may be written. */
struct lw_tiles *lw_cell_layer_tiles(struct lw_solver *solver);

/** What a layer gets of a frame, if frames have a budget. */
struct lw_cell_layer_turn {
    double budget;      /* wall time in s, or units, as the desc has it */
    bool onset, yields; /* (adapt/budget.h) */
};

/** Sets the turn of the frames to come. */
void lw_cell_layer_set_turn(struct lw_solver *solver, const struct lw_cell_layer_turn *turn);

/* The most that lw_cell_layer_backlog() says: lights have moved, and not all
 * tiles of the interest set know. */
#define LW_CELL_LAYER_BACKLOG_MAX 16u
/** How much has changed of what the last frame had no time for, in a few steps; 0: it had for all. */
unsigned lw_cell_layer_backlog(const struct lw_solver *solver);

/** Whether the last frame solved some of a tile. */
bool lw_cell_layer_solved(const struct lw_solver *solver, lw_tile_id id);

/** Judges again whether converged blocks are converged, with other_luminance as it is now. */
void lw_cell_layer_review(struct lw_solver *solver);

#endif
