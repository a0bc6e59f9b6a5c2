/* bench_paths: error of path-traced pictures over paths and over CPU time, with and without a guide.
 *
 *     bench_paths [OPTIONS] SCENE[@PX,PY,PZ:TX,TY,TZ:FOV]...
 *
 * Per scene a table in Markdown: with each guide, after 4, 8, 16 ... paths a pixel, relMSE = mean((x - t)^2 /
 * (t^2 + eps)), eps = 1 % of the mean of t^2, less what the reference's own noise adds; mean over --seeds
 * pictures that begin to learn from nothing. CPU seconds are of the whole process for one picture up to
 * there, learning included. Then what guiding gains: the ratio of relMSE at equal paths, and of the CPU
 * seconds to an equal relMSE, found along straight lines between the rows, both logarithmic. With -o DIR also
 * pictures of --picture paths, and the reference. */
#include "client/view/path_trace.h"
#include "client/view/tonemap.h"
#include "common/clock.h"
#include "common/guide/guide.h"
#include "common/image/image.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_view.h"
#include "tests/support/support.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROWS_MAX 21u

enum guide { OFF, LEARNED, GUIDES };
static const char *const guide_name[GUIDES] = {"off", "learned"};

struct settings {
    struct lw_scene_open open;
    int64_t bounces, reference, width, height, spp_min, spp_max, seeds, picture;
    double alpha, beta, trust;
    int show; /* enum lw_path_part */
    const char *folder, *truth;
};

struct row {
    double error, cpu_s, learn_s, rays;
};

struct bench {
    const struct settings *settings;
    const char *name;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_lights lights;
    struct lw_path_trace *tracer;
    struct lw_path_view view;
    float *reference, *picture;
    double reference_error; /* relMSE */
    struct row row[GUIDES][ROWS_MAX];
};

static size_t value_count(const struct bench *b) {
    return (size_t)b->settings->width * (size_t)b->settings->height * 3;
}

static enum lw_status create_guide(const struct bench *b, struct lw_guide **out, struct lw_error *err) {
    struct lw_guide_desc desc = {.alpha = (float)b->settings->alpha,
                                 .beta = (float)b->settings->beta,
                                 .trust = (float)b->settings->trust};
    if (!lw_pose_bounds(&b->pose, b->scene, &desc.minimum_ws, &desc.maximum_ws))
        return lw_status_fail(err, LW_BAD_DATA, "%s: the scene is empty", b->name);
    return lw_guide_create(&desc, out, err);
}

static enum lw_status write_picture(const struct bench *b, const char *what, int64_t spp, const float *rgb,
                                    struct lw_error *err) {
    char path[512], label[64];
    if (!b->settings->folder) return LW_OK;
    snprintf(path, sizeof path, "%s/%s-%s-%d.png", b->settings->folder,
             bench_label(b->name, label, sizeof label), what, (int)spp);
    uint8_t *rgb8 = malloc(value_count(b));
    if (!rgb8) return lw_status_fail(err, LW_NO_MEMORY, "%s", path);
    const size_t pixels = value_count(b) / 3;
    struct lw_tonemap tonemap;
    lw_tonemap_init(&tonemap, LW_TONEMAP_REINHARD, lw_tonemap_auto_stops(b->reference, pixels));
    lw_tonemap_encode(&tonemap, rgb, pixels, 3, rgb8);
    enum lw_status status =
        lw_image_write_png(path, rgb8, (uint32_t)b->settings->width, (uint32_t)b->settings->height, err);
    free(rgb8);
    return status;
}

/* One path a pixel, and what it teaches. */
static void pass(const struct bench *b, const struct lw_path_view *view, struct lw_path_film *film,
                 struct lw_path_count *count, uint64_t *learn_ns) {
    lw_path_trace_render(b->tracer, view, 1, film, count);
    if (!view->guide) return;
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    lw_guide_learn(view->guide, (unsigned)b->settings->open.threads);
    *learn_ns += lw_clock_process_cpu_ns() - began_ns;
}

static enum lw_status read_reference(struct bench *b, struct lw_error *err) {
    float *rgb = NULL;
    uint32_t width = 0, height = 0;
    enum lw_status status = lw_image_read_exr(b->settings->truth, &rgb, &width, &height, err);
    if (status != LW_OK) return status;
    if (width == b->settings->width && height == b->settings->height)
        memcpy(b->reference, rgb, value_count(b) * sizeof *rgb);
    else
        status = lw_status_fail(err, LW_USAGE, "%s is of %ux%u pixels", b->settings->truth, width, height);
    free(rgb);
    return status;
}

/* The reference is guided: that is unbiased, and its noise lower where it matters. */
static enum lw_status trace_reference(struct bench *b, struct lw_error *err) {
    struct lw_path_film film;
    struct lw_path_view view = b->view;
    uint64_t learn_ns = 0;
    enum lw_status status = create_guide(b, &view.guide, err);
    if (status != LW_OK) return status;
    status = lw_path_film_init(&film, (uint32_t)b->settings->width, (uint32_t)b->settings->height, err);
    if (status == LW_OK) {
        view.seed = 77777;
        for (int64_t s = 0; s < b->settings->reference; s++) pass(b, &view, &film, NULL, &learn_ns);
        lw_path_film_resolve(&film, b->reference);
        b->reference_error = lw_path_film_error(&film) * lw_path_film_error(&film);
        lw_path_film_finish(&film);
    }
    lw_guide_destroy(view.guide);
    return status;
}

/* Adds one picture to the rows of a guide. */
static enum lw_status measure(struct bench *b, enum guide guide, uint32_t seed, struct lw_error *err) {
    const struct settings *o = b->settings;
    struct lw_path_film film;
    struct lw_path_count count = {0};
    struct lw_path_view view = b->view;
    uint64_t spent_ns = 0, learn_ns = 0;
    uint32_t row = 0;
    view.seed = seed;
    enum lw_status status = lw_path_film_init(&film, (uint32_t)o->width, (uint32_t)o->height, err);
    if (status == LW_OK && guide == LEARNED) status = create_guide(b, &view.guide, err);
    for (int64_t spp = o->spp_min; status == LW_OK && spp <= o->spp_max; spp *= 2, row++) {
        const uint64_t began_ns = lw_clock_process_cpu_ns();
        while (film.samples < spp) pass(b, &view, &film, &count, &learn_ns);
        spent_ns += lw_clock_process_cpu_ns() - began_ns;
        lw_path_film_resolve(&film, b->picture);
        struct row *r = &b->row[guide][row];
        r->error += (lw_support_relmse(b->picture, b->reference, value_count(b)) - b->reference_error) /
                    (double)o->seeds;
        r->cpu_s += 1e-9 * (double)spent_ns / (double)o->seeds;
        r->learn_s += 1e-9 * (double)learn_ns / (double)o->seeds;
        r->rays += (double)(count.rays_primary + count.rays_shadow + count.rays_bounce) / (double)o->seeds;
        if (seed == 1 && spp == o->picture)
            status = write_picture(b, guide_name[guide], spp, b->picture, err);
    }
    lw_guide_destroy(view.guide);
    lw_path_film_finish(&film);
    return status;
}

static uint32_t row_count(const struct settings *o) {
    uint32_t rows = 0;
    for (int64_t spp = o->spp_min; spp <= o->spp_max; spp *= 2) rows++;
    return rows;
}

/* CPU seconds to a relMSE; NAN where no two rows have it between them. */
static double seconds_to(const struct row *row, uint32_t rows, double error) {
    for (uint32_t i = 1; i < rows; i++) {
        if (!(row[i - 1].error >= error && row[i].error <= error && row[i].error > 0)) continue;
        const double span = log(row[i - 1].error / row[i].error);
        const double at = span > 0 ? log(row[i - 1].error / error) / span : 0;
        return row[i - 1].cpu_s * pow(row[i].cpu_s / row[i - 1].cpu_s, at);
    }
    return (double)NAN;
}

static void report(const struct bench *b) {
    const uint32_t rows = row_count(b->settings);
    const struct row *off = b->row[OFF], *on = b->row[LEARNED];
    printf(
        "| paths | relMSE off | relMSE learned | learned / off | CPU s off | CPU s learned | a path's cost "
        "| learning | off / learned, CPU s to the relMSE of learned |\n");
    printf("|---|---|---|---|---|---|---|---|---|\n");
    for (uint32_t i = 0; i < rows; i++)
        printf("| %d | %.4g | %.4g | %.3f | %.3f | %.3f | %.2f | %.1f %% | %.2f |\n",
               (int)(b->settings->spp_min << i), off[i].error, on[i].error, on[i].error / off[i].error,
               off[i].cpu_s, on[i].cpu_s, on[i].cpu_s / off[i].cpu_s, 100 * on[i].learn_s / on[i].cpu_s,
               seconds_to(off, rows, on[i].error) / on[i].cpu_s);
    fflush(stdout);
}

static enum lw_status set_up(struct bench *b, struct lw_error *err) {
    const struct settings *o = b->settings;
    enum lw_status status =
        bench_open(&o->open, b->name, BENCH_MOTION_OWN, 0, &b->scene, &b->pose, NULL, err);
    if (status != LW_OK) return status;
    /* One moment: coherent packets are safe then (path_command.c). */
    memset(b->pose.node_moves, 0, b->scene->node_count * sizeof *b->pose.node_moves);
    status = lw_trace_create(b->scene, &b->pose, &b->trace, err);
    if (status != LW_OK) return status;
    status = lw_lights_init(&b->lights, b->scene, &b->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "no memory for the lights");
    status = lw_path_trace_create(&(struct lw_path_trace_desc){.scene = b->scene,
                                                               .trace = b->trace,
                                                               .lights = &b->lights,
                                                               .pose = &b->pose,
                                                               .threads = (unsigned)o->open.threads},
                                  &b->tracer, err);
    if (status != LW_OK) return status;
    b->view.bounces = (uint32_t)o->bounces;
    b->view.part = (enum lw_path_part)o->show;
    status = bench_view_camera(b->name, b->scene, &b->pose, b->trace, (float)o->width / (float)o->height,
                               &b->view.camera, err);
    if (status != LW_OK) return status;
    b->reference = malloc(value_count(b) * sizeof *b->reference);
    b->picture = malloc(value_count(b) * sizeof *b->picture);
    if (!b->reference || !b->picture) return lw_status_fail(err, LW_NO_MEMORY, "no memory for pictures");
    return LW_OK;
}

static void tear_down(struct bench *b) {
    free(b->reference);
    free(b->picture);
    lw_path_trace_destroy(b->tracer);
    lw_lights_finish(&b->lights);
    lw_trace_destroy(b->trace);
    bench_close(b->scene, &b->pose, NULL);
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *o = context;
    struct bench b = {.settings = o, .name = name};
    enum lw_status status = set_up(&b, err);
    if (status == LW_OK) status = o->truth ? read_reference(&b, err) : trace_reference(&b, err);
    if (status == LW_OK) status = write_picture(&b, "reference", o->reference, b.reference, err);
    for (int64_t seed = 1; status == LW_OK && seed <= o->seeds; seed++)
        for (int guide = 0; status == LW_OK && guide < GUIDES; guide++)
            status = measure(&b, (enum guide)guide, (uint32_t)seed, err);
    if (status == LW_OK) {
        printf("\n%s, %dx%d, %d bounces, alpha %g, beta %g, trust %g; relMSE of the reference "
               "%.2g\n\n",
               name, (int)o->width, (int)o->height, (int)o->bounces, o->alpha, o->beta, o->trust,
               b.reference_error);
        report(&b);
    }
    tear_down(&b);
    return status;
}

static enum lw_status begin(void *context, struct lw_error *err) {
    const struct settings *o = context;
    if (o->spp_max < o->spp_min)
        return lw_status_fail(err, LW_USAGE, "--spp-max %d is below --spp-min %d", (int)o->spp_max,
                              (int)o->spp_min);
    return LW_OK;
}

int main(int argc, char **argv) {
    struct settings s = {.bounces = 8,
                         .reference = 4096,
                         .width = 160,
                         .height = 90,
                         .spp_min = 4,
                         .spp_max = 1024,
                         .seeds = 4,
                         .picture = 64,
                         .alpha = (double)LW_GUIDE_ALPHA,
                         .beta = (double)LW_GUIDE_BETA,
                         .trust = (double)LW_GUIDE_TRUST};
    const struct lw_option table[] = {
        {"bounces", "N", "indirect bounces (default 8)", LW_OPTION_INT, &s.bounces, 0,
         LW_PATH_TRACE_BOUNCES_MAX, NULL},
        {"reference", "N", "paths a pixel of the reference (default 4096)", LW_OPTION_INT, &s.reference, 2,
         1 << 20, NULL},
        {"width", "N", "pixels (default 160)", LW_OPTION_INT, &s.width, 1, 16384, NULL},
        {"height", "N", "pixels (default 90)", LW_OPTION_INT, &s.height, 1, 16384, NULL},
        {"spp-min", "N", "fewest paths a pixel (default 4)", LW_OPTION_INT, &s.spp_min, 1, 1 << 19, NULL},
        {"spp-max", "N", "most of them (default 1024)", LW_OPTION_INT, &s.spp_max, 1, 1 << 20, NULL},
        {"seeds", "N", "pictures that the figures are means of (default 4)", LW_OPTION_INT, &s.seeds, 1, 256,
         NULL},
        {"picture", "N", "paths of the pictures that -o writes (default 64)", LW_OPTION_INT, &s.picture, 1,
         1 << 20, NULL},
        {"alpha", "A", "weight of a note (default 0.05)", LW_OPTION_REAL, &s.alpha, 1e-6, 1, NULL},
        {"beta", "B", "share of guided directions (default 0.5)", LW_OPTION_REAL, &s.beta, 1e-3, 0.999, NULL},
        {"trust", "N", "notes after which a cell has half of beta (default 1024)", LW_OPTION_REAL, &s.trust,
         1e-3, 1e9, NULL},
        {"show", "all|direct|indirect", "which light counts (default all)", LW_OPTION_CHOICE, &s.show, 0, 0,
         NULL},
        {"truth", "FILE", "an EXR as the reference, its noise unknown (default: traced)", LW_OPTION_STRING,
         &s.truth, 0, 0, NULL},
        {"o", "DIR", "write pictures there", LW_OPTION_STRING, &s.folder, 0, 0, NULL}};
    return bench_main(&(struct bench_program){.name = "bench_paths",
                                              .about = "Error of paths with and without a guide.",
                                              .operand = "SCENE[@CAMERA]",
                                              .table = table,
                                              .count = sizeof table / sizeof table[0],
                                              .open = &s.open,
                                              .context = &s,
                                              .folder = &s.folder,
                                              .begin = begin,
                                              .run = run},
                      argc, argv);
}
