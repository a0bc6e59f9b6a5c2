#include "tests/bench/bench_view.h"

#include "client/paths/camera_default.h"
#include "server/publish/publisher.h"

#include <stdlib.h>
#include <string.h>

enum lw_status bench_view_camera(const char *name, const struct lw_scene *scene, const struct lw_pose *pose,
                                 struct lw_trace *trace, float aspect, struct lw_camera_view *out_camera,
                                 struct lw_error *err) {
    const char *at = strchr(name, '@');
    uint32_t camera = 0;
    if (at && strchr(at, ':')) return lw_camera_parse(at + 1, out_camera, err);
    if (at) {
        enum lw_status status = lw_camera_find(scene, at + 1, &camera, err);
        if (status != LW_OK) return status;
    }
    *out_camera = camera < scene->camera_count ? lw_camera_of_scene(scene, pose, camera)
                                               : lw_camera_default(scene, pose, trace, aspect);
    return LW_OK;
}

/* ---- light ---- */

enum lw_status bench_view_light_init(struct bench_view_light *light, const struct lw_atlas_map *map,
                                     struct lw_error *err) {
    enum lw_status status = LW_OK;
    *light = (struct bench_view_light){.map = map};
    light->levels = calloc((size_t)map->object_count + 1, sizeof *light->levels);
    light->tile_error = calloc((size_t)map->tile_count + 1, sizeof *light->tile_error);
    light->tile_bounces = calloc((size_t)map->tile_count + 1, sizeof *light->tile_bounces);
    if (!light->levels || !light->tile_error || !light->tile_bounces)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the light of tiles");
    for (uint32_t o = 0; status == LW_OK && o < map->object_count; o++)
        status = lw_levels_init(&light->levels[o], LW_TILE_CHANNEL_FULL, map->atlas[o]);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "no memory for the light of tiles");
}

void bench_view_light_finish(struct bench_view_light *light) {
    for (uint32_t o = 0; light->levels && o < light->map->object_count; o++)
        lw_levels_finish(&light->levels[o]);
    free(light->levels);
    free(light->tile_error);
    free(light->tile_bounces);
    *light = (struct bench_view_light){.levels = NULL};
}

void bench_view_light_read(struct bench_view_light *light, const struct lw_solver *solver) {
    const struct lw_atlas_map *map = light->map;
    for (uint32_t o = 0; o < map->object_count; o++) {
        if (!map->atlas[o]->level_count) continue;
        const uint32_t tiles = map->atlas[o]->level[0].tiles_x * map->atlas[o]->level[0].tiles_y;
        for (uint32_t id = map->first_tile[o]; id < map->first_tile[o] + tiles; id++) {
            struct lw_solver_tile solved;
            solver->ops->read_tile(solver, (lw_tile_id){id}, &solved);
            lw_levels_load_tile(&light->levels[o], &map->place[id], &solved);
        }
        lw_levels_build(&light->levels[o]);
    }
    for (uint32_t id = 0; id < map->tile_count; id++)
        light->tile_error[id] = lw_publisher_error(map, solver, (lw_tile_id){id}, &light->tile_bounces[id]);
}

static struct lw_client_level level(const void *context, uint32_t object, uint32_t k) {
    const struct bench_view_light *light = context;
    const struct lw_levels_image *image = &light->levels[object].level[k];
    return (struct lw_client_level){.width = image->width, .height = image->height, .rgb = image->value};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    const struct bench_view_light *light = context;
    return (struct lw_client_tile){
        .version = 1, .error = light->tile_error[id.v], .bounces = light->tile_bounces[id.v]};
}

struct lw_compose_source bench_view_light_source(const struct bench_view_light *light,
                                                 const struct lw_scene *scene, uint32_t bounces) {
    return (struct lw_compose_source){.context = light,
                                      .level = level,
                                      .tile = tile,
                                      .sky = lw_vec3(scene->sky[0], scene->sky[1], scene->sky[2]),
                                      .bounces = bounces};
}
