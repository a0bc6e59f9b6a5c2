/* histogram.h: a histogram of fixed size (30 KB), whose buckets are wider for larger values.
 * Threads: one thread at a time.
 * After:   HdrHistogram (Tene): a power of two is cut into equal parts, so that the relative error is
 *          bounded. */
#ifndef LW_COMMON_BASE_HISTOGRAM_H
#define LW_COMMON_BASE_HISTOGRAM_H

#include <stdint.h>

#define LW_HISTOGRAM_PARTS   64u /* for each power of two: a bucket is at most 1/64 of its values wide */
#define LW_HISTOGRAM_BUCKETS (LW_HISTOGRAM_PARTS * 59u)

/** Zero-initialise. Values below 128 have buckets of their own; 64 bits fit. */
struct lw_histogram {
    uint64_t count, min, max; /* min and max: exact; 0 if there is no value */
    double sum;
    uint64_t bucket[LW_HISTOGRAM_BUCKETS];
};

void lw_histogram_add(struct lw_histogram *histogram, uint64_t value);

/** The value that a fraction q of all values does not exceed, within 1/128 of it, and between min and max; 0
 * if there is no value. q is clamped to [0, 1]; 0 gives the least value, 1 the largest. */
uint64_t lw_histogram_quantile(const struct lw_histogram *histogram, double q);

/** 0 if there is no value. */
double lw_histogram_mean(const struct lw_histogram *histogram);

#endif
