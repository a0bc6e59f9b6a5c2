/* recoder.h: deltas over several versions of a tile, made when a session that has fallen behind first wants one, and shared by all.
 * Flow:    deltas: two versions of a tile -> [recoder] -> a delta from one to the other -> deltas -> sessions
 * Threads: [loop]; a thread of its own does the work, since some 100 us a tile are too much for the network's. */
#ifndef LW_SERVE_RECODER_H
#define LW_SERVE_RECODER_H

#include "server/publish/snapshot.h"

#define LW_RECODER_JOBS_MAX 256u /* that are asked for and not collected */

/** What is asked for: how version `version` of a tile differs from version `base`. */
struct lw_recoder_job {
    uint32_t tile; /* lw_tile_id */
    uint64_t base, version;
    struct lw_blob *from, *to; /* LW_MESSAGE_TILE of these, neither of them a delta */
};

/** What came of it. */
struct lw_recoder_result {
    uint32_t tile;
    uint64_t base, version;
    struct lw_blob *
        blob; /* LW_MESSAGE_TILE; the collector's to unref. NULL: it would be no smaller than `to`, or there is none */
};

struct lw_recoder;

/** atlas_map outlives it. wake is called by its thread whenever something is there to be collected.
 * Errors: LW_NO_MEMORY, LW_OS. */
LW_MUST_CHECK enum lw_status lw_recoder_create(const struct lw_atlas_map *atlas_map,
                                               void (*wake)(void *context), void *context,
                                               struct lw_recoder **out_recoder);
/** Ends its thread; what was asked for is dropped. */
void lw_recoder_destroy(struct lw_recoder *recoder);

/** Takes references of its own. False if there are LW_RECODER_JOBS_MAX. */
bool lw_recoder_ask(struct lw_recoder *recoder, const struct lw_recoder_job *job);

/** The next one that is done, in the order of asking; false: none is. */
bool lw_recoder_collect(struct lw_recoder *recoder, struct lw_recoder_result *out_result);

#endif
