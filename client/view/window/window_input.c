#include "client/view/window/window_input.h"

#include "client/view/window/window_compare.h"
#include "client/view/window/window_panels.h"
#include "client/view/window/window_render.h"
#include "client/view/window/window_screen.h"
#include "common/base/log.h"

#include <stdio.h>
#include <string.h>

#define RADIANS_PER_PIXEL 0.0025f
#define FAST              4.0f
#define STOPS_A_KEY       0.25f

static void go_to_camera(struct lw_window *w, uint32_t camera) {
    const struct lw_scene *scene = w->stage.scene;
    struct lw_camera_view view = lw_camera_of_scene(scene, &w->stage.pose, camera);
    lw_flight_take(&w->steering.flight, &view);
    lw_steering_set(&w->steering, w->steering.mode == LW_STEERING_WALK ? LW_STEERING_FLY : w->steering.mode,
                    w->stage.trace, w->size_m);
    w->next_camera = (camera + 1) % scene->camera_count;
    lw_window_panels_notify(w, "camera %u of %u: %.60s", camera + 1, scene->camera_count,
                            scene->camera[camera].name);
    lw_window_touch(w);
}

static void capture(struct lw_window *w, bool on) {
    w->captured = on;
    SDL_SetRelativeMouseMode(on ? SDL_TRUE : SDL_FALSE);
}

/* Copies a command line with the camera to the clipboard, and prints it on the terminal. */
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
        lw_window_panels_notify(w, "camera copied as a command line");
    else
        lw_window_panels_notify(w, "the camera's command line is in the terminal");
}

static void set_exposure(struct lw_window *w, bool by_picture, float stops) {
    w->picture.auto_exposure = by_picture;
    if (by_picture) {
        w->surveyed_ns = 0; /* metered again */
        lw_window_panels_notify(w, "exposure by the picture");
    } else {
        w->picture.stops_wanted = fminf(fmaxf(stops, -LW_TONEMAP_STOPS_MAX), LW_TONEMAP_STOPS_MAX);
        w->picture.stops_known = true;
        lw_window_panels_notify(w, "exposure %+.2f stops", (double)w->picture.stops_wanted);
    }
    w->stale = true;
}

/* step: 1 for the next one, -1 for the one before */
static void set_show(struct lw_window *w, int step) {
    w->picture.show = (enum lw_show)(((int)w->picture.show + step + LW_SHOW_COUNT) % LW_SHOW_COUNT);
    lw_window_panels_notify(w, "%s: %s", lw_show_name(w->picture.show), lw_show_about(w->picture.show));
    w->stale = true;
}

static void set_compare(struct lw_window *w, enum lw_window_compare compare) {
    static const char *const says[LW_WINDOW_COMPARES] = {
        "the light of tiles alone", "side by side with a path tracer: the mouse moves the line",
        "difference from a path tracer"};
    w->compare = compare;
    if (compare == LW_WINDOW_COMPARE_NONE) lw_window_compare_stop(w);
    w->picture.show = LW_SHOW_ALL;
    lw_window_panels_notify(w, "%s", says[compare]);
    w->stale = true;
}

static void set_mode(struct lw_window *w, enum lw_steering_mode mode) {
    lw_steering_set(&w->steering, mode, w->stage.trace, w->size_m);
    lw_window_panels_notify(w, "%s", lw_steering_names[mode]);
    lw_window_touch(w);
}

static void set_full_screen(struct lw_window *w, bool on) {
    if (SDL_SetWindowFullscreen(w->screen.handle, on ? (Uint32)SDL_WINDOW_FULLSCREEN_DESKTOP : 0) == 0)
        w->full_screen = on;
    else
        lw_window_panels_notify(w, "no full screen here: %.100s", SDL_GetError());
}

static void try_to_save(struct lw_window *w) {
    struct lw_error err = {0};
    if (w->width == 0) return;
    if (lw_window_render_save(w, &err) == LW_OK) return;
    lw_log(LW_LOG_WARNING, "%s", err.text);
    lw_window_panels_notify(w, "not saved: %.140s", err.text);
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
    if (key == SDLK_t) set_compare(w, (enum lw_window_compare)((w->compare + 1) % LW_WINDOW_COMPARES));
    if (key == SDLK_v) set_show(w, shift ? -1 : 1);
    if (key == SDLK_k) copy_camera(w);
    if (key == SDLK_p) try_to_save(w);
    if (key == SDLK_PLUS || key == SDLK_EQUALS || key == SDLK_KP_PLUS)
        set_exposure(w, false, stops + STOPS_A_KEY);
    if (key == SDLK_MINUS || key == SDLK_KP_MINUS) set_exposure(w, false, stops - STOPS_A_KEY);
    if (key == SDLK_x) set_exposure(w, true, 0);
}

static void press(struct lw_window *w, SDL_Keycode key, bool shift) {
    lw_window_panels_set_keys(w, key == SDLK_h && !w->show_keys);
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

static void set_wipe(struct lw_window *w, int x) {
    int width = 0, height;
    SDL_GetWindowSize(w->screen.handle, &width, &height);
    if (width > 0) w->wipe = fminf(fmaxf((float)x / (float)width, 0), 1);
    if (w->compare == LW_WINDOW_COMPARE_SIDE_BY_SIDE) w->redraw = true;
}

static void set_key_held(struct lw_window *w, SDL_Scancode key, bool down) {
    if ((unsigned)key < SDL_NUM_SCANCODES) w->held[key] = down;
}

enum lw_status lw_window_input_take(struct lw_window *w, int wait_ms, struct lw_error *err) {
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
            lw_window_panels_set_keys(w, false);
            break;
        case SDL_MOUSEMOTION:
            if (!w->captured) set_wipe(w, event.motion.x);
            if (!w->captured || !w->staged) break;
            lw_steering_turn(&w->steering, RADIANS_PER_PIXEL * (float)event.motion.xrel,
                             -RADIANS_PER_PIXEL * (float)event.motion.yrel);
            lw_window_touch(w);
            break;
        case SDL_MOUSEWHEEL:
            if (!w->staged) break;
            lw_steering_wheel(&w->steering, (float)event.wheel.y);
            if (w->steering.mode == LW_STEERING_ORBIT) lw_window_touch(w);
            break;
        case SDL_WINDOWEVENT:
            if (event.window.event == SDL_WINDOWEVENT_FOCUS_LOST) {
                capture(w, false);
                memset(w->held, 0, sizeof w->held); /* their release is not reported */
            }
            resized |= event.window.event == SDL_WINDOWEVENT_SIZE_CHANGED;
            break;
        default:
            break;
        }
    }
    return resized ? lw_window_screen_resize(w, err) : LW_OK;
}

static float axis(const bool *keys, SDL_Scancode positive, SDL_Scancode negative) {
    return (float)keys[positive] - (float)keys[negative];
}

void lw_window_input_move(struct lw_window *w, float seconds) {
    const bool *keys = w->held;
    float right = axis(keys, SDL_SCANCODE_D, SDL_SCANCODE_A), up = axis(keys, SDL_SCANCODE_E, SDL_SCANCODE_Q),
          forward = axis(keys, SDL_SCANCODE_W, SDL_SCANCODE_S);
    if (!w->staged) return;
    const float pace = keys[SDL_SCANCODE_LSHIFT] || keys[SDL_SCANCODE_RSHIFT] ? FAST : 1;
    if (lw_steering_move(&w->steering, w->stage.trace, pace * right, pace * up, pace * forward, seconds))
        lw_window_touch(w);
}
