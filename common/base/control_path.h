/* control_path.h: where the Unix socket of a server lies, by its port: the server
 * makes it, clients look for it.
 * Threads: main() only: it reads the environment. */
#ifndef LW_COMMON_BASE_CONTROL_PATH_H
#define LW_COMMON_BASE_CONTROL_PATH_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_CONTROL_PATH_SIZE 108u /* a socket's path, terminator included: sockaddr_un */

/** Path at which a server of this process makes it. Its folder then exists, and only this user can make files
 * in it: $RUNTIME_DIRECTORY (systemd's), $XDG_RUNTIME_DIR/lightwell, /run/lightwell for root, or
 * /tmp/lightwell-UID. Errors: LW_CANNOT_CREATE naming the folder. */
LW_MUST_CHECK enum lw_status lw_control_path_make(uint16_t port, char out_path[LW_CONTROL_PATH_SIZE],
                                                  struct lw_error *err);

/** The index-th place to look for the socket of a server on this machine, from 0 on; false: there are no
 * more. A place where another user could have put one is left out. */
bool lw_control_path_find(uint16_t port, unsigned index, char out_path[LW_CONTROL_PATH_SIZE]);

#endif
