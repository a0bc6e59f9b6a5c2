/* clock.h: monotonic time, and CPU time. [any] */
#ifndef LW_COMMON_BASE_CLOCK_H
#define LW_COMMON_BASE_CLOCK_H

#include <stdint.h>
#include <time.h>

/** Time of a clock of clock_gettime(), in nanoseconds. */
static inline uint64_t lw_clock_read_ns(clockid_t id) {
    struct timespec t;
    clock_gettime(id, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

/** Nanoseconds since an arbitrary start; never goes back. */
static inline uint64_t lw_clock_ns(void) { return lw_clock_read_ns(CLOCK_MONOTONIC); }

/** CPU time of the whole process, over all its threads. */
static inline uint64_t lw_clock_process_cpu_ns(void) { return lw_clock_read_ns(CLOCK_PROCESS_CPUTIME_ID); }

/** CPU time of the calling thread. */
static inline uint64_t lw_clock_thread_cpu_ns(void) { return lw_clock_read_ns(CLOCK_THREAD_CPUTIME_ID); }

#endif
