/* plan.h: what a frame verifies, corrects, solves and shows: four lists of tiles, with a reason for each.
 * Flow:    facts of tiles, movements, a budget, memory of earlier plans -> [plan] -> lists -> frame
 * Threads: pure functions of their arguments, [any]. No ray, no clock, no light; nothing is written but the
 *          plan and its memory.
 *
 * A frame plans three times: before it verifies, before it lights (by what verification has found), and
 * before it shows. docs/change.md draws the states of a block and says what each field of the memory is for.
 *
 * Interest. A tile that is seen from level k is solved every 2^k-th round: a texel of that level is the mean
 * of 4^k. A tile of no interest is solved as often as its importance asks (interest_set.h): its noise is
 * averaged over its readers, so its age counts. Tiles of no importance are not solved; nor is anything once
 * all tiles of interest have converged. A tile that was never solved is solved once in any case: rays must
 * not hit a place without light.
 *
 * Rounds. All tiles to solve make a round. A frame takes as many of them as its budget allows, and a round
 * is shown together at its end, filtered and welded once. Invalidated blocks are solved before all else,
 * those of the highest priority first, and shown at once. Without a budget a round is a frame.
 *
 * Movement. At an onset all of the interest set is verified as fast as the budget allows, nearest first. What
 * was corrected sends out other light: as many frames as there are bounces then read all rays again
 * (rereads), so that the change arrives without a solve. While lights keep moving there is no time for that:
 * a share of each frame goes round the interest set and corrects it, which is shown once it is through. */
#ifndef LW_ADAPT_PLAN_H
#define LW_ADAPT_PLAN_H

#include "server/solve/adapt/gradient.h"

/* A contributor is solved at least once in this many rounds. */
#define LW_PLAN_PERIOD_MAX 16u

#define LW_PLAN_REASONS(X)                                                                                   \
    X(MOVED, "moved")             /* verify: something has moved since it was verified last */               \
    X(TURN, "turn")               /* verify: nothing has; its blocks take their turns */                     \
    X(SWEPT, "swept")             /* correct: lights keep moving */                                          \
    X(CHANGED_MOST, "most")       /* solve: half of its light or more has changed */                         \
    X(CHANGED_MORE, "more")       /* a quarter or more */                                                    \
    X(CHANGED_LESS, "less")       /* some */                                                                 \
    X(CHANGED_BESIDE, "beside")   /* some, of a tile that nobody looks at */                                 \
    X(STALE, "stale")             /* means that are out of date */                                           \
    X(NOISY, "noisy")             /* neither: samples are missing */                                         \
    X(ROUND_ENDED, "round ended") /* show: all of the round was solved */                                    \
    X(AT_ONCE, "at once")         /* show: it has changed, or was corrected */

enum lw_plan_reason {
#define LW_PLAN_REASON(name, text) LW_PLAN_##name,
    LW_PLAN_REASONS(LW_PLAN_REASON)
#undef LW_PLAN_REASON
        LW_PLAN_REASON_COUNT
};

/* A tile as a plan sees it; filled in by who asks for the plan. */
struct lw_plan_fact {
    lw_tile_id id;
    uint32_t owner; /* the rank that solves it; 0 on one machine */
    uint32_t object, covered_count, sample_count;
    uint32_t invalidated_count;         /* texels of invalidated blocks */
    float priority;                     /* mean square over those of the share of light that has changed */
    float importance;                   /* (interest_set.h) */
    float distance_m;                   /* to what moved last; -1: it moved itself. Read under a budget */
    uint64_t verify_work, correct_work; /* (budget.h), of all its blocks. Read under a budget */
    uint8_t level;                      /* 0: nobody looks; else 1 + the finest level of interest */
    uint8_t state;                      /* enum lw_block_state */
    bool hidden, contributes, invalidated;
    bool begins;    /* it starts again, and nothing of it has been shown since */
    bool corrected; /* in this frame */
    bool unseen;    /* a block has light that was not shown. Read by lw_plan_show(), of corrected tiles or
                     * at the end of a sweep */
};

/* What a plan remembers of a tile. */
struct lw_plan_tile {
    uint32_t solved_round;
    uint16_t weight; /* what a hit of its rays counts for in this round (interest_set.h) */
    bool waiting;    /* the round under way has yet to solve it */
    bool unverified; /* since something moved last */
    bool hidden;     /* as the last plan saw it */
    uint8_t work;    /* enum lw_tile_work, in this frame */
    bool shows;      /* its light is visible in this frame, not merely read by other tiles */
};

/* What a plan remembers. */
struct lw_plan_memory {
    struct lw_plan_tile *tile; /* per lw_tile_id */
    uint32_t ids;

    /* -- the round -- */
    uint32_t round;        /* counts them; periods and ages are measured in it */
    uint32_t frames;       /* so far, in the round under way */
    bool ended;            /* the next frame begins another */
    bool watched;          /* some tile of interest was not converged as it began */
    uint32_t interest;     /* tiles of interest, as it began */
    uint32_t contributing; /* tiles that contribute, as it began */
    bool deferred;         /* it has ended and was not shown: somebody waits for the end of the frame */
    bool released;         /* this frame shows the deferred tiles: they are not deferred twice */

    /* -- after a movement -- */
    uint32_t rereads;          /* frames that are yet to read the light along all ray hits again */
    bool solved_changed;       /* invalidated blocks were solved since the last rereads began */
    uint32_t changed_solves;   /* tiles that the last frame solved because they were invalidated */
    unsigned changed_left;     /* 0: no invalidated tile is left; else more, the more its light has changed */
    uint32_t corrected;        /* tiles, in the last frame */
    uint32_t still_rounds;     /* since something was solved */
    uint32_t unchanged_rounds; /* since any block that contributes was stale */

    /* -- while lights keep moving -- */
    uint32_t swept; /* tiles up to which the interest set has been corrected; 0: no sweep is under way */
    uint32_t sweep_moves; /* movements of lights, as the sweep began */
    bool sweep_ended;     /* in this frame */
};

/* Movements (motion.h). */
struct lw_plan_moves {
    uint32_t moves, began, light_moves;
    bool shone;
};

struct lw_plan_input {
    const struct lw_plan_fact *fact; /* of all tiles, in the order in which they are lit */
    uint32_t count;
    struct lw_plan_moves moves;
    struct lw_budget budget;
    double spent;    /* lw_plan_light(): of the budget, the share that verification has taken */
    bool everything; /* is of interest; else by fact.level */
    bool looked_at;  /* anything is */
    bool lights_all; /* lw_plan_light(): the first frame, whatever its budget */
    bool awaited;    /* lw_plan_show(): somebody waits for the end of the frame */
    uint32_t bounces;
};

struct lw_plan_entry {
    lw_tile_id id;
    uint8_t reason; /* enum lw_plan_reason */
    bool part;      /* solve: its invalidated blocks alone */
};

struct lw_plan_list {
    struct lw_plan_entry *entry;
    uint32_t count;
};

struct lw_plan {
    struct lw_plan_list verify, correct, solve, show;
    uint32_t capacity; /* each list's, in tiles */
    /* Entries of verify that are verified in any case; the rest if these have found no change. */
    uint32_t verify_sure;
    uint64_t verify_work[2]; /* for the sure entries; for the rest */
    uint64_t correct_work;
    struct lw_gradient_round round; /* tests that a block gets */
    bool changing;                  /* light that others read may be changing in this frame */
    struct lw_plan_order {
        float rank;
        uint32_t slot;
    } * order;
};

/** Errors: LW_NO_MEMORY; finish them then. tiles: at most; ids: lw_tile_ids of the scene. */
LW_MUST_CHECK enum lw_status lw_plan_init(struct lw_plan *plan, uint32_t tiles);
LW_MUST_CHECK enum lw_status lw_plan_memory_init(struct lw_plan_memory *memory, uint32_t ids);
/** Zeroed ones are fine. */
void lw_plan_finish(struct lw_plan *plan);
void lw_plan_memory_finish(struct lw_plan_memory *memory);
/** Bytes that a plan and its memory hold. */
size_t lw_plan_bytes(uint32_t tiles, uint32_t ids);

const char *lw_plan_reason_name(enum lw_plan_reason reason);

/** Something has moved: all tiles are to be verified. */
void lw_plan_note_move(struct lw_plan_memory *memory);

/** Goes on where a checkpoint was saved, of a scene that has not changed since. */
void lw_plan_resume(struct lw_plan_memory *memory);

/** Tiles were judged again: converged ones may be so no more. */
void lw_plan_review(struct lw_plan_memory *memory);

/** What a frame asks of its blocks, which says how much work that is (lw_gradient_work()). */
struct lw_gradient_round lw_plan_round(const struct lw_plan_memory *memory, const struct lw_plan_input *in);

/** Whether a tile of interest is yet to be verified after the last movement. */
bool lw_plan_is_behind(const struct lw_plan_memory *memory, const struct lw_plan_input *in);

/** Plans verify and correct. */
void lw_plan_verify(struct lw_plan_memory *memory, const struct lw_plan_input *in, struct lw_plan *plan);

/* What verification has found. */
struct lw_plan_found {
    bool direct;       /* direct light was corrected */
    bool invalidated;  /* a tile is */
    uint32_t verified; /* entries of verify that were carried out */
};
void lw_plan_note_verified(struct lw_plan_memory *memory, const struct lw_plan_input *in,
                           const struct lw_plan *plan, const struct lw_plan_found *found);

/** Plans solve, and which tiles show their new light. At least one tile is solved, if any waits for which
 * there is room at all. */
void lw_plan_light(struct lw_plan_memory *memory, const struct lw_plan_input *in, struct lw_plan *plan);

/** Plans show. */
void lw_plan_show(struct lw_plan_memory *memory, const struct lw_plan_input *in, struct lw_plan *plan);

#endif
