/* measure.h: the commands of lightwell-load that compare the shared cache with a renderer for each user.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_MEASURE_H
#define LW_CLIENT_MEASURE_MEASURE_H

/** lightwell-load crossover SCENE: the cache against opponents, at equal error.
 * argv[0] is "crossover", argv[-1] the program. Returns the program's exit code. */
int lw_measure_crossover(int argc, char **argv);

/** lightwell-load scaling SCENE: from how many users on one solve is cheaper than a path tracer for each.
 * argv[0] is "scaling", argv[-1] the program. Returns the program's exit code. */
int lw_measure_scaling(int argc, char **argv);

#endif
