/* window_input.h: keys and mouse of a window.
 * Flow:    SDL's events -> [window_input] -> steering, settings, saved pictures
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_WINDOW_WINDOW_INPUT_H
#define LW_CLIENT_VIEW_WINDOW_WINDOW_INPUT_H

#include "client/view/window/window_private.h"

/** Takes the events that have come; waits for the first one, wait_ms at most. */
LW_MUST_CHECK enum lw_status lw_window_input_take(struct lw_window *w, int wait_ms, struct lw_error *err);

/** Moves the eye by the keys that are held. */
void lw_window_input_move(struct lw_window *w, float seconds);

#endif
