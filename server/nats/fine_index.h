/* fine_index.h: the tiles of finer levels in the newest snapshot of a channel, by name.
 * Flow:    snapshots -> [fine_index] -> subjects of new tiles
 *          names that relays ask for -> [fine_index] -> ids
 * Threads: one thread at a time.
 *
 * Snapshots list tiles by id, and an id may be another tile's in the next snapshot
 * (server/serve/fine_names.h). The server's loop gives ids, so its map says nothing of the ids of a snapshot
 * in another thread. Each TILE holds its own name: names are read from there. */
#ifndef LW_NATS_FINE_INDEX_H
#define LW_NATS_FINE_INDEX_H

#include "server/publish/snapshot.h"

#define LW_FINE_INDEX_NONE UINT32_MAX

struct lw_fine_index {
    const struct lw_atlas_map *map;
    struct lw_fine_index_tile {
        uint64_t name; /* UINT64_MAX: the snapshot has no tile at this id */
        uint32_t object, level;
        uint64_t had; /* the version that the snapshot before had of the same tile at this id; 0: none */
    } * tile;         /* per id of a finer level; NULL: no snapshot came, or there are no such ids */
    struct lw_fine_index_entry {
        uint64_t name, version;
        uint32_t id;
    } * entry; /* by name, the newest version first */
    uint32_t entry_count;
    bool is_sorted, is_whole; /* is_whole: it has all tiles of the last snapshot */
};

/** map outlives it. */
void lw_fine_index_init(struct lw_fine_index *index, const struct lw_atlas_map *map);
/** A zeroed one is fine. */
void lw_fine_index_finish(struct lw_fine_index *index);

/** Takes the tiles of a snapshot with the channel.
 * before  the snapshot of the call before this one. NULL: there was none, or it lacked the channel
 * Errors: LW_NO_MEMORY; then it is empty. */
LW_MUST_CHECK enum lw_status lw_fine_index_follow(struct lw_fine_index *index, uint32_t channel,
                                                  const struct lw_snapshot *before,
                                                  const struct lw_snapshot *snapshot);
/** The snapshot's id of a tile, by its name; NONE: the snapshot does not have it. */
uint32_t lw_fine_index_find(struct lw_fine_index *index, uint64_t name);

#endif
