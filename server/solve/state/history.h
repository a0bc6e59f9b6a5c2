/* memory.h: how long a running mean remembers, and what of it is out of date.
 * Flow:    how much the light has changed (change.h) -> [memory] -> weights of the next estimates
 * Threads: values, [any].
 *
 * While nothing changes a mean is plain: estimate n enters with 1/n, and the error falls with the root of the frames. Light that
 * changes by d leaves the mean wrong by d until new estimates have replaced the old ones. So what a mean is out of date by, s,
 * is kept beside it: changes add to it, each estimate takes its own weight off it. The mean is cut to the V/s^2 frames with
 * which it is as wrong for being old as for being noisy (V: variance of one estimate). What changes by d in every frame
 * comes to remember about (V/d^2)^(1/3) frames by itself; what changes once grows from V/d^2 frames as a plain mean. */
#ifndef LW_STATE_HISTORY_H
#define LW_STATE_HISTORY_H

#include <math.h>

struct lw_history {
    float frames; /* that the mean stands for */
    float weight; /* with which the last estimate entered */
};

/** Frames that a mean may stand for which is out of date by s > 0, in the unit of the root of the variance of one estimate. */
static inline float lw_history_max(float variance, float s) { return variance / (s * s); }

/** Weight of the next estimate, which is taken in; of the frames before it, at most `room` count. */
static inline float lw_history_take(struct lw_history *memory, float room) {
    memory->frames = fminf(memory->frames, room) + 1;
    memory->weight = 1 / memory->frames;
    return memory->weight;
}

#endif
