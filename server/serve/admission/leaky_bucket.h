/* leaky_bucket.h: how often something may happen: a number of times at once, and then at a rate.
 * Threads: one thread at a time. */
#ifndef LW_SERVE_ADMISSION_LEAKY_BUCKET_H
#define LW_SERVE_ADMISSION_LEAKY_BUCKET_H

#include "common/base/status.h"

#include <stdint.h>

/** Zero is empty. */
struct lw_leaky_bucket {
    double filled; /* times counted, less those that time has made good */
    uint64_t as_of_ns;
};

/** Whether it may happen once more: rate_hz times a second, burst at once. Counts it then. */
LW_MUST_CHECK bool lw_leaky_bucket_take(struct lw_leaky_bucket *bucket, double rate_hz, double burst,
                                        uint64_t now_ns);

#endif
