/* converged.h: when a block has had samples enough.
 * Threads: pure functions, [any]. */
#ifndef LW_ADAPT_CONVERGED_H
#define LW_ADAPT_CONVERGED_H

#include "server/solve/adapt/gradient.h"
#include "server/solve/state/solver_terms.h"

struct lw_converged {
    float target_error;
    /* after which it counts as converged in any case; 0: never. */
    uint32_t frames_max;
};

/** Whether a block needs no more frames until its light changes. */
static inline bool lw_converged_is(const struct lw_converged *converged, const struct lw_solve_block *block) {
    return (block->sample_count >= LW_SOLVER_FRAMES_MIN && block->error <= converged->target_error &&
            !lw_gradient_is_stale(block, converged->target_error)) ||
           (converged->frames_max && block->sample_count >= converged->frames_max);
}

/** The same of a block that this frame has not solved. A block without texels, or of a hidden tile,
 * counts as converged. */
static inline bool lw_converged_may(const struct lw_converged *converged, const struct lw_solve_tile *tile,
                                    const struct lw_solve_block *block) {
    return block->covered_count == 0 || tile->hidden || lw_converged_is(converged, block);
}

#endif
