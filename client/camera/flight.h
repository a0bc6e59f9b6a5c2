/* flight.h: a camera that flies by keys and mouse, always upright.
 * Flow:    SDL events -> [flight] -> camera view
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_CAMERA_FLIGHT_H
#define LW_CLIENT_CAMERA_FLIGHT_H

#include "client/camera/camera.h"

struct lw_flight {
    struct lw_vec3 position;
    float yaw, pitch;      /* radians; 0, 0 looks along -Z; yaw turns to the right, pitch up */
    float fov_y, height_m; /* as a view's */
    float speed;           /* m/s */
};

/** Goes where a view is and looks where it looks; a tilted view is set upright. Keeps the speed. */
void lw_flight_take(struct lw_flight *flight, const struct lw_camera_view *view);

struct lw_camera_view lw_flight_view(const struct lw_flight *flight);

/** Turns by radians. The pitch stops just short of straight up and down. */
void lw_flight_turn(struct lw_flight *flight, float right, float up);

/** Moves for some seconds: right and forward as one looks, up as the world has it; each -1..1, times the
 * speed. */
void lw_flight_move(struct lw_flight *flight, float right, float up, float forward, float seconds);

/** The same for a walk: forward is level at any pitch. */
void lw_flight_walk(struct lw_flight *flight, float right, float forward, float seconds);

/** Goes some way along the view; m, negative: back. */
void lw_flight_advance(struct lw_flight *flight, float way_m);

/** Turns by radians about the point at that distance in the middle of the view, which stays there. */
void lw_flight_orbit(struct lw_flight *flight, float distance_m, float right, float up);

#endif
