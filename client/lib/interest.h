/* interest.h: the client's interest set, the one that the server knows, and when to send it again.
 * Flow:    application -> [interest] -> INTEREST -> server
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_INTEREST_H
#define LIGHTWELL_INTEREST_H

#include "common/tile/atlas.h"

#define LW_INTEREST_TELL_NS  100000000u  /* least time between two INTERESTs */
#define LW_INTEREST_SHED_NS  2000000000u /* by then the server learns of a few tiles that left the set */
#define LW_INTEREST_SHED_ONE 8u          /* a few: under one tile in LW_INTEREST_SHED_ONE */

struct lw_interest_list {
    bool everything;
    uint32_t count;
    lw_tile_id *tile; /* by id, each once */
    /* Tiles that there is room for: a list that is no longer than an earlier one allocates nothing. */
    size_t capacity;
};

struct lw_interest {
    struct lw_interest_list now, sent;
    uint64_t sent_ns;
};

/** Begins with everything, as a session does that has sent no INTEREST. */
void lw_interest_init(struct lw_interest *interest);
void lw_interest_finish(struct lw_interest *interest);

/** Another session begins. Its server has no INTEREST yet, so it takes the set for everything. */
void lw_interest_forget(struct lw_interest *interest);

/** Sets the interest set. Any order; a tile may be listed twice. More than `most` different tiles:
 * everything.
 * Errors: LW_NO_MEMORY; then nothing has changed. */
LW_MUST_CHECK enum lw_status lw_interest_set(struct lw_interest *interest, const lw_tile_id *tile,
                                             size_t count, uint32_t most);
void lw_interest_set_everything(struct lw_interest *interest);

/** Whether a tile is in the set, or in the one that was sent to the server last. */
bool lw_interest_lists(const struct lw_interest *interest, lw_tile_id tile);

/** Whether to tell the server now: of tiles that entered the set at once, of tiles that left it later. */
bool lw_interest_is_due(const struct lw_interest *interest, uint64_t now_ns);

/** The current set has been sent to the server. Errors: LW_NO_MEMORY; then it will be sent again. */
LW_MUST_CHECK enum lw_status lw_interest_tell(struct lw_interest *interest, uint64_t now_ns);

#endif
