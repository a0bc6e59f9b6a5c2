/* server_handover.h: what the loop and the solver's thread give each other, each through one assignment under
 * the mutex: snapshots, interest, updates, runs, relays above.
 * Flow:    lw_server_publish() and others [solver] -> [server_handover] -> sessions [loop];
 *          interest of sessions [loop] -> [server_handover] -> lw_server_take_interest() [solver] */
#ifndef LW_SERVE_SERVER_HANDOVER_H
#define LW_SERVE_SERVER_HANDOVER_H

#include "server/serve/server_private.h"

/** Hands over the union of the interest sets if it has changed and the last one is taken: however often
 * sessions change their minds, that is one list for each frame. [loop] */
void lw_server_handover_interest(struct lw_server *server);

/** Wakes the thread of a relay when its clients have another interest, updates to forward, or other
 * channels. [loop] */
void lw_server_handover_wake_relay(struct lw_server *server);

/** Takes what the solver's thread has handed over: the newest snapshot, answers, a run, relays above,
 * interest from outside the sessions. Returns whether the server is to stop. [loop] */
bool lw_server_handover_take(struct lw_server *server);

/** Frees the snapshot, the interest and the tiles that nobody has taken. */
void lw_server_handover_finish(struct lw_server *server);

#endif
