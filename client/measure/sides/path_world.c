#include "client/measure/sides/path_world.h"

enum lw_status lw_path_world_init(struct lw_path_world *world, const struct lw_scene *scene, uint32_t bounces,
                                  unsigned threads, struct lw_error *err) {
    *world = (struct lw_path_world){.scene = scene, .bounces = bounces, .threads = threads};
    enum lw_status status = lw_pose_init(&world->pose, scene);
    if (status == LW_OK) status = lw_trace_create(scene, &world->pose, &world->trace, err);
    if (status == LW_OK) status = lw_lights_init(&world->lights, scene, &world->pose);
    if (status == LW_OK)
        status = lw_path_trace_create(&(struct lw_path_trace_desc){.scene = scene,
                                                                   .trace = world->trace,
                                                                   .lights = &world->lights,
                                                                   .pose = &world->pose,
                                                                   .threads = threads},
                                      &world->tracer, err);
    if (status == LW_OK) return LW_OK;
    lw_path_world_finish(world);
    return lw_status_fail(err, status, "cannot set up the path tracer: %s", lw_status_text(status));
}

void lw_path_world_finish(struct lw_path_world *world) {
    lw_path_trace_destroy(world->tracer);
    lw_lights_finish(&world->lights);
    lw_trace_destroy(world->trace);
    lw_pose_finish(&world->pose);
    *world = (struct lw_path_world){0};
}

enum lw_status lw_path_world_set_time(struct lw_path_world *world, double time_s, struct lw_error *err) {
    lw_pose_evaluate(&world->pose, world->scene, time_s);
    enum lw_status status = lw_trace_set_pose(world->trace, &world->pose, err);
    if (status != LW_OK) return status;
    lw_lights_set_pose(&world->lights, &world->pose);
    lw_path_trace_set_pose(world->tracer, &world->pose);
    return LW_OK;
}

void lw_path_world_render(const struct lw_path_world *world, const struct lw_path_view *view,
                          uint32_t samples, struct lw_path_film *film) {
    struct lw_path_view centred = *view;
    centred.bounces = world->bounces;
    centred.pixel = LW_PATH_PIXEL_CENTRE;
    lw_path_trace_render(world->tracer, &centred, samples, film, NULL);
}
