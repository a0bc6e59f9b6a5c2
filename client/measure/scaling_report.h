/* scaling_report.h: the files of a scaling run: report.md, scaling.csv, settings.csv, scaling.json, plots.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_SCALING_REPORT_H
#define LW_CLIENT_MEASURE_SCALING_REPORT_H

#include "client/measure/scaling.h"

/** Writes the files. Without gnuplot there are no plots; that is logged and no error.
 * Errors: LW_CANNOT_CREATE, LW_IO naming the file; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scaling_report_write(const struct lw_scaling *scaling, struct lw_error *err);

/** Prints the result on stdout. */
void lw_scaling_report_print(const struct lw_scaling *scaling);

#endif
