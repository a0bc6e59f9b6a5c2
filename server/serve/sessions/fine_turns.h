/* fine_turns.h: which tiles of finer levels come first where a server above, or the solver, takes fewer than
 * sessions list.
 * Flow:    lists of sessions -> [fine_turns] -> the order of lw_server_interest, or its levels
 * Threads: [loop].
 *
 * Sessions take turns: the first tile of each list comes first, then the second one of each, and so on. In
 * each list coarser levels count first. So a session that lists a thousand tiles takes no place from one that
 * lists ten. */
#ifndef LW_SERVE_SESSIONS_FINE_TURNS_H
#define LW_SERVE_SESSIONS_FINE_TURNS_H

#include "server/serve/sessions/session.h"

/** Whether a session that lists `count` tiles of finer levels may have a new id for another one. A quarter
 * of the ids is for the first LW_SESSION_FINE_SHARE tiles of each list. A session gets less than half of the
 * other free ones. */
bool lw_fine_turns_may_claim(const struct lw_atlas_map *map, uint32_t count);

/** For the solver: writes the turns of tiles of finer levels to the levels of lw_interest_union_levels(). 1
 * is for the first four of each list, 2 for the next four. A tile of several lists has its first turn.
 * outside: other tiles that are wanted, as by a session. Returns false where there is no memory. */
LW_MUST_CHECK bool lw_fine_turns_weigh(const struct lw_session_shared *shared, const uint32_t *outside,
                                       size_t outside_count, uint8_t *levels);

/** Puts the tiles of finer levels of a list, which are its last ones, into this order. A
 * list that a server above takes as a whole stays as it is. Returns false where there is no memory. */
LW_MUST_CHECK bool lw_fine_turns_order(const struct lw_session_shared *shared, uint32_t *tile,
                                       uint32_t count);

#endif
