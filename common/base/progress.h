/* progress.h: shows the progress of long work on stderr. On a terminal a bar that is redrawn; elsewhere plain
 * lines, at most one in two seconds. A stage that ends within one second prints nothing, so that fast work
 * stays quiet.
 * Threads: one lw_progress belongs to one thread; lw_progress_step() may be called from [any]. */
#ifndef LW_COMMON_BASE_PROGRESS_H
#define LW_COMMON_BASE_PROGRESS_H

#include "common/base/waiting.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct lw_progress {
    const char *stage; /* "unwrapping", "building the scene" */
    uint64_t total;    /* steps in all; 0: unknown */
    _Atomic uint64_t done;
    uint64_t started_ns;
    _Atomic uint64_t shown_ns; /* when a line was last shown; 0: never */
    /* The stage's own estimate of the time that is left, in place of one by its steps; infinite: not known.
     * NAN, as lw_progress_init() sets it: the estimate is by steps. */
    double left_s;
    /* The name of steps, such as "tiles". A stage that cannot predict its time left shows steps. NULL hides
     * them; lw_progress_init() sets NULL. */
    const char *unit;
    double limit_s; /* the stage ends then, done or not; 0, as lw_progress_init() makes it: never */
    /* May be NULL; lw_progress_init() makes it so. While it is false the stage shows nothing, as its end is
     * not awaited. */
    const _Atomic bool *wanted;
    /* Hears of each step which share of waiting_stage is done, whether the stage shows anything or not. NULL,
     * as lw_progress_init() makes it: nobody does. It outlives the stage. */
    struct lw_waiting *waiting;
    enum lw_waiting_stage waiting_stage;
};

/** Starts a stage. stage must outlive p. */
void lw_progress_init(struct lw_progress *p, const char *stage, uint64_t total);
/** The same for a stage before the first light: waiting, which may be NULL, hears how much of it is done. */
void lw_progress_init_waiting(struct lw_progress *p, const char *stage, uint64_t total,
                              struct lw_waiting *waiting, enum lw_waiting_stage waiting_stage);
/** Adds steps and shows them when due. */
void lw_progress_step(struct lw_progress *p, uint64_t steps);
/** Sets the steps done, which may be fewer than before, and shows them when due. */
void lw_progress_set(struct lw_progress *p, uint64_t done);
/** Ends the stage. Shows its time if that is over a second. Call after the last step of every thread. */
void lw_progress_finish(struct lw_progress *p);
/** Ends a stage whose work is not done. Logs its progress and its time. */
void lw_progress_stop(struct lw_progress *p);
/** Calls lw_progress_finish() if done, else lw_progress_stop(). */
void lw_progress_end(struct lw_progress *p, bool done);

#endif
