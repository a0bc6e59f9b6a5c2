#include "client/view/window/window_screen.h"

#include "common/base/log.h"

#include <stdio.h>
#include <string.h>

enum lw_status lw_window_screen_resize(struct lw_window *w, struct lw_error *err) {
    int width, height;
    if (!lw_screen_size(&w->screen, &width, &height)) return LW_OK; /* minimised: as before */
    w->panel.scale = lw_panel_scale(lw_screen_points(&w->screen), height);
    w->redraw = true;
    if (width > (int)LW_VIEW_SIDE_MAX) width = (int)LW_VIEW_SIDE_MAX;
    if (height > (int)LW_VIEW_SIDE_MAX) height = (int)LW_VIEW_SIDE_MAX;
    if ((uint32_t)width == w->width && (uint32_t)height == w->height) return LW_OK;
    enum lw_status status = lw_picture_resize(&w->picture, (uint32_t)width, (uint32_t)height, err);
    if (status != LW_OK) return status;
    status = lw_screen_resize(&w->screen, width, height, err);
    if (status != LW_OK) return status;
    w->width = (uint32_t)width;
    w->height = (uint32_t)height;
    w->stale = true;
    return LW_OK;
}

/* The program ends, and its own server with it. */
static void on_display_lost(void *context) {
    struct lw_window *w = context;
    lw_log(LW_LOG_ERROR, "the display has gone");
    lw_own_server_stop(w->server);
}

static enum lw_status open_screen(struct lw_window *w, bool gl, struct lw_error *err) {
    char title[320];
    snprintf(title, sizeof title, "lightwell %s", w->options->scene ? w->options->scene : w->address);
    enum lw_status status =
        lw_screen_open(&w->screen, title, (int)w->options->width, (int)w->options->height, gl, err);
    if (status == LW_OK) lw_screen_watch(&w->screen, on_display_lost, w);
    return status;
}

enum lw_status lw_window_screen_leave_gl(struct lw_window *w, struct lw_error *err) {
    if (w->options->renderer == LW_VIEW_RENDERER_GL) {
        lw_status_context(err, "--renderer gl");
        return err->status;
    }
    lw_log(LW_LOG_WARNING, "%s; drawing on the CPU", err->text);
    *err = (struct lw_error){0};
    lw_gl_view_finish(&w->gl);
    lw_screen_close(&w->screen);
    enum lw_status status = open_screen(w, false, err);
    w->width = w->height = 0;
    return status == LW_OK ? lw_window_screen_resize(w, err) : status;
}

enum lw_status lw_window_screen_open(struct lw_window *w, struct lw_error *err) {
    const bool gl = w->options->renderer != LW_VIEW_RENDERER_CPU;
    enum lw_status status = open_screen(w, gl, err);
    /* shadow maps on the CPU take three times as long as its shadow rays (bench_gl) */
    if (status == LW_OK && w->options->renderer == LW_VIEW_RENDERER_AUTO && lw_gl_renderer_is_software())
        status = lw_status_fail(err, LW_UNAVAILABLE,
                                "OpenGL has no GPU here (--renderer gl draws by it all the same)");
    if (status != LW_OK) return gl ? lw_window_screen_leave_gl(w, err) : status;
    return lw_window_screen_resize(w, err);
}
