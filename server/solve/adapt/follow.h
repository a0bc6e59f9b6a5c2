/* follow.h: what follows from a movement: in which frame a tile is asked, corrected, woken and shown.
 * Flow:    movement -> [note] -> [ask] -> tiles corrected and woken -> schedule -> [weigh what is due] -> passes -> [show]
 * Threads: [solver], with workers inside.
 *
 * Where something begins to move, all that is looked at is asked as fast as budgets allow (change_order.h), and what is found wakes, is
 * corrected and solved before all else. What has been corrected sends out other light: as many frames as there are bounces then read all
 * rays that there are again, so that the change arrives where it is looked at without a solve. Whatever this misses the blocks' turns find
 * (change.h).
 * While lights keep moving there is no time for that in any frame. A share of each then goes round what is looked at and corrects it; once
 * it is through, that is shown: a sweep. */
#ifndef LW_ADAPT_FOLLOW_H
#define LW_ADAPT_FOLLOW_H

#include "server/solve/adapt/converged.h"
#include "server/solve/adapt/schedule.h"
#include "server/solve/adapt/verify_order.h"
#include "server/solve/transport/transport.h"

/* What moves after so many frames in which nothing did begins to. */
#define LW_FOLLOW_STILL_FRAMES 4u

struct lw_follow {
    uint32_t moves; /* frames in which something had moved */
    uint32_t began; /* of these, the last before which nothing had for a while */
    uint32_t frames_since_move;
    bool shone;           /* what last began to move shines, or was light itself */
    uint32_t light_moves; /* `moves` when lights last did */
    struct lw_verify_order order;
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
};

/** What it takes of a frame. */
struct lw_follow_frame {
    const struct lw_transport *passes;
    const struct lw_schedule *schedule;
    struct lw_converged rest;
    double budget_s; /* wall time; 0: as long as it takes */
    bool hasty;      /* something has begun to move: what follows from that comes before all else */
    bool filtered;   /* what is shown is (denoise.h) */
    int threads;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_follow_init(struct lw_follow *follow, uint32_t tile_count);
void lw_follow_finish(struct lw_follow *follow);

/** Something has moved: the tiles are still at pose `was`. shines: lights differ (lw_lights_differ()). */
void lw_follow_move(struct lw_follow *follow, struct lw_tiles *tiles, const struct lw_scene *scene,
                    const struct lw_pose *was, const struct lw_pose *is, bool shines);

/** Goes on where a checkpoint was saved, of a scene that has not changed since. */
void lw_follow_resume(struct lw_follow *follow, uint32_t moves, uint32_t frames_since_move);

/** Before it is chosen what the frame solves: asks blocks what has changed, wakes and corrects them. Who is not asked for want of time is
 * in the next frame. Adds the rays to count. */
void lw_follow_ask(struct lw_follow *follow, const struct lw_follow_frame *frame, struct lw_ray_count *count);

/** Lights have begun to move, and something that is looked at has not been asked since. */
bool lw_follow_is_behind(const struct lw_follow *follow, const struct lw_tiles *tiles,
                         const struct lw_schedule *schedule);

/** Light that others read may be changing in this frame. */
bool lw_follow_is_changing(const struct lw_follow *follow);

/** Notes whether the frame solves anything, and a round of the schedule has ended. */
void lw_follow_note_work(struct lw_follow *follow, bool solves, bool ended);

/** Begins the solve of blocks that are due: their means forget what is out of date. Adds the rays to count. */
void lw_follow_weigh(const struct lw_follow *follow, const struct lw_follow_frame *frame,
                     struct lw_ray_count *count);

/** What tiles that have been corrected reflect is sent out anew. */
void lw_follow_pass_on(struct lw_follow *follow, const struct lw_follow_frame *frame);

/** Sets `shows` of tiles whose corrections are to be seen in this frame: at once where something has begun to move, after a sweep where it
 * goes on. */
void lw_follow_show(const struct lw_follow *follow, const struct lw_follow_frame *frame);

/** What the blocks of a tile that have woken are together. */
void lw_follow_sum_woken(struct lw_solve_tile *tile);

#endif
