/* window_private.h: a window's state, and what its files do for one another. Each uses those below it:
 *
 *   window.c          the window as a whole: begin, step, end
 *   window_input.c    keys and mouse
 *   window_link.c     the server: first connection, a scene's arrival, a server that has gone
 *   window_render.c   the picture, by OpenGL or by rays; saved pictures
 *   window_compare.c  the picture beside a path tracer's
 *   window_screen.c   the screen: opening, size, from OpenGL to the CPU
 *   window_panels.c   text over the picture: figures, keys, notices, waiting
 *
 * Threads: main() only. For these files alone. */
#ifndef LW_CLIENT_VIEW_WINDOW_WINDOW_PRIVATE_H
#define LW_CLIENT_VIEW_WINDOW_WINDOW_PRIVATE_H

#include "client/gl/gl_view.h"
#include "client/view/own_server.h"
#include "client/view/window/overlay.h"
#include "client/view/window/pace.h"
#include "client/view/window/panel.h"
#include "client/view/window/picture.h"
#include "client/view/window/screen.h"
#include "client/view/window/seeker.h"
#include "client/view/window/window.h"
#include "common/base/clock.h"

#define LW_WINDOW_FIGURES_EVERY_NS 500000000u

/* Figures of the overlay. They change twice a second, so that a user can read them. */
struct lw_window_figures {
    uint64_t since_ns, bytes;
    unsigned pictures;
    double pictures_per_s, kbit_per_s;
};

/* Ways to show a path tracer's picture of the same view. */
enum lw_window_compare {
    LW_WINDOW_COMPARE_NONE,
    LW_WINDOW_COMPARE_SIDE_BY_SIDE,
    LW_WINDOW_COMPARE_DIFFERENCE,
    LW_WINDOW_COMPARES
};

struct lw_window {
    const struct lw_view_options *options;
    struct lw_screen screen;
    struct lw_panel panel;
    uint32_t width, height; /* 0: it has no pixels yet */
    char address[280];

    struct lw_own_server *server; /* NULL: somebody else's */
    uint64_t importing_ns;        /* begin of its import; 0: it imports nothing */
    struct lw_client *client;     /* its light is shown; it may have lost its server */
    bool lost;
    struct lw_stage stage;
    bool staged;
    struct lw_gl_view gl;       /* the stage's, if the screen is OpenGL's */
    uint64_t surveyed_ns;       /* time of the last survey */
    bool unsurveyed;            /* the picture is newer than it */
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

    enum lw_window_compare compare;
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
    struct lw_window_figures figures;
};

/* The view has changed: the picture is out of date, and moves. */
static inline void lw_window_touch(struct lw_window *w) {
    w->moved_ns = lw_clock_ns();
    w->stale = true;
}

#endif
