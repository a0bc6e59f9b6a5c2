/* turns.h: which session sends next, and whose messages are handled next, so that each gets its share.
 * Flow:    a new snapshot, an answer, a link with room -> due -> [turns] -> send_queue
 *          messages that had no turn -> unread -> [turns] -> session_handlers
 * Threads: everything here is [loop]. */
#ifndef LW_SERVE_SESSIONS_TURNS_H
#define LW_SERVE_SESSIONS_TURNS_H

#include "server/serve/sessions/session.h"

/** Gives all a turn: there is a new snapshot. */
void lw_turns_begin_snapshot(struct lw_session_shared *shared);

/** Sends to those who have a turn, each its share, alternately from both queues, until nobody has one or the
 * deadline (lw_clock_ns) has passed. Sessions that were left out come first next time. */
void lw_turns_serve_due(struct lw_session_shared *shared, uint64_t deadline_ns);
/** Gives a turn to sessions whose rate limit was in the way, of what they get or of what they say. Call some
 * fifty times a second. */
void lw_turns_serve_paced(struct lw_session_shared *shared);
/** Handles messages that came and had no turn, a share of each session. */
void lw_turns_read_on(struct lw_session_shared *shared);

/** Takes what the transcoder has made, and gives a turn to those who wait for it. */
void lw_turns_collect(struct lw_session_shared *shared);

/** Whether somebody has a turn, or messages that are to be handled. */
bool lw_turns_any_due(const struct lw_session_shared *shared);

#endif
