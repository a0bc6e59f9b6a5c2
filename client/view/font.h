/* font.h: letters for the overlay; five by seven pixels and two below the line, ASCII.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_VIEW_FONT_H
#define LW_CLIENT_VIEW_FONT_H

#include <stddef.h>
#include <stdint.h>

#define LW_FONT_WIDTH    5
#define LW_FONT_HEIGHT   9
#define LW_FONT_BASELINE 7 /* rows above the line */
#define LW_FONT_ADVANCE  6

/** Pixels to draw on. */
struct lw_font_canvas {
    uint32_t *pixel;
    int width, height;
    size_t stride; /* pixels from row to row */
};

/** Pixels that one line of text takes across. */
int lw_font_width(const char *text, int scale);

/** Draws one line of text with its upper left corner at (x, y), each pixel of a letter scale x scale large;
 * what falls outside is cut off. Characters that are not ASCII become '?'. */
void lw_font_draw(const struct lw_font_canvas *canvas, int x, int y, int scale, uint32_t colour,
                  const char *text);

#endif
