/* scheduler.h: what a frame verifies, corrects, solves and shows.
 * Flow:    interest, movement -> [verify] -> blocks corrected and invalidated -> [choose] -> passes -> [show]
 *          passes' bounce rays -> [note_hits] -> the importance of tiles, for the next round
 * Threads: [solver], with workers inside; note_hits is [any worker], the same counts in any order.
 *
 * States of a block and what moves it from one to another:
 *
 *     hidden ----object shown----> SAMPLED --error on target--> CONVERGED
 *                                   ^   |                        |    |
 *              nothing out of date  |   | out of date            |    | verified: as before, or corrected,
 *                                   |   v                        |    | and the error stays on target
 *                                  STALE <----invalidated--------+    +--> CONVERGED
 *
 *   verified     packets of its last solve were traced again with the same random numbers (verify.h)
 *   corrected    its sums were changed by what these differ by (control_variate.h); no solve is needed
 *   invalidated they differ by more than its target error allows: it is solved
 *   before all else (change.strength)
 *   stale        its means are known to be out of date, whatever their noise
 *
 * Interest. A tile that is seen from level k is solved every 2^k-th round: a texel of that level is the mean
 * of 4^k. A tile of no interest contributes where bounce rays of solved tiles hit it. Its importance, the
 * rays that hit it for each that it would shoot itself, decides how often it is solved: its noise is averaged
 * over its readers, so the question is how old its light may be. Tiles of no importance are not solved; nor
 * is anything once all tiles of interest have converged. A tile that was never solved is solved once in any
 * case: rays must not hit a place without light.
 *
 * Rounds. What is to be solved makes a round. A frame takes of it what it has time for, and a round is shown
 * together at its end, filtered and welded once. Invalidated blocks are solved before all else, those of the
 * highest priority first, and shown at once. Without a limit of time a round is a frame.
 *
 * Movement. At an onset all of the interest set is verified as fast as the budget allows, nearest first. What
 * was corrected sends out other light: as many frames as there are bounces then read all rays again, so that
 * the change arrives without a solve. What this misses the blocks' turns find (gradient.h). While lights keep
 * moving there is no time for that: a share of each frame goes round the interest set and corrects it
 * (sweep), which is shown once it is through.
 *
 * What is chosen is a function of interest, limits and light, frame by frame: never of time, where no
 * budget is set, or of threads. */
#ifndef LW_ADAPT_SCHEDULER_H
#define LW_ADAPT_SCHEDULER_H

#include "server/solve/adapt/converged.h"
#include "server/solve/adapt/scheduler_mode.h"
#include "server/solve/transport/transport.h"

/* A contributor is solved at least once in this many rounds. */
#define LW_SCHEDULER_PERIOD_MAX 16u
/* A movement after this many frames without one is an onset. */
#define LW_SCHEDULER_STILL_FRAMES 4u
/* Of places on what has moved; more would only order better. */
#define LW_SCHEDULER_PLACES_MAX 32u

/** What is of interest. */
enum lw_scheduler_scope { LW_SCHEDULER_NOTHING, LW_SCHEDULER_TILES, LW_SCHEDULER_EVERYTHING };

/** What was to be shown at the end of a round, and was not: an update was awaited. */
enum lw_scheduler_held { LW_SCHEDULER_NOTHING_HELD, LW_SCHEDULER_HELD, LW_SCHEDULER_RELEASED };

struct lw_scheduler_count {
    /* Tiles: solved in this frame; of interest; that contribute. */
    uint32_t due, interest, contributing;
};

struct lw_scheduler {
    /* -- interest and importance; the planes are NULL until somebody names tiles -- */
    enum lw_scheduler_scope scope;
    /* lw_tile_ids of the scene; of these, tiles of level 0. */
    uint32_t ids, tile_count;
    /* Bounce rays per texel. */
    uint32_t samples;
    /* Per lw_tile_id: 0, or 1 + the finest level that is seen. */
    uint8_t *interest;
    /* Per lw_tile_id: bounce rays of this frame that hit it, by weight, of those that are counted. */
    uint32_t *hits;
    /* Per lw_tile_id: what a hit of one of its rays counts for in this frame. */
    uint16_t *weight;
    /* Per lw_tile_id: running mean of rays that hit it for each that it would shoot. */
    float *importance;

    /* -- rounds -- */
    /* In this round, some tile of interest has not converged. */
    bool watched;
    /* The round has: the next frame begins another. */
    bool ended;
    enum lw_scheduler_held held;
    /* Counts the rounds; period and age are measured in it. */
    uint32_t round;
    /* Frames of the round under way; of the last one, as one begins. */
    uint32_t frames;
    /* Tiles that the last frame solved because they were invalidated. */
    uint32_t solved_first;
    /* How much has changed of what was invalidated and the last frame had no
     * time for; 0: there is nothing. */
    unsigned backlog;
    /* As the round began. */
    struct lw_scheduler_count count;

    /* -- movement -- */
    /* Frames in which something had moved; of these, the last onset; the last in which lights did. */
    uint32_t moves, began, light_moves;
    uint32_t frames_since_move;
    /* At the last onset lights moved, or changed. */
    bool shone;
    /* Where something last moved from, and to. */
    struct lw_vec3 place_ws[LW_SCHEDULER_PLACES_MAX];
    uint32_t place_count;
    /* One of each tile, the first to be verified first. */
    struct lw_scheduler_turn {
        float rank;
        uint32_t tile; /* index into the tiles */
        uint64_t work; /* to verify it, and all before it that are unverified */
    } * turn;
    struct {
        uint32_t next;  /* tile */
        uint32_t moves; /* `light_moves` as it began */
        bool ended;     /* in this frame */
    } sweep;
    /* Frames that are yet to correct all blocks along the rays that there are. */
    uint32_t passes;
    /* Invalidated blocks were solved since the last of these began. */
    bool solved_invalidated;
    /* Tiles, in the last frame. */
    uint32_t corrected;
    /* Rounds since something was solved; since any block that contributes was stale. */
    uint32_t still_rounds, unchanged_rounds;
};

/** What a frame goes by. */
struct lw_scheduler_frame {
    const struct lw_transport *passes;
    struct lw_converged converged;
    enum lw_scheduler_mode mode;
    struct lw_budget budget; /* limited as the mode is */
    /* What is shown is filtered (denoise.h). */
    bool filtered;
    int threads;
};

/** Texels that a frame has time for, about. */
struct lw_scheduler_room {
    /* Of what was invalidated; with what else waits. */
    uint64_t invalidated, all;
};

/** Everything is of interest to begin with. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scheduler_init(struct lw_scheduler *scheduler, uint32_t ids,
                                               uint32_t tile_count, uint32_t indirect_samples);
/** A zeroed one is fine. */
void lw_scheduler_finish(struct lw_scheduler *scheduler);

/** Bytes held. */
size_t lw_scheduler_memory_bytes(const struct lw_scheduler *scheduler);

/* ---- interest (scheduler.c) ---- */

/** Takes the interest set, from the next choice on. interest: per lw_tile_id, as above; entries that are not
 * of level 0 are not read; NULL: everything. Errors: LW_NO_MEMORY; the scheduler is then as before. */
LW_MUST_CHECK enum lw_status lw_scheduler_set_interest(struct lw_scheduler *scheduler,
                                                       const uint8_t *interest);

/** Whether there is any interest: else no light matters. */
static inline bool lw_scheduler_has_interest(const struct lw_scheduler *scheduler) {
    return scheduler->scope != LW_SCHEDULER_NOTHING;
}

static inline bool lw_scheduler_is_of_interest(const struct lw_scheduler *scheduler,
                                               const struct lw_solve_tile *tile) {
    return scheduler->scope == LW_SCHEDULER_EVERYTHING || scheduler->interest[tile->id.v];
}

/** Sets `contributes` of every tile. all_contribute: rays end where texels cannot be counted (at probes), so
 * that every tile may contribute. */
void lw_scheduler_find_contributors(const struct lw_scheduler *scheduler, struct lw_tiles *tiles,
                                    bool all_contribute);

/** Counts where a due tile's bounce rays, and those to reflectors, have ended. */
void lw_scheduler_note_hits(struct lw_scheduler *scheduler, const struct lw_transport *passes,
                            const struct lw_solve_tile *tile);

/* ---- what a frame solves and shows (scheduler.c) ---- */

/** How many texels a frame may solve. Until all tiles are verified after an onset,
 * invalidated blocks alone are solved.
 * spent: the share of the frame's budget that lw_scheduler_verify() has taken */
struct lw_scheduler_room lw_scheduler_room_left(const struct lw_scheduler *scheduler,
                                                const struct lw_tiles *tiles,
                                                const struct lw_scheduler_frame *frame, double spent);

/** Sets `work` and `shows` of every tile, for the frame that begins. At least one tile is due, if any waits
 * for which there is room at all. */
void lw_scheduler_choose(struct lw_scheduler *scheduler, struct lw_tiles *tiles,
                         struct lw_scheduler_room room, struct lw_scheduler_count *out_count);

/** Leaves what need not be shown in this frame for the next frame without
 * invalidated tiles, but not twice. */
void lw_scheduler_put_off(struct lw_scheduler *scheduler, struct lw_tiles *tiles);

/* ---- what follows from a movement (scheduler_moves.c) ---- */

/** Something has moved: the tiles are still at pose `was`. shines: lights differ (lw_lights_differ()). */
void lw_scheduler_move(struct lw_scheduler *scheduler, struct lw_tiles *tiles, const struct lw_scene *scene,
                       const struct lw_pose *was, const struct lw_pose *is, bool shines);

/** Goes on where a checkpoint was saved, of a scene that has not changed since. */
void lw_scheduler_resume(struct lw_scheduler *scheduler, uint32_t moves, uint32_t frames_since_move);

/** Before it is chosen what the frame solves: verifies blocks, invalidates and corrects them. Those that
 * there is no time for are verified in the next frame. Adds the rays to count. Returns the work (budget.h). */
uint64_t lw_scheduler_verify(struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                             struct lw_ray_count *count);

/** Lights have begun to move, and some tile of interest was not verified since. */
bool lw_scheduler_is_behind(const struct lw_scheduler *scheduler, const struct lw_tiles *tiles);

/** Light that others read may be changing in this frame. */
bool lw_scheduler_is_changing(const struct lw_scheduler *scheduler);

/** Notes whether the frame solves anything. */
void lw_scheduler_note_work(struct lw_scheduler *scheduler, bool solves);

/** Begins the solve of blocks that are due: their means forget what is out of
 * date. Adds the rays to count. */
void lw_scheduler_weigh(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame,
                        struct lw_ray_count *count);

/** Sends out again what corrected tiles reflect. */
void lw_scheduler_pass_on(struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame);

/** Sets `shows` of tiles whose corrections are to be seen in this frame: at once at an onset, after a
 * sweep where movement goes on. */
void lw_scheduler_show(const struct lw_scheduler *scheduler, const struct lw_scheduler_frame *frame);

/** Sums the invalidated blocks of a tile: their texels, their priority. */
void lw_scheduler_sum_invalidated(struct lw_solve_tile *tile);

#endif
