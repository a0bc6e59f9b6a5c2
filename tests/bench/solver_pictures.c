#include "tests/bench/solver_pictures.h"

#include "common/image/image.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH  320u
#define HEIGHT 180u
#define PIXELS ((size_t)WIDTH * HEIGHT)

enum lw_status solver_pictures_init(struct solver_pictures *p, const char *name, const struct lw_scene *scene,
                                    const struct lw_pose *pose, const struct lw_atlas_map *map,
                                    uint32_t bounces, double last_s, const char *folder,
                                    struct lw_error *err) {
    *p = (struct solver_pictures){.pose = pose, .folder = folder, .view = {.width = WIDTH, .height = HEIGHT}};
    for (uint32_t m = SOLVER_PICTURES_MOMENTS; m-- > 0; last_s /= 8) p->moment_s[m] = last_s;
    p->rgb = calloc(3 * PIXELS, sizeof *p->rgb);
    p->srgb = malloc(3 * PIXELS);
    if (!p->rgb || !p->srgb) return lw_status_fail(err, LW_NO_MEMORY, "pictures");
    enum lw_status status = lw_trace_create(scene, pose, &p->trace, err);
    if (status == LW_OK)
        status = lw_compose_create(&(struct lw_compose_desc){.scene = scene, .map = map, .trace = p->trace},
                                   &p->compose, err);
    if (status == LW_OK) status = bench_view_light_init(&p->light, map, err);
    p->source = bench_view_light_source(&p->light, scene, bounces);
    if (status != LW_OK) return status;
    return bench_view_camera(name, scene, pose, p->trace, (float)WIDTH / HEIGHT, &p->view.camera, err);
}

void solver_pictures_finish(struct solver_pictures *p) {
    bench_view_light_finish(&p->light);
    lw_compose_destroy(p->compose);
    lw_trace_destroy(p->trace);
    free(p->rgb);
    free(p->srgb);
    *p = (struct solver_pictures){.folder = NULL};
}

static void render(struct solver_pictures *p, const struct lw_solver *solver) {
    struct lw_compose_report report;
    bench_view_light_read(&p->light, solver);
    lw_compose_render(p->compose, &p->source, p->pose, &p->view, p->rgb, &report);
}

static enum lw_status write_picture(struct solver_pictures *p, const char *name, struct lw_error *err) {
    char path[512];
    snprintf(path, sizeof path, "%s/%s.png", p->folder, name);
    lw_tonemap_encode(&p->tonemap, p->rgb, PIXELS, 3, p->srgb);
    return lw_image_write_png(path, p->srgb, WIDTH, HEIGHT, err);
}

enum lw_status solver_pictures_truth(struct solver_pictures *p, const struct lw_solver *solver,
                                     struct lw_error *err) {
    render(p, solver);
    lw_tonemap_init(&p->tonemap, LW_TONEMAP_REINHARD, lw_tonemap_auto_stops(p->rgb, PIXELS));
    return write_picture(p, "truth", err);
}

void solver_pictures_begin(struct solver_pictures *p) {
    p->written = 0;
    memset(p->rgb, 0, 3 * PIXELS * sizeof *p->rgb);
}

enum lw_status solver_pictures_frame(struct solver_pictures *p, const struct lw_solver *solver,
                                     uint32_t number, double cpu_s, struct lw_error *err) {
    enum lw_status status = LW_OK;
    while (status == LW_OK && p->written < SOLVER_PICTURES_MOMENTS && cpu_s > p->moment_s[p->written]) {
        char name[32];
        snprintf(name, sizeof name, "%u-%u", number, p->written++);
        status = write_picture(p, name, err);
    }
    if (status == LW_OK) render(p, solver);
    return status;
}
