/* path_world.h: a scene for tracing paths, from frame to frame: pose, structure for rays, lights, tracer.
 * Flow:    scene, time -> [path_world] -> film
 * Threads: one thread at a time; uses several inside. */
#ifndef LW_CLIENT_MEASURE_SIDES_PATH_WORLD_H
#define LW_CLIENT_MEASURE_SIDES_PATH_WORLD_H

#include "client/paths/path_trace.h"

struct lw_path_world {
    const struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_lights lights;
    struct lw_path_trace *tracer;
    uint32_t bounces;
    unsigned threads; /* 0: all */
};

/** At time 0. The scene must outlive it. Zeroed on failure. Errors: LW_NO_MEMORY, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_path_world_init(struct lw_path_world *world, const struct lw_scene *scene,
                                                uint32_t bounces, unsigned threads, struct lw_error *err);
/** A zeroed world is fine. */
void lw_path_world_finish(struct lw_path_world *world);

/** Goes to another moment. Errors: LW_NO_MEMORY, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_path_world_set_time(struct lw_path_world *world, double time_s,
                                                    struct lw_error *err);

/** Adds samples. The view's bounces and pixel are ignored: bounces are the world's, rays go through the
 * centres of pixels. */
void lw_path_world_render(const struct lw_path_world *world, const struct lw_path_view *view,
                          uint32_t samples, struct lw_path_film *film);

#endif
