/* crossover.h: lightwell-load crossover SCENE: the shared cache against opponents, at equal error.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_H
#define LW_CLIENT_MEASURE_CROSSOVER_H

/** Runs the command; argv[0] is "crossover", argv[-1] the program. Returns the program's exit code. */
int lw_crossover_command(int argc, char **argv);

#endif
