/* deltas.h: the last few deltas of each tile, one after another, for sessions that have fallen behind: several of them are
 * often fewer bytes than the tile whole.
 * Flow:    snapshots -> [deltas] -> sessions
 * Threads: [loop]. */
#ifndef LW_SERVE_DELTAS_H
#define LW_SERVE_DELTAS_H

#include "server/publish/snapshot.h"

#define LW_DELTAS_KEPT 8u /* of a tile */

struct lw_delta {
    uint64_t base, version;
    struct lw_blob *blob;
};

struct lw_deltas {
    uint32_t tile_count;
    struct lw_deltas_of_tile {
        uint32_t count;
        struct lw_delta delta[LW_DELTAS_KEPT]; /* each builds on the one before */
    } * tile;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_deltas_init(struct lw_deltas *deltas, uint32_t tile_count);
void lw_deltas_finish(struct lw_deltas *deltas);

/** A tile's new version, with its delta or without one. What does not lead there is forgotten. */
void lw_deltas_add(struct lw_deltas *deltas, uint32_t tile, const struct lw_snapshot_tile *version);

/** The delta that whoever has version `from` of a tile takes next, on the way to the newest; NULL: there is no way, or, where it
 * takes several, none of fewer bytes than the tile whole (whole_bytes). */
const struct lw_delta *lw_deltas_next(const struct lw_deltas *deltas, uint32_t tile, uint64_t from,
                                      size_t whole_bytes);

#endif
