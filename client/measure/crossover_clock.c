#include "client/measure/crossover_clock.h"

#include "client/measure/crossover_analysis.h"
#include "client/measure/crossover_plan.h"
#include "client/measure/figures/reference.h"
#include "client/measure/sides/lattice.h"
#include "client/measure/sides/real_run.h"
#include "client/measure/sides/views.h"
#include "common/base/log.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define VIEW_STRIDE  5u  /* views are sorted by brightness: spread over all */
#define SAMPLES_MAX  64u /* paths per pixel of a reference */
#define CACHE_WARM_S 4.0 /* at most */
#define PATHS_WARM_S 1.0
#define SECONDS      2.0

/* One renderer in some views. */
struct clock {
    struct lw_crossover_row *row;
    const struct lw_crossover_plan *plan;
    struct lw_path_world world; /* the references' */
    struct lw_crossover_clock sum;
    uint32_t runs;
};

/* A view of the row, for either side. */
struct one_view {
    const struct lw_fixed_views *views;
    uint32_t view;
};

static struct lw_camera_view camera_of_view(const void *context, uint32_t user, uint64_t frame) {
    const struct one_view *v = context;
    (void)user;
    return lw_fixed_views_at(v->views, v->view, (double)(frame - 1) / LW_VIEWS_HZ);
}

/* Errors of the pictures of one run. */
static enum lw_status measure_errors(struct clock *c, const struct lw_renderer_desc *side,
                                     const struct lw_real_run *run, struct lw_error *err) {
    const struct lw_measure_options *o = c->row->base.options;
    const uint32_t samples = o->reference_samples < SAMPLES_MAX ? o->reference_samples : SAMPLES_MAX;
    enum lw_status status = LW_OK;
    for (uint32_t p = 0; status == LW_OK && p < run->picture_count; p++) {
        struct lw_reference reference = {0};
        status =
            lw_reference_init_real(&reference, &c->world, side, &run->picture[p], samples, ~o->seed, err);
        if (status == LW_OK) {
            reference.mean_square = c->row->references.mean_square; /* of all views */
            c->sum.relmse += lw_reference_error(&reference, run->picture[p].lattice);
            c->sum.pictures++;
        }
        lw_reference_finish(&reference);
    }
    return status;
}

/* Runs either side in a view. */
static enum lw_status run_view(const struct clock *c, const struct lw_renderer_desc *side, uint32_t view,
                               struct lw_real_run *run, struct lw_error *err) {
    struct lw_real_run_desc desc = {.side = side,
                                    .setting = c->plan->setting,
                                    .seed = c->row->base.options->seed,
                                    .seconds = SECONDS,
                                    .cancel = c->row->base.cancel};
    if (c->plan->is_cache) {
        desc.users = 1;
        desc.warm_s = CACHE_WARM_S;
        desc.warm_cpu_s = (double)INFINITY;
        return lw_real_run(&desc, run, err);
    }
    desc.kind = c->plan->kind;
    desc.user = view;
    desc.warm_s = PATHS_WARM_S;
    desc.first_s = c->row->options->warm_s - PATHS_WARM_S;
    return lw_real_run_paths(&desc, run, err);
}

static enum lw_status measure_view(struct clock *c, uint32_t view, struct lw_error *err) {
    const struct one_view one = {&c->row->views, view};
    struct lw_renderer_desc side =
        lw_measure_row_side(&c->row->base, &(struct lw_renderer_cameras){&one, camera_of_view});
    struct lw_real_run run;
    side.stride = lw_lattice_stride(side.width, side.height);
    enum lw_status status = run_view(c, &side, view, &run, err);
    if (status != LW_OK) return status;
    c->sum.views_hz += run.views_hz;
    c->sum.light_age_s += run.light_age_s;
    c->runs++;
    status = measure_errors(c, &side, &run, err);
    lw_real_run_finish(&run);
    return status;
}

static void key_of(const char *renderer, const char *setting, char out[LW_MEASURE_NAME_SIZE]) {
    snprintf(out, LW_MEASURE_NAME_SIZE, LW_CROSSOVER_CLOCK_KEY "%.20s %.30s", renderer, setting);
}

static enum lw_status measure_renderer(struct clock *c, struct lw_error *err) {
    struct lw_crossover_row *row = c->row;
    const struct lw_measure_unit *unit = &c->plan->unit;
    char key[LW_MEASURE_NAME_SIZE];
    enum lw_status status = LW_OK;
    key_of(unit->renderer, unit->setting, key);
    if (lw_measure_store_get(&row->base.store, key)) return LW_OK;
    for (uint32_t k = 0; status == LW_OK && k < row->options->alone; k++) {
        const uint32_t view = k * VIEW_STRIDE % LW_MEASURE_VIEWS;
        status = lw_measure_row_check(&row->base, err);
        if (status == LW_OK && !row->references.dark[view]) status = measure_view(c, view, err);
    }
    if (status != LW_OK || !c->runs) return status;
    const double n = c->runs;
    lw_log(LW_LOG_INFO, "by the wall clock, %s, %s: %.3g pictures a second, %.2g s old, relMSE %.4g",
           unit->renderer, unit->setting, c->sum.views_hz / n, c->sum.light_age_s / n,
           c->sum.relmse / c->sum.pictures);
    return lw_measure_row_note(&row->base, err, key, "%.6g,%.6g,%.6g,%u", c->sum.views_hz / n,
                               c->sum.light_age_s / n, c->sum.relmse / c->sum.pictures, c->sum.pictures);
}

bool lw_crossover_clock_read(const struct lw_measure_store *store, const char *renderer, const char *setting,
                             struct lw_crossover_clock *out) {
    char key[LW_MEASURE_NAME_SIZE];
    key_of(renderer, setting, key);
    const char *value = lw_measure_store_get(store, key);
    return value && sscanf(value, "%lf,%lf,%lf,%u", &out->views_hz, &out->light_age_s, &out->relmse,
                           &out->pictures) == 4;
}

/* The cache's setting that takes part; "": none is measured. */
static enum lw_status choose_cache(const struct lw_crossover_row *row, char out[LW_MEASURE_NAME_SIZE],
                                   struct lw_error *err) {
    struct lw_crossover_analysis a;
    enum lw_status status = lw_crossover_analysis_init(&a, &row->base.store, err);
    if (status != LW_OK) return status;
    const enum lw_measure_coin coin = LW_MEASURE_COIN_RELMSE;
    const struct lw_crossover_point *svgf = lw_crossover_analysis_find(&a, "svgf", NULL),
                                    *cache = svgf ? lw_crossover_analysis_cheapest(&a, coin,
                                                                                   svgf->mean[coin].value)
                                                  : NULL;
    if (!cache) cache = lw_crossover_analysis_best(&a, coin);
    snprintf(out, LW_MEASURE_NAME_SIZE, "%s", cache ? cache->setting : "");
    lw_crossover_analysis_finish(&a);
    return LW_OK;
}

enum lw_status lw_crossover_clock_measure(struct lw_crossover_row *row, struct lw_error *err) {
    const struct lw_crossover_options *o = row->options;
    struct lw_crossover_plan plan[LW_CROSSOVER_PLANS_MAX];
    char setting[LW_MEASURE_NAME_SIZE];
    uint32_t count;
    struct clock world = {.row = row}; /* shared by all */
    enum lw_status status = choose_cache(row, setting, err);
    if (status == LW_OK) status = lw_crossover_plan_all(row, plan, &count, err);
    if (status == LW_OK)
        status = lw_path_world_init(&world.world, row->base.densities.scene, o->base.bounces,
                                    (unsigned)o->base.scene.threads, err);
    for (uint32_t i = 0; status == LW_OK && i < count; i++) {
        const bool filters = !plan[i].is_cache && plan[i].kind >= LW_PATH_RENDERER_SVGF,
                   chosen = plan[i].is_cache && strcmp(plan[i].unit.setting, setting) == 0;
        if (!filters && !chosen) continue;
        struct clock c = world;
        c.plan = &plan[i];
        status = measure_renderer(&c, err);
    }
    lw_path_world_finish(&world.world);
    return status;
}
