#include "server/bake/bake.h"

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/progress.h"
#include "server/bake/forecast.h"
#include "server/solve/solver.h"

#include <math.h>
#include <unistd.h>

#define FORECAST_EVERY_S 0.5

enum lw_status lw_bake_resume(const struct lw_bake_desc *desc, uint64_t *out_frames, struct lw_error *err) {
    *out_frames = 0;
    if (!desc->state_path || access(desc->state_path, F_OK) != 0) return LW_OK;
    return desc->solver->ops->load(desc->solver, desc->state_path, desc->key, out_frames, err);
}

struct run {
    const struct lw_bake_desc *desc;
    uint64_t began_ns, saved_ns, forecast_ns;
    struct lw_progress progress;
    struct lw_forecast forecast;
};

static double seconds_since(uint64_t then_ns) { return (double)(lw_clock_ns() - then_ns) * 1e-9; }

/* frames: of this run. Errors of the first ones are noise themselves. */
static void show_progress(struct run *run, const struct lw_solver_stats *stats, uint64_t frames) {
    if (frames < LW_SOLVER_FRAMES_MIN && !run->desc->samples) {
        run->progress.left_s = (double)INFINITY;
    } else if (!run->forecast.count || seconds_since(run->forecast_ns) > FORECAST_EVERY_S) {
        run->forecast_ns = lw_clock_ns();
        run->progress.left_s =
            lw_forecast_note(&run->forecast, seconds_since(run->began_ns), stats->texels_left);
    }
    run->progress.total = stats->tiles;
    lw_progress_set(&run->progress, stats->tiles_converged);
}

/* Hours of light are not thrown away because a disk is full. */
static void save(struct run *run) {
    const struct lw_bake_desc *desc = run->desc;
    struct lw_error err = {0};
    if (!desc->state_path) return;
    if (desc->solver->ops->save(desc->solver, desc->state_path, desc->key, &err) != LW_OK)
        lw_log(LW_LOG_WARNING, "the state is not saved: %s", err.text);
    run->saved_ns = lw_clock_ns();
}

enum lw_status lw_bake_run(const struct lw_bake_desc *desc, uint64_t frames,
                           struct lw_bake_result *out_result, struct lw_error *err) {
    struct lw_bake_result result = {.frames = frames};
    struct run run = {.desc = desc, .began_ns = lw_clock_ns(), .saved_ns = lw_clock_ns()};
    lw_progress_init(&run.progress, "baking", 0);
    run.progress.unit = "tiles";
    run.progress.limit_s = desc->limit_s;
    for (;;) {
        struct lw_solver_stats stats = {0};
        enum lw_status status =
            desc->solver->ops->frame(desc->solver, desc->pose, result.frames + 1, &stats, err);
        if (status != LW_OK) return status;
        result.frames += stats.tiles_solved != 0;
        result.rays += stats.rays_shadow + stats.rays_bounce + stats.rays_probe;
        result.tiles = stats.tiles;
        result.tiles_open = stats.tiles - stats.tiles_converged;
        show_progress(&run, &stats, result.frames - frames);
        if (!result.tiles_open) break;
        result.stopped = desc->stop && *desc->stop;
        result.limited = desc->limit_s > 0 && seconds_since(run.began_ns) >= desc->limit_s;
        if (result.stopped || result.limited) break;
        if (desc->state_interval_s > 0 && seconds_since(run.saved_ns) >= desc->state_interval_s) save(&run);
    }
    if (result.tiles_open)
        lw_progress_stop(&run.progress);
    else
        lw_progress_finish(&run.progress);
    result.seconds = seconds_since(run.began_ns);
    if (result.stopped && desc->state_path) lw_log(LW_LOG_INFO, "saving the state, for a bake that goes on");
    save(&run);
    *out_result = result;
    return LW_OK;
}

void lw_bake_forget(const struct lw_bake_desc *desc) {
    if (desc->state_path) unlink(desc->state_path);
    if (desc->tiles_path) unlink(desc->tiles_path);
}
