#include "server/solve/adapt/scheduler.h"

#include "common/random.h"
#include "server/solve/transport/ray_hit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* One texel in this many has its rays counted, in turn. Odd: it goes through all columns of a tile. */
#define COUNT_ONE_IN 9u
/* What a ray hit of a tile of interest counts for. */
#define WEIGHT_INTEREST 256u
#define WEIGHT_MAX      UINT16_MAX
/* The share of a tile's importance that its own ray hits get: less with every bounce, as albedos. */
#define PASSED_ON 0.5f
/* Frames that the running mean of importance stands for, about. */
#define IMPORTANCE_FRAMES 8.0f
/* A tile of less importance lights nothing that can be seen: a thousandth of what a tile
 * has in a scene all in view. */
#define IMPORTANCE_MIN 0.001f
/* Of the coarsest levels of interest; coarser ones are solved as often as these. */
#define PERIOD_LOG_MAX 3u
/* Of a frame's budget, what is left for solving at least, however long verification takes. */
#define SOLVING_SHARE 0.5

static void forget_interest(struct lw_scheduler *scheduler) {
    free(scheduler->interest);
    free(scheduler->hits);
    free(scheduler->weight);
    free(scheduler->importance);
    scheduler->interest = NULL;
    scheduler->hits = NULL;
    scheduler->importance = NULL;
    scheduler->weight = NULL;
}

static bool allocate(struct lw_scheduler *scheduler) {
    scheduler->interest = calloc((size_t)scheduler->ids + 1, sizeof *scheduler->interest);
    scheduler->hits = calloc((size_t)scheduler->ids + 1, sizeof *scheduler->hits);
    scheduler->importance = calloc((size_t)scheduler->ids + 1, sizeof *scheduler->importance);
    scheduler->weight = calloc((size_t)scheduler->ids + 1, sizeof *scheduler->weight);
    return scheduler->interest && scheduler->hits && scheduler->importance && scheduler->weight;
}

static size_t interest_bytes(const struct lw_scheduler *scheduler) {
    if (!scheduler->interest) return 0;
    return scheduler->ids * (sizeof *scheduler->interest + sizeof *scheduler->hits +
                             sizeof *scheduler->importance + sizeof *scheduler->weight);
}

enum lw_status lw_scheduler_init(struct lw_scheduler *scheduler, uint32_t ids, uint32_t tile_count,
                                 uint32_t indirect_samples) {
    *scheduler = (struct lw_scheduler){.scope = LW_SCHEDULER_EVERYTHING,
                                       .ended = true,
                                       .ids = ids,
                                       .samples = indirect_samples,
                                       .tile_count = tile_count,
                                       .turn = calloc(tile_count + 1ul, sizeof *scheduler->turn)};
    return scheduler->turn ? LW_OK : LW_NO_MEMORY;
}

void lw_scheduler_finish(struct lw_scheduler *scheduler) {
    forget_interest(scheduler);
    free(scheduler->turn);
    scheduler->turn = NULL;
}

size_t lw_scheduler_memory_bytes(const struct lw_scheduler *scheduler) {
    return scheduler->tile_count * sizeof *scheduler->turn + interest_bytes(scheduler);
}

enum lw_status lw_scheduler_set_interest(struct lw_scheduler *scheduler, const uint8_t *interest) {
    if (!interest) {
        scheduler->scope = LW_SCHEDULER_EVERYTHING;
        return LW_OK;
    }
    if (!scheduler->interest && !allocate(scheduler)) {
        forget_interest(scheduler);
        return LW_NO_MEMORY;
    }
    memcpy(scheduler->interest, interest, scheduler->ids);
    scheduler->scope = LW_SCHEDULER_NOTHING;
    for (uint32_t id = 0; id < scheduler->ids; id++)
        if (interest[id]) scheduler->scope = LW_SCHEDULER_TILES;
    return LW_OK;
}

/* Frames from one solve of a contributor to the next. */
static uint32_t contributor_period(float importance) {
    return importance >= 2 ? 2 : importance >= 0.5f ? 4 : importance >= 0.125f ? 8 : LW_SCHEDULER_PERIOD_MAX;
}

/* What its rays count for, when it is solved once in `period` frames: in the mean its own importance.
 * (Counted for more, tiles of no interest would keep each other important.) */
static uint16_t contributor_weight(float importance, uint32_t period) {
    return (uint16_t)fminf(PASSED_ON * importance * (float)(WEIGHT_INTEREST * period), WEIGHT_MAX);
}

/* Where tiles of one period would all be due at once, some are each frame; but one
 * that is too old is at once. */
static bool is_turn(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile, uint32_t period) {
    return scheduler->round - tile->solved_tick >= period ||
           ((scheduler->round + lw_random_hash(tile->id.v)) & (period - 1)) == 0;
}

/* A contributor is seen in coarse levels alone, which may be old. It is shown in one
 * of LW_SCHEDULER_PERIOD_MAX frames, all of an object at once, so that what is
 * welded together shows together. */
static bool shows_contributors(const struct lw_scheduler *scheduler, uint32_t object) {
    return ((scheduler->round + lw_random_hash(object)) & (LW_SCHEDULER_PERIOD_MAX - 1)) == 0;
}

static void take_importance(struct lw_scheduler *scheduler, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        const float own = (float)tile->covered_count * (float)scheduler->samples *
                          ((float)WEIGHT_INTEREST / (float)COUNT_ONE_IN);
        float *importance = &scheduler->importance[tile->id.v];
        if (own > 0)
            *importance += ((float)scheduler->hits[tile->id.v] / own - *importance) * (1 / IMPORTANCE_FRAMES);
    }
    memset(scheduler->hits, 0, scheduler->ids * sizeof *scheduler->hits);
}

/* Whether a tile of interest has not converged, or a contributor is stale. */
static bool is_watched(const struct lw_scheduler *scheduler, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->state != LW_BLOCK_CONVERGED &&
            (scheduler->interest[tile->id.v] || (tile->state == LW_BLOCK_STALE && tile->contributes)))
            return true;
    }
    return false;
}

void lw_scheduler_find_contributors(const struct lw_scheduler *scheduler, struct lw_tiles *tiles,
                                    bool all_contribute) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        tile->contributes = tile->covered_count && !tile->hidden &&
                            (lw_scheduler_is_of_interest(scheduler, tile) ||
                             (scheduler->scope == LW_SCHEDULER_TILES &&
                              (all_contribute || scheduler->importance[tile->id.v] >= IMPORTANCE_MIN)));
    }
}

/* Of a tile that is to be solved: frames until it is solved again; 0: it neither is
 * of interest nor contributes. */
static uint32_t period_of(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile) {
    if (scheduler->scope == LW_SCHEDULER_EVERYTHING) return 1;
    const uint32_t interest = scheduler->interest[tile->id.v];
    if (interest) return 1u << (interest - 1 < PERIOD_LOG_MAX ? interest - 1 : PERIOD_LOG_MAX);
    return scheduler->watched && tile->contributes ? contributor_period(scheduler->importance[tile->id.v])
                                                   : 0;
}

/* Rounds that take many frames must not delay a stale tile by as many frames each. */
static uint32_t rounds_of(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile,
                          uint32_t period) {
    while (tile->state == LW_BLOCK_STALE && period > 1 &&
           period * scheduler->frames > LW_SCHEDULER_PERIOD_MAX)
        period /= 2;
    return period;
}

static void begin_round(struct lw_scheduler *scheduler, struct lw_tiles *tiles) {
    scheduler->round++;
    scheduler->count = (struct lw_scheduler_count){0};
    if (scheduler->watched) take_importance(scheduler, tiles);
    scheduler->watched = scheduler->scope != LW_SCHEDULER_EVERYTHING && is_watched(scheduler, tiles);
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t period = period_of(scheduler, tile);
        const bool looked_at = lw_scheduler_is_of_interest(scheduler, tile);
        if (scheduler->scope != LW_SCHEDULER_EVERYTHING)
            scheduler->weight[tile->id.v] =
                looked_at ? WEIGHT_INTEREST
                : period  ? contributor_weight(scheduler->importance[tile->id.v], period)
                          : 0;
        if (!tile->covered_count) continue;
        scheduler->count.interest += looked_at;
        scheduler->count.contributing += !looked_at && period;
        tile->waiting = tile->state != LW_BLOCK_CONVERGED &&
                        (tile->sample_count == 0 ||
                         (period && is_turn(scheduler, tile, rounds_of(scheduler, tile, period))));
    }
    scheduler->frames = 0;
}

/* What has changed most first: for as many texels it is the most to see. */
enum rank { INVALIDATED_MOST, INVALIDATED_MORE, INVALIDATED_LESS, INVALIDATED_CONTRIBUTOR, STALE, OTHER };
/* Mean square of the share of light that has changed. */
#define MOST 0.25f
#define MORE 0.0625f

static enum rank rank_of(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile) {
    if (!tile->invalidated) return tile->state == LW_BLOCK_STALE ? STALE : OTHER;
    if (!(tile->priority > 0)) return STALE;
    if (!lw_scheduler_is_of_interest(scheduler, tile)) return INVALIDATED_CONTRIBUTOR;
    return tile->priority >= MOST   ? INVALIDATED_MOST
           : tile->priority >= MORE ? INVALIDATED_MORE
                                    : INVALIDATED_LESS;
}

/* Of tiles that wait, takes those of a rank, up to `texels` texels. Of invalidated tiles it takes their
 * invalidated blocks alone, if time is short. */
static void take(const struct lw_scheduler *scheduler, struct lw_tiles *tiles, enum rank rank,
                 uint64_t texels, uint64_t *taken) {
    const bool only_invalidated = rank < STALE && texels != UINT64_MAX;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        if (!(tile->waiting || tile->invalidated) || tile->work || tile->state == LW_BLOCK_CONVERGED ||
            rank_of(scheduler, tile) != rank)
            continue;
        const uint32_t count = only_invalidated ? tile->invalidated_count : tile->covered_count;
        if (!texels || (*taken && *taken + count > texels)) continue;
        tile->work = only_invalidated ? LW_TILE_WORK_INVALIDATED : LW_TILE_WORK_ALL;
        *taken += count;
    }
}

/* Takes what the frame solves of what waits. */
static void take_all(const struct lw_scheduler *scheduler, struct lw_tiles *tiles,
                     struct lw_scheduler_room room) {
    uint64_t taken = 0;
    for (uint32_t i = 0; i < tiles->count; i++) tiles->tile[i].work = LW_TILE_WORK_NONE;
    for (enum rank rank = INVALIDATED_MOST; rank <= INVALIDATED_CONTRIBUTOR; rank++)
        take(scheduler, tiles, rank, room.invalidated, &taken);
    take(scheduler, tiles, STALE, room.all, &taken);
    take(scheduler, tiles, OTHER, room.all, &taken);
}

struct lw_scheduler_room lw_scheduler_room_left(const struct lw_scheduler *scheduler,
                                                const struct lw_tiles *tiles,
                                                const struct lw_scheduler_frame *frame, double spent) {
    if (!lw_scheduler_mode_is_limited(frame->mode)) return (struct lw_scheduler_room){UINT64_MAX, UINT64_MAX};
    const double left = fmax(1 - spent, SOLVING_SHARE);
    const uint64_t texels = 1 + (uint64_t)(left * (double)frame->budget.solve) / LW_BUDGET_SOLVE;
    const bool yields = frame->mode == LW_SCHEDULER_YIELD;
    bool waits = yields;
    for (uint32_t i = 0; i < tiles->count && frame->mode == LW_SCHEDULER_ONSET && !waits; i++)
        waits = scheduler->moves && tiles->tile[i].contributes && tiles->tile[i].unverified;
    return (struct lw_scheduler_room){yields ? 0 : texels, waits ? 0 : texels};
}

void lw_scheduler_choose(struct lw_scheduler *scheduler, struct lw_tiles *tiles,
                         struct lw_scheduler_room room, struct lw_scheduler_count *out_count) {
    if (scheduler->ended) begin_round(scheduler, tiles);
    scheduler->frames++;
    take_all(scheduler, tiles, room);
    struct lw_scheduler_count count = scheduler->count;
    scheduler->ended = true;
    scheduler->backlog = scheduler->solved_first = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        tile->invalidated &= !tile->work && tile->state != LW_BLOCK_CONVERGED;
        tile->waiting &= tile->work != LW_TILE_WORK_ALL;
        scheduler->ended &= !tile->waiting && !tile->invalidated;
        if (tile->invalidated && STALE - rank_of(scheduler, tile) > scheduler->backlog)
            scheduler->backlog = STALE - rank_of(scheduler, tile);
        count.due += tile->work != LW_TILE_WORK_NONE;
        scheduler->solved_first += tile->work == LW_TILE_WORK_INVALIDATED;
    }
    const bool held = scheduler->held == LW_SCHEDULER_HELD,
               whole = scheduler->ended || (held && !scheduler->solved_first);
    if (held && whole) scheduler->held = LW_SCHEDULER_RELEASED;
    if (!held) scheduler->held = LW_SCHEDULER_NOTHING_HELD;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const bool in_turn = lw_scheduler_is_of_interest(scheduler, tile) || tile->sample_count == 0 ||
                             tile->begins || shows_contributors(scheduler, tile->object);
        /* Once all has converged, all may be seen. */
        tile->shows = (count.due == 0 && scheduler->ended) ||
                      (in_turn && (whole || tile->work == LW_TILE_WORK_INVALIDATED));
    }
    *out_count = count;
}

void lw_scheduler_put_off(struct lw_scheduler *scheduler, struct lw_tiles *tiles) {
    if (scheduler->held != LW_SCHEDULER_NOTHING_HELD) return;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->shows && tile->work != LW_TILE_WORK_INVALIDATED) scheduler->held = LW_SCHEDULER_HELD;
        tile->shows &= tile->work == LW_TILE_WORK_INVALIDATED;
    }
}

static void note_hit(struct lw_scheduler *scheduler, const struct lw_tiles *tiles, uint32_t texel,
                     uint32_t weight) {
    __atomic_fetch_add(&scheduler->hits[tiles->block[tiles->block_of_texel[texel]].tile_id], weight,
                       __ATOMIC_RELAXED);
}

void lw_scheduler_note_hits(struct lw_scheduler *scheduler, const struct lw_transport *passes,
                            const struct lw_solve_tile *tile) {
    const struct lw_tiles *tiles = passes->tiles;
    if (!scheduler->watched) return;
    const uint32_t weight = scheduler->weight[tile->id.v];
    if (!weight) return;
    for (uint32_t i = scheduler->round % COUNT_ONE_IN; i < tile->width * tile->height; i += COUNT_ONE_IN) {
        const uint32_t texel = tile->first + i;
        if (!tiles->covered[texel]) continue;
        for (uint32_t s = 0; s < scheduler->samples; s++) {
            const uint32_t hit = passes->ray_hit[(size_t)texel * scheduler->samples + s];
            if (!(hit & LW_RAY_HIT_PROBE)) note_hit(scheduler, tiles, hit, weight); /* or nothing */
        }
        if (passes->reflected[texel].weight > 0)
            note_hit(scheduler, tiles, passes->reflected[texel].texel, weight);
    }
}
