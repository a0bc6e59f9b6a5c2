/* cdf.h: choosing from a discrete distribution by its cumulative sums.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_BASE_CDF_H
#define LW_COMMON_BASE_CDF_H

#include <stdint.h>

/** First entry above pick, by bisection. If no entry is above it, the last entry.
 * cdf   count >= 1 ascending sums
 * pick  in [0, 1) of the last of them, which mostly is 1 */
static inline uint32_t lw_cdf_choose(const float *cdf, uint32_t count, float pick) {
    uint32_t low = 0, high = count - 1;
    while (low < high) {
        uint32_t middle = (low + high) / 2;
        if (cdf[middle] > pick)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/** Probability of entry i. */
static inline float lw_cdf_probability(const float *cdf, uint32_t i) { return cdf[i] - (i ? cdf[i - 1] : 0); }

#endif
