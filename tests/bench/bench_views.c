/* bench_views: the fixed views of scenes (fixed_views.h), and by how much light that is late is off in them.
 *
 *     bench_views [OPTIONS] SCENE...
 *
 * Prints the views as rows of a table in fixed_views.c, each with its mean luminance; with --pick those that
 * the rule finds, whether or not there is a table. With --motion NAME and --lag also, per view, relMSE of
 * light that is a second late: whether a measurement of that motion tells old light from new. It is taken at
 * --moments times from 2 to 6 s; one is at 2 s, when lightwell-load crossover judges. Pixels count that show
 * the same object both times and do not shine; eps is 1 % of the mean square of these pixels, in the view or
 * in all views. With few samples noise in the divisor makes it too large: take off what --motion static has.
 * With -o DIR a picture of each view. */
#include "client/measure/figures/reference.h"
#include "client/measure/sides/fixed_views.h"
#include "client/view/tonemap.h"
#include "common/image/image.h"
#include "common/scene/scene_motion.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

/* Now and late. */
struct pair {
    struct lw_reference light[2];
    uint32_t *object; /* LW_TRACE_MISS: shines, or shows another object then */
};

static enum lw_status write_picture(const struct scene *s, uint32_t view,
                                    const struct lw_reference *reference, struct lw_error *err) {
    char path[512], label[64];
    const size_t pixels = (size_t)reference->width * reference->height;
    float *rgb = malloc(3 * pixels * sizeof *rgb);
    uint8_t *rgb8 = malloc(3 * pixels);
    enum lw_status status =
        rgb && rgb8 ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    if (status == LW_OK) {
        for (size_t i = 0; i < 3 * pixels; i++)
            rgb[i] = 0.5f * (reference->half[0][i] + reference->half[1][i]);
        snprintf(path, sizeof path, "%s/%s-%02u.png", s->settings->folder,
                 bench_label(s->name, label, sizeof label), view);
        struct lw_tonemap tonemap;
        lw_tonemap_init(&tonemap, LW_TONEMAP_REINHARD, lw_tonemap_auto_stops(rgb, pixels));
        lw_tonemap_encode(&tonemap, rgb, pixels, 3, rgb8);
        status = lw_image_write_png(path, rgb8, reference->width, reference->height, err);
    }
    free(rgb8);
    free(rgb);
    return status;
}

static double luminance_of(const struct lw_reference *reference) {
    static const double weight[3] = {0.2126, 0.7152, 0.0722};
    const size_t values = (size_t)reference->width * reference->height * 3;
    double sum = 0;
    for (size_t i = 0; i < values; i++)
        sum += weight[i % 3] * 0.5 * ((double)reference->half[0][i] + (double)reference->half[1][i]);
    return 3 * sum / (double)values;
}

/* The current light and that of a second ago, in the current picture. */
static enum lw_status trace_pair(struct scene *s, uint32_t view, uint32_t moment, double time_s,
                                 struct pair *pair, struct lw_error *err) {
    const struct settings *o = s->settings;
    const uint32_t width = (uint32_t)o->width, height = (uint32_t)o->height, samples = (uint32_t)o->samples;
    const struct lw_camera_view camera = lw_fixed_views_at(&s->views, view, time_s);
    const size_t pixels = (size_t)width * height;
    uint32_t *then = malloc(pixels * sizeof *then);
    pair->object = malloc(pixels * sizeof *pair->object);
    enum lw_status status =
        then && pair->object ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "no memory for a view");
    for (int late = 0; status == LW_OK && late < 2; late++) {
        status = lw_path_world_set_time(&s->world, time_s - late * LATE_S, err);
        if (status == LW_OK)
            status = lw_reference_init(&pair->light[late], &s->world, &camera, width, height, samples,
                                       1 + 2 * (moment * LW_FIXED_VIEWS_COUNT + view) + (uint32_t)late, err);
        if (status == LW_OK)
            status = lw_reference_look(&s->world, &camera, width, height, late ? then : pair->object, err);
    }
    for (size_t i = 0; status == LW_OK && i < pixels; i++)
        if (then[i] != pair->object[i]) pair->object[i] = LW_TRACE_MISS;
    free(then);
    return status;
}

static double value_of(const struct lw_reference *t, size_t i) {
    return 0.5 * ((double)t->half[0][i] + (double)t->half[1][i]);
}

/* The mean over pixels that count. */
static double mean_square_of(const struct pair *pair) {
    const size_t values = (size_t)pair->light[0].width * pair->light[0].height * 3;
    double sum = 0;
    size_t count = 0;
    for (size_t i = 0; i < values; i++)
        if (pair->object[i / 3] != LW_TRACE_MISS) {
            sum += (double)pair->light[0].half[0][i] * (double)pair->light[0].half[1][i];
            count++;
        }
    return count ? sum / (double)count : 0;
}

/* relMSE with a given eps, by independent halves: noise adds nothing in the mean. */
static double error_of(const struct pair *pair, double eps) {
    const struct lw_reference *now = &pair->light[0], *late = &pair->light[1];
    const size_t values = (size_t)now->width * now->height * 3;
    double sum = 0;
    size_t count = 0;
    for (size_t i = 0; i < values; i++) {
        if (pair->object[i / 3] == LW_TRACE_MISS) continue;
        const double t = value_of(now, i);
        sum += ((double)late->half[0][i] - (double)now->half[0][i]) *
               ((double)late->half[1][i] - (double)now->half[1][i]) / (t * t + eps);
        count++;
    }
    return count ? sum / (double)count : 0;
}

static void free_pairs(struct pair *pair, size_t count) {
    for (size_t i = 0; pair && i < count; i++) {
        lw_reference_finish(&pair[i].light[0]);
        lw_reference_finish(&pair[i].light[1]);
        free(pair[i].object);
    }
    free(pair);
}

static void print_lag(const struct scene *s, const struct pair *pair, size_t moments) {
    double mean_square = 0, own = 0, shared = 0;
    const size_t count = moments * LW_FIXED_VIEWS_COUNT;
    for (size_t i = 0; i < count; i++) mean_square += mean_square_of(&pair[i]) / (double)count;
    puts("| view | eps of the view | eps of all views |\n|---|---|---|");
    for (size_t v = 0; v < LW_FIXED_VIEWS_COUNT; v++) {
        double by_own = 0, by_all = 0;
        for (size_t k = 0; k < moments; k++) {
            const struct pair *p = &pair[v * moments + k];
            by_own += error_of(p, 0.01 * mean_square_of(p)) / (double)moments;
            by_all += error_of(p, 0.01 * mean_square) / (double)moments;
        }
        printf("| %zu | %.4f | %.4f |\n", v, by_own, by_all);
        own += by_own / LW_FIXED_VIEWS_COUNT;
        shared += by_all / LW_FIXED_VIEWS_COUNT;
    }
    printf("| all, %s, %s | %.4f | %.4f |\n", s->name,
           lw_scene_motion_name((enum lw_scene_motion)s->settings->motion), own, shared);
}

static enum lw_status measure_lag(struct scene *s, struct lw_error *err) {
    const size_t moments = (size_t)s->settings->moments, count = moments * LW_FIXED_VIEWS_COUNT;
    struct pair *pair = calloc(count, sizeof *pair);
    enum lw_status status = pair ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "no memory for views");
    for (size_t i = 0; status == LW_OK && i < count; i++) {
        const size_t k = i % moments;
        const double share = moments > 1 ? (double)k / (double)(moments - 1) : 0;
        status = trace_pair(s, (uint32_t)(i / moments), (uint32_t)k, FIRST_S + share * (LAST_S - FIRST_S),
                            &pair[i], err);
    }
    if (status == LW_OK) print_lag(s, pair, moments);
    free_pairs(pair, count);
    return status;
}

static void print_view(const struct lw_fixed_view *v, uint32_t i, double luminance) {
    const struct lw_vec3 p = v->position, t = v->target;
    printf("{{%.2ff, %.2ff, %.2ff}, {%.2ff, %.2ff, %.2ff}, \"%s\"}, /* %u: %.3g */", (double)p.x, (double)p.y,
           (double)p.z, (double)t.x, (double)t.y, (double)t.z, v->shows, i, luminance);
}

static enum lw_status look_at_view(struct scene *s, uint32_t i, struct lw_error *err) {
    const struct settings *o = s->settings;
    const struct lw_camera_view camera = lw_fixed_views_at(&s->views, i, o->at_s);
    struct lw_reference reference = {0};
    enum lw_status status = lw_path_world_set_time(&s->world, o->at_s, err);
    if (status == LW_OK)
        status = lw_reference_init(&reference, &s->world, &camera, (uint32_t)o->width, (uint32_t)o->height,
                                   (uint32_t)o->samples, 1, err);
    if (status != LW_OK) return status;
    print_view(&s->views.view[i], i, luminance_of(&reference));
    if (o->folder) status = write_picture(s, i, &reference, err);
    lw_reference_finish(&reference);
    puts("");
    fflush(stdout);
    return status;
}

static enum lw_status print_views(struct scene *s, struct lw_error *err) {
    const struct settings *o = s->settings;
    struct lw_scene_motion_report report;
    enum lw_status status = lw_scene_motion_set(s->scene, (enum lw_scene_motion)o->motion, &report, err);
    if (status == LW_OK)
        status =
            lw_path_world_init(&s->world, s->scene, (uint32_t)o->bounces, (unsigned)o->open.threads, err);
    if (status != LW_OK) return status;
    printf("%s, %s: %s%s, %g m/s, %g degrees/s\n", s->name,
           lw_scene_motion_name((enum lw_scene_motion)o->motion), report.light ? report.light : "",
           report.object ? report.object : "", (double)report.speed_m_s, (double)report.speed_deg_s);
    for (uint32_t i = 0; status == LW_OK && i < LW_FIXED_VIEWS_COUNT; i++) status = look_at_view(s, i, err);
    if (status == LW_OK && o->lag) status = measure_lag(s, err);
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
    if (status == LW_OK) status = print_views(&s, err);
    lw_path_world_finish(&s.world);
    lw_scene_destroy(s.scene);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {
        .width = 192, .height = 108, .samples = 32, .moments = 3, .bounces = 2, .at_s = 3.0, .motion = 0};
    const struct lw_option table[] = {
        {"pick", NULL, "the rule's views, though there may be a table", LW_OPTION_FLAG, &s.pick, 0, 0, NULL},
        {"motion", LW_SCENE_MOTION_CHOICES, "what moves (default static)", LW_OPTION_CHOICE, &s.motion, 0, 0,
         NULL},
        {"lag", NULL, "measure light that is a second late", LW_OPTION_FLAG, &s.lag, 0, 0, NULL},
        BENCH_INT("moments", "from 2 to 6 s at which it is measured (default 3; 1: at 2 s)", &s.moments, 1,
                  1000),
        {"at", "S", "the pictures' moment (default 3)", LW_OPTION_REAL, &s.at_s, 0, 1e6, NULL},
        BENCH_INT("width", "of pictures (default 192)", &s.width, 16, 4096),
        BENCH_INT("height", "of pictures (default 108)", &s.height, 16, 4096),
        BENCH_INT("samples", "paths per pixel (default 32)", &s.samples, 2, 65536),
        BENCH_INT("bounces", "of indirect light (default 2)", &s.bounces, 0, 16),
        {"o", "DIR", "folder for pictures", LW_OPTION_STRING, &s.folder, 0, 0, NULL},
    };
    return BENCH_MAIN(argc, argv, table, .name = "bench_views", .about = "Prints the fixed views of scenes.",
                      .open = &s.open, .folder = &s.folder, .context = &s);
}
