/* gl_panel.h: a rectangle of pixels, laid over the drawn picture: the text of the viewer's window.
 * Threads: that of the context. */
#ifndef LW_CLIENT_GL_PANEL_H
#define LW_CLIENT_GL_PANEL_H

#include "common/base/status.h"

#include <epoxy/gl.h>

struct lw_gl_panel {
    GLuint program, texture, array;
    GLint place;
};

/** Errors: LW_UNAVAILABLE if the driver does not take its shaders. Zeroed on failure. */
LW_MUST_CHECK enum lw_status lw_gl_panel_init(struct lw_gl_panel *panel, struct lw_error *err);
/** A zeroed one is fine. */
void lw_gl_panel_finish(struct lw_gl_panel *panel);

/** Blends pixels (0xAARRGGBB, row by row from the top) over the current framebuffer.
 * x, y                  of the upper left corner, pixels from that of the framebuffer
 * frame_width, _height  of the framebuffer */
void lw_gl_panel_draw(struct lw_gl_panel *panel, const uint32_t *argb, int width, int height, int x, int y,
                      int frame_width, int frame_height);

#endif
