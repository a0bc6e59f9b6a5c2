/* test_compose.c: pictures of squares whose light is known: radiance of surfaces, the sky, transparency,
 * mirrors; neither threads nor garbage change them. */
#include "tests/support/compose_case.h"

#include "common/base/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void stack(struct lw_scene *scene) { /* object i at height i, one above the other */
    for (uint32_t i = 0; i < scene->object_count; i++) {
        scene->node[i].translation[0] = 0;
        scene->node[i].translation[1] = (float)i;
    }
}

static void assert_picture(const float *rgb, float expected) {
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) compose_case_assert_near(rgb[i], expected, 1e-6f);
}

static void test_constant(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(1, 64, false));
    compose_case_fill_constant(&w, 0, 3.0f);
    struct lw_compose_view view = compose_case_view_down();
    struct lw_compose_report report = compose_case_render(&w, &view, rgb);
    assert_picture(rgb, 0.5f * 3.0f / LW_PI);
    assert_true(report.complete && report.converged);
    assert_int_equal(report.tiles_missing, 0);
    compose_case_world_finish(&w);
}

static void test_emission_and_albedo(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    struct lw_scene *scene = compose_case_squares(1, 64, false);
    for (int c = 0; c < 3; c++) {
        scene->material[0].emission[c] = (float)(c + 1);
        scene->material[0].base_colour[c] = 0.2f * (float)c;
    }
    compose_case_world_init(&w, scene);
    compose_case_fill_constant(&w, 0, 3.0f);
    struct lw_compose_view view = compose_case_view_down();
    compose_case_render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        for (int c = 0; c < 3; c++)
            compose_case_assert_near(rgb[3 * i + (size_t)c], 0.2f * (float)c * 3.0f / LW_PI + (float)(c + 1),
                                     1e-6f);
    compose_case_world_finish(&w);
}

/* Whatever light falls on it, an unlit surface is its base colour; so with a colour of each vertex. */
static void test_unlit(void **state) {
    (void)state;
    for (int coloured = 0; coloured < 2; coloured++) {
        struct compose_case_world w;
        float rgb[WIDTH * HEIGHT * 3];
        struct lw_scene *scene = compose_case_squares(1, 64, false);
        struct lw_vec4 *colour = lw_scene_alloc(scene, scene->mesh[0].vertex_count, sizeof *colour);
        for (uint32_t v = 0; v < scene->mesh[0].vertex_count; v++)
            colour[v] = (struct lw_vec4){0.5f, 0.5f, 0.25f, 1};
        if (coloured) scene->mesh[0].colour = colour;
        scene->material[0].unlit = 1;
        for (int c = 0; c < 3; c++) scene->material[0].base_colour[c] = 0.3f * (float)(c + 1);
        compose_case_world_init(&w, scene);
        compose_case_fill_constant(&w, 0, 3.0f);
        struct lw_compose_view view = compose_case_view_down();
        compose_case_render(&w, &view, rgb);
        for (size_t i = 0; i < WIDTH * HEIGHT; i++)
            for (int c = 0; c < 3; c++)
                compose_case_assert_near(rgb[3 * i + (size_t)c],
                                         0.3f * (float)(c + 1) *
                                             (!coloured ? 1
                                              : c == 2  ? 0.25f
                                                        : 0.5f),
                                         1e-6f);
        compose_case_world_finish(&w);
    }
}

/* A square fills the middle half of an orthographic view that is twice as high, however far it is. */
static void test_parallel(void **state) {
    (void)state;
    struct compose_case_world w;
    enum { SIDE = 64 };
    static float rgb[SIDE * SIDE * 3];
    compose_case_world_init(&w, compose_case_squares(1, 64, false));
    compose_case_fill_constant(&w, 0, 3.0f);
    for (int far = 0; far < 3; far++) {
        struct lw_compose_view view = {
            .camera = lw_camera_look_at(lw_vec3(0, powf(10, (float)far), 0), lw_vec3(0, 0, 0), 1),
            .width = SIDE,
            .height = SIDE};
        view.camera.height_m = 2 * SIDE_M;
        compose_case_render(&w, &view, rgb);
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++) {
                const bool inside = x >= SIDE / 4 && x < 3 * SIDE / 4 && y >= SIDE / 4 && y < 3 * SIDE / 4;
                compose_case_assert_near(rgb[3 * (y * SIDE + x)], inside ? 0.5f * 3 / LW_PI : 0.25f, 1e-6f);
            }
    }
    compose_case_world_finish(&w);
}

/* A pane lets 1 - alpha of the radiance behind it pass, by its tint. */
static void test_tint(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    struct lw_scene *scene = compose_case_squares(1, 64, false);
    const float tint[3] = {2, 1, 0.25f}, sky[3] = {0.25f, 0.5f, 1.0f};
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.25f;
    memcpy(scene->material[0].tint, tint, sizeof tint);
    compose_case_world_init(&w, scene);
    compose_case_fill_constant(&w, 0, 3);
    struct lw_compose_view view = compose_case_view_down();
    compose_case_render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        for (int c = 0; c < 3; c++)
            compose_case_assert_near(rgb[3 * i + (size_t)c],
                                     0.25f * 0.5f * 3 / LW_PI + 0.75f * tint[c] * sky[c], 1e-5f);
    compose_case_world_finish(&w);
}

static struct lw_vec3 colour_expected(const struct compose_case_world *w, const struct lw_hit16 *hits,
                                      int i) {
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
    struct lw_scene *scene = compose_case_squares(count, 16, false);
    struct lw_vec4 *colour = lw_scene_alloc(scene, 4, sizeof *colour);
    for (int i = 0; i < 4; i++) colour[i] = (struct lw_vec4){0.25f * (float)i, 1 - 0.3f * (float)i, 0.5f, 1};
    scene->mesh[0].colour = colour;
    scene->material[0].emission[2] = 0.25f;
    for (uint32_t o = 0; o < count; o++)
        for (uint32_t axis = 0; axis < 3; axis++) {
            scene->node[o].translation[axis] = 60 * lw_random_unit(lw_random_hash2(o, axis)) - 30;
            scene->node[o].scale[axis] = 0.2f;
        }
    struct compose_case_world w;
    compose_case_world_init(&w, scene);
    for (uint32_t o = 0; o < count; o++) compose_case_fill_constant(&w, o, (float)(o + 1));
    struct lw_compose_view view = compose_case_view_towards(2, 80, 1, 0, 0, 0, 40);
    view.width = 203, view.height = 101; /* no multiples of a packet */
    float *rgb = malloc((size_t)view.width * view.height * 3 * sizeof *rgb);
    assert_non_null(rgb);
    compose_case_render(&w, &view, rgb);

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
    compose_case_world_finish(&w);
}

static void test_sky(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(1, 64, false));
    struct lw_compose_view view = compose_case_view_towards(0, 1, 0, 0, 2, 0, 40);
    struct lw_compose_report report = compose_case_render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        assert_float_equal(rgb[3 * i], 0.25f, 0);
        assert_float_equal(rgb[3 * i + 2], 1.0f, 0);
    }
    assert_int_equal(report.tiles_needed, 0);
    compose_case_world_finish(&w);
}

/* A ray that meets nothing sees sky and environment, whatever the length of its direction. */
static void test_environment(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(1, 64, false));
    const float texels[4 * 3] = {1, 10, 100, 2, 20, 200,
                                 3, 30, 300, 4, 40, 400}; /* middles: -x-z, x-z, x+z, -x+z */
    w.scene->environment = (struct lw_environment){.width = 4, .height = 1, .rgb = texels};
    for (int side = -1; side < 2;
         side += 2) { /* texel centres of columns 1 and 2 are at +-45 degrees from +X */
        struct lw_compose_view view = compose_case_view_towards(0, 1, 0, 1, 1, (float)side, 2);
        compose_case_render(&w, &view, rgb);
        const float *middle = rgb + 3 * (HEIGHT / 2 * WIDTH + WIDTH / 2);
        float column = side < 0 ? 2 : 3;
        compose_case_assert_near(middle[0], 0.25f + column, 0.05f);
        compose_case_assert_near(middle[1], 0.5f + 10 * column, 0.5f);
        compose_case_assert_near(middle[2], 1.0f + 100 * column, 5);
    }
    compose_case_world_finish(&w);
}

static void test_render_more(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3], other[WIDTH * HEIGHT * 3], listed[WIDTH * HEIGHT * 3];
    uint32_t list[WIDTH * HEIGHT];
    compose_case_world_init(&w, compose_case_squares(1, 64, false));
    for (size_t i = 0; i < (size_t)64 * 64 * 3; i++) w.rgb[0][i] = 1 + (float)(i % 97);
    struct lw_compose_view view = compose_case_view_towards(0.3f, 1.5f, 0.2f, 0, 0, 0, 90);
    struct lw_compose_report report = compose_case_render(&w, &view, rgb);
    view.offset_x = 0.25f, view.offset_y = -0.375f;
    compose_case_render(&w, &view, other);
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) list[i] = i * 7 % (WIDTH * HEIGHT); /* no order */
    const uint32_t needed = report.tiles_needed;
    lw_compose_render_more(w.compose, &view, list, WIDTH * HEIGHT - 5, listed);
    for (uint32_t i = 0; i < WIDTH * HEIGHT - 5; i++)
        for (size_t c = 0; c < 3; c++)
            compose_case_assert_near(listed[3 * i + c], other[3 * (size_t)list[i] + c], 1e-4f);
    lw_compose_check(w.compose, &w.source, &report);
    assert_true(report.tiles_needed >= needed);
    lw_compose_render_more(w.compose, &view, list, 0, NULL); /* nothing asked, nothing done */
    compose_case_world_finish(&w);
}

static void test_nothing_there(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(2, 128, false));
    compose_case_fill_by_level(&w, 0, 1);
    compose_case_fill_constant(&w, 1, 7);
    struct lw_compose_view view = compose_case_view_down(); /* on object 0 */
    for (uint32_t t = 0; t < w.map.atlas[0]->tile_count; t++) w.tile[t].version = 0;
    struct lw_compose_report report = compose_case_render(&w, &view, rgb);
    assert_picture(rgb, 0.5f * 7 / LW_PI); /* the average of the tiles that are there */
    assert_int_equal(report.tiles_missing, report.tiles_needed);
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].version = 0;
    compose_case_render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) assert_true(rgb[i] > 0.01f); /* never black */

    w.tile[compose_case_tile_at(&w, 0, 0, 0)].version =
        1; /* finer than needed serves too, where nothing coarser is */
    w.tile[compose_case_tile_at(&w, 0, 1, 0)].version = 1;
    w.tile[compose_case_tile_at(&w, 0, 0, 1)].version = 1;
    w.tile[compose_case_tile_at(&w, 0, 1, 1)].version = 1;
    view = compose_case_view_towards(0, 2, 0, 0, 0, 0, 40);
    compose_case_render(&w, &view, rgb);
    compose_case_assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * 1 / LW_PI, 1e-6f);
    compose_case_world_finish(&w);
}

static void test_garbage_texels(void **state) {
    (void)state;
    const float garbage[] = {NAN, INFINITY, -1.0f};
    for (size_t i = 0; i < 3; i++) {
        struct compose_case_world w;
        float rgb[WIDTH * HEIGHT * 3];
        compose_case_world_init(&w, compose_case_squares(1, 64, false));
        compose_case_fill_by_level(&w, 0, 1);
        compose_case_fill_level(&w, 0, 0, garbage[i]);
        struct lw_compose_view view = compose_case_view_down();
        compose_case_render(&w, &view, rgb);
        assert_picture(rgb, 0.5f * 2 / LW_PI); /* the level above */
        compose_case_fill_level(&w, 0, w.map.atlas[0]->level_count - 1, garbage[i]);
        for (uint32_t k = 0; k < w.map.atlas[0]->level_count; k++)
            compose_case_fill_level(&w, 0, k, garbage[i]);
        compose_case_render(&w, &view, rgb); /* asserts that all is finite */
        compose_case_world_finish(&w);
    }
}

static void test_backs(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(1, 64, false));
    compose_case_fill_constant(&w, 0, 3);
    struct lw_compose_view from_below = compose_case_view_towards(0, -1, 0, 0, 0, 0, 40);
    compose_case_render(&w, &from_below, rgb);
    assert_float_equal(rgb[0], 0.25f, 0); /* the back of a single-sided surface is not there: sky */
    compose_case_world_finish(&w);

    struct lw_scene *scene = compose_case_squares(1, 64, true);
    scene->material[0].emission[1] = 2;
    compose_case_world_init(&w, scene);
    for (uint32_t k = 0; k < w.map.atlas[0]->level_count; k++) {
        const struct lw_atlas_level *l = &w.map.atlas[0]->level[k];
        for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++)
            w.rgb[k][i] = i / 3 / l->width < l->height / 2 ? 3.0f : 5.0f;
    }
    struct lw_compose_view from_above = compose_case_view_down();
    compose_case_render(&w, &from_above, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        compose_case_assert_near(rgb[3 * i], 0.5f * 3 / LW_PI, 1e-6f);
        compose_case_assert_near(rgb[3 * i + 1], 0.5f * 3 / LW_PI + 2, 1e-6f);
    }
    compose_case_render(&w, &from_below, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        compose_case_assert_near(rgb[3 * i], 0.5f * 5 / LW_PI, 1e-6f);
        compose_case_assert_near(rgb[3 * i + 1], 0.5f * 5 / LW_PI + 2, 1e-6f);
    }
    compose_case_world_finish(&w);
}

static void test_blend(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    struct lw_scene *scene = compose_case_squares(3, 64, false);
    stack(scene);
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.25f;
    scene->material[0].emission[0] = 0.5f;
    compose_case_world_init(&w, scene);
    for (uint32_t o = 0; o < 3; o++) compose_case_fill_constant(&w, o, (float)(o + 1));
    struct lw_compose_view view = compose_case_view_towards(0, 3, 0, 0, 0, 0, 20);
    compose_case_render(&w, &view, rgb);
    for (int c = 0; c < 3; c++) {
        float expected = 0, passes = 1, sky[3] = {0.25f, 0.5f, 1.0f};
        for (int o = 2; o >= 0; o--, passes *= 0.75f)
            expected += passes * 0.25f * (0.5f * (float)(o + 1) / LW_PI + (c == 0 ? 0.5f : 0));
        expected += passes * sky[c];
        for (size_t i = 0; i < WIDTH * HEIGHT; i++)
            compose_case_assert_near(rgb[3 * i + (size_t)c], expected, 1e-5f);
    }
    compose_case_world_finish(&w);
}

static void test_blend_is_bounded(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    struct lw_scene *scene = compose_case_squares(LW_COMPOSE_LAYERS_MAX + 4, 64, false);
    stack(scene);
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.125f;
    compose_case_world_init(&w, scene);
    for (uint32_t o = 0; o < scene->object_count; o++) compose_case_fill_constant(&w, o, 2);
    struct lw_compose_view view = compose_case_view_towards(0, 24, 0, 0, 0, 0, 4);
    compose_case_render(&w, &view, rgb);
    /* the last layer takes all that is left: as if all were opaque */
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) compose_case_assert_near(rgb[i], 0.5f * 2 / LW_PI, 1e-5f);
    compose_case_world_finish(&w);
}

static void test_report(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(1, 128, false));
    compose_case_fill_constant(&w, 0, 1);
    struct lw_compose_view view = compose_case_view_towards(0, 0.5f, 0, 0, 0, 0, 40);
    w.tile[compose_case_tile_at(&w, 1, 0, 0)].version = 0; /* not needed: does not count */
    struct lw_compose_report report = compose_case_render(&w, &view, rgb);
    assert_true(report.complete && report.converged);
    assert_float_equal(report.max_error, 0.01f, 0);
    w.tile[compose_case_tile_at(&w, 0, 1, 1)].error = 0.03f;
    lw_compose_check(w.compose, &w.source, &report);
    assert_true(report.complete && !report.converged);
    assert_int_equal(report.tiles_noisy, 1);
    assert_float_equal(report.max_error, 0.03f, 0);
    w.tile[compose_case_tile_at(&w, 0, 0, 1)].bounces = BOUNCES - 1;
    lw_compose_check(w.compose, &w.source, &report);
    assert_false(report.complete);
    assert_int_equal(report.tiles_unfinished, 1);
    compose_case_world_finish(&w);
}

/* ---- finer levels ---- */

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    struct compose_case_world w;
    struct lw_scene *scene = compose_case_squares(5, 256, true);
    stack(scene);
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.5f;
    compose_case_world_init(&w, scene);
    for (uint32_t i = 0; i < scene->object_count * LW_ATLAS_LEVELS_MAX; i++) {
        uint32_t o = i / LW_ATLAS_LEVELS_MAX, k = i % LW_ATLAS_LEVELS_MAX;
        if (k >= w.map.atlas[o]->level_count) continue;
        const struct lw_atlas_level *l = &w.map.atlas[o]->level[k];
        for (uint32_t j = 0; j < l->width * l->height * 3; j++)
            w.rgb[i][j] = lw_random_unit(lw_random_hash2(i, j));
    }
    for (uint32_t t = 0; t < w.map.tile_count; t += 3) w.tile[t].version = 0;
    struct lw_compose_view view = compose_case_view_towards(3, 5, 6, 0, 1, 0, 60);
    view.width = 301, view.height = 203;
    size_t size = (size_t)view.width * view.height * 3 * sizeof(float);
    float *one = malloc(size), *more = malloc(size);
    uint8_t *needed = malloc(w.map.tile_count);
    assert_true(one && more && needed);
    struct lw_compose_report report = compose_case_render(&w, &view, one);
    memcpy(needed, lw_compose_needed(w.compose), w.map.tile_count);
    for (unsigned threads = 2; threads <= 5; threads++) {
        compose_case_make_compose(&w, threads);
        struct lw_compose_report other = compose_case_render(&w, &view, more);
        assert_memory_equal(one, more, size);
        assert_memory_equal(needed, lw_compose_needed(w.compose), w.map.tile_count);
        assert_int_equal(report.tiles_missing, other.tiles_missing);
    }
    free(needed);
    free(more);
    free(one);
    compose_case_world_finish(&w);
}

/* Half a pixel's offset is the ray of a picture twice as large. */
static void test_offset(void **state) {
    (void)state;
    struct compose_case_world w;
    float small[WIDTH * HEIGHT * 3], *large = malloc(sizeof small * 4);
    assert_non_null(large);
    compose_case_world_init(&w, compose_case_squares(1, 64, false));
    compose_case_fill_ramps(&w);
    struct lw_compose_view view = compose_case_view_down();
    view.offset_x = -0.25f, view.offset_y = 0.25f;
    compose_case_render(&w, &view, small);
    view.offset_x = view.offset_y = 0;
    view.width *= 2, view.height *= 2;
    compose_case_render(&w, &view, large);
    for (size_t y = 0; y < HEIGHT; y++)
        for (size_t x = 0; x < WIDTH; x++)
            compose_case_assert_near(small[3 * (y * WIDTH + x)], large[3 * ((2 * y + 1) * 2 * WIDTH + 2 * x)],
                                     1e-5f);
    free(large);
    compose_case_world_finish(&w);
}

/* ---- mirrors ---- */

/* Squares of a white metal, lit from both sides: object o's back has o's light. */
static void metal_squares(struct compose_case_world *w, unsigned count, float roughness) {
    struct lw_scene *scene = compose_case_squares(count, 64, true);
    lw_support_finish(scene, 0, 1, roughness);
    for (int c = 0; c < 4; c++) scene->material[0].base_colour[c] = 1;
    stack(scene);
    compose_case_world_init(w, scene);
    w->source.sky = lw_vec3(0, 0, 0);
    for (uint32_t o = 0; o < count; o++) compose_case_fill_constant(w, o, 1 + 2 * (float)o);
}

/* The floor mirrors the square over it. The smoother it is, the less of its own light is left. */
static void test_mirrors(void **state) {
    (void)state;
    static const struct {
        float roughness, share;
    } cases[] = {{0, 1}, {0.2f, 1}, {0.35f, 0.75f}, {0.65f, 0}, {0.8f, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct compose_case_world w;
        float rgb[WIDTH * HEIGHT * 3];
        metal_squares(&w, 2, cases[i].roughness);
        struct lw_compose_view view = compose_case_view_towards(0, 0.5f, 0, 0, 0, 0, 40);
        compose_case_render(&w, &view, rgb);
        for (size_t p = 0; p < WIDTH * HEIGHT * 3; p++) compose_case_assert_near(rgb[p], 1 / LW_PI, 0.02f);
        view.mirrors = true;
        compose_case_render(&w, &view, rgb);
        for (size_t p = 0; p < WIDTH * HEIGHT * 3; p++)
            compose_case_assert_near(rgb[p], (1 + 2 * cases[i].share) / LW_PI, 0.02f);
        view.show = LW_SHOW_IRRADIANCE;
        compose_case_render(&w, &view, rgb);
        for (size_t p = 0; p < WIDTH * HEIGHT * 3; p++) compose_case_assert_near(rgb[p], 1 / LW_PI, 0.02f);
        compose_case_world_finish(&w);
    }
}

/* A mirror that nothing is over shows the sky; the tiles that it shows are needed, by surveys
 * as well. */
static void test_mirrors_of_what_is_there(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    metal_squares(&w, 1, 0.1f);
    w.source.sky = lw_vec3(0.5f, 0.5f, 0.5f);
    struct lw_compose_view view = compose_case_view_towards(0, 0.5f, 0, 0, 0, 0, 40);
    view.mirrors = true;
    compose_case_render(&w, &view, rgb);
    for (size_t p = 0; p < WIDTH * HEIGHT * 3; p++) compose_case_assert_near(rgb[p], 0.5f, 0.02f);
    compose_case_world_finish(&w);
    metal_squares(&w, 2, 0.1f);
    for (unsigned with = 0; with < 2; with++) {
        uint32_t above = 0;
        view.mirrors = with;
        compose_case_render(&w, &view, rgb);
        for (uint32_t t = 0; t < w.map.tile_count; t++)
            above += w.map.place[t].object == 1 && lw_compose_needed(w.compose)[t];
        assert_int_equal(above > 0, with);
        lw_compose_survey(w.compose, &w.source, &w.pose, &view);
        above = 0;
        for (uint32_t t = 0; t < w.map.tile_count; t++)
            above += w.map.place[t].object == 1 && lw_compose_around(w.compose)[t];
        assert_int_equal(above > 0, with);
    }
    compose_case_world_finish(&w);
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
        cmocka_unit_test(test_render_more),
        cmocka_unit_test(test_nothing_there),
        cmocka_unit_test(test_garbage_texels),
        cmocka_unit_test(test_backs),
        cmocka_unit_test(test_blend),
        cmocka_unit_test(test_blend_is_bounded),
        cmocka_unit_test(test_report),
        cmocka_unit_test(test_same_bytes_at_any_thread_count),
        cmocka_unit_test(test_mirrors),
        cmocka_unit_test(test_mirrors_of_what_is_there),
        cmocka_unit_test(test_offset),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
