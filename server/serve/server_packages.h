/* server_packages.h: the scene's packages in compressed chunks, which all sessions share.
 * Flow:    bytes of a package -> [server_packages: parts, zstd] -> lw_session_shared: chunks, WELCOME's lists
 * Threads: a thread of its own compresses while others begin their work. */
#ifndef LW_SERVE_SERVER_PACKAGES_H
#define LW_SERVE_SERVER_PACKAGES_H

#include "server/serve/server_private.h"

/** Begins to compress the packages of desc. Nothing else writes lw_session_shared meanwhile. */
void lw_server_packages_start(struct lw_server *server, const struct lw_server_desc *desc);

/** Waits until they are compressed. Errors: LW_NO_MEMORY; LW_INTERNAL; those of lw_package_cut(). */
LW_MUST_CHECK enum lw_status lw_server_packages_await(struct lw_server *server);

/** Frees the chunks and the lists of parts. */
void lw_server_packages_finish(struct lw_session_shared *shared);

#endif
