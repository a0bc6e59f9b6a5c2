#include "client/measure/crossover_unit.h"

#include "client/measure/figures/reference.h"
#include "client/measure/sides/cache_renderer.h"
#include "client/measure/sides/per_user_renderer.h"
#include "client/measure/sides/views.h"
#include "common/base/atomic_file.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/progress.h"
#include "common/image/apng.h"

#include <malloc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SETTLE_FRAMES 6u /* after one user has been left alone, or looks elsewhere; three until he says so */
#define ALONE_FRAMES  6u /* measured after that */
#define ALONE_STRIDE  5u /* views are sorted by brightness: those of a repeat are spread over all */
#define CLIP_VIEW     7u /* drifts, neither dark nor the brightest */
#define CLIP_FRAMES   12u
#define CLIP_HALVED   2u /* clips have half the width and height of pictures */

struct lw_crossover_job {
    struct lw_crossover_row *row;
    const struct lw_crossover_plan *plan;
    struct lw_renderer *renderer;
    float *rgb;                     /* a whole picture */
    float *crops[LW_MEASURE_VIEWS]; /* the last judged frame's */
    float *first;                   /* of all views in the first judged frame; repeat 0 alone */
    uint8_t *clip[CLIP_FRAMES];
    uint32_t clip_count;
    struct lw_measure_sample *sample;
    uint32_t sample_count;
    struct lw_measure_expense expense[2 * LW_MEASURE_VIEWS + 1];
    uint32_t expense_count;
    struct lw_view_error_sum lag;
    double memory_bytes; /* ours, before it began */
};

static const struct lw_crossover_options *options_of(const struct lw_crossover_job *j) {
    return j->row->options;
}

static bool keeps_pictures(const struct lw_crossover_job *j) { return j->plan->unit.repeat == 0; }

static uint32_t last_frame(const struct lw_crossover_job *j) {
    return j->row->judged[j->row->judged_count - 1];
}

/* Index of the judged frame; -1: it is none. */
static int judged_index(const struct lw_crossover_job *j, uint32_t frame) {
    for (uint32_t i = 0; i < j->row->judged_count; i++)
        if (j->row->judged[i] == frame) return (int)i;
    return -1;
}

static size_t crop_values(const struct lw_crossover_references *t) {
    return 3 * (size_t)LW_CROSSOVER_CROPS * t->side * t->side;
}

/* Bytes that are ours now, of programs and files as well. */
static double resident_bytes(void) {
    unsigned long long all, resident = 0;
    FILE *f = fopen("/proc/self/statm", "re");
    if (f && fscanf(f, "%llu %llu", &all, &resident) != 2) resident = 0;
    if (f) fclose(f);
    return (double)resident * (double)sysconf(_SC_PAGESIZE);
}

/* ---- errors ---- */

static struct lw_view_error_desc error_desc(const struct lw_crossover_references *t) {
    return (struct lw_view_error_desc){.epsilon = LW_REFERENCE_FLOOR_SHARE * t->mean_square,
                                       .curve = LW_TONEMAP_ACES,
                                       .stops = t->stops,
                                       .moment_distance_s = (double)LW_CROSSOVER_LATE_FRAMES / LW_VIEWS_HZ};
}

static void add_lag(struct lw_crossover_job *j, uint32_t view) {
    const struct lw_crossover_references *t = &j->row->references;
    struct lw_view_error_reference moment[LW_CROSSOVER_LATES + 1];
    for (uint32_t c = 0; c < LW_CROSSOVER_CROPS; c++) {
        for (uint32_t l = 0; l < LW_CROSSOVER_LATES; l++)
            moment[l] = lw_crossover_references_of(t, &t->late[l][view], c);
        moment[LW_CROSSOVER_LATES] = lw_crossover_references_of(t, &t->now[0][view], c);
        lw_view_error_add_lag(&j->lag, moment, LW_CROSSOVER_LATES + 1,
                              j->crops[view] + c * crop_values(t) / LW_CROSSOVER_CROPS);
    }
}

/* Compares a whole picture with its reference. */
static enum lw_status compare_picture(struct lw_crossover_job *j, uint32_t index, uint32_t view,
                                      struct lw_error *err) {
    const struct lw_crossover_references *t = &j->row->references;
    const struct lw_view_error_desc desc = error_desc(t);
    struct lw_view_error_sum sum;
    if (t->dark[view]) return LW_OK;
    const size_t values = crop_values(t), one = values / LW_CROSSOVER_CROPS;
    float *crops = malloc(values * sizeof *crops);
    if (!crops) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    lw_crossover_references_cut(t, view, j->rgb, options_of(j)->base.width, crops);
    lw_view_error_init(&sum, &desc);
    enum lw_status status = LW_OK;
    for (uint32_t c = 0; status == LW_OK && c < LW_CROSSOVER_CROPS; c++) {
        const struct lw_view_error_reference reference =
            lw_crossover_references_of(t, &t->now[index][view], c);
        status = lw_view_error_add(&sum, &reference, crops + c * one, err);
        if (status != LW_OK || !index || t->judged[index - 1] + 1 != t->judged[index]) continue;
        const struct lw_view_error_reference before =
            lw_crossover_references_of(t, &t->now[index - 1][view], c);
        lw_view_error_add_step(&sum, &before, j->crops[view] + c * one, &reference, crops + c * one);
    }
    const struct lw_view_error error = lw_view_error_of(&sum);
    lw_view_error_finish(&sum);
    free(j->crops[view]);
    j->crops[view] = crops;
    if (status != LW_OK) return status;
    if (index == 0 && options_of(j)->base.motion != LW_SCENE_MOTION_STATIC) add_lag(j, view);
    if (index == 0 && j->first) memcpy(j->first + values * view, crops, values * sizeof *crops);
    j->sample[j->sample_count++] =
        (struct lw_measure_sample){.unit = j->plan->unit,
                                   .view = view,
                                   .frame = t->judged[index],
                                   .coin = {[LW_MEASURE_COIN_RELMSE] = error.relmse,
                                            [LW_MEASURE_COIN_RELMSE_SMALL] = error.relmse_fixed,
                                            [LW_MEASURE_COIN_RELMSE_TRIMMED] = error.relmse_trimmed,
                                            [LW_MEASURE_COIN_FLIP] = error.flip,
                                            [LW_MEASURE_COIN_FLICKER] = error.flicker}};
    return LW_OK;
}

/* ---- pictures ---- */

/* Keeps the picture for the clip, smaller. */
static enum lw_status add_to_clip(struct lw_crossover_job *j, struct lw_error *err) {
    const uint32_t width = options_of(j)->base.width / CLIP_HALVED,
                   height = options_of(j)->base.height / CLIP_HALVED;
    const size_t pixels = (size_t)width * height;
    struct lw_tonemap tonemap;
    float *small = malloc(3 * pixels * sizeof *small);
    uint8_t *shown = malloc(3 * pixels);
    if (!small || !shown) {
        free(small);
        free(shown);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for a clip");
    }
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            for (uint32_t c = 0; c < 3; c++) {
                const float *from =
                    j->rgb +
                    3 * ((size_t)CLIP_HALVED * y * options_of(j)->base.width + (size_t)CLIP_HALVED * x) + c;
                const size_t below = 3 * (size_t)options_of(j)->base.width;
                small[3 * ((size_t)y * width + x) + c] =
                    0.25f * (from[0] + from[3] + from[below] + from[below + 3]);
            }
    lw_tonemap_init(&tonemap, LW_TONEMAP_ACES, j->row->references.stops);
    lw_tonemap_encode(&tonemap, small, pixels, 3, shown);
    free(small);
    j->clip[j->clip_count++] = shown;
    return LW_OK;
}

static enum lw_status save_pictures(struct lw_crossover_job *j, struct lw_error *err) {
    char path[4096];
    const struct lw_crossover_row *row = j->row;
    const size_t size = crop_values(&row->references) * LW_MEASURE_VIEWS * sizeof(float);
    if (!keeps_pictures(j)) return LW_OK;
    lw_measure_store_picture_path(row->base.store.folder, "crops", &j->plan->unit, "raw", path, sizeof path);
    enum lw_status status = lw_atomic_file_save(path, j->first, size, err);
    if (status != LW_OK || !j->clip_count) return status;
    lw_measure_store_picture_path(row->base.store.folder, "clip", &j->plan->unit, "png", path, sizeof path);
    return lw_apng_write(path, (const uint8_t *const *)j->clip, j->clip_count,
                         options_of(j)->base.width / CLIP_HALVED, options_of(j)->base.height / CLIP_HALVED,
                         1000 / LW_VIEWS_HZ, err);
}

/* ---- costs ---- */

/* Sums over frames. */
struct spent {
    struct lw_cost cost;
    double wall_s;
    uint32_t frames;
};

static enum lw_status step(struct lw_crossover_job *j, uint32_t frame, const uint32_t *shown, uint32_t count,
                           struct spent *spent, struct lw_error *err) {
    enum lw_status status = lw_measure_row_check(&j->row->base, err);
    struct lw_cost cost = {0};
    const uint64_t began_ns = lw_clock_ns();
    if (status == LW_OK) status = j->renderer->ops->step(j->renderer, frame, shown, count, &cost, err);
    if (status != LW_OK || !spent) return status;
    lw_cost_add(&spent->cost, &cost, 1);
    spent->wall_s += 1e-9 * (double)(lw_clock_ns() - began_ns);
    spent->frames++;
    return LW_OK;
}

static struct lw_measure_expense *enter(struct lw_crossover_job *j, const struct spent *spent, uint32_t users,
                                        uint32_t view, bool counts_rays) {
    struct lw_measure_expense *e = &j->expense[j->expense_count++];
    const double per_frame = spent->frames ? 1.0 / spent->frames : 0;
    *e = lw_measure_store_expense(&j->plan->unit, users, view);
    e->frames = spent->frames;
    for (int s = 0; s < LW_STAGE_COUNT; s++) e->cpu_s[s] = spent->cost.cpu_s[s] * per_frame;
    e->extra[LW_MEASURE_EXTRA_WALL] = spent->wall_s * per_frame;
    if (counts_rays) {
        e->extra[LW_MEASURE_EXTRA_RAYS] = spent->cost.rays * per_frame;
        e->extra[LW_MEASURE_EXTRA_BYTES] = spent->cost.bytes * per_frame;
    }
    return e;
}

/* Further fields of the line that ends a unit. */
static void conclude(struct lw_crossover_job *j, struct lw_measure_expense *all) {
    all->samples = j->sample_count;
    const struct lw_view_error lag = lw_view_error_of(&j->lag);
    all->extra[LW_MEASURE_EXTRA_LAG] = lag.lag_s;
    all->extra[LW_MEASURE_EXTRA_LAG_RELMSE] = lag.lag_relmse;
    all->extra[LW_MEASURE_EXTRA_LAG_RELMSE_NOW] = lag.lag_relmse_now;
}

/* ---- a path renderer ---- */

/* All frames of one user. */
static enum lw_status follow_view(struct lw_crossover_job *j, uint32_t view, struct spent *sum,
                                  struct lw_progress *progress, struct lw_error *err) {
    const uint32_t judged = j->row->judged[0], history = j->renderer->history;
    const uint32_t first = history < judged ? judged - history : 1, last = last_frame(j);
    const bool clips = keeps_pictures(j) && view == CLIP_VIEW;
    const struct lw_renderer_ops *ops = j->renderer->ops;
    struct spent spent = {0};
    enum lw_status status = ops->start(j->renderer, &j->plan->setting, false,
                                       options_of(j)->base.seed + 1 + j->plan->unit.repeat, err);
    if (status == LW_OK) status = ops->set_users(j->renderer, 1, err);
    for (uint32_t frame = first; status == LW_OK && frame <= last + (clips ? CLIP_FRAMES : 0); frame++) {
        const int index = judged_index(j, frame);
        const bool counts = frame >= j->row->window && frame <= last;
        status = step(j, frame, &view, 1, counts ? &spent : NULL, err);
        lw_progress_step(progress, 1);
        if (status == LW_OK && (index >= 0 || frame > last)) ops->picture(j->renderer, 0, j->rgb);
        if (status == LW_OK && index >= 0) status = compare_picture(j, (uint32_t)index, view, err);
        if (status == LW_OK && frame > last) status = add_to_clip(j, err);
    }
    if (status != LW_OK) return status;
    struct lw_measure_expense *e = enter(j, &spent, 1, view, false);
    e->extra[LW_MEASURE_EXTRA_USER_MEMORY] = resident_bytes() - j->memory_bytes;
    ops->stop(j->renderer);
    lw_cost_add(&sum->cost, &spent.cost, 1);
    sum->wall_s += spent.wall_s;
    sum->frames += spent.frames;
    return LW_OK;
}

static enum lw_status follow_all(struct lw_crossover_job *j, struct spent *sum, struct lw_error *err) {
    struct lw_progress progress;
    const uint32_t history =
        j->renderer->history < j->row->judged[0] ? j->renderer->history : j->row->judged[0];
    lw_progress_init(&progress, j->plan->unit.renderer,
                     (uint64_t)LW_MEASURE_VIEWS * (last_frame(j) - j->row->judged[0] + 1 + history));
    enum lw_status status = LW_OK;
    for (uint32_t v = 0; status == LW_OK && v < LW_MEASURE_VIEWS; v++)
        if (!j->row->references.dark[v]) status = follow_view(j, v, sum, &progress, err);
    lw_progress_end(&progress, status == LW_OK);
    return status;
}

static enum lw_status measure_paths(struct lw_crossover_job *j, struct lw_error *err) {
    const struct lw_renderer_desc side = lw_crossover_row_side(j->row);
    struct spent sum = {0};
    const uint64_t cpu_ns = lw_clock_process_cpu_ns(), wall_ns = lw_clock_ns();
    enum lw_status status = lw_per_user_renderer_create(&side, j->plan->kind, &j->renderer, err);
    if (status != LW_OK) return status;
    const double start_cpu_s = 1e-9 * (double)(lw_clock_process_cpu_ns() - cpu_ns),
                 start_wall_s = 1e-9 * (double)(lw_clock_ns() - wall_ns);
    status = follow_all(j, &sum, err);
    if (status != LW_OK) return status;
    const double memory_bytes = j->expense[0].extra[LW_MEASURE_EXTRA_USER_MEMORY];
    struct lw_measure_expense *all = enter(j, &sum, 1, LW_MEASURE_ALL, false);
    all->extra[LW_MEASURE_EXTRA_USER_MEMORY] = memory_bytes;
    all->extra[LW_MEASURE_EXTRA_START_CPU] = start_cpu_s;
    all->extra[LW_MEASURE_EXTRA_START_WALL] = start_wall_s;
    conclude(j, all);
    return LW_OK;
}

/* ---- the cache ---- */

static double server_cpu_s(const struct lw_crossover_job *j) {
    double cpu_s, bytes;
    j->renderer->ops->elsewhere(j->renderer, &cpu_s, &bytes);
    return cpu_s;
}

/* Frames with all users, up to the last judged one. */
static enum lw_status serve_all(struct lw_crossover_job *j, struct spent *spent, double *out_warm_cpu_s,
                                struct lw_error *err) {
    struct lw_progress progress;
    enum lw_status status = LW_OK;
    const uint32_t last = last_frame(j);
    const double began_cpu_s = server_cpu_s(j);
    lw_progress_init(&progress, "shared cache", last);
    for (uint32_t frame = 1; status == LW_OK && frame <= last; frame++) {
        uint32_t shown[LW_MEASURE_VIEWS], count = 1;
        const int index = judged_index(j, frame);
        if (frame == j->row->window) *out_warm_cpu_s = server_cpu_s(j) - began_cpu_s;
        /* also where no picture is judged: the shown user sends an interest set */
        shown[0] = frame % LW_MEASURE_VIEWS;
        for (uint32_t v = 0; index >= 0 && v < LW_MEASURE_VIEWS; v++) shown[v] = v, count = LW_MEASURE_VIEWS;
        status = step(j, frame, shown, count, frame >= j->row->window ? spent : NULL, err);
        for (uint32_t v = 0; status == LW_OK && index >= 0 && v < LW_MEASURE_VIEWS; v++) {
            j->renderer->ops->picture(j->renderer, v, j->rgb);
            status = compare_picture(j, (uint32_t)index, v, err);
        }
        lw_progress_step(&progress, 1);
    }
    lw_progress_end(&progress, status == LW_OK);
    return status;
}

static enum lw_status film_clip(struct lw_crossover_job *j, uint32_t *frame, struct lw_error *err) {
    enum lw_status status = LW_OK;
    const uint32_t view = CLIP_VIEW;
    for (uint32_t i = 0; status == LW_OK && i < CLIP_FRAMES; i++) {
        status = step(j, ++*frame, &view, 1, NULL, err);
        if (status != LW_OK) break;
        j->renderer->ops->picture(j->renderer, 0, j->rgb);
        status = add_to_clip(j, err);
    }
    return status;
}

/* One user sees some views of this repeat alone, one after another. */
static enum lw_status serve_alone(struct lw_crossover_job *j, uint32_t *frame, struct lw_error *err) {
    const uint32_t alone = options_of(j)->alone, turn = j->plan->unit.repeat * alone;
    enum lw_status status = LW_OK;
    for (uint32_t k = 0; status == LW_OK && k < alone; k++) {
        const uint32_t view = (turn + k) * ALONE_STRIDE % LW_MEASURE_VIEWS;
        struct spent spent = {0};
        if (j->row->references.dark[view]) continue;
        status = j->renderer->ops->set_users(j->renderer, 1, err);
        for (uint32_t i = 0; status == LW_OK && i < SETTLE_FRAMES + ALONE_FRAMES; i++)
            status = step(j, ++*frame, &view, 1, i < SETTLE_FRAMES ? NULL : &spent, err);
        if (status == LW_OK) enter(j, &spent, 1, view, true);
    }
    return status;
}

static enum lw_status run_renderer(struct lw_crossover_job *j, struct lw_error *err) {
    const struct lw_renderer_ops *ops = j->renderer->ops;
    const uint64_t began_ns = lw_clock_ns();
    struct spent spent = {0};
    double warm_cpu_s = 0, bytes;
    enum lw_status status = ops->start(j->renderer, &j->plan->setting, false,
                                       options_of(j)->base.seed + 1 + j->plan->unit.repeat, err);
    if (status != LW_OK) return status;
    const uint64_t cpu_ns = lw_clock_process_cpu_ns();
    status = ops->set_users(j->renderer, 1, err);
    const double join_cpu_s = 1e-9 * (double)(lw_clock_process_cpu_ns() - cpu_ns);
    if (status == LW_OK) status = ops->set_users(j->renderer, LW_MEASURE_VIEWS, err);
    if (status != LW_OK) return status;
    const double start_cpu_s = server_cpu_s(j), start_wall_s = 1e-9 * (double)(lw_clock_ns() - began_ns);
    status = serve_all(j, &spent, &warm_cpu_s, err);
    if (status != LW_OK) return status;
    struct lw_measure_expense all = *enter(j, &spent, LW_MEASURE_VIEWS, LW_MEASURE_ALL, true);
    j->expense_count--; /* comes last */
    all.extra[LW_MEASURE_EXTRA_USER_MEMORY] = resident_bytes() - j->memory_bytes;
    all.extra[LW_MEASURE_EXTRA_BUILD_CPU] =
        lw_scene_densities_build_cpu_s(&j->row->base.densities, j->plan->setting.density);
    all.extra[LW_MEASURE_EXTRA_START_CPU] = start_cpu_s;
    all.extra[LW_MEASURE_EXTRA_JOIN_CPU] = join_cpu_s;
    all.extra[LW_MEASURE_EXTRA_START_WALL] = start_wall_s;
    all.extra[LW_MEASURE_EXTRA_WARM_CPU] = warm_cpu_s;
    all.extra[LW_MEASURE_EXTRA_WARM_FRAMES] = j->row->window - 1;
    uint32_t frame = last_frame(j);
    if (keeps_pictures(j) && !j->row->references.dark[CLIP_VIEW]) status = film_clip(j, &frame, err);
    if (status == LW_OK) status = serve_alone(j, &frame, err);
    if (status != LW_OK) return status;
    ops->elsewhere(j->renderer, &(double){0}, &bytes);
    all.extra[LW_MEASURE_EXTRA_SERVER_MEMORY] = bytes;
    conclude(j, &all);
    j->expense[j->expense_count++] = all;
    return LW_OK;
}

static enum lw_status measure_cache(struct lw_crossover_job *j, struct lw_error *err) {
    const struct lw_renderer_desc side = lw_crossover_row_side(j->row);
    enum lw_status status = lw_cache_renderer_create(&side, &j->renderer, err);
    return status == LW_OK ? run_renderer(j, err) : status;
}

/* ---- the whole ---- */

static enum lw_status prepare(struct lw_crossover_job *j, struct lw_error *err) {
    const struct lw_crossover_options *o = options_of(j);
    const struct lw_view_error_desc desc = error_desc(&j->row->references);
    lw_view_error_init(&j->lag, &desc);
    j->rgb = malloc(3 * (size_t)o->base.width * o->base.height * sizeof *j->rgb);
    j->sample = calloc((size_t)j->row->judged_count * LW_MEASURE_VIEWS, sizeof *j->sample);
    if (keeps_pictures(j))
        j->first = calloc(crop_values(&j->row->references) * LW_MEASURE_VIEWS, sizeof *j->first);
    if (!j->rgb || !j->sample || (keeps_pictures(j) && !j->first))
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for pictures");
    malloc_trim(0); /* what earlier units have given back is not to serve this one unseen */
    j->memory_bytes = resident_bytes();
    return LW_OK;
}

static void free_job(struct lw_crossover_job *j) {
    if (j->renderer) j->renderer->ops->destroy(j->renderer);
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) free(j->crops[v]);
    for (uint32_t i = 0; i < j->clip_count; i++) free(j->clip[i]);
    lw_view_error_finish(&j->lag);
    free(j->first);
    free(j->sample);
    free(j->rgb);
}

enum lw_status lw_crossover_unit_measure(struct lw_crossover_row *row, const struct lw_crossover_plan *plan,
                                         struct lw_error *err) {
    struct lw_crossover_job job = {.row = row, .plan = plan};
    enum lw_status status = prepare(&job, err);
    if (status == LW_OK) status = plan->is_cache ? measure_cache(&job, err) : measure_paths(&job, err);
    if (status == LW_OK) status = save_pictures(&job, err);
    if (status == LW_OK)
        status = lw_measure_store_append(&row->base.store, job.sample, job.sample_count, job.expense,
                                         job.expense_count, err);
    if (status == LW_OK) {
        double error = 0;
        for (uint32_t i = 0; i < job.sample_count; i++)
            error += job.sample[i].coin[LW_MEASURE_COIN_RELMSE] / job.sample_count;
        const struct lw_measure_expense *all = &job.expense[job.expense_count - 1];
        lw_log(LW_LOG_INFO, "repeat %u, %s, %s: relMSE %.4g, %.4g CPU s a frame for %u user%s",
               plan->unit.repeat + 1, plan->unit.renderer, plan->unit.setting, error,
               lw_measure_store_total(all), all->users, all->users > 1 ? "s" : "");
    }
    free_job(&job);
    return status;
}
