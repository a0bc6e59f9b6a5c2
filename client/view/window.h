/* window.h: the scene in a window, to fly through.
 * Flow:    options -> client -> compose -> tonemap -> overlay -> SDL window
 * Threads: main() only; a lost server is sought again on a thread of its own. */
#ifndef LW_CLIENT_VIEW_WINDOW_H
#define LW_CLIENT_VIEW_WINDOW_H

#include "client/view/view_options.h"

/** Opens the window and shows the scene until the user leaves. The keys are shown first, until one is pressed
 * or for a while. A server that goes away is sought again; until it is back the last light stays.
 * Errors: LW_UNAVAILABLE where there is no display; the client's for a server that is not there at the start. */
LW_MUST_CHECK enum lw_status lw_window_run(const struct lw_view_options *options, struct lw_error *err);

#endif
