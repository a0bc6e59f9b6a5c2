/* interest.h: the client's interest set, what the server was told of it, and when to tell it again.
 * Flow:    application -> [interest] -> INTEREST -> server
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_INTEREST_H
#define LIGHTWELL_INTEREST_H

#include "common/tile/atlas.h"

#define LW_INTEREST_TELL_NS  100000000u  /* the server is told no more often than this */
#define LW_INTEREST_SHED_NS  2000000000u /* the server is told of a few tiles that left the set by then */
#define LW_INTEREST_SHED_ONE 8u          /* a few: under one tile in LW_INTEREST_SHED_ONE */

struct lw_interest_list {
    bool everything;
    uint32_t count;
    lw_tile_id *tile; /* by id, each once */
    /* Tiles that there is room for: a list that is no longer than an earlier one allocates nothing. */
    size_t capacity;
};

struct lw_interest {
    struct lw_interest_list now, told;
    uint64_t told_ns;
};

/** Begins with everything, as a session does that has sent no INTEREST. */
void lw_interest_init(struct lw_interest *interest);
void lw_interest_finish(struct lw_interest *interest);

/** Another session begins. Its server was told nothing yet, so it takes the set for everything. */
void lw_interest_forget(struct lw_interest *interest);

/** Sets the interest set. Any order; a tile may be listed twice. More than `most` different tiles:
 * everything.
 * Errors: LW_NO_MEMORY; then nothing has changed. */
LW_MUST_CHECK enum lw_status lw_interest_set(struct lw_interest *interest, const lw_tile_id *tile,
                                             size_t count, uint32_t most);
void lw_interest_set_everything(struct lw_interest *interest);

/** Whether a tile is in the set, or in that which the server was told last. */
bool lw_interest_lists(const struct lw_interest *interest, lw_tile_id tile);

/** Whether to tell the server now: of tiles that entered the set at once, of tiles that left it later. */
bool lw_interest_is_due(const struct lw_interest *interest, uint64_t now_ns);

/** The server has been told the current set. Errors: LW_NO_MEMORY; then it will be told again. */
LW_MUST_CHECK enum lw_status lw_interest_tell(struct lw_interest *interest, uint64_t now_ns);

#endif
