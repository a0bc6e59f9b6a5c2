/* history.h: for how many frames a running mean stands, and how stale it is.
 * Flow:    how much the light has changed (change.h) -> [history] -> weights of the next estimates
 * Threads: values, [any].
 *
 * While nothing changes a mean is plain: estimate n enters with weight 1/n, and the error falls with the
 * root of the frames. Light that changes by d leaves the mean wrong by d until new estimates have
 * replaced the old ones. That is the mean's staleness s: a change adds to it, an estimate takes its own
 * weight off it. The mean is cut to
 *
 *   V / s^2 frames       V: variance of one estimate
 *
 * with which it is as wrong for being old as for being noisy. Light that changes by d in every
 * frame ends at about (V/d^2)^(1/3) frames by itself. After a single change the history grows from
 * V/d^2 frames as a plain mean. */
#ifndef LW_STATE_HISTORY_H
#define LW_STATE_HISTORY_H

#include "common/base/invariant.h"
#include <math.h>

struct lw_history {
    float sample_count; /* frames that the mean stands for */
    float weight;       /* with which the last estimate entered */
};

/** Frames that a mean may stand for which is out of date by s > 0, in the unit of the root of
 * the variance of one estimate. */
static inline float lw_history_max(float variance, float s) { return variance / (s * s); }

/** Weight of the next estimate, which is taken in; of the frames before it, at most `room` count. */
static inline float lw_history_take(struct lw_history *memory, float room) {
    memory->sample_count = fminf(memory->sample_count, room) + 1;
    memory->weight = 1 / memory->sample_count;
    LW_INVARIANT_DEAR(memory->weight > 0 && memory->weight <= 1);
    return memory->weight;
}

#endif
