/* scheduler_mode.h: how a frame follows changes, as far as its budget and what
 * has just happened decide that. */
#ifndef LW_ADAPT_SCHEDULER_MODE_H
#define LW_ADAPT_SCHEDULER_MODE_H

#include <stdbool.h>

enum lw_scheduler_mode {
    /* No budget: what has changed is verified and solved in the frame in which it does. */
    LW_SCHEDULER_UNLIMITED,
    /* A budget, and no onset: blocks are verified in turn; what moves is swept. */
    LW_SCHEDULER_STEADY,
    /* A budget, and an onset: what follows from it comes before all else. */
    LW_SCHEDULER_ONSET,
    /* The same, while another layer has changed more: the frame verifies, and solves nothing. */
    LW_SCHEDULER_YIELD
};

/** Whether a frame has a budget: a few packets must then do where all would be surer. */
static inline bool lw_scheduler_mode_is_limited(enum lw_scheduler_mode mode) {
    return mode != LW_SCHEDULER_UNLIMITED;
}

/** Whether something has just begun to move, and not all that follows fits into a frame. */
static inline bool lw_scheduler_mode_is_onset(enum lw_scheduler_mode mode) {
    return mode == LW_SCHEDULER_ONSET || mode == LW_SCHEDULER_YIELD;
}

#endif
