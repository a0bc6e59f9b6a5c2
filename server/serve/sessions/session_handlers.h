/* session_handlers.h: what a peer says, message by message.
 * Flow:    transport -> bytes -> [session_handlers] -> what the session is to be sent, updates, interest
 * Threads: everything here is [loop]. For the transports and turns.c alone. */
#ifndef LW_SERVE_SESSIONS_SESSION_HANDLERS_H
#define LW_SERVE_SESSIONS_SESSION_HANDLERS_H

#include "server/serve/sessions/session.h"

/** Bytes have come. */
void lw_session_handlers_receive(struct lw_session *session, const uint8_t *bytes, size_t size);

/** Handles waiting messages, within a turn's messages and the peer's rates. The rest waits in an
 * inbox. */
void lw_session_handlers_take(struct lw_session *session);

#endif
