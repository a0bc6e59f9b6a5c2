/* ranks.h: the seam between solvers that light one scene together, each the tiles that it owns.
 * Flow:    tiles that this rank has changed -> [exchange] -> those that the others have
 * Threads: [solver] of each rank calls; exchange returns once all ranks have called.
 *
 * Every rank holds all tiles, plans for all of them, and carries out the entries whose owner it is. A plan
 * is a function of facts, so ranks that have exchanged the same facts have the same plan. On one machine
 * there are no ranks (NULL), and an exchange does nothing. */
#ifndef LW_ADAPT_RANKS_H
#define LW_ADAPT_RANKS_H

#include "server/solve/state/tiles.h"

enum lw_ranks_moment {
    LW_RANKS_VERIFIED, /* tiles were compared and corrected: sums, blocks */
    LW_RANKS_WEIGHED,  /* due blocks have begun: sums, blocks */
    LW_RANKS_RADIATED, /* between bounces: what the tiles send out of one bounce, and nothing else */
    LW_RANKS_LIT,      /* the frame's light: sums, blocks */
    LW_RANKS_COUNTED   /* no tile: counts of ray hits, which all ranks sum */
};

struct lw_ranks_exchange {
    enum lw_ranks_moment moment;
    struct lw_tiles *tiles; /* this rank's */
    const lw_tile_id *tile; /* changed by some rank: their owners send them, the others take them */
    uint32_t tile_count;
    uint32_t bounce;     /* LW_RANKS_RADIATED */
    bool *found;         /* LW_RANKS_VERIFIED: two flags, each true if it is in any rank; else NULL */
    bool *corrected;     /* with it: per lw_tile_id of the list, sent and taken as the tile is */
    uint32_t *count;     /* LW_RANKS_COUNTED: to be summed; else NULL */
    uint32_t count_size; /* entries of count */
};

struct lw_ranks {
    uint32_t count, self; /* self < count */
    void *user;
    void (*exchange)(void *user, const struct lw_ranks_exchange *what);
};

/** The rank that owns a tile of a cell: neighbouring cells have one owner as far as possible. */
static inline uint32_t lw_ranks_owner(const struct lw_ranks *ranks, uint32_t cell, uint32_t cells) {
    return ranks ? (uint32_t)((uint64_t)cell * ranks->count / (cells ? cells : 1)) : 0;
}

static inline uint32_t lw_ranks_self(const struct lw_ranks *ranks) { return ranks ? ranks->self : 0; }

static inline void lw_ranks_run(const struct lw_ranks *ranks, const struct lw_ranks_exchange *what) {
    if (ranks) ranks->exchange(ranks->user, what);
}

#endif
