#include "server/bake/bake.h"

#include "common/clock.h"
#include "common/log.h"
#include "common/progress.h"
#include "server/solve/solver.h"

#include <unistd.h>

#define PLAN_EVERY_S 0.5

enum lw_status lw_bake_resume(const struct lw_bake_desc *desc, uint64_t *out_frames, struct lw_error *err) {
    *out_frames = 0;
    if (!desc->state_path || access(desc->state_path, F_OK) != 0) return LW_OK;
    return desc->solver->ops->load(desc->solver, desc->state_path, desc->key, out_frames, err);
}

/* Frames that a tile still needs. Its error falls with the root of their number. */
static double frames_left(const struct lw_bake_desc *desc, const struct lw_solver_tile *tile) {
    if (desc->samples) return tile->sample_count < desc->samples ? desc->samples - tile->sample_count : 0;
    const double seen = tile->sample_count ? tile->sample_count : 1,
                 ratio = (double)tile->error / (double)desc->error;
    if (tile->sample_count >= LW_SOLVER_FRAMES_MIN && ratio <= 1) return 0;
    return fmax(fmax(1, LW_SOLVER_FRAMES_MIN - seen), seen * ratio * ratio - seen);
}

/* Texels times frames that lie ahead. */
static uint64_t work_left(const struct lw_bake_desc *desc) {
    double sum = 0;
    for (uint32_t id = 0; id < desc->atlas_map->tile_count; id++) {
        if (desc->atlas_map->place[id].level) continue;
        struct lw_solver_tile tile;
        desc->solver->ops->read_tile(desc->solver, (lw_tile_id){id}, &tile);
        if (!(tile.error > 0)) continue; /* nothing in it, or nothing left to learn */
        uint32_t covered = 0;
        for (uint32_t i = 0; i < tile.width * tile.height; i++) covered += tile.covered[i] != 0;
        sum += frames_left(desc, &tile) * (double)covered;
    }
    return sum < 1e18 ? (uint64_t)sum : (uint64_t)1e18;
}

struct run {
    const struct lw_bake_desc *desc;
    uint64_t began_ns, saved_ns, planned_ns;
    struct lw_progress progress;
};

static double seconds_since(uint64_t then_ns) { return (double)(lw_clock_ns() - then_ns) * 1e-9; }

static void show(struct run *run, const struct lw_solver_stats *stats) {
    if (seconds_since(run->planned_ns) > PLAN_EVERY_S) { /* looks at every texel: not at every short frame */
        run->progress.total = run->progress.done + stats->texels_solved + work_left(run->desc);
        run->planned_ns = lw_clock_ns();
    }
    lw_progress_step(&run->progress, stats->texels_solved);
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
        show(&run, &stats);
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
}
