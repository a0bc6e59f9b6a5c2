/* durations.h: how long things took, counted in buckets that never change, for
 * readers that ask now and then.
 * Threads: one thread at a time. */
#ifndef LW_SERVE_METRICS_DURATIONS_H
#define LW_SERVE_METRICS_DURATIONS_H

#include <stdint.h>

#define LW_DURATIONS_BOUNDS 14u

/** Upper bounds of the buckets, s: from half a millisecond to ten seconds. */
extern const double lw_durations_bound_s[LW_DURATIONS_BOUNDS];

/** Zero-initialise. */
struct lw_durations {
    uint64_t count[LW_DURATIONS_BOUNDS + 1]; /* by bucket; the last bucket is above the last bound */
    uint64_t sum_ns;
};

void lw_durations_add(struct lw_durations *durations, uint64_t ns);

#endif
