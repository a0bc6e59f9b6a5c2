#include "server/solve/adapt/scheduler.h"

#include "common/random.h"
#include "server/solve/transport/ray_hit.h"

#include <stdlib.h>
#include <string.h>

/* One texel in so many has its rays counted, in turn. Odd: it goes through all columns of a tile. */
#define COUNT_ONE_IN 9u
/* What the end of a ray counts for that a tile shoots which is looked at. */
#define WEIGHT_WANTED 256u
#define WEIGHT_MAX    UINT16_MAX
/* Of what a tile is read for, so much is for the light that it gets from others: less with every bounce, as albedos. */
#define PASSED_ON 0.5f
/* The running mean of the readings remembers about so many frames. */
#define READINGS_MEMORY 8.0f
/* Fewer readings than this light nothing that can be seen: a thousandth of what a tile gets in a scene all in view. */
#define READINGS_MIN 0.001f
/* Of the coarsest levels that are looked at; farther ones keep up with what moves as these do. */
#define PERIOD_LOG_MAX 3u

void lw_scheduler_forget_interest(struct lw_scheduler *scheduler) {
    free(scheduler->wanted);
    free(scheduler->hits);
    free(scheduler->weight);
    free(scheduler->importance);
    scheduler->wanted = NULL;
    scheduler->hits = NULL;
    scheduler->importance = NULL;
    scheduler->weight = NULL;
}

static bool allocate(struct lw_scheduler *scheduler) {
    scheduler->wanted = calloc((size_t)scheduler->ids + 1, sizeof *scheduler->wanted);
    scheduler->hits = calloc((size_t)scheduler->ids + 1, sizeof *scheduler->hits);
    scheduler->importance = calloc((size_t)scheduler->ids + 1, sizeof *scheduler->importance);
    scheduler->weight = calloc((size_t)scheduler->ids + 1, sizeof *scheduler->weight);
    return scheduler->wanted && scheduler->hits && scheduler->importance && scheduler->weight;
}

size_t lw_scheduler_interest_bytes(const struct lw_scheduler *scheduler) {
    if (!scheduler->wanted) return 0;
    return scheduler->ids * (sizeof *scheduler->wanted + sizeof *scheduler->hits +
                             sizeof *scheduler->importance + sizeof *scheduler->weight);
}

enum lw_status lw_scheduler_set_interest(struct lw_scheduler *scheduler, const uint8_t *wanted) {
    if (!wanted) {
        scheduler->scope = LW_SCHEDULER_EVERYTHING;
        return LW_OK;
    }
    if (!scheduler->wanted && !allocate(scheduler)) {
        lw_scheduler_forget_interest(scheduler);
        return LW_NO_MEMORY;
    }
    memcpy(scheduler->wanted, wanted, scheduler->ids);
    scheduler->scope = LW_SCHEDULER_NOTHING;
    for (uint32_t id = 0; id < scheduler->ids; id++)
        if (wanted[id]) scheduler->scope = LW_SCHEDULER_TILES;
    return LW_OK;
}

/* Frames from one solve of a tile that is not looked at, but lights what is, to the next. */
static uint32_t feeding_period(float readings) {
    return readings >= 2 ? 2 : readings >= 0.5f ? 4 : readings >= 0.125f ? 8 : LW_SCHEDULER_PERIOD_MAX;
}

/* What its rays count for, when it is solved once in `period` frames: in the mean, what it is read for itself. (Counted
 * for more, tiles that nobody looks at would keep each other awake.) */
static uint16_t feeding_weight(float readings, uint32_t period) {
    return (uint16_t)fminf(PASSED_ON * readings * (float)(WEIGHT_WANTED * period), WEIGHT_MAX);
}

/* Where tiles of one period would all be due at once, some are each frame; but one that is too old is at once. */
static bool is_turn(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile, uint32_t period) {
    return scheduler->round - tile->solved_tick >= period ||
           ((scheduler->round + lw_random_hash(tile->id.v)) & (period - 1)) == 0;
}

/* What lights what is looked at is itself on show in coarse levels alone, which may be old: one frame in so many, all of an
 * object at once, so that what is welded together shows together. */
static bool shows_unwanted(const struct lw_scheduler *scheduler, uint32_t object) {
    return ((scheduler->round + lw_random_hash(object)) & (LW_SCHEDULER_PERIOD_MAX - 1)) == 0;
}

static void take_readings(struct lw_scheduler *scheduler, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        const float own = (float)tile->covered_count * (float)scheduler->samples *
                          ((float)WEIGHT_WANTED / (float)COUNT_ONE_IN);
        float *readings = &scheduler->importance[tile->id.v];
        if (own > 0)
            *readings += ((float)scheduler->hits[tile->id.v] / own - *readings) * (1 / READINGS_MEMORY);
    }
    memset(scheduler->hits, 0, scheduler->ids * sizeof *scheduler->hits);
}

/* Whether something that is looked at does not rest, or the light has changed of what lights it. */
static bool is_watched(const struct lw_scheduler *scheduler, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->state != LW_BLOCK_CONVERGED &&
            (scheduler->wanted[tile->id.v] || (tile->state == LW_BLOCK_STALE && tile->serves)))
            return true;
    }
    return false;
}

void lw_scheduler_find_contributors(const struct lw_scheduler *scheduler, struct lw_tiles *tiles,
                                    bool feeds_all) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        tile->serves = tile->covered_count && !tile->hidden &&
                       (lw_scheduler_is_of_interest(scheduler, tile) ||
                        (scheduler->scope == LW_SCHEDULER_TILES &&
                         (feeds_all || scheduler->importance[tile->id.v] >= READINGS_MIN)));
    }
}

/* Of a tile that is to be solved: frames until it is again; 0: it is not looked at, and lights nothing that is. */
static uint32_t period_of(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile) {
    if (scheduler->scope == LW_SCHEDULER_EVERYTHING) return 1;
    const uint32_t wanted = scheduler->wanted[tile->id.v];
    if (wanted) return 1u << (wanted - 1 < PERIOD_LOG_MAX ? wanted - 1 : PERIOD_LOG_MAX);
    return scheduler->watched && tile->serves ? feeding_period(scheduler->importance[tile->id.v]) : 0;
}

/* Rounds that take many frames are no reason to show what is out of date so many times later. */
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
    if (scheduler->watched) take_readings(scheduler, tiles);
    scheduler->watched = scheduler->scope != LW_SCHEDULER_EVERYTHING && is_watched(scheduler, tiles);
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t period = period_of(scheduler, tile);
        const bool looked_at = lw_scheduler_is_of_interest(scheduler, tile);
        if (scheduler->scope != LW_SCHEDULER_EVERYTHING)
            scheduler->weight[tile->id.v] = looked_at ? WEIGHT_WANTED
                                            : period
                                                ? feeding_weight(scheduler->importance[tile->id.v], period)
                                                : 0;
        if (!tile->covered_count) continue;
        scheduler->count.wanted += looked_at;
        scheduler->count.feeding += !looked_at && period;
        tile->waiting =
            tile->state != LW_BLOCK_CONVERGED &&
            (tile->frames == 0 || (period && is_turn(scheduler, tile, rounds_of(scheduler, tile, period))));
    }
    scheduler->frames = 0;
}

/* What has changed most first: for as many texels it is the most to see. */
enum rank { WOKEN_MOST, WOKEN_MORE, WOKEN_LESS, WOKEN_UNSEEN, STALE, OTHER };
/* Mean square of the share of light that has changed. */
#define MOST 0.25f
#define MORE 0.0625f

static enum rank rank_of(const struct lw_scheduler *scheduler, const struct lw_solve_tile *tile) {
    if (!tile->woken) return tile->state == LW_BLOCK_STALE ? STALE : OTHER;
    if (!(tile->urgency > 0)) return STALE;
    if (!lw_scheduler_is_of_interest(scheduler, tile)) return WOKEN_UNSEEN;
    return tile->urgency >= MOST ? WOKEN_MOST : tile->urgency >= MORE ? WOKEN_MORE : WOKEN_LESS;
}

/* Of tiles that wait, takes those of a rank until there are so many texels; of those that have woken, the blocks that have, if time is
 * short. */
static void take(const struct lw_scheduler *scheduler, struct lw_tiles *tiles, enum rank rank,
                 uint64_t texels, uint64_t *taken) {
    const bool urgent = rank < STALE && texels != UINT64_MAX;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        if (!(tile->waiting || tile->woken) || tile->work || tile->state == LW_BLOCK_CONVERGED ||
            rank_of(scheduler, tile) != rank)
            continue;
        const uint32_t count = urgent ? tile->woken_count : tile->covered_count;
        if (!texels || (*taken && *taken + count > texels)) continue;
        tile->work = urgent ? LW_TILE_WORK_INVALIDATED : LW_TILE_WORK_ALL;
        *taken += count;
    }
}

/* Takes what the frame solves of what waits. */
static void take_all(const struct lw_scheduler *scheduler, struct lw_tiles *tiles,
                     struct lw_scheduler_room room) {
    uint64_t taken = 0;
    for (uint32_t i = 0; i < tiles->count; i++) tiles->tile[i].work = LW_TILE_WORK_NONE;
    for (enum rank rank = WOKEN_MOST; rank <= WOKEN_UNSEEN; rank++)
        take(scheduler, tiles, rank, room.woken, &taken);
    take(scheduler, tiles, STALE, room.all, &taken);
    take(scheduler, tiles, OTHER, room.all, &taken);
}

void lw_scheduler_choose(struct lw_scheduler *scheduler, struct lw_tiles *tiles,
                         struct lw_scheduler_room room, struct lw_scheduler_count *out_count) {
    if (scheduler->ended) begin_round(scheduler, tiles);
    scheduler->frames++;
    take_all(scheduler, tiles, room);
    struct lw_scheduler_count count = scheduler->count;
    scheduler->ended = true;
    scheduler->backlog = scheduler->urgent = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        tile->woken &= !tile->work && tile->state != LW_BLOCK_CONVERGED;
        tile->waiting &= tile->work != LW_TILE_WORK_ALL;
        scheduler->ended &= !tile->waiting && !tile->woken;
        if (tile->woken && STALE - rank_of(scheduler, tile) > scheduler->backlog)
            scheduler->backlog = STALE - rank_of(scheduler, tile);
        count.due += tile->work != LW_TILE_WORK_NONE;
        scheduler->urgent += tile->work == LW_TILE_WORK_INVALIDATED;
    }
    const bool held = scheduler->held == LW_SCHEDULER_HELD,
               whole = scheduler->ended || (held && !scheduler->urgent);
    if (held && whole) scheduler->held = LW_SCHEDULER_RELEASED;
    if (!held) scheduler->held = LW_SCHEDULER_NOTHING_HELD;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const bool in_turn = lw_scheduler_is_of_interest(scheduler, tile) || tile->frames == 0 ||
                             tile->begins || shows_unwanted(scheduler, tile->object);
        /* At rest all may be seen. */
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

void lw_scheduler_note_hits(struct lw_scheduler *scheduler, const struct lw_tiles *tiles,
                            const struct lw_solve_tile *tile, const uint32_t *end) {
    if (!scheduler->watched) return;
    const uint32_t weight = scheduler->weight[tile->id.v];
    if (!weight) return;
    for (uint32_t i = scheduler->round % COUNT_ONE_IN; i < tile->width * tile->height; i += COUNT_ONE_IN) {
        const uint32_t texel = tile->first + i;
        if (!tiles->covered[texel]) continue;
        for (uint32_t s = 0; s < scheduler->samples; s++) {
            const uint32_t e = end[(size_t)texel * scheduler->samples + s];
            if (e == LW_RAY_HIT_NOTHING || e & LW_RAY_HIT_PROBE) continue;
            __atomic_fetch_add(&scheduler->hits[tiles->block[tiles->block_of_texel[e]].tile_id], weight,
                               __ATOMIC_RELAXED);
        }
    }
}
