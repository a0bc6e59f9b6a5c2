/* tcp_transport.h: sessions that are a TCP stream each, by TLS where the server has a certificate, or a
 * stream of a Unix socket (control_socket.h).
 * Flow:    listener -> [tcp_transport] <-> session
 * Threads: everything here is [loop]. */
#ifndef LW_SERVE_TRANSPORTS_TCP_TRANSPORT_H
#define LW_SERVE_TRANSPORTS_TCP_TRANSPORT_H

#include "common/tls/tls_stream.h"
#include "server/serve/sessions/session.h"
#include "server/serve/transports/tls_context.h"

/** State that all transports of a server share. Zero-initialised, then the first ones are filled in by the
 * owner, and lw_tls_output_finish(&output) at the end. */
struct lw_tcp_transport_shared {
    struct lw_session_shared *sessions;
    struct lw_tls_context *tls;               /* NULL: all of it is plain */
    uint64_t turn;                            /* the loop's; counted by the owner */
    uint8_t read_buffer[LW_SERVER_TURN_READ]; /* libuv hands a read over before it starts the next */
    uint8_t record[LW_TLS_STREAM_RECORD];     /* what TLS reads or writes, in plain */
    struct lw_tls_output output;              /* what it made: empty between calls */
    uint64_t handshakes_turn, handshakes_ns;  /* time that handshakes took in that turn */
};

/** Takes the next connection of a listener. Errors: LW_NO_MEMORY, LW_OS; LW_UNAVAILABLE: there are too many,
 * or its address connects too often. Then there is no session, and the listener may still have it. */
LW_MUST_CHECK enum lw_status lw_tcp_transport_accept(struct lw_tcp_transport_shared *shared,
                                                     uv_stream_t *listener);

/* For any transport that is on a socket. */

/** The peer at the other end. May control by a token alone. */
struct lw_session_peer lw_tcp_transport_peer(int socket);
/** Sets the options of a connected socket that carries light. */
void lw_tcp_transport_set_options(int socket);
/** Lets the system take what waits for it, LW_SERVER_QUEUE_MAX at least. */
void lw_tcp_transport_push(int socket);
/** Bytes that have arrived since it connected, and the unread ones among them. 0: the system does not report
 * it. */
uint64_t lw_tcp_transport_came(int socket);
size_t lw_tcp_transport_unread(int socket);
/** Bytes in the socket that the peer's system has not taken. */
size_t lw_tcp_transport_socket_waiting(int socket);

#endif
