/* screen.h: the window itself, and what its pixels are drawn with: OpenGL, or SDL's own way for pictures of
 * the CPU.
 * Flow:    gl_view's or picture's pixels, panels of text -> [screen] -> window
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_WINDOW_SCREEN_H
#define LW_CLIENT_VIEW_WINDOW_SCREEN_H

#include "client/gl/gl_panel.h"
#include "common/base/status.h"

#include <SDL.h>

struct lw_screen {
    SDL_Window *handle;
    SDL_GLContext context; /* NULL: without OpenGL */
    struct lw_gl_panel gl_panel;
    SDL_Renderer *renderer; /* without OpenGL, as the next two */
    SDL_Texture *picture;   /* as large as the window; a smaller picture fills its corner */
    SDL_Texture *panel;
    int panel_width, panel_height; /* the largest panel's so far */
    void (*lost)(void *context);   /* as lw_screen_watch() has set it */
    void *lost_context;
    int x_socket; /* its X server's; valid if lost is not NULL */
};

/** Opens a window. Zeroed on failure.
 * gl   by OpenGL 3.3
 * Errors: LW_UNAVAILABLE, naming the missing part. */
LW_MUST_CHECK enum lw_status lw_screen_open(struct lw_screen *screen, const char *title, int width,
                                            int height, bool gl, struct lw_error *err);
/** A zeroed one is fine. Objects made in its context must be gone by then. */
void lw_screen_close(struct lw_screen *screen);

/** Sets a function that is called when the X server has gone, before the program ends with exit code 69, as
 * Xlib cannot go on. Other window systems report it by errors. */
void lw_screen_watch(struct lw_screen *screen, void (*lost)(void *context), void *context);

/** Size of the window in pixels. Returns false where it has none at present. */
bool lw_screen_size(const struct lw_screen *screen, int *out_width, int *out_height);

/** Height of the window in the system's own units, of which there are fewer than pixels on dense screens. */
int lw_screen_points(const struct lw_screen *screen);

/** Makes room for the CPU's pictures of the window's size. With OpenGL it does nothing. Errors:
 * LW_OS. */
LW_MUST_CHECK enum lw_status lw_screen_resize(struct lw_screen *screen, int width, int height,
                                              struct lw_error *err);

/** A plain background. */
void lw_screen_clear(struct lw_screen *screen);

/** Takes a picture of the CPU, RGBA bytes. Only without OpenGL. */
void lw_screen_take(struct lw_screen *screen, const uint32_t *rgba, uint32_t width, uint32_t height);
/** Fills the window with the upper left part of the last picture. */
void lw_screen_show(struct lw_screen *screen, uint32_t width, uint32_t height);

/** Lays a panel of 0xAARRGGBB pixels over the window's picture. */
void lw_screen_draw_panel(struct lw_screen *screen, const uint32_t *argb, int width, int height, int x,
                          int y);

/** Shows everything drawn so far. */
void lw_screen_present(struct lw_screen *screen);

#endif
