/* gnuplot.h: plots of a report, where gnuplot is installed.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_GNUPLOT_H
#define LW_CLIENT_MEASURE_GNUPLOT_H

/** Runs gnuplot on a script in a folder, which becomes its own; a warning says where that did not work. */
void lw_gnuplot_run(const char *folder, const char *script);

#endif
