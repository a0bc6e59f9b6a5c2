/* window_screen.h: the screen of a window.
 * Flow:    options -> [window_screen] -> screen, sizes of picture and panels
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_WINDOW_WINDOW_SCREEN_H
#define LW_CLIENT_VIEW_WINDOW_WINDOW_SCREEN_H

#include "client/view/window/window_private.h"

/** Opens the screen. Without OpenGL, or where it has no GPU, pictures are drawn on the CPU unless the options
 * say otherwise. Errors: LW_UNAVAILABLE, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_window_screen_open(struct lw_window *w, struct lw_error *err);

/** Goes on with the CPU after OpenGL has failed, unless the options ask for OpenGL. err holds the failure. */
LW_MUST_CHECK enum lw_status lw_window_screen_leave_gl(struct lw_window *w, struct lw_error *err);

/** Takes over the screen's size. A minimised window keeps its last one. */
LW_MUST_CHECK enum lw_status lw_window_screen_resize(struct lw_window *w, struct lw_error *err);

#endif
