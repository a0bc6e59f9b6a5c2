/* ws_transport.h: sessions that are a WebSocket each: binary messages carry the bytes
 * of a TCP stream, cut anywhere.
 * Flow:    web_server <-> [ws_transport] <-> session
 * Threads: everything here is [loop].
 *
 * A session by a WebSocket may control by its token only, since any page in a browser of this machine could
 * open one. */
#ifndef LW_SERVE_TRANSPORTS_WS_TRANSPORT_H
#define LW_SERVE_TRANSPORTS_WS_TRANSPORT_H

#include "server/serve/sessions/session.h"

#include <libwebsockets.h>

#define LW_WS_TRANSPORT_PROTOCOL "lightwell"
#define LW_WS_TRANSPORT_MESSAGE  (64u << 10) /* bytes in one message of ours */
/* Codes in our Close (RFC 6455, 7.4.2: private ones are 4000 to 4999). */
#define LW_WS_TRANSPORT_REFUSED 4000u /* plus the code of the REFUSAL */

/** State that all transports of a server share. Filled in by the owner. */
struct lw_ws_transport_shared {
    struct lw_session_shared *sessions;
    uint8_t
        message[LWS_PRE +
                LW_WS_TRANSPORT_MESSAGE]; /* for the current write: libwebsockets keeps the unwritten rest */
};

struct lw_ws_transport;

/** Begins a session on a WebSocket whose handshake is done. NULL: there is no memory, or
 * too many wait for their close. */
struct lw_ws_transport *lw_ws_transport_open(struct lw_ws_transport_shared *shared, struct lws *wsi);

/* Events of libwebsockets. A result other than 0 is for its callback to return: the WebSocket is to be
 * closed. */
/** Bytes of a message have come. */
int lw_ws_transport_receive(struct lw_ws_transport *link, const void *bytes, size_t size);
int lw_ws_transport_writeable(struct lw_ws_transport *link);
/** It is about to close; nothing can be written any more. */
void lw_ws_transport_lost(struct lw_ws_transport *link);
/** It is gone. Frees the session and the link; NULL is fine. */
void lw_ws_transport_destroy(struct lw_ws_transport *link);

#endif
