/* deltas.h: the ways from the last few versions of each tile to the newest, for sessions that lag.
 * Flow:    snapshots -> [deltas] -> sessions
 *          versions -> [deltas] -> transcoder -> coarse forms, and deltas over several versions -> [deltas]
 * Threads: [loop].
 * Memory:  of a tile, twice: references to at most LW_DELTAS_KEPT whole versions, a delta from each
 *          to the next, and one from each to the newest; where coarse forms are wanted, the
 *          transcoder's history as well (24 KB).
 *
 * There are deltas from one version to the next, and from any of them to the newest. The latter is fewer
 * bytes than all between, and often than the whole tile. Sessions on narrow links get tiles in wider steps,
 * with deltas of their own. These versions are made when a session first needs them. */
#ifndef LW_SERVE_TILES_DELTAS_H
#define LW_SERVE_TILES_DELTAS_H

#include "server/serve/tiles/transcoder.h"

#define LW_DELTAS_KEPT 8u /* versions of a tile from which there is a way */

struct lw_deltas {
    uint32_t tile_count;
    struct lw_transcoder *transcoder; /* NULL: there are only those that snapshots bring */
    struct lw_deltas_of_tile {
        uint64_t version;      /* the newest; 0: none */
        struct lw_blob *whole; /* the newest version's */
        uint32_t life;         /* counts lw_deltas_forget(): answers to earlier questions mean nothing */
        uint64_t asked,
            known; /* coarse forms: the last version that the transcoder was asked for, and has answered */
        uint32_t count;
        /* Room for LW_DELTAS_KEPT, each the version before the next; NULL: there never was any. */
        struct lw_delta_base {
            uint64_t version;
            struct lw_blob *whole; /* this version's */
            struct lw_blob *delta; /* to the next of these, from the last one to the newest */
            struct lw_blob *jump;  /* to the newest; NULL: not made, or of no use */
            bool is_asked, is_known;
        } * base;
    } * tile, *coarse;
};

enum lw_deltas_way {
    LW_DELTAS_WHOLE = 0,
    LW_DELTAS_DELTA,
    LW_DELTAS_WAIT /* the transcoder is asked, and will say which way is shortest */
};

struct lw_delta {
    uint64_t version;     /* the delta leads to it */
    struct lw_blob *blob; /* as it is in `deltas` */
};

/** transcoder: outlives it, or NULL. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_deltas_init(struct lw_deltas *deltas, uint32_t tile_count,
                                            struct lw_transcoder *transcoder);
void lw_deltas_finish(struct lw_deltas *deltas);

/** A tile's new version, with its delta or without one. Versions without a way there are forgotten. */
void lw_deltas_add(struct lw_deltas *deltas, uint32_t tile, const struct lw_snapshot_tile *version);

/** Ends the history of a tile, whose id may be given to another, with smaller versions. */
void lw_deltas_forget(struct lw_deltas *deltas, uint32_t tile);

/** Next message for a session that has version `from` of a tile: on the way to the newest version, with the
 * fewest bytes.
 * coarse     to that in wider steps; where there is no such form, or the transcoder has too
 *            much to do, to the newest itself
 * out_delta  written unless it has to wait */
enum lw_deltas_way lw_deltas_next(struct lw_deltas *deltas, uint32_t tile, uint64_t from, bool coarse,
                                  struct lw_delta *out_delta);

/** Asks the transcoder, if there is something to ask, for what lw_deltas_next() would wait for. */
void lw_deltas_prepare(struct lw_deltas *deltas, uint32_t tile, uint64_t from, bool coarse);

/** Takes the finished tiles of the transcoder. Returns whether there were any. */
bool lw_deltas_collect(struct lw_deltas *deltas);

#endif
