#include "tests/support/support.h"

#include "client/view/compose/compose.h"

#include "common/base/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SIDE_M  4.0f
#define BOUNCES 2u

/* A scene with hand-made light: every texel and tile of every level is ours to fill. */
struct world {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_trace *trace;
    struct lw_compose *compose;
    float **rgb; /* object * LW_ATLAS_LEVELS_MAX + level */
    struct lw_client_tile *tile;
    struct lw_compose_source source;
};

static struct lw_client_level world_level(const void *context, uint32_t object, uint32_t level) {
    const struct world *w = context;
    if (level >= w->map.atlas[object]->level_count) return (struct lw_client_level){0};
    const struct lw_atlas_level *l = &w->map.atlas[object]->level[level];
    return (struct lw_client_level){
        .width = l->width, .height = l->height, .rgb = w->rgb[object * LW_ATLAS_LEVELS_MAX + level]};
}

static struct lw_client_tile world_tile(const void *context, lw_tile_id tile) {
    return ((const struct world *)context)->tile[tile.v];
}

/* Squares of SIDE_M with an atlas of texels x texels, u along X and v along Z. Twice as many rows with
 * backs. */
static struct lw_scene *squares(unsigned count, uint32_t texels, bool double_sided) {
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

static void stack(struct lw_scene *scene) { /* object i at height i, one above the other */
    for (uint32_t i = 0; i < scene->object_count; i++) {
        scene->node[i].translation[0] = 0;
        scene->node[i].translation[1] = (float)i;
    }
}

static void make_compose(struct world *w, unsigned threads) {
    struct lw_error err = {0};
    lw_compose_destroy(w->compose);
    lw_support_ok(lw_compose_create(
                      &(struct lw_compose_desc){
                          .scene = w->scene, .map = &w->map, .trace = w->trace, .threads = threads},
                      &w->compose, &err),
                  &err);
}

/* finer: levels */
static void world_init_finer(struct world *w, struct lw_scene *scene, uint32_t finer) {
    struct lw_error err = {0};
    *w = (struct world){.scene = scene};
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
    make_compose(w, 1);
}

static void world_init(struct world *w, struct lw_scene *scene) { world_init_finer(w, scene, 0); }

static void world_finish(struct world *w) {
    lw_compose_destroy(w->compose);
    for (uint32_t i = 0; i < w->scene->object_count * LW_ATLAS_LEVELS_MAX; i++) free(w->rgb[i]);
    free(w->rgb);
    free(w->tile);
    lw_trace_destroy(w->trace);
    lw_atlas_map_finish(&w->map);
    lw_pose_finish(&w->pose);
    lw_scene_destroy(w->scene);
}

static void fill_level(struct world *w, uint32_t object, uint32_t k, float value) {
    const struct lw_atlas_level *l = &w->map.atlas[object]->level[k];
    for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++)
        w->rgb[object * LW_ATLAS_LEVELS_MAX + k][i] = value;
}

/* Every level of an object holds its own constant: first, first + 1, ... */
static void fill_by_level(struct world *w, uint32_t object, float first) {
    for (uint32_t k = 0; k < w->map.atlas[object]->level_count; k++)
        fill_level(w, object, k, first + (float)k);
}

static void fill_constant(struct world *w, uint32_t object, float value) {
    for (uint32_t k = 0; k < w->map.atlas[object]->level_count; k++) fill_level(w, object, k, value);
}

enum { WIDTH = 37, HEIGHT = 22 }; /* no multiple of a packet or a screen tile */

static struct lw_compose_view view_towards(float from_x, float from_y, float from_z, float to_x, float to_y,
                                           float to_z, float fov_deg) {
    return (struct lw_compose_view){.camera =
                                        lw_camera_look_at(lw_vec3(from_x, from_y, from_z),
                                                          lw_vec3(to_x, to_y, to_z), fov_deg / 180 * LW_PI),
                                    .width = WIDTH,
                                    .height = HEIGHT};
}

/* From above on the middle of the first square; all rays meet it. */
static struct lw_compose_view view_down(void) { return view_towards(0, 1, 0, 0, 0, 0, 40); }

static struct lw_compose_report render(struct world *w, const struct lw_compose_view *view, float *rgb) {
    struct lw_compose_report report;
    for (size_t i = 0; i < (size_t)view->width * view->height * 3; i++) rgb[i] = NAN;
    lw_compose_render(w->compose, &w->source, &w->pose, view, rgb, &report);
    for (size_t i = 0; i < (size_t)view->width * view->height * 3; i++)
        assert_true(isfinite(rgb[i]) && rgb[i] >= 0);
    return report;
}

static void assert_near(float value, float expected, float relative) {
    if (!(fabsf(value - expected) <= relative * fabsf(expected)))
        fail_msg("%.9g is not %.9g", (double)value, (double)expected);
}

static void assert_picture(const float *rgb, float expected) {
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) assert_near(rgb[i], expected, 1e-6f);
}

static void test_constant(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(1, 64, false));
    fill_constant(&w, 0, 3.0f);
    struct lw_compose_view view = view_down();
    struct lw_compose_report report = render(&w, &view, rgb);
    assert_picture(rgb, 0.5f * 3.0f / LW_PI);
    assert_true(report.complete && report.converged);
    assert_int_equal(report.tiles_missing, 0);
    world_finish(&w);
}

static void test_emission_and_albedo(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    struct lw_scene *scene = squares(1, 64, false);
    for (int c = 0; c < 3; c++) {
        scene->material[0].emission[c] = (float)(c + 1);
        scene->material[0].base_colour[c] = 0.2f * (float)c;
    }
    world_init(&w, scene);
    fill_constant(&w, 0, 3.0f);
    struct lw_compose_view view = view_down();
    render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        for (int c = 0; c < 3; c++)
            assert_near(rgb[3 * i + (size_t)c], 0.2f * (float)c * 3.0f / LW_PI + (float)(c + 1), 1e-6f);
    world_finish(&w);
}

/* Whatever light falls on it, an unlit surface is its base colour; so with a colour of each vertex. */
static void test_unlit(void **state) {
    (void)state;
    for (int coloured = 0; coloured < 2; coloured++) {
        struct world w;
        float rgb[WIDTH * HEIGHT * 3];
        struct lw_scene *scene = squares(1, 64, false);
        struct lw_vec4 *colour = lw_scene_alloc(scene, scene->mesh[0].vertex_count, sizeof *colour);
        for (uint32_t v = 0; v < scene->mesh[0].vertex_count; v++)
            colour[v] = (struct lw_vec4){0.5f, 0.5f, 0.25f, 1};
        if (coloured) scene->mesh[0].colour = colour;
        scene->material[0].unlit = 1;
        for (int c = 0; c < 3; c++) scene->material[0].base_colour[c] = 0.3f * (float)(c + 1);
        world_init(&w, scene);
        fill_constant(&w, 0, 3.0f);
        struct lw_compose_view view = view_down();
        render(&w, &view, rgb);
        for (size_t i = 0; i < WIDTH * HEIGHT; i++)
            for (int c = 0; c < 3; c++)
                assert_near(rgb[3 * i + (size_t)c],
                            0.3f * (float)(c + 1) *
                                (!coloured ? 1
                                 : c == 2  ? 0.25f
                                           : 0.5f),
                            1e-6f);
        world_finish(&w);
    }
}

/* A square fills the middle half of an orthographic view that is twice as high, however far it is. */
static void test_parallel(void **state) {
    (void)state;
    struct world w;
    enum { SIDE = 64 };
    static float rgb[SIDE * SIDE * 3];
    world_init(&w, squares(1, 64, false));
    fill_constant(&w, 0, 3.0f);
    for (int far = 0; far < 3; far++) {
        struct lw_compose_view view = {
            .camera = lw_camera_look_at(lw_vec3(0, powf(10, (float)far), 0), lw_vec3(0, 0, 0), 1),
            .width = SIDE,
            .height = SIDE};
        view.camera.height_m = 2 * SIDE_M;
        render(&w, &view, rgb);
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++) {
                const bool inside = x >= SIDE / 4 && x < 3 * SIDE / 4 && y >= SIDE / 4 && y < 3 * SIDE / 4;
                assert_near(rgb[3 * (y * SIDE + x)], inside ? 0.5f * 3 / LW_PI : 0.25f, 1e-6f);
            }
    }
    world_finish(&w);
}

/* A pane lets 1 - alpha of the radiance behind it pass, by its tint. */
static void test_tint(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    struct lw_scene *scene = squares(1, 64, false);
    const float tint[3] = {2, 1, 0.25f}, sky[3] = {0.25f, 0.5f, 1.0f};
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.25f;
    memcpy(scene->material[0].tint, tint, sizeof tint);
    world_init(&w, scene);
    fill_constant(&w, 0, 3);
    struct lw_compose_view view = view_down();
    render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        for (int c = 0; c < 3; c++)
            assert_near(rgb[3 * i + (size_t)c], 0.25f * 0.5f * 3 / LW_PI + 0.75f * tint[c] * sky[c], 1e-5f);
    world_finish(&w);
}

static struct lw_vec3 colour_expected(const struct world *w, const struct lw_hit16 *hits, int i) {
    if (hits->object[i] == LW_TRACE_MISS) return lw_vec3(w->source.sky.x, w->source.sky.y, w->source.sky.z);
    struct lw_surface surface;
    lw_scene_surface(w->scene, &w->scene->mesh[0], hits->triangle[i], hits->u[i], hits->v[i], &surface);
    const float e = w->rgb[hits->object[i] * LW_ATLAS_LEVELS_MAX][0];
    return lw_vec3_add(lw_vec3_scale(surface.albedo, e / LW_PI), surface.emission);
}

/* Every triangle is some pixels wide: packets meet up to sixteen, and a thread far more than it keeps at
 * hand. */
static void test_many_small_triangles(void **state) {
    (void)state;
    const uint32_t count = 3000;
    struct lw_scene *scene = squares(count, 16, false);
    struct lw_vec4 *colour = lw_scene_alloc(scene, 4, sizeof *colour);
    for (int i = 0; i < 4; i++) colour[i] = (struct lw_vec4){0.25f * (float)i, 1 - 0.3f * (float)i, 0.5f, 1};
    scene->mesh[0].colour = colour;
    scene->material[0].emission[2] = 0.25f;
    for (uint32_t o = 0; o < count; o++)
        for (uint32_t axis = 0; axis < 3; axis++) {
            scene->node[o].translation[axis] = 60 * lw_random_unit(lw_random_hash2(o, axis)) - 30;
            scene->node[o].scale[axis] = 0.2f;
        }
    struct world w;
    world_init(&w, scene);
    for (uint32_t o = 0; o < count; o++) fill_constant(&w, o, (float)(o + 1));
    struct lw_compose_view view = view_towards(2, 80, 1, 0, 0, 0, 40);
    view.width = 203, view.height = 101; /* no multiples of a packet */
    float *rgb = malloc((size_t)view.width * view.height * 3 * sizeof *rgb);
    assert_non_null(rgb);
    render(&w, &view, rgb);

    const struct lw_camera_plane plane = lw_camera_plane(&view.camera, view.width, view.height);
    unsigned met = 0;
    for (uint32_t y = 0; y < view.height; y += 4)
        for (uint32_t x = 0; x < view.width; x += 4) {
            struct lw_ray16 rays = {.salt = 0};
            struct lw_hit16 hits;
            for (uint32_t i = 0; i < 16; i++)
                lw_trace_set_ray(
                    &rays, i, view.camera.position,
                    lw_camera_direction(&plane, (float)(x + i % 4) + 0.5f, (float)(y + i / 4) + 0.5f),
                    INFINITY);
            lw_trace_closest16(w.trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, 0xffff, &rays, &hits);
            for (uint32_t i = 0; i < 16; i++) {
                if (x + i % 4 >= view.width || y + i / 4 >= view.height) continue;
                const struct lw_vec3 expected = colour_expected(&w, &hits, (int)i);
                const float *pixel = rgb + 3 * ((size_t)(y + i / 4) * view.width + x + i % 4);
                assert_float_equal(pixel[0], expected.x, 1e-5f * (1 + expected.x));
                assert_float_equal(pixel[1], expected.y, 1e-5f * (1 + expected.y));
                assert_float_equal(pixel[2], expected.z, 1e-5f * (1 + expected.z));
                met += hits.object[i] != LW_TRACE_MISS;
            }
        }
    assert_true(met > view.width * view.height / 8);
    free(rgb);
    world_finish(&w);
}

static void test_sky(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(1, 64, false));
    struct lw_compose_view view = view_towards(0, 1, 0, 0, 2, 0, 40);
    struct lw_compose_report report = render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        assert_float_equal(rgb[3 * i], 0.25f, 0);
        assert_float_equal(rgb[3 * i + 2], 1.0f, 0);
    }
    assert_int_equal(report.tiles_needed, 0);
    world_finish(&w);
}

/* A ray that meets nothing sees sky and environment, whatever the length of its direction. */
static void test_environment(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(1, 64, false));
    const float texels[4 * 3] = {1, 10, 100, 2, 20, 200,
                                 3, 30, 300, 4, 40, 400}; /* middles: -x-z, x-z, x+z, -x+z */
    w.scene->environment = (struct lw_environment){.width = 4, .height = 1, .rgb = texels};
    for (int side = -1; side < 2;
         side += 2) { /* texel centres of columns 1 and 2 are at +-45 degrees from +X */
        struct lw_compose_view view = view_towards(0, 1, 0, 1, 1, (float)side, 2);
        render(&w, &view, rgb);
        const float *middle = rgb + 3 * (HEIGHT / 2 * WIDTH + WIDTH / 2);
        float column = side < 0 ? 2 : 3;
        assert_near(middle[0], 0.25f + column, 0.05f);
        assert_near(middle[1], 0.5f + 10 * column, 0.5f);
        assert_near(middle[2], 1.0f + 100 * column, 5);
    }
    world_finish(&w);
}

/* E = u, v and their sum in texels of level 0, written into the texel centres of every level: bilinear
 * interpolation gives it back exactly, at whatever level it is read. */
static void fill_ramps(struct world *w) {
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

static void assert_ramps(const struct lw_compose_view *view, const float *rgb, float texels) {
    struct lw_camera_plane plane = lw_camera_plane(&view->camera, WIDTH, HEIGHT);
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++) {
            struct lw_vec3 dir = lw_camera_direction(&plane, (float)x + 0.5f, (float)y + 0.5f);
            struct lw_vec3 p = lw_vec3_mad(view->camera.position, dir, -view->camera.position.y / dir.y);
            float u = (p.x / SIDE_M + 0.5f) * texels, v = (p.z / SIDE_M + 0.5f) * texels;
            const float *pixel = rgb + 3 * ((size_t)y * WIDTH + x);
            assert_near(pixel[0], 0.5f * u / LW_PI, 1e-4f);
            assert_near(pixel[1], 0.5f * v / LW_PI, 1e-4f);
            assert_near(pixel[2], 0.5f * (u + v) / LW_PI, 1e-4f);
        }
}

static void test_ramps(void **state) {
    (void)state;
    const uint32_t texels[3] = {64, 256, 1024}; /* seen at level 0, 1 and 2 */
    for (int i = 0; i < 3; i++) {
        struct world w;
        float rgb[WIDTH * HEIGHT * 3];
        world_init(&w, squares(1, texels[i], false));
        fill_ramps(&w);
        struct lw_compose_view view = view_towards(0.3f, 1, 0.1f, 0, 0, 0, 40);
        render(&w, &view, rgb);
        assert_ramps(&view, rgb, (float)texels[i]);
        world_finish(&w);
    }
}

/* Texels per pixel where the view's axis meets the square: depth x 2 tan(fov/2) / rows x texels per metre. */
static void test_level_follows_the_footprint(void **state) {
    (void)state;
    struct world w;
    world_init(&w, squares(1, 1024, false));
    fill_by_level(&w, 0, 1);
    float rgb[WIDTH * HEIGHT * 3];
    const float pixel = 2 * tanf(20.0f / 180 * LW_PI) / HEIGHT, texels_per_m = 1024 / SIDE_M;
    const struct {
        float footprint, value;
    } cases[] = {{0.5f, 1}, {1.9f, 1}, {2.1f, 2}, {3.9f, 2}, {4.1f, 3}, {7.9f, 3}, {8.1f, 3}, {40.0f, 3}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct lw_compose_view view =
            view_towards(0, cases[i].footprint / (pixel * texels_per_m), 0, 0, 0, 0, 40);
        render(&w, &view, rgb);
        /* the middle pixel; its footprint is larger than the axis' by the cosine, far less than the margins
         * here */
        assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * cases[i].value / LW_PI, 1e-6f);
    }
    world_finish(&w);
    /* an object twice as large has half the texels per metre */
    struct lw_scene *scene = squares(1, 1024, false);
    for (int c = 0; c < 3; c++) scene->node[0].scale[c] = 2;
    world_init(&w, scene);
    fill_by_level(&w, 0, 1);
    struct lw_compose_view view = view_towards(0, 3.0f / (pixel * texels_per_m), 0, 0, 0, 0, 40);
    render(&w, &view, rgb);
    assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * 1 / LW_PI, 1e-6f);
    world_finish(&w);
}

/* Two charts that share blocks: coarser levels hold the light of both. */
static void test_charts_that_share_blocks_are_read_at_level_0(void **state) {
    (void)state;
    struct lw_scene *scene = squares(1, 1024, false);
    struct lw_mesh *mesh = &scene->mesh[0];
    static const uint32_t apart[2][3] = {{0, 1, 2}, {3, 4, 5}};
    struct lw_vec3 *position = lw_scene_alloc(scene, 6, sizeof *position),
                   *normal = lw_scene_alloc(scene, 6, sizeof *normal);
    struct lw_vec2 *uv = lw_scene_alloc(scene, 6, sizeof *uv),
                   *lightmap_uv = lw_scene_alloc(scene, 6, sizeof *uv);
    for (uint32_t i = 0; i < 6; i++) {
        const uint32_t v = mesh->triangle[i / 3][i % 3];
        position[i] = mesh->position[v], normal[i] = mesh->normal[v];
        if (i >= 3) position[i].y -= 0.01f; /* charts that meet in space would be one piece */
        uv[i] = mesh->uv[0][v], lightmap_uv[i] = mesh->lightmap_uv[v];
    }
    mesh->position = position, mesh->normal = normal, mesh->uv[0] = uv, mesh->lightmap_uv = lightmap_uv;
    mesh->triangle = apart;
    mesh->vertex_count = 6;
    struct world w;
    world_init(&w, scene);
    fill_by_level(&w, 0, 1);
    float rgb[WIDTH * HEIGHT * 3];
    const float pixel = 2 * tanf(20.0f / 180 * LW_PI) / HEIGHT, texels_per_m = 1024 / SIDE_M;
    struct lw_compose_view view = view_towards(0, 8.0f / (pixel * texels_per_m), 0, 0, 0, 0, 40);
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.9f; /* noise is no reason either */
    render(&w, &view, rgb);
    assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * 1 / LW_PI, 1e-6f);
    world_finish(&w);
}

/* A flat slab, whose scale across the surface says nothing about the surface. */
static void test_level_ignores_the_scale_across_the_surface(void **state) {
    (void)state;
    const float pixel = 2 * tanf(20.0f / 180 * LW_PI) / HEIGHT, texels_per_m = 1024 / SIDE_M / 2;
    const float across[] = {0.0001f, 1, 500};
    for (size_t i = 0; i < sizeof across / sizeof across[0]; i++) {
        struct world w;
        float rgb[WIDTH * HEIGHT * 3];
        struct lw_scene *scene = squares(1, 1024, false);
        scene->node[0].scale[0] = 4, scene->node[0].scale[1] = across[i], scene->node[0].scale[2] = 1;
        world_init(&w, scene);
        fill_by_level(&w, 0, 1);
        struct lw_compose_view view = view_towards(0, 3.0f / (pixel * texels_per_m), 0, 0, 0, 0, 40);
        render(&w, &view, rgb);
        assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * 2 / LW_PI, 1e-6f);
        world_finish(&w);
    }
}

static uint32_t tile_at(const struct world *w, uint32_t level, uint32_t x, uint32_t y) {
    return lw_atlas_map_find(&w->map, 0, level, x, y).v;
}

/* What lies beside the picture is surveyed at the level that it would need in it; the picture's own needs
 * stay. */
static void test_survey(void **state) {
    (void)state;
    struct world w;
    world_init(&w, squares(1, 2048, false)); /* tiles of 1/8 m, 1/4 m, 1/2 m */
    fill_by_level(&w, 0, 1);
    struct lw_compose_view view = view_towards(0.6f, 1, 0.6f, 0.6f, 0, 0.6f, 50);
    view.width = 512, view.height = 384;
    float *rgb = malloc((size_t)view.width * view.height * 3 * sizeof *rgb);
    uint8_t *needed = malloc(w.map.tile_count);
    assert_true(rgb && needed);
    render(&w, &view, rgb);
    memcpy(needed, lw_compose_needed(w.compose), w.map.tile_count);
    lw_compose_survey(w.compose, &w.source, &w.pose, &view);
    const uint8_t *around = lw_compose_around(w.compose);
    assert_memory_equal(needed, lw_compose_needed(w.compose), w.map.tile_count);
    uint32_t inside = 0, outside = 0, finest = UINT32_MAX;
    for (uint32_t t = 0; t < w.map.tile_count; t++)
        if (needed[t] && w.map.place[t].level < finest) finest = w.map.place[t].level;
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        if (needed[t]) assert_true(around[t]);
        if (!around[t]) continue;
        assert_true(w.map.place[t].level <= finest + 1); /* a small picture alone would ask for two coarser */
        inside += needed[t];
        outside += !needed[t];
    }
    assert_true(outside > inside / 4 && outside < 2 * inside);
    free(needed);
    free(rgb);
    world_finish(&w);
}

static void test_missing_tile(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(1, 128, false)); /* 2 x 2 tiles at level 0 */
    fill_by_level(&w, 0, 1);
    w.tile[tile_at(&w, 0, 1, 0)].version = 0; /* x > 0, z < 0 */
    struct lw_compose_view view = view_towards(0, 0.5f, 0, 0, 0, 0, 40);
    struct lw_compose_report report = render(&w, &view, rgb);
    assert_int_equal(report.tiles_needed, 4);
    assert_int_equal(report.tiles_missing, 1);
    assert_false(report.complete || report.converged);
    assert_true(lw_compose_needed(w.compose)[tile_at(&w, 0, 1, 0)]);
    assert_false(lw_compose_needed(w.compose)[tile_at(&w, 1, 0, 0)]);
    const float half_texel_m = 0.5f * SIDE_M / 128;
    int coarse = 0, fine = 0;
    struct lw_camera_plane plane = lw_camera_plane(&view.camera, WIDTH, HEIGHT);
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++) {
            struct lw_vec3 dir = lw_camera_direction(&plane, (float)x + 0.5f, (float)y + 0.5f);
            struct lw_vec3 p = lw_vec3_mad(view.camera.position, dir, -view.camera.position.y / dir.y);
            /* a lookup whose four texels touch the missing tile reads the level above as a whole */
            bool touches = p.x >= -half_texel_m && p.z < half_texel_m;
            assert_near(rgb[3 * ((size_t)y * WIDTH + x)], 0.5f * (touches ? 2.0f : 1.0f) / LW_PI, 1e-6f);
            coarse += touches, fine += !touches;
        }
    assert_true(coarse > 50 && fine > 50);

    w.tile[tile_at(&w, 1, 0, 0)].version = 0; /* then the next coarser one that is there */
    w.tile[tile_at(&w, 2, 0, 0)].version = 0;
    render(&w, &view, rgb);
    assert_near(rgb[3 * (WIDTH - 1)], 0.5f * 4 / LW_PI, 1e-6f);
    world_finish(&w);
}

static void test_noisy_tiles_are_read_coarser(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(1, 64, false));
    fill_by_level(&w, 0, 1); /* level k holds k + 1 */
    struct lw_compose_view view = view_towards(0, 0.5f, 0, 0, 0, 0, 40);
    const float error[] = {0.05f, 0.2f, 0.9f};
    for (int k = 0; k < 3; k++) {
        w.tile[tile_at(&w, 0, 0, 0)].error = error[k];
        struct lw_compose_report report = render(&w, &view, rgb);
        assert_near(rgb[0], 0.5f * (float)(1 + k) / LW_PI, 1e-6f);
        assert_true(report.complete && report.tiles_needed == 1); /* what the view needs stays the fine one */
    }
    w.source.noise_shown = 0.2f; /* the filter leaves less to be seen */
    render(&w, &view, rgb);
    assert_near(rgb[0], 0.5f * 2 / LW_PI, 1e-6f);
    w.source.noise_shown = 1;
    /* for those who measure, the fine one is read, too */
    struct lw_error err = {0};
    lw_compose_destroy(w.compose);
    lw_support_ok(
        lw_compose_create(
            &(struct lw_compose_desc){.scene = w.scene, .map = &w.map, .trace = w.trace, .unfiltered = true},
            &w.compose, &err),
        &err);
    render(&w, &view, rgb);
    assert_near(rgb[0], 0.5f / LW_PI, 1e-6f);
    world_finish(&w);
}

/* What a picture shows of its tiles' errors: by pixels, by what the filter leaves, by the level that is
 * read. */
static void test_shown_error(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(2, 64, false));
    fill_constant(&w, 0, 3), fill_constant(&w, 1, 3);
    struct lw_compose_view view = view_down(); /* on object 0 */
    w.source.noise_shown = 0.5f;
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.04f;
    struct lw_compose_report report = render(&w, &view, rgb);
    assert_near(report.shown_error, 0.02f, 1e-3f);
    assert_true(report.complete && report.good && !report.converged && report.tiles_noisy > 0);
    for (uint32_t t = w.map.first_tile[1]; t < w.map.tile_count; t++) w.tile[t].error = 1; /* not in view */
    report = render(&w, &view, rgb);
    assert_near(report.shown_error, 0.02f, 1e-3f);
    for (uint32_t t = 0; t < w.map.first_tile[1]; t++) w.tile[t].error = 0.1f;
    lw_compose_check(w.compose, &w.source, &report); /* without a ray */
    assert_near(report.shown_error, 0.05f, 1e-3f);
    assert_true(report.complete && !report.good);
    /* beyond what views bear they read coarser texels, which have less of it */
    for (uint32_t t = 0; t < w.map.first_tile[1]; t++) w.tile[t].error = 1;
    lw_compose_check(w.compose, &w.source, &report);
    assert_near(report.shown_error, 0.125f, 1e-3f);
    for (uint32_t t = 0; t < w.map.first_tile[1]; t++) w.tile[t].error = NAN;
    lw_compose_check(w.compose, &w.source, &report);
    assert_near(report.shown_error, 1, 1e-3f);
    /* a survey, which nobody sees, changes nothing */
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.04f;
    lw_compose_survey(w.compose, &w.source, &w.pose, &view);
    lw_compose_check(w.compose, &w.source, &report);
    assert_near(report.shown_error, 0.02f, 1e-3f);
    /* a target above it: converged is good */
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.1f;
    w.source.target_error = 0.2f;
    lw_compose_check(w.compose, &w.source, &report);
    assert_true(report.converged && report.good && report.shown_error > LW_COMPOSE_GOOD_ERROR);
    for (uint32_t t = 0; t < w.map.first_tile[1]; t++) w.tile[t].version = 0;
    lw_compose_check(w.compose, &w.source, &report);
    assert_near(report.shown_error, 1, 1e-3f);
    assert_false(report.good);
    world_finish(&w);

    /* what a surface emits is exact: half of this pixel's light is the tile's */
    struct lw_scene *scene = squares(1, 64, false);
    for (int c = 0; c < 3; c++) scene->material[0].emission[c] = 0.5f * 3.0f / LW_PI;
    world_init(&w, scene);
    fill_constant(&w, 0, 3);
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.08f;
    report = render(&w, &view, rgb);
    assert_near(report.shown_error, 0.04f, 1e-2f);
    world_finish(&w);
}

static void test_render_more(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3], other[WIDTH * HEIGHT * 3], listed[WIDTH * HEIGHT * 3];
    uint32_t list[WIDTH * HEIGHT];
    world_init(&w, squares(1, 64, false));
    for (size_t i = 0; i < (size_t)64 * 64 * 3; i++) w.rgb[0][i] = 1 + (float)(i % 97);
    struct lw_compose_view view = view_towards(0.3f, 1.5f, 0.2f, 0, 0, 0, 90);
    struct lw_compose_report report = render(&w, &view, rgb);
    view.offset_x = 0.25f, view.offset_y = -0.375f;
    render(&w, &view, other);
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) list[i] = i * 7 % (WIDTH * HEIGHT); /* no order */
    const uint32_t needed = report.tiles_needed;
    lw_compose_render_more(w.compose, &view, list, WIDTH * HEIGHT - 5, listed);
    for (uint32_t i = 0; i < WIDTH * HEIGHT - 5; i++)
        for (size_t c = 0; c < 3; c++) assert_near(listed[3 * i + c], other[3 * (size_t)list[i] + c], 1e-4f);
    lw_compose_check(w.compose, &w.source, &report);
    assert_true(report.tiles_needed >= needed);
    lw_compose_render_more(w.compose, &view, list, 0, NULL); /* nothing asked, nothing done */
    world_finish(&w);
}

static void test_nothing_there(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(2, 128, false));
    fill_by_level(&w, 0, 1);
    fill_constant(&w, 1, 7);
    struct lw_compose_view view = view_down(); /* on object 0 */
    for (uint32_t t = 0; t < w.map.atlas[0]->tile_count; t++) w.tile[t].version = 0;
    struct lw_compose_report report = render(&w, &view, rgb);
    assert_picture(rgb, 0.5f * 7 / LW_PI); /* the average of the tiles that are there */
    assert_int_equal(report.tiles_missing, report.tiles_needed);
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].version = 0;
    render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) assert_true(rgb[i] > 0.01f); /* never black */

    w.tile[tile_at(&w, 0, 0, 0)].version = 1; /* finer than needed serves too, where nothing coarser is */
    w.tile[tile_at(&w, 0, 1, 0)].version = 1;
    w.tile[tile_at(&w, 0, 0, 1)].version = 1;
    w.tile[tile_at(&w, 0, 1, 1)].version = 1;
    view = view_towards(0, 2, 0, 0, 0, 0, 40);
    render(&w, &view, rgb);
    assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * 1 / LW_PI, 1e-6f);
    world_finish(&w);
}

static void test_garbage_texels(void **state) {
    (void)state;
    const float garbage[] = {NAN, INFINITY, -1.0f};
    for (size_t i = 0; i < 3; i++) {
        struct world w;
        float rgb[WIDTH * HEIGHT * 3];
        world_init(&w, squares(1, 64, false));
        fill_by_level(&w, 0, 1);
        fill_level(&w, 0, 0, garbage[i]);
        struct lw_compose_view view = view_down();
        render(&w, &view, rgb);
        assert_picture(rgb, 0.5f * 2 / LW_PI); /* the level above */
        fill_level(&w, 0, w.map.atlas[0]->level_count - 1, garbage[i]);
        for (uint32_t k = 0; k < w.map.atlas[0]->level_count; k++) fill_level(&w, 0, k, garbage[i]);
        render(&w, &view, rgb); /* asserts that all is finite */
        world_finish(&w);
    }
}

static void test_backs(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(1, 64, false));
    fill_constant(&w, 0, 3);
    struct lw_compose_view from_below = view_towards(0, -1, 0, 0, 0, 0, 40);
    render(&w, &from_below, rgb);
    assert_float_equal(rgb[0], 0.25f, 0); /* the back of a single-sided surface is not there: sky */
    world_finish(&w);

    struct lw_scene *scene = squares(1, 64, true);
    scene->material[0].emission[1] = 2;
    world_init(&w, scene);
    for (uint32_t k = 0; k < w.map.atlas[0]->level_count; k++) {
        const struct lw_atlas_level *l = &w.map.atlas[0]->level[k];
        for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++)
            w.rgb[k][i] = i / 3 / l->width < l->height / 2 ? 3.0f : 5.0f;
    }
    struct lw_compose_view from_above = view_down();
    render(&w, &from_above, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        assert_near(rgb[3 * i], 0.5f * 3 / LW_PI, 1e-6f);
        assert_near(rgb[3 * i + 1], 0.5f * 3 / LW_PI + 2, 1e-6f);
    }
    render(&w, &from_below, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        assert_near(rgb[3 * i], 0.5f * 5 / LW_PI, 1e-6f);
        assert_near(rgb[3 * i + 1], 0.5f * 5 / LW_PI + 2, 1e-6f);
    }
    world_finish(&w);
}

static void test_blend(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    struct lw_scene *scene = squares(3, 64, false);
    stack(scene);
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.25f;
    scene->material[0].emission[0] = 0.5f;
    world_init(&w, scene);
    for (uint32_t o = 0; o < 3; o++) fill_constant(&w, o, (float)(o + 1));
    struct lw_compose_view view = view_towards(0, 3, 0, 0, 0, 0, 20);
    render(&w, &view, rgb);
    for (int c = 0; c < 3; c++) {
        float expected = 0, passes = 1, sky[3] = {0.25f, 0.5f, 1.0f};
        for (int o = 2; o >= 0; o--, passes *= 0.75f)
            expected += passes * 0.25f * (0.5f * (float)(o + 1) / LW_PI + (c == 0 ? 0.5f : 0));
        expected += passes * sky[c];
        for (size_t i = 0; i < WIDTH * HEIGHT; i++) assert_near(rgb[3 * i + (size_t)c], expected, 1e-5f);
    }
    world_finish(&w);
}

static void test_blend_is_bounded(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    struct lw_scene *scene = squares(LW_COMPOSE_LAYERS_MAX + 4, 64, false);
    stack(scene);
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.125f;
    world_init(&w, scene);
    for (uint32_t o = 0; o < scene->object_count; o++) fill_constant(&w, o, 2);
    struct lw_compose_view view = view_towards(0, 24, 0, 0, 0, 0, 4);
    render(&w, &view, rgb);
    /* the last layer takes all that is left: as if all were opaque */
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) assert_near(rgb[i], 0.5f * 2 / LW_PI, 1e-5f);
    world_finish(&w);
}

static void test_report(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    world_init(&w, squares(1, 128, false));
    fill_constant(&w, 0, 1);
    struct lw_compose_view view = view_towards(0, 0.5f, 0, 0, 0, 0, 40);
    w.tile[tile_at(&w, 1, 0, 0)].version = 0; /* not needed: does not count */
    struct lw_compose_report report = render(&w, &view, rgb);
    assert_true(report.complete && report.converged);
    assert_float_equal(report.max_error, 0.01f, 0);
    w.tile[tile_at(&w, 0, 1, 1)].error = 0.03f;
    lw_compose_check(w.compose, &w.source, &report);
    assert_true(report.complete && !report.converged);
    assert_int_equal(report.tiles_noisy, 1);
    assert_float_equal(report.max_error, 0.03f, 0);
    w.tile[tile_at(&w, 0, 0, 1)].bounces = BOUNCES - 1;
    lw_compose_check(w.compose, &w.source, &report);
    assert_false(report.complete);
    assert_int_equal(report.tiles_unfinished, 1);
    world_finish(&w);
}

/* ---- finer levels ---- */

/* Texels of level 0 are 1 and 3 in turn: nowhere it is even. */
static void fill_checkered(struct world *w) {
    const struct lw_atlas_level *l = &w->map.atlas[0]->level[0];
    for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++)
        w->rgb[0][i] = (i / 3 % l->width + i / 3 / l->width) % 2 ? 3 : 1;
}

/* A tile of the finest level that the last render asked for; how many there are. */
static uint32_t asked_for(const struct world *w, lw_tile_id *out_id) {
    uint32_t count = 0;
    for (uint32_t t = w->map.plain_count; t < w->map.tile_count; t++)
        if (lw_compose_needed(w->compose)[t]) *out_id = (lw_tile_id){t}, count++;
    return count;
}

/* Close by, a view asks for a finer level where level 0 is uneven; level 0 stands in for it, and is what the
 * view waits for. A tile that is there is read, asked for or not, unless it is noisy. */
static void test_finer_levels_are_asked_for_and_read(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    static float fine[LW_TILE_TEXELS_MAX * 3];
    lw_tile_id id = {0};
    for (size_t i = 0; i < sizeof fine / sizeof *fine; i++) fine[i] = 7;
    world_init_finer(&w, squares(1, 16, false), 2);
    fill_checkered(&w);
    struct lw_compose_view view = view_towards(0, 0.5f, 0, 0, 0, 0, 20);
    struct lw_compose_report report = render(&w, &view, rgb);
    assert_int_equal(asked_for(&w, &id), 1); /* 64 x 64 texels */
    assert_int_equal(w.map.place[id.v].level, LW_ATLAS_FINER + 2);
    assert_true(report.complete && !report.converged);
    const lw_tile_id below = lw_atlas_map_below(&w.map, id);
    w.tile[below.v].version = 0;
    lw_compose_check(w.compose, &w.source, &report);
    assert_false(report.complete);
    w.tile[below.v].version = 1;
    w.tile[id.v] = (struct lw_client_tile){.version = 1, .bounces = BOUNCES, .error = 0.01f, .rgb = fine};
    report = render(&w, &view, rgb);
    assert_true(report.complete && report.converged);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) assert_near(rgb[i], 0.5f * 7 / LW_PI, 1e-5f);
    fill_level(&w, 0, 0, 2); /* even: nobody asks, but it is there */
    render(&w, &view, rgb);
    assert_int_equal(asked_for(&w, &id), 0);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) assert_near(rgb[i], 0.5f * 7 / LW_PI, 1e-5f);
    w.tile[id.v].error = 0.5f;
    render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) assert_near(rgb[i], 0.5f * 2 / LW_PI, 1e-5f);
    world_finish(&w);
}

/* Across the edge of two tiles light goes over from one to the next; where one lacks, the next coarser
 * level is read instead. */
static void test_finer_tiles_side_by_side(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    static float fine[2][LW_TILE_TEXELS_MAX * 3];
    for (size_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++) fine[0][i] = 4, fine[1][i] = 8;
    world_init_finer(&w, squares(1, 64, false), 1);
    fill_checkered(&w);
    for (uint32_t y = 0; y < 2; y++)
        for (uint32_t x = 0; x < 2; x++)
            w.tile[lw_atlas_map_claim(&w.map, 0, LW_ATLAS_FINER + 1, x, y).v] =
                (struct lw_client_tile){.version = 1, .bounces = BOUNCES, .error = 0.01f, .rgb = fine[x]};
    struct lw_compose_view view = view_towards(0, 0.6f, 0, 0, 0, 0, 10);
    render(&w, &view, rgb);
    uint32_t between = 0;
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) {
        const float e = rgb[i] * LW_PI / 0.5f;
        assert_true(e > 4 - 1e-3f && e < 8 + 1e-3f);
        between += e > 4.01f && e < 7.99f;
    }
    assert_true(between > HEIGHT * 3 && between < WIDTH * HEIGHT);
    w.tile[lw_atlas_map_find(&w.map, 0, LW_ATLAS_FINER + 1, 1, 0).v] = (struct lw_client_tile){0};
    render(&w, &view, rgb);
    uint32_t coarse = 0;
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) coarse += rgb[i] * LW_PI / 0.5f < 3.01f;
    assert_true(coarse > WIDTH * HEIGHT / 4);
    world_finish(&w);
}

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    struct world w;
    struct lw_scene *scene = squares(5, 256, true);
    stack(scene);
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.5f;
    world_init(&w, scene);
    for (uint32_t i = 0; i < scene->object_count * LW_ATLAS_LEVELS_MAX; i++) {
        uint32_t o = i / LW_ATLAS_LEVELS_MAX, k = i % LW_ATLAS_LEVELS_MAX;
        if (k >= w.map.atlas[o]->level_count) continue;
        const struct lw_atlas_level *l = &w.map.atlas[o]->level[k];
        for (uint32_t j = 0; j < l->width * l->height * 3; j++)
            w.rgb[i][j] = lw_random_unit(lw_random_hash2(i, j));
    }
    for (uint32_t t = 0; t < w.map.tile_count; t += 3) w.tile[t].version = 0;
    struct lw_compose_view view = view_towards(3, 5, 6, 0, 1, 0, 60);
    view.width = 301, view.height = 203;
    size_t size = (size_t)view.width * view.height * 3 * sizeof(float);
    float *one = malloc(size), *more = malloc(size);
    uint8_t *needed = malloc(w.map.tile_count);
    assert_true(one && more && needed);
    struct lw_compose_report report = render(&w, &view, one);
    memcpy(needed, lw_compose_needed(w.compose), w.map.tile_count);
    for (unsigned threads = 2; threads <= 5; threads++) {
        make_compose(&w, threads);
        struct lw_compose_report other = render(&w, &view, more);
        assert_memory_equal(one, more, size);
        assert_memory_equal(needed, lw_compose_needed(w.compose), w.map.tile_count);
        assert_int_equal(report.tiles_missing, other.tiles_missing);
    }
    free(needed);
    free(more);
    free(one);
    world_finish(&w);
}

/* Half a pixel's offset is the ray of a picture twice as large. */
static void test_offset(void **state) {
    (void)state;
    struct world w;
    float small[WIDTH * HEIGHT * 3], *large = malloc(sizeof small * 4);
    assert_non_null(large);
    world_init(&w, squares(1, 64, false));
    fill_ramps(&w);
    struct lw_compose_view view = view_down();
    view.offset_x = -0.25f, view.offset_y = 0.25f;
    render(&w, &view, small);
    view.offset_x = view.offset_y = 0;
    view.width *= 2, view.height *= 2;
    render(&w, &view, large);
    for (size_t y = 0; y < HEIGHT; y++)
        for (size_t x = 0; x < WIDTH; x++)
            assert_near(small[3 * (y * WIDTH + x)], large[3 * ((2 * y + 1) * 2 * WIDTH + 2 * x)], 1e-5f);
    free(large);
    world_finish(&w);
}

/* ---- mirrors ---- */

/* Squares of a white metal, lit from both sides: object o's back has o's light. */
static void metal_squares(struct world *w, unsigned count, float roughness) {
    struct lw_scene *scene = squares(count, 64, true);
    lw_support_finish(scene, 0, 1, roughness);
    for (int c = 0; c < 4; c++) scene->material[0].base_colour[c] = 1;
    stack(scene);
    world_init(w, scene);
    w->source.sky = lw_vec3(0, 0, 0);
    for (uint32_t o = 0; o < count; o++) fill_constant(w, o, 1 + 2 * (float)o);
}

/* The floor mirrors the square over it. The smoother it is, the less of its own light is left. */
static void test_mirrors(void **state) {
    (void)state;
    static const struct {
        float roughness, share;
    } cases[] = {{0, 1}, {0.2f, 1}, {0.325f, 0.5f}, {0.4f, 0}, {0.8f, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct world w;
        float rgb[WIDTH * HEIGHT * 3];
        metal_squares(&w, 2, cases[i].roughness);
        struct lw_compose_view view = view_towards(0, 0.5f, 0, 0, 0, 0, 40);
        render(&w, &view, rgb);
        for (size_t p = 0; p < WIDTH * HEIGHT * 3; p++) assert_near(rgb[p], 1 / LW_PI, 0.02f);
        view.mirrors = true;
        render(&w, &view, rgb);
        for (size_t p = 0; p < WIDTH * HEIGHT * 3; p++)
            assert_near(rgb[p], (1 + 2 * cases[i].share) / LW_PI, 0.02f);
        view.show = LW_SHOW_IRRADIANCE;
        render(&w, &view, rgb);
        for (size_t p = 0; p < WIDTH * HEIGHT * 3; p++) assert_near(rgb[p], 1 / LW_PI, 0.02f);
        world_finish(&w);
    }
}

/* A mirror that nothing is over shows the sky; the tiles that it shows are needed. */
static void test_mirrors_of_what_is_there(void **state) {
    (void)state;
    struct world w;
    float rgb[WIDTH * HEIGHT * 3];
    metal_squares(&w, 1, 0.1f);
    w.source.sky = lw_vec3(0.5f, 0.5f, 0.5f);
    struct lw_compose_view view = view_towards(0, 0.5f, 0, 0, 0, 0, 40);
    view.mirrors = true;
    render(&w, &view, rgb);
    for (size_t p = 0; p < WIDTH * HEIGHT * 3; p++) assert_near(rgb[p], 0.5f, 0.02f);
    world_finish(&w);
    metal_squares(&w, 2, 0.1f);
    for (unsigned with = 0; with < 2; with++) {
        uint32_t above = 0;
        view.mirrors = with;
        render(&w, &view, rgb);
        for (uint32_t t = 0; t < w.map.tile_count; t++)
            above += w.map.place[t].object == 1 && lw_compose_needed(w.compose)[t];
        assert_int_equal(above > 0, with);
    }
    world_finish(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_constant),
        cmocka_unit_test(test_emission_and_albedo),
        cmocka_unit_test(test_unlit),
        cmocka_unit_test(test_parallel),
        cmocka_unit_test(test_tint),
        cmocka_unit_test(test_many_small_triangles),
        cmocka_unit_test(test_sky),
        cmocka_unit_test(test_environment),
        cmocka_unit_test(test_ramps),
        cmocka_unit_test(test_level_follows_the_footprint),
        cmocka_unit_test(test_charts_that_share_blocks_are_read_at_level_0),
        cmocka_unit_test(test_level_ignores_the_scale_across_the_surface),
        cmocka_unit_test(test_missing_tile),
        cmocka_unit_test(test_survey),
        cmocka_unit_test(test_noisy_tiles_are_read_coarser),
        cmocka_unit_test(test_shown_error),
        cmocka_unit_test(test_render_more),
        cmocka_unit_test(test_nothing_there),
        cmocka_unit_test(test_garbage_texels),
        cmocka_unit_test(test_backs),
        cmocka_unit_test(test_blend),
        cmocka_unit_test(test_blend_is_bounded),
        cmocka_unit_test(test_report),
        cmocka_unit_test(test_finer_levels_are_asked_for_and_read),
        cmocka_unit_test(test_finer_tiles_side_by_side),
        cmocka_unit_test(test_same_bytes_at_any_thread_count),
        cmocka_unit_test(test_mirrors),
        cmocka_unit_test(test_mirrors_of_what_is_there),
        cmocka_unit_test(test_offset),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
