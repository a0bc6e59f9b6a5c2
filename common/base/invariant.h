/* invariant.h: what our own code relies on and leaves behind, checked as it runs.
 * Flow:    a broken condition -> one line on stderr: file, line, condition -> abort()
 * Threads: [any].
 *
 * An invariant is about our own state: sizes agree, an index is in range, a version never falls, sums are
 * finite and not negative, a list is a permutation. Bytes from a peer or a file give a status and never reach
 * one. Conditions have no effects, since builds leave them out:
 *
 *   LW_INVARIANTS   LW_INVARIANT   LW_INVARIANT_DEAR   chosen by
 *   OFF             not checked    not checked         measurements of what the checks cost
 *   CHEAP           checked        not checked         AUTO in release builds
 *   ALL             checked        checked             AUTO in debug builds; .ci/run
 */
#ifndef LW_COMMON_BASE_INVARIANT_H
#define LW_COMMON_BASE_INVARIANT_H

/** Says which condition is broken, and aborts. For the macros below. */
_Noreturn void lw_invariant_broken(const char *file, int line, const char *condition)
    __attribute__((cold, nonnull));

/* LW_INVARIANT_LEVEL comes from cmake/lightwell.cmake: 0 OFF, 1 CHEAP, 2 ALL. */
#define LW_INVARIANT_AT(level, condition)                                                                    \
    (LW_INVARIANT_LEVEL < (level) || (condition) ? (void)0                                                   \
                                                 : lw_invariant_broken(__FILE__, __LINE__, #condition))

/** For conditions that cost a few instructions. */
#define LW_INVARIANT(condition) LW_INVARIANT_AT(1, condition)
/** For loops over data, and for what runs for each texel or coefficient. */
#define LW_INVARIANT_DEAR(condition) LW_INVARIANT_AT(2, condition)

#endif
