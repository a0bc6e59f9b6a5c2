/* scaling_report.h: the files of a scaling run: report.md, scaling.csv, settings.csv, scaling.json, plots.
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_SCALING_REPORT_H
#define LW_CLIENT_MEASURE_SCALING_REPORT_H

#include "client/measure/scaling_measure.h"

/** Makes the folder if it is not there and checks that files can be written in it, before anything is
 * measured.
 * Errors: LW_CANNOT_CREATE naming it. */
LW_MUST_CHECK enum lw_status lw_scaling_report_prepare(const char *folder, struct lw_error *err);

/** Writes the files. Without gnuplot there are no plots; that is logged and no error.
 * command: as typed, for the report.
 * Errors: LW_CANNOT_CREATE, LW_IO naming the file; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scaling_report_write(const struct lw_scaling *scaling, const char *command,
                                                     struct lw_error *err);

#endif
