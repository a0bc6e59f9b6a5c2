/* nats_fine.h: the tiles of finer levels that a session over NATS lists.
 * Flow:    INTEREST -> [nats_fine] -> a place for each in the feed's arrays
 * Threads: one thread at a time. */
#ifndef LW_RELAY_NATS_FINE_H
#define LW_RELAY_NATS_FINE_H

#include "common/tile/atlas.h"
#include "proto/nats_wire.h"

#define LW_NATS_FINE_NONE UINT32_MAX

struct lw_nats_fine {
    struct lw_nats_fine_tile {
        uint64_t name; /* atlas.h */
        uint32_t object, level, tile;
    } tile[LW_NATS_WIRE_FINE_MAX]; /* by name */
    uint32_t count;
};

/** The tiles of finer levels of a list, each once; over LW_NATS_WIRE_FINE_MAX: the first ones.
 * interest: NULL: none are listed. */
void lw_nats_fine_list(struct lw_nats_fine *fine, const struct lw_atlas_map *map,
                       const struct lw_message_interest *interest);
/** The place of a tile; NONE: it is not listed. */
uint32_t lw_nats_fine_find(const struct lw_nats_fine *fine, uint64_t name);

#endif
