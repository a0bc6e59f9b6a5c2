/* cost_report.h: what renderers for each user cost, as lightwell-load crossover has measured it.
 * Flow:    curves.csv of a report's folder -> [cost_report] -> daemon_metrics
 * Threads: read once; then immutable, [any]. */
#ifndef LW_SERVER_COST_REPORT_H
#define LW_SERVER_COST_REPORT_H

#include "common/base/status.h"

#define LW_COST_REPORT_MAX       16u        /* renderers and settings; further ones are left out */
#define LW_COST_REPORT_BYTES_MAX (1u << 20) /* bytes of the file */

/** CPU seconds per frame and user of each that is no cache, as they stand in the file. */
struct lw_cost_report {
    struct lw_cost_report_row {
        char renderer[40], setting[40];
        double cpu_s;
    } row[LW_COST_REPORT_MAX];
    unsigned count;
};

/** Reads FOLDER/curves.csv. Errors: LW_NO_INPUT, LW_IO naming the file; LW_BAD_DATA naming the line, or that
 * there is no renderer in it; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_cost_report_read(const char *folder, struct lw_cost_report *out_report,
                                                 struct lw_error *err);

#endif
