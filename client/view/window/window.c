#include "client/view/window/window.h"

#include "client/gl/gl_view.h"
#include "client/lib/package_cache.h"
#include "client/paths/camera_default.h"
#include "client/view/compose/stage.h"
#include "client/view/own_server.h"
#include "client/view/window/comparison.h"
#include "client/view/window/overlay.h"
#include "client/view/window/pace.h"
#include "client/view/window/panel.h"
#include "client/view/window/picture.h"
#include "client/view/window/saved_picture.h"
#include "client/view/window/screen.h"
#include "client/view/window/seeker.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/tile/tile_channels.h"

#include <SDL.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CLIENT_NAME       "lightwell-view"
#define CONNECT_MS        5000u
#define IDLE_WAIT_MS      8
#define REST_AFTER_NS     200000000u /* without motion: then the picture sharpens */
#define FIGURES_EVERY_NS  500000000u
#define KEYS_SHOWN_NS     20000000000u /* after the first picture, unless somebody presses a key before */
#define NOTICE_SHOWN_NS   4000000000u
#define RADIANS_PER_PIXEL 0.0025f
#define FAST              4.0f
#define TILES_A_PICTURE                                                                                      \
    32u /* OpenGL takes over no more: with the work of a poll that is under 4 ms (bench_take) */
#define MSAA            4u
#define SAVED_SAMPLES   16u /* per pixel of a saved picture */
#define SURVEY_EVERY_NS 250000000u
#define STEP_S_MAX      0.1f /* a hitch must not throw the camera across the room */
#define STOPS_A_KEY     0.25f
#define TRACED_SHARE    2 /* a traced picture has one pixel for this number of them, each way */

#define PANEL_LINES 4
#define PANEL_INSET 12 /* from the window's edges */

/* What the overlay says; taken twice a second so that it can be read. */
struct figures {
    uint64_t since_ns, bytes;
    unsigned pictures;
    double pictures_per_s, kbit_per_s;
};

/* How a path tracer's picture of the same view is shown. */
enum compare { COMPARE_NONE, COMPARE_SIDE_BY_SIDE, COMPARE_DIFFERENCE, COMPARES };

struct lw_window {
    const struct lw_view_options *options;
    struct lw_screen screen;
    struct lw_panel panel;
    uint32_t width, height; /* 0: it has no pixels yet */
    char address[280];

    struct lw_own_server *server; /* NULL: somebody else's */
    uint64_t importing_ns;        /* since when it imports its scene; 0: it does not */
    struct lw_client *client;     /* its light is shown; it may have lost its server */
    bool lost;
    struct lw_stage stage;
    bool staged;
    struct lw_gl_view gl;       /* the stage's, if the screen is OpenGL's */
    uint64_t surveyed_ns;       /* when it was last asked what the view needs */
    bool unsurveyed;            /* the picture is newer */
    uint32_t waiting;           /* tiles that it has not taken over yet, or that fade */
    struct lw_client *incoming; /* connected, its scene or first light not there yet */
    struct lw_seeker *seeker;

    struct lw_steering steering;
    struct lw_camera_view start;
    float size_m; /* the scene's */
    uint32_t next_camera;
    bool captured, hide_figures, quit, full_screen;
    bool held[SDL_NUM_SCANCODES]; /* keys */
    bool show_keys;
    uint64_t keys_until_ns; /* 0: until somebody hides them */
    char notice[160];
    uint64_t notice_until_ns; /* 0: there is none */
    char says[160];

    enum compare compare;
    struct lw_comparison *comparison; /* the stage's; NULL: nothing is compared */
    struct lw_comparison_picture traced;
    bool scene_changed;               /* since the last lw_comparison_follow() */
    float wipe;                       /* where the traced picture begins, over the window's width */
    uint32_t *over;                   /* pixels over the picture */
    float *light;                     /* the picture that is compared */
    uint32_t over_width, over_height; /* window size that there is room for */

    struct lw_picture picture;
    struct lw_pace pace;
    bool stale;  /* the picture is not up to date */
    bool redraw; /* the overlay is not */
    bool busy;   /* the last step had something to do */
    uint64_t moved_ns, stepped_ns, coloured_ns, pictures;
    uint64_t seen_tiles, seen_frame, seen_finishes_ns;
    struct figures figures;
};

static void stop_comparing(struct lw_window *w) {
    lw_comparison_destroy(w->comparison);
    w->comparison = NULL;
    w->traced = (struct lw_comparison_picture){0};
}

static void touch(struct lw_window *w) {
    w->moved_ns = lw_clock_ns();
    w->stale = true;
}

/* Says something for some seconds. */
__attribute__((format(printf, 2, 3))) static void notify(struct lw_window *w, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(w->notice, sizeof w->notice, format, arguments);
    va_end(arguments);
    snprintf(w->says, sizeof w->says, "%s", w->notice);
    w->notice_until_ns = lw_clock_ns() + NOTICE_SHOWN_NS;
    w->redraw = true;
}

static void show_message(struct lw_window *w, const char *text, float fraction);

/* ---- the server ---- */

static void drop_incoming(struct lw_window *w) {
    lw_client_destroy(w->incoming);
    w->incoming = NULL;
}

static void seek_again(struct lw_window *w, const struct lw_client *lost, const struct lw_error *err) {
    lw_log(LW_LOG_WARNING, "%s; looking for the server again", err->text);
    lw_seeker_start(w->seeker, lw_client_retry_after_ms(lost));
}

static void go_to_camera(struct lw_window *w, uint32_t camera) {
    const struct lw_scene *scene = w->stage.scene;
    struct lw_camera_view view = lw_camera_of_scene(scene, &w->stage.pose, camera);
    lw_flight_take(&w->steering.flight, &view);
    lw_steering_set(&w->steering, w->steering.mode == LW_STEERING_WALK ? LW_STEERING_FLY : w->steering.mode,
                    w->stage.trace, w->size_m);
    w->next_camera = (camera + 1) % scene->camera_count;
    notify(w, "camera %u of %u: %.60s", camera + 1, scene->camera_count, scene->camera[camera].name);
    touch(w);
}

/* first: the command line's camera counts; else the scene is another one, which has its own. */
static enum lw_status choose_start(struct lw_window *w, bool first, struct lw_error *err) {
    const struct lw_scene *scene = w->stage.scene;
    uint32_t camera = 0;
    if (first && w->options->camera_name != NULL) {
        enum lw_status status = lw_camera_find(scene, w->options->camera_name, &camera, err);
        if (status != LW_OK) return status;
    }
    if (first && w->options->camera_given)
        w->start = w->options->camera;
    else if (camera < scene->camera_count)
        w->start = lw_camera_of_scene(scene, &w->stage.pose, camera);
    else
        w->start = lw_camera_default(scene, &w->stage.pose, w->stage.trace,
                                     w->height > 0 ? (float)w->width / (float)w->height : 1);
    w->next_camera = scene->camera_count > 1 ? camera + 1 : 0;
    struct lw_vec3 low, high;
    float high_m = 0;
    w->size_m = 0;
    if (lw_pose_bounds(&w->stage.pose, scene, &low, &high)) {
        w->size_m = lw_vec3_length(lw_vec3_sub(high, low));
        high_m = high.y - low.y;
    }
    lw_steering_start(&w->steering, &w->start, w->size_m, high_m);
    touch(w);
    return LW_OK;
}

static enum lw_status resize(struct lw_window *w, struct lw_error *err);

/* The program ends: nothing of ours may stay behind. */
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

/* OpenGL has failed: on with the CPU, if nobody has asked for OpenGL. */
static enum lw_status leave_gl(struct lw_window *w, struct lw_error *err) {
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

/* Shows the incoming client in place of the current one. */
static enum lw_status stage_incoming(struct lw_window *w, struct lw_error *err) {
    const bool first = !w->staged;
    const bool other = first || memcmp(lw_client_package_hash(w->client), lw_client_package_hash(w->incoming),
                                       LW_CLIENT_HASH_SIZE) != 0;
    bool moved;
    struct lw_stage stage;
    enum lw_status status = lw_stage_init(&stage, w->incoming, w->options->threads, err);
    if (status != LW_OK) return status;
    status = lw_stage_follow(&stage, &moved, err);
    if (status != LW_OK) {
        lw_stage_finish(&stage);
        return status;
    }
    stop_comparing(w); /* it looks at that scene; the next picture begins again */
    lw_gl_view_finish(&w->gl);
    stage.mirrors = w->options->mirrors;
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
    if (!first) lw_log(LW_LOG_INFO, "%s: connected again%s", w->address, other ? ", to another scene" : "");
    if (!first && other) notify(w, "the scene is another one");
    if (first && w->show_keys) w->keys_until_ns = lw_clock_ns() + KEYS_SHOWN_NS;
    return other ? choose_start(w, first, err) : LW_OK;
}

static bool is_ready(const struct lw_window *w, struct lw_client *client) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    /* The old light is better than none: it stays until the first of the new server's is there. */
    return lw_client_scene(client) != NULL && (!w->staged || stats.first_ns != 0);
}

static enum lw_status serve_incoming(struct lw_window *w, struct lw_error *err) {
    if (w->seeker == NULL) return LW_OK; /* a server of our own is not there yet */
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

static enum lw_status serve_shown(struct lw_window *w, struct lw_error *err) {
    if (!w->staged) return LW_OK;
    struct lw_error lost = {0};
    if (!w->lost && lw_client_poll(w->client, 0, &lost) != LW_OK) {
        w->lost = true;
        seek_again(w, w->client, &lost);
    }
    struct lw_client_stats stats;
    lw_client_get_stats(w->client, &stats);
    if (stats.tiles != w->seen_tiles || stats.finishes_ns != w->seen_finishes_ns) w->stale = true;
    w->seen_finishes_ns = stats.finishes_ns;
    /* tiles grow old, and are asked for, without a word of the server */
    if (lw_show_is_of_tiles(w->picture.show) && lw_clock_ns() - w->coloured_ns > FIGURES_EVERY_NS) {
        w->coloured_ns = lw_clock_ns();
        w->stale = true;
    }
    if (stats.frame == w->seen_frame && stats.tiles == w->seen_tiles) return LW_OK;
    w->seen_tiles = stats.tiles;
    w->seen_frame = stats.frame;
    bool moved;
    enum lw_status status = lw_stage_follow(&w->stage, &moved, err);
    if (status == LW_OK && moved) {
        w->scene_changed = true;
        touch(w);
    }
    return status;
}

static enum lw_status connect_first(struct lw_window *w, uint16_t port, struct lw_error *err) {
    const struct lw_view_options *o = w->options;
    snprintf(w->address, sizeof w->address, strchr(o->host, ':') ? "[%s]:%u" : "%s:%u", o->host, port);
    enum lw_status status = lw_seeker_create(o->host, port, &o->access, CLIENT_NAME, o->cache_folder,
                                             o->draws_direct, &w->seeker, err);
    if (status != LW_OK) return status;
    return lw_client_create(&(struct lw_client_desc){.host = o->host,
                                                     .port = port,
                                                     .access = &o->access,
                                                     .name = CLIENT_NAME,
                                                     .timeout_ms = CONNECT_MS,
                                                     .cache_folder = o->cache_folder,
                                                     .wants_nothing = true,
                                                     .budget_ns = LW_SEEKER_BUDGET_NS,
                                                     .draws_direct = o->draws_direct,
                                                     .channel_features = LW_TILE_CHANNELS_DIRECTION,
                                                     .finer = LW_ATLAS_FINER_MAX,
                                                     .materials = true,
                                                     .watch = {.damaged = lw_package_cache_warn,
                                                               .unkept = lw_package_cache_warn_unkept}},
                            &w->incoming, err);
}

/* A server of our own listens once it has imported its scene. */
static enum lw_status await_own_server(struct lw_window *w, struct lw_error *err) {
    uint16_t port = 0;
    if (w->importing_ns == 0) return LW_OK;
    enum lw_status status = lw_own_server_poll(w->server, &port, err);
    if (status != LW_OK || port == 0) return status;
    w->importing_ns = 0;
    return connect_first(w, port, err);
}

/* ---- the user ---- */

static void capture(struct lw_window *w, bool on) {
    w->captured = on;
    SDL_SetRelativeMouseMode(on ? SDL_TRUE : SDL_FALSE);
}

static void show_keys(struct lw_window *w, bool on) {
    w->show_keys = on;
    w->keys_until_ns = 0;
    w->redraw = true;
}

/* The camera as a command: to the clipboard, and to the terminal, where there may be no clipboard. */
static void copy_camera(struct lw_window *w) {
    const struct lw_view_options *o = w->options;
    const struct lw_camera_view view = lw_flight_view(&w->steering.flight);
    char camera[LW_CAMERA_TEXT_SIZE], exposure[32] = "", command[1024];
    lw_camera_format(&view, camera);
    if (!w->picture.auto_exposure)
        snprintf(exposure, sizeof exposure, " --exposure %.3g", (double)w->picture.stops);
    snprintf(command, sizeof command, "lightwell-view %.600s --camera %s --size %ux%u%s",
             o->scene ? o->scene : w->address, camera, w->width, w->height, exposure);
    fprintf(stderr, "%s\n", command);
    if (SDL_SetClipboardText(command) == 0)
        notify(w, "camera copied as a command line");
    else
        notify(w, "the camera's command line is in the terminal");
}

static void set_exposure(struct lw_window *w, bool by_picture, float stops) {
    w->picture.auto_exposure = by_picture;
    if (by_picture) {
        w->surveyed_ns = 0; /* metered again */
        notify(w, "exposure by the picture");
    } else {
        w->picture.stops_wanted = fminf(fmaxf(stops, -LW_TONEMAP_STOPS_MAX), LW_TONEMAP_STOPS_MAX);
        w->picture.stops_known = true;
        notify(w, "exposure %+.2f stops", (double)w->picture.stops_wanted);
    }
    w->stale = true;
}

/* The next one, or the one before. */
static void set_show(struct lw_window *w, int step) {
    w->picture.show = (enum lw_show)(((int)w->picture.show + step + LW_SHOW_COUNT) % LW_SHOW_COUNT);
    notify(w, "%s: %s", lw_show_name(w->picture.show), lw_show_about(w->picture.show));
    w->stale = true;
}

static void set_compare(struct lw_window *w, enum compare compare) {
    static const char *const says[COMPARES] = {"the light of tiles alone",
                                               "side by side with a path tracer: the mouse moves the line",
                                               "difference from a path tracer"};
    w->compare = compare;
    if (compare == COMPARE_NONE) stop_comparing(w);
    w->picture.show = LW_SHOW_ALL;
    notify(w, "%s", says[compare]);
    w->stale = true;
}

static void set_mode(struct lw_window *w, enum lw_steering_mode mode) {
    lw_steering_set(&w->steering, mode, w->stage.trace, w->size_m);
    notify(w, "%s", lw_steering_names[mode]);
    touch(w);
}

static void set_full_screen(struct lw_window *w, bool on) {
    if (SDL_SetWindowFullscreen(w->screen.handle, on ? (Uint32)SDL_WINDOW_FULLSCREEN_DESKTOP : 0) == 0)
        w->full_screen = on;
    else
        notify(w, "no full screen here: %.100s", SDL_GetError());
}

static enum lw_status save_picture(struct lw_window *w, struct lw_error *err);

static void try_to_save(struct lw_window *w) {
    struct lw_error err = {0};
    if (w->width == 0) return;
    if (save_picture(w, &err) == LW_OK) return;
    lw_log(LW_LOG_WARNING, "%s", err.text);
    notify(w, "not saved: %.140s", err.text);
}

static void press_staged(struct lw_window *w, SDL_Keycode key, bool shift) {
    const uint32_t cameras = w->stage.scene->camera_count;
    const float stops = w->picture.auto_exposure ? w->picture.stops : w->picture.stops_wanted;
    if (key == SDLK_c && cameras > 0) go_to_camera(w, w->next_camera);
    if (key >= SDLK_1 && key <= SDLK_9 && (uint32_t)(key - SDLK_1) < cameras)
        go_to_camera(w, (uint32_t)(key - SDLK_1));
    if (key == SDLK_0) {
        lw_flight_take(&w->steering.flight, &w->start);
        set_mode(w, LW_STEERING_FLY);
    }
    if (key == SDLK_m) set_mode(w, (enum lw_steering_mode)((w->steering.mode + 1) % LW_STEERING_MODES));
    if (key == SDLK_t) set_compare(w, (enum compare)((w->compare + 1) % COMPARES));
    if (key == SDLK_v) set_show(w, shift ? -1 : 1);
    if (key == SDLK_k) copy_camera(w);
    if (key == SDLK_p) try_to_save(w);
    if (key == SDLK_PLUS || key == SDLK_EQUALS || key == SDLK_KP_PLUS)
        set_exposure(w, false, stops + STOPS_A_KEY);
    if (key == SDLK_MINUS || key == SDLK_KP_MINUS) set_exposure(w, false, stops - STOPS_A_KEY);
    if (key == SDLK_x) set_exposure(w, true, 0);
}

static void press(struct lw_window *w, SDL_Keycode key, bool shift) {
    show_keys(w, key == SDLK_h && !w->show_keys);
    if (key == SDLK_ESCAPE) {
        if (w->captured)
            capture(w, false);
        else
            w->quit = true;
    }
    if (key == SDLK_F1) w->hide_figures = !w->hide_figures;
    if (key == SDLK_F11) set_full_screen(w, !w->full_screen);
    if (w->staged) press_staged(w, key, shift);
}

static enum lw_status resize(struct lw_window *w, struct lw_error *err) {
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

static void set_wipe(struct lw_window *w, int x) {
    int width = 0, height;
    SDL_GetWindowSize(w->screen.handle, &width, &height);
    if (width > 0) w->wipe = fminf(fmaxf((float)x / (float)width, 0), 1);
    if (w->compare == COMPARE_SIDE_BY_SIDE) w->redraw = true;
}

static void set_key_held(struct lw_window *w, SDL_Scancode key, bool down) {
    if ((unsigned)key < SDL_NUM_SCANCODES) w->held[key] = down;
}

static enum lw_status take_events(struct lw_window *w, int wait_ms, struct lw_error *err) {
    SDL_Event event;
    bool resized = false;
    for (int some = wait_ms > 0 ? SDL_WaitEventTimeout(&event, wait_ms) : SDL_PollEvent(&event); some;
         some = SDL_PollEvent(&event)) {
        switch (event.type) {
        case SDL_QUIT:
            w->quit = true;
            break;
        case SDL_KEYUP:
            set_key_held(w, event.key.keysym.scancode, false);
            break;
        case SDL_KEYDOWN:
            set_key_held(w, event.key.keysym.scancode, true);
            if (!event.key.repeat) press(w, event.key.keysym.sym, (event.key.keysym.mod & KMOD_SHIFT) != 0);
            break;
        case SDL_MOUSEBUTTONDOWN:
            capture(w, true);
            show_keys(w, false);
            break;
        case SDL_MOUSEMOTION:
            if (!w->captured) set_wipe(w, event.motion.x);
            if (!w->captured || !w->staged) break;
            lw_steering_turn(&w->steering, RADIANS_PER_PIXEL * (float)event.motion.xrel,
                             -RADIANS_PER_PIXEL * (float)event.motion.yrel);
            touch(w);
            break;
        case SDL_MOUSEWHEEL:
            if (!w->staged) break;
            lw_steering_wheel(&w->steering, (float)event.wheel.y);
            if (w->steering.mode == LW_STEERING_ORBIT) touch(w);
            break;
        case SDL_WINDOWEVENT:
            if (event.window.event == SDL_WINDOWEVENT_FOCUS_LOST) {
                capture(w, false);
                memset(w->held, 0, sizeof w->held); /* nobody tells of their release */
            }
            resized |= event.window.event == SDL_WINDOWEVENT_SIZE_CHANGED;
            break;
        default:
            break;
        }
    }
    return resized ? resize(w, err) : LW_OK;
}

static float axis(const bool *keys, SDL_Scancode positive, SDL_Scancode negative) {
    return (float)keys[positive] - (float)keys[negative];
}

static void move(struct lw_window *w, float seconds) {
    const bool *keys = w->held;
    float right = axis(keys, SDL_SCANCODE_D, SDL_SCANCODE_A), up = axis(keys, SDL_SCANCODE_E, SDL_SCANCODE_Q),
          forward = axis(keys, SDL_SCANCODE_W, SDL_SCANCODE_S);
    if (!w->staged) return;
    const float pace = keys[SDL_SCANCODE_LSHIFT] || keys[SDL_SCANCODE_RSHIFT] ? FAST : 1;
    if (lw_steering_move(&w->steering, w->stage.trace, pace * right, pace * up, pace * forward, seconds))
        touch(w);
}

/* ---- the screen ---- */

/* Places of a panel in the window other than pixels from its upper left corner. */
enum { MIDDLE = -1, LOW = -2, RIGHT = -3 };

/* Draws lines of text, and a bar below them unless its fraction is negative, on a panel at (x, y) of the
 * window. */
static void show_panel(struct lw_window *w, int x, int y, const char *const *line, int count, float fraction,
                       uint32_t colour) {
    struct lw_error err = {0};
    if (lw_panel_draw(&w->panel, line, count, fraction, colour, &err) != LW_OK)
        return; /* a picture without text */
    if (x == MIDDLE) x = ((int)w->width - w->panel.width) / 2;
    if (x == RIGHT) x = (int)w->width - w->panel.width - PANEL_INSET;
    if (y == MIDDLE)
        y = ((int)w->height - w->panel.height) / 2;
    else if (y == LOW)
        y = (int)w->height - w->panel.height - PANEL_INSET;
    lw_screen_draw_panel(&w->screen, w->panel.pixel, w->panel.width, w->panel.height, x, y);
}

static void draw_keys(struct lw_window *w) {
    if (w->show_keys) show_panel(w, PANEL_INSET, LOW, lw_overlay_keys, LW_OVERLAY_KEYS, -1, LW_PANEL_TEXT);
}

static void draw_notice(struct lw_window *w) {
    if (w->notice_until_ns != 0)
        show_panel(w, MIDDLE, LOW, (const char *const[]){w->notice}, 1, -1, LW_PANEL_TEXT);
}

static void show_message(struct lw_window *w, const char *text, float fraction) {
    snprintf(w->says, sizeof w->says, "%s", text);
    lw_screen_clear(&w->screen);
    draw_keys(w);
    show_panel(w, MIDDLE, MIDDLE, (const char *const[]){text}, 1, fraction, LW_PANEL_TEXT);
    lw_screen_present(&w->screen);
}

static const char *file_of(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static void show_waiting(struct lw_window *w) {
    char text[96];
    if (w->importing_ns != 0) {
        snprintf(text, sizeof text, "importing %.60s, %.0f s", file_of(w->options->scene),
                 (double)(lw_clock_ns() - w->importing_ns) * 1e-9);
        show_message(w, text, -1);
        return;
    }
    if (w->incoming == NULL) {
        snprintf(text, sizeof text, "looking for %.60s", w->address);
        show_message(w, text, -1);
        return;
    }
    float fraction = lw_client_package_progress(w->incoming);
    snprintf(text, sizeof text, "receiving the scene %.0f %%", (double)fraction * 100.0);
    show_message(w, text, fraction);
}

static void take_figures(struct lw_window *w, const struct lw_client_stats *stats, uint64_t now_ns) {
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

static void show_figures(struct lw_window *w) {
    struct lw_client_stats stats;
    lw_client_get_stats(w->client, &stats);
    take_figures(w, &stats, lw_clock_ns());
    char line[PANEL_LINES][LW_OVERLAY_LINE_SIZE];
    snprintf(line[0], sizeof line[0], "%3.0f frames/s  %ux%u  %s", w->figures.pictures_per_s,
             w->picture.width, w->picture.height, lw_steering_names[w->steering.mode]);
    snprintf(line[1], sizeof line[1], "%.0f kbit/s", w->figures.kbit_per_s);
    const struct lw_overlay_state state = {.lost = w->lost,
                                           .receiving = w->incoming != NULL,
                                           .lit = stats.first_ns != 0,
                                           .waiting = lw_client_waiting(w->client),
                                           .report = w->picture.report};
    if (state.lit)
        snprintf(line[2], sizeof line[2], "light %.0f ms old", (double)stats.light_age_ns * 1e-6);
    else
        snprintf(line[2], sizeof line[2], "no light yet");
    lw_overlay_state(&state, line[3]);
    bool hint = state.lost || !state.lit;
    if (!w->hide_figures)
        show_panel(w, PANEL_INSET, PANEL_INSET, (const char *const[]){line[0], line[1], line[2], line[3]},
                   PANEL_LINES, -1, hint ? LW_PANEL_HINT : LW_PANEL_TEXT);
    else if (hint)
        show_panel(w, PANEL_INSET, PANEL_INSET, (const char *const[]){line[3]}, 1, -1, LW_PANEL_HINT);
}

/* What the view needs, how well that is served, and how bright the picture is: four times a second. */
static enum lw_status survey(struct lw_window *w, const struct lw_compose_view *view, struct lw_error *err) {
    const uint64_t now_ns = lw_clock_ns();
    w->unsurveyed = now_ns - w->surveyed_ns < SURVEY_EVERY_NS;
    if (w->unsurveyed) return LW_OK;
    w->surveyed_ns = now_ns;
    enum lw_status status = lw_gl_view_survey(&w->gl, &w->stage, view, &w->picture.report, err);
    if (status != LW_OK || !w->picture.auto_exposure) return status;
    if (lw_show_is_chart(w->picture.show)) return LW_OK;
    status = lw_gl_renderer_meter(w->gl.renderer, &w->picture.stops_wanted, err);
    if (!w->picture.stops_known) w->picture.stops = w->picture.stops_wanted;
    w->picture.stops_known = status == LW_OK;
    return status;
}

static enum lw_tonemap_curve curve_of(const struct lw_window *w) {
    return lw_show_is_chart(w->picture.show) ? LW_TONEMAP_NONE : w->options->curve;
}

static float stops_of(const struct lw_window *w) {
    return lw_show_is_chart(w->picture.show) ? 0 : w->picture.stops;
}

static void show_by_gl(struct lw_window *w) {
    lw_gl_renderer_show(w->gl.renderer, 0, curve_of(w), stops_of(w), w->width, w->height);
}

/* The same by OpenGL: in full where that is quick enough, and at rest. */
static enum lw_status renew_by_gl(struct lw_window *w, float seconds, bool *out_busy, struct lw_error *err) {
    const uint64_t start_ns = lw_clock_ns();
    const bool at_rest = start_ns - w->moved_ns > REST_AFTER_NS;
    struct lw_picture *p = &w->picture;
    uint32_t width = w->width, height = w->height;
    if (!at_rest) lw_pace_size(&w->pace, w->width, w->height, &width, &height);
    const unsigned samples = width == w->width ? MSAA : 1;
    const bool render = w->stale || w->waiting > 0 || p->width != width || p->height != height ||
                        (w->unsurveyed && start_ns - w->surveyed_ns >= SURVEY_EVERY_NS);
    struct lw_compose_view view = {
        .camera = lw_flight_view(&w->steering.flight), .width = width, .height = height};
    enum lw_status status = LW_OK;
    if (render) {
        status = lw_stage_show(&w->stage, w->picture.show, &view, err);
        if (status == LW_OK)
            status = lw_gl_view_take(&w->gl, &w->stage, TILES_A_PICTURE, start_ns, &w->waiting, err);
        if (status == LW_OK) status = lw_gl_renderer_draw(w->gl.renderer, &view, samples, err);
        if (status == LW_OK) status = survey(w, &view, err);
        if (status != LW_OK) return status;
        w->stale = false;
        w->figures.pictures++;
        w->pictures++;
        p->width = width, p->height = height, p->samples = samples;
    }
    *out_busy = lw_picture_adapt(p, seconds) || render;
    if (!*out_busy) return LW_OK;
    show_by_gl(w);
    glFinish(); /* else nothing is known of what it costs */
    if (render && samples == 1) lw_pace_note(&w->pace, (uint64_t)width * height, lw_clock_ns() - start_ns);
    if (render && samples > 1) /* without a GPU it costs two or three times as much */
        lw_pace_note(&w->pace, (uint64_t)width * height, (lw_clock_ns() - start_ns) / 2);
    return LW_OK;
}

/* Renders if there is something new or something to sharpen; returns whether it did. */
static bool renew_picture(struct lw_window *w, float seconds) {
    uint64_t start_ns = lw_clock_ns();
    bool at_rest = start_ns - w->moved_ns > REST_AFTER_NS;
    uint32_t width = w->width, height = w->height;
    if (!at_rest) lw_pace_size(&w->pace, w->width, w->height, &width, &height);
    bool sharpen = w->picture.width != width || w->picture.height != height ||
                   (at_rest && w->picture.samples < LW_PICTURE_SAMPLES_MAX);
    bool render = w->stale || sharpen;
    if (render) {
        struct lw_camera_view camera = lw_flight_view(&w->steering.flight);
        /* at rest all pixels have more samples soon */
        const bool whole = width == w->width && height == w->height;
        const uint64_t edge_time_ns =
            !at_rest && whole ? lw_pace_spare_ns(&w->pace, (uint64_t)width * height) : 0;
        lw_picture_render(&w->picture, &w->stage, &camera, width, height, w->stale, edge_time_ns);
        w->stale = false;
        w->figures.pictures++;
        w->pictures++;
    }
    if (!lw_picture_adapt(&w->picture, seconds) && !render) return false;
    lw_picture_develop(&w->picture);
    lw_screen_take(&w->screen, w->picture.rgba, w->picture.width, w->picture.height);
    if (render) /* edges take the remaining time: they do not count */
        lw_pace_note(&w->pace, (uint64_t)width * height, lw_clock_ns() - start_ns - w->picture.edge_ns);
    return true;
}

/* The current view with all its samples, whatever size it has while things move. */
static enum lw_status render_whole(struct lw_window *w, float *rgb, struct lw_error *err) {
    struct lw_compose_view view = {
        .camera = lw_flight_view(&w->steering.flight), .width = w->width, .height = w->height};
    enum lw_status status = lw_stage_show(&w->stage, w->picture.show, &view, err);
    if (status != LW_OK) return status;
    if (w->gl.renderer != NULL) return lw_gl_view_average(&w->gl, &view, SAVED_SAMPLES, rgb, err);
    struct lw_antialias antialias = {0};
    status = lw_antialias_reserve(&antialias, (size_t)w->width * w->height, err);
    if (status != LW_OK) return status;
    const struct lw_compose_source source = lw_compose_source_of(w->stage.client);
    struct lw_compose_report report;
    lw_antialias_render(&antialias, w->stage.compose, &source, &w->stage.pose, &view, SAVED_SAMPLES, rgb,
                        &report);
    lw_antialias_finish(&antialias);
    return LW_OK;
}

static enum lw_status save_picture(struct lw_window *w, struct lw_error *err) {
    char name[LW_SAVED_PICTURE_NAME_SIZE];
    float *rgb = malloc(sizeof *rgb * 3 * w->width * w->height);
    if (rgb == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the picture");
    enum lw_status status = render_whole(w, rgb, err);
    if (status == LW_OK)
        status = lw_saved_picture_write(rgb, w->width, w->height, curve_of(w), stops_of(w), name, err);
    free(rgb);
    if (status == LW_OK) notify(w, "saved %s.png and .exr", name);
    w->stale = true; /* what the renderer has in hand is another picture now */
    return status;
}

/* ---- beside a path tracer ---- */

static enum lw_status follow_comparison(struct lw_window *w, const struct lw_camera_view *camera,
                                        struct lw_error *err) {
    if (w->compare == COMPARE_NONE) return LW_OK;
    enum lw_status status = LW_OK;
    if (w->comparison == NULL) status = lw_comparison_create(0, &w->comparison, err);
    if (status == LW_OK)
        status = lw_comparison_follow(w->comparison, &w->stage, camera, (w->width + 1) / TRACED_SHARE,
                                      (w->height + 1) / TRACED_SHARE, w->scene_changed, err);
    if (status != LW_OK) return status;
    w->scene_changed = false;
    if (lw_comparison_take(w->comparison, &w->traced)) w->redraw = true;
    return LW_OK;
}

static bool make_room_over(struct lw_window *w) {
    const size_t count = (size_t)w->width * w->height;
    if (w->over_width == w->width && w->over_height == w->height) return true;
    free(w->over);
    free(w->light);
    w->over = malloc(count * sizeof *w->over);
    w->light = malloc(3 * count * sizeof *w->light);
    w->over_width = w->over && w->light ? w->width : 0;
    w->over_height = w->height;
    return w->over_width != 0;
}

/* The window's own picture as floats; its size. */
static bool take_light(struct lw_window *w, uint32_t *out_width, uint32_t *out_height) {
    const struct lw_picture *p = &w->picture;
    struct lw_error err = {0};
    *out_width = p->width, *out_height = p->height;
    if (p->width == 0 || (size_t)p->width * p->height > (size_t)w->over_width * w->over_height) return false;
    if (w->gl.renderer != NULL) return lw_gl_renderer_read(w->gl.renderer, w->light, &err) == LW_OK;
    for (size_t i = 0; i < 3ul * p->width * p->height; i++) w->light[i] = p->sum[i] / (float)p->samples;
    return true;
}

static void draw_comparison(struct lw_window *w) {
    const struct lw_comparison_picture *t = &w->traced;
    char text[2][96] = {"a path tracer begins", ""};
    int lines = 1;
    uint32_t width, height;
    if (w->compare == COMPARE_NONE) return;
    if (t->samples > 0 && make_room_over(w)) {
        char noise[32] = "";
        if (isfinite(t->error)) snprintf(noise, sizeof noise, ", noise %.1f %%", 100 * t->error);
        snprintf(text[0], sizeof text[0], "paths: %u a pixel%s", t->samples, noise);
        if (w->compare == COMPARE_SIDE_BY_SIDE) {
            const uint32_t left = (uint32_t)lrintf(w->wipe * (float)w->width);
            lw_comparison_wipe(t, w->options->curve, w->picture.stops, w->width, w->height, left, w->over);
            if (left < w->width)
                lw_screen_draw_panel(&w->screen, w->over, (int)(w->width - left), (int)w->height, (int)left,
                                     0);
        } else if (take_light(w, &width, &height)) {
            const double off =
                lw_comparison_difference(t, w->light, width, height, w->width, w->height, w->over);
            lw_screen_draw_panel(&w->screen, w->over, (int)w->width, (int)w->height, 0, 0);
            snprintf(text[1], sizeof text[1], "differs by %.1f %%: blue 0.1, green 3, red 100 %%", 100 * off);
            lines = 2;
        }
    }
    show_panel(w, RIGHT, PANEL_INSET, (const char *const[]){text[0], text[1]}, lines, -1, LW_PANEL_TEXT);
}

static void show_picture(struct lw_window *w) {
    if (w->gl.renderer != NULL)
        show_by_gl(w);
    else
        lw_screen_show(&w->screen, w->picture.width, w->picture.height);
    draw_comparison(w);
    show_figures(w);
    draw_keys(w);
    draw_notice(w);
    lw_screen_present(&w->screen);
}

/* ---- the whole ---- */

static enum lw_status open_window(struct lw_window *w, struct lw_error *err) {
    const bool gl = w->options->renderer != LW_VIEW_RENDERER_CPU;
    enum lw_status status = open_screen(w, gl, err);
    /* shadow maps on the CPU take three times as long as its shadow rays (bench_gl) */
    if (status == LW_OK && w->options->renderer == LW_VIEW_RENDERER_AUTO && lw_gl_renderer_is_software())
        status = lw_status_fail(err, LW_UNAVAILABLE,
                                "OpenGL has no GPU here (--renderer gl draws by it all the same)");
    if (status != LW_OK) return gl ? leave_gl(w, err) : status;
    return resize(w, err);
}

/* Asked for before SDL is: without a display it takes a driver that shows nothing to nobody. */
static bool has_display(void) {
    return getenv("DISPLAY") != NULL || getenv("WAYLAND_DISPLAY") != NULL ||
           getenv("SDL_VIDEODRIVER") != NULL;
}

static enum lw_status begin(struct lw_window *w, struct lw_error *err) {
    const struct lw_view_options *o = w->options;
    if (o->scene == NULL) {
        enum lw_status status = connect_first(w, o->port, err);
        return status == LW_OK ? open_window(w, err) : status;
    }
    enum lw_status status = lw_own_server_start(&o->own, &w->server, err);
    w->importing_ns = lw_clock_ns();
    return status == LW_OK ? open_window(w, err) : status;
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
    stop_comparing(w);
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
        if (renew_by_gl(w, seconds, &w->busy, err) != LW_OK) status = leave_gl(w, err);
        if (status != LW_OK) return status;
    }
    if (w->gl.renderer == NULL) w->busy = renew_picture(w, seconds);
    const struct lw_camera_view camera = lw_flight_view(&w->steering.flight);
    status = lw_stage_look(&w->stage, &camera, w->width, w->height, err);
    if (status == LW_OK) status = follow_comparison(w, &camera, err);
    if (status != LW_OK) return status;
    if (w->keys_until_ns != 0 && now_ns > w->keys_until_ns) show_keys(w, false);
    if (w->notice_until_ns != 0 && now_ns > w->notice_until_ns) w->notice_until_ns = 0, w->redraw = true;
    if (w->busy || w->redraw || now_ns - w->figures.since_ns >= FIGURES_EVERY_NS) show_picture(w);
    w->redraw = false;
    return LW_OK;
}

enum lw_status lw_window_step(struct lw_window *w, struct lw_error *err) {
    enum lw_status status = take_events(w, w->busy ? 0 : IDLE_WAIT_MS, err);
    const uint64_t now_ns = lw_clock_ns();
    const float seconds = fminf((float)(now_ns - w->stepped_ns) * 1e-9f, STEP_S_MAX);
    w->stepped_ns = now_ns;
    move(w, seconds);
    if (status == LW_OK) status = await_own_server(w, err);
    if (status == LW_OK) status = serve_shown(w, err);
    if (status == LW_OK) status = serve_incoming(w, err);
    if (status != LW_OK) return status;
    w->busy = false;
    if (w->width == 0) return resize(w, err); /* it began without pixels */
    if (w->staged) return draw(w, seconds, now_ns, err);
    show_waiting(w);
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
                                    .compares = w->compare != COMPARE_NONE,
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
