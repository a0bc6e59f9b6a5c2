#include "client/measure/scaling_run.h"

#include "common/base/progress.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Costs are linear in samples: those of many are worked out from those of these. */
#define FEW  1u
#define MORE 4u

/* ---- the tables ---- */

struct lw_measure_unit lw_scaling_run_unit(const struct lw_scaling *x, const struct lw_scaling_side *side,
                                           const struct lw_setting *setting, uint32_t repeat) {
    /* a test of the harness has the same renderer on both sides */
    const bool second = side->traces && side == &x->side[LW_SCALING_SHARED];
    struct lw_measure_unit unit = {.repeat = repeat};
    snprintf(unit.renderer, sizeof unit.renderer, "%s%s", side->traces ? side->name : LW_MEASURE_CACHE,
             second ? " again" : "");
    lw_measure_store_setting(setting, !side->traces, unit.setting);
    return unit;
}

bool lw_scaling_run_load(const struct lw_scaling *x, const struct lw_measure_unit *unit,
                         struct lw_scaling_record *out_record) {
    const struct lw_measure_store *s = &x->base.store;
    struct lw_scaling_record record = {.line_count = 0};
    if (!lw_measure_store_has(s, unit)) return false;
    for (size_t i = 0; i < s->expense_count && record.line_count < LW_SCALING_COUNTS_MAX; i++)
        if (lw_measure_store_same(&s->expense[i].unit, unit))
            record.line[record.line_count++] = s->expense[i];
    for (size_t i = 0; i < s->sample_count; i++) {
        const struct lw_measure_sample *sample = &s->sample[i];
        const int picture = lw_scaling_run_picture(x, sample->frame);
        if (!lw_measure_store_same(&sample->unit, unit) || picture < 0 || sample->view >= x->eyes) continue;
        record.errors.of[picture][sample->view] = sample->coin[LW_MEASURE_COIN_RELMSE];
        record.errors.judged[picture][sample->view] = true;
    }
    *out_record = record;
    return true;
}

struct lw_measure_expense *lw_scaling_run_enter(struct lw_scaling_record *record,
                                                const struct lw_measure_unit *unit, uint32_t users,
                                                uint32_t view, const struct lw_cost *cost) {
    struct lw_measure_expense *e = &record->line[record->line_count++];
    *e = lw_measure_store_expense(unit, users, view);
    memcpy(e->cpu_s, cost->cpu_s, sizeof e->cpu_s);
    e->extra[LW_MEASURE_EXTRA_RAYS] = cost->rays;
    e->extra[LW_MEASURE_EXTRA_BYTES] = cost->bytes;
    return e;
}

enum lw_status lw_scaling_run_save(struct lw_scaling *x, struct lw_scaling_record *record,
                                   struct lw_error *err) {
    struct lw_measure_sample sample[LW_SCALING_PICTURES * LW_SCALING_EYES];
    struct lw_measure_expense *last = &record->line[record->line_count - 1];
    uint32_t count = 0;
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        for (uint32_t eye = 0; eye < x->eyes; eye++) {
            if (!record->errors.judged[p][eye]) continue;
            struct lw_measure_sample *s = &sample[count++];
            *s =
                (struct lw_measure_sample){.unit = last->unit, .view = eye, .frame = (uint32_t)x->picture[p]};
            for (int c = 0; c < LW_MEASURE_COIN_COUNT; c++) s->coin[c] = (double)NAN;
            s->coin[LW_MEASURE_COIN_RELMSE] = record->errors.of[p][eye];
        }
    last->samples = count;
    return lw_measure_store_append(&x->base.store, sample, count, record->line, record->line_count, err);
}

struct lw_report_words lw_scaling_run_describe(const struct lw_scaling_side *side,
                                               const struct lw_setting *s) {
    struct lw_report_words words;
    if (side->traces)
        snprintf(words.text, sizeof words.text, "%u path%s per pixel", s->samples, s->samples > 1 ? "s" : "");
    else
        snprintf(words.text, sizeof words.text, "density ×%g, %u + %u samples, target error %g", s->density,
                 s->direct_samples, s->indirect_samples, s->target_error);
    return words;
}

/* ---- pictures ---- */

int lw_scaling_run_picture(const struct lw_scaling *x, uint64_t frame) {
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        if (x->picture[p] == frame) return (int)p;
    return -1;
}

enum lw_status lw_scaling_run_judge(const struct lw_scaling *x, const struct lw_renderer *renderer,
                                    uint32_t picture, const uint32_t *shown, uint32_t shown_count,
                                    struct lw_scaling_errors *errors, struct lw_error *err) {
    float *lattice = malloc((size_t)x->lattice_width * x->lattice_height * 3 * sizeof *lattice);
    if (!lattice) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    for (uint32_t k = 0; k < shown_count; k++) {
        if (shown[k] >= x->eyes || x->dark[picture][shown[k]]) continue;
        renderer->ops->picture(renderer, k, lattice);
        errors->of[picture][shown[k]] = lw_reference_error(&x->reference[picture][shown[k]], lattice);
        errors->judged[picture][shown[k]] = true;
    }
    free(lattice);
    return LW_OK;
}

/* ---- a sequence ---- */

struct lw_cost lw_scaling_run_of_one(const struct lw_cost *cost, double users) {
    struct lw_cost one = *cost;
    for (int s = 0; s < LW_STAGE_COUNT; s++)
        if (lw_stage_is_per_user((enum lw_stage)s)) one.cpu_s[s] /= users;
    one.bytes /= users;
    return one;
}

/* Shows all eyes in a picture's frame and where pictures build on each other, else one in turn. */
static uint32_t choose_shown(const struct lw_scaling *x, const struct lw_renderer *renderer, uint64_t frame,
                             uint32_t *out_shown) {
    for (uint32_t i = 0; i < x->eyes; i++) out_shown[i] = i;
    if (renderer->keeps || lw_scaling_run_picture(x, frame) >= 0) return x->eyes;
    out_shown[0] = (uint32_t)(frame % x->eyes);
    return 1; /* also where nothing is measured: a user who is shown sets its interest */
}

static bool is_needed(const struct lw_scaling *x, const struct lw_renderer *renderer, uint64_t frame) {
    if (renderer->history == UINT32_MAX) return true;
    for (uint32_t p = 0; p < LW_SCALING_PICTURES; p++)
        if (frame <= x->picture[p] && x->picture[p] - frame <= renderer->history) return true;
    return false;
}

static uint64_t count_needed(const struct lw_scaling *x, const struct lw_renderer *renderer) {
    uint64_t count = 0;
    for (uint64_t frame = 1; frame <= x->warm_frames + x->frames; frame++)
        count += is_needed(x, renderer, frame);
    return count;
}

/* All frames. *out_cost: per frame, of all eyes. */
static enum lw_status step_through(struct lw_scaling *x, struct lw_renderer *renderer, bool costs,
                                   struct lw_scaling_errors *errors, struct lw_progress *progress,
                                   struct lw_cost *out_cost, struct lw_error *err) {
    const bool from_start = x->options.base.motion == LW_SCENE_MOTION_STATIC;
    struct lw_cost sum = {0};
    double measured = 0;
    enum lw_status status = LW_OK;
    for (uint64_t frame = 1; status == LW_OK && frame <= x->warm_frames + x->frames; frame++) {
        if (!is_needed(x, renderer, frame)) continue;
        uint32_t shown[LW_SCALING_EYES];
        const bool counts = costs && (from_start || frame > x->warm_frames);
        const uint32_t shown_count = choose_shown(x, renderer, frame, shown);
        const int picture = lw_scaling_run_picture(x, frame);
        struct lw_cost cost = {0};
        status = lw_measure_row_check(&x->base, err);
        if (status == LW_OK) status = renderer->ops->step(renderer, frame, shown, shown_count, &cost, err);
        lw_cost_add(&sum, &cost, counts);
        measured += counts;
        lw_progress_step(progress, 1);
        if (status == LW_OK && picture >= 0)
            status = lw_scaling_run_judge(x, renderer, (uint32_t)picture, shown, shown_count, errors, err);
    }
    *out_cost = (struct lw_cost){0};
    lw_cost_add(out_cost, &sum, measured > 0 ? 1 / measured : 0);
    return status;
}

static enum lw_status measure_sequence(struct lw_scaling *x, const struct lw_scaling_side *side,
                                       const struct lw_setting *setting, const struct lw_measure_unit *unit,
                                       bool costs, struct lw_scaling_record *record, struct lw_error *err) {
    struct lw_renderer *renderer = side->renderer;
    struct lw_progress progress;
    struct lw_cost cost;
    *record = (struct lw_scaling_record){.line_count = 0};
    lw_progress_init(&progress, renderer->ops->name, count_needed(x, renderer));
    enum lw_status status =
        renderer->ops->start(renderer, setting, !costs, x->options.base.seed + unit->repeat, err);
    if (status == LW_OK) status = renderer->ops->set_users(renderer, x->eyes, err);
    if (status == LW_OK) status = step_through(x, renderer, costs, &record->errors, &progress, &cost, err);
    renderer->ops->stop(renderer);
    lw_progress_end(&progress, status == LW_OK);
    if (status != LW_OK) return status;
    cost = lw_scaling_run_of_one(&cost, x->eyes);
    lw_scaling_run_enter(record, unit, 1, LW_MEASURE_ALL, &cost);
    return lw_scaling_run_save(x, record, err);
}

enum lw_status lw_scaling_run_sequence(struct lw_scaling *x, const struct lw_scaling_side *side,
                                       const struct lw_setting *setting, uint32_t repeat,
                                       struct lw_cost *out_cost, struct lw_scaling_errors *out_errors,
                                       struct lw_error *err) {
    const struct lw_measure_unit unit = lw_scaling_run_unit(x, side, setting, repeat);
    struct lw_scaling_record record;
    enum lw_status status = LW_OK;
    if (!lw_scaling_run_load(x, &unit, &record))
        status = measure_sequence(x, side, setting, &unit, out_cost != NULL, &record, err);
    if (status != LW_OK) return status;
    *out_errors = record.errors;
    if (out_cost) *out_cost = lw_measure_store_cost(&record.line[0]);
    return LW_OK;
}

/* ---- path tracers' cost ---- */

static enum lw_status trace_each(struct lw_scaling *x, struct lw_renderer *renderer, uint32_t samples,
                                 uint32_t repeat, double *out_per_eye_s, struct lw_error *err) {
    const uint32_t seed = x->options.base.seed + repeat;
    const uint64_t frame = x->picture[repeat ? (repeat - 1) % LW_SCALING_PICTURES : LW_SCALING_PICTURES / 2];
    /* where a frame's cost depends on the one before, the last of two is measured */
    const uint64_t before = renderer->keeps ? 1 : 0;
    enum lw_status status = LW_OK;
    for (uint32_t eye = 0; eye < x->eyes && status == LW_OK; eye++) {
        struct lw_cost cost = {0};
        status = lw_measure_row_check(&x->base, err);
        if (status == LW_OK)
            status =
                renderer->ops->start(renderer, &(struct lw_setting){.samples = samples}, false, seed, err);
        if (status == LW_OK) status = renderer->ops->set_users(renderer, 1, err);
        for (uint64_t back = before + 1; back-- > 0 && status == LW_OK;) {
            cost = (struct lw_cost){0};
            status = renderer->ops->step(renderer, frame - back, &eye, 1, &cost, err);
        }
        renderer->ops->stop(renderer);
        out_per_eye_s[eye] = lw_cost_total(&cost);
    }
    return status;
}

/* Traces few samples. The cost of many lies on the line through two counts. */
static enum lw_status trace_samples(struct lw_scaling *x, struct lw_renderer *renderer, uint32_t samples,
                                    uint32_t repeat, double *out_per_eye_s, struct lw_error *err) {
    if (samples <= MORE) return trace_each(x, renderer, samples, repeat, out_per_eye_s, err);
    double few_s[LW_SCALING_EYES], more_s[LW_SCALING_EYES];
    enum lw_status status = trace_each(x, renderer, FEW, repeat, few_s, err);
    if (status == LW_OK) status = trace_each(x, renderer, MORE, repeat, more_s, err);
    for (uint32_t eye = 0; status == LW_OK && eye < x->eyes; eye++)
        out_per_eye_s[eye] = few_s[eye] + (more_s[eye] - few_s[eye]) / (MORE - FEW) * (samples - FEW);
    return status;
}

enum lw_status lw_scaling_run_trace(struct lw_scaling *x, const struct lw_scaling_side *side,
                                    const struct lw_setting *setting, uint32_t repeat,
                                    double out_per_eye_s[LW_SCALING_EYES], struct lw_error *err) {
    if (side->renderer->history == UINT32_MAX) { /* what a frame costs depends on all before */
        struct lw_cost cost;
        struct lw_scaling_errors ignored;
        enum lw_status status = lw_scaling_run_sequence(x, side, setting, repeat, &cost, &ignored, err);
        for (uint32_t eye = 0; status == LW_OK && eye < x->eyes; eye++)
            out_per_eye_s[eye] = lw_cost_total(&cost);
        return status;
    }
    struct lw_measure_unit unit = lw_scaling_run_unit(x, side, setting, repeat);
    struct lw_scaling_record record = {.line_count = 0};
    const size_t name = strlen(unit.renderer);
    snprintf(unit.renderer + name, sizeof unit.renderer - name, " alone"); /* beside the sequence's unit */
    if (lw_scaling_run_load(x, &unit, &record) && record.line_count == x->eyes + 1) {
        for (uint32_t eye = 0; eye < x->eyes; eye++)
            out_per_eye_s[eye] = lw_measure_store_total(&record.line[eye]);
        return LW_OK;
    }
    enum lw_status status = trace_samples(x, side->renderer, setting->samples, repeat, out_per_eye_s, err);
    if (status != LW_OK) return status;
    struct lw_cost sum = {0};
    for (uint32_t eye = 0; eye < x->eyes; eye++) {
        const struct lw_cost cost = {.cpu_s[LW_STAGE_TRACE] = out_per_eye_s[eye]};
        lw_scaling_run_enter(&record, &unit, 1, eye, &cost);
        lw_cost_add(&sum, &cost, 1);
    }
    lw_scaling_run_enter(&record, &unit, x->eyes, LW_MEASURE_ALL, &sum);
    return lw_scaling_run_save(x, &record, err);
}
