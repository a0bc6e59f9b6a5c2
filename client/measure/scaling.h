/* scaling.h: lightwell-load scaling SCENE: from how many users on one shared solve is cheaper than a path
 * tracer each.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_SCALING_H
#define LW_CLIENT_MEASURE_SCALING_H

/** Runs the command; argv[0] is "scaling", argv[-1] the program. Returns the program's exit code. */
int lw_scaling_command(int argc, char **argv);

#endif
