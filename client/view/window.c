#include "client/view/window.h"

#include "client/gl/gl_view.h"
#include "client/view/flight.h"
#include "client/view/font.h"
#include "client/view/overlay.h"
#include "client/view/pace.h"
#include "client/view/picture.h"
#include "client/view/screen.h"
#include "client/view/seeker.h"
#include "client/view/stage.h"
#include "common/clock.h"
#include "common/log.h"

#include <SDL.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CLIENT_NAME       "lightwell-view"
#define CONNECT_MS        5000u
#define IDLE_WAIT_MS      8
#define REST_AFTER_NS     200000000u /* without motion: then the picture sharpens */
#define FIGURES_EVERY_NS  500000000u
#define KEYS_SHOWN_NS     20000000000u /* of the first picture, unless somebody presses a key before */
#define RADIANS_PER_PIXEL 0.0025f
#define FAST              4.0f
#define TILES_A_PICTURE   48u /* that OpenGL takes over at most: a few ms */
#define MSAA              4u
#define SURVEY_EVERY_NS   250000000u
#define STEP_S_MAX        0.1f /* a hitch must not throw the camera across the room */

#define TEXT_SCALE   2
#define PANEL_MARGIN 10
#define PANEL_PITCH  (TEXT_SCALE * (LW_FONT_HEIGHT + 2))
#define PANEL_WIDTH  520
#define PANEL_HEIGHT (LW_OVERLAY_KEYS * PANEL_PITCH + 2 * PANEL_MARGIN)
#define PANEL_LINES  4
#define PANEL_INSET  12          /* from the window's edges */
#define TEXT_COLOUR  0xfff2f2f2u /* ARGB, as the rest */
#define HINT_COLOUR  0xffffc860u
#define PANEL_COLOUR 0xa0101418u
#define BAR_COLOUR   0xff5aa0e0u

/* What the overlay says; taken twice a second so that it can be read. */
struct figures {
    uint64_t since_ns, bytes;
    unsigned pictures;
    double pictures_per_s, kbit_per_s;
};

struct window {
    const struct lw_view_options *options;
    struct lw_screen screen;
    uint32_t panel[PANEL_WIDTH * PANEL_HEIGHT]; /* scratch */
    uint32_t width, height;
    char address[280];

    struct lw_client *client; /* whose light is shown; may have lost its server */
    bool lost;
    struct lw_stage stage;
    bool staged;
    struct lw_gl_view gl;       /* of the stage, if the screen is OpenGL's */
    uint64_t surveyed_ns;       /* when it was last asked what the view needs */
    bool unsurveyed;            /* the picture is newer */
    uint32_t waiting;           /* tiles that it has not taken over yet */
    struct lw_client *incoming; /* connected, its scene or first light not there yet */
    struct lw_seeker *seeker;

    struct lw_flight flight;
    struct lw_camera_view start;
    uint32_t next_camera;
    bool captured, hide_figures, quit;
    bool show_keys;
    uint64_t keys_until_ns; /* 0: until somebody hides them */

    struct lw_picture picture;
    struct lw_pace pace;
    bool stale;  /* the picture is not of what is there now */
    bool redraw; /* the overlay is not */
    uint64_t moved_ns, stepped_ns;
    uint64_t seen_tiles, seen_frame;
    struct figures figures;
};

/* ---- the server ---- */

static void drop_incoming(struct window *w) {
    lw_client_destroy(w->incoming);
    w->incoming = NULL;
}

static void seek_again(struct window *w, const struct lw_client *lost, const struct lw_error *err) {
    lw_log(LW_LOG_WARNING, "%s; looking for the server again", err->text);
    lw_seeker_start(w->seeker, lw_client_retry_after_ms(lost));
}

static void go_to_camera(struct window *w, uint32_t camera) {
    struct lw_camera_view view = lw_camera_of_scene(w->stage.scene, &w->stage.pose, camera);
    lw_flight_take(&w->flight, &view);
    w->next_camera = (camera + 1) % w->stage.scene->camera_count;
    w->stale = true;
    w->moved_ns = lw_clock_ns();
}

static enum lw_status choose_start(struct window *w, struct lw_error *err) {
    const struct lw_scene *scene = w->stage.scene;
    uint32_t camera = 0;
    if (w->options->camera_name != NULL) {
        enum lw_status status = lw_camera_find(scene, w->options->camera_name, &camera, err);
        if (status != LW_OK) return status;
    }
    if (w->options->camera_given)
        w->start = w->options->camera;
    else if (camera < scene->camera_count)
        w->start = lw_camera_of_scene(scene, &w->stage.pose, camera);
    else
        w->start =
            lw_camera_default(scene, &w->stage.pose, w->stage.trace, (float)w->width / (float)w->height);
    w->next_camera = scene->camera_count > 1 ? camera + 1 : 0;
    struct lw_vec3 low, high;
    w->flight.speed = 2.0f;
    if (lw_pose_bounds(&w->stage.pose, scene, &low, &high))
        w->flight.speed = fmaxf(lw_vec3_length(lw_vec3_sub(high, low)) / 10.0f, 0.05f);
    lw_flight_take(&w->flight, &w->start);
    return LW_OK;
}

static enum lw_status resize(struct window *w, struct lw_error *err);

static enum lw_status open_screen(struct window *w, bool gl, struct lw_error *err) {
    char title[320];
    snprintf(title, sizeof title, "lightwell %s", w->address);
    return lw_screen_open(&w->screen, title, (int)w->options->width, (int)w->options->height, PANEL_WIDTH,
                          PANEL_HEIGHT, gl, err);
}

/* OpenGL has failed: on with the CPU, if nobody has asked for OpenGL. */
static enum lw_status leave_gl(struct window *w, struct lw_error *err) {
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
    return status == LW_OK ? resize(w, err) : status;
}

/* Shows the incoming client in place of what is shown. */
static enum lw_status stage_incoming(struct window *w, struct lw_error *err) {
    bool first = !w->staged, moved;
    struct lw_stage stage;
    enum lw_status status = lw_stage_init(&stage, w->incoming, w->options->threads, err);
    if (status != LW_OK) return status;
    status = lw_stage_follow(&stage, &moved, err);
    if (status != LW_OK) {
        lw_stage_finish(&stage);
        return status;
    }
    lw_gl_view_finish(&w->gl);
    lw_stage_finish(&w->stage);
    lw_client_destroy(w->client);
    w->stage = stage;
    w->client = w->incoming;
    w->incoming = NULL;
    w->lost = false;
    w->staged = w->stale = true;
    w->seen_tiles = w->seen_frame = w->figures.bytes = 0;
    lw_seeker_reset(w->seeker);
    if (w->screen.context != NULL && lw_gl_view_init(&w->gl, &w->stage, false, err) != LW_OK) {
        status = leave_gl(w, err);
        if (status != LW_OK) return status;
    }
    if (!first) lw_log(LW_LOG_INFO, "%s: connected again", w->address);
    if (first && w->show_keys) w->keys_until_ns = lw_clock_ns() + KEYS_SHOWN_NS;
    return first ? choose_start(w, err) : LW_OK;
}

static bool is_ready(const struct window *w, struct lw_client *client) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    /* The old light is better than none: it stays until the first of the new server's is there. */
    return lw_client_scene(client) != NULL && (!w->staged || stats.first_ns != 0);
}

static void show_message(struct window *w, const char *text, float fraction);

static enum lw_status serve_incoming(struct window *w, struct lw_error *err) {
    if (w->incoming == NULL) w->incoming = lw_seeker_take(w->seeker);
    if (w->incoming == NULL) return LW_OK;
    struct lw_error lost = {0};
    if (lw_client_poll(w->incoming, 0, &lost) != LW_OK) {
        seek_again(w, w->incoming, &lost);
        drop_incoming(w);
        return LW_OK;
    }
    if (!is_ready(w, w->incoming)) return LW_OK;
    if (!w->staged) show_message(w, "building the scene", 1);
    return stage_incoming(w, err);
}

static enum lw_status serve_shown(struct window *w, struct lw_error *err) {
    if (!w->staged) return LW_OK;
    struct lw_error lost = {0};
    if (!w->lost && lw_client_poll(w->client, 0, &lost) != LW_OK) {
        w->lost = true;
        seek_again(w, w->client, &lost);
    }
    struct lw_client_stats stats;
    lw_client_get_stats(w->client, &stats);
    if (stats.tiles != w->seen_tiles) w->stale = true;
    if (stats.frame == w->seen_frame && stats.tiles == w->seen_tiles) return LW_OK;
    w->seen_tiles = stats.tiles;
    w->seen_frame = stats.frame;
    bool moved;
    enum lw_status status = lw_stage_follow(&w->stage, &moved, err);
    if (status == LW_OK && moved) {
        w->moved_ns = lw_clock_ns();
        w->stale = true;
    }
    return status;
}

/* ---- the user ---- */

static void capture(struct window *w, bool on) {
    w->captured = on;
    SDL_SetRelativeMouseMode(on ? SDL_TRUE : SDL_FALSE);
}

static void show_keys(struct window *w, bool on) {
    w->show_keys = on;
    w->keys_until_ns = 0;
    w->redraw = true;
}

static void press(struct window *w, SDL_Keycode key) {
    show_keys(w, key == SDLK_h && !w->show_keys);
    if (key == SDLK_ESCAPE) {
        if (w->captured)
            capture(w, false);
        else
            w->quit = true;
    }
    if (key == SDLK_F1) w->hide_figures = !w->hide_figures;
    if (!w->staged) return;
    uint32_t cameras = w->stage.scene->camera_count;
    if (key == SDLK_c && cameras > 0) go_to_camera(w, w->next_camera);
    if (key >= SDLK_1 && key <= SDLK_9 && (uint32_t)(key - SDLK_1) < cameras)
        go_to_camera(w, (uint32_t)(key - SDLK_1));
    if (key == SDLK_0) {
        lw_flight_take(&w->flight, &w->start);
        w->stale = true;
        w->moved_ns = lw_clock_ns();
    }
}

static enum lw_status resize(struct window *w, struct lw_error *err) {
    int width, height;
    if (!lw_screen_size(&w->screen, &width, &height)) return LW_OK;
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

static enum lw_status take_events(struct window *w, int wait_ms, struct lw_error *err) {
    SDL_Event event;
    bool resized = false;
    for (int some = wait_ms > 0 ? SDL_WaitEventTimeout(&event, wait_ms) : SDL_PollEvent(&event); some;
         some = SDL_PollEvent(&event)) {
        switch (event.type) {
        case SDL_QUIT:
            w->quit = true;
            break;
        case SDL_KEYDOWN:
            if (!event.key.repeat) press(w, event.key.keysym.sym);
            break;
        case SDL_MOUSEBUTTONDOWN:
            capture(w, true);
            show_keys(w, false);
            break;
        case SDL_MOUSEMOTION:
            if (!w->captured || !w->staged) break;
            lw_flight_turn(&w->flight, RADIANS_PER_PIXEL * (float)event.motion.xrel,
                           -RADIANS_PER_PIXEL * (float)event.motion.yrel);
            w->moved_ns = lw_clock_ns();
            w->stale = true;
            break;
        case SDL_MOUSEWHEEL:
            w->flight.speed *= exp2f(0.25f * (float)event.wheel.y);
            break;
        case SDL_WINDOWEVENT:
            if (event.window.event == SDL_WINDOWEVENT_FOCUS_LOST) capture(w, false);
            resized |= event.window.event == SDL_WINDOWEVENT_SIZE_CHANGED;
            break;
        default:
            break;
        }
    }
    return resized ? resize(w, err) : LW_OK;
}

static float axis(const Uint8 *keys, SDL_Scancode positive, SDL_Scancode negative) {
    return (float)keys[positive] - (float)keys[negative];
}

static void fly(struct window *w, float seconds) {
    const Uint8 *keys = SDL_GetKeyboardState(NULL);
    float right = axis(keys, SDL_SCANCODE_D, SDL_SCANCODE_A), up = axis(keys, SDL_SCANCODE_E, SDL_SCANCODE_Q),
          forward = axis(keys, SDL_SCANCODE_W, SDL_SCANCODE_S);
    if (!w->staged || (right == 0 && up == 0 && forward == 0)) return;
    if (keys[SDL_SCANCODE_LSHIFT] || keys[SDL_SCANCODE_RSHIFT]) seconds *= FAST;
    lw_flight_move(&w->flight, right, up, forward, seconds);
    w->moved_ns = lw_clock_ns();
    w->stale = true;
}

/* ---- the screen ---- */

static void fill(const struct lw_font_canvas *canvas, int x, int y, int width, int height, uint32_t colour) {
    for (int j = y; j < y + height && j < canvas->height; j++)
        for (int i = x; i < x + width && i < canvas->width; i++)
            canvas->pixel[(size_t)j * canvas->stride + (size_t)i] = colour;
}

/* Places of a panel in the window other than pixels from its upper left corner. */
enum { MIDDLE = -1, LOW = -2 };

/* Draws lines of text, and a bar below them unless its fraction is negative, on a panel at (x, y) of the window. */
static void show_panel(struct window *w, int x, int y, const char *const *line, int count, float fraction,
                       uint32_t colour) {
    int width = fraction >= 0 ? PANEL_WIDTH - 2 * PANEL_MARGIN : 0;
    for (int i = 0; i < count; i++) {
        int needed = lw_font_width(line[i], TEXT_SCALE);
        if (needed > width) width = needed;
    }
    if (width > PANEL_WIDTH - 2 * PANEL_MARGIN) width = PANEL_WIDTH - 2 * PANEL_MARGIN;
    int height = count * PANEL_PITCH + (fraction >= 0 ? PANEL_PITCH : 0);
    struct lw_font_canvas canvas = {
        .pixel = w->panel, .width = width + 2 * PANEL_MARGIN, .height = height + 2 * PANEL_MARGIN - 4};
    canvas.stride = (size_t)canvas.width;
    fill(&canvas, 0, 0, canvas.width, canvas.height, PANEL_COLOUR);
    for (int i = 0; i < count; i++)
        lw_font_draw(&canvas, PANEL_MARGIN, PANEL_MARGIN + i * PANEL_PITCH, TEXT_SCALE, colour, line[i]);
    if (fraction >= 0) {
        int top = PANEL_MARGIN + count * PANEL_PITCH, full = (int)((float)width * fminf(fraction, 1));
        fill(&canvas, PANEL_MARGIN, top, width, PANEL_PITCH / 2, 0xff303840u);
        fill(&canvas, PANEL_MARGIN, top, full, PANEL_PITCH / 2, BAR_COLOUR);
    }
    if (x == MIDDLE) x = ((int)w->width - canvas.width) / 2;
    if (y == MIDDLE)
        y = ((int)w->height - canvas.height) / 2;
    else if (y == LOW)
        y = (int)w->height - canvas.height - PANEL_INSET;
    lw_screen_draw_panel(&w->screen, w->panel, canvas.width, canvas.height, x, y);
}

static void draw_keys(struct window *w) {
    if (w->show_keys) show_panel(w, PANEL_INSET, LOW, lw_overlay_keys, LW_OVERLAY_KEYS, -1, TEXT_COLOUR);
}

static void show_message(struct window *w, const char *text, float fraction) {
    lw_screen_clear(&w->screen);
    draw_keys(w);
    show_panel(w, MIDDLE, MIDDLE, (const char *const[]){text}, 1, fraction, TEXT_COLOUR);
    lw_screen_present(&w->screen);
}

static void show_waiting(struct window *w) {
    char text[64];
    if (w->incoming == NULL) {
        snprintf(text, sizeof text, "looking for %.40s", w->address);
        show_message(w, text, -1);
        return;
    }
    float fraction = lw_client_package_progress(w->incoming);
    snprintf(text, sizeof text, "receiving the scene %.0f %%", (double)fraction * 100.0);
    show_message(w, text, fraction);
}

static void take_figures(struct window *w, const struct lw_client_stats *stats, uint64_t now_ns) {
    struct figures *f = &w->figures;
    if (now_ns - f->since_ns < FIGURES_EVERY_NS) return;
    double seconds = (double)(now_ns - f->since_ns) * 1e-9;
    f->pictures_per_s = f->pictures / seconds;
    f->kbit_per_s =
        stats->bytes >= f->bytes && f->bytes > 0 ? (double)(stats->bytes - f->bytes) * 8e-3 / seconds : 0;
    f->bytes = stats->bytes;
    f->pictures = 0;
    f->since_ns = now_ns;
}

static void show_figures(struct window *w) {
    struct lw_client_stats stats;
    lw_client_get_stats(w->client, &stats);
    take_figures(w, &stats, lw_clock_ns());
    char line[PANEL_LINES][LW_OVERLAY_LINE_SIZE];
    snprintf(line[0], sizeof line[0], "%3.0f frames/s  %ux%u", w->figures.pictures_per_s, w->picture.width,
             w->picture.height);
    snprintf(line[1], sizeof line[1], "%.0f kbit/s", w->figures.kbit_per_s);
    const struct lw_overlay_state state = {.lost = w->lost,
                                           .receiving = w->incoming != NULL,
                                           .lit = stats.first_ns != 0,
                                           .report = w->picture.report};
    if (state.lit)
        snprintf(line[2], sizeof line[2], "light %.0f ms old", (double)stats.light_age_ns * 1e-6);
    else
        snprintf(line[2], sizeof line[2], "no light yet");
    lw_overlay_state(&state, line[3]);
    bool hint = state.lost || !state.lit;
    if (!w->hide_figures)
        show_panel(w, PANEL_INSET, PANEL_INSET, (const char *const[]){line[0], line[1], line[2], line[3]},
                   PANEL_LINES, -1, hint ? HINT_COLOUR : TEXT_COLOUR);
    else if (hint)
        show_panel(w, PANEL_INSET, PANEL_INSET, (const char *const[]){line[3]}, 1, -1, HINT_COLOUR);
}

/* What the view needs, how well that is served, and how bright the picture is: four times a second. */
static enum lw_status survey(struct window *w, const struct lw_compose_view *view, struct lw_error *err) {
    const uint64_t now_ns = lw_clock_ns();
    w->unsurveyed = now_ns - w->surveyed_ns < SURVEY_EVERY_NS;
    if (w->unsurveyed) return LW_OK;
    w->surveyed_ns = now_ns;
    enum lw_status status = lw_gl_view_survey(&w->gl, &w->stage, view, &w->picture.report, err);
    if (status != LW_OK || !w->picture.auto_exposure) return status;
    status = lw_gl_renderer_meter(w->gl.renderer, &w->picture.stops_wanted, err);
    if (!w->picture.stops_known) w->picture.stops = w->picture.stops_wanted;
    w->picture.stops_known = status == LW_OK;
    return status;
}

/* The same by OpenGL: in full where that is quick enough, and at rest. */
static enum lw_status renew_by_gl(struct window *w, float seconds, bool *out_busy, struct lw_error *err) {
    const uint64_t start_ns = lw_clock_ns();
    const bool at_rest = start_ns - w->moved_ns > REST_AFTER_NS;
    struct lw_picture *p = &w->picture;
    uint32_t width = w->width, height = w->height;
    if (!at_rest) lw_pace_size(&w->pace, w->width, w->height, &width, &height);
    const unsigned samples = width == w->width ? MSAA : 1;
    const bool render = w->stale || w->waiting > 0 || p->width != width || p->height != height ||
                        (w->unsurveyed && start_ns - w->surveyed_ns >= SURVEY_EVERY_NS);
    const struct lw_compose_view view = {
        .camera = lw_flight_view(&w->flight), .width = width, .height = height};
    enum lw_status status = LW_OK;
    if (render) {
        status = lw_gl_view_take(&w->gl, &w->stage, TILES_A_PICTURE, &w->waiting, err);
        if (status == LW_OK) status = lw_gl_renderer_draw(w->gl.renderer, &view, samples, err);
        if (status == LW_OK) status = survey(w, &view, err);
        if (status != LW_OK) return status;
        w->stale = false;
        w->figures.pictures++;
        p->width = width, p->height = height, p->samples = samples;
    }
    *out_busy = lw_picture_adapt(p, seconds) || render;
    if (!*out_busy) return LW_OK;
    lw_gl_renderer_show(w->gl.renderer, w->options->curve, p->stops, w->width, w->height);
    glFinish(); /* else nothing is known of what it costs */
    if (render && samples == 1) lw_pace_note(&w->pace, (uint64_t)width * height, lw_clock_ns() - start_ns);
    if (render && samples > 1) /* without a GPU it costs two or three times as much */
        lw_pace_note(&w->pace, (uint64_t)width * height, (lw_clock_ns() - start_ns) / 2);
    return LW_OK;
}

/* Renders if there is something new or something to sharpen; returns whether it did. */
static bool renew_picture(struct window *w, float seconds) {
    uint64_t start_ns = lw_clock_ns();
    bool at_rest = start_ns - w->moved_ns > REST_AFTER_NS;
    uint32_t width = w->width, height = w->height;
    if (!at_rest) lw_pace_size(&w->pace, w->width, w->height, &width, &height);
    bool sharpen = w->picture.width != width || w->picture.height != height ||
                   (at_rest && w->picture.samples < LW_PICTURE_SAMPLES_MAX);
    bool render = w->stale || sharpen;
    if (render) {
        struct lw_camera_view camera = lw_flight_view(&w->flight);
        /* at rest all pixels have more samples soon */
        const bool whole = width == w->width && height == w->height;
        const uint64_t edge_time_ns =
            !at_rest && whole ? lw_pace_spare_ns(&w->pace, (uint64_t)width * height) : 0;
        lw_picture_render(&w->picture, &w->stage, &camera, width, height, w->stale, edge_time_ns);
        w->stale = false;
        w->figures.pictures++;
    }
    if (!lw_picture_adapt(&w->picture, seconds) && !render) return false;
    lw_picture_develop(&w->picture);
    lw_screen_take(&w->screen, w->picture.rgba, w->picture.width, w->picture.height);
    if (render) /* edges take what is left: they do not count */
        lw_pace_note(&w->pace, (uint64_t)width * height, lw_clock_ns() - start_ns - w->picture.edge_ns);
    return true;
}

static void show_picture(struct window *w) {
    if (w->gl.renderer != NULL)
        lw_gl_renderer_show(w->gl.renderer, w->options->curve, w->picture.stops, w->width, w->height);
    else
        lw_screen_show(&w->screen, w->picture.width, w->picture.height);
    show_figures(w);
    draw_keys(w);
    lw_screen_present(&w->screen);
}

/* ---- the whole ---- */

static enum lw_status open_window(struct window *w, struct lw_error *err) {
    const bool gl = w->options->renderer != LW_VIEW_RENDERER_CPU;
    enum lw_status status = open_screen(w, gl, err);
    /* shadow maps on the CPU take three times as long as its shadow rays (bench_gl) */
    if (status == LW_OK && w->options->renderer == LW_VIEW_RENDERER_AUTO && lw_gl_renderer_is_software())
        status = lw_status_fail(err, LW_UNAVAILABLE,
                                "OpenGL has no GPU here (--renderer gl draws by it all the same)");
    if (status != LW_OK) return gl ? leave_gl(w, err) : status;
    return resize(w, err);
}

static enum lw_status connect_first(struct window *w, struct lw_error *err) {
    const struct lw_view_options *o = w->options;
    snprintf(w->address, sizeof w->address, strchr(o->host, ':') ? "[%s]:%u" : "%s:%u", o->host, o->port);
    enum lw_status status = lw_seeker_create(o->host, o->port, &o->access, CLIENT_NAME, o->cache_folder,
                                             o->draws_direct, &w->seeker, err);
    if (status != LW_OK) return status;
    return lw_client_create(&(struct lw_client_desc){.host = o->host,
                                                     .port = o->port,
                                                     .access = &o->access,
                                                     .name = CLIENT_NAME,
                                                     .timeout_ms = CONNECT_MS,
                                                     .cache_folder = o->cache_folder,
                                                     .wants_nothing = true,
                                                     .draws_direct = o->draws_direct},
                            &w->incoming, err);
}

static enum lw_status run_loop(struct window *w, struct lw_error *err) {
    bool busy = true;
    w->stepped_ns = w->figures.since_ns = lw_clock_ns();
    while (!w->quit) {
        enum lw_status status = take_events(w, busy ? 0 : IDLE_WAIT_MS, err);
        uint64_t now_ns = lw_clock_ns();
        float seconds = fminf((float)(now_ns - w->stepped_ns) * 1e-9f, STEP_S_MAX);
        w->stepped_ns = now_ns;
        fly(w, seconds);
        if (status == LW_OK) status = serve_shown(w, err);
        if (status == LW_OK) status = serve_incoming(w, err);
        if (status != LW_OK) return status;
        if (!w->staged) {
            show_waiting(w);
            busy = false;
            continue;
        }
        if (w->gl.renderer != NULL) {
            if (renew_by_gl(w, seconds, &busy, err) != LW_OK) status = leave_gl(w, err);
            if (status != LW_OK) return status;
        }
        if (w->gl.renderer == NULL) busy = renew_picture(w, seconds);
        struct lw_camera_view camera = lw_flight_view(&w->flight);
        status = lw_stage_look(&w->stage, &camera, w->width, w->height, err);
        if (status != LW_OK) return status;
        if (w->keys_until_ns != 0 && now_ns > w->keys_until_ns) show_keys(w, false);
        if (busy || w->redraw || now_ns - w->figures.since_ns >= FIGURES_EVERY_NS) show_picture(w);
        w->redraw = false;
    }
    return LW_OK;
}

/* Asked for before SDL is: without a display it takes a driver that shows nothing to nobody. */
static bool has_display(void) {
    return getenv("DISPLAY") != NULL || getenv("WAYLAND_DISPLAY") != NULL ||
           getenv("SDL_VIDEODRIVER") != NULL;
}

enum lw_status lw_window_run(const struct lw_view_options *options, struct lw_error *err) {
    SDL_SetHint(SDL_HINT_VIDEO_X11_FORCE_EGL, "1"); /* GLX ends the program where its driver is missing */
    if (!has_display() || SDL_Init(SDL_INIT_VIDEO) != 0)
        return lw_status_fail(err, LW_UNAVAILABLE, "no display: use --headless");
    struct window w = {.options = options, .show_keys = true};
    lw_picture_init(&w.picture, options->curve, options->auto_exposure, options->stops, options->threads);
    enum lw_status status = connect_first(&w, err);
    if (status == LW_OK) status = open_window(&w, err);
    if (status == LW_OK) status = run_loop(&w, err);
    lw_gl_view_finish(&w.gl);
    lw_stage_finish(&w.stage);
    lw_client_destroy(w.client);
    lw_client_destroy(w.incoming);
    lw_seeker_destroy(w.seeker);
    lw_picture_finish(&w.picture);
    lw_screen_close(&w.screen);
    SDL_Quit();
    return status;
}
