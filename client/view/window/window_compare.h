/* window_compare.h: the window's picture beside a path tracer's.
 * Flow:    stage, camera -> comparison -> [window_compare] -> screen
 * Threads: main() only; the path tracer has a thread of its own. */
#ifndef LW_CLIENT_VIEW_WINDOW_WINDOW_COMPARE_H
#define LW_CLIENT_VIEW_WINDOW_WINDOW_COMPARE_H

#include "client/view/window/window_private.h"

/** Ends the path tracer. */
void lw_window_compare_stop(struct lw_window *w);

/** Gives the path tracer the current view, and takes its latest picture. */
LW_MUST_CHECK enum lw_status
lw_window_compare_follow(struct lw_window *w, const struct lw_camera_view *camera, struct lw_error *err);

/** Draws the traced picture, or the difference, over the window's own. */
void lw_window_compare_draw(struct lw_window *w);

#endif
