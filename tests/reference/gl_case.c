#include "tests/reference/gl_case.h"

#include "client/camera/camera.h"
#include "client/measure/figures/flip.h"
#include "client/view/compose/antialias.h"
#include "client/view/tonemap.h"
#include "common/open/scene_open.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MEAN_MAX       (2 / 255.0) /* mean error of pictures as a display shows them */
#define FLIP_MAX       0.03
#define DRAWN_MEAN_MAX (4 / 255.0) /* with shadow maps, against shadow rays */
#define DRAWN_FLIP_MAX 0.06

static struct lw_client_level level(const void *context, uint32_t object, uint32_t k) {
    const struct gl_case_world *w = context;
    const struct lw_atlas_level *l = &w->map.atlas[object]->level[k];
    const size_t at = object * LW_ATLAS_LEVELS_MAX + k;
    return (struct lw_client_level){.width = l->width,
                                    .height = l->height,
                                    .rgb = w->rgb[at],
                                    .direction = w->direction ? w->direction[at] : NULL};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    return ((const struct gl_case_world *)context)->tile[id.v];
}

/* Waves of light of about 5 W/m^2 x `scale`, which differ from object to object, and by
 * `tint` from level to level. */
static void fill(struct gl_case_world *w, uint32_t o, uint32_t k, float tint, float scale) {
    const struct lw_atlas_level *l = &w->map.atlas[o]->level[k];
    float *rgb = calloc((size_t)l->width * l->height * 3, sizeof *rgb);
    assert_non_null(rgb);
    w->rgb[o * LW_ATLAS_LEVELS_MAX + k] = rgb;
    for (uint32_t y = 0; y < l->height; y++)
        for (uint32_t x = 0; x < l->width; x++, rgb += 3) {
            const float u = ((float)x + 0.5f) * (float)(1u << k), v = ((float)y + 0.5f) * (float)(1u << k);
            const float wave = 1.2f + sinf(0.15f * u + (float)o) * cosf(0.11f * v);
            rgb[0] = scale * 4 * wave, rgb[1] = scale * 5 * wave / (1 + tint * (float)k),
            rgb[2] = scale * (6 - 2 * wave);
        }
}

/* Scenes that several tests look at and none changes: to import one takes longer than to draw it. The small
 * one is dense, so that its atlases have levels. */
static struct opened {
    char name[512];
    struct lw_scene *scene;
} opened[8];

struct lw_scene *gl_case_open_scene(const char *name) {
    struct lw_error err = {0};
    struct opened *o = opened;
    const bool is_small = strcmp(name, "builtin:cornell") == 0;
    while (o->scene && strcmp(o->name, name) != 0) o++;
    assert_true(o < opened + sizeof opened / sizeof *opened - 1);
    if (o->scene) return o->scene;
    snprintf(o->name, sizeof o->name, "%s", name);
    lw_support_ok(lw_scene_open(&(struct lw_scene_open){.path = name,
                                                        .texels_per_metre = is_small ? 40 : 2,
                                                        .sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG},
                                &o->scene, &err),
                  &err);
    return o->scene;
}

static bool is_opened(const struct lw_scene *scene) {
    for (size_t i = 0; i < sizeof opened / sizeof *opened; i++)
        if (opened[i].scene == scene) return true;
    return false;
}

int gl_case_close_scenes(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof opened / sizeof *opened; i++) lw_scene_destroy(opened[i].scene);
    return 0;
}

static void start_renderer(struct gl_case_world *w) {
    struct lw_error err = {0};
    if (lw_gl_offscreen_create(&w->offscreen, &err) != LW_OK) {
        print_message("no OpenGL here, so it is not tested: %s\n", err.text);
        skip();
    }
    lw_support_ok(lw_gl_renderer_create(&(struct lw_gl_renderer_desc){.scene = w->scene,
                                                                      .map = &w->map,
                                                                      .exact = true,
                                                                      .drawn = &w->drawn,
                                                                      .trace = w->trace,
                                                                      .pose = &w->pose},
                                        &w->renderer, &err),
                  &err);
}

void gl_case_start(struct gl_case_world *w, struct lw_scene *scene, float tint, float scale) {
    struct lw_error err = {0};
    *w = (struct gl_case_world){.scene = scene};
    lw_support_ok(lw_pose_init(&w->pose, scene), NULL);
    lw_support_ok(lw_atlas_map_init(&w->map, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &w->pose, &w->trace, &err), &err);
    w->rgb = calloc((size_t)scene->object_count * LW_ATLAS_LEVELS_MAX, sizeof *w->rgb);
    w->tile = calloc(w->map.tile_count + 1ul, sizeof *w->tile);
    w->by_cpu = calloc((size_t)PIXELS * 3, sizeof *w->by_cpu);
    w->by_gl = calloc((size_t)PIXELS * 3, sizeof *w->by_gl);
    assert_true(w->rgb && w->tile && w->by_cpu && w->by_gl);
    for (uint32_t o = 0; o < scene->object_count; o++)
        for (uint32_t k = 0; k < w->map.atlas[o]->level_count; k++) fill(w, o, k, tint, scale);
    for (uint32_t t = 0; t < w->map.tile_count; t++) w->tile[t] = (struct lw_client_tile){.version = 1};
    const float *sky = scene->sky;
    w->source = (struct lw_compose_source){
        .context = w, .level = level, .tile = tile, .sky = lw_vec3(sky[0], sky[1], sky[2]), .noise_shown = 1};
    w->view = (struct lw_compose_view){.width = WIDTH, .height = HEIGHT};
    if (scene->camera_count > 0) w->view.camera = lw_camera_of_scene(scene, &w->pose, 0);
    lw_support_ok(
        lw_compose_create(&(struct lw_compose_desc){.scene = scene, .map = &w->map, .trace = w->trace},
                          &w->compose, &err),
        &err);
    start_renderer(w);
}

static void finish_renderer(struct gl_case_world *w) {
    lw_gl_renderer_destroy(w->renderer);
    lw_gl_offscreen_destroy(w->offscreen);
}

void gl_case_world_finish(struct gl_case_world *w) {
    finish_renderer(w);
    lw_compose_destroy(w->compose);
    lw_client_lights_finish(&w->drawn);
    for (uint32_t i = 0; i < w->scene->object_count * LW_ATLAS_LEVELS_MAX; i++) free(w->rgb[i]);
    for (uint32_t i = 0; w->direction && i < w->scene->object_count * LW_ATLAS_LEVELS_MAX; i++)
        free(w->direction[i]);
    free(w->direction);
    free(w->rgb);
    free(w->tile);
    free(w->by_cpu);
    free(w->by_gl);
    lw_trace_destroy(w->trace);
    lw_atlas_map_finish(&w->map);
    lw_pose_finish(&w->pose);
    if (!is_opened(w->scene)) lw_scene_destroy(w->scene);
}

void gl_case_draw(struct gl_case_world *w) {
    struct lw_error err = {0};
    struct lw_antialias antialias = {0};
    struct lw_compose_report report;
    lw_support_ok(lw_antialias_reserve(&antialias, PIXELS, &err), &err);
    lw_antialias_render(&antialias, w->compose, &w->source, &w->pose, &w->view, SAMPLES, w->by_cpu, &report);
    lw_support_ok(lw_gl_renderer_take(w->renderer, &w->source, &w->pose, 0, 0, NULL, &err), &err);
    memset(w->by_gl, 0, sizeof(float) * 3 * PIXELS);
    for (uint32_t i = 0; i < SAMPLES; i++) {
        struct lw_compose_view view = w->view;
        lw_antialias_offset(i, SAMPLES, &view.offset_x, &view.offset_y);
        lw_support_ok(lw_gl_renderer_draw(w->renderer, &view, 1, &err), &err);
        lw_support_ok(lw_gl_renderer_read(w->renderer, antialias.sample, &err), &err);
        for (size_t k = 0; k < (size_t)3 * PIXELS; k++) w->by_gl[k] += antialias.sample[k] / SAMPLES;
    }
    lw_antialias_finish(&antialias);
}

void gl_case_take_and_draw(struct gl_case_world *w, unsigned samples) {
    struct lw_error err = {0};
    lw_support_ok(lw_gl_renderer_take(w->renderer, &w->source, &w->pose, 0, 0, NULL, &err), &err);
    lw_support_ok(lw_gl_renderer_draw(w->renderer, &w->view, samples, &err), &err);
}

/* As a display shows them. */
static void develop(const float *rgb, float stops, float *out) {
    const float scale = exp2f(stops);
    for (size_t i = 0; i < PIXELS; i++) {
        const struct lw_vec3 c = lw_tonemap_apply(
            LW_TONEMAP_REINHARD, lw_vec3(scale * rgb[3 * i], scale * rgb[3 * i + 1], scale * rgb[3 * i + 2]));
        out[3 * i] = c.x, out[3 * i + 1] = c.y, out[3 * i + 2] = c.z;
    }
}

static uint8_t coded(float linear) {
    return (uint8_t)(255 *
                         (linear <= 0.0031308f ? 12.92f * linear : 1.055f * powf(linear, 1 / 2.4f) - 0.055f) +
                     0.5f);
}

void gl_case_compare(const char *name, struct gl_case_world *w) {
    struct lw_error err = {0};
    const float stops = lw_tonemap_auto_stops(w->by_cpu, PIXELS);
    float *shown = malloc(sizeof(float) * 6 * PIXELS), *map = malloc(sizeof(float) * PIXELS);
    assert_true(shown && map);
    develop(w->by_cpu, stops, shown);
    develop(w->by_gl, stops, shown + 3ul * PIXELS);
    double sum = 0;
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++)
        sum += abs(coded(shown[i]) - coded(shown[i + 3ul * PIXELS]));
    lw_support_ok(
        lw_flip_map(shown, shown + 3ul * PIXELS, WIDTH, HEIGHT, LW_FLIP_PIXELS_PER_DEGREE, map, &err), &err);
    const double mean = sum / (255.0 * 3 * PIXELS), flip = lw_flip_mean(map, NULL, PIXELS);
    print_message("%s: mean difference %.2f / 255, FLIP %.4f\n", name, mean * 255, flip);
    free(map);
    free(shown);
    const bool drawn = lw_client_lights_any(&w->drawn);
    assert_true(mean <= (drawn ? DRAWN_MEAN_MAX : MEAN_MAX));
    assert_true(flip <= (drawn ? DRAWN_FLIP_MAX : FLIP_MAX));
}

void gl_case_start_lit(struct gl_case_world *w, struct lw_scene *scene, float tint, float scale,
                       const char *lights) {
    struct lw_error err = {0};
    gl_case_start(w, scene, tint, scale);
    lw_support_ok(lw_client_lights_init(&w->drawn, w->scene, &w->pose, lights, &err), &err);
    lw_compose_destroy(w->compose);
    lw_support_ok(
        lw_compose_create(
            &(struct lw_compose_desc){
                .scene = w->scene, .map = &w->map, .trace = w->trace, .drawn = &w->drawn, .pose = &w->pose},
            &w->compose, &err),
        &err);
    finish_renderer(w);
    start_renderer(w);
}

void gl_case_start_drawn(struct gl_case_world *w, const char *name, float scale) {
    gl_case_start_lit(w, gl_case_open_scene(name), 0, scale, "auto");
}
