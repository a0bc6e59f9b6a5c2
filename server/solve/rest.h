/* rest.h: when a block has had frames enough.
 * Threads: pure functions, [any]. */
#ifndef LW_SOLVE_REST_H
#define LW_SOLVE_REST_H

#include "server/solve/tiles.h"

/* A block rests at the target error, but never before it has seen this many frames. */
#define LW_REST_FRAMES_MIN 16u

struct lw_rest {
    float target_error;
    uint32_t frames_max; /* after which it rests in any case; 0: never */
};

/** Whether a block needs no more frames until its light changes. */
static inline bool lw_rest_has_enough(const struct lw_rest *rest, const struct lw_solve_block *block) {
    return (block->frames >= LW_REST_FRAMES_MIN && block->error <= rest->target_error &&
            !lw_change_is_stale(block, rest->target_error)) ||
           (rest->frames_max && block->frames >= rest->frames_max);
}

/** The same of a block that this frame has not solved: what has no texels or is hidden needs none. */
static inline bool lw_rest_may(const struct lw_rest *rest, const struct lw_solve_tile *tile,
                               const struct lw_solve_block *block) {
    return block->covered_count == 0 || tile->hidden || lw_rest_has_enough(rest, block);
}

#endif
