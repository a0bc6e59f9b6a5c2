#include "client/view/window/panel.h"

#include "client/view/font.h"

#include <math.h>
#include <stdlib.h>

/* In pixels of a letter. */
#define MARGIN    5
#define PITCH     (LW_FONT_HEIGHT + 2)
#define BAR_WIDTH 240
#define SCALE_MAX 16

#define SMALL_POINTS 400 /* windows below this have small letters */

#define PANEL_COLOUR 0xa0101418u
#define BAR_COLOUR   0xff5aa0e0u
#define BAR_TO_COME  0xff303840u

void lw_panel_finish(struct lw_panel *p) {
    free(p->pixel);
    *p = (struct lw_panel){0};
}

int lw_panel_scale(int points, int pixels) {
    if (points <= 0 || pixels <= 0) return 1;
    const float density = (float)pixels / (float)points;
    const int scale = (int)lrintf((points < SMALL_POINTS ? 1 : 2) * density);
    return scale < 1 ? 1 : scale > SCALE_MAX ? SCALE_MAX : scale;
}

static void fill(struct lw_panel *p, int x, int y, int width, int height, uint32_t colour) {
    for (int j = y; j < y + height && j < p->height; j++)
        for (int i = x; i < x + width && i < p->width; i++)
            p->pixel[(size_t)j * (size_t)p->width + (size_t)i] = colour;
}

enum lw_status lw_panel_draw(struct lw_panel *p, const char *const *line, int count, float fraction,
                             uint32_t colour, struct lw_error *err) {
    const int scale = p->scale, margin = MARGIN * scale, pitch = PITCH * scale;
    int width = fraction >= 0 ? BAR_WIDTH * scale : 0;
    for (int i = 0; i < count; i++) {
        const int needed = lw_font_width(line[i], scale);
        if (needed > width) width = needed;
    }
    p->width = width + 2 * margin;
    p->height = (count + (fraction >= 0)) * pitch + 2 * margin - 2 * scale;
    const size_t size = (size_t)p->width * (size_t)p->height;
    if (size > p->capacity) {
        uint32_t *pixel = realloc(p->pixel, size * sizeof *pixel);
        if (pixel == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a line of text");
        p->pixel = pixel;
        p->capacity = size;
    }
    fill(p, 0, 0, p->width, p->height, PANEL_COLOUR);
    const struct lw_font_canvas canvas = {
        .pixel = p->pixel, .width = p->width, .height = p->height, .stride = (size_t)p->width};
    for (int i = 0; i < count; i++) lw_font_draw(&canvas, margin, margin + i * pitch, scale, colour, line[i]);
    if (fraction >= 0) {
        const int top = margin + count * pitch, done = (int)((float)width * fminf(fraction, 1));
        fill(p, margin, top, width, pitch / 2, BAR_TO_COME);
        fill(p, margin, top, done, pitch / 2, BAR_COLOUR);
    }
    return LW_OK;
}
