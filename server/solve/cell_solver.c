#include "server/solve/cell_solver.h"

#include "common/clock.h"
#include "common/log.h"
#include "common/progress.h"
#include "server/solve/change_order.h"
#include "server/solve/checkpoint.h"
#include "server/solve/correction.h"
#include "server/solve/denoise.h"
#include "server/solve/passes.h"
#include "server/solve/schedule.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* Of a frame's budget, what goes into asking what has changed once some has been found, and at most before; what is left for solving at
 * least. */
#define ASKING_SHARE  0.5
#define SEARCH_SHARE  1.0
#define SOLVING_SHARE 0.5
/* While lights keep moving: what goes into correcting what they light. */
#define SWEEP_SHARE 0.5

struct cell_solver {
    struct lw_solver base;
    struct lw_solver_desc desc;
    int threads;
    struct lw_geometry *geometry;
    struct lw_geometry own_geometry; /* unless it is shared */
    struct lw_cells cells;
    struct lw_tiles tiles;
    struct lw_seams_light welds;
    uint32_t seams_found; /* of the geometry: those that the welds are of */
    struct lw_lights lights;
    struct lw_probes probes;
    bool has_probes;
    struct lw_denoise denoise; /* empty unless the desc asks for it */
    uint32_t *end;
    struct lw_pose pose;          /* the last one given */
    struct lw_progress *progress; /* of the first frame, which may be long; else NULL */
    struct lw_schedule schedule;
    uint32_t frames, frames_since_move;
    uint32_t moves;       /* frames in which something had moved */
    uint32_t began;       /* of these, the last before which nothing had for a while */
    bool shone;           /* what last began to move shines, or was light itself */
    uint32_t light_moves; /* `moves` when the layer's own light last did */
    struct {
        uint32_t next;  /* tile */
        uint32_t moves; /* `light_moves` as it began */
        bool ended;     /* in this frame */
    } sweep;
    uint32_t passes;           /* frames that are yet to correct all blocks along the rays that there are */
    bool solved_urgent;        /* blocks that had woken were, since the last of these began */
    uint32_t corrected;        /* tiles, in the last frame */
    uint32_t still_rounds;     /* since something was solved */
    uint32_t unchanged_rounds; /* since any light that serves was known to be out of date */
    double texel_ns;           /* wall time that one takes, in the mean of late */
    double budget_s;           /* of this frame; 0: none */
    bool hasty;                /* what has just begun comes before all else */
    bool yields;               /* this frame solves nothing, and only asks what has changed */
    bool forgetful; /* the tiles' estimates are not those of their last solve: a checkpoint keeps none */
    unsigned
        pose_due;  /* what of the pose has changed since rays, lights and tiles were last placed: LW_POSE_* */
    bool view_due; /* likewise: which objects are hidden */
    struct lw_change_order order;
};

/* Of the above, what a checkpoint keeps. */
struct remembered {
    uint32_t frames, frames_since_move, moves;
};

/* Seams that hold an object which has begun to move may do so a little longer where frames have a time to keep. */
static enum lw_status find_seams(struct cell_solver *s) {
    enum lw_status status = lw_geometry_find_seams(s->geometry, &s->tiles, s->desc.frame_budget_s > 0);
    if (status != LW_OK || s->seams_found == s->geometry->seams_found) return status;
    lw_seams_light_finish(&s->welds);
    s->seams_found = s->geometry->seams_found;
    return lw_seams_light_init(&s->welds, &s->geometry->seams);
}

/* What all tiles send out, from their sums. */
static void radiate_all(struct cell_solver *s) {
    const struct lw_passes passes = {.tiles = &s->tiles};
    for (uint32_t bounce = 0; bounce < s->desc.bounces; bounce++) {
#pragma omp parallel for schedule(static) num_threads(s->threads)
        for (uint32_t i = 0; i < s->tiles.count; i++) lw_passes_radiate(&passes, &s->tiles.tile[i], bounce);
    }
}

/* Takes over s->pose. */
static enum lw_status place(struct cell_solver *s, struct lw_solver_stats *stats, struct lw_error *err) {
    enum lw_status status = lw_geometry_set_pose(s->geometry, &s->pose, s->desc.frame_budget_s > 0, err);
    if (status != LW_OK) return status;
    if (s->pose_due & LW_POSE_DYNAMIC) lw_tiles_recount(&s->tiles, s->threads);
    if (s->pose_due & (LW_POSE_MATERIALS | LW_POSE_SKY))
        status = lw_lights_set_materials(&s->lights, &s->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "taking over what has changed");
    if (s->pose_due & LW_POSE_MATERIALS) radiate_all(s);
    lw_lights_set_pose(&s->lights, &s->pose);
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

/* Frames have a time to keep. */
static bool is_hurried(const struct cell_solver *s) { return s->budget_s > 0; }

static bool cancelled(const struct cell_solver *s) { return s->desc.cancel && *s->desc.cancel; }

static bool has_work(const struct cell_solver *s, const struct lw_solve_tile *tile) {
    return tile->due && !cancelled(s);
}

/* The frames for which probes may remember, that many frames after a movement. */
static uint32_t probe_history_max(const struct cell_solver *s) {
    return s->moves ? LW_CELL_SOLVER_HISTORY_PROBES - 1 + s->frames_since_move / 2 : UINT32_MAX;
}

static void count_rays(struct lw_solver_stats *stats, uint64_t shadow, uint64_t bounce) {
    stats->rays_shadow += shadow;
    stats->rays_bounce += bounce;
}

/* ---- what has changed (change.h) ---- */

/* So many rounds after the last light that was known to be out of date, what it lights has followed. */
#define CHANGING_ROUNDS 2u

static bool is_changing(const struct cell_solver *s) {
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (s->tiles.tile[i].serves && s->tiles.tile[i].stale) return true;
    return false;
}

/* Whether the layer's light itself is another, or comes from elsewhere. */
static bool lights_differ(const struct cell_solver *s, const struct lw_pose *now) {
    const struct lw_scene *scene = s->desc.scene;
    const struct lw_lights *lights = &s->lights;
    if (lw_pose_difference(now, &s->pose, scene) & (LW_POSE_LIGHTS | LW_POSE_SKY)) return true;
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (memcmp(now->material[m].emission, s->pose.material[m].emission, sizeof now->material->emission))
            return true;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (!lw_pose_object_differs(now, &s->pose, o)) continue;
        for (uint32_t e = lights->first_emitter[o]; e < lights->first_emitter[o + 1]; e++)
            if (lights->luminance[e] > 0) return true;
    }
    return false;
}

/* Whether something that is looked at is yet to be asked about the last movement. */
static bool is_unasked(const struct cell_solver *s) {
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        const struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (tile->unasked && tile->serves && lw_schedule_looks_at(&s->schedule, tile)) return true;
    }
    return false;
}

/* Direct light has changed everywhere: all packets are asked about it, so that it need not be solved. */
static bool asks_all(const struct cell_solver *s) { return is_hurried(s) && s->hasty && s->shone; }

/* For how long a frame may ask those that have not been asked about a movement: there should be time to solve what is found. */
static bool is_time_over(const struct cell_solver *s, uint64_t began_ns, bool found) {
    const double budgets = found && !asks_all(s) ? ASKING_SHARE : SEARCH_SHARE;
    return is_hurried(s) && (double)(lw_clock_ns() - began_ns) > budgets * s->budget_s * 1e9;
}

static bool settled(const struct cell_solver *s, const struct lw_solve_block *block) {
    return (block->frames >= LW_CELL_SOLVER_FRAMES_MIN && block->error <= s->desc.target_error &&
            !lw_change_is_stale(block, s->desc.target_error)) ||
           (s->desc.frames_max && block->frames >= s->desc.frames_max);
}

/* Of a block that the frame has not solved. */
static bool may_rest(const struct cell_solver *s, const struct lw_solve_tile *tile,
                     const struct lw_solve_block *block) {
    return block->covered_count == 0 || tile->hidden || settled(s, block);
}

/* A block at rest whose light has been corrected rests on with so many times its target error: less of the light, and it is noisier. */
#define RESTS_ON 1.5f

/* What the blocks of a tile that have woken are together. */
static void note_woken(struct lw_solve_tile *tile) {
    double square = 0;
    tile->woken_count = 0;
    tile->woken = false;
    LW_TILES_EACH_BLOCK (tile, block) {
        const double share = fmin(1, (double)block->change.strength);
        tile->woken |= block->change.woken;
        if (!lw_change_is_urgent(&block->change)) continue;
        square += share * share * block->covered_count;
        tile->woken_count += block->covered_count;
    }
    tile->urgency = tile->woken_count ? (float)(square / tile->woken_count) : 0;
}

/* After their answers: indirect light of a tile is corrected, and what has been is judged anew. */
static void take_over(struct cell_solver *s, const struct lw_passes *passes, struct lw_solve_tile *tile) {
    tile->corrected |= lw_correction_indirect(&s->tiles, tile, s->desc.target_error, true);
    if (tile->corrected) lw_passes_judge(passes, tile);
}

/* Wakes blocks at rest whose light is no longer what it was; where something begins to move, asks those that are awake too. Who
 * is not asked for want of time is in the next frame. */
static void find_change(struct cell_solver *s, const struct lw_passes *passes,
                        struct lw_solver_stats *stats) {
    const uint64_t began_ns = lw_clock_ns();
    uint64_t shadow = 0, bounce = 0;
    bool found = false, begun = false, direct = false;
    const bool active =
        s->still_rounds <= LW_PACKETS_MAX; /* until all have been asked about the last solve */
    const bool hurried = is_hurried(s), spreads = hurried && s->hasty && s->passes > 0 && !is_unasked(s);
    lw_change_order_sort(&s->order, &s->tiles, &s->schedule, hurried);
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shadow, bounce) reduction(|| : direct)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[s->order.turn[i].tile];
        struct lw_passes_count count = {0};
        bool asked = false, more = false;
        if (!tile->serves) continue;
        if (tile->unasked && is_time_over(s, began_ns, __atomic_load_n(&found, __ATOMIC_RELAXED)) &&
            __atomic_exchange_n(&begun, true, __ATOMIC_RELAXED))
            continue; /* but one is asked in any case */
        tile->unasked = false;
        LW_TILES_EACH_BLOCK (tile, block) {
            asked |= lw_change_choose(block, s->moves, s->began, s->schedule.tick, s->schedule.ended, active,
                                      spreads, asks_all(s));
        }
        if (!asked) continue;
        tile->corrected = lw_passes_compare(passes, tile, &count);
        direct |= tile->corrected;
        LW_TILES_EACH_BLOCK (tile, block) {
            more |= lw_change_choose_more(block, s->desc.target_error, hurried);
        }
        if (more) tile->corrected |= lw_passes_compare(passes, tile, &count);
        take_over(s, passes, tile);
        LW_TILES_EACH_BLOCK (tile, block) {
            if (!block->covered_count) continue;
            lw_change_wake(block, s->desc.target_error, hurried);
            if (tile->corrected && block->error > RESTS_ON * s->desc.target_error)
                block->resting = block->resting && may_rest(s, tile, block);
        }
        note_woken(tile);
        if (tile->woken) __atomic_store_n(&found, true, __ATOMIC_RELAXED);
        lw_tiles_sum_up(tile);
        shadow += count.shadow;
        bounce += count.bounce;
    }
    count_rays(stats, shadow, bounce);
    /* As many as there are bounces, once direct light has changed, and again once nothing urgent is left to solve. */
    s->solved_urgent |= s->schedule.urgent > 0;
    if (direct || (s->solved_urgent && !s->passes && !s->schedule.hurry)) {
        s->passes = s->desc.bounces;
        s->solved_urgent = false;
    } else if (spreads) {
        s->passes--;
    }
}

/* Corrects all light of a tile: direct light by new shadow rays, indirect light along the rays that there are. */
static void correct_tile(struct cell_solver *s, const struct lw_passes *passes, struct lw_solve_tile *tile,
                         struct lw_passes_count *count) {
    bool asked = false;
    LW_TILES_EACH_BLOCK (tile, block) asked |= lw_change_choose_all(block, s->moves);
    if (!asked) return;
    tile->corrected |= lw_passes_compare(passes, tile, count);
    take_over(s, passes, tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (block->resting && block->covered_count) lw_change_wake(block, s->desc.target_error, true);
        block->change.compare = block->change.direct = 0;
    }
    note_woken(tile);
    lw_tiles_sum_up(tile);
}

/* While lights keep moving, a round is too long to wait for: a share of each frame goes round what is looked at, and corrects it. What
 * that comes to is shown at its end. It goes on until all has been corrected since the last movement. */
static void sweep(struct cell_solver *s, const struct lw_passes *passes, struct lw_solver_stats *stats) {
    const uint64_t began_ns = lw_clock_ns(),
                   until_ns = began_ns + (uint64_t)(SWEEP_SHARE * s->budget_s * 1e9);
    uint64_t shadow = 0, bounce = 0;
    s->sweep.ended = false;
    if (!is_hurried(s) || s->hasty) s->sweep.moves = s->light_moves; /* all are asked at once, or solved */
    if (s->sweep.next == 0 && s->sweep.moves == s->light_moves) return;
    if (s->sweep.next == 0) s->sweep.moves = s->light_moves;
    uint32_t next = s->sweep.next;
#pragma omp parallel num_threads(s->threads) reduction(+ : shadow, bounce)
    for (;;) {
        const uint32_t i = __atomic_fetch_add(&next, 1, __ATOMIC_RELAXED);
        struct lw_passes_count count = {0};
        if (i >= s->tiles.count) break;
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (!tile->serves || !lw_schedule_looks_at(&s->schedule, tile)) continue;
        correct_tile(s, passes, tile, &count);
        shadow += count.shadow;
        bounce += count.bounce;
        if (lw_clock_ns() > until_ns) break;
    }
    s->sweep.ended = next >= s->tiles.count;
    s->sweep.next = s->sweep.ended ? 0 : next;
    count_rays(stats, shadow, bounce);
}

/* What bounces off tiles whose light has been corrected; returns how many those are. */
static uint32_t pass_on(struct cell_solver *s, const struct lw_passes *passes) {
    uint32_t count = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : count)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        const struct lw_solve_tile *tile = &s->tiles.tile[i];
        count += tile->corrected;
        for (uint32_t bounce = 0; tile->corrected && bounce < s->desc.bounces; bounce++)
            lw_passes_radiate(passes, tile, bounce);
    }
    return count;
}

/* Blocks that are due: what this frame begins with. */
static void weigh_direct(struct cell_solver *s, const struct lw_passes *passes,
                         struct lw_solver_stats *stats) {
    uint64_t shadow = 0, bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shadow, bounce)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        struct lw_passes_count count = {0};
        bool asked = false;
        LW_TILES_EACH_BLOCK (tile, block) {
            block->due = tile->due && !block->resting &&
                         (!tile->urgent || lw_change_is_urgent(&block->change) || !block->frames);
            if (block->due && s->moves) asked |= lw_change_choose_due(block, s->moves);
        }
        if (asked) {
            (void)lw_passes_compare(passes, tile, &count);
            (void)lw_correction_indirect(&s->tiles, tile, s->desc.target_error, true);
        }
        LW_TILES_EACH_BLOCK (tile, block) {
            if (block->due)
                lw_change_weigh_direct(block, s->moves, s->desc.denoise, is_hurried(s) && s->hasty);
        }
        if (tile->due) tile->solved_tick = s->schedule.tick;
        shadow += count.shadow;
        bounce += count.bounce;
    }
    count_rays(stats, shadow, bounce);
}

/* ---- the passes ---- */

static void run_direct(struct cell_solver *s, const struct lw_passes *passes, struct lw_solver_stats *stats) {
    uint64_t shadow = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shadow)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (!has_work(s, tile)) continue;
        struct lw_passes_count count = {0};
        lw_passes_direct(passes, tile, &count);
        shadow += count.shadow;
        if (s->progress) lw_progress_step(s->progress, 1);
    }
    stats->rays_shadow += shadow;
}

static void run_trace_ends(struct cell_solver *s, const struct lw_passes *passes,
                           struct lw_solver_stats *stats) {
    uint64_t bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : bounce)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        if (!has_work(s, &s->tiles.tile[i])) continue;
        struct lw_passes_count count = {0};
        lw_passes_trace_ends(passes, &s->tiles.tile[i], &count);
        lw_schedule_note_ends(&s->schedule, &s->tiles, &s->tiles.tile[i], s->end);
        bounce += count.bounce;
        if (s->progress) lw_progress_step(s->progress, 1);
    }
    stats->rays_bounce += bounce;
}

static void run_radiate(struct cell_solver *s, const struct lw_passes *passes, uint32_t bounce) {
#pragma omp parallel for schedule(static) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (has_work(s, &s->tiles.tile[i])) lw_passes_radiate(passes, &s->tiles.tile[i], bounce);
}

/* Light of earlier frames follows what direct light is now; along rays that new ones are about to take the place of. */
static void run_reread(struct cell_solver *s, const struct lw_passes *passes) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (has_work(s, &s->tiles.tile[i])) lw_passes_reread(passes, &s->tiles.tile[i]);
}

/* With which weight this frame's estimates of bounces enter their means. */
static void weigh_indirect(struct cell_solver *s) {
    const float most = s->has_probes ? (float)probe_history_max(s) : INFINITY;
#pragma omp parallel for schedule(static) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        if (!has_work(s, &s->tiles.tile[i])) continue;
        LW_TILES_EACH_BLOCK (&s->tiles.tile[i], block)
            if (block->due) lw_change_weigh_indirect(block, most, s->desc.denoise);
    }
}

/* Bounces from the second on change only now. */
static void run_arrive(struct cell_solver *s, const struct lw_passes *passes) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (has_work(s, &s->tiles.tile[i])) lw_passes_arrive(passes, &s->tiles.tile[i]);
}

static void run_gather(struct cell_solver *s, const struct lw_passes *passes, uint32_t bounce) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (has_work(s, &s->tiles.tile[i])) lw_passes_gather(passes, &s->tiles.tile[i], bounce);
}

/* Where something has just begun to move, what has been corrected is to be seen at once; where it goes on, at the end of a sweep. */
static void show_corrections(struct cell_solver *s) {
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        const bool is_to_be_seen = s->sweep.ended || (tile->corrected && is_hurried(s) && s->hasty);
        bool unseen = false;
        LW_TILES_EACH_BLOCK (tile, block) unseen |= is_to_be_seen && block->unseen;
        tile->shows |= unseen && lw_schedule_looks_at(&s->schedule, tile);
        tile->corrected = false;
    }
}

static void run_finish(struct cell_solver *s, const struct lw_passes *passes, uint64_t frame,
                       struct lw_solver_stats *stats) {
    uint32_t shown = 0;
    show_corrections(s);
    if (s->desc.awaited && *s->desc.awaited && s->frames > 0) lw_schedule_put_off(&s->schedule, &s->tiles);
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shown)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (tile->due) lw_passes_finish_tile(passes, tile);
        LW_TILES_EACH_BLOCK (tile, block) {
            block->unseen |= tile->due && block->due && block->covered_count;
            if (!block->unseen || !tile->shows) continue;
            block->unseen = tile->begins = false;
            block->shown_frame = tile->solved_frame = frame;
        }
        shown += tile->solved_frame == frame;
    }
    stats->tiles_shown = shown;
}

/* Blocks whose error is low enough rest until their light changes. */
static void settle_tile(const struct cell_solver *s, struct lw_solve_tile *tile) {
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->due || !block->covered_count) continue;
        block->resting = settled(s, block);
        block->stale = !block->resting && lw_change_is_stale(block, s->desc.target_error);
        block->change.woken &= !block->resting;
    }
    note_woken(tile);
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
    return s->moves && s->frames_since_move < LW_CELL_SOLVER_FADE_FRAMES;
}

static void count_tiles(const struct cell_solver *s, struct lw_solver_stats *stats) {
    stats->tiles = s->tiles.count;
    for (uint32_t i = 0; i < s->tiles.count; i++) stats->tiles_converged += s->tiles.tile[i].resting;
}

/* How many texels a frame may solve, of what has woken and in all. The first frame lights everything. Before all have been asked, what
 * has woken is solved alone. */
static struct lw_schedule_room room_in_time(const struct cell_solver *s, uint64_t asking_ns) {
    if (!(s->budget_s > 0) || s->frames == 0) return (struct lw_schedule_room){UINT64_MAX, UINT64_MAX};
    const double left_ns = fmax(s->budget_s * 1e9 - (double)asking_ns, SOLVING_SHARE * s->budget_s * 1e9);
    const uint64_t texels = 1 + (uint64_t)(left_ns / fmax(s->texel_ns, 1));
    bool waits = s->yields;
    for (uint32_t i = 0; i < s->tiles.count && s->hasty && !waits; i++)
        waits = s->moves && s->tiles.tile[i].serves && s->tiles.tile[i].unasked;
    return (struct lw_schedule_room){s->yields ? 0 : texels, waits ? 0 : texels};
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

/* Estimates of the last solves, before anything moves from where it was then. */
static void recall(struct cell_solver *s, const struct lw_passes *passes, struct lw_solver_stats *stats) {
    uint64_t shadow = 0, bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shadow, bounce)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_passes_count count = {0};
        lw_passes_recall(passes, &s->tiles.tile[i], &count);
        shadow += count.shadow;
        bounce += count.bounce;
    }
    count_rays(stats, shadow, bounce);
    s->forgetful = false;
}

/* The two sides of seams and the gutters, around what a frame shows. */
static enum lw_status weld(struct cell_solver *s, uint64_t number, struct lw_error *err) {
    const struct lw_seams *seams = &s->geometry->seams;
    enum lw_status status = find_seams(s);
    if (status != LW_OK) return lw_status_fail(err, status, "seams");
    lw_seams_weld(seams, &s->welds, &s->tiles, number, s->threads);
    lw_seam_gutters_fill(&seams->gutters, &s->tiles, number, s->threads);
    return LW_OK;
}

/* What is to be seen of the tiles that this frame shows. */
static enum lw_status show(struct cell_solver *s, uint64_t number, struct lw_solver_stats *stats,
                           struct lw_error *err) {
    const uint64_t t0 = lw_clock_ns();
    if (s->desc.denoise)
        lw_denoise_run(&s->denoise, number, s->threads);
    else
        lw_tiles_show(&s->tiles, number, s->threads);
    const uint64_t t1 = lw_clock_ns();
    enum lw_status status = weld(s, number, err);
    stats->denoise_ns = t1 - t0;
    stats->weld_ns = lw_clock_ns() - t1;
    return status;
}

static struct lw_passes passes_of(struct cell_solver *s) {
    return (struct lw_passes){.scene = s->desc.scene,
                              .pose = &s->pose,
                              .trace = s->geometry->trace,
                              .lights = &s->lights,
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

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct cell_solver *s = (struct cell_solver *)solver;
    struct lw_solver_stats stats = {0};
    uint64_t t0 = lw_clock_ns();
    const struct lw_passes passes = passes_of(s);
    const unsigned moved = lw_pose_difference(pose, &s->pose, s->desc.scene);
    stats.moved = moved != 0;
    s->frames_since_move++;
    if (stats.moved) {
        if (s->forgetful) recall(s, &passes, &stats);
        s->view_due |= memcmp(s->pose.object_hidden, pose->object_hidden,
                              s->desc.scene->object_count * sizeof *pose->object_hidden) != 0;
        lw_change_order_note(&s->order, &s->tiles, s->desc.scene, &s->pose, pose);
        const bool shines = lights_differ(s, pose);
        lw_pose_copy(&s->pose, pose, s->desc.scene);
        s->pose_due |= moved;
        s->moves++;
        if (shines) s->light_moves = s->moves;
        if (s->frames_since_move > LW_CELL_SOLVER_STILL_FRAMES) {
            s->began = s->moves;
            s->shone = shines;
        }
        s->frames_since_move = 0;
    }
    const bool looked_at = lw_schedule_is_looked_at(&s->schedule);
    /* What appears is lit at once, whoever looks: there is nothing without light (schedule.h). That what went was gone must be
     * known by then. */
    enum lw_status status = lw_trace_settle(s->geometry->trace, false, err);
    if (status == LW_OK && s->pose_due && (looked_at || s->view_due)) status = place(s, &stats, err);
    if (status != LW_OK) return status;
    lw_schedule_serve(&s->schedule, &s->tiles, s->has_probes);
    const uint64_t asked = lw_clock_ns();
    if (s->moves && looked_at) {
        find_change(s, &passes, &stats);
        sweep(s, &passes, &stats);
    }
    stats.change_ns = lw_clock_ns() - asked;
    s->unchanged_rounds = is_changing(s) || s->corrected ? 0 : s->unchanged_rounds + s->schedule.ended;
    const bool solves = choose_tiles(s, &stats),
               changing = s->moves && s->unchanged_rounds <= CHANGING_ROUNDS;
    s->still_rounds = solves || s->corrected ? 0 : s->still_rounds + s->schedule.ended;
    if (!solves) {
        s->corrected = pass_on(s, &passes);
        run_finish(s, &passes, number, &stats); /* of what was solved before but not shown */
        if (stats.tiles_shown) status = show(s, number, &stats, err);
        if (status != LW_OK) return status;
        count_tiles(s, &stats);
        *out_stats = stats;
        return LW_OK;
    }
    if (s->pose_due) status = place(s, &stats, err);
    if (status != LW_OK) return status;
    /* Only now: what place() makes of new materials, find_change() has found already. */
    for (uint32_t bounce = 0; bounce < s->desc.bounces; bounce++)
        memset(s->tiles.radiance_change[bounce], 0, s->tiles.block_count * sizeof(struct lw_vec3));
    const uint64_t weighed = lw_clock_ns();
    weigh_direct(s, &passes, &stats);
    s->corrected = pass_on(s, &passes);
    stats.change_ns += lw_clock_ns() - weighed;
    stats.pose_ns = lw_clock_ns() - t0 - stats.probe_ns - stats.change_ns;
    struct lw_progress progress;
    if (s->frames == 0) {
        lw_progress_init(&progress, "lighting the first frame", s->tiles.count * (s->desc.bounces ? 2u : 1u));
        s->progress = &progress;
    }
    uint64_t t1 = lw_clock_ns();
    run_direct(s, &passes, &stats);
    if (s->desc.bounces) run_radiate(s, &passes, 0);
    uint64_t t2 = lw_clock_ns();
    stats.direct_ns = t2 - t1;
    if (s->desc.bounces && changing) run_reread(s, &passes);
    if (s->desc.bounces) run_trace_ends(s, &passes, &stats);
    weigh_indirect(s);
    stats.scatter_ns = lw_clock_ns() - t2;
    if (s->progress) lw_progress_finish(s->progress);
    s->progress = NULL;
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
    if (cancelled(s)) return LW_CLOSED;
    run_finish(s, &passes, number, &stats);
    if (stats.tiles_shown) status = show(s, number, &stats, err);
    if (status != LW_OK) return status;
    settle(s, &stats);
    note_texel_cost(s, &stats);
    s->frames++;
    *out_stats = stats;
    return LW_OK;
}

struct lw_tiles *lw_cell_solver_tiles(struct lw_solver *solver) {
    return &((struct cell_solver *)solver)->tiles;
}

void lw_cell_solver_give(struct lw_solver *solver, double budget_s, bool yields, bool hasty) {
    struct cell_solver *s = (struct cell_solver *)solver;
    s->budget_s = budget_s;
    s->yields = yields;
    s->hasty = hasty;
}

unsigned lw_cell_solver_hurry(const struct lw_solver *solver) {
    const struct cell_solver *s = (const struct cell_solver *)solver;
    return asks_all(s) && is_unasked(s) ? LW_CELL_SOLVER_HURRY_MOST : s->schedule.hurry;
}

void lw_cell_solver_review(struct lw_solver *solver) {
    struct cell_solver *s = (struct cell_solver *)solver;
    const struct lw_passes passes = passes_of(s);
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        lw_passes_judge(&passes, tile);
        LW_TILES_EACH_BLOCK (tile, block) {
            if (!block->resting || !block->covered_count) continue;
            block->resting = may_rest(s, tile, block);
            lw_change_review(block, s->desc.target_error);
        }
        lw_tiles_sum_up(tile);
    }
    s->still_rounds = 0;
}

static enum lw_status want(struct lw_solver *solver, const uint8_t *wanted, struct lw_error *err) {
    struct cell_solver *s = (struct cell_solver *)solver;
    enum lw_status status = lw_schedule_want(&s->schedule, wanted);
    return status == LW_OK ? LW_OK
                           : lw_status_fail(err, status, "schedule of %u texels", s->geometry->texels.count);
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
    lw_denoise_run(&s->denoise, last, s->threads);
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
        out_tile->light[c] = s->tiles.light[c] + tile->first;
        out_tile->albedo[c] = tile->mesh->albedo[c] + tile->local;
    }
}

/* What a frame reads of those before it, beside the tiles. */
#define PARTS_MAX (2 + LW_PROBES_PARTS)
static uint32_t list_parts(const struct cell_solver *s, struct remembered *remembered,
                           struct lw_checkpoint_part out_part[PARTS_MAX]) {
    uint32_t n = 0;
    out_part[n++] = (struct lw_checkpoint_part){remembered, sizeof *remembered};
    if (s->welds.member_count)
        out_part[n++] = (struct lw_checkpoint_part){s->welds.correction, (size_t)s->welds.member_count * 3 *
                                                                             sizeof *s->welds.correction};
    if (s->has_probes) n += lw_probes_list_parts(&s->probes, out_part + n);
    return n;
}

static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    const struct cell_solver *s = (const struct cell_solver *)solver;
    struct remembered remembered = {s->frames, s->frames_since_move, s->moves};
    struct lw_checkpoint_part part[PARTS_MAX];
    const uint32_t parts = list_parts(s, &remembered, part);
    return lw_checkpoint_save(path, key, &s->tiles, part, parts, err);
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    struct cell_solver *s = (struct cell_solver *)solver;
    struct remembered remembered;
    struct lw_checkpoint_part part[PARTS_MAX];
    const uint32_t parts = list_parts(s, &remembered, part);
    enum lw_status status = lw_checkpoint_load(path, key, &s->tiles, part, parts, err);
    if (status != LW_OK) return status;
    s->frames = remembered.frames;
    s->frames_since_move = remembered.frames_since_move;
    s->moves = remembered.moves;
    s->forgetful = true;
    s->unchanged_rounds = CHANGING_ROUNDS + 1;
    s->welds.fresh = true;
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        LW_TILES_EACH_BLOCK (tile, block) {
            block->resting = may_rest(s, tile, block);
            block->change.moves = s->moves;
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
    const size_t per_texel = sizeof(float) * (3 + 3 + 3 + (3 + 4) * (size_t)s->desc.bounces + 8) +
                             sizeof(uint32_t) + sizeof(uint32_t) * s->desc.indirect_samples;
    return per_texel * s->tiles.texel_count + lw_seams_light_memory_bytes(&s->welds) +
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
    lw_seams_light_finish(&s->welds);
    lw_schedule_finish(&s->schedule);
    lw_tiles_finish(&s->tiles);
    lw_geometry_finish(&s->own_geometry);
    lw_pose_finish(&s->pose);
    lw_change_order_finish(&s->order);
    free(s->end);
    free(s);
}

static const struct lw_solver_ops ops = {.name = "cells",
                                         .frame = frame,
                                         .want = want,
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
    if ((status = find_seams(s)) != LW_OK)
        return lw_status_fail(err, status, "seams of %u texels", texels->count);
    if ((status = lw_lights_init(&s->lights, scene, &s->pose)) != LW_OK)
        return lw_status_fail(err, status, "lights");
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->pose);
    lw_schedule_init(&s->schedule, s->desc.atlas_map->tile_count, s->desc.indirect_samples);

    s->has_probes = isfinite(s->desc.tracing_range_m) && s->desc.bounces > 0;
    if (s->has_probes && (status = place_probes(s, lo, hi)) != LW_OK)
        return lw_status_fail(err, status, "probes");
    if (s->desc.denoise && (status = set_up_denoise(s, err)) != LW_OK) return status;
    s->end = calloc((size_t)texels->count * s->desc.indirect_samples + 1, sizeof *s->end);
    if (!s->end || lw_change_order_init(&s->order, s->tiles.count) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "%u texels", texels->count);
    return LW_OK;
}

enum lw_status lw_cell_solver_create_over(struct lw_geometry *geometry, const struct lw_solver_desc *desc,
                                          const struct lw_pose *pose, struct lw_solver **out_solver,
                                          struct lw_error *err) {
    struct cell_solver *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    s->base.ops = &ops;
    s->geometry = geometry;
    s->desc = *desc;
    s->budget_s = desc->frame_budget_s;
    s->hasty = true;
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

enum lw_status lw_cell_solver_create(const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                     struct lw_solver **out_solver, struct lw_error *err) {
    return lw_cell_solver_create_over(NULL, desc, pose, out_solver, err);
}
