/* crossover_report.h: the report of a row's tables: report.md, plots, strips of pictures.
 * Flow:    measure_store -> crossover_analysis -> [crossover_report] -> report.md, curves.csv, *.png
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_REPORT_H
#define LW_CLIENT_MEASURE_CROSSOVER_REPORT_H

#include "client/measure/measure_store.h"

/** Writes the report of all complete units from the tables alone; pictures where their files are there.
 * Prints its first figures on stdout.
 * Errors: LW_BAD_DATA where nothing is measured; LW_IO, LW_CANNOT_CREATE, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_crossover_report_write(const struct lw_measure_store *store,
                                                       struct lw_error *err);

/** Writes a report that says why the row cannot be measured: a scene without the motion, black views.
 * Errors: LW_IO, LW_CANNOT_CREATE, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_crossover_report_refuse(const struct lw_measure_store *store, const char *why,
                                                        struct lw_error *err);

#endif
