/* tile_check.h: checks tiles as a client must: the place exists, the version grows, the bytes decode.
 * Flow:    TILE of any session -> [tile_check] -> verdict
 * Threads: one thread at a time.
 *
 * The server encodes a tile once for all sessions, so the checker decodes it once. It remembers the last
 * few versions of each tile by a hash of the decoded bytes. Other bytes under the same version are a fault,
 * in any session. A few sessions are followed as clients: their deltas are added to the light that
 * they hold. Other light under the same version is a fault too, whether it came whole or as a delta. */
#ifndef LW_CLIENT_LOAD_TILE_CHECK_H
#define LW_CLIENT_LOAD_TILE_CHECK_H

#include "common/tile/atlas.h"
#include "proto/message.h"

#define LW_TILE_CHECK_VERSIONS 8u /* and bases, remembered per tile; sessions are seldom further apart */

enum lw_tile_verdict {
    LW_TILE_GOOD,
    LW_TILE_IGNORED,   /* its layer is one that clients ignore */
    LW_TILE_NOWHERE,   /* there is no such place in the scene */
    LW_TILE_BACKWARDS, /* its version is not above the one that the session had: a client ignores it */
    /* codec unknown, builds on what the session does not have, or its payload does not decode */
    LW_TILE_DAMAGED,
    LW_TILE_DIFFERENT /* its version came before with other bytes, or other light */
};

struct lw_tile_finding {
    enum lw_tile_verdict verdict;
    lw_tile_id id;   /* where there is such a place, with any verdict but NOWHERE */
    uint64_t before; /* the version that the session had; 0: none */
};

struct lw_tile_check;

/** The light that a followed session holds. */
struct lw_tile_held;
/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tile_held_create(const struct lw_atlas_map *map,
                                                 struct lw_tile_held **out_held);
void lw_tile_held_destroy(struct lw_tile_held *held);
/** Bytes that it may take. */
size_t lw_tile_held_bytes_max(const struct lw_atlas_map *map);

/** map     outlives the checker
 * always  decode every tile of every session, even one that was checked before
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tile_check_create(const struct lw_atlas_map *map, bool always,
                                                  struct lw_tile_check **out_check);
void lw_tile_check_destroy(struct lw_tile_check *check);

/** Judges a tile.
 * known  the session's version of each tile of the map, 0 for none; updated if the verdict is GOOD
 * held   the session's light, if it is followed; else NULL.
 * Errors: LW_NO_MEMORY; then there is no verdict. */
LW_MUST_CHECK enum lw_status lw_tile_check_take(struct lw_tile_check *check,
                                                const struct lw_message_tile *tile, uint64_t *known,
                                                struct lw_tile_held *held,
                                                struct lw_tile_finding *out_finding);

/** The server was started again. Drops all versions. */
void lw_tile_check_forget(struct lw_tile_check *check);

/** Tiles decoded so far. */
uint64_t lw_tile_check_decoded(const struct lw_tile_check *check);

#endif
