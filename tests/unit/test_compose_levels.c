/* test_compose_levels.c: which level and which tiles of light a picture reads and asks for. */
#include "tests/support/compose_case.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void assert_ramps(const struct lw_compose_view *view, const float *rgb, float texels) {
    struct lw_camera_plane plane = lw_camera_plane(&view->camera, WIDTH, HEIGHT);
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++) {
            struct lw_vec3 dir = lw_camera_direction(&plane, (float)x + 0.5f, (float)y + 0.5f);
            struct lw_vec3 p = lw_vec3_mad(view->camera.position, dir, -view->camera.position.y / dir.y);
            float u = (p.x / SIDE_M + 0.5f) * texels, v = (p.z / SIDE_M + 0.5f) * texels;
            const float *pixel = rgb + 3 * ((size_t)y * WIDTH + x);
            compose_case_assert_near(pixel[0], 0.5f * u / LW_PI, 1e-4f);
            compose_case_assert_near(pixel[1], 0.5f * v / LW_PI, 1e-4f);
            compose_case_assert_near(pixel[2], 0.5f * (u + v) / LW_PI, 1e-4f);
        }
}

static void test_ramps(void **state) {
    (void)state;
    const uint32_t texels[3] = {64, 256, 1024}; /* seen at level 0, 1 and 2 */
    for (int i = 0; i < 3; i++) {
        struct compose_case_world w;
        float rgb[WIDTH * HEIGHT * 3];
        compose_case_world_init(&w, compose_case_squares(1, texels[i], false));
        compose_case_fill_ramps(&w);
        struct lw_compose_view view = compose_case_view_towards(0.3f, 1, 0.1f, 0, 0, 0, 40);
        compose_case_render(&w, &view, rgb);
        assert_ramps(&view, rgb, (float)texels[i]);
        compose_case_world_finish(&w);
    }
}

/* Texels per pixel where the view's axis meets the square: depth x 2 tan(fov/2) / rows x texels per metre. */
static void test_level_follows_the_footprint(void **state) {
    (void)state;
    struct compose_case_world w;
    compose_case_world_init(&w, compose_case_squares(1, 1024, false));
    compose_case_fill_by_level(&w, 0, 1);
    float rgb[WIDTH * HEIGHT * 3];
    const float pixel = 2 * tanf(20.0f / 180 * LW_PI) / HEIGHT, texels_per_m = 1024 / SIDE_M;
    const struct {
        float footprint, value;
    } cases[] = {{0.5f, 1}, {1.9f, 1}, {2.1f, 2}, {3.9f, 2}, {4.1f, 3}, {7.9f, 3}, {8.1f, 3}, {40.0f, 3}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct lw_compose_view view =
            compose_case_view_towards(0, cases[i].footprint / (pixel * texels_per_m), 0, 0, 0, 0, 40);
        compose_case_render(&w, &view, rgb);
        /* the middle pixel; its footprint is larger than the axis' by the cosine, far less than the margins
         * here */
        compose_case_assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * cases[i].value / LW_PI,
                                 1e-6f);
    }
    compose_case_world_finish(&w);
    /* an object twice as large has half the texels per metre */
    struct lw_scene *scene = compose_case_squares(1, 1024, false);
    for (int c = 0; c < 3; c++) scene->node[0].scale[c] = 2;
    compose_case_world_init(&w, scene);
    compose_case_fill_by_level(&w, 0, 1);
    struct lw_compose_view view = compose_case_view_towards(0, 3.0f / (pixel * texels_per_m), 0, 0, 0, 0, 40);
    compose_case_render(&w, &view, rgb);
    compose_case_assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * 1 / LW_PI, 1e-6f);
    compose_case_world_finish(&w);
}

/* Two charts that share blocks: coarser levels hold the light of both. */
static void test_charts_that_share_blocks_are_read_at_level_0(void **state) {
    (void)state;
    struct lw_scene *scene = compose_case_squares(1, 1024, false);
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
    struct compose_case_world w;
    compose_case_world_init(&w, scene);
    compose_case_fill_by_level(&w, 0, 1);
    float rgb[WIDTH * HEIGHT * 3];
    const float pixel = 2 * tanf(20.0f / 180 * LW_PI) / HEIGHT, texels_per_m = 1024 / SIDE_M;
    struct lw_compose_view view = compose_case_view_towards(0, 8.0f / (pixel * texels_per_m), 0, 0, 0, 0, 40);
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.9f; /* noise is no reason either */
    compose_case_render(&w, &view, rgb);
    compose_case_assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * 1 / LW_PI, 1e-6f);
    compose_case_world_finish(&w);
}

/* A flat slab, whose scale across the surface says nothing about the surface. */
static void test_level_ignores_the_scale_across_the_surface(void **state) {
    (void)state;
    const float pixel = 2 * tanf(20.0f / 180 * LW_PI) / HEIGHT, texels_per_m = 1024 / SIDE_M / 2;
    const float across[] = {0.0001f, 1, 500};
    for (size_t i = 0; i < sizeof across / sizeof across[0]; i++) {
        struct compose_case_world w;
        float rgb[WIDTH * HEIGHT * 3];
        struct lw_scene *scene = compose_case_squares(1, 1024, false);
        scene->node[0].scale[0] = 4, scene->node[0].scale[1] = across[i], scene->node[0].scale[2] = 1;
        compose_case_world_init(&w, scene);
        compose_case_fill_by_level(&w, 0, 1);
        struct lw_compose_view view =
            compose_case_view_towards(0, 3.0f / (pixel * texels_per_m), 0, 0, 0, 0, 40);
        compose_case_render(&w, &view, rgb);
        compose_case_assert_near(rgb[3 * (HEIGHT / 2 * WIDTH + WIDTH / 2)], 0.5f * 2 / LW_PI, 1e-6f);
        compose_case_world_finish(&w);
    }
}

/* What lies beside the picture is surveyed at the level that it would need in it; the picture's own needs
 * stay. */
static void test_survey(void **state) {
    (void)state;
    struct compose_case_world w;
    compose_case_world_init(&w, compose_case_squares(1, 2048, false)); /* tiles of 1/8 m, 1/4 m, 1/2 m */
    compose_case_fill_by_level(&w, 0, 1);
    struct lw_compose_view view = compose_case_view_towards(0.6f, 1, 0.6f, 0.6f, 0, 0.6f, 50);
    view.width = 512, view.height = 384;
    float *rgb = malloc((size_t)view.width * view.height * 3 * sizeof *rgb);
    uint8_t *needed = malloc(w.map.tile_count);
    assert_true(rgb && needed);
    compose_case_render(&w, &view, rgb);
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
    compose_case_world_finish(&w);
}

static void test_missing_tile(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(1, 128, false)); /* 2 x 2 tiles at level 0 */
    compose_case_fill_by_level(&w, 0, 1);
    w.tile[compose_case_tile_at(&w, 0, 1, 0)].version = 0; /* x > 0, z < 0 */
    struct lw_compose_view view = compose_case_view_towards(0, 0.5f, 0, 0, 0, 0, 40);
    struct lw_compose_report report = compose_case_render(&w, &view, rgb);
    assert_int_equal(report.tiles_needed, 4);
    assert_int_equal(report.tiles_missing, 1);
    assert_false(report.complete || report.converged);
    assert_true(lw_compose_needed(w.compose)[compose_case_tile_at(&w, 0, 1, 0)]);
    assert_false(lw_compose_needed(w.compose)[compose_case_tile_at(&w, 1, 0, 0)]);
    const float half_texel_m = 0.5f * SIDE_M / 128;
    int coarse = 0, fine = 0;
    struct lw_camera_plane plane = lw_camera_plane(&view.camera, WIDTH, HEIGHT);
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++) {
            struct lw_vec3 dir = lw_camera_direction(&plane, (float)x + 0.5f, (float)y + 0.5f);
            struct lw_vec3 p = lw_vec3_mad(view.camera.position, dir, -view.camera.position.y / dir.y);
            /* a lookup whose four texels touch the missing tile reads the level above as a whole */
            bool touches = p.x >= -half_texel_m && p.z < half_texel_m;
            compose_case_assert_near(rgb[3 * ((size_t)y * WIDTH + x)], 0.5f * (touches ? 2.0f : 1.0f) / LW_PI,
                                     1e-6f);
            coarse += touches, fine += !touches;
        }
    assert_true(coarse > 50 && fine > 50);

    w.tile[compose_case_tile_at(&w, 1, 0, 0)].version = 0; /* then the next coarser one that is there */
    w.tile[compose_case_tile_at(&w, 2, 0, 0)].version = 0;
    compose_case_render(&w, &view, rgb);
    compose_case_assert_near(rgb[3 * (WIDTH - 1)], 0.5f * 4 / LW_PI, 1e-6f);
    compose_case_world_finish(&w);
}

static void test_noisy_tiles_are_read_coarser(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(1, 64, false));
    compose_case_fill_by_level(&w, 0, 1); /* level k holds k + 1 */
    struct lw_compose_view view = compose_case_view_towards(0, 0.5f, 0, 0, 0, 0, 40);
    const float error[] = {0.05f, 0.2f, 0.9f};
    for (int k = 0; k < 3; k++) {
        w.tile[compose_case_tile_at(&w, 0, 0, 0)].error = error[k];
        struct lw_compose_report report = compose_case_render(&w, &view, rgb);
        compose_case_assert_near(rgb[0], 0.5f * (float)(1 + k) / LW_PI, 1e-6f);
        assert_true(report.complete && report.tiles_needed == 1); /* what the view needs stays the fine one */
    }
    w.source.noise_shown = 0.2f; /* the filter leaves less to be seen */
    compose_case_render(&w, &view, rgb);
    compose_case_assert_near(rgb[0], 0.5f * 2 / LW_PI, 1e-6f);
    w.source.noise_shown = 1;
    /* for those who measure, the fine one is read, too */
    struct lw_error err = {0};
    lw_compose_destroy(w.compose);
    lw_support_ok(
        lw_compose_create(
            &(struct lw_compose_desc){.scene = w.scene, .map = &w.map, .trace = w.trace, .unfiltered = true},
            &w.compose, &err),
        &err);
    compose_case_render(&w, &view, rgb);
    compose_case_assert_near(rgb[0], 0.5f / LW_PI, 1e-6f);
    compose_case_world_finish(&w);
}

/* What a picture shows of its tiles' errors: by pixels, by what the filter leaves, by the level that is
 * read. */
static void test_shown_error(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    compose_case_world_init(&w, compose_case_squares(2, 64, false));
    compose_case_fill_constant(&w, 0, 3), compose_case_fill_constant(&w, 1, 3);
    struct lw_compose_view view = compose_case_view_down(); /* on object 0 */
    w.source.noise_shown = 0.5f;
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.04f;
    struct lw_compose_report report = compose_case_render(&w, &view, rgb);
    compose_case_assert_near(report.shown_error, 0.02f, 1e-3f);
    assert_true(report.complete && report.good && !report.converged && report.tiles_noisy > 0);
    for (uint32_t t = w.map.first_tile[1]; t < w.map.tile_count; t++) w.tile[t].error = 1; /* not in view */
    report = compose_case_render(&w, &view, rgb);
    compose_case_assert_near(report.shown_error, 0.02f, 1e-3f);
    for (uint32_t t = 0; t < w.map.first_tile[1]; t++) w.tile[t].error = 0.1f;
    lw_compose_check(w.compose, &w.source, &report); /* without a ray */
    compose_case_assert_near(report.shown_error, 0.05f, 1e-3f);
    assert_true(report.complete && !report.good);
    /* beyond what views bear they read coarser texels, which have less of it */
    for (uint32_t t = 0; t < w.map.first_tile[1]; t++) w.tile[t].error = 1;
    lw_compose_check(w.compose, &w.source, &report);
    compose_case_assert_near(report.shown_error, 0.125f, 1e-3f);
    for (uint32_t t = 0; t < w.map.first_tile[1]; t++) w.tile[t].error = NAN;
    lw_compose_check(w.compose, &w.source, &report);
    compose_case_assert_near(report.shown_error, 1, 1e-3f);
    /* a survey, which nobody sees, changes nothing */
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.04f;
    lw_compose_survey(w.compose, &w.source, &w.pose, &view);
    lw_compose_check(w.compose, &w.source, &report);
    compose_case_assert_near(report.shown_error, 0.02f, 1e-3f);
    /* a target above it: converged is good */
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.1f;
    w.source.target_error = 0.2f;
    lw_compose_check(w.compose, &w.source, &report);
    assert_true(report.converged && report.good && report.shown_error > LW_COMPOSE_GOOD_ERROR);
    for (uint32_t t = 0; t < w.map.first_tile[1]; t++) w.tile[t].version = 0;
    lw_compose_check(w.compose, &w.source, &report);
    compose_case_assert_near(report.shown_error, 1, 1e-3f);
    assert_false(report.good);
    compose_case_world_finish(&w);

    /* what a surface emits is exact: half of this pixel's light is the tile's */
    struct lw_scene *scene = compose_case_squares(1, 64, false);
    for (int c = 0; c < 3; c++) scene->material[0].emission[c] = 0.5f * 3.0f / LW_PI;
    compose_case_world_init(&w, scene);
    compose_case_fill_constant(&w, 0, 3);
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].error = 0.08f;
    report = compose_case_render(&w, &view, rgb);
    compose_case_assert_near(report.shown_error, 0.04f, 1e-2f);
    compose_case_world_finish(&w);
}

/* ---- finer levels ---- */

/* Texels of level 0 are 1 and 3 in turn: nowhere it is even. */
static void fill_checkered(struct compose_case_world *w) {
    const struct lw_atlas_level *l = &w->map.atlas[0]->level[0];
    for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++)
        w->rgb[0][i] = (i / 3 % l->width + i / 3 / l->width) % 2 ? 3 : 1;
}

/* A tile of the finest level that the last render asked for; how many there are. */
static uint32_t asked_for(const struct compose_case_world *w, lw_tile_id *out_id) {
    uint32_t count = 0;
    for (uint32_t t = w->map.plain_count; t < w->map.tile_count; t++)
        if (lw_compose_needed(w->compose)[t]) *out_id = (lw_tile_id){t}, count++;
    return count;
}

/* Close by, a view asks for a finer level where level 0 is uneven; level 0 stands in for it, and is what the
 * view waits for. A tile that is there is read, asked for or not, unless it is noisy. */
static void test_finer_levels_are_asked_for_and_read(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    static float fine[LW_TILE_TEXELS_MAX * 3];
    lw_tile_id id = {0};
    for (size_t i = 0; i < sizeof fine / sizeof *fine; i++) fine[i] = 7;
    compose_case_world_init_finer(&w, compose_case_squares(1, 16, false), 2);
    fill_checkered(&w);
    struct lw_compose_view view = compose_case_view_towards(0, 0.5f, 0, 0, 0, 0, 20);
    struct lw_compose_report report = compose_case_render(&w, &view, rgb);
    assert_int_equal(asked_for(&w, &id), 1); /* 64 x 64 texels */
    assert_int_equal(w.map.place[id.v].level, LW_ATLAS_FINER + 2);
    assert_true(report.complete && !report.converged);
    const lw_tile_id below = lw_atlas_map_below(&w.map, id);
    w.tile[below.v].version = 0;
    lw_compose_check(w.compose, &w.source, &report);
    assert_false(report.complete);
    w.tile[below.v].version = 1;
    w.tile[id.v] = (struct lw_client_tile){.version = 1, .bounces = BOUNCES, .error = 0.01f, .rgb = fine};
    report = compose_case_render(&w, &view, rgb);
    assert_true(report.complete && report.converged);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) compose_case_assert_near(rgb[i], 0.5f * 7 / LW_PI, 1e-5f);
    compose_case_fill_level(&w, 0, 0, 2); /* even: nobody asks, but it is there */
    compose_case_render(&w, &view, rgb);
    assert_int_equal(asked_for(&w, &id), 0);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) compose_case_assert_near(rgb[i], 0.5f * 7 / LW_PI, 1e-5f);
    w.tile[id.v].error = 0.5f;
    compose_case_render(&w, &view, rgb);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) compose_case_assert_near(rgb[i], 0.5f * 2 / LW_PI, 1e-5f);
    compose_case_world_finish(&w);
}

/* Across the edge of two tiles light goes over from one to the next; where one lacks, the next coarser
 * level is read instead. */
static void test_finer_tiles_side_by_side(void **state) {
    (void)state;
    struct compose_case_world w;
    float rgb[WIDTH * HEIGHT * 3];
    static float fine[2][LW_TILE_TEXELS_MAX * 3];
    for (size_t i = 0; i < LW_TILE_TEXELS_MAX * 3; i++) fine[0][i] = 4, fine[1][i] = 8;
    compose_case_world_init_finer(&w, compose_case_squares(1, 64, false), 1);
    fill_checkered(&w);
    for (uint32_t y = 0; y < 2; y++)
        for (uint32_t x = 0; x < 2; x++)
            w.tile[lw_atlas_map_claim(&w.map, 0, LW_ATLAS_FINER + 1, x, y).v] =
                (struct lw_client_tile){.version = 1, .bounces = BOUNCES, .error = 0.01f, .rgb = fine[x]};
    struct lw_compose_view view = compose_case_view_towards(0, 0.6f, 0, 0, 0, 0, 10);
    compose_case_render(&w, &view, rgb);
    uint32_t between = 0;
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) {
        const float e = rgb[i] * LW_PI / 0.5f;
        assert_true(e > 4 - 1e-3f && e < 8 + 1e-3f);
        between += e > 4.01f && e < 7.99f;
    }
    assert_true(between > HEIGHT * 3 && between < WIDTH * HEIGHT);
    w.tile[lw_atlas_map_find(&w.map, 0, LW_ATLAS_FINER + 1, 1, 0).v] = (struct lw_client_tile){0};
    compose_case_render(&w, &view, rgb);
    uint32_t coarse = 0;
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++) coarse += rgb[i] * LW_PI / 0.5f < 3.01f;
    assert_true(coarse > WIDTH * HEIGHT / 4);
    compose_case_world_finish(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ramps),
        cmocka_unit_test(test_level_follows_the_footprint),
        cmocka_unit_test(test_charts_that_share_blocks_are_read_at_level_0),
        cmocka_unit_test(test_level_ignores_the_scale_across_the_surface),
        cmocka_unit_test(test_missing_tile),
        cmocka_unit_test(test_survey),
        cmocka_unit_test(test_noisy_tiles_are_read_coarser),
        cmocka_unit_test(test_shown_error),
        cmocka_unit_test(test_finer_levels_are_asked_for_and_read),
        cmocka_unit_test(test_finer_tiles_side_by_side),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
