/* clock.h: monotonic time. [any] */
#ifndef LW_COMMON_CLOCK_H
#define LW_COMMON_CLOCK_H

#include <stdint.h>
#include <time.h>

/** Nanoseconds since an arbitrary start; never goes back. */
static inline uint64_t lw_clock_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

#endif
