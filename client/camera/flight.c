#include "client/camera/flight.h"

#define PITCH_MAX (89.0f / 180.0f * LW_PI)

static float clamp_pitch(float pitch) { return fminf(fmaxf(pitch, -PITCH_MAX), PITCH_MAX); }

void lw_flight_take(struct lw_flight *flight, const struct lw_camera_view *view) {
    flight->position = view->position;
    /* by the right-hand vector, which is level and well defined even for a view straight down */
    flight->yaw = atan2f(view->right.z, view->right.x);
    flight->pitch = clamp_pitch(asinf(fminf(fmaxf(view->forward.y, -1.0f), 1.0f)));
    flight->fov_y = view->fov_y;
    flight->height_m = view->height_m;
}

static struct lw_vec3 forward_of(const struct lw_flight *flight) {
    float level = cosf(flight->pitch);
    return lw_vec3(sinf(flight->yaw) * level, sinf(flight->pitch), -cosf(flight->yaw) * level);
}

struct lw_camera_view lw_flight_view(const struct lw_flight *flight) {
    struct lw_camera_view view =
        lw_camera_look_at(flight->position, lw_vec3_add(flight->position, forward_of(flight)), flight->fov_y);
    view.height_m = flight->height_m;
    return view;
}

void lw_flight_turn(struct lw_flight *flight, float right, float up) {
    flight->yaw = remainderf(flight->yaw + right, 2 * LW_PI);
    flight->pitch = clamp_pitch(flight->pitch + up);
}

void lw_flight_move(struct lw_flight *flight, float right, float up, float forward, float seconds) {
    struct lw_vec3 step = lw_vec3_scale(forward_of(flight), forward);
    step = lw_vec3_mad(step, lw_vec3(cosf(flight->yaw), 0, sinf(flight->yaw)), right);
    step.y += up;
    flight->position = lw_vec3_mad(flight->position, step, flight->speed * seconds);
}

void lw_flight_walk(struct lw_flight *flight, float right, float forward, float seconds) {
    const struct lw_vec3 ahead = lw_vec3(sinf(flight->yaw), 0, -cosf(flight->yaw)),
                         aside = lw_vec3(cosf(flight->yaw), 0, sinf(flight->yaw));
    const struct lw_vec3 step = lw_vec3_mad(lw_vec3_scale(ahead, forward), aside, right);
    flight->position = lw_vec3_mad(flight->position, step, flight->speed * seconds);
}

void lw_flight_advance(struct lw_flight *flight, float way_m) {
    flight->position = lw_vec3_mad(flight->position, forward_of(flight), way_m);
}

void lw_flight_orbit(struct lw_flight *flight, float distance_m, float right, float up) {
    lw_flight_advance(flight, distance_m);
    lw_flight_turn(flight, right, up);
    lw_flight_advance(flight, -distance_m);
}
