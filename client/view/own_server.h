/* own_server.h: a lightwelld of the viewer's own, for a scene in place of an address.
 * Flow:    scene -> [lightwelld] -> port -> headless or window
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_OWN_SERVER_H
#define LW_CLIENT_VIEW_OWN_SERVER_H

#include "common/status.h"

#include <stdint.h>

struct lw_own_server;

/** Starts a server for a scene on a free port of 127.0.0.1, and waits until it listens. What it says goes to our stderr.
 * It ends when the calling thread does, however that comes about; Ctrl-C is not for it.
 * Errors: LW_NO_INPUT for a file that is not there; LW_OS if lightwelld, beside this program or in PATH, does not start; LW_UNAVAILABLE if it ends, having said
 * why; LW_CANNOT_CREATE; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_own_server_start(const char *scene, struct lw_own_server **out_server,
                                                 uint16_t *out_port, struct lw_error *err);
/** Ends it, by force if it does not within 5 s. NULL is fine. */
void lw_own_server_stop(struct lw_own_server *server);

#endif
