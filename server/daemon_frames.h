/* daemon_frames.h: the frames of lightwelld: changes, solve, snapshot.
 * Flow:    updates and interest of clients -> [daemon_frames: solver, publisher] -> snapshots, figures
 * Threads: lw_daemon_frames_run() is [solver]; the rest is [any]. */
#ifndef LW_SERVER_DAEMON_FRAMES_H
#define LW_SERVER_DAEMON_FRAMES_H

#include "server/daemon.h"

/** The solver's thread, of a struct lw_daemon: sets up the solver and runs frames until it shall stop; stops
 * the server then. daemon->solver_error: why, where that was a failure. Returns NULL. */
void *lw_daemon_frames_run(void *daemon);

/** Work that begins now is done within --stall-limit, or the solver hangs. */
void lw_daemon_frames_expect(struct lw_daemon *daemon);
/** Whether the solver hangs. */
bool lw_daemon_frames_stalled(const struct lw_daemon *daemon);

#endif
