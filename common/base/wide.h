/* wide.h: functions compiled for several generations of vector units. Threads: [any]. */
#ifndef LW_COMMON_BASE_WIDE_H
#define LW_COMMON_BASE_WIDE_H

/** LW_WIDE before a function: the compiler makes versions of it for several generations of x86-64, and the
 * first call picks one. All versions do the same operations in the same order, without fused ones
 * (-ffp-contract=off), so they give the same bytes. Functions that it calls must be LW_WIDE_INLINE to be as
 * wide. On other processors, and under sanitizers, LW_WIDE has no effect. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__) &&                            \
    !defined(__SANITIZE_THREAD__) && !defined(__clang__)
#define LW_WIDE __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define LW_WIDE
#endif
#define LW_WIDE_INLINE static inline __attribute__((always_inline))

#endif
