/* steering.h: the three ways to move through a scene: to fly, to walk upright on the ground, and to
 * orbit about the point in the middle of the picture.
 * Flow:    keys and mouse -> [steering: flight, and rays of the scene] -> camera view
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_CAMERA_STEERING_H
#define LW_CLIENT_CAMERA_STEERING_H

#include "client/camera/flight.h"
#include "common/trace/trace.h"

enum lw_steering_mode { LW_STEERING_FLY, LW_STEERING_WALK, LW_STEERING_ORBIT, LW_STEERING_MODES };
extern const char *const lw_steering_names[LW_STEERING_MODES];

#define LW_STEERING_EYE_M 1.7f /* above the ground, in a scene that is large enough */

struct lw_steering {
    struct lw_flight flight;
    enum lw_steering_mode mode;
    float eye_m;      /* above the ground */
    float distance_m; /* to what one orbits about */
    bool standing;    /* the eye is at its height */
};

/** Distance along a ray to the surface that it meets; INFINITY: none.
 * direction   of any length; the distance is in units of it */
float lw_steering_reach(const struct lw_trace *trace, struct lw_vec3 from, struct lw_vec3 direction);

/** Sets speed and heights by the scene's size; starts flying where a view is.
 * size_m   diagonal of the scene's bounds; 0: unknown
 * high_m   of the bounds */
void lw_steering_start(struct lw_steering *steering, const struct lw_camera_view *view, float size_m,
                       float high_m);

/** Another way to move. Orbit turns about the point in the middle of the picture. Where there is no surface,
 * it turns about a point as far away as the scene is large (fallback_m). */
void lw_steering_set(struct lw_steering *steering, enum lw_steering_mode mode, const struct lw_trace *trace,
                     float fallback_m);

/** Turns by radians; in orbit the eye goes round. */
void lw_steering_turn(struct lw_steering *steering, float right, float up);

/** The wheel: speed, or in orbit the distance. */
void lw_steering_wheel(struct lw_steering *steering, float notches);

/** Moves by keys for some seconds, each of right, up, forward -1..1 (more: faster). A walker stays on the
 * ground, climbs steps below his knee, and stops at walls. Returns whether the view is another. */
bool lw_steering_move(struct lw_steering *steering, const struct lw_trace *trace, float right, float up,
                      float forward, float seconds);

#endif
