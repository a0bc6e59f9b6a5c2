/* window_render.h: the window's picture, by OpenGL or by rays.
 * Flow:    stage, steering -> [window_render: gl_view or picture] -> screen, or files
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_WINDOW_WINDOW_RENDER_H
#define LW_CLIENT_VIEW_WINDOW_WINDOW_RENDER_H

#include "client/view/window/window_private.h"

/** Renders by OpenGL if there is something new: in full at rest and where that is quick enough. */
LW_MUST_CHECK enum lw_status lw_window_render_gl(struct lw_window *w, float seconds, bool *out_busy,
                                                 struct lw_error *err);
/** Draws the last picture again. */
void lw_window_render_show_gl(struct lw_window *w);

/** Renders by rays if there is something new or something to sharpen. Returns whether it did. */
bool lw_window_render_cpu(struct lw_window *w, float seconds);

/** Writes the current view as files, with all its samples. Errors: the image writers'; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_window_render_save(struct lw_window *w, struct lw_error *err);

#endif
