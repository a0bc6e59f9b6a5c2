/* bench_renderers: how near each path renderer (path_renderer.h) comes to the reference with few samples, and
 * what that costs.
 *
 *     bench_renderers [OPTIONS] SCENE[@PX,PY,PZ:TX,TY,TZ:FOV]...
 *
 * A camera moves and turns through each scene for --frames pictures while its animation runs; the last
 * one is compared with a path trace of --reference samples. One table in Markdown per scene: relMSE =
 * mean((x-t)^2 / (t^2 + eps)), eps = 1 % of the mean of t^2, less what the reference's own noise adds; CPU
 * seconds per picture: of first hits and paths, and of the filter. over_raw: a renderer's rays a CPU second,
 * with all that it does, over those of bare rays through the same pixels, 16 neighbours at a time. Bounce
 * rays are not parallel, so that 1 cannot be reached. With -o DIR also the pictures: of each renderer, and
 * the reference. */
#include "client/paths/path_renderer.h"
#include "client/view/tonemap.h"
#include "common/base/clock.h"
#include "common/image/image.h"
#include "common/scene/scene_motion.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_view.h"
#include "tests/support/support.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define BARE_ROUNDS 5

struct settings {
    struct lw_scene_open open;
    int64_t bounces, reference, frames, width, height, spp_min, spp_max;
    int64_t vpl_lights;
    const char *vpl_sets; /* apart by commas */
    double vpl_near_m;
    double move_m, turn_deg, step_s, start_s;
    int motion;            /* enum lw_scene_motion */
    const char *renderers; /* names, apart by commas; NULL: all */
    const char *folder;
};

struct scene {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_lights lights;
    struct lw_path_trace *tracer;
    struct lw_camera_view camera; /* the first frame's */
    float *reference;
    double reference_error; /* relMSE */
    double bare_rate;       /* rays a CPU second */
};

static size_t value_count(const struct scene *s) {
    return (size_t)s->settings->width * (size_t)s->settings->height * 3;
}

/* The camera of a frame: it goes on to its right and turns to its left. */
static struct lw_camera_view camera_at(const struct scene *s, int64_t frame) {
    const struct lw_camera_view *c = &s->camera;
    const float m = (float)(s->settings->move_m * (double)frame),
                a = (float)(s->settings->turn_deg * (double)frame) * LW_PI / 180;
    struct lw_vec3 position = lw_vec3_mad(c->position, c->right, m);
    struct lw_vec3 forward = lw_vec3_mad(lw_vec3_scale(c->forward, cosf(a)), c->right, -sinf(a));
    return lw_camera_look_at(position, lw_vec3_add(position, forward), c->fov_y);
}

static enum lw_status go_to(struct scene *s, int64_t frame, struct lw_error *err) {
    lw_pose_evaluate(&s->pose, s->scene, s->settings->start_s + s->settings->step_s * (double)frame);
    enum lw_status status = lw_trace_set_pose(s->trace, &s->pose, err);
    if (status != LW_OK) return status;
    lw_lights_set_pose(&s->lights, &s->pose);
    lw_path_trace_set_pose(s->tracer, &s->pose);
    return LW_OK;
}

static struct lw_path_view view_at(const struct scene *s, int64_t frame) {
    return (struct lw_path_view){.camera = camera_at(s, frame),
                                 .bounces = (uint32_t)s->settings->bounces,
                                 .seed = 1,
                                 .pixel = LW_PATH_PIXEL_CENTRE};
}

static enum lw_status trace_reference(struct scene *s, struct lw_error *err) {
    const int64_t last = s->settings->frames - 1;
    struct lw_path_film film;
    enum lw_status status = go_to(s, last, err);
    if (status == LW_OK)
        status = lw_path_film_init(&film, (uint32_t)s->settings->width, (uint32_t)s->settings->height, err);
    if (status != LW_OK) return status;
    struct lw_path_view view = view_at(s, last);
    view.seed = 77;
    lw_path_trace_render(s->tracer, &view, (uint32_t)s->settings->reference, &film, NULL);
    lw_path_film_resolve(&film, s->reference);
    s->reference_error = lw_path_film_error(&film) * lw_path_film_error(&film);
    lw_path_film_finish(&film);
    return LW_OK;
}

/* Without the noise of the reference. */
static double error_of(const struct scene *s, const float *rgb) {
    return lw_support_relmse(rgb, s->reference, value_count(s)) - s->reference_error;
}

/* CPU seconds of a bare ray through each pixel, with nothing asked of what it meets. */
static double bare_rays_s(const struct scene *s) {
    const uint32_t width = (uint32_t)s->settings->width, height = (uint32_t)s->settings->height;
    const struct lw_camera_view camera = camera_at(s, s->settings->frames - 1);
    const struct lw_camera_plane plane = lw_camera_plane(&camera, width, height);
    const uint64_t began_ns = lw_clock_thread_cpu_ns();
    for (uint32_t top = 0; top < height; top += 4)
        for (uint32_t left = 0; left < width; left += 4) {
            struct lw_ray16 rays = {.salt = 0};
            struct lw_hit16 hits;
            for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
                const float x = (float)(left + i % 4) + 0.5f, y = (float)(top + i / 4) + 0.5f;
                const struct lw_vec3 d = lw_camera_direction(&plane, x, y);
                lw_trace_set_ray(&rays, i, camera.position, d, INFINITY);
            }
            lw_trace_closest16(s->trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, 0xffff, &rays, &hits);
        }
    return 1e-9 * (double)(lw_clock_thread_cpu_ns() - began_ns);
}

/* Rays a CPU second; the best of some rounds, since other programs can only make it slower. */
static double bare_rate(const struct scene *s) {
    double least_s = bare_rays_s(s);
    for (int i = 1; i < BARE_ROUNDS; i++) least_s = fmin(least_s, bare_rays_s(s));
    const double across = ceil((double)s->settings->width / 4), down = ceil((double)s->settings->height / 4);
    return LW_TRACE_WIDTH * across * down / least_s;
}

static enum lw_status write_picture(const struct scene *s, const char *name, const char *what, int64_t spp,
                                    const float *rgb, struct lw_error *err) {
    char path[512];
    const struct settings *o = s->settings;
    if (o->folder == NULL) return LW_OK;
    const char *slash = strrchr(name, '/'), *base = slash ? slash + 1 : name;
    snprintf(path, sizeof path, "%s/%.*s-%s-%d.png", o->folder, (int)strcspn(base, "@"), base, what,
             (int)spp);
    uint8_t *rgb8 = malloc(value_count(s));
    if (rgb8 == NULL) return lw_status_fail(err, LW_NO_MEMORY, "%s", path);
    const size_t pixels = value_count(s) / 3;
    struct lw_tonemap tonemap;
    lw_tonemap_init(&tonemap, LW_TONEMAP_REINHARD, lw_tonemap_auto_stops(s->reference, pixels));
    lw_tonemap_encode(&tonemap, rgb, pixels, 3, rgb8);
    enum lw_status status = lw_image_write_png(path, rgb8, (uint32_t)o->width, (uint32_t)o->height, err);
    free(rgb8);
    return status;
}

static enum lw_status measure(struct scene *s, const char *name, enum lw_path_renderer_kind kind,
                              uint32_t spp, uint32_t sets, struct lw_error *err) {
    const struct settings *o = s->settings;
    struct lw_path_renderer *renderer;
    struct lw_path_frame_cost cost = {0};
    const float *rgb = NULL;
    enum lw_status status = lw_path_renderer_create(
        &(struct lw_path_renderer_desc){
            .kind = kind,
            .scene = s->scene,
            .trace = s->trace,
            .tracer = s->tracer,
            .lights = &s->lights,
            .vpl = {.lights = (uint32_t)o->vpl_lights, .sets = sets, .near_m = (float)o->vpl_near_m},
            .width = (uint32_t)o->width,
            .height = (uint32_t)o->height,
            .bounces = (uint32_t)o->bounces,
            .threads = (unsigned)o->open.threads},
        &renderer, err);
    if (status != LW_OK) return status;
    for (int64_t f = 0; status == LW_OK && f < o->frames; f++) {
        status = go_to(s, f, err);
        if (status != LW_OK) break;
        const struct lw_path_frame frame = {
            .pose = &s->pose, .camera = camera_at(s, f), .samples = spp, .seed = 1, .number = (uint32_t)f};
        rgb = lw_path_renderer_frame(renderer, &frame, &cost);
    }
    if (status == LW_OK) {
        const double n = (double)o->frames, total_s = (cost.trace_s + cost.filter_s) / n;
        printf("| %s", lw_path_renderer_name(kind));
        if (sets) printf(", %u set%s", sets, sets == 1 ? "" : "s");
        printf(" | %u | %.4g | %.3f | %.3f | %.3f | %.3f | %.3f |\n", spp, error_of(s, rgb), cost.trace_s / n,
               cost.filter_s / n, total_s, 1e-6 * (double)cost.rays / n,
               (double)cost.rays / (total_s * n) / s->bare_rate);
        if (kind == LW_PATH_RENDERER_VPL)
            fprintf(stderr, "vpl: nearer than %.3g m a light is not brighter\n",
                    (double)lw_path_renderer_near_m(renderer));
        fflush(stdout);
        status = write_picture(s, name, lw_path_renderer_name(kind), spp, rgb, err);
    }
    lw_path_renderer_destroy(renderer);
    return status;
}

/* Whether a renderer is to be measured. */
static bool is_asked_for(const struct settings *settings, enum lw_path_renderer_kind kind) {
    const char *name = lw_path_renderer_name(kind);
    for (const char *at = settings->renderers; at;) {
        const size_t length = strcspn(at, ",");
        if (length == strlen(name) && strncmp(at, name, length) == 0) return true;
        at = at[length] ? at + length + 1 : NULL;
    }
    return !settings->renderers;
}

/* Each number of sets that is asked for. */
static enum lw_status measure_vpl(struct scene *s, const char *name, uint32_t spp, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (const char *at = s->settings->vpl_sets; status == LW_OK && at;) {
        char *end;
        const unsigned long sets = strtoul(at, &end, 10);
        if (end == at || (*end && *end != ',') || sets < 1 || sets > LW_INSTANT_RADIOSITY_SETS_MAX)
            return lw_status_fail(err, LW_USAGE, "--vpl-sets: \"%s\" is no list of numbers up to %u",
                                  s->settings->vpl_sets, LW_INSTANT_RADIOSITY_SETS_MAX);
        status = measure(s, name, LW_PATH_RENDERER_VPL, spp, (uint32_t)sets, err);
        at = *end ? end + 1 : NULL;
    }
    return status;
}

static enum lw_status measure_all(struct scene *s, const char *name, uint32_t spp, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (int k = 0; status == LW_OK && k < LW_PATH_RENDERER_COUNT; k++) {
        const enum lw_path_renderer_kind kind = (enum lw_path_renderer_kind)k;
        if (!is_asked_for(s->settings, kind)) continue;
        status = kind == LW_PATH_RENDERER_VPL ? measure_vpl(s, name, spp, err)
                                              : measure(s, name, kind, spp, 0, err);
    }
    return status;
}

static enum lw_status set_up(struct scene *s, const char *name, struct lw_error *err) {
    enum lw_status status =
        bench_open(&s->settings->open, name, s->settings->motion, 0, &s->scene, &s->pose, NULL, err);
    if (status != LW_OK) return status;
    status = lw_trace_create(s->scene, &s->pose, &s->trace, err);
    if (status != LW_OK) return status;
    status = lw_lights_init(&s->lights, s->scene, &s->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "no memory for the lights");
    status =
        lw_path_trace_create(&(struct lw_path_trace_desc){.scene = s->scene,
                                                          .trace = s->trace,
                                                          .lights = &s->lights,
                                                          .pose = &s->pose,
                                                          .threads = (unsigned)s->settings->open.threads},
                             &s->tracer, err);
    if (status != LW_OK) return status;
    const float aspect = (float)s->settings->width / (float)s->settings->height;
    status = bench_view_camera(name, s->scene, &s->pose, s->trace, aspect, &s->camera, err);
    if (status != LW_OK) return status;
    s->reference = malloc(value_count(s) * sizeof *s->reference);
    if (!s->reference) return lw_status_fail(err, LW_NO_MEMORY, "no memory for pictures");
    return status;
}

static void tear_down(struct scene *s) {
    free(s->reference);
    lw_path_trace_destroy(s->tracer);
    lw_lights_finish(&s->lights);
    lw_trace_destroy(s->trace);
    bench_close(s->scene, &s->pose, NULL);
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *settings = context;
    struct scene s = {.settings = settings};
    enum lw_status status = set_up(&s, name, err);
    if (status == LW_OK) status = trace_reference(&s, err);
    if (status == LW_OK) {
        s.bare_rate = bare_rate(&s);
        printf(
            "\n%s, %dx%d, %d frames; relMSE of the reference %.2g; %.3g M bare rays a CPU second; pictures "
            "at exposure %.3f\n\n",
            name, (int)settings->width, (int)settings->height, (int)settings->frames, s.reference_error,
            1e-6 * s.bare_rate, (double)lw_tonemap_auto_stops(s.reference, value_count(&s) / 3));
        printf(
            "| renderer | spp | relMSE | paths, CPU s | filter, CPU s | frame, CPU s | Mrays | over_raw |\n");
        printf("|---|---|---|---|---|---|---|---|\n");
        status = write_picture(&s, name, "reference", settings->reference, s.reference, err);
    }
    for (int64_t spp = settings->spp_min; status == LW_OK && spp <= settings->spp_max; spp *= 2)
        status = measure_all(&s, name, (uint32_t)spp, err);
    tear_down(&s);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.bounces = 2,
                         .reference = 512,
                         .frames = 16,
                         .width = 320,
                         .height = 180,
                         .spp_min = 1,
                         .spp_max = 8,
                         .move_m = 0.02,
                         .turn_deg = 0.5,
                         .step_s = 1 / 30.0,
                         .motion = LW_SCENE_MOTION_ALL,
                         .vpl_sets = "8"};
    const struct lw_option table[] = {
        BENCH_BOUNCES(&s, LW_PATH_TRACE_BOUNCES_MAX),
        BENCH_INT("reference", "samples of the reference (default 512)", &s.reference, 2, 1 << 20),
        BENCH_INT("frames", "pictures on the way (default 16)", &s.frames, 1, 1 << 20),
        BENCH_SIZE(&s, "320", "180", 1, 1),
        BENCH_INT("spp-min", "fewest samples per pixel (default 1)", &s.spp_min, 1, 1 << 16),
        BENCH_INT("spp-max", "most of them (default 8)", &s.spp_max, 1, 1 << 16),
        {"move", "METRES", "the camera's way per picture, to its right (default 0.02)", LW_OPTION_REAL,
         &s.move_m, -1e6, 1e6, NULL},
        {"turn", "DEG", "its turn per picture, to its left (default 0.5)", LW_OPTION_REAL, &s.turn_deg, -180,
         180, NULL},
        {"renderers", "LIST", "those to measure, apart by commas (default: all)", LW_OPTION_STRING,
         &s.renderers, 0, 0, NULL},
        BENCH_INT("vpl-lights", "virtual point lights of vpl (default 512)", &s.vpl_lights, 0,
                  LW_INSTANT_RADIOSITY_LIGHTS_MAX),
        {"vpl-sets", "LIST", "sets that they come in, apart by commas (default 8)", LW_OPTION_STRING,
         &s.vpl_sets, 0, 0, NULL},
        {"vpl-near", "METRES",
         "nearer than this they are not brighter (default: by the area of all surfaces)", LW_OPTION_REAL,
         &s.vpl_near_m, 0, 1e6, NULL},
        {"time", "SECONDS", "of the animation at the first picture (default 0)", LW_OPTION_REAL, &s.start_s,
         0, 1e9, NULL},
        {"step", "SECONDS", "of the animation from picture to picture (default 1/30)", LW_OPTION_REAL,
         &s.step_s, 0, 1e9, NULL},
        {"motion", LW_SCENE_MOTION_CHOICES, "what moves but the camera (default all)", LW_OPTION_CHOICE,
         &s.motion, 0, 0, NULL},
        BENCH_FOLDER(&s)};
    return BENCH_MAIN(argc, argv, table, .name = "bench_renderers",
                      .about = "The error and cost of few paths per pixel, by each path renderer.",
                      .operand = "SCENE[@CAMERA]", .open = &s.open, .folder = &s.folder, .context = &s);
}
