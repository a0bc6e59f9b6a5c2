/* bake_memory.h: whether a bake lights all texels at once or tile by tile.
 * Flow:    scene, --memory -> [bake_memory] -> the choice of a solver
 * Threads: main() only. */
#ifndef LW_BAKE_BAKE_MEMORY_H
#define LW_BAKE_BAKE_MEMORY_H

#include "server/solve/tile_by_tile.h"

/** Chooses tile by tile (tile_by_tile.h) where a solve of all texels takes more memory than it may, and says
 * so in a line.
 * desc          of the solver of all texels, with the scene
 * memory_bytes  0: three quarters of the machine's
 * Errors        LW_NO_MEMORY with the MB needed: tile by tile is too much, too, or `entry` lights no tiles
 *               one after another */
LW_MUST_CHECK enum lw_status lw_bake_memory_choose(const struct lw_solvers_entry *entry,
                                                   const struct lw_solver_desc *desc, uint64_t memory_bytes,
                                                   bool *out_by_tile, struct lw_error *err);

#endif
