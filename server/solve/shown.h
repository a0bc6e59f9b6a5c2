/* shown.h: what a solver shows of its tiles: their sums, filtered, welded, with gutters, by channel.
 * Flow:    tiles: sums of the blocks that a frame shows -> [shown: filter, welds, gutters] -> tiles->shown
 * Threads: those of solver.h. */
#ifndef LW_SOLVE_SHOWN_H
#define LW_SOLVE_SHOWN_H

#include "server/solve/geometry.h"

struct lw_shown {
    struct lw_geometry *geometry; /* outlives it, as do: */
    const struct lw_atlas_map *map;
    struct lw_tiles *tiles;
    int threads;
    bool seams_later;          /* (lw_geometry_find_seams()) */
    bool filters;              /* frames filter */
    struct lw_denoise denoise; /* empty until something is filtered */
    struct lw_seams_welds welds;
    uint32_t seams_found; /* of the geometry: those that the welds are of */
    uint32_t channels;    /* that are shown (tile_channels.h) */
    /* One of them is new: the next frame shows everything, and sets it back. */
    bool all;
};

/** The first seven fields are set by the caller. Shows FULL alone, to begin with.
 * Errors: LW_NO_MEMORY; finish it then. */
LW_MUST_CHECK enum lw_status lw_shown_init(struct lw_shown *shown, struct lw_error *err);
void lw_shown_finish(struct lw_shown *shown);

/** As lw_solver_ops.show(). Returns whether errors are measured otherwise from now on (lw_tiles_judge_channels). */
bool lw_shown_choose(struct lw_shown *shown, uint32_t channels);

/** Shows the blocks of frame `frame` (shown_frame): filtered, or as they are. */
void lw_shown_filter(struct lw_shown *shown, uint64_t frame);
/** After it: light agrees over seams, and gutters are filled. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_shown_weld(struct lw_shown *shown, uint64_t frame, struct lw_error *err);
/** Both, filtered whatever frames do. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_shown_filter_once(struct lw_shown *shown, uint64_t frame,
                                                  struct lw_error *err);

/** As lw_solver_ops.read_tile(). */
void lw_shown_read_tile(const struct lw_shown *shown, lw_tile_id id, uint32_t bounces,
                        struct lw_solver_tile *out_tile);

/** Bytes held, but for the geometry and the tiles. */
size_t lw_shown_memory_bytes(const struct lw_shown *shown);

#endif
