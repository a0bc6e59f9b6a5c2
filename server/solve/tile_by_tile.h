/* tile_by_tile.h: a solver for maps that do not fit into memory: it holds the light of a coarse scene and of
 * a few tiles, and keeps finished tiles in a file.
 * Flow:    coarse scene (coarse_scene.h) -> cell solver -> [tile_by_tile] -> tile_file -> maps
 * Threads: those of solver.h.
 *
 *     frames:  | the coarse scene, until it has converged | its tiles of the finer level 2, some at a time
 *     file:    |                                          | each of them, once it has converged
 *
 * Such a tile has the texels of a tile of level 0 of the scene itself (fine_tiles.h). Its rays end on the
 * coarse scene. Until it is in the file it reads as coarse light, interpolated (coarse_tiles.h). Nothing is
 * welded between tiles, and the filter filters each by itself.
 *
 * A later run with the same file and key goes on: finished tiles are not lit again. Unfinished ones begin
 * again, with the same samples. */
#ifndef LW_SOLVE_TILE_BY_TILE_H
#define LW_SOLVE_TILE_BY_TILE_H

#include "server/solve/solvers.h"

/* Tiles that are lit at a time. */
#define LW_TILE_BY_TILE_AT_ONCE 64u

struct lw_tile_by_tile_desc {
    const char *path;  /* the file's */
    uint8_t key[16];   /* as for lw_solver_ops.save() */
    uint32_t channels; /* shown ones: the file holds these alone */
    bool has_albedo;   /* the file holds albedo, too */
};

/** Bytes of memory that it takes, roughly, beside the rays' structure. desc: with the scene */
uint64_t lw_tile_by_tile_forecast(const struct lw_solver_desc *desc);

/** Builds the solver of the coarse scene. It knows no interest. Filtered tiles are filtered as they are lit.
 * desc    of the whole solver, without light groups; what it points to outlives the solver
 * Errors  as entry->create(), lw_tile_file_open() */
LW_MUST_CHECK enum lw_status lw_tile_by_tile_create(const struct lw_solvers_entry *entry,
                                                    const struct lw_solver_desc *desc,
                                                    const struct lw_pose *pose,
                                                    const struct lw_tile_by_tile_desc *how,
                                                    struct lw_solver **out_solver, struct lw_error *err);

#endif
