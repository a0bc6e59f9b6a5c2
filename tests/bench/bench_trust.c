/* bench_trust: the solve against the path tracer, seen by the same camera, region by region.
 *
 *     bench_trust [OPTIONS] SCENE[@PX,PY,PZ:TX,TY,TZ:FOV | @CAMERA]...
 *
 * Solves each scene, composes the view from the lightmaps, traces the same view with paths, both through the
 * centres of the pixels, and prints a table in Markdown: ratio of the means, the worst of 8 x 6 regions with
 * its standard error, how many regions obey |ratio - 1| <= max(3 standard errors, 0.005), and relMSE =
 * mean((x - t)^2 / (t^2 + eps)), eps = 1 % of the mean of t^2; x is the mean of two seeds of the solve. View
 * error is that of one seed, as a client has it: the mean of min(1, (x - t)^2/(t^2 + eps^2)), eps = 1 % of
 * the mean of t, so that a few bright pixels do not make it up. The standard errors hold the noise of both
 * sides: batches of the path tracer, two seeds of the solve. Light is as the solver shows it, not coded.
 * --list adds every region and every object that does not obey, those first that move the picture's mean
 * most. With
 * -o DIR also the pictures: the solve on the left, the path tracer on the right. */
#include "client/paths/path_trace.h"
#include "client/view/tonemap.h"
#include "common/base/clock.h"
#include "common/image/image.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_view.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define COLUMNS 8u
#define ROWS    6u
#define REGIONS (COLUMNS * ROWS)
#define BATCHES 8u
#define SEEDS   2u
#define BOUND   0.005

struct settings {
    struct lw_scene_open open;
    int64_t bounces, spp, frames, direct_samples, indirect_samples, width, height;
    double range, time_s, noise_shown;
    const char *folder;
    bool denoise, list;
    uint32_t scenes; /* so far */
};

/* Parts of the picture, and the mean of each: the sum of its pixels over that of all. */
struct parts {
    uint32_t count;
    uint32_t *of_pixel;
    double *reference[BATCHES], *image[SEEDS];
};

struct scene {
    const struct settings *settings;
    const char *camera_text; /* for the table */
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_lights lights;
    struct lw_compose *compose;
    struct bench_view_light light;
    struct lw_compose_view view;
    float *image[SEEDS], *reference; /* width * height * 3 */
    double solve_s, trace_s, texels;
    struct parts regions, objects; /* objects: the first one seen, and one more for the sky */
};

/* ---- the solve ---- */

static enum lw_status solve(struct scene *s, uint32_t seed, float *out_rgb, struct lw_error *err) {
    const struct settings *settings = s->settings;
    struct lw_solver *solver;
    enum lw_status status =
        lw_solvers_create(NULL,
                          &(struct lw_solver_desc){.scene = s->scene,
                                                   .atlas_map = &s->map,
                                                   .bounces = (uint32_t)settings->bounces,
                                                   .tracing_range_m = (float)settings->range,
                                                   .direct_samples = (uint32_t)settings->direct_samples,
                                                   .indirect_samples = (uint32_t)settings->indirect_samples,
                                                   .target_error = 1e-9f,
                                                   .denoise = settings->denoise,
                                                   .seed = seed},
                          &s->pose, &solver, err);
    if (status != LW_OK) return status;
    const uint64_t began = lw_clock_ns();
    for (uint64_t frame = 1; status == LW_OK && frame <= (uint64_t)settings->frames; frame++) {
        struct lw_solver_stats stats;
        status = solver->ops->frame(solver, &s->pose, frame, &stats, err);
        s->texels = (double)stats.texels_solved;
    }
    s->solve_s += (double)(lw_clock_ns() - began) * 1e-9;
    if (status == LW_OK) {
        struct lw_compose_report report;
        struct lw_compose_source source =
            bench_view_light_source(&s->light, s->scene, (uint32_t)settings->bounces);
        source.target_error = 1;
        source.noise_shown = (float)settings->noise_shown;
        bench_view_light_read(&s->light, solver);
        lw_compose_render(s->compose, &source, &s->pose, &s->view, out_rgb, &report);
    }
    solver->ops->destroy(solver);
    return status;
}

/* ---- the path tracer, and regions ---- */

static bool parts_init(struct parts *parts, uint32_t count, const struct lw_compose_view *view) {
    *parts = (struct parts){.count = count};
    bool ok = (parts->of_pixel = calloc((size_t)view->width * view->height, sizeof *parts->of_pixel)) != NULL;
    for (uint32_t i = 0; i < BATCHES; i++)
        ok &= (parts->reference[i] = calloc(count, sizeof(double))) != NULL;
    for (uint32_t i = 0; i < SEEDS; i++) ok &= (parts->image[i] = calloc(count, sizeof(double))) != NULL;
    return ok;
}

static void parts_finish(struct parts *parts) {
    free(parts->of_pixel);
    for (uint32_t i = 0; i < BATCHES; i++) free(parts->reference[i]);
    for (uint32_t i = 0; i < SEEDS; i++) free(parts->image[i]);
}

static void part_by_region(struct parts *parts, const struct lw_compose_view *view) {
    for (uint32_t y = 0; y < view->height; y++)
        for (uint32_t x = 0; x < view->width; x++)
            parts->of_pixel[(size_t)y * view->width + x] =
                y * ROWS / view->height * COLUMNS + x * COLUMNS / view->width;
}

static void part_by_object(struct parts *parts, const struct scene *s) {
    const struct lw_camera_plane plane = lw_camera_plane(&s->view.camera, s->view.width, s->view.height);
    for (uint32_t i = 0; i < s->view.width * s->view.height; i++) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        const float x = (float)(i % s->view.width) + 0.5f, y = (float)(i / s->view.width) + 0.5f;
        lw_trace_set_ray(&rays, 0, s->view.camera.position, lw_camera_direction(&plane, x, y), INFINITY);
        lw_trace_closest16(s->trace, LW_TRACE_VIEW, 1, &rays, &hits);
        parts->of_pixel[i] = hits.object[0] == LW_TRACE_MISS ? s->scene->object_count : hits.object[0];
    }
}

static void sum_up(const struct parts *parts, size_t pixels, const float *rgb, double *out) {
    for (size_t i = 0; i < 3 * pixels; i++)
        out[parts->of_pixel[i / 3]] += (double)rgb[i] / (3 * (double)pixels);
}

static enum lw_status trace_paths(struct scene *s, struct lw_error *err) {
    const size_t floats = (size_t)s->view.width * s->view.height * 3;
    struct lw_path_trace *tracer;
    struct lw_path_film film;
    enum lw_status status = lw_path_trace_create(
        &(struct lw_path_trace_desc){
            .scene = s->scene, .trace = s->trace, .lights = &s->lights, .pose = &s->pose},
        &tracer, err);
    if (status != LW_OK) return status;
    status = lw_path_film_init(&film, s->view.width, s->view.height, err);
    float *batch = malloc(floats * sizeof *batch);
    if (status == LW_OK && !batch) status = lw_status_fail(err, LW_NO_MEMORY, "pictures");
    const uint64_t began = lw_clock_ns();
    for (uint32_t b = 0; status == LW_OK && b < BATCHES; b++) {
        const struct lw_path_view view = {.camera = s->view.camera,
                                          .bounces = (uint32_t)s->settings->bounces,
                                          .seed = 1000 + b,
                                          .pixel = LW_PATH_PIXEL_CENTRE};
        lw_path_film_clear(&film);
        lw_path_trace_render(tracer, &view, (uint32_t)(s->settings->spp / BATCHES), &film, NULL);
        lw_path_film_resolve(&film, batch);
        sum_up(&s->regions, floats / 3, batch, s->regions.reference[b]);
        sum_up(&s->objects, floats / 3, batch, s->objects.reference[b]);
        for (size_t i = 0; i < floats; i++) s->reference[i] += batch[i] / (float)BATCHES;
    }
    s->trace_s = (double)(lw_clock_ns() - began) * 1e-9;
    free(batch);
    lw_path_film_finish(&film);
    lw_path_trace_destroy(tracer);
    return status;
}

/* ---- report ---- */

struct verdict {
    double ratio, relative_mse, view_error, worst, worst_error;
    uint32_t worst_region, regions, within;
};

/* Error of the solve's mean of two seeds, relative, pooled over all parts. */
static double solve_variance_of(const struct parts *parts) {
    double sum = 0;
    for (uint32_t r = 0; r < parts->count; r++) {
        const double a = parts->image[0][r], b = parts->image[1][r];
        if (a + b > 0) sum += pow((a - b) / (a + b), 2) / parts->count;
    }
    return sum;
}

struct part {
    uint32_t index;
    double image, reference, ratio, error; /* means; the ratio's standard error */
    bool within;
};

/* False: there is nothing to see. */
static bool judge_part(const struct parts *parts, uint32_t index, double solve_variance, struct part *out) {
    double reference = 0, square = 0;
    for (uint32_t b = 0; b < BATCHES; b++) reference += parts->reference[b][index] / BATCHES;
    for (uint32_t b = 0; b < BATCHES; b++) square += pow(parts->reference[b][index] - reference, 2);
    if (!(reference > 0)) return false;
    const double image = (parts->image[0][index] + parts->image[1][index]) / 2;
    const double error = sqrt(square / (BATCHES - 1) / BATCHES / (reference * reference) + solve_variance);
    *out = (struct part){.index = index,
                         .image = image,
                         .reference = reference,
                         .ratio = image / reference,
                         .error = error,
                         .within = fabs(image / reference - 1) <= fmax(3 * error, BOUND)};
    return true;
}

static struct verdict judge(const struct scene *s) {
    struct verdict v = {.worst = 1};
    const double solve_variance = solve_variance_of(&s->regions);
    double image_sum = 0, reference_sum = 0;
    for (uint32_t r = 0; r < s->regions.count; r++) {
        struct part part;
        if (!judge_part(&s->regions, r, solve_variance, &part)) continue;
        image_sum += part.image;
        reference_sum += part.reference;
        v.regions++;
        v.within += part.within;
        if (fabs(part.ratio - 1) <= fabs(v.worst - 1)) continue;
        v.worst = part.ratio;
        v.worst_error = part.error;
        v.worst_region = r;
    }
    v.ratio = image_sum / reference_sum;
    const size_t floats = (size_t)s->view.width * s->view.height * 3;
    double mean = 0, mean_square = 0;
    for (size_t i = 0; i < floats; i++) {
        mean += (double)s->reference[i] / (double)floats;
        mean_square += (double)s->reference[i] * (double)s->reference[i] / (double)floats;
    }
    for (size_t i = 0; i < floats; i++) {
        const double x[SEEDS] = {(double)s->image[0][i], (double)s->image[1][i]}, t = (double)s->reference[i];
        const double both = (x[0] + x[1]) / 2;
        v.relative_mse += (both - t) * (both - t) / (t * t + 0.01 * mean_square) / (double)floats;
        for (uint32_t seed = 0; seed < SEEDS; seed++)
            v.view_error +=
                fmin(1, pow(x[seed] - t, 2) / (t * t + pow(0.01 * mean, 2))) / (double)(SEEDS * floats);
    }
    return v;
}

static int by_weight(const void *a, const void *b) {
    const struct part *x = a, *y = b;
    const double wx = fabs(x->image - x->reference), wy = fabs(y->image - y->reference);
    return wx > wy ? -1 : wx < wy;
}

/* Parts that are out of bounds, and by how much of the picture's mean. */
static void list_parts(const struct scene *s, const struct parts *parts, bool regions) {
    struct part *part = malloc((parts->count + 1u) * sizeof *part);
    const double solve_variance = solve_variance_of(parts);
    uint32_t count = 0;
    double total = 0;
    for (uint32_t i = 0; part && i < parts->count; i++) {
        struct part p;
        if (!judge_part(parts, i, solve_variance, &p)) continue;
        total += p.reference;
        if (!p.within) part[count++] = p;
    }
    if (count) qsort(part, count, sizeof *part, by_weight);
    for (uint32_t i = 0; i < count; i++) {
        const struct part *p = &part[i];
        if (regions)
            printf("    region %u,%u", p->index % COLUMNS, p->index / COLUMNS);
        else
            printf("    object %u %s", p->index,
                   p->index < s->scene->object_count ? s->scene->object[p->index].name : "(sky)");
        printf(": %.4f +- %.4f, %+.3f %% of the picture's mean, which it is %.1f %% of\n", p->ratio, p->error,
               100 * (p->image - p->reference) / total, 100 * p->reference / total);
    }
    free(part);
}

/* Both pictures with one exposure, side by side. */
static enum lw_status write_pair(const struct scene *s, const char *stem, struct lw_error *err) {
    const uint32_t w = s->view.width, h = s->view.height;
    char path[4096];
    enum lw_status status = LW_OK;
    const char *const suffix[2] = {"solve", "reference"};
    float *const half[2] = {s->image[0], s->reference};
    for (int i = 0; status == LW_OK && i < 2; i++) {
        snprintf(path, sizeof path, "%s/%s-%s.exr", s->settings->folder, stem, suffix[i]);
        status = lw_image_write_exr(path, half[i], w, h, "W/(m^2 sr)", err);
    }
    if (status != LW_OK) return status;
    struct lw_tonemap tonemap;
    uint8_t *srgb = malloc((size_t)w * h * 6);
    if (!srgb) return lw_status_fail(err, LW_NO_MEMORY, "pictures");
    lw_tonemap_init(&tonemap, LW_TONEMAP_REINHARD, lw_tonemap_auto_stops(s->reference, (size_t)w * h));
    for (uint32_t y = 0; y < h; y++)
        for (uint32_t i = 0; i < 2; i++)
            lw_tonemap_encode(&tonemap, half[i] + (size_t)y * w * 3, w, 3,
                              srgb + ((size_t)y * 2 + i) * w * 3);
    snprintf(path, sizeof path, "%s/%s.png", s->settings->folder, stem);
    status = lw_image_write_png(path, srgb, 2 * w, h, err);
    free(srgb);
    return status;
}

static void print_row(const struct scene *s, const char *name, const struct verdict *v) {
    double texels_per_metre = s->settings->open.texels_per_metre;
    char density[32] = "default";
    if (texels_per_metre > 0) snprintf(density, sizeof density, "%g", texels_per_metre);
    printf("| %s | %s | %s | %.0f | %.4f | %.4f +- %.4f at %u,%u | %u of %u | %.5f | %.4f | %.1f | %.1f |\n",
           name, s->camera_text ? s->camera_text : "default", density, s->texels, v->ratio, v->worst,
           v->worst_error, v->worst_region % COLUMNS, v->worst_region / COLUMNS, v->within, v->regions,
           v->relative_mse, v->view_error, s->solve_s, s->trace_s);
    fflush(stdout);
}

/* ---- one scene ---- */

static enum lw_status prepare(struct scene *s, const char *name, struct lw_error *err) {
    enum lw_status status = bench_open(&s->settings->open, name, BENCH_MOTION_OWN, s->settings->time_s,
                                       &s->scene, &s->pose, &s->map, err);
    if (status != LW_OK) return status;
    if ((status = lw_trace_create(s->scene, &s->pose, &s->trace, err)) != LW_OK) return status;
    if ((status = lw_lights_init(&s->lights, s->scene, &s->pose)) != LW_OK) return status;
    status = lw_compose_create(
        &(struct lw_compose_desc){.scene = s->scene, .map = &s->map, .trace = s->trace}, &s->compose, err);
    const size_t floats = (size_t)s->view.width * s->view.height * 3;
    for (uint32_t i = 0; i < SEEDS; i++) s->image[i] = calloc(floats, sizeof(float));
    s->reference = calloc(floats, sizeof(float));
    if (status == LW_OK && (!s->image[0] || !s->image[1] || !s->reference))
        status = lw_status_fail(err, LW_NO_MEMORY, "pictures");
    if (status == LW_OK) status = bench_view_light_init(&s->light, &s->map, err);
    if (status == LW_OK)
        status = bench_view_camera(name, s->scene, &s->pose, s->trace,
                                   (float)s->view.width / (float)s->view.height, &s->view.camera, err);
    if (status == LW_OK && (!parts_init(&s->regions, REGIONS, &s->view) ||
                            !parts_init(&s->objects, s->scene->object_count + 1, &s->view)))
        status = lw_status_fail(err, LW_NO_MEMORY, "parts of the picture");
    if (status != LW_OK) return status;
    part_by_region(&s->regions, &s->view);
    part_by_object(&s->objects, s);
    return LW_OK;
}

static void scene_finish(struct scene *s) {
    bench_view_light_finish(&s->light);
    for (uint32_t i = 0; i < SEEDS; i++) free(s->image[i]);
    free(s->reference);
    parts_finish(&s->regions);
    parts_finish(&s->objects);
    lw_compose_destroy(s->compose);
    lw_lights_finish(&s->lights);
    lw_trace_destroy(s->trace);
    bench_close(s->scene, &s->pose, &s->map);
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    struct settings *settings = context;
    char label[64], stem[64];
    const char *at = strchr(name, '@');
    struct scene s = {.settings = settings,
                      .camera_text = at ? at + 1 : NULL,
                      .view = {.width = (uint32_t)settings->width, .height = (uint32_t)settings->height}};
    const size_t pixels = (size_t)s.view.width * s.view.height;
    enum lw_status status = prepare(&s, name, err);
    for (uint32_t i = 0; status == LW_OK && i < SEEDS; i++) {
        status = solve(&s, 1 + i, s.image[i], err);
        if (status != LW_OK) break;
        sum_up(&s.regions, pixels, s.image[i], s.regions.image[i]);
        sum_up(&s.objects, pixels, s.image[i], s.objects.image[i]);
    }
    if (status == LW_OK) status = trace_paths(&s, err);
    if (status == LW_OK) {
        const struct verdict verdict = judge(&s);
        print_row(&s, bench_label(name, label, sizeof label), &verdict);
        if (settings->list) list_parts(&s, &s.regions, true);
        if (settings->list) list_parts(&s, &s.objects, false);
        snprintf(stem, sizeof stem, "trust-%u", settings->scenes++);
        if (settings->folder) status = write_pair(&s, stem, err);
    }
    scene_finish(&s);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.bounces = 2,
                         .spp = 256,
                         .frames = 128,
                         .direct_samples = 2,
                         .indirect_samples = 4,
                         .width = 480,
                         .height = 270,
                         .range = (double)INFINITY};
    const struct lw_option table[] = {
        BENCH_BOUNCES(&s, LW_SOLVER_BOUNCES_MAX),
        BENCH_INT("spp", "paths per pixel (default 256)", &s.spp, 16, 1 << 20),
        BENCH_INT("frames", "frames of each solve (default 128)", &s.frames, 1, 1 << 20),
        BENCH_INT("direct-samples", "per texel and frame (default 2)", &s.direct_samples, 1, 1024),
        BENCH_INT("indirect-samples", "per texel and frame (default 4)", &s.indirect_samples, 1, 1024),
        BENCH_SIZE(&s, "480", "270", 8, 6),
        {"tracing-range", "METRES", "as lightwelld's (default inf)", LW_OPTION_REAL, &s.range, 1e-6,
         (double)INFINITY, NULL},
        {"time", "SECONDS", "of the scene's animation (default 0)", LW_OPTION_REAL, &s.time_s, 0, 1e9, NULL},
        {"denoise", NULL, "filter what is shown, as lightwelld does by default", LW_OPTION_FLAG, &s.denoise,
         0, 0, NULL},
        {"noise-shown", "SHARE",
         "share of tiles' errors that views see, and read coarser levels where it is much (default 0: never)",
         LW_OPTION_REAL, &s.noise_shown, 0, 1, NULL},
        {"list", NULL, "every region and object that does not obey", LW_OPTION_FLAG, &s.list, 0, 0, NULL},
        BENCH_FOLDER(&s)};
    return BENCH_MAIN(
        argc, argv, table, .name = "bench_trust",
        .about = "Compares the solve with the path tracer, region by region.", .operand = "SCENE[@CAMERA]",
        .heading = "| scene | camera | texels/m | texels | ratio of means | worst region | regions "
                   "within | relMSE | view error | solve s | paths s |\n"
                   "|---|---|---|---|---|---|---|---|---|---|---|",
        .open = &s.open, .folder = &s.folder, .context = &s);
}
