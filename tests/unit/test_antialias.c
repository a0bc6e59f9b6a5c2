#include "tests/support/support.h"

#include "client/view/compose/antialias.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 61, HEIGHT = 38, PIXELS = WIDTH * HEIGHT, TEXELS = 16 };

/* A square of constant light before a dark sky, seen askew: slanted edges and flat middles. */
struct world {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct lw_antialias antialias;
    struct lw_compose_source source;
    struct lw_compose_view view;
    float light[TEXELS * TEXELS * 3];
};

static struct lw_client_level level(const void *context, uint32_t object, uint32_t k) {
    const struct world *w = context;
    const struct lw_atlas_level *l = &w->map.atlas[object]->level[k];
    return (struct lw_client_level){.width = l->width, .height = l->height, .rgb = w->light};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    (void)context, (void)id;
    return (struct lw_client_tile){.version = 1};
}

static void world_init(struct world *w, unsigned threads) {
    struct lw_error err = {0};
    memset(w, 0, sizeof *w);
    w->scene = lw_support_squares(1, 4);
    struct lw_mesh *mesh = &w->scene->mesh[0];
    struct lw_vec2 *uv = lw_scene_alloc(w->scene, 4, sizeof *uv);
    for (int i = 0; i < 4; i++)
        uv[i] = (struct lw_vec2){mesh->uv[0][i].x * TEXELS, mesh->uv[0][i].y * TEXELS};
    mesh->lightmap_uv = uv;
    mesh->atlas_width = mesh->atlas_height = TEXELS;
    for (size_t i = 0; i < sizeof w->light / sizeof w->light[0]; i++) w->light[i] = 3;
    lw_support_ok(lw_pose_init(&w->pose, w->scene), NULL);
    lw_support_ok(lw_atlas_map_init(&w->map, w->scene), NULL);
    lw_support_ok(lw_trace_create(w->scene, &w->pose, &w->trace, &err), &err);
    lw_support_ok(lw_compose_create(
                      &(struct lw_compose_desc){
                          .scene = w->scene, .map = &w->map, .trace = w->trace, .threads = threads},
                      &w->compose, &err),
                  &err);
    lw_support_ok(lw_antialias_reserve(&w->antialias, PIXELS, &err), &err);
    w->source = (struct lw_compose_source){
        .context = w, .level = level, .tile = tile, .sky = {0.01f, 0.01f, 0.01f}, .noise_shown = 1};
    w->view = (struct lw_compose_view){
        .camera = lw_camera_look_at(lw_vec3(1, 5, 2), lw_vec3(0.2f, 0, 0.1f), 70 / 180.0f * LW_PI),
        .width = WIDTH,
        .height = HEIGHT};
}

static void world_finish(struct world *w) {
    lw_antialias_finish(&w->antialias);
    lw_compose_destroy(w->compose);
    lw_trace_destroy(w->trace);
    lw_atlas_map_finish(&w->map);
    lw_pose_finish(&w->pose);
    lw_scene_destroy(w->scene);
}

static void render(struct world *w, uint32_t samples, float *rgb) {
    struct lw_compose_report report;
    lw_antialias_render(&w->antialias, w->compose, &w->source, &w->pose, &w->view, samples, rgb, &report);
    assert_true(report.complete);
}

static void render_edges(struct world *w, uint32_t samples, unsigned threads, float *rgb) {
    struct lw_compose_report report;
    lw_antialias_render_edges(&w->antialias, w->compose, &w->source, &w->pose, &w->view, samples, threads,
                              rgb, &report);
    assert_true(report.complete);
}

static double square_error(const float *a, const float *b) {
    double sum = 0;
    for (size_t i = 0; i < 3 * PIXELS; i++) sum += (double)(a[i] - b[i]) * (double)(a[i] - b[i]);
    return sum;
}

static void test_offsets(void **state) {
    (void)state;
    for (uint32_t count = 1; count <= 33; count++) {
        double mean[2] = {0};
        for (uint32_t i = 0; i < count; i++) {
            float x, y;
            lw_antialias_offset(i, count, &x, &y);
            assert_true(fabsf(x) <= 0.5f && fabsf(y) <= 0.5f);
            if (count == 1) assert_true(x == 0 && y == 0); /* pixels' centres, as without */
            mean[0] += (double)x, mean[1] += (double)y;
        }
        assert_true(fabs(mean[0]) < 1e-5 * count && fabs(mean[1]) < 1e-5 * count);
    }
}

/* 16 samples are one in each sixteenth of either side, and one in each of 4 x 4 squares. */
static void test_offsets_are_stratified(void **state) {
    (void)state;
    unsigned columns = 0, rows = 0, squares = 0;
    for (uint32_t i = 0; i < 16; i++) {
        float x, y;
        lw_antialias_offset(i, 16, &x, &y);
        const unsigned column = (unsigned)((x + 0.5f) * 16), row = (unsigned)((y + 0.5f) * 16);
        columns |= 1u << column, rows |= 1u << row, squares |= 1u << (column / 4 + 4 * (row / 4));
    }
    assert_true(columns == 0xffff && rows == 0xffff && squares == 0xffff);
}

static void test_one_sample_is_the_centre(void **state) {
    (void)state;
    struct world w;
    float one[3 * PIXELS], centre[3 * PIXELS];
    struct lw_compose_report report;
    world_init(&w, 1);
    render(&w, 1, one);
    lw_compose_render(w.compose, &w.source, &w.pose, &w.view, centre, &report);
    assert_memory_equal(one, centre, sizeof one);
    render_edges(&w, 0, 1, one);
    assert_memory_equal(one, centre, sizeof one);
    world_finish(&w);
}

static void test_more_samples_are_nearer_to_the_square(void **state) {
    (void)state;
    struct world w;
    static float reference[3 * PIXELS], centre[3 * PIXELS], all[3 * PIXELS], edges[3 * PIXELS];
    world_init(&w, 1);
    render(&w, 1024, reference);
    render(&w, 1, centre);
    render(&w, 16, all);
    render_edges(&w, 4, 1, edges);
    const double of_centre = square_error(centre, reference);
    assert_true(of_centre > 1);
    assert_true(square_error(all, reference) < 0.02 * of_centre);
    assert_true(square_error(edges, reference) < 0.3 * of_centre);

    /* only edges change, and the found edge is a line */
    assert_true(w.antialias.edge_count > WIDTH && w.antialias.edge_count < PIXELS / 4);
    bool is_edge[PIXELS] = {false};
    for (size_t i = 0; i < w.antialias.edge_count; i++) {
        assert_true(w.antialias.edge[i] < PIXELS && !is_edge[w.antialias.edge[i]]);
        is_edge[w.antialias.edge[i]] = true;
    }
    for (size_t i = 0; i < PIXELS; i++)
        if (!is_edge[i]) assert_memory_equal(&edges[3 * i], &centre[3 * i], 3 * sizeof(float));
    world_finish(&w);
}

static void test_same_bytes_at_any_number_of_threads(void **state) {
    (void)state;
    static float first[3 * PIXELS], other[3 * PIXELS];
    for (unsigned threads = 1; threads <= 3; threads++) {
        struct world w;
        world_init(&w, threads);
        render_edges(&w, 3, threads, threads == 1 ? first : other);
        if (threads > 1) assert_memory_equal(first, other, sizeof first);
        world_finish(&w);
    }
}

/* Sides that are no multiple of anything, down to a single pixel. */
static void test_odd_sizes(void **state) {
    (void)state;
    static const uint32_t size[][2] = {{1, 1}, {1, 38}, {61, 1}, {3, 5}, {5, 3}};
    struct world w;
    float rgb[3 * PIXELS];
    world_init(&w, 2);
    for (size_t i = 0; i < sizeof size / sizeof size[0]; i++) {
        struct lw_antialias small = {0};
        struct lw_error err = {0};
        lw_antialias_finish(&w.antialias);
        w.view.width = size[i][0], w.view.height = size[i][1];
        lw_support_ok(lw_antialias_reserve(&small, (size_t)size[i][0] * size[i][1], &err), &err);
        w.antialias = small;
        render_edges(&w, 4, 2, rgb);
        assert_true(w.antialias.edge_count <= (size_t)size[i][0] * size[i][1]);
        for (size_t k = 0; k < (size_t)3 * size[i][0] * size[i][1]; k++) assert_true(isfinite(rgb[k]));
    }
    world_finish(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_offsets),
        cmocka_unit_test(test_offsets_are_stratified),
        cmocka_unit_test(test_one_sample_is_the_centre),
        cmocka_unit_test(test_more_samples_are_nearer_to_the_square),
        cmocka_unit_test(test_same_bytes_at_any_number_of_threads),
        cmocka_unit_test(test_odd_sizes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
