/* shown.h: makes the shown planes of tiles from their sums, by channel: filter, welds, gutters.
 * Flow:    sums of the blocks that a frame shows -> [filter, welds, gutters] -> tiles->shown -> read_tile
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
    bool filters;              /* frames filter; else they show sums as they are */
    struct lw_denoise denoise; /* empty until first used */
    struct lw_seams_welds welds;
    uint32_t seams_found; /* lw_geometry.seams_found that the welds belong to */
    uint32_t channels;    /* the shown channels (tile_channels.h) */
    bool all;             /* a channel is new: the next frame shows every block, and clears this */
};

/** Finds seams, and sets up the filter if frames filter. The caller has set the first six fields. Shows FULL.
 * Errors: LW_NO_MEMORY; finish it then. */
LW_MUST_CHECK enum lw_status lw_shown_init(struct lw_shown *shown, struct lw_error *err);
void lw_shown_finish(struct lw_shown *shown);

/** Chooses the shown channels: lw_solver_ops.choose_channels(). Returns as lw_tiles_judge_channels(). */
bool lw_shown_choose(struct lw_shown *shown, uint32_t channels);

/** Shows the blocks whose shown_frame is `frame`: filtered, or as they are. */
void lw_shown_filter(struct lw_shown *shown, uint64_t frame);
/** Welds seams and fills gutters around these blocks, after lw_shown_filter(). Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_shown_weld(struct lw_shown *shown, uint64_t frame, struct lw_error *err);
/** Does both, and filters even if frames do not. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_shown_filter_once(struct lw_shown *shown, uint64_t frame,
                                                  struct lw_error *err);

/** As lw_solver_ops.read_tile(). */
void lw_shown_read_tile(const struct lw_shown *shown, lw_tile_id id, uint32_t bounces,
                        struct lw_solver_tile *out_tile);

/** Bytes held, without the geometry and the tiles. */
size_t lw_shown_memory_bytes(const struct lw_shown *shown);

#endif
