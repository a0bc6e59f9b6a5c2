/* interest_union.h: the union of all interest sets: how many sessions want each tile.
 * Flow:    each session's interest -> [interest_union] -> level-0 tiles of
 *          interest, from which level -> solver
 * Threads: [loop]. */
#ifndef LW_SERVE_TILES_INTEREST_UNION_H
#define LW_SERVE_TILES_INTEREST_UNION_H

#include "common/tile/atlas.h"

struct lw_interest_union {
    const struct lw_atlas_map *atlas_map;
    uint32_t everything; /* sessions that want every tile */
    uint32_t *count;     /* per lw_tile_id: sessions that want this one */
    bool changed; /* the union of the sessions' interest sets has changed since this was last set to false */
};

/** atlas_map outlives it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_interest_union_init(struct lw_interest_union *wanted,
                                                    const struct lw_atlas_map *atlas_map);
void lw_interest_union_finish(struct lw_interest_union *wanted);

/** One session more, or less, that wants everything. */
void lw_interest_union_add_everything(struct lw_interest_union *wanted);
void lw_interest_union_remove_everything(struct lw_interest_union *wanted);

/** One session more, or less, that wants these tiles, each listed once. */
void lw_interest_union_add(struct lw_interest_union *wanted, const uint32_t *tile, size_t count);
void lw_interest_union_remove(struct lw_interest_union *wanted, const uint32_t *tile, size_t count);

/** Lists the tiles for the solver, unless a session wants all tiles.
 *
 * out_levels  per lw_tile_id: 1 + the finest level of interest that covers the tile, for tiles of level 0;
 * else 0. A wanted tile of level k covers 2^k x 2^k of them. */
void lw_interest_union_levels(const struct lw_interest_union *wanted, uint8_t *out_levels);

#endif
