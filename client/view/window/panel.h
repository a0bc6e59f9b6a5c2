/* panel.h: lines of text on a dark ground, and a bar: what the window says over its picture.
 * Flow:    text -> [panel] -> pixels for screen
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_WINDOW_PANEL_H
#define LW_CLIENT_VIEW_WINDOW_PANEL_H

#include "common/base/status.h"

#include <stddef.h>
#include <stdint.h>

#define LW_PANEL_TEXT 0xfff2f2f2u /* ARGB */
#define LW_PANEL_HINT 0xffffc860u

struct lw_panel {
    uint32_t *pixel; /* 0xAARRGGBB */
    size_t capacity;
    int scale;         /* pixels of the window for one of a letter; at least 1 */
    int width, height; /* the last drawing's, pixels */
};

void lw_panel_finish(struct lw_panel *panel);

/** The scale of text in a window of that height in points, whose drawable has `pixels` rows: letters have the
 * same size on screens of any density, and are smaller in small windows. */
int lw_panel_scale(int points, int pixels);

/** Draws lines of text, and a bar below them unless its fraction is negative.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_panel_draw(struct lw_panel *panel, const char *const *line, int count,
                                           float fraction, uint32_t colour, struct lw_error *err);

#endif
