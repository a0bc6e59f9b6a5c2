#include "client/measure/scaling_run.h"

#include <stdlib.h>

/* Costs are linear in samples: those of many are worked out from those of these. */
#define FEW  1u
#define MORE 4u

bool lw_scaling_run_stopped(const struct lw_scaling_run *run) { return run->cancel && *run->cancel; }

void lw_scaling_run_end(const struct lw_scaling_run *run, enum lw_status status,
                        struct lw_progress *progress) {
    if (status == LW_OK && !lw_scaling_run_stopped(run))
        lw_progress_finish(progress);
    else
        lw_progress_stop(progress);
}

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

/* Who is shown: all in a picture's frame and where pictures build on each other, else one in turn. */
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

enum lw_status lw_scaling_run_sequence(struct lw_scaling_run *run, struct lw_renderer *renderer,
                                       const struct lw_setting *setting, uint32_t seed,
                                       struct lw_cost *out_cost, struct lw_scaling_errors *out_errors,
                                       struct lw_error *err) {
    const struct lw_scaling *x = run->x;
    const bool from_start = x->options.base.motion == LW_SCENE_MOTION_STATIC;
    struct lw_cost sum = {0};
    double measured = 0;
    *out_errors = (struct lw_scaling_errors){.of = {{0}}};
    struct lw_progress progress;
    lw_progress_init(&progress, renderer->ops->name, count_needed(x, renderer));
    enum lw_status status = renderer->ops->start(renderer, setting, out_cost == NULL, seed, err);
    if (status == LW_OK) status = renderer->ops->set_users(renderer, x->eyes, err);
    for (uint64_t frame = 1; status == LW_OK && frame <= x->warm_frames + x->frames; frame++) {
        if (lw_scaling_run_stopped(run)) break;
        if (!is_needed(x, renderer, frame)) continue;
        uint32_t shown[LW_SCALING_EYES];
        const bool counts = from_start || frame > x->warm_frames;
        const uint32_t shown_count = choose_shown(x, renderer, frame, shown);
        const int picture = lw_scaling_run_picture(x, frame);
        struct lw_cost cost = {0};
        status = renderer->ops->step(renderer, frame, shown, shown_count, &cost, err);
        lw_cost_add(&sum, &cost, counts);
        measured += counts;
        lw_progress_step(&progress, 1);
        if (status == LW_OK && picture >= 0)
            status =
                lw_scaling_run_judge(x, renderer, (uint32_t)picture, shown, shown_count, out_errors, err);
    }
    renderer->ops->stop(renderer);
    lw_scaling_run_end(run, status, &progress);
    if (status != LW_OK) return status;
    if (out_cost) {
        struct lw_cost per_frame = {0};
        lw_cost_add(&per_frame, &sum, measured > 0 ? 1 / measured : 0);
        *out_cost = lw_scaling_run_of_one(&per_frame, x->eyes);
    }
    return LW_OK;
}

/* ---- path tracers' cost ---- */

static enum lw_status trace_each(struct lw_scaling_run *run, struct lw_renderer *renderer, uint32_t samples,
                                 uint32_t picture, uint32_t seed, double *out_per_eye_s,
                                 struct lw_error *err) {
    const struct lw_scaling *x = run->x;
    /* where a frame's cost depends on the one before, the last of two is measured */
    const uint64_t before = renderer->keeps ? 1 : 0;
    enum lw_status status = LW_OK;
    for (uint32_t eye = 0; eye < x->eyes && status == LW_OK && !lw_scaling_run_stopped(run); eye++) {
        struct lw_cost cost = {0};
        status = renderer->ops->start(renderer, &(struct lw_setting){.samples = samples}, false, seed, err);
        if (status == LW_OK) status = renderer->ops->set_users(renderer, 1, err);
        for (uint64_t back = before + 1; back-- > 0 && status == LW_OK;) {
            cost = (struct lw_cost){0};
            status = renderer->ops->step(renderer, x->picture[picture] - back, &eye, 1, &cost, err);
        }
        renderer->ops->stop(renderer);
        out_per_eye_s[eye] = lw_cost_total(&cost);
    }
    return status;
}

enum lw_status lw_scaling_run_trace(struct lw_scaling_run *run, struct lw_renderer *renderer,
                                    const struct lw_setting *setting, uint32_t picture, uint32_t seed,
                                    double out_per_eye_s[LW_SCALING_EYES], struct lw_error *err) {
    const struct lw_scaling *x = run->x;
    if (renderer->history == UINT32_MAX) { /* what a frame costs depends on all before */
        struct lw_cost cost;
        struct lw_scaling_errors ignored;
        enum lw_status status = lw_scaling_run_sequence(run, renderer, setting, seed, &cost, &ignored, err);
        for (uint32_t eye = 0; status == LW_OK && eye < x->eyes; eye++)
            out_per_eye_s[eye] = lw_cost_total(&cost);
        return status;
    }
    if (setting->samples <= MORE)
        return trace_each(run, renderer, setting->samples, picture, seed, out_per_eye_s, err);
    double few_s[LW_SCALING_EYES], more_s[LW_SCALING_EYES];
    enum lw_status status = trace_each(run, renderer, FEW, picture, seed, few_s, err);
    if (status == LW_OK) status = trace_each(run, renderer, MORE, picture, seed, more_s, err);
    for (uint32_t eye = 0; status == LW_OK && eye < x->eyes; eye++)
        out_per_eye_s[eye] =
            few_s[eye] + (more_s[eye] - few_s[eye]) / (MORE - FEW) * (setting->samples - FEW);
    return status;
}
