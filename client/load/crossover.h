/* crossover.h: lightwell-load crossover SCENE: from how many users on one shared solve is cheaper than a path tracer each.
 * Threads: main() only. */
#ifndef LW_CLIENT_LOAD_CROSSOVER_H
#define LW_CLIENT_LOAD_CROSSOVER_H

/** Runs the command; argv[0] is "crossover", argv[-1] the program. Returns the program's exit code. */
int lw_crossover_command(int argc, char **argv);

#endif
