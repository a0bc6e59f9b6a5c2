/* Direct light at pixels against the path tracer's: nothing is in the texels, all comes from client
 * lights. */
#include "tests/support/support.h"

#include "client/paths/path_trace.h"
#include "client/view/compose/compose.h"
#include "client/view/lights/emitter_clusters.h"
#include "client/view/lights/emitter_triangle.h"
#include "common/base/random.h"
#include "common/builtin/builtin.h"
#include "common/light/direction.h"
#include "common/lightmap/lightmap.h"
#include "common/shading/tangent.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH   192u
#define HEIGHT  108u
#define VALUES  (3 * WIDTH * HEIGHT)
#define COLUMNS 4u /* blocks of the picture whose means are compared */
#define ROWS    3u

struct world {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_trace *trace;
    struct lw_client_lights drawn;
    struct lw_compose_view view;
};

static struct lw_client_level no_level(const void *context, uint32_t object, uint32_t level) {
    (void)context, (void)object, (void)level;
    return (struct lw_client_level){0};
}

static struct lw_client_tile no_tile(const void *context, lw_tile_id tile) {
    (void)context, (void)tile;
    return (struct lw_client_tile){0};
}

static void set_up_scene(struct world *w, struct lw_scene *scene, const char *names) {
    struct lw_error err = {0};
    *w = (struct world){.scene = scene};
    lw_support_ok(lw_pose_init(&w->pose, scene), NULL);
    memset(w->pose.node_moves, 0, scene->node_count * sizeof *w->pose.node_moves);
    lw_support_ok(lw_atlas_map_init(&w->map, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &w->pose, &w->trace, &err), &err);
    lw_support_ok(lw_client_lights_init(&w->drawn, scene, &w->pose, names, &err), &err);
    w->view = (struct lw_compose_view){.width = WIDTH, .height = HEIGHT};
    if (scene->camera_count) w->view.camera = lw_camera_of_scene(scene, &w->pose, 0);
}

/* Built once: no test changes it. */
static struct lw_scene *atrium;

static void set_up(struct world *w, const char *name, const char *names) {
    const bool is_atrium = strcmp(name, "builtin:atrium-matt") == 0;
    struct lw_scene *scene = is_atrium ? atrium : NULL;
    struct lw_error err = {0};
    if (!scene) lw_support_ok(lw_builtin_build(name, &scene, &err), &err);
    if (is_atrium) atrium = scene;
    set_up_scene(w, scene, names);
}

static int destroy_atrium(void **state) {
    (void)state;
    lw_scene_destroy(atrium);
    return 0;
}

static void tear_down(struct world *w) {
    lw_client_lights_finish(&w->drawn);
    lw_trace_destroy(w->trace);
    lw_atlas_map_finish(&w->map);
    lw_pose_finish(&w->pose);
    if (w->scene != atrium) lw_scene_destroy(w->scene);
}

static struct lw_compose *new_compose(const struct world *w, bool drawn, unsigned threads) {
    struct lw_compose *compose;
    struct lw_error err = {0};
    lw_support_ok(lw_compose_create(&(struct lw_compose_desc){.scene = w->scene,
                                                              .map = &w->map,
                                                              .trace = w->trace,
                                                              .threads = threads,
                                                              .drawn = drawn ? &w->drawn : NULL,
                                                              .pose = &w->pose},
                                    &compose, &err),
                  &err);
    return compose;
}

static float *new_picture(void) {
    float *rgb = calloc(VALUES, sizeof *rgb);
    assert_non_null(rgb);
    return rgb;
}

static void render(struct lw_compose *compose, const struct world *w, uint32_t sample, float *rgb) {
    const struct lw_compose_source source = {.level = no_level, .tile = no_tile};
    struct lw_compose_view view = w->view;
    struct lw_compose_report report;
    view.sample = sample;
    lw_compose_render(compose, &source, &w->pose, &view, rgb, &report);
    for (uint32_t i = 0; i < VALUES; i++) assert_true(isfinite(rgb[i]) && rgb[i] >= 0);
}

/* Without light in texels a stand-in is shown; client-drawn light is the difference to it. Mean of
 * `pictures` pictures. */
static float *draw(const struct world *w, uint32_t pictures, unsigned threads) {
    float *sum = new_picture(), *rgb = new_picture();
    struct lw_compose *drawing = new_compose(w, true, threads), *without = new_compose(w, false, threads);
    for (uint32_t n = 0; n < pictures; n++) {
        render(drawing, w, n, rgb);
        for (uint32_t i = 0; i < VALUES; i++) sum[i] += rgb[i] / (float)pictures;
    }
    render(without, w, 0, rgb);
    for (uint32_t i = 0; i < VALUES; i++) sum[i] -= rgb[i];
    lw_compose_destroy(without);
    lw_compose_destroy(drawing);
    free(rgb);
    return sum;
}

/* Direct light of client lights, by the path tracer, without visible emission. */
static float *trace_reference(const struct world *w, uint32_t samples) {
    struct lw_error err = {0};
    const struct lw_lights_part part = lw_client_lights_part(&w->drawn, true);
    struct lw_lights lights;
    struct lw_path_trace *tracer;
    struct lw_path_film film;
    float *rgb = new_picture(), *shining = new_picture();
    lw_support_ok(lw_lights_init_part(&lights, w->scene, &w->pose, &part), NULL);
    lw_support_ok(lw_path_trace_create(
                      &(struct lw_path_trace_desc){
                          .scene = w->scene, .trace = w->trace, .lights = &lights, .pose = &w->pose},
                      &tracer, &err),
                  &err);
    struct lw_path_view view = {.camera = w->view.camera,
                                .seed = 7,
                                .pixel = LW_PATH_PIXEL_CENTRE,
                                .method = LW_PATH_METHOD_LAMPS,
                                .part = LW_PATH_PART_DIRECT,
                                .all_lights = true};
    lw_support_ok(lw_path_film_init(&film, WIDTH, HEIGHT, &err), &err);
    lw_path_trace_render(tracer, &view, samples, &film, NULL);
    lw_path_film_resolve(&film, rgb);
    lw_path_film_finish(&film);
    /* emission and sky alone: surfaces without albedo, as the composer shows them without light */
    struct lw_client_lights none = {.light = calloc(w->scene->light_count + 1ul, 1),
                                    .material = calloc(w->scene->material_count + 1ul, 1)};
    assert_true(none.light && none.material);
    const struct lw_lights_part dark = lw_client_lights_part(&none, true);
    lw_lights_finish(&lights);
    lw_support_ok(lw_lights_init_part(&lights, w->scene, &w->pose, &dark), NULL);
    lw_support_ok(lw_path_film_init(&film, WIDTH, HEIGHT, &err), &err);
    lw_path_trace_render(tracer, &view, samples, &film, NULL);
    lw_path_film_resolve(&film, shining);
    for (uint32_t i = 0; i < VALUES; i++) rgb[i] -= shining[i];
    lw_path_film_finish(&film);
    lw_client_lights_finish(&none);
    lw_path_trace_destroy(tracer);
    lw_lights_finish(&lights);
    free(shining);
    return rgb;
}

static double mean_of_block(const float *rgb, uint32_t block) {
    const uint32_t width = WIDTH / COLUMNS, height = HEIGHT / ROWS, left = block % COLUMNS * width,
                   top = block / COLUMNS * height;
    double sum = 0;
    for (uint32_t y = top; y < top + height; y++)
        for (uint32_t x = left; x < left + width; x++)
            for (uint32_t c = 0; c < 3; c++) sum += (double)rgb[3 * (y * WIDTH + x) + c];
    return sum / (3.0 * width * height);
}

static double mean_of(const float *rgb) {
    double sum = 0;
    for (uint32_t b = 0; b < COLUMNS * ROWS; b++) sum += mean_of_block(rgb, b);
    return sum / (COLUMNS * ROWS);
}

/* tolerance: of blocks that have a tenth of the mean light, and of a fifth of that mean in others */
static void assert_alike(const struct world *w, uint32_t pictures, uint32_t samples, double tolerance,
                         double relmse) {
    float *drawn = draw(w, pictures, 0), *reference = trace_reference(w, samples);
    const double mean = mean_of(reference);
    assert_true(mean > 0);
    for (uint32_t b = 0; b < COLUMNS * ROWS; b++) {
        const double is = mean_of_block(drawn, b), should = mean_of_block(reference, b);
        if (!(fabs(is - should) <= tolerance * fmax(should, 0.2 * mean)))
            fail_msg("block %u is %g, not %g (the picture's mean: %g)", b, is, should, mean);
    }
    const double error = lw_support_relmse(drawn, reference, VALUES);
    if (!(error <= relmse)) fail_msg("relMSE is %g, not under %g", error, relmse);
    free(reference);
    free(drawn);
}

/* Measured: relMSE 0.011, of pixels this coarse; 0.001 in a picture of 1280 x 720. */
static void test_sun(void **state) {
    (void)state;
    struct world w;
    set_up(&w, "builtin:atrium-matt", "sun");
    assert_alike(&w, 1, 32, 0.03, 0.016);
    tear_down(&w);
}

static void test_lamps(void **state) {
    (void)state;
    struct world w;
    set_up(&w, "builtin:atrium-matt", "lamp,lantern");
    assert_alike(&w, 1, 64, 0.08, 0.02);
    tear_down(&w);
}

/* One large lamp lights surfaces close to it, even a face that only its edge rises above. Blocks are within
 * 1 %, but those with edges of penumbras, which are a few of these coarse pixels wide. */
static void test_a_panel(void **state) {
    (void)state;
    struct world w;
    set_up(&w, "builtin:cornell", "auto");
    assert_true(lw_client_lights_any(&w.drawn));
    assert_alike(&w, 1, 256, 0.05, 0.02);
    tear_down(&w);
}

/* E of a panel at points that face it, at a distance in its radii, over what its triangles give exactly: the
 * mean, and the largest difference, over the E below its middle. */
static void compare_cluster(const struct lw_emitter_cluster *cluster, float radii, double *out_mean,
                            double *out_most) {
    const float d = radii * cluster->radius_m;
    double is = 0, should = 0;
    *out_most = 0;
    for (uint32_t packet = 0; packet < 16; packet++) {
        struct lw_points16 at;
        float e[16];
        for (uint32_t i = 0; i < 16; i++) {
            float square[2];
            lw_random_sobol2(16 * packet + i, 0, square);
            const struct lw_vec3 up = lw_direction_cosine(square), away = lw_vec3(up.x, -up.z, up.y);
            const struct lw_vec3 p = lw_vec3_mad(cluster->centre, away, d);
            at.x[i] = p.x, at.y[i] = p.y, at.z[i] = p.z;
            at.nx[i] = -away.x, at.ny[i] = -away.y, at.nz[i] = -away.z;
        }
        lw_emitter_clusters_light16(cluster, &at, e);
        for (uint32_t i = 0; i < 16; i++) {
            float exact = 0;
            for (uint32_t k = 0; k < cluster->triangle_count; k++)
                exact +=
                    cluster->triangle[k].luminance *
                    lw_emitter_triangle_light(cluster->triangle[k].corner, lw_vec3(at.x[i], at.y[i], at.z[i]),
                                              lw_vec3(at.nx[i], at.ny[i], at.nz[i]));
            assert_true(exact > 0);
            *out_most = fmax(*out_most, fabs((double)((e[i] - exact) * d * d / cluster->intensity)));
            is += (double)e[i], should += (double)exact;
        }
    }
    *out_mean = is / should;
}

/* Its triangles from nearby, and its map from afar. */
static void test_light_without_shadows(void **state) {
    (void)state;
    struct world w;
    struct lw_lights lights;
    struct lw_emitter_clusters clusters;
    double mean, most;
    set_up(&w, "builtin:cornell", "auto");
    lw_support_ok(lw_lights_init(&lights, w.scene, &w.pose), NULL);
    lw_support_ok(lw_emitter_clusters_init(&clusters, &lights), NULL);
    assert_int_equal(clusters.count, 1);
    lw_emitter_clusters_place(&clusters, 0, w.trace);
    assert_int_equal(clusters.cluster[0].triangle_count, 2);
    compare_cluster(&clusters.cluster[0], 2, &mean, &most);
    assert_true(fabs(mean - 1) < 1e-6 && most < 1e-5);
    compare_cluster(&clusters.cluster[0], 30, &mean, &most);
    if (!(fabs(mean - 1) < 0.002 && most < 0.03)) fail_msg("from afar: %g, one by %g", mean, most);
    lw_emitter_clusters_finish(&clusters);
    lw_lights_finish(&lights);
    tear_down(&w);
}

static double noise_of(const struct world *w, uint32_t pictures, const float *reference) {
    float *drawn = draw(w, pictures, 0);
    const double error = lw_support_relmse(drawn, reference, VALUES);
    free(drawn);
    return error;
}

/* Pictures that are averaged have random numbers of their own. */
static void test_pictures_converge(void **state) {
    (void)state;
    struct world w;
    set_up(&w, "builtin:cornell", "auto");
    float *reference = trace_reference(&w, 256);
    const double one = noise_of(&w, 1, reference), many = noise_of(&w, 16, reference);
    if (!(many < 0.7 * one)) fail_msg("relMSE of 16 pictures is %g, of one %g", many, one);
    free(reference);
    tear_down(&w);
}

static void test_threads_change_nothing(void **state) {
    (void)state;
    struct world w;
    set_up(&w, "builtin:atrium-matt", "auto");
    float *one = draw(&w, 1, 1), *three = draw(&w, 1, 3);
    assert_memory_equal(one, three, VALUES * sizeof *one);
    free(three);
    free(one);
    tear_down(&w);
}

/* Nothing to draw is as no list of lights: the same bytes. */
static void test_nothing_to_draw(void **state) {
    (void)state;
    struct world w;
    set_up(&w, "builtin:cornell", "none");
    float *drawn = draw(&w, 1, 0);
    for (uint32_t i = 0; i < VALUES; i++) assert_true(drawn[i] == 0);
    free(drawn);
    tear_down(&w);
}

/* A light that moves, dims or goes out is right in the next picture, whatever the picture before. */
static void test_nothing_is_remembered(void **state) {
    (void)state;
    struct world w;
    struct lw_error err = {0};
    set_up(&w, "builtin:atrium-matt", "auto");
    float *before = new_picture(), *after = new_picture(), *fresh = new_picture();
    struct lw_compose *compose = new_compose(&w, true, 0);
    render(compose, &w, 0, before);
    for (uint32_t o = 0; o < w.scene->object_count; o++)
        if (strcmp(w.scene->object[o].name, "lantern") == 0) {
            w.pose.object_dynamic[o] = true;
            w.pose.object_to_world[o].m[0][3] += 1.5f;
        }
    for (uint32_t l = 0; l < w.scene->light_count; l++)
        w.pose.light[l].intensity = lw_vec3_scale(w.pose.light[l].intensity, 0.5f);
    lw_support_ok(lw_trace_set_pose(w.trace, &w.pose, &err), &err);
    render(compose, &w, 0, after);
    lw_compose_destroy(compose);
    compose = new_compose(&w, true, 0);
    render(compose, &w, 0, fresh);
    const double apart = lw_support_relmse(after, before, VALUES),
                 left = lw_support_relmse(after, fresh, VALUES);
    if (!(apart > 0.01 && left < 0.02 * apart))
        fail_msg("from before it differs by %g, from a composer that has just begun by %g", apart, left);
    lw_compose_destroy(compose);
    free(fresh);
    free(after);
    free(before);
    tear_down(&w);
}

/* Squares in a row under `count` points; atlas sizes do not matter. */
static struct lw_scene *squares_with_lights(uint32_t count, float intensity) {
    struct lw_scene *scene = lw_support_squares(3, 2);
    struct lw_light *light = lw_scene_alloc(scene, count, sizeof *light);
    struct lw_node *node = lw_scene_alloc(scene, scene->node_count + count, sizeof *node);
    assert_true(light && node);
    memcpy(node, scene->node, scene->node_count * sizeof *node);
    for (uint32_t i = 0; i < count; i++) {
        node[scene->node_count + i] = scene->node[scene->light[0].node];
        node[scene->node_count + i].parent = LW_SCENE_NONE;
        node[scene->node_count + i].translation[0] = 0.01f * (float)i;
        node[scene->node_count + i].translation[1] = 1 + 0.5f * (float)(i % 3);
        light[i] = scene->light[0];
        light[i].node = scene->node_count + i;
        for (int c = 0; c < 3; c++) light[i].intensity[c] = intensity;
    }
    scene->node = node;
    scene->node_count += count;
    scene->light = light;
    scene->light_count = count;
    return scene;
}

static void set_up_squares(struct world *w, uint32_t count, float intensity) {
    set_up_scene(w, squares_with_lights(count, intensity), "auto");
    w->view.camera = lw_camera_look_at(lw_vec3(4, 5, 8), lw_vec3(4, 0, 0), 1);
}

/* Tilts the normals of all squares by 30 degrees towards +x, by a map of one texel. */
static void tilt_squares(struct lw_scene *scene) {
    static uint8_t texel[4] = {191, 128, 238, 255};
    struct lw_texture *map = lw_scene_alloc(scene, 1, sizeof *map);
    assert_non_null(map);
    *map = (struct lw_texture){.name = "", .width = 1, .height = 1, .content = LW_CONTENT_NORMAL};
    map->rgba = memcpy(lw_scene_alloc(scene, 1, sizeof texel), texel, sizeof texel);
    scene->finish_texture = map, scene->finish_texture_count = 1;
    for (uint32_t m = 0; m < scene->material_count; m++)
        lw_support_finish(scene, m, 0, 0.8f)->normal_texture =
            (struct lw_texture_use){0, 0, {1, 0, 0, 0, 1, 0}};
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        struct lw_mesh *mesh = &scene->mesh[m];
        uint16_t *tangent = lw_scene_alloc(scene, 3ul * mesh->triangle_count, sizeof *tangent);
        assert_non_null(tangent);
        for (uint32_t c = 0; c < 3 * mesh->triangle_count; c++)
            tangent[c] =
                lw_tangent_encode(mesh->normal[mesh->triangle[c / 3][c % 3]], lw_vec3(1, 0, 0), false);
        mesh->tangent = tangent;
    }
}

/* A sun that half rises above a floor lights bumps by half: shadow rays to the rest meet the floor. */
static void test_a_sun_on_the_horizon(void **state) {
    (void)state;
    struct world w;
    struct lw_scene *scene = squares_with_lights(1, 1);
    tilt_squares(scene);
    struct lw_light *sun = (struct lw_light *)&scene->light[0];
    struct lw_node *node = (struct lw_node *)&scene->node[sun->node];
    sun->kind = LW_LIGHT_DIRECTIONAL, sun->angular_diameter = 0.05f;
    memcpy(node->rotation, (float[]){0, sqrtf(0.5f), 0, sqrtf(0.5f)}, sizeof node->rotation);
    set_up_scene(&w, scene, "auto");
    w.view.camera = lw_camera_look_at(lw_vec3(4, 5, 8), lw_vec3(4, 0, 0), 1);
    float *drawn = draw(&w, 16, 0), *reference = trace_reference(&w, 64);
    const double is = mean_of(drawn), should = mean_of(reference);
    if (!(should > 0 && fabs(is - should) < 0.1 * should)) fail_msg("%g, not %g", is, should);
    free(reference);
    free(drawn);
    tear_down(&w);
}

/* Bounded cost: few of them have rays of their own; their light is all there. */
static void test_a_thousand_lights(void **state) {
    (void)state;
    struct world w;
    set_up_squares(&w, 1000, 0.01f);
    struct lw_compose *compose = new_compose(&w, true, 0);
    float *rgb = new_picture();
    const struct lw_compose_source source = {.level = no_level, .tile = no_tile};
    struct lw_compose_report report;
    lw_compose_render(compose, &source, &w.pose, &w.view, rgb, &report);
    assert_in_range(report.shadow_rays, 1, 30ull * WIDTH * HEIGHT);
    lw_compose_destroy(compose);
    free(rgb);
    assert_alike(&w, 16, 64, 0.1, 0.1);
    tear_down(&w);
}

static void test_absurd_lights(void **state) {
    (void)state;
    static const float absurd[] = {1e12f, 1e-30f, NAN, INFINITY, -5};
    for (size_t k = 0; k < sizeof absurd / sizeof absurd[0]; k++) {
        struct world w;
        set_up_squares(&w, 2, 1);
        w.pose.light[0].intensity = lw_vec3(absurd[k], absurd[k], 1);
        w.pose.light[1].position_ws = lw_vec3(k & 1 ? NAN : 0, 0, 0); /* nowhere, and within a surface */
        float *drawn = draw(&w, 1, 0);                                /* looks at each value */
        free(drawn);
        tear_down(&w);
    }
}

/* Emitters without area, of absurd radiance, and one that what it lights touches. */
static void test_absurd_emitters(void **state) {
    (void)state;
    static const float radiance[] = {1e12f, NAN, INFINITY, 1};
    for (size_t k = 0; k < sizeof radiance / sizeof radiance[0]; k++) {
        struct world w;
        struct lw_scene *scene = squares_with_lights(1, 1);
        for (int c = 0; c < 3; c++) scene->material[0].emission[c] = 1;
        set_up_scene(&w, scene, "auto");
        w.view.camera = lw_camera_look_at(lw_vec3(4, 5, 8), lw_vec3(4, 0, 0), 1);
        for (uint32_t m = 0; m < scene->material_count; m++) w.drawn.material[m] = 1;
        w.drawn.drawn_materials = scene->material_count;
        w.pose.object_to_world[1] = (struct lw_affine){{{0}}}; /* a point */
        struct lw_compose *compose = new_compose(&w, true, 0);
        float *rgb = new_picture();
        render(compose, &w, 0, rgb);
        for (int c = 0; c < 3; c++)
            scene->material[0].emission[c] = radiance[k] > 0 ? fminf(radiance[k], 1e12f) : 0;
        render(compose, &w, 0, rgb);
        lw_compose_destroy(compose);
        free(rgb);
        tear_down(&w);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sun),
        cmocka_unit_test(test_lamps),
        cmocka_unit_test(test_a_panel),
        cmocka_unit_test(test_light_without_shadows),
        cmocka_unit_test(test_pictures_converge),
        cmocka_unit_test(test_threads_change_nothing),
        cmocka_unit_test(test_nothing_to_draw),
        cmocka_unit_test(test_nothing_is_remembered),
        cmocka_unit_test(test_a_sun_on_the_horizon),
        cmocka_unit_test(test_a_thousand_lights),
        cmocka_unit_test(test_absurd_lights),
        cmocka_unit_test(test_absurd_emitters),
    };
    return cmocka_run_group_tests(tests, NULL, destroy_atrium);
}
