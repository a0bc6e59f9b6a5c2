/* interest_set.h: which tiles somebody looks at, and how much light others send there.
 * Flow:    union of the sessions' interest -> [interest] -> facts of tiles -> plan
 *          bounce rays of solved tiles -> [note_hits] -> importance
 * Threads: [solver]; note_hits is [any worker], the same counts in any order.
 *
 * A tile of no interest contributes where bounce rays of solved tiles hit it. Its importance is the rays that
 * hit it for each ray that it would shoot itself. */
#ifndef LW_ADAPT_INTEREST_SET_H
#define LW_ADAPT_INTEREST_SET_H

#include "server/solve/transport/transport.h"

/* What a ray hit of a tile of interest counts for. */
#define LW_INTEREST_WEIGHT 256u

enum lw_interest_set_scope { LW_INTEREST_NOTHING, LW_INTEREST_TILES, LW_INTEREST_EVERYTHING };

struct lw_interest_set {
    enum lw_interest_set_scope scope;
    uint32_t ids; /* lw_tile_ids of the scene */
    /* The planes are NULL until somebody names tiles. Per lw_tile_id: */
    uint8_t *level; /* 0, or 1 + the finest level of interest */
    uint32_t *hits; /* bounce rays that hit it since the last lw_interest_set_take_importance(), by weight */
    float *importance; /* running mean */
};

/** Everything is of interest to begin with. */
void lw_interest_set_init(struct lw_interest_set *interest, uint32_t ids);
/** A zeroed one is fine. */
void lw_interest_set_finish(struct lw_interest_set *interest);
size_t lw_interest_set_memory_bytes(const struct lw_interest_set *interest);

/** Takes the interest set. level: per lw_tile_id, as above; NULL: everything. Entries of coarser levels than
 * 0 are not read. From id `plain` on tiles are of finer levels: their entries say whether they are of
 * interest. Errors: LW_NO_MEMORY; the interest is then as before. */
LW_MUST_CHECK enum lw_status lw_interest_set_replace(struct lw_interest_set *interest, const uint8_t *level,
                                                     uint32_t plain);

/** 0: nobody looks at the tile; else 1 + the finest level. */
static inline uint8_t lw_interest_set_level(const struct lw_interest_set *interest, lw_tile_id id) {
    return interest->scope == LW_INTEREST_EVERYTHING ? 1 : interest->level ? interest->level[id.v] : 0;
}

/** 0 while everything is of interest. */
static inline float lw_interest_set_importance(const struct lw_interest_set *interest, lw_tile_id id) {
    return interest->scope == LW_INTEREST_EVERYTHING || !interest->importance ? 0
                                                                              : interest->importance[id.v];
}

/** Forgets a tile's importance. */
void lw_interest_set_forget(struct lw_interest_set *interest, lw_tile_id id);

/** Whether a tile is of interest, or lights a tile of interest. all_contribute: rays end where texels cannot
 * be counted (at probes), so that every tile may. */
bool lw_interest_set_contributes(const struct lw_interest_set *interest, const struct lw_solve_tile *tile,
                                 bool all_contribute);

/** Counts where the bounce rays of a solved tile, and those to reflectors, have ended. One texel in nine is
 * counted, in turn: turn counts the rounds. weight: what a hit counts for (lw_plan_tile). */
void lw_interest_set_note_hits(struct lw_interest_set *interest, const struct lw_transport *passes,
                               const struct lw_solve_tile *tile, uint32_t turn, uint32_t weight);

/** Takes those counts into the importance of all tiles, and begins new ones. samples: bounce rays of a texel.
 * */
void lw_interest_set_take_importance(struct lw_interest_set *interest, const struct lw_tiles *tiles,
                                     uint32_t samples);

#endif
