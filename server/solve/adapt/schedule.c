#include "server/solve/adapt/schedule.h"

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

void lw_schedule_init(struct lw_schedule *schedule, uint32_t ids, uint32_t indirect_samples) {
    *schedule =
        (struct lw_schedule){.everything = true, .ended = true, .ids = ids, .samples = indirect_samples};
}

static void forget(struct lw_schedule *schedule) {
    free(schedule->wanted);
    free(schedule->ends);
    free(schedule->weight);
    free(schedule->readings);
    schedule->wanted = NULL;
    schedule->ends = NULL;
    schedule->readings = NULL;
    schedule->weight = NULL;
}

void lw_schedule_finish(struct lw_schedule *schedule) { forget(schedule); }

static bool allocate(struct lw_schedule *schedule) {
    schedule->wanted = calloc((size_t)schedule->ids + 1, sizeof *schedule->wanted);
    schedule->ends = calloc((size_t)schedule->ids + 1, sizeof *schedule->ends);
    schedule->readings = calloc((size_t)schedule->ids + 1, sizeof *schedule->readings);
    schedule->weight = calloc((size_t)schedule->ids + 1, sizeof *schedule->weight);
    return schedule->wanted && schedule->ends && schedule->readings && schedule->weight;
}

enum lw_status lw_schedule_want(struct lw_schedule *schedule, const uint8_t *wanted) {
    schedule->everything |= wanted == NULL;
    if (!wanted) return LW_OK;
    if (!schedule->wanted && !allocate(schedule)) {
        forget(schedule);
        return LW_NO_MEMORY;
    }
    memcpy(schedule->wanted, wanted, schedule->ids);
    schedule->everything = schedule->looked_at = false;
    for (uint32_t id = 0; id < schedule->ids; id++) schedule->looked_at |= wanted[id] != 0;
    return LW_OK;
}

/* Frames from one solve of a tile that is not looked at, but lights what is, to the next. */
static uint32_t feeding_period(float readings) {
    return readings >= 2 ? 2 : readings >= 0.5f ? 4 : readings >= 0.125f ? 8 : LW_SCHEDULE_PERIOD_MAX;
}

/* What its rays count for, when it is solved once in `period` frames: in the mean, what it is read for itself. (Counted
 * for more, tiles that nobody looks at would keep each other awake.) */
static uint16_t feeding_weight(float readings, uint32_t period) {
    return (uint16_t)fminf(PASSED_ON * readings * (float)(WEIGHT_WANTED * period), WEIGHT_MAX);
}

/* Where tiles of one period would all be due at once, some are each frame; but one that is too old is at once. */
static bool is_turn(const struct lw_schedule *schedule, const struct lw_solve_tile *tile, uint32_t period) {
    return schedule->tick - tile->solved_tick >= period ||
           ((schedule->tick + lw_random_hash(tile->id.v)) & (period - 1)) == 0;
}

/* What lights what is looked at is itself on show in coarse levels alone, which may be old: one frame in so many, all of an
 * object at once, so that what is welded together shows together. */
static bool shows_unwanted(const struct lw_schedule *schedule, uint32_t object) {
    return ((schedule->tick + lw_random_hash(object)) & (LW_SCHEDULE_PERIOD_MAX - 1)) == 0;
}

static void take_readings(struct lw_schedule *schedule, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        const float own = (float)tile->covered_count * (float)schedule->samples *
                          ((float)WEIGHT_WANTED / (float)COUNT_ONE_IN);
        float *readings = &schedule->readings[tile->id.v];
        if (own > 0)
            *readings += ((float)schedule->ends[tile->id.v] / own - *readings) * (1 / READINGS_MEMORY);
    }
    memset(schedule->ends, 0, schedule->ids * sizeof *schedule->ends);
}

/* Whether something that is looked at does not rest, or the light has changed of what lights it. */
static bool is_watched(const struct lw_schedule *schedule, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (!tile->resting && (schedule->wanted[tile->id.v] || (tile->stale && tile->serves))) return true;
    }
    return false;
}

void lw_schedule_serve(const struct lw_schedule *schedule, struct lw_tiles *tiles, bool feeds_all) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        tile->serves =
            tile->covered_count && !tile->hidden &&
            (schedule->everything || schedule->wanted[tile->id.v] ||
             (schedule->looked_at && (feeds_all || schedule->readings[tile->id.v] >= READINGS_MIN)));
    }
}

/* Of a tile that is to be solved: frames until it is again; 0: it is not looked at, and lights nothing that is. */
static uint32_t period_of(const struct lw_schedule *schedule, const struct lw_solve_tile *tile) {
    if (schedule->everything) return 1;
    const uint32_t wanted = schedule->wanted[tile->id.v];
    if (wanted) return 1u << (wanted - 1 < PERIOD_LOG_MAX ? wanted - 1 : PERIOD_LOG_MAX);
    return schedule->watched && tile->serves ? feeding_period(schedule->readings[tile->id.v]) : 0;
}

/* Rounds that take many frames are no reason to show what is out of date so many times later. */
static uint32_t rounds_of(const struct lw_schedule *schedule, const struct lw_solve_tile *tile,
                          uint32_t period) {
    while (tile->stale && period > 1 && period * schedule->frames > LW_SCHEDULE_PERIOD_MAX) period /= 2;
    return period;
}

static void begin_round(struct lw_schedule *schedule, struct lw_tiles *tiles) {
    schedule->tick++;
    schedule->count = (struct lw_schedule_count){0};
    if (schedule->watched) take_readings(schedule, tiles);
    schedule->watched = !schedule->everything && is_watched(schedule, tiles);
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t period = period_of(schedule, tile);
        const bool looked_at = lw_schedule_looks_at(schedule, tile);
        if (!schedule->everything)
            schedule->weight[tile->id.v] = looked_at ? WEIGHT_WANTED
                                           : period  ? feeding_weight(schedule->readings[tile->id.v], period)
                                                     : 0;
        if (!tile->covered_count) continue;
        schedule->count.wanted += looked_at;
        schedule->count.feeding += !looked_at && period;
        tile->waiting =
            !tile->resting &&
            (tile->frames == 0 || (period && is_turn(schedule, tile, rounds_of(schedule, tile, period))));
    }
    schedule->frames = 0;
}

/* What has changed most first: for as many texels it is the most to see. */
enum rank { WOKEN_MOST, WOKEN_MORE, WOKEN_LESS, WOKEN_UNSEEN, STALE, OTHER };
/* Mean square of the share of light that has changed. */
#define MOST 0.25f
#define MORE 0.0625f

static enum rank rank_of(const struct lw_schedule *schedule, const struct lw_solve_tile *tile) {
    if (!tile->woken) return tile->stale ? STALE : OTHER;
    if (!(tile->urgency > 0)) return STALE;
    if (!lw_schedule_looks_at(schedule, tile)) return WOKEN_UNSEEN;
    return tile->urgency >= MOST ? WOKEN_MOST : tile->urgency >= MORE ? WOKEN_MORE : WOKEN_LESS;
}

/* Of tiles that wait, takes those of a rank until there are so many texels; of those that have woken, the blocks that have, if time is
 * short. */
static void take(const struct lw_schedule *schedule, struct lw_tiles *tiles, enum rank rank, uint64_t texels,
                 uint64_t *taken) {
    const bool urgent = rank < STALE && texels != UINT64_MAX;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        if (!(tile->waiting || tile->woken) || tile->due || tile->resting || rank_of(schedule, tile) != rank)
            continue;
        const uint32_t count = urgent ? tile->woken_count : tile->covered_count;
        if (!texels || (*taken && *taken + count > texels)) continue;
        tile->due = true;
        tile->urgent = urgent;
        *taken += count;
    }
}

/* Takes what the frame solves of what waits. */
static void take_all(const struct lw_schedule *schedule, struct lw_tiles *tiles,
                     struct lw_schedule_room room) {
    uint64_t taken = 0;
    for (uint32_t i = 0; i < tiles->count; i++) tiles->tile[i].due = tiles->tile[i].urgent = false;
    for (enum rank rank = WOKEN_MOST; rank <= WOKEN_UNSEEN; rank++)
        take(schedule, tiles, rank, room.woken, &taken);
    take(schedule, tiles, STALE, room.all, &taken);
    take(schedule, tiles, OTHER, room.all, &taken);
}

void lw_schedule_choose(struct lw_schedule *schedule, struct lw_tiles *tiles, struct lw_schedule_room room,
                        struct lw_schedule_count *out_count) {
    if (schedule->ended) begin_round(schedule, tiles);
    schedule->frames++;
    take_all(schedule, tiles, room);
    struct lw_schedule_count count = schedule->count;
    schedule->ended = true;
    schedule->hurry = schedule->urgent = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        tile->woken &= !tile->due && !tile->resting;
        tile->waiting &= !tile->due || tile->urgent;
        schedule->ended &= !tile->waiting && !tile->woken;
        if (tile->woken && STALE - rank_of(schedule, tile) > schedule->hurry)
            schedule->hurry = STALE - rank_of(schedule, tile);
        count.due += tile->due;
        schedule->urgent += tile->urgent;
    }
    const bool whole = schedule->ended || (schedule->owing && !schedule->urgent);
    schedule->owed = schedule->owing;
    schedule->owing &= !whole;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const bool in_turn = lw_schedule_looks_at(schedule, tile) || tile->frames == 0 || tile->begins ||
                             shows_unwanted(schedule, tile->object);
        /* At rest all may be seen. */
        tile->shows = (count.due == 0 && schedule->ended) || (in_turn && (whole || tile->urgent));
    }
    *out_count = count;
}

void lw_schedule_put_off(struct lw_schedule *schedule, struct lw_tiles *tiles) {
    if (schedule->owed) return;
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        schedule->owing |= tile->shows && !tile->urgent;
        tile->shows &= tile->urgent;
    }
}

void lw_schedule_note_hits(struct lw_schedule *schedule, const struct lw_tiles *tiles,
                           const struct lw_solve_tile *tile, const uint32_t *end) {
    if (!schedule->watched) return;
    const uint32_t weight = schedule->weight[tile->id.v];
    if (!weight) return;
    for (uint32_t i = schedule->tick % COUNT_ONE_IN; i < tile->width * tile->height; i += COUNT_ONE_IN) {
        const uint32_t texel = tile->first + i;
        if (!tiles->covered[texel]) continue;
        for (uint32_t s = 0; s < schedule->samples; s++) {
            const uint32_t e = end[(size_t)texel * schedule->samples + s];
            if (e == LW_RAY_HIT_NOTHING || e & LW_RAY_HIT_PROBE) continue;
            __atomic_fetch_add(&schedule->ends[tiles->block[tiles->block_of_texel[e]].tile_id], weight,
                               __ATOMIC_RELAXED);
        }
    }
}

size_t lw_schedule_memory_bytes(const struct lw_schedule *schedule) {
    return schedule->wanted ? (size_t)schedule->ids * 11 : 0;
}
