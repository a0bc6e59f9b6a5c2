/* wait_policy.h: makes idle OpenMP threads sleep.
 * Threads: main, before any other.
 *
 * libgomp's threads spin for some milliseconds at the end of each parallel region, unless OMP_WAIT_POLICY
 * says otherwise when the program is loaded. Spinning wastes CPU time. On a busy machine it also takes the
 * cores from threads that still work: a frame has some thirty regions, and each then waits for time
 * slices. */
#ifndef LW_COMMON_BASE_WAIT_POLICY_H
#define LW_COMMON_BASE_WAIT_POLICY_H

/** Executes the program again in the same process, with OMP_WAIT_POLICY=passive. Returns at once if the
 * variable is set. Child programs inherit it. On failure it logs a warning and returns. */
void lw_wait_passively(char **argv);

#endif
