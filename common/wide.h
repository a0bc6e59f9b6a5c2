/* wide.h: functions whose loops want wider registers than the oldest processor of the platform has.
 * Threads: none of its concern. */
#ifndef LW_COMMON_WIDE_H
#define LW_COMMON_WIDE_H

/** LW_WIDE before a function: the compiler makes it for several generations of x86-64 as well, and the first
 * call picks one. The same operations in the same order, no fused ones (-ffp-contract=off): the same bytes
 * from all of them. What it calls and should be as wide must be LW_WIDE_INLINE. Elsewhere, and under
 * sanitizers, it means nothing. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__) &&                            \
    !defined(__SANITIZE_THREAD__) && !defined(__clang__)
#define LW_WIDE __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define LW_WIDE
#endif
#define LW_WIDE_INLINE static inline __attribute__((always_inline))

#endif
