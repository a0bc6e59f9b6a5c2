/* session_transport.h: what a session knows of the link that it runs on. There are
 * tcp_transport.h and ws_transport.h.
 * Flow:    session -> blobs -> [transport] -> link; link -> bytes -> lw_session_handlers_receive()
 * Threads: everything here is [loop].
 *
 * A transport calls lw_session_open() when its link is there, then lw_session_handlers_receive(),
 * lw_session_written() and lw_session_lost() as they come, and lw_session_closed() last, once, when the link
 * is gone: a call to close() ends there. */
#ifndef LW_SERVE_SESSIONS_SESSION_TRANSPORT_H
#define LW_SERVE_SESSIONS_SESSION_TRANSPORT_H

#include "proto/message.h"
#include "server/publish/snapshot.h"
#include "server/serve/admission/address_places.h"

#define LW_SESSION_TRANSPORT_BLOBS 64u /* in one write */

struct lw_session_transport {
    const struct lw_session_transport_ops {
        /** Sends blobs one after another, LW_SESSION_TRANSPORT_BLOBS at most, and takes over the references.
         * The next call has to wait for lw_session_written() unless this one took all.
         * Returns how many bytes the link took at once, or libuv's error: then none of it is sent. */
        int (*write)(struct lw_session_transport *link, struct lw_blob *const *blob, uint32_t blob_count);
        /** Whether bytes are to come in: those that do not stay with the peer. They do, to begin with. */
        void (*read)(struct lw_session_transport *link, bool on);
        /** The system may take all that waits and one more message: nothing newer will stand in for it.
         * It goes on sending that after the close. */
        void (*push)(struct lw_session_transport *link);
        /** Says that nothing more follows the bytes written; code and text are for links that can send them.
         * Returns 0 or libuv's error. */
        int (*end)(struct lw_session_transport *link, enum lw_refusal code, const char *text);
        /** At once, whatever waits to be written. */
        void (*close)(struct lw_session_transport *link);
        /** Bytes that the link has not taken, and those that the peer's system has not. */
        void (*waiting)(const struct lw_session_transport *link, size_t *out_ours, size_t *out_socket);
        /** Bytes that have come since the last call and were no messages. NULL: the link counts them itself
         * as they come, or there are none. */
        size_t (*overhead)(struct lw_session_transport *link);
    } * ops;
};

/** The peer at the other end. */
struct lw_session_peer {
    struct lw_address at;
    char address[64]; /* for people, with the port */
    bool may_control; /* if it asks to, and without a token */
    bool is_too_many; /* connections of its address in a second: it gets no place */
    bool is_local;    /* on a Unix socket of the server's: it takes no place, and there is always one */
    bool is_web;      /* by a WebSocket */
    bool is_operator; /* over the server's own Unix socket, as its user or root; whatever its token */
};

#endif
