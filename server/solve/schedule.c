#include "server/solve/schedule.h"

#include "common/random.h"
#include "server/solve/transport.h"

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
    *schedule = (struct lw_schedule){.everything = true, .ids = ids, .samples = indirect_samples};
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
 * object at once, since filter, seams and levels work by the object. */
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

static void choose_everything(struct lw_tiles *tiles, struct lw_schedule_count *count) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        tiles->tile[i].due = !tiles->tile[i].resting;
        tiles->tile[i].shows = true;
        count->due += tiles->tile[i].due;
        count->wanted += tiles->tile[i].covered_count > 0;
    }
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
            tile->covered_count &&
            (schedule->everything || schedule->wanted[tile->id.v] ||
             (schedule->looked_at && (feeds_all || schedule->readings[tile->id.v] >= READINGS_MIN)));
    }
}

void lw_schedule_choose(struct lw_schedule *schedule, struct lw_tiles *tiles,
                        struct lw_schedule_count *out_count) {
    struct lw_schedule_count count = {0};
    schedule->tick++;
    if (schedule->everything) {
        choose_everything(tiles, &count);
        schedule->watched = false;
        *out_count = count;
        return;
    }
    if (schedule->watched) take_readings(schedule, tiles);
    schedule->watched = is_watched(schedule, tiles);
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t wanted = schedule->wanted[tile->id.v];
        uint32_t period = 0;
        tile->due = false;
        schedule->weight[tile->id.v] = 0;
        if (!tile->covered_count) continue;
        if (wanted) {
            period = 1u << (wanted - 1 < PERIOD_LOG_MAX ? wanted - 1 : PERIOD_LOG_MAX);
            schedule->weight[tile->id.v] = WEIGHT_WANTED;
            count.wanted++;
        } else if (schedule->watched && tile->serves) {
            period = feeding_period(schedule->readings[tile->id.v]);
            schedule->weight[tile->id.v] = feeding_weight(schedule->readings[tile->id.v], period);
            count.feeding += period > 0;
        }
        tile->due = !tile->resting &&
                    (tile->frames == 0 || (period && (tile->woken || is_turn(schedule, tile, period))));
        tile->shows = wanted || tile->frames == 0 || shows_unwanted(schedule, tile->object);
        count.due += tile->due;
    }
    *out_count = count;
}

void lw_schedule_note_ends(struct lw_schedule *schedule, const struct lw_tiles *tiles,
                           const struct lw_solve_tile *tile, const uint32_t *end) {
    if (!schedule->watched) return;
    const uint32_t weight = schedule->weight[tile->id.v];
    if (!weight) return;
    for (uint32_t i = schedule->tick % COUNT_ONE_IN; i < tile->width * tile->height; i += COUNT_ONE_IN) {
        const uint32_t texel = tile->first + i;
        if (!tiles->covered[texel]) continue;
        for (uint32_t s = 0; s < schedule->samples; s++) {
            const uint32_t e = end[(size_t)texel * schedule->samples + s];
            if (e == LW_END_NOTHING || e & LW_END_PROBE) continue;
            __atomic_fetch_add(&schedule->ends[tiles->block[tiles->block_of_texel[e]].tile_id], weight,
                               __ATOMIC_RELAXED);
        }
    }
}

size_t lw_schedule_memory_bytes(const struct lw_schedule *schedule) {
    return schedule->wanted ? (size_t)schedule->ids * 11 : 0;
}
