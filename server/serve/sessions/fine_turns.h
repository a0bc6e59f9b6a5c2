/* fine_turns.h: which tiles of finer levels come first where a server above takes fewer than sessions list.
 * Flow:    lists of sessions -> [fine_turns] -> the order of lw_server_interest
 * Threads: [loop].
 *
 * Sessions take turns: the first tile of each list comes first, then the second one of each, and so on. So a
 * session that lists a thousand tiles takes no place from one that lists ten. */
#ifndef LW_SERVE_SESSIONS_FINE_TURNS_H
#define LW_SERVE_SESSIONS_FINE_TURNS_H

#include "server/serve/sessions/session.h"

/** Puts the tiles of finer levels of a list, which are its last ones, into this order. A
 * list that a server above takes as a whole stays as it is. Returns false where there is no memory. */
LW_MUST_CHECK bool lw_fine_turns_order(const struct lw_session_shared *shared, uint32_t *tile,
                                       uint32_t count);

#endif
