#include "client/view/window/screen.h"

#include <SDL_syswm.h>
#include <dlfcn.h>
#include <poll.h>
#include <unistd.h>

static enum lw_status open_gl(struct lw_screen *s, struct lw_error *err) {
    s->context = SDL_GL_CreateContext(s->handle);
    if (s->context == NULL)
        return lw_status_fail(err, LW_UNAVAILABLE, "there is no OpenGL 3.3 here: %s", SDL_GetError());
    SDL_GL_SetSwapInterval(1); /* where that is not to be had, pictures come as they are ready */
    return lw_gl_panel_init(&s->gl_panel, err);
}

static enum lw_status open_plain(struct lw_screen *s, struct lw_error *err) {
    s->renderer = SDL_CreateRenderer(s->handle, -1, SDL_RENDERER_PRESENTVSYNC);
    if (s->renderer == NULL) s->renderer = SDL_CreateRenderer(s->handle, -1, SDL_RENDERER_SOFTWARE);
    if (s->renderer == NULL)
        return lw_status_fail(err, LW_UNAVAILABLE, "cannot draw in a window: %s; use --headless",
                              SDL_GetError());
    return LW_OK;
}

enum lw_status lw_screen_open(struct lw_screen *s, const char *title, int width, int height, bool gl,
                              struct lw_error *err) {
    *s = (struct lw_screen){0};
    if (gl) {
        SDL_GL_SetAttribute(SDL_GL_CONTEXT_MAJOR_VERSION, 3);
        SDL_GL_SetAttribute(SDL_GL_CONTEXT_MINOR_VERSION, 3);
        SDL_GL_SetAttribute(SDL_GL_CONTEXT_PROFILE_MASK, SDL_GL_CONTEXT_PROFILE_CORE);
        SDL_GL_SetAttribute(SDL_GL_DOUBLEBUFFER, 1);
    }
    s->handle = SDL_CreateWindow(title, SDL_WINDOWPOS_UNDEFINED, SDL_WINDOWPOS_UNDEFINED, width, height,
                                 SDL_WINDOW_RESIZABLE | SDL_WINDOW_ALLOW_HIGHDPI |
                                     (gl ? (Uint32)SDL_WINDOW_OPENGL : 0));
    enum lw_status status;
    if (s->handle == NULL)
        status = lw_status_fail(err, LW_UNAVAILABLE,
                                gl ? "no window for OpenGL 3.3: %s" : "no window: %s; use --headless",
                                SDL_GetError());
    else
        status = gl ? open_gl(s, err) : open_plain(s, err);
    if (status != LW_OK) lw_screen_close(s);
    return status;
}

/* Xlib's own handlers, found where SDL has loaded it: it is no library of ours. */
struct x11 {
    void (*set_handler)(int (*handler)(void *display));
    int (*connection_number)(void *display);
    void (*set_exit_handler)(void *display, void (*handler)(void *display, void *context), void *context);
};

static int say_nothing(void *display) { /* in place of Xlib's two lines */
    (void)display;
    return 0;
}

static void end(struct lw_screen *s) {
    s->lost(s->lost_context);
    _exit(lw_status_exit_code(LW_UNAVAILABLE));
}

static void on_lost(void *display, void *context) {
    (void)display;
    end(context);
}

/* Mesa's software hangs when it is given a picture for a server that has gone. */
static void check_server(struct lw_screen *s) {
    if (s->lost == NULL) return;
    struct pollfd server = {.fd = s->x_socket};
    if (poll(&server, 1, 0) > 0 && (server.revents & (POLLHUP | POLLERR))) end(s);
}

void lw_screen_watch(struct lw_screen *s, void (*lost)(void *context), void *context) {
    SDL_SysWMinfo info;
    struct x11 x11;
    SDL_VERSION(&info.version);
    if (!SDL_GetWindowWMInfo(s->handle, &info) || info.subsystem != SDL_SYSWM_X11) return;
    void *library = dlopen("libX11.so.6", RTLD_LAZY | RTLD_NOLOAD);
    if (library == NULL) return;
    *(void **)&x11.set_handler = dlsym(library, "XSetIOErrorHandler");
    *(void **)&x11.set_exit_handler = dlsym(library, "XSetIOErrorExitHandler");
    *(void **)&x11.connection_number = dlsym(library, "XConnectionNumber");
    if (x11.set_handler && x11.set_exit_handler && x11.connection_number) {
        s->lost = lost;
        s->lost_context = context;
        s->x_socket = x11.connection_number(info.info.x11.display);
        x11.set_handler(say_nothing);
        x11.set_exit_handler(info.info.x11.display, on_lost, s);
    }
    dlclose(library); /* SDL holds it */
}

void lw_screen_close(struct lw_screen *s) {
    if (s->context != NULL) {
        lw_gl_panel_finish(&s->gl_panel);
        SDL_GL_DeleteContext(s->context);
    }
    if (s->panel != NULL) SDL_DestroyTexture(s->panel);
    if (s->picture != NULL) SDL_DestroyTexture(s->picture);
    if (s->renderer != NULL) SDL_DestroyRenderer(s->renderer);
    if (s->handle != NULL) SDL_DestroyWindow(s->handle);
    *s = (struct lw_screen){0};
}

bool lw_screen_size(const struct lw_screen *s, int *out_width, int *out_height) {
    *out_width = *out_height = 0;
    if (s->context != NULL)
        SDL_GL_GetDrawableSize(s->handle, out_width, out_height);
    else if (SDL_GetRendererOutputSize(s->renderer, out_width, out_height) != 0)
        return false;
    return *out_width > 0 && *out_height > 0;
}

int lw_screen_points(const struct lw_screen *s) {
    int width, height;
    SDL_GetWindowSize(s->handle, &width, &height);
    return height;
}

enum lw_status lw_screen_resize(struct lw_screen *s, int width, int height, struct lw_error *err) {
    if (s->context != NULL) return LW_OK;
    if (s->picture != NULL) SDL_DestroyTexture(s->picture);
    s->picture =
        SDL_CreateTexture(s->renderer, SDL_PIXELFORMAT_RGBA32, SDL_TEXTUREACCESS_STREAMING, width, height);
    if (s->picture == NULL)
        return lw_status_fail(err, LW_OS, "cannot make a texture of %dx%d pixels: %s", width, height,
                              SDL_GetError());
    SDL_SetTextureScaleMode(s->picture, SDL_ScaleModeLinear);
    return LW_OK;
}

void lw_screen_clear(struct lw_screen *s) {
    if (s->context != NULL) {
        glBindFramebuffer(GL_FRAMEBUFFER, 0);
        glClearColor(40 / 255.0f, 46 / 255.0f, 54 / 255.0f, 1);
        glClear(GL_COLOR_BUFFER_BIT);
        return;
    }
    SDL_SetRenderDrawColor(s->renderer, 40, 46, 54, 255);
    SDL_RenderClear(s->renderer);
}

void lw_screen_take(struct lw_screen *s, const uint32_t *rgba, uint32_t width, uint32_t height) {
    SDL_UpdateTexture(s->picture, &(SDL_Rect){0, 0, (int)width, (int)height}, rgba,
                      (int)(width * sizeof *rgba));
}

void lw_screen_show(struct lw_screen *s, uint32_t width, uint32_t height) {
    SDL_RenderCopy(s->renderer, s->picture, &(SDL_Rect){0, 0, (int)width, (int)height}, NULL);
}

void lw_screen_draw_panel(struct lw_screen *s, const uint32_t *argb, int width, int height, int x, int y) {
    int frame_width, frame_height;
    if (s->context != NULL) {
        if (lw_screen_size(s, &frame_width, &frame_height))
            lw_gl_panel_draw(&s->gl_panel, argb, width, height, x, y, frame_width, frame_height);
        return;
    }
    if (width > s->panel_width || height > s->panel_height) {
        if (s->panel != NULL) SDL_DestroyTexture(s->panel);
        s->panel_width = width > s->panel_width ? width : s->panel_width;
        s->panel_height = height > s->panel_height ? height : s->panel_height;
        s->panel = SDL_CreateTexture(s->renderer, SDL_PIXELFORMAT_ARGB8888, SDL_TEXTUREACCESS_STREAMING,
                                     s->panel_width, s->panel_height);
        if (s->panel != NULL) SDL_SetTextureBlendMode(s->panel, SDL_BLENDMODE_BLEND);
    }
    if (s->panel == NULL) return; /* a picture without text is better than none */
    const SDL_Rect part = {0, 0, width, height};
    SDL_UpdateTexture(s->panel, &part, argb, width * (int)sizeof *argb);
    SDL_RenderCopy(s->renderer, s->panel, &part, &(SDL_Rect){x, y, width, height});
}

void lw_screen_present(struct lw_screen *s) {
    check_server(s);
    if (s->context != NULL)
        SDL_GL_SwapWindow(s->handle);
    else
        SDL_RenderPresent(s->renderer);
}
