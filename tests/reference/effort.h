/* effort.h: how many samples a reference test takes: as few as the fast tests can do with, or, where the
 * program has an argument, twice as many. */
#ifndef LW_TESTS_EFFORT_H
#define LW_TESTS_EFFORT_H

#include <math.h>

/* Times the samples of the fast test; noise falls by its root. */
static unsigned effort = 1;
static inline double noise(double tolerance) { return tolerance / sqrt(effort); }
static inline void set_effort(int argc) { effort = argc > 1 ? 2 : 1; }

#endif
