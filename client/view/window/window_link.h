/* window_link.h: the server behind a window.
 * Flow:    server -> [window_link: seeker, client] -> stage
 * Threads: main() only; the seeker connects on a thread of its own. */
#ifndef LW_CLIENT_VIEW_WINDOW_WINDOW_LINK_H
#define LW_CLIENT_VIEW_WINDOW_WINDOW_LINK_H

#include "client/view/window/window_private.h"

/** Connects for the first time. */
LW_MUST_CHECK enum lw_status lw_window_link_connect(struct lw_window *w, uint16_t port, struct lw_error *err);

/** Connects to a server of the window's own, once it listens: it imports its scene first. */
LW_MUST_CHECK enum lw_status lw_window_link_await(struct lw_window *w, struct lw_error *err);

/** Takes in what the server of the current light has sent. Looks for it again if it has gone. */
LW_MUST_CHECK enum lw_status lw_window_link_shown(struct lw_window *w, struct lw_error *err);

/** Takes in what a newly found server has sent. Shows its scene once the first light is there. */
LW_MUST_CHECK enum lw_status lw_window_link_incoming(struct lw_window *w, struct lw_error *err);

#endif
