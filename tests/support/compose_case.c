#include "tests/support/compose_case.h"

#include <math.h>
#include <stdlib.h>

static struct lw_client_level world_level(const void *context, uint32_t object, uint32_t level) {
    const struct compose_case_world *w = context;
    if (level >= w->map.atlas[object]->level_count) return (struct lw_client_level){0};
    const struct lw_atlas_level *l = &w->map.atlas[object]->level[level];
    return (struct lw_client_level){
        .width = l->width, .height = l->height, .rgb = w->rgb[object * LW_ATLAS_LEVELS_MAX + level]};
}

static struct lw_client_tile world_tile(const void *context, lw_tile_id tile) {
    return ((const struct compose_case_world *)context)->tile[tile.v];
}

struct lw_scene *compose_case_squares(unsigned count, uint32_t texels, bool double_sided) {
    struct lw_scene *scene = lw_support_squares(count, SIDE_M);
    struct lw_mesh *mesh = &scene->mesh[0];
    struct lw_vec2 *uv = lw_scene_alloc(scene, 4, sizeof *uv);
    for (int i = 0; i < 4; i++)
        uv[i] = (struct lw_vec2){mesh->uv[0][i].x * (float)texels, mesh->uv[0][i].y * (float)texels};
    mesh->lightmap_uv = uv;
    mesh->atlas_width = texels;
    mesh->atlas_height = double_sided ? 2 * texels : texels;
    mesh->back_offset = double_sided ? texels : 0;
    scene->material[0].double_sided = double_sided;
    return scene;
}

void compose_case_make_compose(struct compose_case_world *w, unsigned threads) {
    struct lw_error err = {0};
    lw_compose_destroy(w->compose);
    lw_support_ok(lw_compose_create(
                      &(struct lw_compose_desc){
                          .scene = w->scene, .map = &w->map, .trace = w->trace, .threads = threads},
                      &w->compose, &err),
                  &err);
}

void compose_case_world_init_finer(struct compose_case_world *w, struct lw_scene *scene, uint32_t finer) {
    struct lw_error err = {0};
    *w = (struct compose_case_world){.scene = scene};
    lw_support_ok(lw_pose_init(&w->pose, scene), NULL);
    lw_support_ok(lw_atlas_map_init_finer(&w->map, scene, finer, finer ? 64 : 0), NULL);
    lw_support_ok(lw_trace_create(scene, &w->pose, &w->trace, &err), &err);
    w->rgb = calloc((size_t)scene->object_count * LW_ATLAS_LEVELS_MAX, sizeof *w->rgb);
    w->tile = calloc(w->map.tile_count, sizeof *w->tile);
    assert_true(w->rgb && w->tile);
    for (uint32_t o = 0; o < scene->object_count; o++)
        for (uint32_t k = 0; k < w->map.atlas[o]->level_count; k++) {
            const struct lw_atlas_level *l = &w->map.atlas[o]->level[k];
            w->rgb[o * LW_ATLAS_LEVELS_MAX + k] = calloc((size_t)l->width * l->height * 3, sizeof(float));
            assert_non_null(w->rgb[o * LW_ATLAS_LEVELS_MAX + k]);
        }
    for (uint32_t t = 0; t < w->map.plain_count; t++)
        w->tile[t] = (struct lw_client_tile){.version = 1, .bounces = BOUNCES, .error = 0.01f};
    w->source = (struct lw_compose_source){.context = w,
                                           .level = world_level,
                                           .tile = world_tile,
                                           .sky = {0.25f, 0.5f, 1.0f},
                                           .bounces = BOUNCES,
                                           .target_error = 0.02f,
                                           .noise_shown = 1};
    compose_case_make_compose(w, 1);
}

void compose_case_world_init(struct compose_case_world *w, struct lw_scene *scene) {
    compose_case_world_init_finer(w, scene, 0);
}

void compose_case_world_finish(struct compose_case_world *w) {
    lw_compose_destroy(w->compose);
    for (uint32_t i = 0; i < w->scene->object_count * LW_ATLAS_LEVELS_MAX; i++) free(w->rgb[i]);
    free(w->rgb);
    free(w->tile);
    lw_trace_destroy(w->trace);
    lw_atlas_map_finish(&w->map);
    lw_pose_finish(&w->pose);
    lw_scene_destroy(w->scene);
}

void compose_case_fill_level(struct compose_case_world *w, uint32_t object, uint32_t k, float value) {
    const struct lw_atlas_level *l = &w->map.atlas[object]->level[k];
    for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++)
        w->rgb[object * LW_ATLAS_LEVELS_MAX + k][i] = value;
}

void compose_case_fill_by_level(struct compose_case_world *w, uint32_t object, float first) {
    for (uint32_t k = 0; k < w->map.atlas[object]->level_count; k++)
        compose_case_fill_level(w, object, k, first + (float)k);
}

void compose_case_fill_constant(struct compose_case_world *w, uint32_t object, float value) {
    for (uint32_t k = 0; k < w->map.atlas[object]->level_count; k++)
        compose_case_fill_level(w, object, k, value);
}

struct lw_compose_view compose_case_view_towards(float from_x, float from_y, float from_z, float to_x,
                                                 float to_y, float to_z, float fov_deg) {
    return (struct lw_compose_view){.camera =
                                        lw_camera_look_at(lw_vec3(from_x, from_y, from_z),
                                                          lw_vec3(to_x, to_y, to_z), fov_deg / 180 * LW_PI),
                                    .width = WIDTH,
                                    .height = HEIGHT};
}

struct lw_compose_view compose_case_view_down(void) {
    return compose_case_view_towards(0, 1, 0, 0, 0, 0, 40);
}

struct lw_compose_report compose_case_render(struct compose_case_world *w, const struct lw_compose_view *view,
                                             float *rgb) {
    struct lw_compose_report report;
    for (size_t i = 0; i < (size_t)view->width * view->height * 3; i++) rgb[i] = NAN;
    lw_compose_render(w->compose, &w->source, &w->pose, view, rgb, &report);
    for (size_t i = 0; i < (size_t)view->width * view->height * 3; i++)
        assert_true(isfinite(rgb[i]) && rgb[i] >= 0);
    return report;
}

void compose_case_assert_near(float value, float expected, float relative) {
    if (!(fabsf(value - expected) <= relative * fabsf(expected)))
        fail_msg("%.9g is not %.9g", (double)value, (double)expected);
}

void compose_case_fill_ramps(struct compose_case_world *w) {
    for (uint32_t k = 0; k < w->map.atlas[0]->level_count; k++) {
        const struct lw_atlas_level *l = &w->map.atlas[0]->level[k];
        for (uint32_t y = 0; y < l->height; y++)
            for (uint32_t x = 0; x < l->width; x++) {
                float *e = w->rgb[k] + 3 * ((size_t)y * l->width + x);
                e[0] = ((float)x + 0.5f) * (float)(1u << k);
                e[1] = ((float)y + 0.5f) * (float)(1u << k);
                e[2] = e[0] + e[1];
            }
    }
}

uint32_t compose_case_tile_at(const struct compose_case_world *w, uint32_t level, uint32_t x, uint32_t y) {
    return lw_atlas_map_find(&w->map, 0, level, x, y).v;
}
