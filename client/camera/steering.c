#include "client/camera/steering.h"

#include <math.h>

#define KNEE          0.35f /* over the eye's height: higher steps are walls */
#define ROOM          0.15f /* over the eye's height: a walker's distance from walls */
#define EYE_SHARE     0.4f  /* over the scene's height, at most */
#define STAND_RATE_HZ 8.0f
#define STOOD         1e-3f /* over the eye's height */
#define ORBIT_RATE    1.0f  /* radians/s by keys */
#define ZOOM_RATE     1.0f  /* octaves/s by keys */
#define NOTCH         0.25f /* octaves of speed or distance */

const char *const lw_steering_names[LW_STEERING_MODES] = {"fly", "walk", "orbit"};

float lw_steering_reach(const struct lw_trace *trace, struct lw_vec3 from, struct lw_vec3 direction) {
    struct lw_ray16 rays = {0};
    struct lw_hit16 hits;
    lw_trace_set_ray(&rays, 0, from, direction, INFINITY);
    lw_trace_closest16(trace, LW_TRACE_VIEW, 1, &rays, &hits);
    return hits.object[0] == LW_TRACE_MISS ? INFINITY : hits.t[0];
}

void lw_steering_start(struct lw_steering *s, const struct lw_camera_view *view, float size_m, float high_m) {
    *s = (struct lw_steering){.flight.speed = size_m > 0 ? fmaxf(size_m / 10.0f, 0.05f) : 2.0f,
                              .eye_m = LW_STEERING_EYE_M,
                              .distance_m = size_m > 0 ? size_m : 1};
    if (high_m > 0 && s->eye_m > EYE_SHARE * high_m) s->eye_m = EYE_SHARE * high_m;
    lw_flight_take(&s->flight, view);
}

void lw_steering_set(struct lw_steering *s, enum lw_steering_mode mode, const struct lw_trace *trace,
                     float fallback_m) {
    s->mode = mode;
    s->standing = false;
    if (mode != LW_STEERING_ORBIT) return;
    const struct lw_camera_view view = lw_flight_view(&s->flight);
    const float reach = lw_steering_reach(trace, view.position, view.forward);
    s->distance_m = isfinite(reach) && reach > 0 ? reach : fallback_m > 0 ? fallback_m : 1;
}

void lw_steering_turn(struct lw_steering *s, float right, float up) {
    if (s->mode == LW_STEERING_ORBIT)
        lw_flight_orbit(&s->flight, s->distance_m, right, up);
    else
        lw_flight_turn(&s->flight, right, up);
}

static void zoom(struct lw_steering *s, float octaves) {
    const float wanted = s->distance_m * exp2f(octaves);
    lw_flight_advance(&s->flight, s->distance_m - wanted);
    s->distance_m = wanted;
    s->flight.height_m *= exp2f(octaves); /* nearer things are no larger in an orthographic view */
}

void lw_steering_wheel(struct lw_steering *s, float notches) {
    if (s->mode == LW_STEERING_ORBIT)
        zoom(s, -NOTCH * notches);
    else
        s->flight.speed *= exp2f(NOTCH * notches);
}

/* Whether a wall is in the way of a step, at the height of the knee or of the eye. */
static bool is_blocked(const struct lw_steering *s, const struct lw_trace *trace, struct lw_vec3 step) {
    const float length = lw_vec3_length(step);
    struct lw_vec3 from = s->flight.position;
    const struct lw_vec3 ahead = lw_vec3_scale(step, (length + ROOM * s->eye_m) / length);
    if (lw_steering_reach(trace, from, ahead) < 1) return true;
    from.y -= (1 - KNEE) * s->eye_m;
    return lw_steering_reach(trace, from, ahead) < 1;
}

static bool walk(struct lw_steering *s, const struct lw_trace *trace, float right, float forward,
                 float seconds) {
    bool moved = false;
    if (right != 0 || forward != 0) {
        struct lw_flight next = s->flight;
        lw_flight_walk(&next, right, forward, seconds);
        const struct lw_vec3 step = lw_vec3_sub(next.position, s->flight.position);
        if (lw_vec3_length(step) > 0 && !is_blocked(s, trace, step)) {
            s->flight = next;
            s->standing = false;
            moved = true;
        }
    }
    if (s->standing) return moved;
    const float below = lw_steering_reach(trace, s->flight.position, lw_vec3(0, -1, 0));
    const float way = s->eye_m - below; /* up */
    s->standing = !isfinite(below) || fabsf(way) < STOOD * s->eye_m;
    if (!isfinite(below)) return moved; /* no ground: one hovers */
    s->flight.position.y += s->standing ? way : way * (1 - expf(-seconds * STAND_RATE_HZ));
    return true;
}

bool lw_steering_move(struct lw_steering *s, const struct lw_trace *trace, float right, float up,
                      float forward, float seconds) {
    if (s->mode == LW_STEERING_WALK) return walk(s, trace, right, forward, seconds);
    if (right == 0 && up == 0 && forward == 0) return false;
    if (s->mode == LW_STEERING_FLY) {
        lw_flight_move(&s->flight, right, up, forward, seconds);
        return true;
    }
    lw_flight_orbit(&s->flight, s->distance_m, -ORBIT_RATE * right * seconds, -ORBIT_RATE * up * seconds);
    if (forward != 0) zoom(s, -ZOOM_RATE * forward * seconds);
    return true;
}
