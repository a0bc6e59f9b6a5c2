/* gnuplot.h: plots of a report, where gnuplot is installed.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_GNUPLOT_H
#define LW_CLIENT_MEASURE_GNUPLOT_H

#include <stdio.h>

/** Writes the lines before a `plot` command, and those after it. It draws NAME.png and NAME.svg, of this size
 * in pixels. */
void lw_gnuplot_begin(FILE *script, const char *name, unsigned width, unsigned height);
void lw_gnuplot_end(FILE *script, const char *name, unsigned width, unsigned height);

/** Runs gnuplot on a script in a folder, which becomes its own; a warning says where that did not work. */
void lw_gnuplot_run(const char *folder, const char *script);

#endif
