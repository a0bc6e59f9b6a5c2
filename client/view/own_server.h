/* own_server.h: a lightwelld of the viewer's own, for a scene in place of an address.
 * Flow:    scene and its options -> [lightwelld] -> port -> headless or window
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_OWN_SERVER_H
#define LW_CLIENT_VIEW_OWN_SERVER_H

#include "common/base/status.h"
#include "common/open/scene_open.h"

#include <stdint.h>

struct lw_own_server;

/** Starts a server for a scene on a free port of 127.0.0.1. Its log goes to our stderr. A scene without
 * a light gets a plain sky. It ends with the calling thread, for any reason. Ctrl-C does not end it.
 * open    the scene and how it is opened. It must outlive the server.
 * Errors: LW_NO_INPUT for a file that is not there; LW_OS if lightwelld, beside this program or in PATH, does
 * not start; LW_CANNOT_CREATE; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_own_server_start(const struct lw_scene_open *open,
                                                 struct lw_own_server **out_server, struct lw_error *err);
/** Its address. port 0: it imports the scene and does not listen yet.
 * Errors: LW_UNAVAILABLE if it has ended, having said why. */
LW_MUST_CHECK enum lw_status lw_own_server_poll(struct lw_own_server *server, uint16_t *out_port,
                                                struct lw_error *err);
/** The same, once it listens: waits as long as the import takes. */
LW_MUST_CHECK enum lw_status lw_own_server_wait(struct lw_own_server *server, uint16_t *out_port,
                                                struct lw_error *err);
/** Ends it, by force if it does not within 5 s. NULL is fine. */
void lw_own_server_stop(struct lw_own_server *server);

#endif
