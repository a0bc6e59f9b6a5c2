/* bench_compose: what composing a view costs, against the bare tracer on the same rays, in one run.
 *
 *     bench_compose [OPTIONS] SCENE[@PX,PY,PZ:TX,TY,TZ:FOV]...
 *
 * Every scene twice: at rest, as one flat structure of triangles, and with moving parts set apart (where
 * nothing does, a lamp and an object are set moving). Its light is noise, so that a look-up of the wrong
 * texel shows. One table in Markdown, CPU milliseconds per picture, medians over the rounds:
 *   raw      the view's rays in the flat structure, with nothing asked of what they meet: Embree and little
 *            else
 *   rays     the same in the structure of this row, as the view traces them
 *   compose  the whole picture; its rate over that of raw: compose_over_raw
 *   drawn    the whole picture with the direct light of client lights (common/light/client_lights.h). Its
 *            time over that of compose: drawn_over_compose
 *   directed the whole picture with directions of light (common/light/direction_form.h); its time over that
 *            of compose: directed_over_compose
 *   path     the path tracer, one path per pixel
 * With -o DIR the pictures as EXR, for bench_compare; with --dark no light is in their texels, so that the
 * ones with client lights are what "lightwell-view --path-trace --show direct" shows. */
#include "client/paths/path_trace.h"
#include "client/view/compose/compose.h"
#include "common/base/clock.h"
#include "common/base/random.h"
#include "common/image/image.h"
#include "common/scene/scene_motion.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_view.h"

#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROUNDS_MAX 99
#define PATH_EVERY 4    /* rounds: paths take much longer */
#define BLOCK      4u   /* pixels; the side of a packet */
#define LIGHT      9.0f /* W/m^2, mean: what shaded stone has in the atrium; the sun is ten times as much */
#define TILE       32u  /* pixels; the side of what a thread takes */

struct settings {
    struct lw_scene_open open;
    int64_t width, height, rounds, bounces;
    double time_s;
    const char *folder, *lights;
    bool dark;
};

struct scene {
    const struct settings *settings;
    int threads;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_trace *flat;
    struct lw_compose_view view;
    struct lw_client_lights drawn;
    float *light;     /* enough for the largest level; every level reads it */
    float *direction; /* the same, of where it comes from */
    bool directed;    /* the picture at hand has it */
    float *picture;
};

static struct lw_client_level level(const void *context, uint32_t object, uint32_t k) {
    const struct scene *s = context;
    const struct lw_atlas_level *l = &s->map.atlas[object]->level[k];
    return (struct lw_client_level){.width = l->width,
                                    .height = l->height,
                                    .rgb = s->light,
                                    .direction = s->directed ? s->direction : NULL};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    (void)context, (void)id;
    return (struct lw_client_tile){.version = 1};
}

static void trace_block(const struct scene *s, const struct lw_trace *trace, unsigned flags,
                        const struct lw_camera_plane *plane, uint32_t x, uint32_t y) {
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    uint16_t active = 0;
    for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
        const uint32_t px = x + i % BLOCK, py = y + i / BLOCK;
        if (px < s->view.width && py < s->view.height) active |= (uint16_t)(1u << i);
        lw_trace_set_ray(&rays, i, s->view.camera.position,
                         lw_camera_direction(plane, (float)px + 0.5f, (float)py + 0.5f), INFINITY);
    }
    rays.salt = 0;
    lw_trace_closest16(trace, flags, active, &rays, &hits);
}

static void trace_all(const struct scene *s, const struct lw_trace *trace, unsigned flags) {
    const uint32_t width = s->view.width, height = s->view.height;
    const struct lw_camera_plane plane = lw_camera_plane(&s->view.camera, width, height);
    const uint32_t columns = (width + TILE - 1) / TILE, rows = (height + TILE - 1) / TILE;
#pragma omp parallel for schedule(dynamic) num_threads(s->threads)
    for (uint32_t t = 0; t < columns * rows; t++) {
        const uint32_t left = t % columns * TILE, top = t / columns * TILE;
        for (uint32_t y = top; y < top + TILE && y < height; y += BLOCK)
            for (uint32_t x = left; x < left + TILE && x < width; x += BLOCK)
                trace_block(s, trace, flags, &plane, x, y);
    }
}

static enum lw_status write_picture(const struct scene *s, const char *name, const char *motion,
                                    struct lw_error *err) {
    char path[512];
    if (s->settings->folder == NULL) return LW_OK;
    const char *slash = strrchr(name, '/'), *base = slash ? slash + 1 : name;
    snprintf(path, sizeof path, "%s/%.*s-%s.exr", s->settings->folder, (int)strcspn(base, "@"), base, motion);
    return lw_image_write_exr(path, s->picture, s->view.width, s->view.height, "W/(m^2 sr)", err);
}

/* One row: a structure of its own, at rest or not. */
static enum lw_status measure(struct scene *s, const char *name, bool moving, struct lw_error *err) {
    const struct settings *o = s->settings;
    const unsigned threads = (unsigned)s->threads;
    struct lw_trace *trace = NULL;
    struct lw_compose *compose = NULL, *drawing = NULL;
    struct lw_path_trace *tracer = NULL;
    struct lw_lights lights = {0};
    struct lw_path_film film = {0};
    double time_s[6][ROUNDS_MAX] = {0};
    bool *node_moves = s->pose.node_moves, *none = calloc((size_t)s->scene->node_count + 1, sizeof *none);
    if (none == NULL) return LW_NO_MEMORY;
    if (!moving) s->pose.node_moves = none;
    enum lw_status status = lw_trace_create(s->scene, &s->pose, &trace, err);
    s->pose.node_moves = node_moves;
    free(none);
    if (status == LW_OK)
        status = lw_compose_create(
            &(struct lw_compose_desc){.scene = s->scene, .map = &s->map, .trace = trace, .threads = threads},
            &compose, err);
    if (status == LW_OK)
        status = lw_compose_create(&(struct lw_compose_desc){.scene = s->scene,
                                                             .map = &s->map,
                                                             .trace = trace,
                                                             .threads = threads,
                                                             .drawn = &s->drawn,
                                                             .pose = &s->pose},
                                   &drawing, err);
    if (status == LW_OK) status = lw_lights_init(&lights, s->scene, &s->pose);
    if (status == LW_OK)
        status = lw_path_trace_create(
            &(struct lw_path_trace_desc){
                .scene = s->scene, .trace = trace, .lights = &lights, .pose = &s->pose, .threads = threads},
            &tracer, err);
    if (status == LW_OK) status = lw_path_film_init(&film, s->view.width, s->view.height, err);

    uint64_t shadow_rays = 0;
    const float *sky = s->scene->sky;
    const struct lw_compose_source source = {
        .context = s, .level = level, .tile = tile, .sky = lw_vec3(sky[0], sky[1], sky[2]), .noise_shown = 1};
    const struct lw_path_view paths = {.camera = s->view.camera, .bounces = (uint32_t)o->bounces};
    /* alternately, so that all share the same machine load */
    for (int64_t i = 0; status == LW_OK && i < o->rounds; i++) {
        struct lw_compose_report report;
        uint64_t at_ns[6] = {lw_clock_process_cpu_ns()};
        trace_all(s, s->flat, LW_TRACE_LIGHT | LW_TRACE_COHERENT);
        at_ns[1] = lw_clock_process_cpu_ns();
        trace_all(s, trace, LW_TRACE_VIEW | LW_TRACE_COHERENT);
        at_ns[2] = lw_clock_process_cpu_ns();
        lw_compose_render(compose, &source, &s->pose, &s->view, s->picture, &report);
        at_ns[3] = lw_clock_process_cpu_ns();
        lw_compose_render(drawing, &source, &s->pose, &s->view, s->picture, &report);
        at_ns[4] = lw_clock_process_cpu_ns();
        shadow_rays = report.shadow_rays;
        s->directed = true;
        lw_compose_render(compose, &source, &s->pose, &s->view, s->picture, &report);
        s->directed = false;
        at_ns[5] = lw_clock_process_cpu_ns();
        for (int k = 0; k < 5; k++) time_s[k][i] = 1e-9 * (double)(at_ns[k + 1] - at_ns[k]);
        if (i % PATH_EVERY != 0) continue;
        lw_path_trace_render(tracer, &paths, 1, &film, NULL);
        time_s[5][i / PATH_EVERY] = 1e-9 * (double)(lw_clock_process_cpu_ns() - at_ns[5]);
    }
    if (status == LW_OK) {
        double over_raw[ROUNDS_MAX], over_compose[ROUNDS_MAX], directed[ROUNDS_MAX];
        const size_t rounds = (size_t)o->rounds;
        for (size_t i = 0; i < rounds; i++) {
            over_raw[i] = time_s[0][i] / time_s[2][i];
            over_compose[i] = time_s[3][i] / time_s[2][i];
            directed[i] = time_s[4][i] / time_s[2][i];
        }
        const double raw = bench_median(time_s[0], rounds), rays = bench_median(time_s[1], rounds),
                     whole = bench_median(time_s[2], rounds), drawn = bench_median(time_s[3], rounds),
                     path = bench_median(time_s[5], (rounds + PATH_EVERY - 1) / PATH_EVERY);
        printf("| %s | %s | %.1f | %.1f | %.1f | %.2f | %.1f | %.2f | %.2f | %.2f | %.0f |\n", name,
               moving ? "moving" : "still", 1e3 * raw, 1e3 * rays, 1e3 * whole,
               bench_median(over_raw, rounds), 1e3 * drawn, bench_median(over_compose, rounds),
               (double)shadow_rays / ((double)s->view.width * s->view.height), bench_median(directed, rounds),
               1e3 * path);
        fflush(stdout);
        status = write_picture(s, name, moving ? "moving" : "still", err);
    }
    lw_path_film_finish(&film);
    lw_path_trace_destroy(tracer);
    lw_lights_finish(&lights);
    lw_compose_destroy(drawing);
    lw_compose_destroy(compose);
    lw_trace_destroy(trace);
    return status;
}

static enum lw_status make_light(struct scene *s) {
    size_t texels = 1;
    for (uint32_t o = 0; o < s->map.object_count; o++) {
        const size_t count = (size_t)s->map.atlas[o]->level[0].width * s->map.atlas[o]->level[0].height;
        if (count > texels) texels = count;
    }
    s->light = malloc(texels * 3 * sizeof *s->light);
    s->direction = malloc(texels * 3 * sizeof *s->direction);
    s->picture = malloc((size_t)s->view.width * s->view.height * 3 * sizeof *s->picture);
    if (s->light == NULL || s->direction == NULL || s->picture == NULL) return LW_NO_MEMORY;
    for (size_t i = 0; i < texels * 3; i++)
        s->direction[i] = 0.3f + 0.4f * lw_random_unit(lw_random_hash2(2, (uint32_t)i));
    for (size_t i = 0; i < texels * 3; i++)
        s->light[i] =
            s->settings->dark ? 0 : LIGHT * (0.5f + lw_random_unit(lw_random_hash2(1, (uint32_t)i)));
    return LW_OK;
}

static enum lw_status open_flat(struct scene *s, struct lw_error *err) {
    bool *node_moves = s->pose.node_moves;
    s->pose.node_moves = calloc((size_t)s->scene->node_count + 1, sizeof *node_moves);
    enum lw_status status =
        s->pose.node_moves == NULL ? LW_NO_MEMORY : lw_trace_create(s->scene, &s->pose, &s->flat, err);
    free(s->pose.node_moves);
    s->pose.node_moves = node_moves;
    return status;
}

static enum lw_status set_up(struct scene *s, const char *name, struct lw_error *err) {
    const struct settings *o = s->settings;
    enum lw_status status =
        bench_open(&o->open, name, LW_SCENE_MOTION_ALL, o->time_s, &s->scene, &s->pose, &s->map, err);
    if (status != LW_OK) return status;
    status = open_flat(s, err);
    if (status != LW_OK) return status;
    s->view = (struct lw_compose_view){.width = (uint32_t)o->width, .height = (uint32_t)o->height};
    status = bench_view_camera(name, s->scene, &s->pose, s->flat, (float)o->width / (float)o->height,
                               &s->view.camera, err);
    if (status == LW_OK) status = lw_client_lights_init(&s->drawn, s->scene, &s->pose, o->lights, err);
    return status == LW_OK ? make_light(s) : status;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *settings = context;
    struct scene s = {.settings = settings,
                      .threads =
                          settings->open.threads ? (int)settings->open.threads : omp_get_max_threads()};
    enum lw_status status = set_up(&s, name, err);
    if (status == LW_OK) status = measure(&s, name, false, err);
    if (status == LW_OK) status = measure(&s, name, true, err);
    free(s.picture);
    free(s.direction);
    free(s.light);
    lw_client_lights_finish(&s.drawn);
    lw_trace_destroy(s.flat);
    bench_close(s.scene, &s.pose, &s.map);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "%s: %s", name, lw_status_text(status));
}

int main(int argc, char **argv) {
    struct settings s = {.width = 1280, .height = 720, .rounds = 9, .bounces = 2};
    const struct lw_option table[] = {
        BENCH_SIZE(&s, "1280", "720", 1, 1),
        BENCH_ROUNDS(&s, ROUNDS_MAX),
        BENCH_INT("bounces", "of the path tracer (default 2)", &s.bounces, 0, LW_PATH_TRACE_BOUNCES_MAX),
        BENCH_TIME(&s),
        {"client-lights", "auto|none|NAMES", "whose direct light is drawn at pixels (default auto)",
         LW_OPTION_STRING, &s.lights, 0, 0, NULL},
        {"dark", NULL, "no light in the texels", LW_OPTION_FLAG, &s.dark, 0, 0, NULL},
        BENCH_FOLDER(&s)};
    return BENCH_MAIN(argc, argv, table, .name = "bench_compose",
                      .about = "CPU time of a composed view, by the bare tracer's.",
                      .operand = "SCENE[@CAMERA]",
                      .heading = "| scene | motion | raw | rays | compose | compose_over_raw | "
                                 "drawn | drawn_over_compose | shadow rays a pixel | "
                                 "directed_over_compose | path |\n"
                                 "|---|---|---|---|---|---|---|---|---|---|---|",
                      .open = &s.open, .context = &s);
}
