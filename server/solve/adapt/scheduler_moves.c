#include "server/solve/adapt/scheduler.h"

#include "server/solve/adapt/control_variate.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/adapt/gradient.h"
#include "server/solve/adapt/verify.h"
#include "server/solve/transport/bounces.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Of a frame's budget, what goes into verification once a change has been found, and at most before. */
#define VERIFY_SHARE 0.5
#define SEARCH_SHARE 1.0
/* While lights keep moving: what goes into correcting what they light. */
#define SWEEP_SHARE 0.5
/* After this many rounds without a stale block, what the last one lights has followed. */
#define CHANGING_ROUNDS 2u
/* A converged block whose light has been corrected stays converged up to this many times its target error:
 * less of the light, and it is noisier. */
#define CONVERGED_FACTOR 1.5f

/* ---- order: interest before its contributors, near to what has moved before far from it ---- */

static void add_places(struct lw_scheduler *scheduler, struct lw_vec3 was, struct lw_vec3 is) {
    if (scheduler->place_count + 2 > LW_SCHEDULER_PLACES_MAX) return;
    scheduler->place_ws[scheduler->place_count++] = was;
    scheduler->place_ws[scheduler->place_count++] = is;
}

static void note_places(struct lw_scheduler *scheduler, struct lw_tiles *tiles, const struct lw_scene *scene,
                        const struct lw_pose *was, const struct lw_pose *is) {
    uint32_t last = UINT32_MAX;
    scheduler->place_count = 0;
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->light[i].kind != LW_LIGHT_DIRECTIONAL &&
            memcmp(&was->light[i], &is->light[i], sizeof *is->light) != 0)
            add_places(scheduler, was->light[i].position_ws, is->light[i].position_ws);
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t object = tile->object;
        tile->unverified = true;
        tile->moved = lw_pose_object_differs(was, is, object);
        if (object == last || !tile->moved) continue;
        last = object;
        add_places(scheduler, lw_affine_point(&was->object_to_world[object], tile->centre_os),
                   lw_affine_point(&is->object_to_world[object], tile->centre_os));
    }
}

/* The tile of the least rank is verified first. */
static float rank_of(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile) {
    float distance = scheduler->place_count ? INFINITY : 0;
    for (uint32_t k = 0; k < scheduler->place_count; k++)
        distance = fminf(distance, lw_vec3_length(lw_vec3_sub(tile->centre_ws, scheduler->place_ws[k])) -
                                       tile->radius_m);
    const bool looked_at = lw_scheduler_is_of_interest(scheduler, tile);
    return (tile->moved ? -1 : fmaxf(distance, 0)) + (looked_at ? 0 : FLT_MAX / 2);
}

static int compare_turns(const void *a, const void *b) {
    const struct lw_scheduler_turn *x = a, *y = b;
    return x->rank != y->rank ? (x->rank > y->rank) - (x->rank < y->rank)
                              : (x->tile > y->tile) - (x->tile < y->tile);
}

/* By rank if not all may be verified in this frame and some tile is yet to be; else as the tiles stand. */
static void sort_tiles(struct lw_scheduler *scheduler, const struct lw_tiles *tiles, bool limited) {
    bool any = false;
    for (uint32_t i = 0; limited && i < tiles->count; i++)
        any |= tiles->tile[i].contributes && tiles->tile[i].unverified;
    for (uint32_t i = 0; i < tiles->count; i++)
        scheduler->turn[i] =
            (struct lw_scheduler_turn){.rank = any ? rank_of(scheduler, &tiles->tile[i]) : 0, .tile = i};
    if (any) qsort(scheduler->turn, tiles->count, sizeof *scheduler->turn, compare_turns);
}

/* ---- movement ---- */

void lw_scheduler_move(struct lw_scheduler *scheduler, struct lw_tiles *tiles, const struct lw_scene *scene,
                       const struct lw_pose *was, const struct lw_pose *is, bool shines) {
    note_places(scheduler, tiles, scene, was, is);
    scheduler->moves++;
    if (shines) scheduler->light_moves = scheduler->moves;
    if (scheduler->moves == 1 || scheduler->frames_since_move > LW_SCHEDULER_STILL_FRAMES) {
        scheduler->began = scheduler->moves;
        scheduler->shone = shines;
    }
    scheduler->frames_since_move = 0;
}

void lw_scheduler_resume(struct lw_scheduler *scheduler, uint32_t moves, uint32_t frames_since_move) {
    scheduler->moves = moves;
    scheduler->frames_since_move = frames_since_move;
    scheduler->unchanged_rounds = CHANGING_ROUNDS + 1;
}

/* What follows from a movement need not wait for its turn. */
static bool is_at_once(const struct lw_scheduler_frame *frame) { return frame->mode != LW_SCHEDULER_STEADY; }

/* ---- what is found ---- */

void lw_scheduler_sum_invalidated(struct lw_solve_tile *tile) {
    double square = 0;
    tile->invalidated_count = 0;
    tile->invalidated = false;
    LW_TILES_EACH_BLOCK (tile, block) {
        const double share = fmin(1, (double)block->change.strength);
        tile->invalidated |= lw_gradient_is_invalidated(&block->change);
        if (!lw_gradient_is_strong(&block->change)) continue;
        square += share * share * block->covered_count;
        tile->invalidated_count += block->covered_count;
    }
    tile->priority = tile->invalidated_count ? (float)(square / tile->invalidated_count) : 0;
}

/* After the comparison: corrects indirect light of a tile, and judges again what was corrected. */
static void take_over(const struct lw_scheduler_frame *frame, struct lw_solve_tile *tile) {
    const struct lw_transport *passes = frame->passes;
    tile->corrected |= lw_control_variate_indirect(passes->tiles, tile, frame->converged.target_error, true);
    if (tile->corrected) lw_estimates_judge(passes, tile);
}

/* ---- where something begins to move, and in turn ---- */

/* Direct light has changed everywhere: all packets are verified about it, so that it need not be solved. */
static bool verifies_all(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame) {
    return lw_scheduler_mode_is_onset(frame->mode) && scheduler->shone;
}

/* Whether a tile of interest is yet to be verified after the last movement. */
static bool is_unverified(const struct lw_scheduler *scheduler, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->unverified && tile->contributes && lw_scheduler_is_of_interest(scheduler, tile))
            return true;
    }
    return false;
}

bool lw_scheduler_is_behind(const struct lw_scheduler *scheduler, const struct lw_tiles *tiles) {
    return scheduler->shone && is_unverified(scheduler, tiles);
}

static uint64_t work_of(const struct lw_solve_tile *tile, const struct lw_gradient_round *round) {
    uint64_t work = 0;
    LW_TILES_EACH_BLOCK (tile, block) work += lw_gradient_work(block, round);
    return work;
}

/* Fills turn[].work. */
static void forecast(struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                     const struct lw_gradient_round *round) {
    const struct lw_tiles *tiles = frame->passes->tiles;
    uint64_t sum = 0;
#pragma omp parallel for schedule(static) num_threads(frame->threads)
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[scheduler->turn[i].tile];
        scheduler->turn[i].work = tile->contributes && tile->unverified ? work_of(tile, round) : 0;
    }
    for (uint32_t i = 0; i < tiles->count; i++) scheduler->turn[i].work = sum += scheduler->turn[i].work;
}

/* Turns from `first` on whose unverified tiles fit into a share of the budget; one does in any case. */
static uint32_t turns_within(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                             double share) {
    const uint32_t count = frame->passes->tiles->count;
    if (!lw_scheduler_mode_is_limited(frame->mode)) return count;
    const uint64_t most = (uint64_t)(share * (double)frame->budget.verify);
    uint32_t i = 0;
    while (i < count && !scheduler->turn[i].work) i++;
    if (i < count) i++;
    while (i < count && scheduler->turn[i].work <= most) i++;
    return i;
}

/* Verifies one tile; adds its rays to count, its work to work. Returns whether its direct light has been
 * corrected. */
static bool verify_tile(const struct lw_scheduler_frame *frame, const struct lw_gradient_round *round,
                        struct lw_solve_tile *tile, struct lw_ray_count *count, uint64_t *work) {
    const float target_error = frame->converged.target_error;
    bool any = false, more = false;
    *work += work_of(tile, round);
    tile->unverified = false;
    LW_TILES_EACH_BLOCK (tile, block) any |= lw_gradient_choose(block, round);
    if (!any) return false;
    const bool direct = tile->corrected = lw_verify_compare(frame->passes, tile, count);
    LW_TILES_EACH_BLOCK (tile, block) more |= lw_gradient_choose_more(block, target_error, frame->mode);
    if (more) tile->corrected |= lw_verify_compare(frame->passes, tile, count);
    take_over(frame, tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->covered_count) continue;
        lw_gradient_invalidate(block, target_error, frame->mode);
        if (tile->corrected && block->error > CONVERGED_FACTOR * target_error &&
            block->state == LW_BLOCK_CONVERGED && !lw_converged_may(&frame->converged, tile, block))
            block->state = LW_BLOCK_SAMPLED;
    }
    lw_scheduler_sum_invalidated(tile);
    lw_tiles_sum_up(tile);
    return direct;
}

/* What a search has found so far. */
struct found {
    struct lw_ray_count rays;
    uint64_t work;
    bool direct; /* direct light was corrected */
    bool change; /* a tile was invalidated */
};

/* Verifies tiles in turn: unverified ones of the turns from `first` to `end`, others if first is 0. */
static void verify_turns(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                         const struct lw_gradient_round *round, uint32_t first, uint32_t end,
                         struct found *found) {
    struct lw_tiles *tiles = frame->passes->tiles;
    uint64_t shadow = 0, bounce = 0, work = 0;
    bool direct = false, change = false;
#pragma omp parallel for schedule(dynamic, 1) num_threads(frame->threads) reduction(+ : shadow, bounce, work) \
    reduction(|| : direct, change)
    for (uint32_t i = first; i < (first ? end : tiles->count); i++) {
        struct lw_solve_tile *tile = &tiles->tile[scheduler->turn[i].tile];
        struct lw_ray_count of_tile = {0};
        if (!tile->contributes || (tile->unverified ? i >= end : first > 0)) continue;
        direct |= verify_tile(frame, round, tile, &of_tile, &work);
        change |= tile->invalidated;
        shadow += of_tile.shadow;
        bounce += of_tile.bounce;
    }
    found->rays.shadow += shadow;
    found->rays.bounce += bounce;
    found->work += work;
    found->direct |= direct;
    found->change |= change;
}

/* Invalidates converged blocks whose light has changed; at an onset it verifies the others too. Where a change
 * is found there should be time to solve it. */
static uint64_t verify_tiles(struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                             struct lw_ray_count *count) {
    struct lw_tiles *tiles = frame->passes->tiles;
    const bool limited = lw_scheduler_mode_is_limited(frame->mode);
    const struct lw_gradient_round round = {.moves = scheduler->moves,
                                            .began = scheduler->began,
                                            .light_moves = scheduler->light_moves,
                                            .tick = scheduler->round,
                                            .turn = scheduler->ended,
                                            /* not all were verified */
                                            .active = scheduler->still_rounds <= LW_PACKETS_MAX,
                                            .spreads = is_at_once(frame) && scheduler->passes > 0 &&
                                                       !is_unverified(scheduler, tiles),
                                            .mode = frame->mode};
    struct found found = {0};
    sort_tiles(scheduler, tiles, limited);
    if (limited) forecast(scheduler, frame, &round);
    const uint32_t search = turns_within(scheduler, frame, SEARCH_SHARE),
                   sure =
                       verifies_all(scheduler, frame) ? search : turns_within(scheduler, frame, VERIFY_SHARE);
    verify_turns(scheduler, frame, &round, 0, sure, &found);
    if (!found.change && sure < search) verify_turns(scheduler, frame, &round, sure, search, &found);
    count->shadow += found.rays.shadow;
    count->bounce += found.rays.bounce;
    /* As many as there are bounces, once direct light has changed, and again once
     * nothing invalidated is left to solve. */
    scheduler->solved_invalidated |= scheduler->solved_first > 0;
    if (found.direct || (scheduler->solved_invalidated && !scheduler->passes && !scheduler->backlog)) {
        scheduler->passes = tiles->bounces;
        scheduler->solved_invalidated = false;
    } else if (round.spreads) {
        scheduler->passes--;
    }
    return found.work;
}

/* ---- while lights keep moving ---- */

/* Corrects all light of a tile: direct light by new shadow rays, indirect light
 * along the rays that there are. */
static void correct_tile(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                         struct lw_solve_tile *tile, struct lw_ray_count *count) {
    bool any = false;
    LW_TILES_EACH_BLOCK (tile, block) any |= lw_gradient_choose_all(block, scheduler->moves);
    if (!any) return;
    tile->corrected |= lw_verify_compare(frame->passes, tile, count);
    take_over(frame, tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (block->state == LW_BLOCK_CONVERGED && block->covered_count)
            lw_gradient_invalidate(block, frame->converged.target_error, frame->mode);
        block->change.compare = block->change.direct = 0;
    }
    lw_scheduler_sum_invalidated(tile);
    lw_tiles_sum_up(tile);
}

/* A round is too long to wait for. A share of each frame goes on through the interest set, until all of it
 * has been corrected since the last movement. */
static bool is_swept(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile) {
    return tile->contributes && lw_scheduler_is_of_interest(scheduler, tile);
}

/* The first tile behind those that a sweep corrects in a frame: at least one, if any is left. */
static uint32_t end_of_sweep(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                             uint64_t *out_work) {
    const struct lw_tiles *tiles = frame->passes->tiles;
    const uint64_t most = (uint64_t)(SWEEP_SHARE * (double)frame->budget.verify);
    uint32_t i = scheduler->sweep.next;
    *out_work = 0;
    for (; i < tiles->count; i++) {
        uint64_t work = 0;
        if (!is_swept(scheduler, &tiles->tile[i])) continue;
        LW_TILES_EACH_BLOCK (&tiles->tile[i], block) work += lw_gradient_work_all(block);
        if (*out_work && *out_work + work > most) break;
        *out_work += work;
    }
    return i;
}

static uint64_t sweep(struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                      struct lw_ray_count *count) {
    const struct lw_tiles *tiles = frame->passes->tiles;
    uint64_t shadow = 0, bounce = 0, work;
    scheduler->sweep.ended = false;
    if (is_at_once(frame)) /* all are verified at once, or solved */
        scheduler->sweep.moves = scheduler->light_moves;
    if (scheduler->sweep.next == 0 && scheduler->sweep.moves == scheduler->light_moves) return 0;
    if (scheduler->sweep.next == 0) scheduler->sweep.moves = scheduler->light_moves;
    const uint32_t end = end_of_sweep(scheduler, frame, &work);
#pragma omp parallel for schedule(dynamic, 1) num_threads(frame->threads) reduction(+ : shadow, bounce)
    for (uint32_t i = scheduler->sweep.next; i < end; i++) {
        struct lw_ray_count of_tile = {0};
        if (!is_swept(scheduler, &tiles->tile[i])) continue;
        correct_tile(scheduler, frame, &tiles->tile[i], &of_tile);
        shadow += of_tile.shadow;
        bounce += of_tile.bounce;
    }
    scheduler->sweep.ended = end >= tiles->count;
    scheduler->sweep.next = scheduler->sweep.ended ? 0 : end;
    count->shadow += shadow;
    count->bounce += bounce;
    return work;
}

/* ---- a frame ---- */

static bool is_any_stale(const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++)
        if (tiles->tile[i].contributes && tiles->tile[i].state == LW_BLOCK_STALE) return true;
    return false;
}

uint64_t lw_scheduler_verify(struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                             struct lw_ray_count *count) {
    uint64_t work = 0;
    if (scheduler->moves && lw_scheduler_has_interest(scheduler)) {
        work = verify_tiles(scheduler, frame, count);
        work += sweep(scheduler, frame, count);
    }
    if (is_any_stale(frame->passes->tiles) || scheduler->corrected)
        scheduler->unchanged_rounds = 0;
    else
        scheduler->unchanged_rounds += scheduler->ended;
    return work;
}

bool lw_scheduler_is_changing(const struct lw_scheduler *scheduler) {
    return scheduler->moves && scheduler->unchanged_rounds <= CHANGING_ROUNDS;
}

void lw_scheduler_note_work(struct lw_scheduler *scheduler, bool solves) {
    scheduler->still_rounds = solves || scheduler->corrected ? 0 : scheduler->still_rounds + scheduler->ended;
}

void lw_scheduler_weigh(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                        struct lw_ray_count *count) {
    struct lw_tiles *tiles = frame->passes->tiles;
    uint64_t shadow = 0, bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(frame->threads) reduction(+ : shadow, bounce)
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        struct lw_ray_count of_tile = {0};
        bool any = false;
        LW_TILES_EACH_BLOCK (tile, block)
            if (block->due && scheduler->moves) any |= lw_gradient_choose_due(block, scheduler->moves);
        if (any) {
            (void)lw_verify_compare(frame->passes, tile, &of_tile);
            (void)lw_control_variate_indirect(tiles, tile, frame->converged.target_error, true);
        }
        LW_TILES_EACH_BLOCK (tile, block)
            if (block->due) lw_gradient_weigh_direct(block, scheduler->moves, frame->filtered, frame->mode);
        shadow += of_tile.shadow;
        bounce += of_tile.bounce;
    }
    count->shadow += shadow;
    count->bounce += bounce;
}

void lw_scheduler_pass_on(struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame) {
    const struct lw_tiles *tiles = frame->passes->tiles;
    uint32_t corrected = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(frame->threads) reduction(+ : corrected)
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        corrected += tile->corrected;
        for (uint32_t bounce = 0; tile->corrected && bounce < tiles->bounces; bounce++)
            lw_bounces_radiate(frame->passes, tile, bounce);
    }
    scheduler->corrected = corrected;
}

void lw_scheduler_show(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame) {
    struct lw_tiles *tiles = frame->passes->tiles;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const bool is_to_be_seen = scheduler->sweep.ended || (tile->corrected && is_at_once(frame));
        bool unseen = false;
        LW_TILES_EACH_BLOCK (tile, block) unseen |= is_to_be_seen && block->unseen;
        tile->shows |= unseen && lw_scheduler_is_of_interest(scheduler, tile);
        tile->corrected = false;
    }
}
