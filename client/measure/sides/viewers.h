/* viewers.h: the users of one server in one process. Each has a client; they share scene, rays and
 * composer. A viewer by OpenGL has a renderer of its own, with a copy of the light, as on a GPU of its own.
 * Flow:    server -> clients -> [viewers] -> pictures
 * Threads: one thread at a time, with OpenGL always the same; a picture is composed by several threads. */
#ifndef LW_CLIENT_MEASURE_SIDES_VIEWERS_H
#define LW_CLIENT_MEASURE_SIDES_VIEWERS_H

#include "client/gl/gl_offscreen.h"
#include "client/gl/gl_renderer.h"
#include "client/view/compose/attention.h"
#include "client/view/compose/compose.h"
#include "client/view/lights/drawn_lights.h"

#define LW_VIEWERS_LOOK_NS 100000000u /* between two updates of a client's interest */

struct lw_viewers {
    uint16_t port; /* on 127.0.0.1 */
    uint32_t width, height;
    unsigned threads;
    bool wants_everything; /* clients send no interest */
    /* users draw the direct light of client lights. Set before the first joins. Default: tiles hold it */
    bool draws_direct;
    bool unfiltered;  /* noisy tiles are read at full resolution (compose.h) */
    bool draws_by_gl; /* by OpenGL, not by rays. Set before the first joins */
    struct lw_viewers_user {
        struct lw_client *client;
        struct lw_attention attention;
        uint64_t looked_ns; /* 0: never */
        struct lw_gl_renderer *gl;
    } * user;
    uint32_t count, capacity;

    /* for the first client's scene: */
    const struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct lw_client_lights drawn;
    struct lw_gl_offscreen *offscreen; /* for draws_by_gl */
};

/** Starts without users. Finish it in any case. */
void lw_viewers_init(struct lw_viewers *viewers, uint16_t port, uint32_t width, uint32_t height,
                     unsigned threads, bool wants_everything, bool unfiltered);
/** A zeroed one is fine. */
void lw_viewers_finish(struct lw_viewers *viewers);

/** Lets clients join or leave until there are `count`, and waits for the scene.
 * Errors: those of lw_client_create() and lw_client_poll(); LW_TIMED_OUT; LW_NO_MEMORY; LW_UNAVAILABLE where
 *         OpenGL is. */
LW_MUST_CHECK enum lw_status lw_viewers_set_count(struct lw_viewers *viewers, uint32_t count,
                                                  struct lw_error *err);

struct lw_client_stats lw_viewers_stats(const struct lw_viewers *viewers, uint32_t user);

/** Moves objects and client-drawn lights to the server's newest pose, read from the first client.
 * Errors: LW_NO_MEMORY, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_viewers_follow(struct lw_viewers *viewers, struct lw_error *err);

/** Clears a user's interest. The user's next lw_viewers_look() is due at once.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_viewers_forget(struct lw_viewers *viewers, uint32_t user,
                                               struct lw_error *err);

/** Draws a user's view from the light that the user's client has. out_rgb: width * height * 3 floats.
 * Errors: those of lw_gl_renderer_draw(), with draws_by_gl alone. */
LW_MUST_CHECK enum lw_status lw_viewers_show(struct lw_viewers *viewers, uint32_t user,
                                             const struct lw_camera_view *camera, float *out_rgb,
                                             struct lw_error *err);
/** Sets the interest of a user's client from a view, if an update is due. The next lw_client_poll() sends
 * it.
 * now_ns: > 0, of the clock that frames follow.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_viewers_look(struct lw_viewers *viewers, uint32_t user,
                                             const struct lw_camera_view *camera, uint64_t now_ns,
                                             struct lw_error *err);

#endif
