/* want.h: which tiles the client wants, what the server was told of it, and when to tell it again.
 * Flow:    application -> [want] -> INTEREST -> server
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_WANT_H
#define LIGHTWELL_WANT_H

#include "common/tile/atlas.h"

#define LW_WANT_TELL_NS  100000000u  /* the server is told no more often than this */
#define LW_WANT_SHED_NS  2000000000u /* what is wanted no more is told by then, if it is few */
#define LW_WANT_SHED_ONE 8u          /* it is few under one tile in so many */

struct lw_want_list {
    bool everything;
    uint32_t count;
    lw_tile_id *tile; /* by id, each once */
    size_t
        capacity; /* tiles that there is room for: lists that are no longer than earlier ones allocate nothing */
};

struct lw_want {
    struct lw_want_list now, told;
    uint64_t told_ns;
};

/** Begins as a session does that has said nothing: everything is wanted. */
void lw_want_init(struct lw_want *want);
void lw_want_finish(struct lw_want *want);

/** Another session begins, which has been told nothing: everything is wanted in it until it is. */
void lw_want_forget(struct lw_want *want);

/** Wants these, in any order, each as often as you like; over `most` different ones: everything.
 * Errors: LW_NO_MEMORY; then nothing has changed. */
LW_MUST_CHECK enum lw_status lw_want_set(struct lw_want *want, const lw_tile_id *tile, size_t count,
                                         uint32_t most);
void lw_want_set_everything(struct lw_want *want);

/** Whether to tell the server now: at once of what is newly wanted, later of what is wanted no more. */
bool lw_want_is_due(const struct lw_want *want, uint64_t now_ns);

/** The server has been told. Errors: LW_NO_MEMORY; then it will be told again. */
LW_MUST_CHECK enum lw_status lw_want_tell(struct lw_want *want, uint64_t now_ns);

#endif
