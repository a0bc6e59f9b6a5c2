/* Tiles of finer levels by OpenGL: the picture and the needed tiles against the composer's, and the pool. */
#include "tests/support/support.h"

#include "client/camera/camera.h"
#include "client/gl/gl_fine_tiles.h"
#include "client/gl/gl_offscreen.h"
#include "client/gl/gl_renderer.h"

#include <epoxy/gl.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 480, HEIGHT = 270, VALUES = WIDTH * HEIGHT * 3 };
enum { FINER = 2, LEVELS = LW_ATLAS_LEVELS_MAX + FINER, OBJECTS = 2 };

#define TEXELS 60.0f         /* on a side of a square */
#define SMALL  2.5f          /* the same for the small square of the same mesh */
#define SIDE   64u           /* side of its atlas */
#define SECOND 1000000000ull /* ns */

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
    float *rgb[OBJECTS][LEVELS];
    struct lw_client_tile *tile; /* per id; of finer levels without their texels: */
    float **cut;
};

static const struct lw_atlas_level *level_of(const struct world *w, uint32_t o, uint32_t k) {
    const uint32_t number = k < LW_ATLAS_LEVELS_MAX ? k : k - LW_ATLAS_LEVELS_MAX + 1 + LW_ATLAS_FINER;
    return lw_atlas_level(w->map.atlas[o], number);
}

static struct lw_client_level level(const void *context, uint32_t object, uint32_t number) {
    const struct world *w = context;
    const struct lw_atlas_level *l = lw_atlas_level(w->map.atlas[object], number);
    const uint32_t finer = lw_atlas_finer(number), at = finer ? LW_ATLAS_LEVELS_MAX + finer - 1 : number;
    return (struct lw_client_level){.width = l->width, .height = l->height, .rgb = w->rgb[object][at]};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    const struct world *w = context;
    struct lw_client_tile is = w->tile[id.v];
    if (is.version) is.rgb = w->cut[id.v];
    return is;
}

static float random_of(uint32_t a, uint32_t b) {
    return (float)((a * 2654435761u ^ b * 2246822519u) * 3266489917u >> 16) / 65536;
}

/* Level 0 is a checkerboard, so that nowhere it is even; finer ones differ from it and from each other in all
 * texels. `even`: each level is of one value. */
static void fill(struct world *w, uint32_t o, uint32_t k, bool even) {
    const struct lw_atlas_level *l = level_of(w, o, k);
    float *rgb = w->rgb[o][k] = calloc((size_t)l->width * l->height * 3, sizeof *rgb);
    assert_non_null(rgb);
    const bool finer = k >= LW_ATLAS_LEVELS_MAX;
    for (uint32_t y = 0; y < l->height; y++)
        for (uint32_t x = 0; x < l->width; x++, rgb += 3) {
            const float value = even    ? 2
                                : finer ? (float)(k - LW_ATLAS_LEVELS_MAX + 3) + random_of(x + 977 * o, y)
                                        : (float)(1 + (x + y) % 2);
            rgb[0] = value, rgb[1] = 0.7f * value, rgb[2] = 1.3f * value;
        }
}

/* Two objects of a mesh of two squares, a large one and a small one beside it. The small one's material is
 * the first, so it is drawn first. */
static struct lw_scene *make_scene(void) {
    struct lw_scene *scene = lw_support_squares(OBJECTS, 1);
    struct lw_mesh *mesh = &scene->mesh[0];
    struct lw_vec3 *position = lw_scene_alloc(scene, 8, sizeof *position),
                   *normal = lw_scene_alloc(scene, 8, sizeof *normal);
    struct lw_vec2 *uv = lw_scene_alloc(scene, 8, sizeof *uv), *map_uv = lw_scene_alloc(scene, 8, sizeof *uv);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 4, sizeof *triangle);
    for (uint32_t i = 0; i < 8; i++) {
        const struct lw_vec3 p = mesh->position[i % 4];
        const struct lw_vec2 at = mesh->uv[0][i % 4];
        const float small_m = SMALL / TEXELS;
        position[i] = i < 4 ? p : lw_vec3(0.55f + small_m * at.x, 0, small_m * (at.y - 0.5f));
        map_uv[i] = i < 4 ? (struct lw_vec2){TEXELS * at.x, TEXELS * at.y}
                          : (struct lw_vec2){61 + SMALL * at.x, 61 + SMALL * at.y};
        uv[i] = at;
        normal[i] = lw_vec3(0, 1, 0);
    }
    for (uint32_t t = 0; t < 4; t++)
        for (int c = 0; c < 3; c++) triangle[t][c] = mesh->triangle[t % 2][c] + 4 * (t / 2);
    mesh->position = position, mesh->normal = normal, mesh->uv[0] = uv, mesh->lightmap_uv = map_uv;
    mesh->triangle = triangle;
    const struct lw_material grey = scene->material[0];
    scene->material = lw_scene_alloc(scene, 2, sizeof *scene->material);
    scene->material[0] = scene->material[1] = grey;
    scene->material_count = 2;
    uint32_t *material = lw_scene_alloc(scene, 4, sizeof *material);
    material[0] = material[1] = 1;
    mesh->material = material;
    mesh->vertex_count = 8, mesh->triangle_count = 4;
    mesh->atlas_width = mesh->atlas_height = SIDE;
    scene->node[1].translation[0] =
        1.25f; /* turned by half a turn, so that its small square is beside the other */
    scene->node[1].rotation[1] = 1, scene->node[1].rotation[3] = 0;
    return scene;
}

static void start_renderer(struct world *w, const struct lw_atlas_map *map) {
    struct lw_error err = {0};
    lw_gl_renderer_destroy(w->renderer);
    w->renderer = NULL;
    lw_support_ok(
        lw_gl_renderer_create(&(struct lw_gl_renderer_desc){.scene = w->scene, .map = map, .exact = true},
                              &w->renderer, &err),
        &err);
}

/* Every tile of the finer levels has an id, in the order of their names. */
static void name_all(struct world *w) {
    lw_support_ok(lw_atlas_map_init_finer(&w->map, w->scene, FINER, 1), NULL);
    const uint32_t names = (uint32_t)w->map.fine_names;
    lw_atlas_map_finish(&w->map);
    lw_support_ok(lw_atlas_map_init_finer(&w->map, w->scene, FINER, names), NULL);
    for (uint32_t i = 0; i < names; i++)
        assert_int_equal(lw_atlas_map_claim_name(&w->map, i).v, w->map.plain_count + i);
}

/* The texels of the tiles of finer levels, each by itself. */
static void cut_tiles(struct world *w) {
    assert_non_null(w->cut = calloc(w->map.tile_count, sizeof *w->cut));
    for (uint32_t t = w->map.plain_count; t < w->map.tile_count; t++) {
        const struct lw_tile_place *p = &w->map.place[t];
        const struct lw_client_level l = level(w, p->object, p->level);
        assert_non_null(w->cut[t] = malloc((size_t)p->width * p->height * 3 * sizeof(float)));
        for (uint32_t y = 0; y < p->height; y++)
            memcpy(w->cut[t] + 3ul * y * p->width,
                   l.rgb + 3 * ((size_t)(p->y * LW_TILE_SIDE + y) * l.width + p->x * LW_TILE_SIDE),
                   p->width * 3 * sizeof(float));
    }
}

/* From close above the first object's edge towards the second one: levels -2 to 0 are in the picture. */
static void start(struct world *w, bool even) {
    struct lw_error err = {0};
    *w = (struct world){.scene = make_scene(), .view = {.width = WIDTH, .height = HEIGHT}};
    lw_support_ok(lw_pose_init(&w->pose, w->scene), NULL);
    name_all(w);
    lw_support_ok(lw_trace_create(w->scene, &w->pose, &w->trace, &err), &err);
    w->tile = calloc(w->map.tile_count, sizeof *w->tile);
    assert_non_null(w->tile);
    for (uint32_t o = 0; o < OBJECTS; o++)
        for (uint32_t k = 0; k < LEVELS; k++)
            if (k >= LW_ATLAS_LEVELS_MAX || k < w->map.atlas[o]->level_count) fill(w, o, k, even);
    for (uint32_t t = 0; t < w->map.tile_count; t++) w->tile[t] = (struct lw_client_tile){.version = 1};
    cut_tiles(w);
    w->source = (struct lw_compose_source){.context = w, .level = level, .tile = tile, .noise_shown = 1};
    w->view.camera = lw_camera_look_at(lw_vec3(-0.35f, 0.22f, 0), lw_vec3(0, 0, 0.05f), 0.9f);
    lw_support_ok(
        lw_compose_create(
            &(struct lw_compose_desc){.scene = w->scene, .map = &w->map, .trace = w->trace, .threads = 1},
            &w->compose, &err),
        &err);
    if (lw_gl_offscreen_create(&w->offscreen, &err) != LW_OK) {
        print_message("no OpenGL here, so it is not tested: %s\n", err.text);
        skip();
    }
    start_renderer(w, &w->map);
}

static void world_finish(struct world *w) {
    lw_gl_renderer_destroy(w->renderer);
    lw_gl_offscreen_destroy(w->offscreen);
    lw_compose_destroy(w->compose);
    for (uint32_t o = 0; o < OBJECTS; o++)
        for (uint32_t k = 0; k < LEVELS; k++) free(w->rgb[o][k]);
    for (uint32_t t = 0; t < w->map.tile_count; t++) free(w->cut[t]);
    free(w->cut);
    free(w->tile);
    lw_trace_destroy(w->trace);
    lw_atlas_map_finish(&w->map);
    lw_pose_finish(&w->pose);
    lw_scene_destroy(w->scene);
}

/* now_ns: as of lw_gl_renderer_take(). Returns what waits. */
static uint32_t draw(struct world *w, uint64_t now_ns, float *out_rgb) {
    struct lw_error err = {0};
    uint32_t waiting;
    lw_support_ok(lw_gl_renderer_take(w->renderer, &w->source, &w->pose, 0, now_ns, &waiting, &err), &err);
    lw_support_ok(lw_gl_renderer_draw(w->renderer, &w->view, 1, &err), &err);
    lw_support_ok(lw_gl_renderer_read(w->renderer, out_rgb, &err), &err);
    return waiting;
}

static void compose(struct world *w, float *out_rgb) {
    struct lw_compose_report report;
    lw_compose_render(w->compose, &w->source, &w->pose, &w->view, out_rgb, &report);
}

/* Share of the values that are farther apart than RGB9E5 explains: a step of the largest channel is at most
 * 1/256 of it, and a look-up of 8 bits of weight is off by 1/256 of what it mixes. */
static double share_apart(const float *a, const float *b) {
    size_t apart = 0;
    for (size_t i = 0; i < VALUES; i++) apart += fabsf(a[i] - b[i]) > 0.012f * fmaxf(a[i], b[i]) + 1e-6f;
    return (double)apart / VALUES;
}

static double mean_of(const float *rgb) {
    double sum = 0;
    for (size_t i = 0; i < VALUES; i++) sum += (double)rgb[i];
    return sum / VALUES;
}

static bool is_finer(const struct world *w, uint32_t t) { return t >= w->map.plain_count; }

static void set_finer(struct world *w, struct lw_client_tile to) {
    for (uint32_t t = w->map.plain_count; t < w->map.tile_count; t++) w->tile[t] = to;
}

/* All tiles are there; then a third of the finer ones lacks, and another third is too noisy. */
static void test_same_picture(void **state) {
    (void)state;
    struct world w;
    static float by_cpu[VALUES], by_gl[VALUES], without[VALUES];
    start(&w, false);
    compose(&w, by_cpu);
    assert_int_equal(draw(&w, 0, by_gl), 0);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).fine_tiles, lw_atlas_map_room(&w.map));
    set_finer(&w, (struct lw_client_tile){0});
    compose(&w, without);
    print_message("finer levels: %.4f of the values differ by OpenGL, %.4f without them\n",
                  share_apart(by_cpu, by_gl), share_apart(by_cpu, without));
    assert_true(share_apart(by_cpu, by_gl) < 0.01);
    assert_true(share_apart(by_cpu, without) > 0.4);

    for (uint32_t t = w.map.plain_count; t < w.map.tile_count; t++)
        w.tile[t] = (struct lw_client_tile){.version = t % 3 ? 2 : 0, .error = t % 3 == 1 ? 0.2f : 0};
    static float part[VALUES];
    compose(&w, part);
    draw(&w, 0, by_gl);
    print_message("a third of the tiles: %.4f differ by OpenGL, %.4f from all\n", share_apart(part, by_gl),
                  share_apart(part, by_cpu));
    assert_true(share_apart(part, by_gl) < 0.02); /* the tiles' edges are half a texel wider by OpenGL */
    assert_true(share_apart(part, by_cpu) > 0.1 && share_apart(part, without) > 0.1);

    for (uint32_t t = w.map.plain_count; t < w.map.tile_count; t++)
        w.tile[t] = (struct lw_client_tile){.version = w.map.place[t].object == 0 ? 3 : 0};
    compose(&w, part);
    draw(&w, 0, by_gl);
    print_message("tiles of one object: %.4f differ by OpenGL\n", share_apart(part, by_gl));
    assert_true(share_apart(part, by_gl) < 0.01);
    world_finish(&w);
}

/* Charts show the tiles that are read, as the composer's do. */
static void test_charts(void **state) {
    (void)state;
    struct world w;
    static float by_cpu[VALUES], by_gl[VALUES];
    start(&w, false);
    struct lw_vec3 *colour = calloc(w.map.tile_count, sizeof *colour);
    assert_non_null(colour);
    for (uint32_t t = 0; t < w.map.tile_count; t++)
        colour[t] = lw_vec3(random_of(t, 1), random_of(t, 2), random_of(t, 3));
    for (int show = LW_SHOW_TEXELS; show <= LW_SHOW_INTEREST; show++) {
        w.view.show = (enum lw_show)show, w.view.tile_colour = colour;
        compose(&w, by_cpu);
        draw(&w, 0, by_gl);
        print_message("%s: %.4f of the values differ\n", lw_show_name(w.view.show),
                      share_apart(by_cpu, by_gl));
        assert_true(share_apart(by_cpu, by_gl) < 0.04); /* along the edges of texels and levels */
    }
    free(colour);
    world_finish(&w);
}

/* A picture without a tile of finer levels has the bytes of one in a session without such levels. */
static void test_none(void **state) {
    (void)state;
    struct world w;
    struct lw_atlas_map plain;
    static float with[VALUES], without[VALUES];
    start(&w, false);
    set_finer(&w, (struct lw_client_tile){0});
    draw(&w, 0, with);
    lw_support_ok(lw_atlas_map_init(&plain, w.scene), NULL);
    start_renderer(&w, &plain);
    draw(&w, 0, without);
    assert_memory_equal(with, without, sizeof with);
    world_finish(&w);
    lw_atlas_map_finish(&plain);
}

/* A tile that comes or goes is seen by and by, and only the moments that the caller names count. */
static void test_fades(void **state) {
    (void)state;
    struct world w;
    static float before[VALUES], at[VALUES], after[VALUES];
    const uint64_t step = LW_GL_FINE_TILES_FADE / 4;
    const struct lw_client_tile there = {.version = 5};
    start(&w, false);
    const uint32_t finer = lw_atlas_map_room(&w.map);
    draw(&w, 0, after);
    set_finer(&w, (struct lw_client_tile){0});
    draw(&w, 0, before);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).fine_tiles, 0);
    const double low = mean_of(before), high = mean_of(after);
    assert_true(high > 1.5 * low);
    for (int goes = 0; goes < 2; goes++) {
        set_finer(&w, goes ? (struct lw_client_tile){0} : there);
        for (uint64_t i = 0; i <= 4; i++) {
            const uint32_t waiting = draw(&w, (goes ? 8 : 3) * SECOND + i * step, at);
            const double share = goes ? 1 - (double)i / 4 : (double)i / 4;
            print_message("%s, %d/4: %.3f\n", goes ? "goes" : "comes", (int)i,
                          (mean_of(at) - low) / (high - low));
            assert_true(fabs((mean_of(at) - low) / (high - low) - share) < 0.1); /* one level over another */
            assert_int_equal(waiting, i < 4 ? finer : 0);
        }
        assert_memory_equal(at, goes ? before : after, sizeof at);
        assert_int_equal(lw_gl_renderer_figures(w.renderer).fine_tiles, goes ? 0 : finer);
    }
    world_finish(&w);
}

/* Tiles whose ids are lost with their light fade out, too, with the texels that they had. */
static void test_withdrawn_tiles_fade_out(void **state) {
    (void)state;
    struct world w;
    static float before[VALUES], at[VALUES];
    const uint64_t step = LW_GL_FINE_TILES_FADE / 4;
    start(&w, false);
    const uint32_t finer = lw_atlas_map_room(&w.map);
    draw(&w, SECOND, before);
    draw(&w, 2 * SECOND, before);
    const double high = mean_of(before);
    set_finer(&w, (struct lw_client_tile){0});
    for (uint32_t t = w.map.plain_count; t < w.map.tile_count; t++)
        lw_atlas_map_release(&w.map, (lw_tile_id){t});
    assert_int_equal(draw(&w, 3 * SECOND, at), finer);
    assert_memory_equal(at, before, sizeof at);
    double last = high;
    for (uint64_t i = 1; i <= 4; i++) {
        assert_int_equal(draw(&w, 3 * SECOND + i * step, at), i < 4 ? finer : 0);
        print_message("withdrawn, %d/4: %.3f\n", (int)i, mean_of(at) / high);
        assert_true(mean_of(at) < 0.95 * last);
        last = mean_of(at);
    }
    start_renderer(&w, &w.map);
    draw(&w, 0, before);
    assert_memory_equal(at, before, sizeof at);
    world_finish(&w);
}

/* Where four tiles of the finest level meet. */
static void look_at_corner(struct world *w) {
    const float m = -0.5f + (float)SIDE / 2 / TEXELS;
    w->view.camera = lw_camera_look_at(lw_vec3(m, 0.15f, m + 0.01f), lw_vec3(m, 0, m), 0.9f);
}

/* Between tiles light is mixed as the composer mixes it. A border follows a neighbour that comes later: the
 * picture is that of a renderer which had all at once. */
static void test_borders(void **state) {
    (void)state;
    struct world w;
    static float by_cpu[VALUES], late[VALUES], at_once[VALUES];
    start(&w, false);
    look_at_corner(&w);
    compose(&w, by_cpu);
    for (uint32_t t = w.map.plain_count; t < w.map.tile_count; t++)
        w.tile[t].version = (w.map.place[t].x + w.map.place[t].y) % 2;
    draw(&w, 0, late);
    assert_true(share_apart(by_cpu, late) > 0.1);
    for (uint32_t t = w.map.plain_count; t < w.map.tile_count; t++) w.tile[t].version = 1;
    draw(&w, 0, late);
    start_renderer(&w, &w.map);
    draw(&w, 0, at_once);
    print_message("where tiles meet: %.4f of the values differ\n", share_apart(by_cpu, at_once));
    assert_true(share_apart(by_cpu, at_once) < 0.001);
    assert_memory_equal(late, at_once, sizeof late);
    world_finish(&w);
}

static PFNGLGETINTEGERVPROC real_get_integerv;

static void few_layers(GLenum name, GLint *out) {
    real_get_integerv(name, out);
    if (name == GL_MAX_ARRAY_TEXTURE_LAYERS) *out = 4;
}

/* Where the pool is full, a survey's tiles come into it. */
static void test_full(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    static float by_cpu[VALUES], by_gl[VALUES];
    start(&w, false);
    look_at_corner(&w);
    real_get_integerv = epoxy_glGetIntegerv;
    epoxy_glGetIntegerv = few_layers;
    start_renderer(&w, &w.map);
    epoxy_glGetIntegerv = real_get_integerv;
    uint8_t *needed = calloc(w.map.tile_count, 1);
    uint64_t *shown = calloc(w.map.tile_count, sizeof *shown), pixels;
    assert_true(needed && shown);
    compose(&w, by_cpu);
    draw(&w, 0, by_gl);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).fine_tiles, 4);
    assert_true(share_apart(by_cpu, by_gl) > 0.5);
    lw_support_ok(lw_gl_renderer_survey(w.renderer, &w.view, needed, shown, &pixels, &err), &err);
    draw(&w, 0, by_gl);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).fine_tiles, 4);
    assert_true(share_apart(by_cpu, by_gl) < 0.001);
    free(needed);
    free(shown);
    world_finish(&w);
}

/* Coarsest levels of other light, which nobody sees here, change the scale by which light is packed; the
 * picture stays. */
static void test_scale(void **state) {
    (void)state;
    struct world w;
    static float before[VALUES], after[VALUES];
    start(&w, false);
    draw(&w, 0, before);
    for (uint32_t o = 0; o < OBJECTS; o++) {
        const uint32_t k = w.map.atlas[o]->level_count - 1;
        const struct lw_atlas_level *l = level_of(&w, o, k);
        for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++) w.rgb[o][k][i] *= 4096;
        w.tile[lw_atlas_map_first(&w.map, o, k)].version++;
    }
    const uint64_t uploaded = lw_gl_renderer_figures(w.renderer).tiles_uploaded;
    draw(&w, 0, after);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).tiles_uploaded, uploaded + w.map.tile_count);
    assert_true(share_apart(before, after) == 0);
    world_finish(&w);
}

static void count_needed(struct world *w, const uint8_t *needed, uint32_t *out_both, uint32_t *out_one,
                         uint32_t *out_finer) {
    const uint8_t *by_cpu = lw_compose_needed(w->compose);
    *out_both = *out_one = *out_finer = 0;
    for (uint32_t t = 0; t < w->map.tile_count; t++) {
        *out_both += needed[t] && by_cpu[t];
        *out_one += needed[t] != by_cpu[t];
        *out_finer += needed[t] && is_finer(w, t);
    }
}

/* A survey finds the tiles of finer levels that the composer needs, there or not: all of uneven light, and of
 * even light those of small triangles alone. */
static void test_survey(void **state) {
    (void)state;
    for (int even = 0; even < 2; even++) {
        struct world w;
        struct lw_error err = {0};
        static float rgb[VALUES];
        start(&w, even);
        if (even) w.view.camera = lw_camera_look_at(lw_vec3(0.62f, 0.12f, 0.01f), lw_vec3(0.62f, 0, 0), 1.6f);
        uint8_t *needed = calloc(w.map.tile_count, 1);
        uint64_t *shown = calloc(w.map.tile_count, sizeof *shown), pixels;
        assert_true(needed && shown);
        for (int there = 0; there < 2; there++) {
            uint32_t both, one, finer;
            set_finer(&w, (struct lw_client_tile){.version = there ? 1 : 0});
            memset(needed, 0, w.map.tile_count);
            compose(&w, rgb);
            draw(&w, 0, rgb);
            lw_support_ok(lw_gl_renderer_survey(w.renderer, &w.view, needed, shown, &pixels, &err), &err);
            count_needed(&w, needed, &both, &one, &finer);
            print_message("%s light, finer tiles %s: %u needed by both, %u by one; %u of finer levels\n",
                          even ? "even" : "uneven", there ? "there" : "lacking", both, one, finer);
            assert_true(both > 4 * one);
            assert_true(even ? finer >= OBJECTS && finer <= 2 * OBJECTS : finer > 4);
        }
        free(needed);
        free(shown);
        world_finish(&w);
    }
}

/* ---- the pool ---- */

enum { SLOTS = 4 };

struct pool {
    struct world world;
    struct lw_gl_fine_tiles fine;
};

static void start_pool(struct pool *p) {
    struct lw_error err = {0};
    start(&p->world, false);
    set_finer(&p->world, (struct lw_client_tile){0});
    lw_support_ok(lw_gl_fine_tiles_init(&p->fine, &p->world.map, SLOTS, &err), &err);
    assert_int_equal(p->fine.slot_count, SLOTS);
}

static void finish_pool(struct pool *p) {
    lw_gl_fine_tiles_finish(&p->fine);
    world_finish(&p->world);
}

static uint32_t nth(const struct pool *p, uint32_t i) { return p->world.map.plain_count + i; }

static bool take_tiles_at(struct pool *p, uint64_t now_ns, uint32_t tiles_max) {
    const struct lw_gl_fine_tiles_take take = {
        .source = &p->world.source, .scale = 1, .now_ns = now_ns, .tiles_max = tiles_max};
    return lw_gl_fine_tiles_take(&p->fine, &take);
}

static bool take_tiles(struct pool *p, uint32_t tiles_max) { return take_tiles_at(p, 0, tiles_max); }

static uint32_t slot_of(const struct pool *p, uint32_t i) {
    return (p->fine.word[i] & ((1u << LW_GL_FINE_TILES_SHIFT) - 1)) - 1;
}

static uint32_t share_of(const struct pool *p, uint32_t i) {
    return p->fine.word[i] >> LW_GL_FINE_TILES_SHIFT;
}

/* A tile loses its light and its id. */
static void withdraw(struct pool *p, uint32_t i) {
    p->world.tile[nth(p, i)] = (struct lw_client_tile){0};
    lw_atlas_map_release(&p->world.map, (lw_tile_id){nth(p, i)});
}

static void survey(struct pool *p, uint32_t first, uint32_t end) {
    lw_gl_fine_tiles_survey(&p->fine);
    for (uint32_t i = first; i < end; i++) lw_gl_fine_tiles_want(&p->fine, (lw_tile_id){nth(p, i)});
}

/* The finer tiles from `first` to `end` are in the pool, each in a slot of its own, and no others. */
static void assert_pool(const struct pool *p, uint32_t first, uint32_t end) {
    bool taken[SLOTS] = {false};
    for (uint32_t i = 0; i < lw_atlas_map_room(&p->world.map); i++) {
        assert_int_equal(p->fine.word[i] != 0, i >= first && i < end);
        if (p->fine.word[i] == 0) continue;
        const uint32_t slot = slot_of(p, i);
        assert_true(slot < SLOTS && !taken[slot]);
        assert_int_equal(share_of(p, i), LW_GL_FINE_TILES_WHOLE);
        taken[slot] = true;
    }
    assert_int_equal(p->fine.used, end - first);
}

/* A full pool changes for tiles that were wanted later, and for no others. */
static void test_eviction(void **state) {
    (void)state;
    struct pool p;
    start_pool(&p);
    for (uint32_t i = 0; i < 3; i++) p.world.tile[nth(&p, i)].version = 1;
    assert_true(take_tiles(&p, UINT32_MAX));
    assert_pool(&p, 0, 3);
    assert_false(take_tiles(&p, UINT32_MAX)); /* nothing has changed */
    set_finer(&p.world, (struct lw_client_tile){.version = 1});
    take_tiles(&p, UINT32_MAX);
    assert_pool(&p, 0, 4); /* nobody wants any of them: those that are there stay */
    survey(&p, 2, 6);
    take_tiles(&p, UINT32_MAX);
    assert_pool(&p, 2, 6);
    survey(&p, 2, 10);
    assert_false(take_tiles(&p, UINT32_MAX)); /* all that are there are wanted */
    assert_pool(&p, 2, 6);
    survey(&p, 10, 14);
    take_tiles(&p, 1);
    assert_int_equal(p.fine.waiting, 3);
    take_tiles(&p, UINT32_MAX);
    assert_pool(&p, 10, 14);
    assert_int_equal(p.fine.waiting, 0);
    p.world.tile[nth(&p, 13)] = (struct lw_client_tile){0}; /* withdrawn: its slot is another's at once */
    survey(&p, 9, 13);
    take_tiles(&p, UINT32_MAX);
    assert_pool(&p, 9, 13);
    finish_pool(&p);
}

/* A withdrawn tile that comes back keeps its slot, is uploaded again, and fades in from where it is. */
static void test_tile_that_comes_back(void **state) {
    (void)state;
    struct pool p;
    const uint64_t step = LW_GL_FINE_TILES_FADE / 4;
    start_pool(&p);
    for (uint32_t i = 0; i < 2; i++) p.world.tile[nth(&p, i)].version = 1;
    take_tiles_at(&p, SECOND, UINT32_MAX);
    take_tiles_at(&p, 2 * SECOND, UINT32_MAX);
    assert_pool(&p, 0, 2);
    const uint32_t slot = slot_of(&p, 1);
    withdraw(&p, 1);
    assert_false(take_tiles_at(&p, 3 * SECOND, UINT32_MAX)); /* no picture was drawn since it turned */
    assert_true(take_tiles_at(&p, 3 * SECOND + 3 * step, UINT32_MAX));
    assert_true(p.fine.word[1] == 0 && p.fine.used == 2 && p.fine.waiting == 1);
    const uint64_t uploaded = p.fine.uploaded;
    assert_int_equal(lw_atlas_map_claim_name(&p.world.map, 1).v, nth(&p, 1));
    p.world.tile[nth(&p, 1)].version = 1; /* another run has other texels */
    take_tiles_at(&p, 4 * SECOND, UINT32_MAX);
    assert_true(slot_of(&p, 1) == slot && p.fine.used == 2);
    assert_int_equal(p.fine.uploaded, uploaded + 2); /* with the tile of whose border it is */
    assert_int_equal(share_of(&p, 1), LW_GL_FINE_TILES_WHOLE / 4 + 1);
    take_tiles_at(&p, 4 * SECOND + step, UINT32_MAX);
    assert_int_equal(share_of(&p, 1), LW_GL_FINE_TILES_WHOLE / 2 + 1);
    take_tiles_at(&p, 5 * SECOND, UINT32_MAX);
    assert_pool(&p, 0, 2);
    assert_int_equal(p.fine.waiting, 0);
    finish_pool(&p);
}

/* In a full pool the slot of a tile that fades out goes to a new tile at once, wanted or not. Nothing else is
 * taken from a tile that is there. */
static void test_full_pool_does_not_wait(void **state) {
    (void)state;
    struct pool p;
    start_pool(&p);
    survey(&p, 0, SLOTS);
    for (uint32_t i = 0; i < SLOTS; i++) p.world.tile[nth(&p, i)].version = 1;
    take_tiles_at(&p, SECOND, UINT32_MAX);
    take_tiles_at(&p, 2 * SECOND, UINT32_MAX);
    const uint32_t slot = slot_of(&p, 1);
    withdraw(&p, 1);
    take_tiles_at(&p, 3 * SECOND, UINT32_MAX);
    assert_int_equal(p.fine.used, SLOTS);
    for (uint32_t i = SLOTS; i < SLOTS + 2; i++) p.world.tile[nth(&p, i)].version = 1;
    take_tiles_at(&p, 3 * SECOND + 1, UINT32_MAX);
    assert_true(slot_of(&p, SLOTS) == slot && share_of(&p, SLOTS) == 0);
    assert_int_equal(p.fine.word[SLOTS + 1], 0);
    assert_int_equal(p.fine.used, SLOTS);
    finish_pool(&p);
}

/* A tile whose id another one has now is gone. A tile that has another id now keeps its slot. */
static void test_ids_that_go_to_others(void **state) {
    (void)state;
    struct pool p;
    start_pool(&p);
    for (uint32_t i = 0; i < 3; i++) p.world.tile[nth(&p, i)].version = 1;
    take_tiles(&p, UINT32_MAX);
    assert_pool(&p, 0, 3);
    const lw_tile_id first = {nth(&p, 0)}, second = {nth(&p, 1)};
    lw_atlas_map_release(&p.world.map, first);
    lw_atlas_map_release(&p.world.map, second);
    assert_int_equal(lw_atlas_map_claim_name(&p.world.map, 1).v, first.v);
    const uint32_t slot = slot_of(&p, 1);
    p.world.tile[first.v].version = 2, p.world.tile[second.v].version = 0;
    take_tiles(&p, UINT32_MAX);
    assert_int_equal(p.fine.used, 2);
    assert_true(p.fine.word[0] != 0 && p.fine.word[1] == 0 && p.fine.word[2] != 0);
    assert_int_equal(slot_of(&p, 0), slot);
    assert_int_equal(p.fine.uploaded, 4);
    finish_pool(&p);
}

/* A new version is uploaded once, and so are the borders that it is part of. */
static void test_versions(void **state) {
    (void)state;
    struct pool p;
    start_pool(&p);
    const struct lw_tile_place *place = &p.world.map.place[nth(&p, 0)];
    const uint32_t tiles_x = lw_atlas_level(p.world.map.atlas[place->object], place->level)->tiles_x;
    assert_int_equal(tiles_x, 2); /* 128 x 128 texels: four tiles */
    for (uint32_t i = 0; i < 4; i++) p.world.tile[nth(&p, i)].version = 1;
    take_tiles(&p, UINT32_MAX);
    assert_int_equal(p.fine.uploaded, 4);
    p.world.tile[nth(&p, 3)].version = 2; /* the last one is part of the borders of all */
    take_tiles(&p, UINT32_MAX);
    assert_int_equal(p.fine.uploaded, 8);
    p.world.tile[nth(&p, 0)].version = 2; /* the first one of none */
    take_tiles(&p, UINT32_MAX);
    assert_int_equal(p.fine.uploaded, 9);
    assert_false(take_tiles(&p, UINT32_MAX));
    assert_int_equal(p.fine.uploaded, 9);
    finish_pool(&p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_picture),
        cmocka_unit_test(test_charts),
        cmocka_unit_test(test_none),
        cmocka_unit_test(test_fades),
        cmocka_unit_test(test_withdrawn_tiles_fade_out),
        cmocka_unit_test(test_borders),
        cmocka_unit_test(test_full),
        cmocka_unit_test(test_scale),
        cmocka_unit_test(test_survey),
        cmocka_unit_test(test_eviction),
        cmocka_unit_test(test_versions),
        cmocka_unit_test(test_tile_that_comes_back),
        cmocka_unit_test(test_full_pool_does_not_wait),
        cmocka_unit_test(test_ids_that_go_to_others),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
