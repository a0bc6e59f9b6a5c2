/* white.h: the E that nearly all of a scene's light is under, which tells how dark looks black.
 * Flow:    solved tiles -> [white] -> publisher -> tile codec
 * The values are means of all light over squares of 8 x 8 texels of level 0. Each square counts once. A value
 * is held as its bin alone: six bytes a square.
 * Threads: one worker notes a tile. lw_white_find() runs alone. */
#ifndef LW_PUBLISH_WHITE_H
#define LW_PUBLISH_WHITE_H

#include "common/tile/atlas.h"
#include "server/solve/solver.h"

/* White is the E that this share of the values is under. */
#define LW_WHITE_QUANTILE 0.99

struct lw_white {
    const struct lw_atlas_map *map;
    uint32_t *first;    /* per plain tile id: its first square; only tiles of level 0 have some */
    uint16_t (*bin)[3]; /* per square: of red, green, blue */
    size_t square_count;
};

/** Before any light. The map outlives it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_white_init(struct lw_white *white, const struct lw_atlas_map *map);
void lw_white_finish(struct lw_white *white);

/** Replaces the values of a tile of level 0. tile: with its planes of light. */
void lw_white_note(struct lw_white *white, lw_tile_id id, const struct lw_solver_tile *tile);

/** White, W/m^2, up to a fifth too low: the lower end of its bin. 0: nothing was noted.
 * hidden  per object: its light does not count */
float lw_white_find(const struct lw_white *white, const bool *hidden);

/** Bytes held. */
size_t lw_white_memory_bytes(const struct lw_white *white);

#endif
