/* wait_policy.h: OpenMP threads that have nothing to do sleep.
 * Threads: main, before any other.
 *
 * libgomp's threads spin for some milliseconds at the end of each parallel region, unless told otherwise as
 * the program is loaded. That is CPU time that nobody used; and where other programs want the cores, the
 * threads that are waited for do not get them: a frame has some thirty regions, and each then takes time
 * slices of the others. */
#ifndef LW_COMMON_WAIT_POLICY_H
#define LW_COMMON_WAIT_POLICY_H

/** Starts the program anew, in the same process, with OMP_WAIT_POLICY=passive; returns at once if it has
 * that, or another one. Programs that it starts inherit it. If it cannot, it warns, and the program goes on
 * as it is. */
void lw_wait_passively(char **argv);

#endif
