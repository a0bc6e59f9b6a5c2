/* views.h: cameras of the users of a measurement, frame by frame.
 * Flow:    scene, its bounds and cameras -> [views] -> camera of a user in a frame
 * Threads: created by one; lookups [any].
 *
 * Frames count from 1; scene time is (frame - 1) / LW_VIEWS_HZ, as under lightwelld's step clock. */
#ifndef LW_CLIENT_MEASURE_SIDES_VIEWS_H
#define LW_CLIENT_MEASURE_SIDES_VIEWS_H

#include "client/measure/sides/renderer.h"

#define LW_VIEWS_HZ 30

enum lw_views_kind {
    /* Along the first animated camera of the scene. Without one, from the place of lw_camera_default()
     * half of the way to its target and back, at 1.4 m/s, looking left and right. */
    LW_VIEWS_WALK,
    /* Standing at places spread evenly over the scene's box, outside of geometry, looking at its centre
     * (Vandersanden 2023, ch. 5). */
    LW_VIEWS_CENTRE
};

struct lw_views_desc {
    const struct lw_scene *scene; /* with its cameras' animation */
    const struct lw_trace *trace; /* the scene's, at time 0 */
    enum lw_views_kind kind;
    uint32_t users; /* > 0 */
    /* Distance of users: 0: together (walkers within two seconds of each other); 1: over the whole path or
     * box.
     * The first users are spread as evenly as all of them. */
    float spread;
    uint32_t seed;
    float aspect;
};

struct lw_views;

/** Errors: LW_BAD_DATA for a scene in whose box no place is free; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_views_create(const struct lw_views_desc *desc, struct lw_views **out_views,
                                             struct lw_error *err);
void lw_views_destroy(struct lw_views *views);

struct lw_camera_view lw_views_at(const struct lw_views *views, uint32_t user, uint64_t frame);

/** The same as lw_views_at(); views must outlive it. */
struct lw_renderer_cameras lw_views_cameras(const struct lw_views *views);

/** Whether all cameras stand still. */
bool lw_views_rest(const struct lw_views *views);

/** Whether a place is outside geometry and nothing is nearer than clearance_m, by 32 rays in all
 * directions.
 * seed: turns the rays. */
bool lw_views_is_free(const struct lw_trace *trace, struct lw_vec3 at, float clearance_m, uint32_t seed);

/** A description for people: "a walk along camera \"walk\"". Lives as long as views. */
const char *lw_views_about(const struct lw_views *views);

#endif
