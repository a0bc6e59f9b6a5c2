#include "client/measure/scaling_users.h"

#include "common/base/log.h"
#include "common/base/progress.h"

#define SETTLE_FRAMES 2u /* after users joined, until all is as it was */
#define COUNT_FRAMES  8u /* measured per count of users; the first one takes all frames */

/* A user of a repeat: each begins with another one, so that no figure rests on one view. */
static uint32_t user_of(const struct lw_scaling *x, uint32_t repeat, uint32_t user, uint32_t users) {
    return (user + repeat) % (users > x->eyes ? users : x->eyes);
}

/* ---- the shared side ---- */

static struct lw_scaling_point *chosen_point(struct lw_scaling *x, enum lw_scaling_side_id s) {
    return &x->side[s].point[x->target[0].best[s]];
}

/* CPU seconds of a frame with this number of users, as the search has found; 1 where that is not known. */
static double foresee_frame(struct lw_scaling *x, uint32_t users) {
    const struct lw_scaling_point *point = chosen_point(x, LW_SCALING_SHARED);
    const uint32_t shown = users < LW_SCALING_SHOWN_MAX ? users : LW_SCALING_SHOWN_MAX;
    double sum_s = 0;
    if (point->later) return 1;
    for (int s = 0; s < LW_STAGE_COUNT; s++)
        sum_s += point->cost.cpu_s[s] * (!lw_stage_is_per_user((enum lw_stage)s) ? 1
                                         : s == LW_STAGE_COMPOSE                 ? shown
                                                                                 : users);
    return sum_s;
}

/* CPU seconds of a repeat's path tracers; 0 where the shared side's cost is not known before. */
static double foresee_paths(struct lw_scaling *x) {
    const struct lw_scaling_side *paths = &x->side[LW_SCALING_PATHS];
    return chosen_point(x, LW_SCALING_SHARED)->later
               ? 0
               : x->eyes * (2 * paths->fixed_s + 5 * paths->per_sample_s);
}

static uint64_t frames_of(const struct lw_scaling *x, uint32_t c) {
    return c == 0 ? x->warm_frames + x->frames : SETTLE_FRAMES + COUNT_FRAMES;
}

/* All that is to come, likewise. */
static double foresee(struct lw_scaling *x) {
    double repeat_s = foresee_paths(x), whole_s = 0;
    if (x->side[LW_SCALING_SHARED].traces) return 2 * repeat_s * x->options.base.repeats;
    for (uint32_t c = 0; c < x->options.user_counts; c++)
        repeat_s += (double)frames_of(x, c) * foresee_frame(x, x->options.users[c]);
    if (x->options.look_whole) whole_s = (double)frames_of(x, 0) * foresee_frame(x, x->options.users[0]);
    return repeat_s * x->options.base.repeats + whole_s;
}

/* One sequence with users who come in steps. */
struct user_steps {
    uint32_t repeat, users;
    bool whole;        /* all of the scene is lit, for any number of users */
    uint64_t frame;    /* the last one */
    double warm_cpu_s; /* the solve's, in the frames before the first that count */
    struct lw_scaling_errors errors;
    struct lw_progress *progress; /* the whole run's, in microseconds of CPU time as foreseen */
    double frame_s;               /* so foreseen */
};

_Static_assert(LW_SCALING_EYES <= LW_SCALING_SHOWN_MAX, "all eyes can be shown at once");

/* The users shown in a frame: as many as possible, in turn. Where light does not depend on the users, all
 * eyes judge. */
static uint32_t choose_shown(const struct lw_scaling *x, const struct user_steps *steps,
                             uint32_t *out_shown) {
    if (steps->whole && lw_scaling_run_picture(x, steps->frame) >= 0) {
        for (uint32_t eye = 0; eye < x->eyes; eye++) out_shown[eye] = eye;
        return x->eyes;
    }
    const uint32_t count = steps->users < LW_SCALING_SHOWN_MAX ? steps->users : LW_SCALING_SHOWN_MAX;
    for (uint32_t k = 0; k < count; k++) {
        uint64_t of_all = (uint64_t)k * steps->users / count;
        uint32_t turn = steps->users > count ? (uint32_t)(steps->frame % steps->users) : 0;
        out_shown[k] = user_of(x, steps->repeat, (uint32_t)of_all + turn, steps->users);
    }
    return count;
}

/* Steps `frames` frames with the users that are there. *out_cost: per frame. */
static enum lw_status measure_frames(struct lw_scaling *x, struct lw_renderer *renderer,
                                     struct user_steps *steps, uint64_t frames, struct lw_cost *out_cost,
                                     struct lw_error *err) {
    enum lw_status status = LW_OK;
    struct lw_cost sum = {0};
    for (uint64_t i = 0; i < frames && status == LW_OK; i++) {
        uint32_t shown[LW_SCALING_SHOWN_MAX];
        steps->frame++;
        uint32_t count = choose_shown(x, steps, shown);
        status = lw_measure_row_check(&x->base, err);
        if (status == LW_OK) status = renderer->ops->step(renderer, steps->frame, shown, count, &sum, err);
        lw_progress_step(steps->progress, (uint64_t)(1e6 * steps->frame_s));
        int picture = lw_scaling_run_picture(x, steps->frame);
        if (status == LW_OK && picture >= 0)
            status = lw_scaling_run_judge(x, renderer, (uint32_t)picture, shown, count, &steps->errors, err);
    }
    *out_cost = (struct lw_cost){0};
    lw_cost_add(out_cost, &sum, 1.0 / (double)frames);
    return status;
}

/* In a still scene the cost of the start is spread over all frames of the first count. Later counts take
 * the same. */
static void spread_start(const struct lw_scaling *x, bool first, struct lw_cost *start,
                         struct lw_cost *cost) {
    if (first) {
        const double share = (double)x->warm_frames / (double)(x->warm_frames + x->frames);
        struct lw_cost all = {0};
        lw_cost_add(&all, start, share);
        lw_cost_add(&all, cost, 1 - share);
        *start = *cost = all;
        return;
    }
    for (int s = 0; s < LW_STAGE_COUNT; s++)
        if (!lw_stage_is_per_user((enum lw_stage)s)) cost->cpu_s[s] = start->cpu_s[s];
}

/* One more count of users; its cost as a frame's. */
static enum lw_status measure_count(struct lw_scaling *x, struct lw_renderer *renderer,
                                    struct user_steps *steps, uint32_t c, struct lw_cost *start,
                                    struct lw_cost *out_cost, struct lw_error *err) {
    steps->users = x->count[c].users;
    steps->frame_s = foresee_frame(x, steps->users);
    enum lw_status status = renderer->ops->set_users(renderer, steps->users, err);
    if (status == LW_OK)
        status = measure_frames(x, renderer, steps, c == 0 ? x->warm_frames : SETTLE_FRAMES,
                                c == 0 ? start : out_cost, err);
    if (c == 0) steps->warm_cpu_s = start->cpu_s[LW_STAGE_SOLVE] * (double)x->warm_frames;
    if (status == LW_OK)
        status = measure_frames(x, renderer, steps, c == 0 ? x->frames : COUNT_FRAMES, out_cost, err);
    if (status == LW_OK && x->options.base.motion == LW_SCENE_MOTION_STATIC)
        spread_start(x, c == 0, start, out_cost);
    return status;
}

static enum lw_status measure_counts(struct lw_scaling *x, struct user_steps *steps, uint32_t counts,
                                     const struct lw_measure_unit *unit, struct lw_scaling_record *record,
                                     struct lw_error *err) {
    struct lw_renderer *renderer = x->side[LW_SCALING_SHARED].renderer;
    struct lw_cost start = {0};
    enum lw_status status = LW_OK;
    for (uint32_t c = 0; c < counts && status == LW_OK; c++) {
        struct lw_cost cost = {0};
        status = measure_count(x, renderer, steps, c, &start, &cost, err);
        if (status != LW_OK) break;
        lw_scaling_run_enter(record, unit, steps->users, c + 1 < counts ? LW_MEASURE_SOME : LW_MEASURE_ALL,
                             &cost);
        lw_log(LW_LOG_INFO, "shared cache, %u user%s: %.4g CPU s per frame", steps->users,
               steps->users > 1 ? "s" : "", lw_cost_total(&cost));
    }
    return status;
}

/* All counts of users, or the first one alone, from the tables or measured. */
static enum lw_status find_counts(struct lw_scaling *x, struct lw_progress *progress, uint32_t repeat,
                                  const struct lw_setting *setting, uint32_t counts,
                                  struct lw_scaling_record *record, struct lw_error *err) {
    struct lw_renderer *renderer = x->side[LW_SCALING_SHARED].renderer;
    const struct lw_measure_unit unit =
        lw_scaling_run_unit(x, &x->side[LW_SCALING_SHARED], setting, repeat + 1);
    struct user_steps steps = {.repeat = repeat, .whole = setting->whole, .progress = progress};
    if (lw_scaling_run_load(x, &unit, record)) return LW_OK;
    *record = (struct lw_scaling_record){.line_count = 0};
    enum lw_status status =
        renderer->ops->start(renderer, setting, false, x->options.base.seed + unit.repeat, err);
    if (status == LW_OK) status = measure_counts(x, &steps, counts, &unit, record, err);
    renderer->ops->stop(renderer);
    if (status != LW_OK) return status;
    record->errors = steps.errors;
    record->line[counts - 1].extra[LW_MEASURE_EXTRA_WARM_CPU] = steps.warm_cpu_s;
    return lw_scaling_run_save(x, record, err);
}

static enum lw_status measure_shared(struct lw_scaling *x, struct lw_progress *progress, uint32_t repeat,
                                     struct lw_error *err) {
    struct lw_scaling_record record;
    enum lw_status status =
        find_counts(x, progress, repeat, &x->chosen[LW_SCALING_SHARED], x->options.user_counts, &record, err);
    if (status != LW_OK) return status;
    struct lw_scaling_point *ours = chosen_point(x, LW_SCALING_SHARED);
    if (ours->later) ours->errors = record.errors;
    x->shared_error[repeat] = lw_scaling_figures_error(&record.errors, &record.errors);
    x->paths_error[repeat] =
        lw_scaling_figures_error(&chosen_point(x, LW_SCALING_PATHS)->errors, &record.errors);
    for (uint32_t c = 0; c < record.line_count; c++) {
        x->count[c].shared[repeat] = lw_measure_store_cost(&record.line[c]);
        x->count[c].cost_s[LW_SCALING_SHARED][repeat] = lw_measure_store_total(&record.line[c]);
    }
    x->warm_cpu_s = record.line[record.line_count - 1].extra[LW_MEASURE_EXTRA_WARM_CPU];
    return LW_OK;
}

/* The first count with all of the scene lit, after the first repeat. */
static enum lw_status measure_whole(struct lw_scaling *x, struct lw_progress *progress,
                                    struct lw_error *err) {
    struct lw_scaling_record record;
    struct lw_setting setting = x->chosen[LW_SCALING_SHARED];
    setting.whole = true;
    enum lw_status status = find_counts(x, progress, 0, &setting, 1, &record, err);
    if (status != LW_OK) return status;
    x->whole_ratio = lw_measure_store_total(&record.line[0]) / x->count[0].cost_s[LW_SCALING_PATHS][0];
    x->whole_error = lw_scaling_figures_error(&record.errors, &record.errors);
    x->whole_paths_error =
        lw_scaling_figures_error(&chosen_point(x, LW_SCALING_PATHS)->errors, &record.errors);
    x->whole_done = true;
    return LW_OK;
}

/* ---- path tracers ---- */

static enum lw_status measure_paths(struct lw_scaling *x, struct lw_progress *progress,
                                    enum lw_scaling_side_id s, uint32_t repeat, struct lw_error *err) {
    double per_eye_s[LW_SCALING_EYES] = {0}, sum_s = 0;
    enum lw_status status = lw_scaling_run_trace(x, &x->side[s], &x->chosen[s], repeat + 1, per_eye_s, err);
    if (status != LW_OK) return status;
    for (uint32_t eye = 0; eye < x->eyes; eye++) sum_s += per_eye_s[eye];
    for (uint32_t c = 0; c < x->options.user_counts; c++) {
        const uint32_t users = x->count[c].users;
        double cost_s = 0;
        if (users < x->eyes) /* they are eyes themselves; more are as the eyes in the mean */
            for (uint32_t u = 0; u < users; u++) cost_s += per_eye_s[user_of(x, repeat, u, users)];
        else
            cost_s = users * sum_s / x->eyes;
        x->count[c].cost_s[s][repeat] = cost_s;
    }
    lw_progress_step(progress, (uint64_t)(1e6 * foresee_paths(x)));
    lw_log(LW_LOG_INFO, "%s: %.4g CPU s per frame and user", x->side[s].name, sum_s / x->eyes);
    return LW_OK;
}

/* ---- figures ---- */

static void conclude(struct lw_scaling *x) {
    const uint32_t repeats = x->repeats_done, counts = x->options.user_counts;
    double ratio[LW_SCALING_REPEATS_MAX], slope[LW_SCALING_REPEATS_MAX], cross[LW_SCALING_REPEATS_MAX];
    for (uint32_t c = 0; c < counts; c++) {
        struct lw_scaling_count *count = &x->count[c];
        count->cost = (struct lw_cost){0};
        for (uint32_t i = 0; i < repeats; i++) {
            lw_cost_add(&count->cost, &count->shared[i], 1.0 / repeats);
            ratio[i] = count->cost_s[LW_SCALING_SHARED][i] / count->cost_s[LW_SCALING_PATHS][i];
        }
        count->ratio = lw_scaling_figures_mean(ratio, repeats);
    }
    for (uint32_t i = 0; i < repeats; i++) {
        uint32_t users[LW_SCALING_COUNTS_MAX];
        double cost_s[LW_SCALING_COUNTS_MAX], fixed_s, slope_s;
        for (uint32_t c = 0; c < counts; c++) {
            users[c] = x->count[c].users;
            cost_s[c] = x->count[c].cost_s[LW_SCALING_SHARED][i];
        }
        /* the last count's path tracers are the mean over all eyes */
        const double alone_s = x->count[counts - 1].cost_s[LW_SCALING_PATHS][i] / users[counts - 1];
        lw_scaling_figures_line(users, cost_s, counts, &fixed_s, &slope_s);
        slope[i] = slope_s / alone_s;
        cross[i] = lw_scaling_figures_cross(fixed_s, slope_s, alone_s);
    }
    x->count_done = counts;
    x->first_ratio = x->count[0].ratio;
    x->marginal = lw_scaling_figures_mean(slope, repeats);
    x->crossover = lw_scaling_figures_mean(cross, repeats);
}

/* One repeat. After the first one the whole scene is lit once as well. */
static enum lw_status measure_repeat(struct lw_scaling *x, struct lw_progress *progress, uint32_t i,
                                     struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (int s = 0; s < LW_SCALING_SIDES && status == LW_OK; s++)
        status = x->side[s].traces ? measure_paths(x, progress, (enum lw_scaling_side_id)s, i, err)
                                   : measure_shared(x, progress, i, err);
    if (status != LW_OK) return status;
    x->repeats_done = i + 1; /* also if the run with the whole scene fails */
    const bool looks = x->options.look_whole && !x->side[LW_SCALING_SHARED].traces;
    return looks && i == 0 ? measure_whole(x, progress, err) : LW_OK;
}

/* The shared side's only point, where it was left to the repeats. */
static void fill_point(struct lw_scaling *x, struct lw_scaling_point *point) {
    point->error = lw_scaling_figures_mean(x->shared_error, x->repeats_done).mean;
    point->cost = lw_scaling_run_of_one(&x->count[0].cost, x->count[0].users);
    point->later = false;
    x->chosen_error[LW_SCALING_SHARED] = point->error;
}

enum lw_status lw_scaling_users(struct lw_scaling *x, struct lw_error *err) {
    for (int s = 0; s < LW_SCALING_SIDES; s++) {
        const int best = x->target[0].best[s];
        if (best < 0) {
            x->shortfall = s == LW_SCALING_PATHS
                               ? "the path tracer did not reach the error"
                               : "the shared cache did not reach the error with any setting tried";
            return LW_OK;
        }
        x->chosen[s] = x->side[s].point[best].setting;
        x->chosen_error[s] = x->side[s].point[best].error;
    }
    for (uint32_t c = 0; c < x->options.user_counts; c++) x->count[c].users = x->options.users[c];
    enum lw_status status = LW_OK;
    struct lw_progress progress;
    lw_progress_init(&progress, "counting users", (uint64_t)(1e6 * foresee(x)));
    for (uint32_t i = 0; i < x->options.base.repeats && status == LW_OK; i++)
        status = measure_repeat(x, &progress, i, err);
    lw_progress_end(&progress, status == LW_OK);
    if (!x->repeats_done) return status;
    conclude(x);
    struct lw_scaling_point *point = chosen_point(x, LW_SCALING_SHARED);
    if (point->later) fill_point(x, point);
    return status;
}
