/* relay_fine.h: the tiles of finer levels that a relay's clients list, and those that servers above are asked
 * for: which id each has.
 * Flow:    lists of interest -> [relay_fine] -> ids for TILEs, lw_snapshot.holds_fine
 * Threads: one thread at a time, beside the server's loop, which gives and frees ids (fine_names.h).
 *
 * An id of the map means the same tile from the first list that names it until a snapshot that does not hold
 * it. So the tiles that are listed or asked for are held, and their names are looked up here: the table of
 * the map is the loop's. */
#ifndef LW_RELAY_FINE_H
#define LW_RELAY_FINE_H

#include "common/tile/atlas.h"

struct lw_relay_fine {
    const struct lw_atlas_map *map;
    struct lw_relay_fine_tile {
        uint64_t name;  /* in the last list that had the id */
        bool is_listed; /* in the newest list of clients' interest */
        uint32_t asked; /* channels whose session has it in the list that its server was sent last */
    } * tile;           /* per id of a finer level; NULL: there are none */
    struct lw_relay_fine_name {
        uint64_t name;
        uint32_t id;
    } * held; /* tiles that are listed or asked for, by name */
    uint32_t held_count;
    uint64_t interest; /* the number of the newest list; 0: none came */
};

/** map outlives it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_relay_fine_init(struct lw_relay_fine *fine, const struct lw_atlas_map *map);
/** A zeroed one is fine. */
void lw_relay_fine_finish(struct lw_relay_fine *fine);

/** The newest list of clients' interest (lw_server_interest): its number, and its tiles, of all levels. */
void lw_relay_fine_list(struct lw_relay_fine *fine, uint64_t number, const uint32_t *tile, uint32_t count);
/** The list that the server of a channel's session was sent: tiles of all levels. count 0: it is over. */
void lw_relay_fine_ask(struct lw_relay_fine *fine, uint32_t channel, const lw_tile_id *tile, uint32_t count);

/** The id of a tile that is held, by its name; UINT32_MAX: it is not held. */
uint32_t lw_relay_fine_find(const struct lw_relay_fine *fine, uint64_t name);

static inline struct lw_relay_fine_tile *lw_relay_fine_tile(const struct lw_relay_fine *fine, uint32_t id) {
    return &fine->tile[id - fine->map->plain_count];
}
static inline bool lw_relay_fine_is_held(const struct lw_relay_fine *fine, uint32_t id) {
    const struct lw_relay_fine_tile *tile = lw_relay_fine_tile(fine, id);
    return tile->is_listed || tile->asked;
}

#endif
