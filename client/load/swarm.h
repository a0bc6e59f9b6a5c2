/* swarm.h: thousands of sessions in one process, each a client that checks what it gets, and what they measured.
 * Flow:    options -> scene, sessions on one libuv loop -> figures -> report on stdout
 * Threads: main() only. */
#ifndef LW_CLIENT_LOAD_SWARM_H
#define LW_CLIENT_LOAD_SWARM_H

#include "client/load/load_options.h"

/** Runs until the time is over, the server is gone or SIGINT or SIGTERM comes (a second one ends the program), and prints
 * what was measured until then. *out_held: whether all thresholds held and the whole time was measured; each one that did
 * not is logged in a line of its own.
 * Errors: LW_NO_HOST, LW_UNAVAILABLE, LW_TIMED_OUT, LW_PROTOCOL where there is no server to load; LW_OS; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_swarm_run(const struct lw_load_options *options, bool *out_held,
                                          struct lw_error *err);

#endif
