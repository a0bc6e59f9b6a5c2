/* The picture by OpenGL against the composer's, from the same light. */
#include "tests/support/process.h"

#include "client/camera/camera.h"
#include "client/gl/gl_offscreen.h"
#include "client/gl/gl_renderer.h"
#include "client/gl/gl_rgb9e5.h"
#include "client/measure/figures/flip.h"
#include "client/view/compose/antialias.h"
#include "client/view/tonemap.h"
#include "common/base/random.h"
#include "common/light/direction_form.h"
#include "common/open/scene_open.h"
#include "common/shading/tangent.h"

#include <epoxy/gl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 192, HEIGHT = 108, PIXELS = WIDTH * HEIGHT, SAMPLES = 4 };

#define MEAN_MAX       (2 / 255.0) /* mean error of pictures as a display shows them */
#define FLIP_MAX       0.03
#define DRAWN_MEAN_MAX (4 / 255.0) /* with shadow maps, against shadow rays */
#define DRAWN_FLIP_MAX 0.06

struct world {
    struct lw_gl_offscreen *offscreen; /* NULL: there is no OpenGL here */
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct lw_gl_renderer *renderer;
    struct lw_compose_source source;
    struct lw_compose_view view;
    struct lw_client_lights drawn; /* zeroed: all light is in tiles */
    float **rgb;                   /* object * LW_ATLAS_LEVELS_MAX + level */
    float **direction;             /* the same of where light comes from; NULL: not known */
    struct lw_client_tile *tile;
    float *by_cpu, *by_gl;
};

static struct lw_client_level level(const void *context, uint32_t object, uint32_t k) {
    const struct world *w = context;
    const struct lw_atlas_level *l = &w->map.atlas[object]->level[k];
    const size_t at = object * LW_ATLAS_LEVELS_MAX + k;
    return (struct lw_client_level){.width = l->width,
                                    .height = l->height,
                                    .rgb = w->rgb[at],
                                    .direction = w->direction ? w->direction[at] : NULL};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    return ((const struct world *)context)->tile[id.v];
}

/* Waves of light of about 5 W/m^2 x `scale`, which differ from object to object, and by
 * `tint` from level to level. */
static void fill(struct world *w, uint32_t o, uint32_t k, float tint, float scale) {
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

/* Light comes mostly from one side, here more and there less; on some texels that is not known. */
static void fill_directions(struct world *w) {
    w->direction = calloc((size_t)w->scene->object_count * LW_ATLAS_LEVELS_MAX, sizeof *w->direction);
    assert_non_null(w->direction);
    for (uint32_t o = 0; o < w->scene->object_count; o++)
        for (uint32_t k = 0; k < w->map.atlas[o]->level_count; k++) {
            const struct lw_atlas_level *l = &w->map.atlas[o]->level[k];
            float *xyz = calloc((size_t)l->width * l->height * 3, sizeof *xyz);
            assert_non_null(xyz);
            w->direction[o * LW_ATLAS_LEVELS_MAX + k] = xyz;
            for (uint32_t y = 0; o % 4 && y < l->height; y++)
                for (uint32_t x = 0; x < l->width; x++) {
                    const float turn = 0.1f * ((float)x + 0.5f) * (float)(1u << k) + (float)o;
                    float *at = xyz + 3 * ((size_t)y * l->width + x);
                    at[0] = 0.5f * cosf(turn), at[1] = 0.7f, at[2] = 0.5f * sinf(turn);
                }
        }
    for (uint32_t t = 0; t < w->map.tile_count; t++) w->tile[t].direction_version = 1;
}

/* Scenes that several tests look at and none changes: to import one takes longer than to draw it. The small
 * one is dense, so that its atlases have levels. */
static struct opened {
    char name[512];
    struct lw_scene *scene;
} opened[8];

static struct lw_scene *open_scene(const char *name) {
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

static int close_scenes(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof opened / sizeof *opened; i++) lw_scene_destroy(opened[i].scene);
    return 0;
}

static void start_renderer(struct world *w) {
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

static void start(struct world *w, struct lw_scene *scene, float tint, float scale) {
    struct lw_error err = {0};
    *w = (struct world){.scene = scene};
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

static void finish_renderer(struct world *w) {
    lw_gl_renderer_destroy(w->renderer);
    lw_gl_offscreen_destroy(w->offscreen);
}

static void world_finish(struct world *w) {
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

/* Both pictures, the mean of SAMPLES each. */
static void draw(struct world *w) {
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

static void take_and_draw(struct world *w, unsigned samples) {
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

static void compare(const char *name, struct world *w) {
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

/* The scene from a camera, or its own, with levels that can be told apart. */
static void test_same_picture(const char *name, const char *camera) {
    struct world w;
    struct lw_error err = {0};
    start(&w, open_scene(name), 0.5f, 1);
    if (camera) lw_support_ok(lw_camera_parse(camera, &w.view.camera, &err), &err);
    draw(&w);
    compare(name, &w);
    world_finish(&w);
}

/* With lights that the client draws, beside as much other light as there may be with them. */
static void start_lit(struct world *w, struct lw_scene *scene, float tint, float scale, const char *lights) {
    struct lw_error err = {0};
    start(w, scene, tint, scale);
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

static void start_drawn(struct world *w, const char *name, float scale) {
    start_lit(w, open_scene(name), 0, scale, "auto");
}

static void test_drawn(const char *name, const char *camera, float scale) {
    struct world w;
    struct lw_error err = {0};
    start_drawn(&w, name, scale);
    if (camera) lw_support_ok(lw_camera_parse(camera, &w.view.camera, &err), &err);
    draw(&w);
    compare(name, &w);
    const uint64_t maps = lw_gl_renderer_figures(w.renderer).maps_drawn;
    take_and_draw(&w, 1); /* nothing has moved */
    assert_int_equal(lw_gl_renderer_figures(w.renderer).maps_drawn, maps);
    assert_true(maps > 0);
    world_finish(&w);
}

static void test_drawn_atrium(void **state) {
    (void)state;
    test_drawn(lw_process_atrium(), NULL, 1);
}

static void test_drawn_cornell(void **state) {
    (void)state;
    test_drawn("builtin:cornell", NULL, 0.02f);
    test_drawn("builtin:cornell", "0.3,1.2,3.4:0,0.8,0:2.6m", 0.02f);
}

static void test_drawn_sponza(void **state) {
    (void)state;
    test_drawn(lw_support_scene("sponza/Sponza_lit.gltf"), "-8,1.8,-0.3:5,4,-0.3:75", 500);
}

static void test_atrium(void **state) {
    (void)state;
    test_same_picture(lw_process_atrium(), NULL);
}

/* Light that is noisy here and lacks there; of every object the coarsest level has arrived. */
static void test_part_of_the_light(void **state) {
    (void)state;
    struct world w;
    uint32_t lacking = 0;
    start(&w, open_scene("builtin:cornell"), 0.5f, 1);
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        const struct lw_tile_place *p = &w.map.place[t];
        const uint32_t number = t * 2654435761u >> 16;
        w.tile[t].error = (float)(number % 5) * 0.08f;
        w.tile[t].version = 1 + (number % 7 != 0);
        if (number % 3 == 0 && p->level + 1 < w.map.atlas[p->object]->level_count)
            w.tile[t].version = 0, lacking++;
    }
    print_message("%u of %u tiles lack\n", lacking, w.map.tile_count);
    assert_true(lacking > w.map.tile_count / 5);
    draw(&w);
    compare("builtin:cornell, part of the light", &w);
    world_finish(&w);
}

static void test_cornell(void **state) {
    (void)state;
    test_same_picture("builtin:cornell", NULL);
    test_same_picture("builtin:cornell", "0.3,1.2,3.4:0,0.8,0:2.6m");
}

enum { REPEATED, MASKED, BLENDED, BACK, AWAY, MIRRORED, GLOWING, COLOURED, GLASS, UNLIT, TINTED, PANELS };

/* A square of each kind, facing up, three in a row; glass, an unlit and a tinted one hang over others. */
static struct lw_scene *panels(void) {
    struct lw_scene *scene = lw_support_squares(PANELS, 1);
    const struct lw_mesh mesh = scene->mesh[0];
    const struct lw_material material = scene->material[0];
    scene->mesh = lw_scene_alloc(scene, PANELS, sizeof *scene->mesh);
    scene->material = lw_scene_alloc(scene, PANELS, sizeof *scene->material);
    scene->texture = lw_scene_alloc(scene, 2, sizeof *scene->texture);
    scene->mesh_count = scene->material_count = PANELS;
    scene->texture_count = 2;
    uint8_t *rgba = lw_scene_alloc(scene, 16 * 16, 4);
    struct lw_vec2 *uv = lw_scene_alloc(scene, 4, sizeof *uv);
    struct lw_vec4 *colour = lw_scene_alloc(scene, 4, sizeof *colour);
    for (uint32_t i = 0; i < 16 * 16; i++) {
        const uint8_t texel[4] = {(uint8_t)(40 + 13 * (i % 16)), (uint8_t)(250 - 12 * (i / 16)),
                                  (uint8_t)(i % 16 > 7 ? 200 : 60), (uint8_t)(16 * (i % 16) + i / 16)};
        memcpy(rgba + 4ul * i, texel, 4);
    }
    for (int i = 0; i < 4; i++) {
        uv[i] = (struct lw_vec2){2.5f * mesh.uv[0][i].x - 0.5f, 1.5f * mesh.uv[0][i].y - 0.3f};
        colour[i] = (struct lw_vec4){i & 1 ? 1 : 0.2f, i & 2 ? 0.9f : 0.3f, 0.6f, 1};
    }
    for (uint32_t t = 0; t < 2; t++)
        scene->texture[t] = (struct lw_texture){.name = "",
                                                .width = 16,
                                                .height = 16,
                                                .rgba = rgba,
                                                .wrap_s = t ? LW_WRAP_CLAMP : LW_WRAP_REPEAT,
                                                .wrap_t = t ? LW_WRAP_MIRROR : LW_WRAP_REPEAT};
    for (uint32_t i = 0; i < PANELS; i++) {
        uint32_t *materials = lw_scene_alloc(scene, 2, sizeof *materials);
        materials[0] = materials[1] = i;
        scene->mesh[i] = mesh;
        scene->mesh[i].material = materials;
        scene->mesh[i].uv[1] = uv;
        scene->material[i] = material;
        scene->object[i].mesh = i;
        scene->node[i].translation[0] = 1.1f * (float)(i % 3) - 1.1f;
        scene->node[i].translation[2] = 1.1f * (float)(i / 3) - 1.1f;
    }
    struct lw_material *m = scene->material;
    static const float turned[6] = {1.6f, -1.2f, 0.3f, 1.2f, 1.6f, -0.7f};
    m[REPEATED].base_colour_texture.texture = 0;
    memcpy(m[REPEATED].base_colour_texture.transform, turned, sizeof turned);
    m[MASKED].base_colour_texture.texture = 0, m[MASKED].alpha_mode = LW_ALPHA_MASK;
    m[BLENDED].base_colour_texture.texture = 1, m[BLENDED].alpha_mode = LW_ALPHA_BLEND;
    m[BLENDED].base_colour_texture.uv_set = 1;
    m[BACK].double_sided = 1;
    m[GLOWING].emission_texture.texture = 1, m[GLOWING].emission_texture.uv_set = 1;
    for (int c = 0; c < 3; c++) m[GLOWING].emission[c] = 2;
    scene->mesh[COLOURED].colour = colour;
    m[GLASS].alpha_mode = LW_ALPHA_BLEND, m[GLASS].base_colour[3] = 0.4f;
    scene->node[BACK].scale[1] = scene->node[BACK].scale[0] = -1; /* half a turn about Z */
    scene->node[AWAY].scale[1] = scene->node[AWAY].scale[0] = -1;
    scene->node[MIRRORED].scale[0] = -1;
    scene->node[GLASS].translation[0] = 0.6f, scene->node[GLASS].translation[1] = 0.4f;
    scene->node[GLASS].translation[2] = -0.9f;
    m[UNLIT].unlit = 1, m[UNLIT].base_colour_texture.texture = 0;
    scene->mesh[UNLIT].colour = colour;
    scene->node[UNLIT].translation[0] = -0.8f, scene->node[UNLIT].translation[1] = 0.4f;
    scene->node[UNLIT].translation[2] = -0.9f;
    m[TINTED].alpha_mode = LW_ALPHA_BLEND, m[TINTED].base_colour[3] = 0.2f;
    m[TINTED].tint[0] = 0.5f, m[TINTED].tint[1] = 1.2f, m[TINTED].tint[2] = 0.1f;
    scene->node[TINTED].translation[0] = -1.2f, scene->node[TINTED].translation[1] = 0.5f;
    scene->node[TINTED].translation[2] = 0.6f;
    scene->sky[0] = 0.2f, scene->sky[2] = 0.5f;
    return scene;
}

static void test_panels(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    struct lw_scene *scene = panels();
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err),
                  &err);
    start(&w, scene, 0.5f, 1);
    w.view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
    draw(&w);
    compare("panels", &w);
    const float *centre =
        w.by_gl + 3ul * (PIXELS / 2 + WIDTH / 2); /* a back that is not there: the sky is seen */
    assert_true(fabsf(centre[0] - 0.2f) < 1e-4f && centre[1] < 1e-4f);
    const struct lw_camera_view perspective = w.view.camera;
    w.view.camera.height_m = 3.5f;
    draw(&w);
    compare("panels, orthographic", &w);
    w.view.camera = perspective;
    w.pose.object_hidden[REPEATED] = true; /* things that change */
    w.pose.object_to_world[COLOURED].m[1][3] = 0.3f;
    w.pose.object_dynamic[REPEATED] = w.pose.object_dynamic[COLOURED] = true;
    scene->material[MIRRORED].base_colour[0] = 0.9f;
    scene->material[COLOURED].emission[1] = 3;
    lw_support_ok(lw_trace_set_pose(w.trace, &w.pose, &err), &err);
    draw(&w);
    compare("panels, changed", &w);
    world_finish(&w);
}

/* A finish map: waves of normals, or of roughness, metalness and occlusion, or of colours. */
static void add_map(struct lw_scene *scene, uint32_t at, uint8_t content) {
    enum { SIDE = 32 };
    uint8_t *rgba = lw_scene_alloc(scene, (size_t)SIDE * SIDE, 4);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        const float u = 2 * LW_PI * (float)(i % SIDE) / SIDE, v = 2 * LW_PI * (float)(i / SIDE) / SIDE;
        const uint8_t texel[4] = {(uint8_t)(127.5f + 60 * sinf(u)), (uint8_t)(127.5f + 60 * sinf(2 * v)),
                                  (uint8_t)(127.5f + 120 * cosf(u + v)), (uint8_t)(200 + 50 * sinf(v))};
        memcpy(rgba + 4ul * i, texel, 4);
    }
    scene->finish_texture[at] = (struct lw_texture){.name = "",
                                                    .width = SIDE,
                                                    .height = SIDE,
                                                    .rgba = rgba,
                                                    .content = content,
                                                    .wrap_t = LW_WRAP_MIRROR};
}

static const struct lw_finish plain_finish = {.roughness = 0.3f,
                                              .specular = 1,
                                              .specular_colour = {1, 1, 1},
                                              .ior = 1.5f,
                                              .occlusion = 1,
                                              .normal_scale = 1,
                                              .surface_texture = {.texture = LW_SCENE_NONE},
                                              .specular_texture = {.texture = LW_SCENE_NONE},
                                              .occlusion_texture = {.texture = LW_SCENE_NONE},
                                              .normal_texture = {.texture = LW_SCENE_NONE}};

static void use_map(struct lw_texture_use *use, uint32_t map, uint32_t set, float times) {
    const float turned[6] = {times, 0.3f, 0.1f, -0.2f, times, 0.4f};
    *use = (struct lw_texture_use){.texture = map, .uv_set = set};
    memcpy(use->transform, turned, sizeof turned);
}

/* A ball of triangles in place of a mesh's square, with smooth normals. */
static void make_round(struct lw_scene *scene, struct lw_mesh *mesh) {
    enum { ROWS = 16, COLUMNS = 32, COUNT = (ROWS + 1) * (COLUMNS + 1) };
    struct lw_vec3 *position = lw_scene_alloc(scene, COUNT, sizeof *position),
                   *normal = lw_scene_alloc(scene, COUNT, sizeof *normal);
    struct lw_vec2 *uv = lw_scene_alloc(scene, COUNT, sizeof *uv);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 2 * ROWS * COLUMNS, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, 2 * ROWS * COLUMNS, sizeof *material), count = 0;
    for (uint32_t i = 0; i < COUNT; i++) {
        const float u = (float)(i % (COLUMNS + 1)) / COLUMNS, v = (float)(i / (COLUMNS + 1)) / ROWS;
        const float phi = 2 * LW_PI * u, sine = sinf(LW_PI * v);
        normal[i] = lw_vec3(sine * cosf(phi), cosf(LW_PI * v), -sine * sinf(phi));
        position[i] = lw_vec3_scale(normal[i], 0.5f);
        uv[i] = (struct lw_vec2){u, v};
    }
    for (uint32_t j = 0; j < ROWS; j++)
        for (uint32_t i = 0; i < COLUMNS; i++) {
            const uint32_t a = j * (COLUMNS + 1) + i, b = a + COLUMNS + 1;
            const uint32_t corners[2][3] = {{a, b, b + 1}, {a, b + 1, a + 1}};
            for (uint32_t t = 0; t < 2; t++)
                if (t ? j > 0 : j + 1 < ROWS) {
                    material[count] = mesh->material[0];
                    memcpy(triangle[count++], corners[t], sizeof corners[t]);
                }
        }
    mesh->vertex_count = COUNT, mesh->triangle_count = count;
    mesh->position = position, mesh->normal = normal, mesh->material = material;
    mesh->triangle = (const uint32_t(*)[3])triangle;
    mesh->uv[0] = mesh->uv[1] = uv;
}

/* Tangents along X, or around a ball; every other triangle of a mesh of many mirrored. */
static void add_tangents(struct lw_scene *scene, struct lw_mesh *mesh) {
    uint16_t *tangent = lw_scene_alloc(scene, 3ul * mesh->triangle_count, sizeof *tangent);
    for (uint32_t c = 0; c < 3 * mesh->triangle_count; c++) {
        const struct lw_vec3 n = mesh->normal[mesh->triangle[c / 3][c % 3]];
        const struct lw_vec3 along =
            mesh->triangle_count > 2 ? lw_vec3_cross(lw_vec3(0, 1, 0), n) : lw_vec3(1, 0, 0);
        tangent[c] = lw_tangent_encode(n, along, mesh->triangle_count <= 2 && c / 3 % 2);
    }
    mesh->tangent = tangent;
}

/* The panels with finishes, two of them balls, under a lamp. */
static struct lw_scene *finished_panels(void) {
    struct lw_scene *scene = panels();
    scene->finish_texture = lw_scene_alloc(scene, 3, sizeof *scene->finish_texture);
    scene->finish_texture_count = 3;
    for (uint8_t k = 0; k < 3; k++)
        add_map(scene, k, (uint8_t[]){LW_CONTENT_SURFACE, LW_CONTENT_NORMAL, LW_CONTENT_COLOUR}[k]);
    struct lw_finish *finish = lw_scene_alloc(scene, PANELS, sizeof *finish);
    for (uint32_t i = 0; i < PANELS; i++) {
        finish[i] = plain_finish;
        if (i != UNLIT) scene->material[i].finish = &finish[i];
    }
    make_round(scene, &scene->mesh[MIRRORED]);
    make_round(scene, &scene->mesh[GLOWING]);
    for (uint32_t i = 0; i < PANELS; i++) add_tangents(scene, &scene->mesh[i]);
    use_map(&finish[REPEATED].surface_texture, 0, 0, 2), use_map(&finish[REPEATED].normal_texture, 1, 0, 2);
    use_map(&scene->material[REPEATED].base_colour_texture, /* where its finish is read, too */
            scene->material[REPEATED].base_colour_texture.texture, 0, 2);
    finish[REPEATED].occlusion_texture = finish[REPEATED].surface_texture;
    finish[REPEATED].roughness = 0.8f;
    finish[MASKED].metalness = 1, finish[MASKED].roughness = 0.1f;
    use_map(&finish[BLENDED].specular_texture, 2, 1, 1), use_map(&finish[BLENDED].occlusion_texture, 0, 0, 1);
    finish[BACK].metalness = 0.7f;
    use_map(&finish[BACK].normal_texture, 1, 1, 2), finish[BACK].normal_scale = -0.7f;
    use_map(&finish[BACK].surface_texture, 0, 1, 1);
    use_map(&finish[MIRRORED].normal_texture, 1, 0, 4);
    use_map(&finish[GLOWING].surface_texture, 0, 0, 3), use_map(&finish[GLOWING].normal_texture, 1, 0, 3);
    finish[GLOWING].metalness = 1, finish[GLOWING].roughness = 0.6f;
    use_map(&finish[COLOURED].normal_texture, 1, 1, 2);
    finish[COLOURED].roughness = 1, finish[COLOURED].specular = 0; /* matt, but for its relief */
    finish[TINTED].roughness = 0.05f;
    for (int c = 0; c < 3; c++) {
        scene->material[MASKED].base_colour[c] = 0.9f;
        scene->material[GLOWING].emission[c] = 0.05f;
        scene->light[0].intensity[c] = 20;
    }
    return scene;
}

/* A sky that is bright and blue above, with a glow at one side. */
static void add_environment(struct lw_scene *scene) {
    enum { W = 64, H = 32 };
    float *rgb = lw_scene_alloc(scene, 3ul * W * H, sizeof *rgb);
    for (uint32_t i = 0; i < W * H; i++) {
        const float up = 1 - 2 * ((float)(i / W) + 0.5f) / H, side = cosf(2 * LW_PI * (float)(i % W) / W);
        rgb[3 * i] = up > 0 ? 0.5f + 3 * powf(fmaxf(side, 0), 8) : 0.2f;
        rgb[3 * i + 1] = up > 0 ? 0.6f + up : 0.15f, rgb[3 * i + 2] = up > 0 ? 1 + 2 * up : 0.1f;
    }
    scene->environment = (struct lw_environment){.width = W, .height = H, .rgb = rgb};
}

static void test_finish_picture(const char *name, bool environment, const char *lights) {
    struct world w;
    struct lw_error err = {0};
    struct lw_scene *scene = finished_panels();
    if (environment) add_environment(scene);
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err),
                  &err);
    start_lit(&w, scene, 0.5f, 1, lights);
    w.view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
    draw(&w);
    compare(name, &w);
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++)
        assert_true(w.by_cpu[i] >= 0 && w.by_cpu[i] < INFINITY && w.by_gl[i] >= 0 && w.by_gl[i] < INFINITY);
    for (int show = LW_SHOW_NORMALS; show < LW_SHOW_COUNT; show++) {
        w.view.show = (enum lw_show)show;
        draw(&w);
        compare(lw_show_name((enum lw_show)show), &w);
    }
    world_finish(&w);
}

static void test_finishes(void **state) {
    (void)state;
    test_finish_picture("finishes, light of tiles", true, "none");
    test_finish_picture("finishes, even sky, light of tiles", false, "none");
    test_finish_picture("finishes, even sky and a lamp", false, "lamps");
}

static double difference_of(const float *a, const float *b) {
    double sum = 0;
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++) sum += fabs((double)(a[i] - b[i]));
    return sum / (3 * PIXELS);
}

/* Directions of light that come later than the light are taken up at the next picture, and shown as rays show
 * them. */
static void test_directions(void **state) {
    (void)state;
    struct world w;
    for (int lamps = 0; lamps < 2; lamps++) {
        struct lw_error err = {0};
        struct lw_scene *scene = finished_panels();
        lw_support_ok(
            lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err), &err);
        start_lit(&w, scene, 0.5f, 1, lamps ? "lamps" : "none");
        w.view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
        draw(&w);
        float *before = malloc(sizeof(float) * 3 * PIXELS);
        assert_non_null(before);
        memcpy(before, w.by_gl, sizeof(float) * 3 * PIXELS);
        fill_directions(&w);
        draw(&w);
        compare(lamps ? "directions and a lamp" : "directions", &w);
        assert_true(difference_of(before, w.by_gl) > 10 * difference_of(w.by_cpu, w.by_gl));
        free(before);
        world_finish(&w);
    }
}

/* Panels with finishes, light in tiles, and planes of directions in which nothing is known. */
static void start_without_directions(struct world *w) {
    struct lw_error err = {0};
    struct lw_scene *scene = finished_panels();
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err),
                  &err);
    start_lit(w, scene, 0.5f, 1, "none");
    w->view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
}

/* Calls a function of each number of all planes of directions, and tells clients that they are others. */
static void change_directions(struct world *w, float (*change)(uint32_t number)) {
    uint32_t number = 0;
    for (uint32_t o = 0; o < w->scene->object_count; o++)
        for (uint32_t k = 0; k < w->map.atlas[o]->level_count; k++) {
            const struct lw_atlas_level *l = &w->map.atlas[o]->level[k];
            float *at = w->direction[o * LW_ATLAS_LEVELS_MAX + k];
            for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++) at[i] = change(number++);
        }
    for (uint32_t t = 0; t < w->map.tile_count; t++) w->tile[t].direction_version++;
}

static float nothing(uint32_t number) {
    (void)number;
    return 0;
}

static float any_number(uint32_t number) {
    const uint32_t bits = lw_random_hash2(number, 5);
    float value;
    memcpy(&value, &bits, sizeof value);
    return number / 48 % 2 ? value : (float)(bits % 4001) / 1000 - 2;
}

/* Both pictures without directions, by rays and by OpenGL; then there are some. The caller frees it. */
static float *draw_without_directions(struct world *w) {
    start_without_directions(w);
    draw(w);
    float *before = malloc(sizeof(float) * 6 * PIXELS);
    assert_non_null(before);
    memcpy(before, w->by_cpu, sizeof(float) * 3 * PIXELS);
    memcpy(before + 3ul * PIXELS, w->by_gl, sizeof(float) * 3 * PIXELS);
    fill_directions(w);
    return before;
}

/* Where no direction is known, both pictures are those without directions. */
static void test_directions_unknown(void **state) {
    (void)state;
    struct world w;
    float *before = draw_without_directions(&w);
    draw(&w);
    assert_true(difference_of(before, w.by_cpu) > 1e-3);
    change_directions(&w, nothing);
    draw(&w);
    assert_true(difference_of(before, w.by_cpu) < 1e-6);
    assert_true(difference_of(before + 3ul * PIXELS, w.by_gl) < 1e-4);
    free(before);
    world_finish(&w);
}

/* Directions of any bits: no pixel is no number, negative, or above the bounds of direction_form.h. */
static void test_directions_hostile(void **state) {
    (void)state;
    struct world w;
    float *before = draw_without_directions(&w);
    change_directions(&w, any_number);
    draw(&w);
    const float most = fmaxf(LW_DIRECTION_FACTOR_MAX, LW_DIRECTION_GAIN_MAX) * 1.02f;
    assert_true(difference_of(before + 3ul * PIXELS, w.by_gl) > 1e-3);
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++) {
        assert_true(w.by_cpu[i] >= 0 && w.by_cpu[i] <= most * before[i] + 1e-3f);
        assert_true(w.by_gl[i] >= 0 && w.by_gl[i] <= most * before[i + 3ul * PIXELS] + 1e-3f);
    }
    free(before);
    world_finish(&w);
}

static void test_finished_atrium(void **state) {
    (void)state;
    test_drawn("builtin:atrium", NULL, 1);
}

/* Finishes that come later are taken up at the next picture. */
static void test_finishes_arrive(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    struct lw_scene *scene = finished_panels();
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err),
                  &err);
    const struct lw_finish *kept[PANELS];
    const uint16_t *tangent[PANELS];
    for (uint32_t i = 0; i < PANELS; i++) {
        kept[i] = scene->material[i].finish, tangent[i] = scene->mesh[i].tangent;
        scene->material[i].finish = NULL, scene->mesh[i].tangent = NULL;
    }
    const uint32_t count = scene->finish_texture_count;
    scene->finish_texture_count = 0;
    start_lit(&w, scene, 0.5f, 1, "lamps");
    w.view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
    draw(&w);
    compare("before finishes", &w);
    float *before = malloc(sizeof(float) * 3 * PIXELS);
    assert_non_null(before);
    memcpy(before, w.by_gl, sizeof(float) * 3 * PIXELS);
    scene->finish_texture_count = count;
    for (uint32_t i = 0; i < PANELS; i++)
        scene->material[i].finish = kept[i], scene->mesh[i].tangent = tangent[i];
    draw(&w);
    compare("after they came", &w);
    double differs = 0;
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++) differs += fabs((double)(before[i] - w.by_gl[i]));
    assert_true(differs > 0.01 * 3 * PIXELS);
    free(before);
    world_finish(&w);
}

/* Before any light has arrived surfaces are as bright as their albedo. */
static void test_no_light(void **state) {
    (void)state;
    struct world w;
    start(&w, open_scene("builtin:cornell"), 0, 1);
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].version = 0;
    draw(&w);
    compare("builtin:cornell, without light", &w);
    world_finish(&w);
}

/* Uploads are capped, what waits comes later, and nothing is uploaded twice. */
static void test_uploads(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    start(&w, open_scene("builtin:cornell"), 0.5f, 1);
    uint32_t waiting = 0, tile_count = w.map.tile_count, calls = 0;
    do {
        const uint32_t before = waiting;
        lw_support_ok(lw_gl_renderer_take(w.renderer, &w.source, &w.pose, 3, 0, &waiting, &err), &err);
        assert_int_equal(calls == 0 ? tile_count - 3 : before > 3 ? before - 3 : 0, waiting);
        assert_true(++calls <= tile_count);
    } while (waiting > 0);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).tiles_uploaded, tile_count);
    draw(&w);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).tiles_uploaded, tile_count);
    compare("builtin:cornell, in steps", &w);
    w.tile[tile_count / 2].version++;
    draw(&w);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).tiles_uploaded, tile_count + 1);
    world_finish(&w);
}

/* Parts of the light, and charts, are the same by both; the parts add up. */
static void test_shows(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    start_drawn(&w, "builtin:cornell", 0.02f);
    struct lw_vec3 *colour = calloc(w.map.tile_count, sizeof *colour);
    float *sum = calloc((size_t)3 * PIXELS, sizeof *sum);
    assert_true(colour && sum);
    for (uint32_t t = 0; t < w.map.tile_count; t++)
        w.tile[t].error = 0.002f * (float)(1 + (t * 2654435761u >> 16) % 7);
    for (int show = LW_SHOW_DIRECT; show < LW_SHOW_COUNT; show++) {
        char name[64];
        const struct lw_show_tiles tiles = {
            .count = w.map.tile_count, .context = &w, .tile = tile, .now_ns = 5000000000u};
        lw_show_colour_tiles(LW_SHOW_ERROR, &tiles, colour);
        w.view.show = (enum lw_show)show, w.view.tile_colour = colour;
        draw(&w);
        snprintf(name, sizeof name, "builtin:cornell, %s", lw_show_name((enum lw_show)show));
        compare(name, &w);
        if (show <= LW_SHOW_INDIRECT)
            for (size_t i = 0; i < (size_t)3 * PIXELS; i++) sum[i] += w.by_cpu[i];
    }
    w.view.show = LW_SHOW_ALL;
    draw(&w);
    double off = 0, all = 0;
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++) {
        off += fabs((double)sum[i] - (double)w.by_cpu[i]);
        all += (double)w.by_cpu[i];
    }
    assert_true(off < 1e-5 * all);
    (void)err;
    free(sum);
    free(colour);
    world_finish(&w);
}

/* The object of a room that fills the least of it: a thing that stands there. */
static uint32_t find_inner(const struct world *w) {
    uint32_t inner = 0;
    float least = INFINITY;
    for (uint32_t o = 0; o < w->scene->object_count; o++) {
        const struct lw_mesh *mesh = &w->scene->mesh[w->scene->object[o].mesh];
        struct lw_vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
        for (uint32_t v = 0; v < mesh->vertex_count; v++) {
            const struct lw_vec3 p = lw_affine_point(&w->pose.object_to_world[o], mesh->position[v]);
            low = lw_vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
            high = lw_vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
        }
        const struct lw_vec3 side = lw_vec3_sub(high, low);
        const float volume = side.x * side.y * side.z;
        if (volume > 1e-3f && volume < least) least = volume, inner = o;
    }
    return inner;
}

/* The shadow maps that hold the moved thing are drawn again, and no others; the moved thing is
 * seen. */
static void test_moved_caster(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    start_drawn(&w, "builtin:cornell", 0.02f);
    take_and_draw(&w, 1);
    const uint64_t all = lw_gl_renderer_figures(w.renderer).maps_drawn;
    take_and_draw(&w, 1);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).maps_drawn, all);
    const uint32_t inner = find_inner(&w);
    w.pose.object_dynamic[inner] = true;
    w.pose.object_to_world[inner].m[0][3] += 0.02f;
    lw_support_ok(lw_trace_set_pose(w.trace, &w.pose, &err), &err);
    take_and_draw(&w, 1);
    const uint64_t again = lw_gl_renderer_figures(w.renderer).maps_drawn - all;
    print_message("%u maps, %u of them again when object %u moves\n", (unsigned)all, (unsigned)again, inner);
    assert_true(again > 0 && again < all);
    draw(&w);
    compare("builtin:cornell, a box moved", &w);
    world_finish(&w);
}

static struct lw_gl_renderer_figures figures_from(struct world *w, const char *camera) {
    struct lw_error err = {0};
    lw_support_ok(lw_camera_parse(camera, &w->view.camera, &err), &err);
    take_and_draw(w, 1);
    return lw_gl_renderer_figures(w->renderer);
}

/* Draw calls if each object had its own: one for each of its materials. */
static uint32_t count_single_calls(const struct world *w) {
    uint32_t calls = 0;
    uint8_t *used = calloc(w->scene->material_count + 1ul, 1);
    assert_non_null(used);
    for (uint32_t o = 0; o < w->scene->object_count; o++) {
        const struct lw_mesh *mesh = &w->scene->mesh[w->scene->object[o].mesh];
        memset(used, 0, w->scene->material_count);
        for (uint32_t t = 0; t < mesh->triangle_count; t++) used[mesh->material[t]] = 1;
        for (uint32_t m = 0; m < w->scene->material_count; m++) calls += used[m];
    }
    free(used);
    return calls;
}

/* Instances share draw calls, and objects out of sight are not drawn. */
static void test_draw_calls(void **state) {
    (void)state;
    struct world w;
    start(&w, open_scene("builtin:city:1"), 0, 1);
    uint32_t placed = 0;
    for (uint32_t o = 0; o < w.scene->object_count; o++) placed += !w.pose.object_hidden[o];
    const struct lw_gl_renderer_figures all = figures_from(&w, "-900,700,-900:0,0,0:60"),
                                        part = figures_from(&w, "0,2,0:100,2,0:40"),
                                        none = figures_from(&w, "0,400,0:0,500,1:40");
    print_message("city:1, %u objects: %u in %u draw calls; from within %u in %u; of the sky %u in %u\n",
                  placed, all.objects, all.draw_calls, part.objects, part.draw_calls, none.objects,
                  none.draw_calls);
    assert_int_equal(all.objects, placed);
    assert_true(all.draw_calls < count_single_calls(&w));
    assert_true(part.objects < placed && part.objects > 0);
    assert_true(part.draw_calls <= all.draw_calls);
    assert_int_equal(none.objects, 0);
    assert_true(none.draw_calls <= 1);
    world_finish(&w);
}

/* By how many codes at most a framebuffer differs from what lw_tonemap makes of the picture. */
static unsigned codes_apart(struct world *w, GLuint frame, enum lw_tonemap_curve curve, float stops) {
    struct lw_tonemap tonemap;
    unsigned most = 0;
    uint8_t *shown = malloc(4ul * PIXELS), *expected = malloc(3ul * PIXELS);
    assert_true(shown && expected);
    lw_tonemap_init(&tonemap, curve, stops);
    lw_tonemap_encode(&tonemap, w->by_gl, PIXELS, 3, expected);
    lw_gl_renderer_show(w->renderer, frame, curve, stops, WIDTH, HEIGHT);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, frame);
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    glReadPixels(0, 0, WIDTH, HEIGHT, GL_RGBA, GL_UNSIGNED_BYTE, shown);
    for (size_t y = 0; y < HEIGHT; y++)
        for (size_t x = 0; x < WIDTH; x++)
            for (size_t c = 0; c < 3; c++) {
                const int a = shown[4 * ((HEIGHT - 1 - y) * WIDTH + x) + c],
                          b = expected[3 * (y * WIDTH + x) + c];
                if ((unsigned)abs(a - b) > most) most = (unsigned)abs(a - b);
            }
    free(expected);
    free(shown);
    return most;
}

/* What the window gets is the picture as lw_tonemap encodes it, and its exposure that of the whole
 * picture. */
static void test_show_and_meter(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    start(&w, open_scene("builtin:cornell"), 0, 1);
    take_and_draw(&w, 1);
    lw_support_ok(lw_gl_renderer_read(w.renderer, w.by_gl, &err), &err);
    float stops = 0;
    lw_support_ok(lw_gl_renderer_meter(w.renderer, &stops, &err), &err);
    const float whole = lw_tonemap_auto_stops(w.by_gl, PIXELS);
    print_message("metered %+.3f stops, of all pixels %+.3f\n", (double)stops, (double)whole);
    assert_true(fabsf(stops - whole) < 0.1f);
    GLuint frame, buffer;
    glGenFramebuffers(1, &frame);
    glBindFramebuffer(GL_FRAMEBUFFER, frame);
    glGenRenderbuffers(1, &buffer);
    glBindRenderbuffer(GL_RENDERBUFFER, buffer);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, WIDTH, HEIGHT);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, buffer);
    for (int curve = LW_TONEMAP_REINHARD; curve <= LW_TONEMAP_NONE; curve++) {
        const unsigned most = codes_apart(&w, frame, (enum lw_tonemap_curve)curve, whole);
        print_message("curve %d: codes differ by %u at most\n", curve, most);
        assert_true(most <= 1);
    }
    glDeleteFramebuffers(1, &frame);
    glDeleteRenderbuffers(1, &buffer);
    world_finish(&w);
}

/* The tiles of a survey are those that the composer needs, but for few that cover a pixel or two. */
static void test_survey(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    struct lw_compose_report report;
    start(&w, open_scene("builtin:cornell"), 0.5f, 1);
    uint8_t *needed = calloc(w.map.tile_count, 1);
    uint64_t *shown = calloc(w.map.tile_count, sizeof *shown), pixel_count = 0, lit = 0;
    assert_true(needed && shown);
    lw_compose_render(w.compose, &w.source, &w.pose, &w.view, w.by_cpu, &report);
    lw_support_ok(lw_gl_renderer_take(w.renderer, &w.source, &w.pose, 0, 0, NULL, &err), &err);
    lw_support_ok(lw_gl_renderer_survey(w.renderer, &w.view, needed, shown, &pixel_count, &err), &err);
    uint32_t both = 0, one = 0;
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        both += needed[t] && lw_compose_needed(w.compose)[t];
        one += needed[t] != lw_compose_needed(w.compose)[t];
        lit += shown[t];
        if (shown[t]) assert_true(needed[t]);
    }
    print_message("%u tiles needed by both, %u by one\n", both, one);
    assert_int_equal(pixel_count, WIDTH / 4 * HEIGHT / 4);
    assert_true(both > 3 * one);
    assert_true(lit <= 256 * pixel_count && lit > 64 * pixel_count);
    free(shown);
    free(needed);
    world_finish(&w);
}

/* RGB9E5 is within half a step of what it holds, times the scale. */
static void test_pack(void **state) {
    (void)state;
    for (int i = -20; i < 16; i++)
        for (int k = 0; k < 40; k++) {
            const float most = ldexpf(1 + (float)k / 39.0f, i), rgb[3] = {most, 0.3f * most, 0.001f * most};
            const uint32_t packed = lw_gl_rgb9e5_pack(rgb, 1);
            const float step = ldexpf(1, (int)(packed >> 27) - 24);
            if (most > 65408) continue;
            for (int c = 0; c < 3; c++)
                assert_true(fabsf((float)(packed >> (9 * c) & 511) * step - rgb[c]) <= 0.5f * step);
            assert_true(step <= fmaxf(most / 255, ldexpf(1, -24)));
        }
    const float wrong[3] = {NAN, -1, 1e30f};
    const uint32_t packed = lw_gl_rgb9e5_pack(wrong, 1);
    assert_int_equal(packed & 0x3ffff, 0);
    assert_int_equal(packed >> 18, 31 << 9 | 511);
    const float dim[3] = {0.5f, 0.125f, 0}, bright[3] = {2, 0.5f, 0};
    assert_int_equal(lw_gl_rgb9e5_pack(dim, 4), lw_gl_rgb9e5_pack(bright, 1));
    assert_int_not_equal(lw_gl_rgb9e5_pack(dim, 4), lw_gl_rgb9e5_pack(dim, 1));
}

/* A picture that no GPU draws fails with a word, and the next one is drawn. */
static void test_sizes(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    start(&w, open_scene("builtin:cornell"), 0, 1);
    struct lw_compose_view view = w.view;
    for (int i = 0; i < 2; i++) {
        view.width = i ? 1u << 20 : 0;
        err = (struct lw_error){0};
        lw_support_fails(lw_gl_renderer_draw(w.renderer, &view, 1, &err), LW_UNAVAILABLE, &err, "pixels");
    }
    draw(&w);
    compare("builtin:cornell, after sizes that cannot be", &w);
    world_finish(&w);
}

static void test_sponza(void **state) {
    (void)state;
    test_same_picture(lw_support_scene("sponza/Sponza_lit.gltf"), "-8,1.8,-0.3:5,4,-0.3:75");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_atrium),
        cmocka_unit_test(test_part_of_the_light),
        cmocka_unit_test(test_cornell),
        cmocka_unit_test(test_panels),
        cmocka_unit_test(test_no_light),
        cmocka_unit_test(test_shows),
        cmocka_unit_test(test_moved_caster),
        cmocka_unit_test(test_draw_calls),
        cmocka_unit_test(test_show_and_meter),
        cmocka_unit_test(test_uploads),
        cmocka_unit_test(test_survey),
        cmocka_unit_test(test_pack),
        cmocka_unit_test(test_sizes),
        cmocka_unit_test(test_sponza),
        cmocka_unit_test(test_drawn_cornell),
        cmocka_unit_test(test_drawn_atrium),
        cmocka_unit_test(test_drawn_sponza),
        cmocka_unit_test(test_finishes),
        cmocka_unit_test(test_finishes_arrive),
        cmocka_unit_test(test_directions),
        cmocka_unit_test(test_directions_unknown),
        cmocka_unit_test(test_directions_hostile),
        cmocka_unit_test(test_finished_atrium),
    };
    return cmocka_run_group_tests(tests, NULL, close_scenes);
}
