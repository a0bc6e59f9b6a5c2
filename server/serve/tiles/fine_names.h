/* fine_names.h: which tiles of finer levels have ids (common/tile/fine_ids.h), for sessions list them.
 * Flow:    lists of sessions -> [fine_names] -> ids; snapshots -> [fine_names] -> ids that are free again
 * Threads: [loop]. Other threads use an id from the list of interest that names it until a snapshot without
 * it.
 *
 * An id goes to a tile when a session first lists it. It is free again once no list has it and the solver,
 * which has heard so, holds the tile no longer: only then can nothing mistake the next tile for it. */
#ifndef LW_SERVE_TILES_FINE_NAMES_H
#define LW_SERVE_TILES_FINE_NAMES_H

#include "server/publish/snapshot.h"

struct lw_fine_names {
    const struct lw_atlas_map *map;
    struct lw_fine_name {
        uint32_t lists; /* sessions' lists that have it */
        uint64_t
            idle_since; /* the number of the last list of interest that may name it, if none has it now */
    } * name;           /* per id of a finer level; NULL: there are none */
    uint64_t interest;  /* the number of the last list of interest: they count from 1 */
};

/** atlas_map outlives it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_fine_names_init(struct lw_fine_names *names,
                                                const struct lw_atlas_map *atlas_map);
/** A zeroed one is fine. */
void lw_fine_names_finish(struct lw_fine_names *names);

/** One list more, or less, has these tiles, each once; those that are not of finer levels are left out.
 * remove: returns whether no list has some tile any more. */
void lw_fine_names_add(struct lw_fine_names *names, const uint32_t *tile, uint32_t count);
bool lw_fine_names_remove(struct lw_fine_names *names, const uint32_t *tile, uint32_t count);

/** Frees the ids that a snapshot shows to be unused. */
void lw_fine_names_review(struct lw_fine_names *names, const struct lw_snapshot *snapshot);

#endif
