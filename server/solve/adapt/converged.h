/* rest.h: when a block has had frames enough.
 * Threads: pure functions, [any]. */
#ifndef LW_ADAPT_CONVERGED_H
#define LW_ADAPT_CONVERGED_H

#include "server/solve/adapt/gradient.h"

/* A block rests at the target error, but never before it has seen this many frames. */
#define LW_CONVERGED_FRAMES_MIN 16u

struct lw_converged {
    float target_error;
    uint32_t frames_max; /* after which it rests in any case; 0: never */
};

/** Whether a block needs no more frames until its light changes. */
static inline bool lw_converged_is(const struct lw_converged *rest, const struct lw_solve_block *block) {
    return (block->frames >= LW_CONVERGED_FRAMES_MIN && block->error <= rest->target_error &&
            !lw_gradient_is_stale(block, rest->target_error)) ||
           (rest->frames_max && block->frames >= rest->frames_max);
}

/** The same of a block that this frame has not solved: what has no texels or is hidden needs none. */
static inline bool lw_converged_may(const struct lw_converged *rest, const struct lw_solve_tile *tile,
                                    const struct lw_solve_block *block) {
    return block->covered_count == 0 || tile->hidden || lw_converged_is(rest, block);
}

#endif
