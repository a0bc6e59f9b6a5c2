/* gl_offscreen.h: an OpenGL context without a window, by EGL: for files, tests and machines without a
 * display.
 * Flow:    [gl_offscreen] -> gl_renderer
 * Threads: the context is current in the thread that created it, and stays there. */
#ifndef LW_CLIENT_GL_OFFSCREEN_H
#define LW_CLIENT_GL_OFFSCREEN_H

#include "common/base/status.h"

struct lw_gl_offscreen;

/** Makes a context of OpenGL 3.3 core or later and makes it current. Without a GPU Mesa's software renderer
 * serves.
 * Errors: LW_UNAVAILABLE, naming the missing part; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gl_offscreen_create(struct lw_gl_offscreen **out_offscreen,
                                                    struct lw_error *err);
/** NULL is fine. Objects made in the context must be gone by then. */
void lw_gl_offscreen_destroy(struct lw_gl_offscreen *offscreen);

#endif
