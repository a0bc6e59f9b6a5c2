/* gradient.h: how much a block's light has changed since it was last solved.
 * Flow:    movement -> [choose packets] -> lw_verify_compare() -> control_variate.h ->
 *          [judge] -> which blocks are invalidated, what their means forget
 * Threads: a block's change is read and written by the one worker that has its tile.
 *
 * The samples of a block's last solve are taken again with the same random numbers, and compared with
 * their former values (temporal gradients, Schied et al. 2018). Only changed light differs, so the difference
 * has none of the noise of the estimates. Where something has moved since, rays are traced again. Elsewhere
 * the light that arrives along the ray hits is read again, which costs no ray: so a change follows the
 * bounces. Tiles that are neither of interest nor contribute are not verified.
 *
 *   situation of a block                         packets that are verified
 *   something begins to move                     one, or up to four of a block with several surfaces. All
 *                                                where these found a difference (under a budget: only before
 *                                                it is solved, and if the difference was small)
 *   lights begin to move, or have since it       all, about direct light; without a budget along the ray
 *   last contributed                             hits too
 *   the light of other blocks has just changed   all, along the ray hits
 *   lights keep moving                           all, about both, some tiles a frame
 *   converged                                    one a round, until all were: 16 rounds after a movement
 *   not converged                                one before each solve while something moves; all, along the
 *                                                ray hits, while light changes
 *
 * The means are corrected by the findings (control_variate.h). The rest of this file is about the remaining
 * staleness and its standard error. A block is invalidated when they add up to more than its target error.
 *
 * The verified packets may lie on another surface than the change, and miss it. So a block that
 * is solved after a movement also compares its estimates with its means: where they stay off to
 * one side, the means are stale.
 *
 * Blocks that are solved in the same frame change what arrives in it. Direct light is therefore read along a
 * block's old ray hits before new rays are traced (lw_verify_reread()). For bounces, the mean change of each
 * block's radiance since the frame before is looked up at the new ray hits (lw_verify_add_indirect_change()).
 *
 * A change that fewer than one ray in 512 of a block meets may still be overlooked. */
#ifndef LW_ADAPT_GRADIENT_H
#define LW_ADAPT_GRADIENT_H

#include "server/solve/adapt/budget.h"
#include "server/solve/state/tiles.h"

/* One frame's verification, for all blocks. */
struct lw_gradient_round {
    uint32_t moves, began, light_moves; /* as in struct lw_motion */
    uint32_t tick;                      /* counts the rounds (plan.h) */
    bool turn;                          /* a round begins */
    bool active;                        /* light elsewhere may be changing */
    bool spreads; /* it has changed in the last frames: its consequences are not to wait for their turn */
    struct lw_budget budget;
};

/** Chooses the packets of a block that are verified before it is known what this frame solves. See the
 * table above: mostly one, or none; of a block that has not converged only where something begins to move.
 * Returns whether there are any. */
bool lw_gradient_choose(struct lw_solve_block *block, const struct lw_gradient_round *round);

/** The work that verifying what lw_gradient_choose() would choose takes, about (budget.h). */
uint64_t lw_gradient_work(const struct lw_solve_block *block, const struct lw_gradient_round *round);

/** The same of lw_gradient_choose_all(). */
static inline uint64_t lw_gradient_work_all(const struct lw_solve_block *block) {
    const bool any = block->packet_count && block->sample_count;
    return any ? (uint64_t)block->covered_count * (LW_BUDGET_SHADOW + LW_BUDGET_READ) : 0;
}

/** Chooses all packets, about direct light and along the ray hits. Returns whether there are any. */
bool lw_gradient_choose_all(struct lw_solve_block *block, uint32_t moves);

/** After lw_verify_compare() of the chosen packets: chooses more packets to verify, before
 * lw_gradient_invalidate(). It chooses all packets if the change is near the limit of
 * invalidation. Under a budget none at an onset, where one packet is enough.
 * Returns whether there are any. */
bool lw_gradient_choose_more(struct lw_solve_block *block, float target_error,
                             const struct lw_budget *budget);

/* Its light has changed by more than its target error allows, and it was not solved since. */
static inline bool lw_gradient_is_invalidated(const struct lw_change_block *change) {
    return change->strength > 0;
}

/* A block of whose light so much has changed is solved before all else. */
#define LW_GRADIENT_STRONG 0.03f
static inline bool lw_gradient_is_strong(const struct lw_change_block *change) {
    return change->strength >= LW_GRADIENT_STRONG;
}

/** A W/m^2 of a region counts `factor` times as much as before (lw_solve_block.weight), and so does its
 * known staleness. */
void lw_gradient_reweigh(struct lw_solve_block *block, const float factor[LW_REGIONS]);

/** Notes what the estimates of a solve are off their means, in the mean over the texels of a region;
 * weighted. */
void lw_gradient_note_drift(struct lw_solve_block *block, int part, uint32_t region, float off);

/** Keeps what corrections have left of the packets' differences as staleness. */
void lw_gradient_note_staleness(struct lw_solve_block *block);

/** Invalidates a block if its packets' differences exceed its target error. Under a budget those of few
 * packets must also exceed their noise. */
void lw_gradient_invalidate(struct lw_solve_block *block, float target_error, const struct lw_budget *budget);

/** Chooses the packets of a block that is to be solved, unless it was verified in this frame or is
 * invalidated: one, if something has moved since. Returns whether there are any. */
bool lw_gradient_choose_due(struct lw_solve_block *block, uint32_t moves);

/** Begins a due block's frame: cuts its means to their staleness, forgets what its packets have found, and
 * sets the weight of its next estimate of direct light. filtered: shown light is filtered (denoise.h), so
 * that noise matters less, and means of changed light stand for fewer frames. At an onset a block that has
 * changed much is invalidated again, with half the strength, since its new light has hardly any samples. */
void lw_gradient_weigh_direct(struct lw_solve_block *block, uint32_t moves, bool filtered,
                              const struct lw_budget *budget);

/** After lw_verify_add_indirect_change() of the first bounce: the same for indirect light. most: frames that
 * its mean may stand for in any case. */
void lw_gradient_weigh_indirect(struct lw_solve_block *block, float most, bool filtered);

/** Invalidates a converged block if its differences since it was solved exceed its
 * target error as that is now. */
void lw_gradient_review(struct lw_solve_block *block, float target_error);

/** Whether a block's means are too stale for it to converge. */
bool lw_gradient_is_stale(const struct lw_solve_block *block, float target_error);

#endif
