/* server_listeners.h: the sockets that a server listens on, and the connections that come in by them.
 * Flow:    addresses, or sockets of the server before -> [server_listeners] -> connections -> tcp_transport,
 *          web_server
 * Threads: everything here is [loop]. */
#ifndef LW_SERVE_SERVER_LISTENERS_H
#define LW_SERVE_SERVER_LISTENERS_H

#include "server/serve/server_private.h"

/** Says what each listener is for. Its handles are made, its TLS context is there. */
void lw_server_listeners_init(struct lw_server *server);

/** Listens on all that desc names, but for a control socket that the server before still has: that is for
 * lw_server_run().
 * Errors: LW_UNAVAILABLE, LW_NO_HOST, LW_OS, with the address and its option; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status
lw_server_listeners_open(struct lw_server *server, const struct lw_server_desc *desc, struct lw_error *err);

/** The control socket; a path "auto" that cannot be used is a warning. Errors: lw_control_socket_bind()'s. */
LW_MUST_CHECK enum lw_status lw_server_listeners_open_control(struct lw_server *server, const char *path,
                                                              struct lw_error *err);

/** The program's page, and in its metrics the relays below. Needs hooks.page. context: the server */
bool lw_server_listeners_page(void *context, const char *path, struct lw_server_page *out_page);

/** Whether a connection waits for the next turn of the loop. */
bool lw_server_listeners_any_held(const struct lw_server *server);
/** A new turn: takes the connections that waited for it. */
void lw_server_listeners_take_held(struct lw_server *server);

#endif
