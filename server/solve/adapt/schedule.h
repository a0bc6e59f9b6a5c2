/* schedule.h: which tiles a frame solves: those that somebody looks at, and, less often, those that light them.
 * Flow:    wanted tiles (sessions) -> [choose] -> passes; passes' bounce rays -> [note_ends] -> the next frame's choice
 * Threads: [solver]; note_ends is [any worker], the same counts in any order.
 *
 * A tile that is looked at from level k is solved every 2^k-th frame: a texel of that level is the mean of 4^k. A tile
 * that is not looked at is read wherever a bounce ray of a solved tile ends on it. Its readings, the rays that end on
 * it for each that it would shoot itself, decide how often it is solved: its noise is averaged over its readers, so the
 * question is how old its light may be. Tiles that nobody looks at and nobody reads are not solved; nor is anything
 * once all that is looked at rests. A tile that was never solved is solved once, whoever looks: there is no place
 * without light for rays to end on, and everything has a coarse level to show.
 *
 * What is to be solved makes a round. A frame takes of it what it has time for, first what has changed most lately; what
 * a round has solved is shown together at its end, filtered and welded once. But where blocks have found that their light has
 * changed (change.h), those are solved before all else, tiles in which it has most first, and shown at once. Without a limit of time a round is
 * a frame.
 *
 * The choice is a function of the wanted tiles and of the limits, frame by frame, and of nothing else: never of time or thread. */
#ifndef LW_ADAPT_SCHEDULE_H
#define LW_ADAPT_SCHEDULE_H

#include "server/solve/state/tiles.h"

/* A tile that lights what is looked at is solved every so many frames at least. */
#define LW_SCHEDULE_PERIOD_MAX 16u

struct lw_schedule_count {
    uint32_t due, wanted, feeding; /* tiles: solved in this frame; looked at; that light what is looked at */
};

struct lw_schedule {
    bool everything;  /* until somebody says otherwise; what follows is empty until then */
    bool looked_at;   /* something is, resting or not */
    bool watched;     /* in this frame, something that is looked at does not rest */
    bool ended;       /* the round has: the next frame begins another */
    bool owing, owed; /* what a round has solved was not shown at its end; before this frame */
    unsigned
        hurry; /* how much has changed of what has woken and the last frame had no time for; 0: there is nothing */
    uint32_t tick;   /* counts the rounds; period and age are measured in it */
    uint32_t urgent; /* tiles that the last frame solved because they had woken */
    uint32_t frames; /* of the round under way; of the last one, as one begins */
    uint8_t *wanted; /* per lw_tile_id: 0, or 1 + the finest level that is looked at */
    uint32_t *
        ends; /* per lw_tile_id: bounce rays of this frame that ended there, by weight, of those that are counted */
    uint16_t *weight; /* per lw_tile_id: what the end of one of its rays counts for in this frame */
    float *readings;  /* per lw_tile_id: running mean of rays that end there for each that it would shoot */
    uint32_t ids;     /* lw_tile_ids of the scene */
    uint32_t samples; /* bounce rays per texel */
    struct lw_schedule_count count; /* as the round began */
};

/* Texels that a frame has time for, about. */
struct lw_schedule_room {
    uint64_t woken, all; /* of what has woken; with what else waits */
};

void lw_schedule_init(struct lw_schedule *schedule, uint32_t ids, uint32_t indirect_samples);
void lw_schedule_finish(struct lw_schedule *schedule);

/** Takes what is looked at, from the next choice on. wanted: per lw_tile_id, as above; entries that are not of level 0
 * are not read; NULL: everything. Errors: LW_NO_MEMORY; the schedule is then as before. */
LW_MUST_CHECK enum lw_status lw_schedule_want(struct lw_schedule *schedule, const uint8_t *wanted);

/** Whether anybody looks at anything: else no light matters. */
static inline bool lw_schedule_is_looked_at(const struct lw_schedule *schedule) {
    return schedule->everything || schedule->looked_at;
}

/** Whether anybody looks at a tile. */
static inline bool lw_schedule_looks_at(const struct lw_schedule *schedule,
                                        const struct lw_solve_tile *tile) {
    return schedule->everything || schedule->wanted[tile->id.v];
}

/** Sets `serves` of every tile. feeds_all: rays end where texels cannot be counted (at probes), so that every tile may light what
 * is looked at. */
void lw_schedule_serve(const struct lw_schedule *schedule, struct lw_tiles *tiles, bool feeds_all);

/** Sets `due`, `urgent` and `shows` of every tile, for the frame that begins. At least one tile is due, if any waits for which there is
 * room at all. */
void lw_schedule_choose(struct lw_schedule *schedule, struct lw_tiles *tiles, struct lw_schedule_room room,
                        struct lw_schedule_count *out_count);

/** Leaves what need not be shown in this frame for the next one in which nothing is urgent, but not twice. */
void lw_schedule_put_off(struct lw_schedule *schedule, struct lw_tiles *tiles);

/** Counts a due tile's bounce rays. end: of the whole scene, `samples` words per texel (transport.h). */
void lw_schedule_note_hits(struct lw_schedule *schedule, const struct lw_tiles *tiles,
                           const struct lw_solve_tile *tile, const uint32_t *end);

size_t lw_schedule_memory_bytes(const struct lw_schedule *schedule);

#endif
