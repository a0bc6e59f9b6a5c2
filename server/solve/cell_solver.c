#include "server/solve/cell_layer.h"

#include "common/clock.h"
#include "common/light/client_lights.h"
#include "common/log.h"
#include "common/progress.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/adapt/follow.h"
#include "server/solve/adapt/schedule.h"
#include "server/solve/adapt/verify.h"
#include "server/solve/filter/denoise.h"
#include "server/solve/state/checkpoint.h"
#include "server/solve/transport/bounces.h"
#include "server/solve/transport/direct_light.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* Of a frame's budget, what is left for solving at least, however long it takes to ask what has changed. */
#define SOLVING_SHARE 0.5

struct cell_solver {
    struct lw_solver base;
    struct lw_solver_desc desc;
    int threads;
    struct lw_geometry *geometry;
    struct lw_geometry own_geometry; /* unless it is shared */
    struct lw_cells cells;
    struct lw_tiles tiles;
    struct lw_seams_light welds[LW_LIGHT_FORM_COUNT]; /* SPLIT: only with client lights */
    unsigned forms;                                   /* that are shown (light_form.h) */
    bool shows_all;                 /* one of them is new: the next frame shows everything */
    uint32_t seams_found;           /* of the geometry: those that the welds are of */
    struct lw_lights lights, drawn; /* without client lights, and those; drawn: zeroed where there are none */
    struct lw_probes probes;
    bool has_probes;
    struct lw_denoise denoise; /* empty unless the desc asks for it */
    uint32_t *end;
    struct lw_pose pose;         /* the last one given */
    struct lw_progress progress; /* of a frame */
    struct lw_schedule schedule;
    struct lw_follow follow;
    uint32_t frames;
    double texel_ns; /* wall time that one takes, in the mean of late */
    struct lw_cell_layer_turn turn;
    bool forgetful; /* the tiles' estimates are not those of their last solve: a checkpoint keeps none */
    unsigned
        pose_due;  /* what of the pose has changed since rays, lights and tiles were last placed: LW_POSE_* */
    bool view_due; /* likewise: which objects are hidden */
};

/* Of the above, what a checkpoint keeps. */
struct remembered {
    uint32_t frames, frames_since_move, moves;
    uint32_t judges_split; /* errors are those of the split form */
};

static bool judges_split(const struct cell_solver *s) { return s->tiles.judged_spread != s->tiles.spread; }

static bool parts_drawn(const struct cell_solver *s) { return lw_client_lights_any(s->desc.client_lights); }

/* Seams that hold an object which has begun to move may do so a little longer where frames have a time to keep. */
static enum lw_status find_seams(struct cell_solver *s) {
    enum lw_status status = lw_geometry_find_seams(s->geometry, &s->tiles, s->desc.frame_budget_s > 0);
    if (status != LW_OK || s->seams_found == s->geometry->seams_found) return status;
    s->seams_found = s->geometry->seams_found;
    for (int f = 0; f < LW_LIGHT_FORM_COUNT && status == LW_OK; f++) {
        lw_seams_light_finish(&s->welds[f]);
        if (f == LW_LIGHT_FORM_FULL || parts_drawn(s))
            status = lw_seams_light_init(&s->welds[f], &s->geometry->seams, f);
    }
    return status;
}

/* A step is a tile in a pass over all that are due. Shown of the first frame, which may be long, and while
 * somebody waits for the end of one. */
static void begin_progress(struct cell_solver *s) {
    static const _Atomic bool never = false;
    const uint32_t passes = 1 + (s->desc.bounces ? 1 + s->desc.bounces : 0);
    uint64_t due = 0;
    for (uint32_t i = 0; i < s->tiles.count; i++) due += s->tiles.tile[i].due;
    lw_progress_init(&s->progress, s->frames ? "finishing the samples under way" : "lighting the first frame",
                     due * passes);
    if (s->frames) s->progress.wanted = s->desc.finishing ? s->desc.finishing : &never;
}

/* What all tiles send out, from their sums. */
static void radiate_all(struct cell_solver *s) {
    const struct lw_transport passes = {.tiles = &s->tiles};
    for (uint32_t bounce = 0; bounce < s->desc.bounces; bounce++) {
#pragma omp parallel for schedule(static) num_threads(s->threads)
        for (uint32_t i = 0; i < s->tiles.count; i++) lw_bounces_radiate(&passes, &s->tiles.tile[i], bounce);
    }
}

/* Takes over s->pose. */
static enum lw_status place(struct cell_solver *s, struct lw_solver_stats *stats, struct lw_error *err) {
    enum lw_status status = lw_geometry_set_pose(s->geometry, &s->pose, s->desc.frame_budget_s > 0, err);
    if (status != LW_OK) return status;
    if (s->pose_due & LW_POSE_DYNAMIC) lw_tiles_recount(&s->tiles, s->threads);
    if (s->pose_due & (LW_POSE_MATERIALS | LW_POSE_SKY))
        status = lw_lights_set_materials(&s->lights, &s->pose);
    if (status == LW_OK && s->pose_due & (LW_POSE_MATERIALS | LW_POSE_SKY) && parts_drawn(s))
        status = lw_lights_set_materials(&s->drawn, &s->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "taking over what has changed");
    if (s->pose_due & LW_POSE_MATERIALS) radiate_all(s);
    lw_lights_set_pose(&s->lights, &s->pose);
    if (parts_drawn(s)) lw_lights_set_pose(&s->drawn, &s->pose);
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->pose);
    if (s->has_probes) {
        uint64_t t = lw_clock_ns();
        stats->rays_probe += lw_probes_place(&s->probes, &s->pose, s->geometry->trace, s->threads);
        stats->probe_ns += lw_clock_ns() - t;
    }
    s->pose_due = 0;
    s->view_due = false;
    return LW_OK;
}

static bool cancelled(const struct cell_solver *s) { return s->desc.cancel && *s->desc.cancel; }

static bool has_work(const struct cell_solver *s, const struct lw_solve_tile *tile) {
    return tile->due && !cancelled(s);
}

/* The frames for which probes may remember, that many frames after a movement. */
static uint32_t probe_history_max(const struct cell_solver *s) {
    const struct lw_follow *follow = &s->follow;
    return follow->moves ? LW_CELL_LAYER_HISTORY_PROBES - 1 + follow->frames_since_move / 2 : UINT32_MAX;
}

static void count_rays(struct lw_solver_stats *stats, const struct lw_ray_count *count) {
    stats->rays_shadow += count->shadow;
    stats->rays_bounce += count->bounce;
}

static struct lw_converged rest_of(const struct cell_solver *s) {
    return (struct lw_converged){.target_error = s->desc.target_error, .frames_max = s->desc.frames_max};
}

/* ---- the passes ---- */

static void run_direct(struct cell_solver *s, const struct lw_transport *passes,
                       struct lw_solver_stats *stats) {
    uint64_t shadow = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shadow)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (!has_work(s, tile)) continue;
        struct lw_ray_count count = {0};
        lw_direct_light_solve(passes, tile, &count);
        shadow += count.shadow;
        lw_progress_step(&s->progress, 1);
    }
    stats->rays_shadow += shadow;
}

static void run_trace_ends(struct cell_solver *s, const struct lw_transport *passes,
                           struct lw_solver_stats *stats) {
    uint64_t bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : bounce)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        if (!has_work(s, &s->tiles.tile[i])) continue;
        struct lw_ray_count count = {0};
        lw_bounces_trace(passes, &s->tiles.tile[i], &count);
        lw_schedule_note_hits(&s->schedule, &s->tiles, &s->tiles.tile[i], s->end);
        bounce += count.bounce;
        lw_progress_step(&s->progress, 1);
    }
    stats->rays_bounce += bounce;
}

static void run_radiate(struct cell_solver *s, const struct lw_transport *passes, uint32_t bounce) {
#pragma omp parallel for schedule(static) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (has_work(s, &s->tiles.tile[i])) lw_bounces_radiate(passes, &s->tiles.tile[i], bounce);
}

/* Light of earlier frames follows what direct light is now; along rays that new ones are about to take the place of. */
static void run_reread(struct cell_solver *s, const struct lw_transport *passes) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (has_work(s, &s->tiles.tile[i])) lw_verify_reread(passes, &s->tiles.tile[i]);
}

/* With which weight this frame's estimates of bounces enter their means. */
static void weigh_indirect(struct cell_solver *s) {
    const float most = s->has_probes ? (float)probe_history_max(s) : INFINITY;
#pragma omp parallel for schedule(static) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        if (!has_work(s, &s->tiles.tile[i])) continue;
        LW_TILES_EACH_BLOCK (&s->tiles.tile[i], block)
            if (block->due) lw_gradient_weigh_indirect(block, most, s->desc.denoise);
    }
}

/* Bounces from the second on change only now. */
static void run_arrive(struct cell_solver *s, const struct lw_transport *passes) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (has_work(s, &s->tiles.tile[i])) lw_verify_arrive(passes, &s->tiles.tile[i]);
}

static void run_gather(struct cell_solver *s, const struct lw_transport *passes, uint32_t bounce) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        if (!has_work(s, &s->tiles.tile[i])) continue;
        lw_bounces_gather(passes, &s->tiles.tile[i], bounce);
        lw_progress_step(&s->progress, 1);
    }
}

static void run_finish(struct cell_solver *s, const struct lw_transport *passes, uint64_t frame,
                       struct lw_solver_stats *stats) {
    uint32_t shown = 0;
    if (s->desc.awaited && *s->desc.awaited && s->frames > 0) lw_schedule_put_off(&s->schedule, &s->tiles);
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shown)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (tile->due) lw_estimates_finish_tile(passes, tile);
        LW_TILES_EACH_BLOCK (tile, block) {
            block->unseen |= tile->due && block->due && block->covered_count;
            if (!(block->unseen && tile->shows) && !(s->shows_all && block->covered_count && block->frames))
                continue;
            block->unseen = tile->begins = false;
            block->shown_frame = tile->solved_frame = frame;
        }
        shown += tile->solved_frame == frame;
    }
    stats->tiles_shown = shown;
    s->shows_all = false;
}

/* Blocks whose error is low enough rest until their light changes. */
static void settle_tile(const struct cell_solver *s, struct lw_solve_tile *tile) {
    const struct lw_converged rest = rest_of(s);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->due || !block->covered_count) continue;
        block->resting = lw_converged_is(&rest, block);
        block->stale = !block->resting && lw_gradient_is_stale(block, s->desc.target_error);
        block->change.woken &= !block->resting;
    }
    lw_follow_sum_woken(tile);
    lw_tiles_sum_up(tile);
}

static void settle(struct cell_solver *s, struct lw_solver_stats *stats) {
    stats->tiles = s->tiles.count;
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        stats->tiles_solved += tile->due;
        LW_TILES_EACH_BLOCK (tile, block) stats->texels_solved += block->due ? block->covered_count : 0;
        if (tile->due) settle_tile(s, tile);
        stats->tiles_converged += tile->resting;
    }
}

/* While what is remembered of the time before a movement may still show. */
static bool is_fading(const struct cell_solver *s) {
    return s->follow.moves && s->follow.frames_since_move < LW_CELL_LAYER_FADE_FRAMES;
}

static void count_tiles(const struct cell_solver *s, struct lw_solver_stats *stats) {
    stats->tiles = s->tiles.count;
    for (uint32_t i = 0; i < s->tiles.count; i++) stats->tiles_converged += s->tiles.tile[i].resting;
}

/* How many texels a frame may solve, of what has woken and in all. The first frame lights everything. Before all have been asked, what
 * has woken is solved alone. */
static struct lw_schedule_room room_in_time(const struct cell_solver *s, uint64_t asking_ns) {
    if (!(s->turn.budget_s > 0) || s->frames == 0) return (struct lw_schedule_room){UINT64_MAX, UINT64_MAX};
    const double left_ns =
        fmax(s->turn.budget_s * 1e9 - (double)asking_ns, SOLVING_SHARE * s->turn.budget_s * 1e9);
    const uint64_t texels = 1 + (uint64_t)(left_ns / fmax(s->texel_ns, 1));
    bool waits = s->turn.yields;
    for (uint32_t i = 0; i < s->tiles.count && s->turn.hasty && !waits; i++)
        waits = s->follow.moves && s->tiles.tile[i].serves && s->tiles.tile[i].unasked;
    return (struct lw_schedule_room){s->turn.yields ? 0 : texels, waits ? 0 : texels};
}

/* What a texel takes now, in wall time: a running mean over some ten frames' worth. */
static void note_texel_cost(struct cell_solver *s, const struct lw_solver_stats *stats) {
    if (!stats->texels_solved) return;
    const double ns = (double)(stats->direct_ns + stats->scatter_ns) / (double)stats->texels_solved;
    s->texel_ns = s->texel_ns > 0 ? s->texel_ns + (ns - s->texel_ns) * 0.1 : ns;
}

/* Whether the frame has anything to solve. Where it has not, the pose waits, and with it the probes' rays. */
static bool choose_tiles(struct cell_solver *s, struct lw_solver_stats *stats) {
    struct lw_schedule_count count;
    lw_schedule_choose(&s->schedule, &s->tiles, room_in_time(s, stats->change_ns), &count);
    stats->tiles_wanted = count.wanted;
    stats->tiles_feeding = count.feeding;
    return count.due > 0;
}

/* Of the tiles that are due, the blocks; of an urgent one those alone that have woken. */
static void choose_blocks(struct cell_solver *s) {
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        LW_TILES_EACH_BLOCK (tile, block)
            block->due = tile->due && !block->resting &&
                         (!tile->urgent || lw_gradient_is_urgent(&block->change) || !block->frames);
        if (tile->due) tile->solved_tick = s->schedule.tick;
    }
}

/* Estimates of the last solves, before anything moves from where it was then. */
static void recall(struct cell_solver *s, const struct lw_transport *passes, struct lw_solver_stats *stats) {
    uint64_t shadow = 0, bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shadow, bounce)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_ray_count count = {0};
        lw_verify_recall(passes, &s->tiles.tile[i], &count);
        shadow += count.shadow;
        bounce += count.bounce;
    }
    count_rays(stats, &(struct lw_ray_count){shadow, bounce});
    s->forgetful = false;
}

/* The two sides of seams and the gutters, around what a frame shows. */
static enum lw_status weld(struct cell_solver *s, uint64_t number, struct lw_error *err) {
    const struct lw_seams *seams = &s->geometry->seams;
    enum lw_status status = find_seams(s);
    if (status != LW_OK) return lw_status_fail(err, status, "seams");
    lw_seams_weld(seams, s->welds, s->forms, &s->tiles, number, s->threads);
    lw_seam_gutters_fill(&seams->gutters, &s->tiles, number, s->forms, s->threads);
    return LW_OK;
}

/* What is to be seen of the tiles that this frame shows. */
static enum lw_status show(struct cell_solver *s, uint64_t number, struct lw_solver_stats *stats,
                           struct lw_error *err) {
    const uint64_t t0 = lw_clock_ns();
    if (s->desc.denoise)
        lw_denoise_run(&s->denoise, number, s->forms, s->threads);
    else
        lw_tiles_show(&s->tiles, number, s->forms, s->threads);
    const uint64_t t1 = lw_clock_ns();
    enum lw_status status = weld(s, number, err);
    stats->denoise_ns = t1 - t0;
    stats->weld_ns = lw_clock_ns() - t1;
    return status;
}

static struct lw_transport passes_of(struct cell_solver *s) {
    return (struct lw_transport){.scene = s->desc.scene,
                                 .pose = &s->pose,
                                 .trace = s->geometry->trace,
                                 .lights = &s->lights,
                                 .drawn = parts_drawn(s) ? &s->drawn : NULL,
                                 .texels = &s->geometry->texels,
                                 .cells = &s->cells,
                                 .probes = s->has_probes ? &s->probes : NULL,
                                 .tiles = &s->tiles,
                                 .end = s->end,
                                 .direct_samples = s->desc.direct_samples,
                                 .indirect_samples = s->desc.indirect_samples,
                                 .seed = s->desc.seed,
                                 .tracing_range_m = s->desc.tracing_range_m,
                                 .target_error = s->desc.target_error};
}

static struct lw_follow_frame following_of(const struct cell_solver *s, const struct lw_transport *passes) {
    return (struct lw_follow_frame){.passes = passes,
                                    .schedule = &s->schedule,
                                    .rest = rest_of(s),
                                    .budget_s = s->turn.budget_s,
                                    .hasty = s->turn.hasty,
                                    .filtered = s->desc.denoise,
                                    .threads = s->threads};
}

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct cell_solver *s = (struct cell_solver *)solver;
    struct lw_solver_stats stats = {0};
    uint64_t t0 = lw_clock_ns();
    const struct lw_transport passes = passes_of(s);
    const unsigned moved = lw_pose_difference(pose, &s->pose, s->desc.scene);
    stats.moved = moved != 0;
    s->follow.frames_since_move++;
    if (stats.moved) {
        if (s->forgetful) recall(s, &passes, &stats);
        s->view_due |= memcmp(s->pose.object_hidden, pose->object_hidden,
                              s->desc.scene->object_count * sizeof *pose->object_hidden) != 0;
        lw_follow_move(&s->follow, &s->tiles, s->desc.scene, &s->pose, pose,
                       lw_lights_differ(&s->lights, &s->pose, pose) ||
                           (parts_drawn(s) && lw_lights_differ(&s->drawn, &s->pose, pose)));
        lw_pose_copy(&s->pose, pose, s->desc.scene);
        s->pose_due |= moved;
    }
    const bool looked_at = lw_schedule_is_looked_at(&s->schedule);
    /* What appears is lit at once, whoever looks: there is nothing without light (schedule.h). That what went was gone must be
     * known by then. */
    enum lw_status status = lw_trace_settle(s->geometry->trace, false, err);
    if (status == LW_OK && s->pose_due && (looked_at || s->view_due)) status = place(s, &stats, err);
    if (status != LW_OK) return status;
    lw_schedule_serve(&s->schedule, &s->tiles, s->has_probes);
    const struct lw_follow_frame following = following_of(s, &passes);
    struct lw_ray_count asked = {0};
    const uint64_t asked_ns = lw_clock_ns();
    lw_follow_ask(&s->follow, &following, &asked);
    stats.change_ns = lw_clock_ns() - asked_ns;
    const bool solves = choose_tiles(s, &stats), changing = lw_follow_is_changing(&s->follow);
    lw_follow_note_work(&s->follow, solves, s->schedule.ended);
    if (!solves) {
        count_rays(&stats, &asked);
        lw_follow_pass_on(&s->follow, &following);
        lw_follow_show(&s->follow, &following);
        run_finish(s, &passes, number, &stats); /* of what was solved before but not shown */
        if (stats.tiles_shown) status = show(s, number, &stats, err);
        if (status != LW_OK) return status;
        count_tiles(s, &stats);
        *out_stats = stats;
        return LW_OK;
    }
    if (s->pose_due) status = place(s, &stats, err);
    if (status != LW_OK) return status;
    /* Only now: what place() makes of new materials has been asked about already. */
    for (uint32_t bounce = 0; bounce < s->desc.bounces; bounce++)
        memset(s->tiles.radiance_change[bounce], 0, s->tiles.block_count * sizeof(struct lw_vec3));
    const uint64_t weighed = lw_clock_ns();
    choose_blocks(s);
    lw_follow_weigh(&s->follow, &following, &asked);
    count_rays(&stats, &asked);
    lw_follow_pass_on(&s->follow, &following);
    stats.change_ns += lw_clock_ns() - weighed;
    stats.pose_ns = lw_clock_ns() - t0 - stats.probe_ns - stats.change_ns;
    begin_progress(s);
    uint64_t t1 = lw_clock_ns();
    run_direct(s, &passes, &stats);
    if (s->desc.bounces) run_radiate(s, &passes, 0);
    uint64_t t2 = lw_clock_ns();
    stats.direct_ns = t2 - t1;
    if (s->desc.bounces && changing) run_reread(s, &passes);
    if (s->desc.bounces) run_trace_ends(s, &passes, &stats);
    weigh_indirect(s);
    stats.scatter_ns = lw_clock_ns() - t2;
    if (s->has_probes) {
        uint64_t t = lw_clock_ns();
        stats.rays_probe += lw_probes_gather(&s->probes, s->geometry->trace, &s->geometry->texels, s->frames,
                                             is_fading(s), s->threads);
        stats.probe_ns += lw_clock_ns() - t;
    }
    for (uint32_t bounce = 1; bounce <= s->desc.bounces; bounce++) {
        uint64_t t = lw_clock_ns();
        if (s->has_probes)
            lw_probes_project(&s->probes, bounce - 1, s->tiles.radiance[bounce - 1], probe_history_max(s),
                              s->threads);
        uint64_t projected = lw_clock_ns();
        run_gather(s, &passes, bounce);
        if (bounce < s->desc.bounces) run_radiate(s, &passes, bounce);
        stats.probe_ns += projected - t;
        stats.scatter_ns += lw_clock_ns() - projected;
    }
    if (s->desc.bounces > 1 && changing) run_arrive(s, &passes);
    if (cancelled(s)) {
        lw_progress_stop(&s->progress);
        return LW_CLOSED;
    }
    lw_follow_show(&s->follow, &following);
    run_finish(s, &passes, number, &stats);
    if (stats.tiles_shown) status = show(s, number, &stats, err);
    if (status != LW_OK) return status;
    lw_progress_finish(&s->progress);
    settle(s, &stats);
    note_texel_cost(s, &stats);
    s->frames++;
    *out_stats = stats;
    return LW_OK;
}

struct lw_tiles *lw_cell_layer_tiles(struct lw_solver *solver) {
    return &((struct cell_solver *)solver)->tiles;
}

void lw_cell_layer_set_turn(struct lw_solver *solver, const struct lw_cell_layer_turn *turn) {
    ((struct cell_solver *)solver)->turn = *turn;
}

unsigned lw_cell_layer_backlog(const struct lw_solver *solver) {
    const struct cell_solver *s = (const struct cell_solver *)solver;
    const bool hasty = s->turn.budget_s > 0 && s->turn.hasty;
    return hasty && lw_follow_is_behind(&s->follow, &s->tiles, &s->schedule) ? LW_CELL_LAYER_BACKLOG_MAX
                                                                             : s->schedule.hurry;
}

void lw_cell_layer_review(struct lw_solver *solver) {
    struct cell_solver *s = (struct cell_solver *)solver;
    const struct lw_transport passes = passes_of(s);
    const struct lw_converged rest = rest_of(s);
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        lw_estimates_judge(&passes, tile);
        LW_TILES_EACH_BLOCK (tile, block) {
            if (!block->resting || !block->covered_count) continue;
            block->resting = lw_converged_may(&rest, tile, block);
            lw_gradient_review(block, s->desc.target_error);
        }
        lw_tiles_sum_up(tile);
    }
    s->follow.still_rounds = 0;
}

static enum lw_status want(struct lw_solver *solver, const uint8_t *wanted, struct lw_error *err) {
    struct cell_solver *s = (struct cell_solver *)solver;
    enum lw_status status = lw_schedule_want(&s->schedule, wanted);
    return status == LW_OK ? LW_OK
                           : lw_status_fail(err, status, "schedule of %u texels", s->geometry->texels.count);
}

static void show_forms(struct lw_solver *solver, unsigned forms) {
    struct cell_solver *s = (struct cell_solver *)solver;
    if (!parts_drawn(s)) forms = LW_LIGHT_FORMS_FULL;
    s->shows_all |= (forms & ~s->forms) != 0;
    s->forms = forms;
    if (lw_tiles_judge_forms(&s->tiles, forms, s->threads)) lw_cell_layer_review(solver);
}

static enum lw_status set_up_denoise(struct cell_solver *s, struct lw_error *err) {
    if (s->denoise.pairs) return LW_OK;
    enum lw_status status = lw_geometry_weigh_pairs(s->geometry);
    if (status == LW_OK)
        status = lw_denoise_init(&s->denoise, &s->geometry->pairs, s->desc.atlas_map, &s->tiles, s->threads);
    return status == LW_OK ? LW_OK
                           : lw_status_fail(err, status, "denoiser of %u texels", s->geometry->texels.count);
}

/* From the sums, whatever the frames have made of what is shown; and welded again. */
static enum lw_status filter(struct lw_solver *solver, struct lw_error *err) {
    struct cell_solver *s = (struct cell_solver *)solver;
    enum lw_status status = set_up_denoise(s, err);
    if (status != LW_OK) return status;
    uint64_t last = 0;
    for (uint32_t i = 0; i < s->tiles.count; i++)
        last = s->tiles.tile[i].solved_frame > last ? s->tiles.tile[i].solved_frame : last;
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        LW_TILES_EACH_BLOCK (tile, block) block->shown_frame = last;
        tile->solved_frame = last;
    }
    lw_denoise_run(&s->denoise, last, s->forms, s->threads);
    return weld(s, last, err);
}

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *out_tile) {
    const struct cell_solver *s = (const struct cell_solver *)solver;
    const struct lw_solve_tile *tile = &s->tiles.tile[s->tiles.slot_of_id[id.v]];
    *out_tile = (struct lw_solver_tile){.covered = s->tiles.covered + tile->first,
                                        .filled = s->geometry->texels.filled + tile->first,
                                        .width = tile->width,
                                        .height = tile->height,
                                        .bounces = s->desc.bounces,
                                        .frames = tile->frames,
                                        .error = tile->covered_count ? tile->error : 0,
                                        .solved_frame = tile->solved_frame};
    for (int c = 0; c < 3; c++) {
        out_tile->direct[c] = s->tiles.direct[c] + tile->first;
        out_tile->indirect[c] = s->tiles.indirect[c] + tile->first;
        out_tile->light[c] = s->tiles.light[LW_LIGHT_FORM_FULL][c] + tile->first;
        if (s->forms & lw_light_form_bit(LW_LIGHT_FORM_SPLIT))
            out_tile->split[c] = s->tiles.light[LW_LIGHT_FORM_SPLIT][c] + tile->first;
        out_tile->albedo[c] = tile->mesh->albedo[c] + tile->local;
    }
}

/* What a frame reads of those before it, beside the tiles. */
#define PARTS_MAX (1 + LW_LIGHT_FORM_COUNT + LW_PROBES_PARTS)
static uint32_t list_parts(const struct cell_solver *s, struct remembered *remembered,
                           struct lw_checkpoint_part out_part[PARTS_MAX]) {
    uint32_t n = 0;
    out_part[n++] = (struct lw_checkpoint_part){remembered, sizeof *remembered};
    for (int f = 0; f < LW_LIGHT_FORM_COUNT; f++)
        if (s->welds[f].member_count)
            out_part[n++] =
                (struct lw_checkpoint_part){s->welds[f].correction, (size_t)s->welds[f].member_count * 3 *
                                                                        sizeof *s->welds[f].correction};
    if (s->has_probes) n += lw_probes_list_parts(&s->probes, out_part + n);
    return n;
}

static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    const struct cell_solver *s = (const struct cell_solver *)solver;
    struct remembered remembered = {s->frames, s->follow.frames_since_move, s->follow.moves, judges_split(s)};
    struct lw_checkpoint_part part[PARTS_MAX];
    const uint32_t parts = list_parts(s, &remembered, part);
    return lw_checkpoint_save(path, key, &s->tiles, part, parts, err);
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    struct cell_solver *s = (struct cell_solver *)solver;
    struct remembered remembered;
    const struct lw_converged rest = rest_of(s);
    struct lw_checkpoint_part part[PARTS_MAX];
    const uint32_t parts = list_parts(s, &remembered, part);
    enum lw_status status = lw_checkpoint_load(path, key, &s->tiles, part, parts, err);
    if (status != LW_OK) return status;
    s->frames = remembered.frames;
    lw_follow_resume(&s->follow, remembered.moves, remembered.frames_since_move);
    s->forgetful = true;
    for (int f = 0; f < LW_LIGHT_FORM_COUNT; f++) s->welds[f].fresh = true;
    if (remembered.judges_split != judges_split(s)) {
        const struct lw_transport passes = passes_of(s);
        lw_tiles_sum_variance(&s->tiles, s->threads);
        for (uint32_t i = 0; i < s->tiles.count; i++) lw_estimates_judge(&passes, &s->tiles.tile[i]);
    }
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        LW_TILES_EACH_BLOCK (tile, block) {
            block->resting = lw_converged_may(&rest, tile, block);
            block->change.moves = s->follow.moves;
        }
        lw_tiles_sum_up(tile);
    }
    radiate_all(
        s); /* which a checkpoint does not keep; those at rest are read before they are solved again */
    *out_frames = s->frames;
    return LW_OK;
}

static size_t memory_bytes(const struct lw_solver *solver) {
    const struct cell_solver *s = (const struct cell_solver *)solver;
    const size_t per_texel = lw_tiles_texel_bytes(&s->tiles) + sizeof(uint32_t) * s->desc.indirect_samples;
    return per_texel * s->tiles.texel_count + lw_seams_light_memory_bytes(&s->welds[LW_LIGHT_FORM_FULL]) +
           lw_seams_light_memory_bytes(&s->welds[LW_LIGHT_FORM_SPLIT]) +
           lw_denoise_memory_bytes(&s->denoise) + lw_schedule_memory_bytes(&s->schedule) +
           s->tiles.block_count * sizeof *s->tiles.block +
           (s->has_probes ? lw_probes_memory_bytes(&s->probes) : 0) +
           (s->geometry == &s->own_geometry ? lw_geometry_memory_bytes(s->geometry) : 0);
}

static void destroy(struct lw_solver *solver) {
    if (!solver) return;
    struct cell_solver *s = (struct cell_solver *)solver;
    if (s->geometry) lw_geometry_forget_tiles(s->geometry);
    lw_denoise_finish(&s->denoise);
    lw_probes_finish(&s->probes);
    lw_lights_finish(&s->lights);
    lw_lights_finish(&s->drawn);
    for (int f = 0; f < LW_LIGHT_FORM_COUNT; f++) lw_seams_light_finish(&s->welds[f]);
    lw_schedule_finish(&s->schedule);
    lw_tiles_finish(&s->tiles);
    lw_geometry_finish(&s->own_geometry);
    lw_pose_finish(&s->pose);
    lw_follow_finish(&s->follow);
    free(s->end);
    free(s);
}

static const struct lw_solver_ops ops = {.name = "cells",
                                         .frame = frame,
                                         .want = want,
                                         .show = show_forms,
                                         .filter = filter,
                                         .read_tile = read_tile,
                                         .save = save,
                                         .load = load,
                                         .memory_bytes = memory_bytes,
                                         .destroy = destroy};

static enum lw_status place_probes(struct cell_solver *s, struct lw_vec3 lo, struct lw_vec3 hi) {
    enum lw_status status =
        lw_probes_init(&s->probes, &(struct lw_probes_desc){.scene = s->desc.scene,
                                                            .minimum_ws = lo,
                                                            .maximum_ws = hi,
                                                            .spacing_m = s->desc.probe_spacing_m,
                                                            .bounces = s->desc.bounces,
                                                            .seed = s->desc.seed,
                                                            .form = s->desc.probe_form,
                                                            .projection = s->desc.probe_projection});
    if (status != LW_OK) return status;
    lw_probes_place(&s->probes, &s->pose, s->geometry->trace, s->threads);
    lw_log(LW_LOG_INFO, "%u probes, %s, %.2g m apart; %u of them dead inside objects", s->probes.count,
           s->probes.form->name, (double)s->probes.grid.size_m.x, s->probes.count - s->probes.alive);
    return LW_OK;
}

static enum lw_status init_lights(struct cell_solver *s) {
    const struct lw_client_lights *client = s->desc.client_lights;
    if (!parts_drawn(s)) return lw_lights_init(&s->lights, s->desc.scene, &s->pose);
    const struct lw_lights_part served = lw_client_lights_part(client, false),
                                drawn = lw_client_lights_part(client, true);
    enum lw_status status = lw_lights_init_part(&s->lights, s->desc.scene, &s->pose, &served);
    return status == LW_OK ? lw_lights_init_part(&s->drawn, s->desc.scene, &s->pose, &drawn) : status;
}

static enum lw_status build(struct cell_solver *s, const struct lw_pose *pose, struct lw_error *err) {
    const struct lw_scene *scene = s->desc.scene;
    enum lw_status status = lw_pose_init(&s->pose, scene);
    if (status != LW_OK) return lw_status_fail(err, status, "poses");
    lw_pose_copy(&s->pose, pose, scene);
    if (!s->geometry) {
        s->geometry = &s->own_geometry;
        if ((status = lw_geometry_init(s->geometry, scene, &s->pose, s->threads, err)) != LW_OK)
            return status;
    }
    const struct lw_texels *texels = &s->geometry->texels;
    struct lw_vec3 lo = {0}, hi = {0};
    lw_pose_bounds(&s->pose, scene, &lo, &hi);
    lw_cells_init(&s->cells, lo, hi, s->desc.cell_size_m);
    if ((status = lw_tiles_init(&s->tiles, scene, s->desc.atlas_map, texels, s->desc.bounces, s->threads)) !=
        LW_OK)
        return lw_status_fail(err, status, "%u texels", texels->count);
    if (parts_drawn(s) && (status = lw_tiles_part_drawn(&s->tiles)) != LW_OK)
        return lw_status_fail(err, status, "%u texels", texels->count);
    if ((status = find_seams(s)) != LW_OK)
        return lw_status_fail(err, status, "seams of %u texels", texels->count);
    if ((status = init_lights(s)) != LW_OK) return lw_status_fail(err, status, "lights");
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->pose);
    lw_schedule_init(&s->schedule, s->desc.atlas_map->tile_count, s->desc.indirect_samples);

    s->has_probes = isfinite(s->desc.tracing_range_m) && s->desc.bounces > 0;
    if (s->has_probes && (status = place_probes(s, lo, hi)) != LW_OK)
        return lw_status_fail(err, status, "probes");
    if (s->desc.denoise && (status = set_up_denoise(s, err)) != LW_OK) return status;
    s->end = calloc((size_t)texels->count * s->desc.indirect_samples + 1, sizeof *s->end);
    if (!s->end || lw_follow_init(&s->follow, s->tiles.count) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "%u texels", texels->count);
    return LW_OK;
}

enum lw_status lw_cell_layer_create(struct lw_geometry *geometry, const struct lw_solver_desc *desc,
                                    const struct lw_pose *pose, struct lw_solver **out_solver,
                                    struct lw_error *err) {
    struct cell_solver *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    s->base.ops = &ops;
    s->geometry = geometry;
    s->desc = *desc;
    s->turn = (struct lw_cell_layer_turn){.budget_s = desc->frame_budget_s, .hasty = true};
    s->forms = LW_LIGHT_FORMS_FULL;
    s->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    if (!(s->desc.tracing_range_m > 0)) s->desc.tracing_range_m = INFINITY;
    enum lw_status status = build(s, pose, err);
    if (status != LW_OK) {
        destroy(&s->base);
        return status;
    }
    *out_solver = &s->base;
    return LW_OK;
}
