/* bench_view.h: what benches of views share: the camera of a SCENE@CAMERA, and solved light that a composed
 * view reads without coding it.
 * Flow:    solver -> [bench_view_light: mip levels, tiles' errors] -> lw_compose_render()
 * Threads: main() only. */
#ifndef LW_TESTS_BENCH_VIEW_H
#define LW_TESTS_BENCH_VIEW_H

#include "client/camera/camera.h"
#include "client/view/compose/compose.h"
#include "server/publish/levels.h"
#include "server/solve/solver.h"

/** The camera that a scene's name has behind a '@': numbers as lw_camera_parse() takes them, or a camera's
 * name. Without one the scene's first camera, or the default view.
 * Errors: those of lw_camera_parse() and lw_camera_find(). */
LW_MUST_CHECK enum lw_status bench_view_camera(const char *name, const struct lw_scene *scene,
                                               const struct lw_pose *pose, struct lw_trace *trace,
                                               float aspect, struct lw_camera_view *out_camera,
                                               struct lw_error *err);

/** The light of all tiles, as views read it. */
struct bench_view_light {
    const struct lw_atlas_map *map;
    struct lw_levels *levels; /* per object */
    float *tile_error;
    uint32_t *tile_bounces;
};

/** Errors: LW_NO_MEMORY. Finish it in any case. */
LW_MUST_CHECK enum lw_status bench_view_light_init(struct bench_view_light *light,
                                                   const struct lw_atlas_map *map, struct lw_error *err);
/** A zeroed one is fine. */
void bench_view_light_finish(struct bench_view_light *light);

/** Takes the light that a solver has found. */
void bench_view_light_read(struct bench_view_light *light, const struct lw_solver *solver);

/** A source for lw_compose_render() that reads this light and the scene's sky. light must outlive it. */
struct lw_compose_source bench_view_light_source(const struct bench_view_light *light,
                                                 const struct lw_scene *scene, uint32_t bounces);

#endif
