/* daemon_succession.h: what lightwelld does at SIGHUP: options and scene are read again.
 * Flow:    SIGHUP -> [daemon_succession: another daemon beside this one] -> lw_server_relay() -> the next one
 * Threads: lw_daemon_succession_reload() is [loop]; the next scene is read in a thread of its own.
 *
 * Another daemon is made beside the one that serves, of the options and the scene as they are now. Its scene
 * is read and its solver set up in a thread. Then the server hands over its sockets and tells its clients to
 * come back at once: they find the next daemon. A failure leaves the daemon as it was. */
#ifndef LW_SERVER_DAEMON_SUCCESSION_H
#define LW_SERVER_DAEMON_SUCCESSION_H

#include "server/daemon.h"

/** Begins to prepare the next scene; a hook of the server. context: a struct lw_daemon. A failure is a line
 * of the log, and leaves the daemon as it is. */
void lw_daemon_succession_reload(void *context);

/** Returns the daemon that follows one that has served, or NULL.
 * *out_left: the thread is still at work, so that its data must stay. */
struct lw_daemon *lw_daemon_succession_take(struct lw_daemon *daemon, bool served, bool *out_left);

#endif
