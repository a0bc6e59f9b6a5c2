/* change.h: how much a block's light has changed since it was last solved.
 * Flow:    movement -> [choose packets] -> lw_verify_compare() -> correction.h -> [judge] -> which blocks wake, what their means forget
 * Threads: a block's change is read and written by the one worker that has its tile.
 *
 * The samples of a block's last frame are taken again now, with the same random numbers, and compared with what they were then
 * (temporal gradients, Schied et al. 2018): whatever does not come out the same has changed, and nothing else, so that the
 * difference has none of the noise of the estimates themselves. Direct light and bounce rays are traced again where something has
 * moved since; where not, what arrives along the rays' ends is read again, which costs no ray: so a change follows the
 * bounces. What nobody looks at and what lights nobody's view is not asked.
 *   where something begins to move   one packet, or up to four of a block of several surfaces, and all at once if these have found a
 *                                    difference; in a hurry, not those before they are solved, and then only if it was a small one
 *   where lights begin to move, or have since the block last served   all packets, about direct light; without hurry, both
 *   where others' light has just changed               all packets, along the rays that there are
 *   while lights keep moving                           all packets, about both, some tiles a frame
 *   at rest   one packet in turn, so that all have been asked 16 rounds after the last movement
 *   awake     one packet before each solve while something moves; all, along the rays that there are, while light changes
 * Of what they find the means are corrected (correction.h); what follows is about the rest, and the doubt that a correction leaves.
 * The packets asked may lie on another surface of the block than what has changed, and miss it. So the estimates of a block that is solved
 * after a movement are held against their means as well, for nothing: where they stay off to one side, the means are out of date.
 * A block wakes when what its packets have found adds up to more than its target error.
 * Others that are solved in the same frame change what arrives in that frame: of direct light that is read along the block's old rays
 * before new ones are traced (lw_verify_reread()); of bounces, the mean by which the radiance of each block differs from the frame
 * before is looked up at the ends of the new ones (lw_verify_arrive()).
 * A block with no change in its samples may still be wrong by what fewer than one ray in 512 of it would see. */
#ifndef LW_ADAPT_GRADIENT_H
#define LW_ADAPT_GRADIENT_H

#include "server/solve/state/tiles.h"

/* What is asked of all blocks in a frame. */
struct lw_gradient_round {
    uint32_t moves, began,
        light_moves; /* of the scene, so far; when it last began to move; when its lights last did */
    uint32_t tick;   /* counts the rounds (scheduler.h) */
    bool turn;       /* a round begins */
    bool active;     /* light elsewhere may be changing */
    bool spreads; /* it has changed in the last frames: what follows from that is not to wait for its turn */
    bool hurried; /* time is short */
};

/** Chooses the packets that are asked of a block before it is known what this frame solves: mostly one, or none; of a block that does
 * not rest only where something begins to move. Where light spreads, all along the rays that there are; where lights have begun to move, or
 * have since the block last served, all about direct light, and, if there is time, along the rays. Returns whether there are any. */
bool lw_gradient_choose(struct lw_solve_block *block, const struct lw_gradient_round *round);

/** Chooses all packets, about direct light and along the rays that there are. Returns whether there are any. */
bool lw_gradient_choose_all(struct lw_solve_block *block, uint32_t moves);

/** After their answers: chooses the packets that are to be asked besides, before lw_gradient_wake(): all, if those asked have found so
 * much that the block might have to wake, but not so much that it must. hurried: where something begins to move none are: one packet is
 * enough to wake. Returns whether there are any. */
bool lw_gradient_choose_more(struct lw_solve_block *block, float target_error, bool hurried);

/* Its light has changed by more than its target error allows, and it was not solved since. */
static inline bool lw_gradient_is_invalidated(const struct lw_change_block *change) {
    return change->strength > 0;
}

/* A block of whose light so much has changed is solved before all else. */
#define LW_GRADIENT_URGENT 0.03f
static inline bool lw_gradient_is_urgent(const struct lw_change_block *change) {
    return change->strength >= LW_GRADIENT_URGENT;
}

/** Notes what the estimates of a solve are off their means, in the mean over the texels of a region. */
void lw_gradient_note_drift(struct lw_solve_block *block, int part, uint32_t region, float off);

/** Keeps what is left of what all packets have found as out of date. */
void lw_gradient_note_rest(struct lw_solve_block *block);

/** Wakes a block if what its packets have found is more than its target error allows; hurried: where that is of few packets, and more than
 * their noise may be. */
void lw_gradient_wake(struct lw_solve_block *block, float target_error, bool hurried);

/** Chooses the packets of a block that is to be solved, unless it was asked in this frame or has woken: one where
 * something has moved since. Returns whether there are any. */
bool lw_gradient_choose_due(struct lw_solve_block *block, uint32_t moves);

/** Begins a due block's frame with what its packets have found, which is then forgotten; sets the weight of its next estimate of
 * direct light. filtered: what is shown is (denoise.h), so that noise matters less, and means remember less of light that has
 * changed. hurried: what has changed much is woken again, with half the strength: its new light has hardly any samples. */
void lw_gradient_weigh_direct(struct lw_solve_block *block, uint32_t moves, bool filtered, bool hurried);

/** After lw_verify_arrive() of the first bounce: that of indirect light. most: frames that it may remember in any case. */
void lw_gradient_weigh_indirect(struct lw_solve_block *block, float most, bool filtered);

/** Wakes a block at rest if all that was found since it was solved is more than its target error allows, as that is now. */
void lw_gradient_review(struct lw_solve_block *block, float target_error);

/** Whether more of a block's means is out of date than may be at rest. */
bool lw_gradient_is_stale(const struct lw_solve_block *block, float target_error);

#endif
