/* load_test.h: a load test: thousands of sessions in one process on one loop.
 * Flow:    options -> scene, sessions -> [load_test: who joins, who leaves, when to measure] -> report
 * Threads: one; while it runs, it is the loop. */
#ifndef LW_CLIENT_LOAD_LOAD_TEST_H
#define LW_CLIENT_LOAD_LOAD_TEST_H

#include "client/load/load_report.h"

/** Runs until the time is over, the server is gone, or SIGINT or SIGTERM comes. A second signal ends the
 * program.
 * The report has all figures measured by then; the caller frees it with free().
 * Errors: LW_NO_HOST, LW_UNAVAILABLE, LW_TIMED_OUT, LW_PROTOCOL where there is no server to load; LW_OS,
 *         naming the limit on open files where that is too low; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_load_test_run(const struct lw_load_options *options,
                                              struct lw_load_report **out_report, struct lw_error *err);

#endif
