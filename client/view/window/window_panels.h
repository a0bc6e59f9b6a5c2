/* window_panels.h: text over the window's picture.
 * Flow:    notices, figures, the server's state -> [window_panels] -> screen
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_WINDOW_WINDOW_PANELS_H
#define LW_CLIENT_VIEW_WINDOW_WINDOW_PANELS_H

#include "client/view/window/window_private.h"

#define LW_WINDOW_PANELS_INSET 12 /* from the window's edges */

/* Places of a panel in the window other than pixels from its upper left corner. */
enum { LW_WINDOW_PANELS_MIDDLE = -1, LW_WINDOW_PANELS_LOW = -2, LW_WINDOW_PANELS_RIGHT = -3 };

/** Draws lines of text on a panel at (x, y) of the window, and a bar below them unless its fraction is
 * negative. */
void lw_window_panels_show(struct lw_window *w, int x, int y, const char *const *line, int count,
                           float fraction, uint32_t colour);

/** Shows a line for some seconds. */
__attribute__((format(printf, 2, 3))) void lw_window_panels_notify(struct lw_window *w, const char *format,
                                                                   ...);

/** Shows or hides the list of keys. */
void lw_window_panels_set_keys(struct lw_window *w, bool on);

/** Draw the list of keys, and the notice, if they are shown. */
void lw_window_panels_keys(struct lw_window *w);
void lw_window_panels_notice(struct lw_window *w);

/** Fills the window with one line, and a bar unless its fraction is negative. */
void lw_window_panels_message(struct lw_window *w, const char *text, float fraction);

/** Says what a window without a scene waits for. */
void lw_window_panels_waiting(struct lw_window *w);

/** Draws the figures, or their hint alone where they are hidden. */
void lw_window_panels_figures(struct lw_window *w);

#endif
