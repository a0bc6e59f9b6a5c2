/* tcp_transport.h: sessions that are a TCP stream each, or one of a Unix socket (control_socket.h).
 * Flow:    listener -> [tcp_transport] <-> session
 * Threads: everything here is [loop]. */
#ifndef LW_SERVE_TCP_TRANSPORT_H
#define LW_SERVE_TCP_TRANSPORT_H

#include "server/serve/session.h"

/* Bytes of one peer in one turn of the loop: others wait for them. */
#define LW_TCP_TRANSPORT_READ (16u << 10)

/** What all of a server's share. Filled in by the owner. */
struct lw_tcp_transport_shared {
    struct lw_session_shared *sessions;
    uint64_t turn;                              /* of the loop; counted by the owner */
    uint8_t read_buffer[LW_TCP_TRANSPORT_READ]; /* libuv hands a read over before it starts the next */
};

/** Takes the next connection of a listener. Errors: LW_NO_MEMORY, LW_OS; then there is no session. */
LW_MUST_CHECK enum lw_status lw_tcp_transport_accept(struct lw_tcp_transport_shared *shared,
                                                     uv_stream_t *listener);

/* For any transport that is on a socket. */

/** Who is at the other end. May control by a token alone. */
struct lw_session_peer lw_tcp_transport_peer(int socket);
/** What a connected socket that carries light should be set to. */
void lw_tcp_transport_set_options(int socket);
/** Bytes in the socket that the peer's system has not taken. */
size_t lw_tcp_transport_socket_waiting(int socket);

#endif
