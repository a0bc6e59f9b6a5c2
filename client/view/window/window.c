#include "client/view/window/window.h"

#include "client/view/window/window_compare.h"
#include "client/view/window/window_input.h"
#include "client/view/window/window_link.h"
#include "client/view/window/window_panels.h"
#include "client/view/window/window_render.h"
#include "client/view/window/window_screen.h"

#include <stdlib.h>

#define IDLE_WAIT_MS 8
#define STEP_S_MAX   0.1f /* a hitch must not throw the camera across the room */

static void show_picture(struct lw_window *w) {
    if (w->gl.renderer != NULL)
        lw_window_render_show_gl(w);
    else
        lw_screen_show(&w->screen, w->picture.width, w->picture.height);
    lw_window_compare_draw(w);
    lw_window_panels_figures(w);
    lw_window_panels_keys(w);
    lw_window_panels_notice(w);
    lw_screen_present(&w->screen);
}

/* Called before SDL_Init(), which takes a driver that shows nothing where there is no display. */
static bool has_display(void) {
    return getenv("DISPLAY") != NULL || getenv("WAYLAND_DISPLAY") != NULL ||
           getenv("SDL_VIDEODRIVER") != NULL;
}

static enum lw_status begin(struct lw_window *w, struct lw_error *err) {
    const struct lw_view_options *o = w->options;
    if (o->scene == NULL) {
        enum lw_status status = lw_window_link_connect(w, o->port, err);
        return status == LW_OK ? lw_window_screen_open(w, err) : status;
    }
    enum lw_status status = lw_own_server_start(&o->own, &w->server, err);
    w->importing_ns = lw_clock_ns();
    return status == LW_OK ? lw_window_screen_open(w, err) : status;
}

enum lw_status lw_window_create(const struct lw_view_options *options, struct lw_window **out_window,
                                struct lw_error *err) {
    SDL_SetHint(SDL_HINT_VIDEO_X11_FORCE_EGL, "1"); /* GLX ends the program where its driver is missing */
    if (!has_display() || SDL_Init(SDL_INIT_VIDEO) != 0)
        return lw_status_fail(err, LW_UNAVAILABLE, "no display: use --headless");
    struct lw_window *w = calloc(1, sizeof *w);
    if (w == NULL) {
        SDL_Quit();
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for a window");
    }
    w->options = options;
    w->show_keys = w->busy = true;
    w->wipe = 0.5f;
    w->panel.scale = 1;
    lw_picture_init(&w->picture, options->curve, options->auto_exposure, options->stops, options->threads);
    w->picture.show = options->show;
    enum lw_status status = begin(w, err);
    w->stepped_ns = w->figures.since_ns = lw_clock_ns();
    if (status == LW_OK)
        *out_window = w;
    else
        lw_window_destroy(w);
    return status;
}

void lw_window_destroy(struct lw_window *w) {
    if (w == NULL) return;
    lw_window_compare_stop(w);
    free(w->over);
    free(w->light);
    lw_gl_view_finish(&w->gl);
    lw_stage_finish(&w->stage);
    lw_client_destroy(w->client);
    lw_client_destroy(w->incoming);
    lw_seeker_destroy(w->seeker);
    lw_picture_finish(&w->picture);
    lw_panel_finish(&w->panel);
    lw_screen_close(&w->screen);
    SDL_Quit();
    lw_own_server_stop(w->server);
    free(w);
}

/* One picture, if there is something new or somebody looks at the figures. */
static enum lw_status draw(struct lw_window *w, float seconds, uint64_t now_ns, struct lw_error *err) {
    enum lw_status status = LW_OK;
    if (w->gl.renderer != NULL) {
        if (lw_window_render_gl(w, seconds, &w->busy, err) != LW_OK)
            status = lw_window_screen_leave_gl(w, err);
        if (status != LW_OK) return status;
    }
    if (w->gl.renderer == NULL) w->busy = lw_window_render_cpu(w, seconds);
    const struct lw_camera_view camera = lw_flight_view(&w->steering.flight);
    status = lw_stage_look(&w->stage, &camera, w->width, w->height, err);
    if (status == LW_OK) status = lw_window_compare_follow(w, &camera, err);
    if (status != LW_OK) return status;
    if (w->keys_until_ns != 0 && now_ns > w->keys_until_ns) lw_window_panels_set_keys(w, false);
    if (w->notice_until_ns != 0 && now_ns > w->notice_until_ns) w->notice_until_ns = 0, w->redraw = true;
    if (w->busy || w->redraw || now_ns - w->figures.since_ns >= LW_WINDOW_FIGURES_EVERY_NS) show_picture(w);
    w->redraw = false;
    return LW_OK;
}

enum lw_status lw_window_step(struct lw_window *w, struct lw_error *err) {
    enum lw_status status = lw_window_input_take(w, w->busy ? 0 : IDLE_WAIT_MS, err);
    const uint64_t now_ns = lw_clock_ns();
    const float seconds = fminf((float)(now_ns - w->stepped_ns) * 1e-9f, STEP_S_MAX);
    w->stepped_ns = now_ns;
    lw_window_input_move(w, seconds);
    if (status == LW_OK) status = lw_window_link_await(w, err);
    if (status == LW_OK) status = lw_window_link_shown(w, err);
    if (status == LW_OK) status = lw_window_link_incoming(w, err);
    if (status != LW_OK) return status;
    w->busy = false;
    if (w->width == 0) return lw_window_screen_resize(w, err); /* it began without pixels */
    if (w->staged) return draw(w, seconds, now_ns, err);
    lw_window_panels_waiting(w);
    return LW_OK;
}

struct lw_window_state lw_window_state(const struct lw_window *w) {
    struct lw_client_stats stats = {0};
    if (w->staged) lw_client_get_stats(w->client, &stats);
    return (struct lw_window_state){.quit = w->quit,
                                    .staged = w->staged,
                                    .lit = stats.first_ns != 0,
                                    .says = w->says,
                                    .pictures = w->pictures,
                                    .steering = w->steering,
                                    .start = w->start,
                                    .stops =
                                        w->picture.auto_exposure ? w->picture.stops : w->picture.stops_wanted,
                                    .auto_exposure = w->picture.auto_exposure,
                                    .keys_shown = w->show_keys,
                                    .figures_shown = !w->hide_figures,
                                    .full_screen = w->full_screen,
                                    .by_gl = w->gl.renderer != NULL,
                                    .show = w->picture.show,
                                    .compares = w->compare != LW_WINDOW_COMPARE_NONE,
                                    .traced = w->traced,
                                    .wipe = w->wipe,
                                    .width = w->width,
                                    .height = w->height,
                                    .text_scale = w->panel.scale};
}

enum lw_status lw_window_run(const struct lw_view_options *options, struct lw_error *err) {
    struct lw_window *w;
    enum lw_status status = lw_window_create(options, &w, err);
    if (status != LW_OK) return status;
    while (status == LW_OK && !w->quit) status = lw_window_step(w, err);
    lw_window_destroy(w);
    return status;
}
