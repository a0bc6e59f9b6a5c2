/* bench_views: the fixed views of scenes (fixed_views.h), and by how much light that is late is off in them.
 *
 *     bench_views [OPTIONS] SCENE...
 *
 * Prints the views as the rows of the table in fixed_views.c, each with its mean luminance; with --pick those that the rule finds,
 * whether or not there is a table. With --motion NAME and --lag also, per view, relMSE (truth.h) of light that is a
 * second late, emitters masked, at --moments times from 2 to 6 s: whether a measurement of that motion tells old light
 * from new. With -o DIR a picture of each view. */
#include "client/load/fixed_views.h"
#include "client/load/truth.h"
#include "client/view/tonemap.h"
#include "common/image/image.h"
#include "common/scene/scene_motion.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define FIRST_S 2.0
#define LAST_S  6.0
#define LATE_S  1.0

struct settings {
    struct lw_scene_open open;
    bool pick, lag;
    int motion;
    int64_t width, height, samples, moments, bounces;
    double at_s;
    const char *folder;
};

struct scene {
    const struct settings *settings;
    const char *name;
    struct lw_scene *scene;
    struct lw_fixed_views views;
    struct lw_path_world world;
};

static enum lw_status write_picture(const struct scene *s, uint32_t view, const struct lw_truth *truth,
                                    struct lw_error *err) {
    char path[512], label[64];
    const size_t pixels = (size_t)truth->width * truth->height;
    float *rgb = malloc(3 * pixels * sizeof *rgb);
    uint8_t *rgb8 = malloc(3 * pixels);
    enum lw_status status =
        rgb && rgb8 ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    if (status == LW_OK) {
        for (size_t i = 0; i < 3 * pixels; i++) rgb[i] = 0.5f * (truth->half[0][i] + truth->half[1][i]);
        snprintf(path, sizeof path, "%s/%s-%02u.png", s->settings->folder,
                 bench_label(s->name, label, sizeof label), view);
        struct lw_tonemap tonemap;
        lw_tonemap_init(&tonemap, LW_TONEMAP_REINHARD, lw_tonemap_auto_stops(rgb, pixels));
        lw_tonemap_encode(&tonemap, rgb, pixels, 3, rgb8);
        status = lw_image_write_png(path, rgb8, truth->width, truth->height, err);
    }
    free(rgb8);
    free(rgb);
    return status;
}

static double luminance_of(const struct lw_truth *truth) {
    static const double weight[3] = {0.2126, 0.7152, 0.0722};
    const size_t values = (size_t)truth->width * truth->height * 3;
    double sum = 0;
    for (size_t i = 0; i < values; i++)
        sum += weight[i % 3] * 0.5 * ((double)truth->half[0][i] + (double)truth->half[1][i]);
    return 3 * sum / (double)values;
}

/* The light of a second ago, in the picture of now. */
static enum lw_status measure_lag(struct scene *s, uint32_t view, double time_s, double *out_error,
                                  struct lw_error *err) {
    const struct settings *o = s->settings;
    const uint32_t width = (uint32_t)o->width, height = (uint32_t)o->height, samples = (uint32_t)o->samples;
    const struct lw_camera_view camera = lw_fixed_views_at(&s->views, view, time_s);
    struct lw_truth truth = {0};
    uint32_t *object = malloc((size_t)width * height * sizeof *object);
    enum lw_status status = object ? lw_path_world_set_time(&s->world, time_s, err)
                                   : lw_status_fail(err, LW_NO_MEMORY, "no memory for a view");
    if (status == LW_OK) status = lw_truth_init(&truth, &s->world, &camera, width, height, samples, 1, err);
    if (status == LW_OK) status = lw_truth_look(&s->world, &camera, width, height, object, err);
    if (status == LW_OK) status = lw_path_world_set_time(&s->world, time_s - LATE_S, err);
    if (status == LW_OK)
        status = lw_truth_lag_error(&truth, object, &s->world, &camera, samples, 2, out_error, err);
    lw_truth_finish(&truth);
    free(object);
    return status;
}

static void print_view(const struct lw_fixed_view *v, uint32_t i, double luminance) {
    const struct lw_vec3 p = v->position, t = v->target;
    printf("{{%.2ff, %.2ff, %.2ff}, {%.2ff, %.2ff, %.2ff}, %.0f, \"%s\"}, /* %u: %.3g */", (double)p.x,
           (double)p.y, (double)p.z, (double)t.x, (double)t.y, (double)t.z, (double)v->fov_deg, v->shows, i,
           luminance);
}

static enum lw_status look_at_view(struct scene *s, uint32_t i, double *sum, struct lw_error *err) {
    const struct settings *o = s->settings;
    const struct lw_camera_view camera = lw_fixed_views_at(&s->views, i, o->at_s);
    struct lw_truth truth = {0};
    enum lw_status status = lw_path_world_set_time(&s->world, o->at_s, err);
    if (status == LW_OK)
        status = lw_truth_init(&truth, &s->world, &camera, (uint32_t)o->width, (uint32_t)o->height,
                               (uint32_t)o->samples, 1, err);
    if (status != LW_OK) return status;
    print_view(&s->views.view[i], i, luminance_of(&truth));
    if (o->folder) status = write_picture(s, i, &truth, err);
    lw_truth_finish(&truth);
    for (int64_t k = 0; o->lag && status == LW_OK && k < o->moments; k++) {
        double error = 0;
        const double share = o->moments > 1 ? (double)k / (double)(o->moments - 1) : 0.5;
        status = measure_lag(s, i, FIRST_S + share * (LAST_S - FIRST_S), &error, err);
        printf(" %.4f", error);
        *sum += error;
    }
    puts("");
    fflush(stdout);
    return status;
}

static enum lw_status look(struct scene *s, struct lw_error *err) {
    const struct settings *o = s->settings;
    struct lw_scene_motion_report report;
    enum lw_status status = lw_scene_motion_set(s->scene, (enum lw_scene_motion)o->motion, &report, err);
    if (status == LW_OK)
        status =
            lw_path_world_init(&s->world, s->scene, (uint32_t)o->bounces, (unsigned)o->open.threads, err);
    if (status != LW_OK) return status;
    double sum = 0;
    printf("%s, %s: %s%s, %g m/s, %g degrees/s\n", s->name,
           lw_scene_motion_name((enum lw_scene_motion)o->motion), report.light ? report.light : "",
           report.object ? report.object : "", (double)report.speed_m_s, (double)report.speed_deg_s);
    for (uint32_t i = 0; status == LW_OK && i < LW_FIXED_VIEWS_COUNT; i++)
        status = look_at_view(s, i, &sum, err);
    if (status == LW_OK && o->lag)
        printf("%s, %s: light a second late: relMSE %.4f\n", s->name,
               lw_scene_motion_name((enum lw_scene_motion)o->motion),
               sum / (double)(LW_FIXED_VIEWS_COUNT * o->moments));
    return status;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *o = context;
    struct scene s = {.settings = o, .name = name};
    struct lw_scene_open open = o->open;
    open.path = name;
    enum lw_status status = lw_scene_open(&open, &s.scene, err);
    if (status != LW_OK) return status;
    status = o->pick ? lw_fixed_views_pick(&s.views, s.scene, (unsigned)o->open.threads, err)
                     : lw_fixed_views_init(&s.views, s.scene, (unsigned)o->open.threads, err);
    if (status == LW_OK) status = look(&s, err);
    lw_path_world_finish(&s.world);
    lw_scene_destroy(s.scene);
    return status;
}

static enum lw_status begin(void *context, struct lw_error *err) {
    (void)err;
    const struct settings *o = context;
    if (o->folder) mkdir(o->folder, 0777); /* where that fails, the first picture says so */
    return LW_OK;
}

int main(int argc, char **argv) {
    struct settings s = {
        .width = 192, .height = 108, .samples = 32, .moments = 3, .bounces = 2, .at_s = 3.0, .motion = 0};
    const struct lw_option table[] = {
        {"pick", NULL, "the rule's views, though there may be a table", LW_OPTION_FLAG, &s.pick, 0, 0, NULL},
        {"motion", LW_SCENE_MOTION_CHOICES, "what moves (default static)", LW_OPTION_CHOICE, &s.motion, 0, 0,
         NULL},
        {"lag", NULL, "measure light that is a second late", LW_OPTION_FLAG, &s.lag, 0, 0, NULL},
        {"moments", "N", "at which it is measured (default 3)", LW_OPTION_INT, &s.moments, 1, 1000, NULL},
        {"at", "S", "the pictures' moment (default 3)", LW_OPTION_REAL, &s.at_s, 0, 1e6, NULL},
        {"width", "N", "of pictures (default 192)", LW_OPTION_INT, &s.width, 16, 4096, NULL},
        {"height", "N", "of pictures (default 108)", LW_OPTION_INT, &s.height, 16, 4096, NULL},
        {"samples", "N", "paths per pixel (default 32)", LW_OPTION_INT, &s.samples, 2, 65536, NULL},
        {"bounces", "N", "of indirect light (default 2)", LW_OPTION_INT, &s.bounces, 0, 16, NULL},
        {"o", "DIR", "folder for pictures", LW_OPTION_STRING, &s.folder, 0, 0, NULL},
    };
    return bench_main(&(struct bench_program){.name = "bench_views",
                                              .about = "Prints the fixed views of scenes.",
                                              .table = table,
                                              .count = sizeof table / sizeof table[0],
                                              .open = &s.open,
                                              .context = &s,
                                              .begin = begin,
                                              .run = run},
                      argc, argv);
}
