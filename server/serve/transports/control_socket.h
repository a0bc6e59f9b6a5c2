/* control_socket.h: the Unix socket by which the server's own user, and root, change the scene.
 * Flow:    path -> [control_socket] -> listener; connection -> [control_socket: who is it?] -> session
 * Threads: [loop]. */
#ifndef LW_SERVE_TRANSPORTS_CONTROL_SOCKET_H
#define LW_SERVE_TRANSPORTS_CONTROL_SOCKET_H

#include "server/serve/sessions/session_transport.h"

#include <uv.h>

/** Binds a pipe that is not listening yet. A dead server's socket is replaced. Only this user can open the
 * new one.
 * path    or "auto": control_path.h chooses
 * Errors: LW_UNAVAILABLE: another server has it, or it cannot be made; naming the path */
LW_MUST_CHECK enum lw_status lw_control_socket_bind(uv_pipe_t *pipe, const char *path, uint16_t port,
                                                    struct lw_error *err);

/** The peer at the other end of a connection. may_control is set for this process's user and root. */
struct lw_session_peer lw_control_socket_peer(int descriptor);

#endif
