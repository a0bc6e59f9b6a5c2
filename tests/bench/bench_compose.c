/* bench_compose: rays per second of the view against the bare tracer on the same primary rays, in one run.
 *
 *     bench_compose [SCENE.lwscene | builtin:NAME] [THREADS]
 *
 * Prints CSV: scene, threads, then millions of rays per second of each, and their ratio. */
#include "client/view/compose.h"
#include "common/clock.h"
#include "common/log.h"
#include "common/scene/builtin.h"
#include "common/scene/lightmap.h"
#include "common/scene/package.h"

#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH  1280u
#define HEIGHT 720u
#define ROUNDS 9

struct light {
    const struct lw_atlas_map *map;
    float *rgb; /* enough for the largest level: every level reads the same grey */
};

static struct lw_client_level level(const void *context, uint32_t object, uint32_t k) {
    const struct light *light = context;
    const struct lw_atlas_level *l = &light->map->atlas[object].level[k];
    return (struct lw_client_level){.width = l->width, .height = l->height, .rgb = light->rgb};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    (void)context, (void)id;
    return (struct lw_client_tile){.version = 1};
}

static enum lw_status load(const char *name, struct lw_scene **out_scene, struct lw_error *err) {
    if (strncmp(name, LW_BUILTIN_PREFIX, strlen(LW_BUILTIN_PREFIX)) != 0)
        return lw_package_load(name, out_scene, err);
    enum lw_status status = lw_builtin_build(name, out_scene, err);
    if (status != LW_OK) return status;
    return lw_lightmap_build(*out_scene, &(struct lw_lightmap_desc){0}, NULL, err);
}

static void trace_block(const struct lw_trace *trace, struct lw_vec3 from,
                        const struct lw_camera_plane *plane, uint32_t x, uint32_t y) {
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
        struct lw_vec3 dir = lw_camera_direction(plane, (float)(x + i % 4) + 0.5f, (float)(y + i / 4) + 0.5f);
        rays.org_x[i] = from.x, rays.org_y[i] = from.y, rays.org_z[i] = from.z;
        rays.dir_x[i] = dir.x, rays.dir_y[i] = dir.y, rays.dir_z[i] = dir.z;
        rays.t_near[i] = 0, rays.t_far[i] = INFINITY;
    }
    lw_trace_closest16(trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, 0xffff, &rays, &hits);
}

static void trace_all(const struct lw_trace *trace, const struct lw_camera_view *camera, int threads) {
    const struct lw_camera_plane plane = lw_camera_plane(camera, WIDTH, HEIGHT);
    const uint32_t columns = WIDTH / 32, rows = (HEIGHT + 31) / 32;
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (uint32_t t = 0; t < columns * rows; t++)
        for (uint32_t y = t / columns * 32; y < t / columns * 32 + 32 && y < HEIGHT; y += 4)
            for (uint32_t x = t % columns * 32; x < t % columns * 32 + 32; x += 4)
                trace_block(trace, camera->position, &plane, x, y);
}

static int compare(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double mrays_per_s(double *seconds) {
    qsort(seconds, ROUNDS, sizeof *seconds, compare);
    return WIDTH * HEIGHT * 1e-6 / seconds[ROUNDS / 2];
}

int main(int argc, char **argv) {
    lw_log_init("bench_compose", LW_LOG_INFO);
    const char *name = argc > 1 ? argv[1] : "builtin:atrium";
    int threads = argc > 2 ? atoi(argv[2]) : omp_get_max_threads();
    struct lw_error err = {0};
    struct lw_scene *scene = NULL;
    struct lw_pose pose = {0};
    struct lw_atlas_map map = {0};
    struct lw_trace *trace = NULL;
    struct lw_compose *compose = NULL;
    struct light light = {.map = &map};
    float *picture = malloc((size_t)WIDTH * HEIGHT * 3 * sizeof *picture);
    enum lw_status status = picture == NULL ? LW_NO_MEMORY : load(name, &scene, &err);
    if (status == LW_OK) status = lw_pose_init(&pose, scene);
    if (status == LW_OK) status = lw_atlas_map_init(&map, scene);
    if (status == LW_OK) status = lw_trace_create(scene, &pose, &trace, &err);
    if (status == LW_OK)
        status = lw_compose_create(
            &(struct lw_compose_desc){
                .scene = scene, .map = &map, .trace = trace, .threads = (unsigned)threads},
            &compose, &err);
    size_t texels = 0;
    for (uint32_t o = 0; status == LW_OK && o < map.object_count; o++) {
        size_t count = (size_t)map.atlas[o].level[0].width * map.atlas[o].level[0].height;
        if (count > texels) texels = count;
    }
    if (status == LW_OK && (light.rgb = malloc(texels * 3 * sizeof *light.rgb)) == NULL)
        status = LW_NO_MEMORY;
    if (status != LW_OK) {
        lw_status_fail(&err, status, "%s", lw_status_text(status));
        return lw_log_failure(&err);
    }
    for (size_t i = 0; i < texels * 3; i++) light.rgb[i] = 1;
    struct lw_compose_source source = {.context = &light, .level = level, .tile = tile};
    struct lw_compose_view view = {.width = WIDTH, .height = HEIGHT};
    view.camera = scene->camera_count ? lw_camera_of_scene(scene, &pose, 0)
                                      : lw_camera_default(scene, &pose, trace, (float)WIDTH / HEIGHT);

    double bare[ROUNDS], composed[ROUNDS];
    struct lw_compose_report report;
    for (int i = 0; i < ROUNDS; i++) { /* by turns, so that both meet the same machine */
        uint64_t start_ns = lw_clock_ns();
        trace_all(trace, &view.camera, threads);
        uint64_t middle_ns = lw_clock_ns();
        lw_compose_render(compose, &source, &pose, &view, picture, &report);
        bare[i] = (double)(middle_ns - start_ns) * 1e-9;
        composed[i] = (double)(lw_clock_ns() - middle_ns) * 1e-9;
    }
    double traced = mrays_per_s(bare), shown = mrays_per_s(composed);
    printf("scene,threads,bare_mrays_per_s,compose_mrays_per_s,ratio\n%s,%d,%.2f,%.2f,%.3f\n", name, threads,
           traced, shown, shown / traced);
    lw_compose_destroy(compose);
    lw_trace_destroy(trace);
    lw_atlas_map_finish(&map);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    free(light.rgb);
    free(picture);
    return 0;
}
