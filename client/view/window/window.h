/* window.h: the interactive front end: a window over the live scene, with the server's light as it comes, or
 * with light of a server of its own.
 * Flow:    client -> stage -> picture or gl_view -> [window] -> screen; keys and mouse -> steering
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_WINDOW_WINDOW_H
#define LW_CLIENT_VIEW_WINDOW_WINDOW_H

#include "client/camera/steering.h"
#include "client/view/view_options.h"
#include "client/view/window/comparison.h"

/** Shows a window until the user closes it. Survives the server: it keeps the last picture and looks for it
 * again.
 * Errors: LW_UNAVAILABLE: no display, no server; LW_USAGE: no such camera; LW_NO_INPUT: no such scene. */
LW_MUST_CHECK enum lw_status lw_window_run(const struct lw_view_options *options, struct lw_error *err);

struct lw_window;

/** The same in steps. Opens the window, and begins with a scene or with the server's answer. options must
 * outlive it.
 * Errors: as lw_window_run(). */
LW_MUST_CHECK enum lw_status lw_window_create(const struct lw_view_options *options,
                                              struct lw_window **out_window, struct lw_error *err);
/** NULL is fine. */
void lw_window_destroy(struct lw_window *window);

/** Takes in what the user and the server have done, and shows that. Waits some milliseconds where there is
 * nothing new.
 * Errors: as lw_window_run(). */
LW_MUST_CHECK enum lw_status lw_window_step(struct lw_window *window, struct lw_error *err);

/** State of a window. */
struct lw_window_state {
    bool quit;   /* the user wants to leave */
    bool staged; /* there is a scene to look at */
    bool lit;    /* and the first light */
    const char
        *says; /* what the window said last in its middle or below: a message or a notice; never NULL */
    uint64_t pictures; /* drawn so far */
    struct lw_steering steering;
    struct lw_camera_view start;
    float stops;
    bool auto_exposure, keys_shown, figures_shown, full_screen, by_gl;
    enum lw_show show;
    bool compares;
    struct lw_comparison_picture traced; /* beside it */
    float wipe;                          /* where that begins, 0..1 of the width */
    uint32_t width, height;              /* the window's, pixels */
    int text_scale;
};
struct lw_window_state lw_window_state(const struct lw_window *window);

#endif
