/* live_tiles.h: which tiles an engine has not read since they changed, and from where each is read.
 * Flow:    replica -> [live_tiles] -> live_texels -> lw_live_take_dirty(), lw_live_read()
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_LIVE_TILES_H
#define LIGHTWELL_LIVE_TILES_H

#include "client/include/lightwell/lightwell.h"
#include "client/lib/client.h"

struct lw_live_tiles {
    const struct lw_client *client;
    const struct lw_atlas_map *map;
    bool as_it_is, reads_finer;
    uint8_t *state;   /* per tile: DIRTY, QUEUED */
    lw_tile_id *ring; /* queued tiles, oldest first; tiles taken otherwise are no longer DIRTY */
    uint32_t ring_first, ring_count, dirty_count;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_live_tiles_init(struct lw_live_tiles *tiles, const struct lw_client *client,
                                                bool as_it_is, bool reads_finer);
/** A zeroed one is fine. */
void lw_live_tiles_finish(struct lw_live_tiles *tiles);

/** A tile has changed: it is dirty, and so is each finer one that is read from it. Tiles of levels that are
 * finer than level 0 are never dirty: live_slots.h reports them. */
void lw_live_tiles_mark(struct lw_live_tiles *tiles, lw_tile_id tile);

/** As lw_live_take_dirty(). */
size_t lw_live_tiles_take(struct lw_live_tiles *tiles, uint32_t object, uint32_t level, uint64_t texels_max,
                          struct lw_live_rect *out_rect, size_t capacity);

/** Whether a rectangle lies within a level, which may be finer than level 0. Errors: LW_LIVE_USAGE;
 * LW_LIVE_UNAVAILABLE for a finer level that the server does not have. */
enum lw_live_status lw_live_tiles_check(const struct lw_live_tiles *tiles, const struct lw_live_rect *rect,
                                        struct lw_live_error *err);

/** The tile of a coarser level, or of its own, that covers one. */
lw_tile_id lw_live_tiles_cover(const struct lw_live_tiles *tiles, const struct lw_tile_place *place,
                               uint32_t level);

/** The level that a tile is read from: its own or a coarser one; UINT32_MAX: none has arrived. Not of a tile
 * of a level that is finer than level 0. */
uint32_t lw_live_tiles_source(const struct lw_live_tiles *tiles, lw_tile_id tile);

/** Whether a tile of a level that is finer than level 0 is there, and is read: it has no more noise than
 * level 0 may have, or all is read as it came. id: that is used, or free */
bool lw_live_tiles_reads_fine(const struct lw_live_tiles *tiles, lw_tile_id tile);

#endif
