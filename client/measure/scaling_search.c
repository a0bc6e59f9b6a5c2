#include "client/measure/scaling_search.h"

#include "common/base/log.h"

#include <math.h>

#define SAMPLES_MAX 256u /* per pixel and frame, of the path tracer; with more a picture takes minutes */
#define GAIN_MIN    0.9  /* a rung, or a density, must bring the error below this share of the one before */
#define HOPELESS    4    /* times the error: what samples alone have never made up for */
#define PROBE       4u   /* samples of the second of two points on the line of a path tracer's cost */

static const double curve[] = {0.5, 0.1, 0.02};
static const double densities[] = {0.25, 0.5, 1, 2, 4}; /* a trial costs four times the one before */
/* Sample counts. The first rung has those of the second, in lightmaps that converge at a higher error. */
static const struct {
    uint32_t direct, indirect;
    double target_error;
} rungs[] = {{1, 1, 0.2},
             {1, 1, LW_SCALING_REST},
             {1, 2, LW_SCALING_REST},
             {2, 4, LW_SCALING_REST},
             {4, 8, LW_SCALING_REST},
             {8, 16, LW_SCALING_REST},
             {16, 32, LW_SCALING_REST}};
static const double target_errors[] = {0.5, 0.25, 0.12, 0.06, 0.03, 0.015};
#define COUNT(array) (sizeof(array) / sizeof *(array))

/* Cheapest point of a side that reaches an error; -1 if none does. */
static int cheapest(const struct lw_scaling_side *side, double error) {
    int best = -1;
    for (uint32_t i = 0; i < side->point_count; i++)
        if (side->point[i].error <= error &&
            (best < 0 || lw_cost_total(&side->point[i].cost) < lw_cost_total(&side->point[best].cost)))
            best = (int)i;
    return best;
}

/* ---- points ---- */

/* CPU time of a frame at full size = fixed_s + samples * per_sample_s, the mean over the eyes. */
static enum lw_status measure_line(struct lw_scaling *x, struct lw_scaling_side *side, struct lw_error *err) {
    static const uint32_t samples[2] = {1, PROBE};
    double mean_s[2] = {0};
    for (int i = 0; i < 2; i++) {
        double per_eye_s[LW_SCALING_EYES] = {0};
        enum lw_status status =
            lw_scaling_run_trace(x, side, &(struct lw_setting){.samples = samples[i]}, 0, per_eye_s, err);
        if (status != LW_OK) return status;
        for (uint32_t eye = 0; eye < x->eyes; eye++) mean_s[i] += per_eye_s[eye] / x->eyes;
    }
    side->per_sample_s = (mean_s[1] - mean_s[0]) / (PROBE - 1);
    side->fixed_s = fmax(0, mean_s[0] - side->per_sample_s);
    return LW_OK;
}

static bool is_same(const struct lw_setting *a, const struct lw_setting *b) {
    return a->samples == b->samples && a->density == b->density && a->direct_samples == b->direct_samples &&
           a->indirect_samples == b->indirect_samples && a->target_error == b->target_error;
}

/* The point of a setting, which may exist already. *out_point: NULL if there is no room. */
static enum lw_status try_setting(struct lw_scaling *x, struct lw_scaling_side *side,
                                  const struct lw_setting *setting, struct lw_scaling_point **out_point,
                                  struct lw_error *err) {
    const bool linear = side->traces && side->renderer->history < UINT32_MAX;
    struct lw_scaling_point point = {.setting = *setting};
    *out_point = NULL;
    for (uint32_t i = 0; i < side->point_count && !*out_point; i++)
        if (is_same(&side->point[i].setting, setting)) *out_point = &side->point[i];
    if (*out_point || side->point_count == LW_SCALING_POINTS_MAX) return LW_OK;
    enum lw_status status = linear && !(side->per_sample_s > 0) ? measure_line(x, side, err) : LW_OK;
    if (status == LW_OK)
        status =
            lw_scaling_run_sequence(x, side, setting, 0, linear ? NULL : &point.cost, &point.errors, err);
    if (status != LW_OK) return status;
    point.error = lw_scaling_figures_error(&point.errors, &point.errors);
    if (linear) point.cost.cpu_s[LW_STAGE_TRACE] = side->fixed_s + setting->samples * side->per_sample_s;
    lw_log(LW_LOG_INFO, "%s, %s: relMSE %.4g, %.3g CPU s per frame and user", side->name,
           lw_scaling_run_describe(side, setting).text, point.error, lw_cost_total(&point.cost));
    side->point[side->point_count] = point;
    *out_point = &side->point[side->point_count++];
    return LW_OK;
}

/* ---- a path tracer ---- */

static enum lw_status try_samples(struct lw_scaling *x, struct lw_scaling_side *side, uint32_t samples,
                                  struct lw_scaling_point **out_point, struct lw_error *err) {
    return try_setting(x, side, &(struct lw_setting){.samples = samples}, out_point, err);
}

/* Between two points, where a line through their logarithms has the error. */
static uint32_t interpolate(const struct lw_scaling_point *low, const struct lw_scaling_point *high,
                            double error) {
    const uint32_t from = low->setting.samples, to = high->setting.samples;
    const double share = high->error > 0 ? log(low->error / error) / log(low->error / high->error) : 0.5;
    const double at = from * pow((double)to / from, share);
    return at <= from + 1 ? from + 1 : at >= to - 1 ? to - 1 : (uint32_t)ceil(at);
}

/* Doubled until they reach it, then between the last two; the error of so few pictures is not known better
 * than to an eighth. */
static enum lw_status search_samples(struct lw_scaling *x, struct lw_scaling_side *side, double error,
                                     struct lw_error *err) {
    struct lw_scaling_point *low = NULL, *point; /* low does not reach it */
    enum lw_status status = try_samples(x, side, 1, &point, err);
    while (status == LW_OK && point && point->error > error && point->setting.samples < SAMPLES_MAX) {
        low = point;
        status = try_samples(x, side, 2 * low->setting.samples, &point, err);
    }
    struct lw_scaling_point *high = point;
    while (status == LW_OK && low && point &&
           high->setting.samples - low->setting.samples > 1 + low->setting.samples / 8) {
        status = try_samples(x, side, interpolate(low, high, error), &point, err);
        if (point) *(point->error <= error ? &high : &low) = point;
        if (point == high && point) break; /* as good as the line, which is good enough */
    }
    return status;
}

/* ---- the cache ---- */

static struct lw_setting setting_at(const struct lw_scaling *x, double density, uint32_t rung) {
    struct lw_setting setting = {
        .density = density, .direct_samples = 1, .indirect_samples = 2, .whole = x->options.whole};
    if (x->options.base.motion == LW_SCENE_MOTION_STATIC) {
        setting.target_error = target_errors[rung];
    } else {
        setting.direct_samples = rungs[rung].direct;
        setting.indirect_samples = rungs[rung].indirect;
        setting.target_error = rungs[rung].target_error;
    }
    return setting;
}

/* The largest error that is asked for and not reached yet. */
static double easiest_left(const struct lw_scaling *x, const struct lw_scaling_side *side) {
    double easiest = 0;
    for (uint32_t t = 0; t < x->target_count; t++)
        if (cheapest(side, x->target[t].error) < 0) easiest = fmax(easiest, x->target[t].error);
    return easiest;
}

/* *rung_count: how many rungs are tried; afterwards, one more than those that have gained something. */
static enum lw_status climb(struct lw_scaling *x, struct lw_scaling_side *side, double density,
                            double hardest, uint32_t *rung_count, struct lw_error *err) {
    const bool still = x->options.base.motion == LW_SCENE_MOTION_STATIC;
    const uint32_t rungs_max = *rung_count;
    double last_error = (double)INFINITY;
    for (uint32_t rung = 0; rung < rungs_max; rung++) {
        const struct lw_setting setting = setting_at(x, density, rung);
        struct lw_scaling_point *point;
        enum lw_status status = try_setting(x, side, &setting, &point, err);
        if (status != LW_OK || !point) return status;
        const bool samples_alone = still || rung > 1, gained = point->error <= GAIN_MIN * last_error;
        if (gained) *rung_count = lw_scaling_figures_rungs(rung, rungs_max);
        if (!still && point->error > HOPELESS * easiest_left(x, side)) break; /* for want of texels */
        if (point->error <= hardest || (samples_alone && !gained)) break;
        last_error = point->error;
    }
    return LW_OK;
}

/* The least error of a side so far. */
static double least_error(const struct lw_scaling_side *side) {
    double least = (double)INFINITY;
    for (uint32_t i = 0; i < side->point_count; i++) least = fmin(least, side->point[i].error);
    return least;
}

static enum lw_status search_densities(struct lw_scaling *x, struct lw_scaling_side *side, double hardest,
                                       struct lw_error *err) {
    const bool still = x->options.base.motion == LW_SCENE_MOTION_STATIC;
    enum lw_status status = LW_OK;
    /* rungs that gained nothing at one density are not tried at the next, which costs four times as much */
    uint32_t rung_count = still ? COUNT(target_errors) : COUNT(rungs);
    for (uint32_t d = 0; d < COUNT(densities) && status == LW_OK; d++) {
        const double before = least_error(side);
        if (cheapest(side, hardest) >= 0 || !lw_scene_densities_fits(&x->base.densities, densities[d])) break;
        status = climb(x, side, densities[d], hardest, &rung_count, err);
        if (status == LW_OK && d > 0 && least_error(side) > GAIN_MIN * before && d + 1 < COUNT(densities)) {
            lw_log(LW_LOG_WARNING, "density x%g gains under %.0f %%: denser ones are not tried", densities[d],
                   100 * (1 - GAIN_MIN));
            break;
        }
    }
    return status;
}

/* ---- targets ---- */

static void add_target(struct lw_scaling *x, double error) {
    for (uint32_t t = 0; t < x->target_count; t++)
        if (fabs(x->target[t].error - error) < 1e-12) return;
    x->target[x->target_count++] = (struct lw_scaling_target){.error = error, .best = {-1, -1}};
}

/* The settings that were asked for are each side's only point, and the only target. Where all of the scene is
 * lit, every eye is judged while users are added, and no sequence of its own is spent on it. */
static enum lw_status take_given(struct lw_scaling *x, struct lw_error *err) {
    const struct lw_scaling_options *o = &x->options;
    enum lw_status status = LW_OK;
    for (int s = 0; s < LW_SCALING_SIDES && status == LW_OK; s++) {
        struct lw_scaling_side *side = &x->side[s];
        struct lw_scaling_point *point;
        const struct lw_setting setting = {.density = o->fixed_density,
                                           .direct_samples = o->fixed_direct,
                                           .indirect_samples = o->fixed_indirect,
                                           .target_error = o->fixed_target_error,
                                           .whole = o->whole};
        if (side->traces) {
            status = try_samples(x, side, o->fixed_samples, &point, err);
        } else if (o->whole) {
            point = &side->point[side->point_count++];
            *point = (struct lw_scaling_point){.setting = setting, .later = true};
        } else {
            status = try_setting(x, side, &setting, &point, err);
        }
        if (status != LW_OK || !point) return status;
        if (s == LW_SCALING_PATHS) add_target(x, point->error);
        x->target[0].best[s] = 0;
    }
    return status;
}

enum lw_status lw_scaling_search(struct lw_scaling *x, struct lw_error *err) {
    if (x->options.fixed_samples) return take_given(x, err);
    double error = x->options.error;
    if (x->options.match_samples) {
        struct lw_scaling_point *point;
        enum lw_status status =
            try_samples(x, &x->side[LW_SCALING_PATHS], x->options.match_samples, &point, err);
        if (status != LW_OK || !point) return status;
        error = point->error;
    }
    double hardest = error;
    add_target(x, error);
    for (size_t i = 0; i < COUNT(curve) && !x->options.one_error; i++) {
        add_target(x, curve[i]);
        hardest = fmin(hardest, curve[i]);
    }
    enum lw_status status = LW_OK;
    for (int s = 0; s < LW_SCALING_SIDES; s++) {
        struct lw_scaling_side *side = &x->side[s];
        if (status == LW_OK && !side->traces) status = search_densities(x, side, hardest, err);
        for (uint32_t t = 0; t < x->target_count; t++) {
            if (status == LW_OK && side->traces) status = search_samples(x, side, x->target[t].error, err);
        }
    }
    for (uint32_t t = 0; t < x->target_count; t++)
        for (int s = 0; s < LW_SCALING_SIDES; s++)
            x->target[t].best[s] = cheapest(&x->side[s], x->target[t].error);
    return status;
}
