#include "server/solve/adapt/follow.h"

#include "common/clock.h"
#include "server/solve/adapt/control_variate.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/adapt/gradient.h"
#include "server/solve/adapt/verify.h"
#include "server/solve/transport/bounces.h"

#include <math.h>

/* Of a frame's budget, what goes into asking what has changed once some has been found, and at most before. */
#define ASKING_SHARE 0.5
#define SEARCH_SHARE 1.0
/* While lights keep moving: what goes into correcting what they light. */
#define SWEEP_SHARE 0.5
/* So many rounds after the last light that was known to be out of date, what it lights has followed. */
#define CHANGING_ROUNDS 2u
/* A block at rest whose light has been corrected rests on with so many times its target error: less of the light, and it is noisier. */
#define RESTS_ON 1.5f

enum lw_status lw_follow_init(struct lw_follow *follow, uint32_t tile_count) {
    *follow = (struct lw_follow){0};
    return lw_verify_order_init(&follow->order, tile_count);
}

void lw_follow_finish(struct lw_follow *follow) { lw_verify_order_finish(&follow->order); }

void lw_follow_move(struct lw_follow *follow, struct lw_tiles *tiles, const struct lw_scene *scene,
                    const struct lw_pose *was, const struct lw_pose *is, bool shines) {
    lw_verify_order_note(&follow->order, tiles, scene, was, is);
    follow->moves++;
    if (shines) follow->light_moves = follow->moves;
    if (follow->moves == 1 || follow->frames_since_move > LW_FOLLOW_STILL_FRAMES) {
        follow->began = follow->moves;
        follow->shone = shines;
    }
    follow->frames_since_move = 0;
}

void lw_follow_resume(struct lw_follow *follow, uint32_t moves, uint32_t frames_since_move) {
    follow->moves = moves;
    follow->frames_since_move = frames_since_move;
    follow->unchanged_rounds = CHANGING_ROUNDS + 1;
}

static bool is_hurried(const struct lw_follow_frame *frame) { return frame->budget_s > 0; }

/* What follows from a movement need not wait for its turn. */
static bool is_at_once(const struct lw_follow_frame *frame) { return !is_hurried(frame) || frame->hasty; }

static bool is_hasty(const struct lw_follow_frame *frame) { return is_hurried(frame) && frame->hasty; }

/* ---- what is found ---- */

void lw_follow_sum_woken(struct lw_solve_tile *tile) {
    double square = 0;
    tile->woken_count = 0;
    tile->woken = false;
    LW_TILES_EACH_BLOCK (tile, block) {
        const double share = fmin(1, (double)block->change.strength);
        tile->woken |= block->change.woken;
        if (!lw_gradient_is_urgent(&block->change)) continue;
        square += share * share * block->covered_count;
        tile->woken_count += block->covered_count;
    }
    tile->urgency = tile->woken_count ? (float)(square / tile->woken_count) : 0;
}

/* After their answers: indirect light of a tile is corrected, and what has been is judged anew. */
static void take_over(const struct lw_follow_frame *frame, struct lw_solve_tile *tile) {
    const struct lw_transport *passes = frame->passes;
    tile->corrected |= lw_control_variate_indirect(passes->tiles, tile, frame->rest.target_error, true);
    if (tile->corrected) lw_estimates_judge(passes, tile);
}

/* ---- where something begins to move, and in turn ---- */

/* Direct light has changed everywhere: all packets are asked about it, so that it need not be solved. */
static bool asks_all(const struct lw_follow *follow, const struct lw_follow_frame *frame) {
    return is_hasty(frame) && follow->shone;
}

/* Whether something that is looked at is yet to be asked about the last movement. */
static bool is_unasked(const struct lw_tiles *tiles, const struct lw_schedule *schedule) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->unasked && tile->serves && lw_schedule_looks_at(schedule, tile)) return true;
    }
    return false;
}

bool lw_follow_is_behind(const struct lw_follow *follow, const struct lw_tiles *tiles,
                         const struct lw_schedule *schedule) {
    return follow->shone && is_unasked(tiles, schedule);
}

/* A frame's round of questions. */
struct search {
    const struct lw_follow_frame *frame;
    uint64_t began_ns;
    struct lw_gradient_round round;
    bool begun, found; /* by any worker: a question that there was no time for, a change */
};

/* Whether there is no time for another tile that is yet to be asked; but one is asked in any case. There should be time to solve what is
 * found. */
static bool is_time_over(const struct lw_follow *follow, struct search *search) {
    const struct lw_follow_frame *frame = search->frame;
    const bool found = __atomic_load_n(&search->found, __ATOMIC_RELAXED);
    const double budgets = found && !asks_all(follow, frame) ? ASKING_SHARE : SEARCH_SHARE;
    return is_hurried(frame) &&
           (double)(lw_clock_ns() - search->began_ns) > budgets * frame->budget_s * 1e9 &&
           __atomic_exchange_n(&search->begun, true, __ATOMIC_RELAXED);
}

/* Asks one tile; adds its rays to count. Returns whether its direct light has been corrected. */
static bool ask_tile(struct search *search, struct lw_solve_tile *tile, struct lw_ray_count *count) {
    const struct lw_follow_frame *frame = search->frame;
    const float target_error = frame->rest.target_error;
    const bool hurried = is_hurried(frame);
    bool asked = false, more = false;
    tile->unasked = false;
    LW_TILES_EACH_BLOCK (tile, block) asked |= lw_gradient_choose(block, &search->round);
    if (!asked) return false;
    const bool direct = tile->corrected = lw_verify_compare(frame->passes, tile, count);
    LW_TILES_EACH_BLOCK (tile, block) more |= lw_gradient_choose_more(block, target_error, hurried);
    if (more) tile->corrected |= lw_verify_compare(frame->passes, tile, count);
    take_over(frame, tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->covered_count) continue;
        lw_gradient_wake(block, target_error, hurried);
        if (tile->corrected && block->error > RESTS_ON * target_error)
            block->resting = block->resting && lw_converged_may(&frame->rest, tile, block);
    }
    lw_follow_sum_woken(tile);
    lw_tiles_sum_up(tile);
    if (tile->woken) __atomic_store_n(&search->found, true, __ATOMIC_RELAXED);
    return direct;
}

/* Wakes blocks at rest whose light is no longer what it was; where something begins to move, asks those that are awake too. */
static void ask(struct lw_follow *follow, const struct lw_follow_frame *frame, struct lw_ray_count *count) {
    struct lw_tiles *tiles = frame->passes->tiles;
    struct search search = {
        .frame = frame,
        .began_ns = lw_clock_ns(),
        .round = {.moves = follow->moves,
                  .began = follow->began,
                  .light_moves = follow->light_moves,
                  .tick = frame->schedule->tick,
                  .turn = frame->schedule->ended,
                  .active = follow->still_rounds <= LW_PACKETS_MAX, /* not all were asked */
                  .spreads = is_at_once(frame) && follow->passes > 0 && !is_unasked(tiles, frame->schedule),
                  .hurried = is_hurried(frame)}};
    uint64_t shadow = 0, bounce = 0;
    bool direct = false;
    lw_verify_order_sort(&follow->order, tiles, frame->schedule, is_hurried(frame));
#pragma omp parallel for schedule(dynamic, 1) num_threads(frame->threads) reduction(+ : shadow, bounce) reduction(|| : direct)
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[follow->order.turn[i].tile];
        struct lw_ray_count of_tile = {0};
        if (!tile->serves || (tile->unasked && is_time_over(follow, &search))) continue;
        direct |= ask_tile(&search, tile, &of_tile);
        shadow += of_tile.shadow;
        bounce += of_tile.bounce;
    }
    count->shadow += shadow;
    count->bounce += bounce;
    /* As many as there are bounces, once direct light has changed, and again once nothing urgent is left to solve. */
    follow->solved_urgent |= frame->schedule->urgent > 0;
    if (direct || (follow->solved_urgent && !follow->passes && !frame->schedule->hurry)) {
        follow->passes = tiles->bounces;
        follow->solved_urgent = false;
    } else if (search.round.spreads) {
        follow->passes--;
    }
}

/* ---- while lights keep moving ---- */

/* Corrects all light of a tile: direct light by new shadow rays, indirect light along the rays that there are. */
static void correct_tile(const struct lw_follow *follow, const struct lw_follow_frame *frame,
                         struct lw_solve_tile *tile, struct lw_ray_count *count) {
    bool asked = false;
    LW_TILES_EACH_BLOCK (tile, block) asked |= lw_gradient_choose_all(block, follow->moves);
    if (!asked) return;
    tile->corrected |= lw_verify_compare(frame->passes, tile, count);
    take_over(frame, tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (block->resting && block->covered_count) lw_gradient_wake(block, frame->rest.target_error, true);
        block->change.compare = block->change.direct = 0;
    }
    lw_follow_sum_woken(tile);
    lw_tiles_sum_up(tile);
}

/* A round is too long to wait for: a share of each frame goes on with what is looked at, until all has been corrected since the last
 * movement. */
static void sweep(struct lw_follow *follow, const struct lw_follow_frame *frame, struct lw_ray_count *count) {
    const struct lw_tiles *tiles = frame->passes->tiles;
    const uint64_t until_ns = lw_clock_ns() + (uint64_t)(SWEEP_SHARE * frame->budget_s * 1e9);
    uint64_t shadow = 0, bounce = 0;
    follow->sweep.ended = false;
    if (!is_hurried(frame) || frame->hasty)
        follow->sweep.moves = follow->light_moves; /* all are asked at once, or solved */
    if (follow->sweep.next == 0 && follow->sweep.moves == follow->light_moves) return;
    if (follow->sweep.next == 0) follow->sweep.moves = follow->light_moves;
    uint32_t next = follow->sweep.next;
#pragma omp parallel num_threads(frame->threads) reduction(+ : shadow, bounce)
    for (;;) {
        const uint32_t i = __atomic_fetch_add(&next, 1, __ATOMIC_RELAXED);
        struct lw_ray_count of_tile = {0};
        if (i >= tiles->count) break;
        struct lw_solve_tile *tile = &tiles->tile[i];
        if (!tile->serves || !lw_schedule_looks_at(frame->schedule, tile)) continue;
        correct_tile(follow, frame, tile, &of_tile);
        shadow += of_tile.shadow;
        bounce += of_tile.bounce;
        if (lw_clock_ns() > until_ns) break;
    }
    follow->sweep.ended = next >= tiles->count;
    follow->sweep.next = follow->sweep.ended ? 0 : next;
    count->shadow += shadow;
    count->bounce += bounce;
}

/* ---- a frame ---- */

static bool is_any_stale(const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++)
        if (tiles->tile[i].serves && tiles->tile[i].stale) return true;
    return false;
}

void lw_follow_ask(struct lw_follow *follow, const struct lw_follow_frame *frame,
                   struct lw_ray_count *count) {
    if (follow->moves && lw_schedule_is_looked_at(frame->schedule)) {
        ask(follow, frame, count);
        sweep(follow, frame, count);
    }
    if (is_any_stale(frame->passes->tiles) || follow->corrected)
        follow->unchanged_rounds = 0;
    else
        follow->unchanged_rounds += frame->schedule->ended;
}

bool lw_follow_is_changing(const struct lw_follow *follow) {
    return follow->moves && follow->unchanged_rounds <= CHANGING_ROUNDS;
}

void lw_follow_note_work(struct lw_follow *follow, bool solves, bool ended) {
    follow->still_rounds = solves || follow->corrected ? 0 : follow->still_rounds + ended;
}

void lw_follow_weigh(const struct lw_follow *follow, const struct lw_follow_frame *frame,
                     struct lw_ray_count *count) {
    struct lw_tiles *tiles = frame->passes->tiles;
    uint64_t shadow = 0, bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(frame->threads) reduction(+ : shadow, bounce)
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        struct lw_ray_count of_tile = {0};
        bool asked = false;
        LW_TILES_EACH_BLOCK (tile, block)
            if (block->due && follow->moves) asked |= lw_gradient_choose_due(block, follow->moves);
        if (asked) {
            (void)lw_verify_compare(frame->passes, tile, &of_tile);
            (void)lw_control_variate_indirect(tiles, tile, frame->rest.target_error, true);
        }
        LW_TILES_EACH_BLOCK (tile, block)
            if (block->due) lw_gradient_weigh_direct(block, follow->moves, frame->filtered, is_hasty(frame));
        shadow += of_tile.shadow;
        bounce += of_tile.bounce;
    }
    count->shadow += shadow;
    count->bounce += bounce;
}

void lw_follow_pass_on(struct lw_follow *follow, const struct lw_follow_frame *frame) {
    const struct lw_tiles *tiles = frame->passes->tiles;
    uint32_t corrected = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(frame->threads) reduction(+ : corrected)
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        corrected += tile->corrected;
        for (uint32_t bounce = 0; tile->corrected && bounce < tiles->bounces; bounce++)
            lw_bounces_radiate(frame->passes, tile, bounce);
    }
    follow->corrected = corrected;
}

void lw_follow_show(const struct lw_follow *follow, const struct lw_follow_frame *frame) {
    struct lw_tiles *tiles = frame->passes->tiles;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const bool is_to_be_seen = follow->sweep.ended || (tile->corrected && is_at_once(frame));
        bool unseen = false;
        LW_TILES_EACH_BLOCK (tile, block) unseen |= is_to_be_seen && block->unseen;
        tile->shows |= unseen && lw_schedule_looks_at(frame->schedule, tile);
        tile->corrected = false;
    }
}
