/* live_slots.h: which tile of a finer level is in which slot of an engine's pool, and how much of it is seen.
 * Flow:    replica -> [live_slots] -> lw_live_take_slots()
 * Threads: one thread at a time.
 *
 * A tile that is there and read (lw_live_tiles_reads_fine()) gets a free slot, and keeps it until it is
 * read no more and has faded out. The engine's texels outlive the tile, so that a tile which the server has
 * dropped fades out, too. */
#ifndef LIGHTWELL_LIVE_SLOTS_H
#define LIGHTWELL_LIVE_SLOTS_H

#include "client/lib/live_tiles.h"

#define LW_LIVE_SLOTS_FADE 250000000u /* ns, from nothing to all of a tile */

struct lw_live_slots {
    const struct lw_live_tiles *tiles;
    uint32_t count; /* 0: there are none */
    struct lw_live_slots_one *slot;
    uint8_t *placed;   /* scratch, per id of finer levels: it has a slot */
    uint64_t moved_ns; /* when shares were last moved on */
    uint32_t next;     /* slot with which the next call begins */
    uint32_t used;     /* slots */
    uint32_t waiting;  /* slots of which the last call did not tell all, or whose tiles fade */
};

/** count: of slots; there are none where the map has no finer levels. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_live_slots_init(struct lw_live_slots *slots,
                                                const struct lw_live_tiles *tiles, uint32_t count);
/** A zeroed one is fine. */
void lw_live_slots_finish(struct lw_live_slots *slots);

/** As lw_live_take_slots(). */
size_t lw_live_slots_take(struct lw_live_slots *slots, uint64_t now_ns, size_t tiles_max,
                          struct lw_live_slot *out_slot, size_t capacity);

#endif
