#include "client/measure/crossover_plan.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Samples per texel and frame, and the error at which blocks converge. */
static const struct {
    uint32_t direct, indirect;
    double target_error;
} rungs[] = {{1, 1, 0.2}, {1, 2, 0.02}};
#define RUNGS (sizeof rungs / sizeof *rungs)

static void plan_paths(const struct lw_crossover_options *o, struct lw_crossover_plan *plan,
                       uint32_t *count) {
    for (uint32_t i = 0; i < o->opponent_count; i++) {
        const bool filters = o->opponent[i] >= LW_PATH_RENDERER_SVGF;
        for (uint32_t p = 0; p < (filters ? 1 : o->paths_count) && *count < LW_CROSSOVER_PLANS_MAX; p++) {
            struct lw_crossover_plan *next = &plan[(*count)++];
            const uint32_t paths = filters ? 1 : o->paths[p];
            *next = (struct lw_crossover_plan){.kind = o->opponent[i], .setting = {.samples = paths}};
            snprintf(next->unit.renderer, sizeof next->unit.renderer, "%s",
                     lw_path_renderer_name(o->opponent[i]));
            lw_measure_store_setting(&next->setting, false, next->unit.setting);
        }
    }
}

/* The samples that are tried at a density. form: what else the cache is measured with. */
static void plan_rungs(struct lw_crossover_plan *plan, uint32_t *count, uint32_t d,
                       const struct lw_setting *form) {
    for (size_t r = 0; r < RUNGS && *count < LW_CROSSOVER_PLANS_MAX; r++) {
        struct lw_crossover_plan *next = &plan[(*count)++];
        *next = (struct lw_crossover_plan){.is_cache = true,
                                           .unit = {.renderer = LW_MEASURE_CACHE},
                                           .density = d,
                                           .rung = (uint32_t)r,
                                           .setting = *form};
        next->setting.direct_samples = rungs[r].direct;
        next->setting.indirect_samples = rungs[r].indirect;
        next->setting.target_error = rungs[r].target_error;
        lw_measure_store_setting(&next->setting, true, next->unit.setting);
    }
}

static void plan_forms(const struct lw_crossover_options *o, struct lw_crossover_plan *plan, uint32_t *count,
                       uint32_t d) {
    for (int by_gl = 0; by_gl < 2; by_gl++)
        for (int tiles = 0; tiles < 2; tiles++)
            if ((by_gl ? o->by_gl : o->by_rays) && (tiles ? o->tiles : o->pixels))
                plan_rungs(plan, count, d,
                           &(struct lw_setting){.density = o->density[d], .draws = !tiles, .by_gl = by_gl});
}

static enum lw_status plan_cache(struct lw_crossover_row *row, struct lw_crossover_plan *plan,
                                 uint32_t *count, struct lw_error *err) {
    const struct lw_crossover_options *o = row->options;
    char left_out[200] = "";
    size_t at = 0;
    for (uint32_t d = 0; d < o->density_count; d++) {
        const double density = o->density[d], texels = row->base.densities.texels * density * density;
        if (lw_scene_densities_fits(&row->base.densities, density))
            plan_forms(o, plan, count, d);
        else
            at += (size_t)snprintf(left_out + at, sizeof left_out - at, "%sx%g (%.3g million texels)",
                                   at ? "; " : "", density, 1e-6 * texels);
    }
    return lw_measure_row_note(&row->base, err, "densities left out", "%s", left_out);
}

/* Whether more samples bring the error in a measure down, or may: one is not measured. */
static bool gains(const struct lw_measure_store *s, const struct lw_crossover_plan *few,
                  const struct lw_crossover_plan *more, enum lw_measure_coin coin) {
    return !(lw_measure_store_mean(s, &more->unit, LW_MEASURE_ALL, LW_MEASURE_ALL, coin) >
             LW_CROSSOVER_GAIN_MIN *
                 lw_measure_store_mean(s, &few->unit, LW_MEASURE_ALL, LW_MEASURE_ALL, coin));
}

bool lw_crossover_plan_is_idle(const struct lw_crossover_row *row, const struct lw_crossover_plan *plan,
                               uint32_t count, const struct lw_crossover_plan *next) {
    for (uint32_t i = 0; next->is_cache && i + next->rung < count && next->rung; i++) {
        const struct lw_crossover_plan *few = &plan[i], *more = &plan[i + next->rung];
        if (!few->is_cache || few->density >= next->density || few->rung || more->rung != next->rung ||
            few->setting.draws != next->setting.draws || few->setting.by_gl != next->setting.by_gl)
            continue;
        if (!gains(&row->base.store, few, more, LW_MEASURE_COIN_RELMSE) &&
            !gains(&row->base.store, few, more, LW_MEASURE_COIN_FLIP))
            return true;
    }
    return false;
}

enum lw_status lw_crossover_plan_all(struct lw_crossover_row *row,
                                     struct lw_crossover_plan out_plan[LW_CROSSOVER_PLANS_MAX],
                                     uint32_t *out_count, struct lw_error *err) {
    *out_count = 0;
    plan_paths(row->options, out_plan, out_count);
    return plan_cache(row, out_plan, out_count, err);
}
