#include "client/measure/measure.h"

#include "client/measure/crossover_report.h"
#include "client/measure/crossover_run.h"
#include "client/measure/scaling_measure.h"
#include "client/measure/scaling_report.h"
#include "common/base/interrupt.h"
#include "common/base/log.h"
#include "common/base/wait_policy.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>

#define COMMAND_SIZE LW_MEASURE_NOTE_SIZE

static _Atomic bool signalled;

static const struct lw_interrupt_phase measuring = {
    .answer = "stopping: what is measured stays, and the same command goes on; Ctrl-C again ends it at once"};

/* The first signal ends the measurement, the second the program. */
static void on_signal(int number) {
    (void)number;
    signalled = true;
}

/* Before anything is measured. Writes the command line for reports, arguments with blanks in quotes. */
static void prepare(int argc, char **argv, char command[COMMAND_SIZE]) {
    lw_wait_passively(argv - 1); /* the program's own name: see measure.h */
    size_t length = (size_t)snprintf(command, COMMAND_SIZE, "lightwell-load");
    for (int i = 0; i < argc && length < COMMAND_SIZE; i++) {
        const char *quote = strchr(argv[i], ' ') ? "'" : "";
        const int more = snprintf(command + length, COMMAND_SIZE - length, " %s%s%s", quote, argv[i], quote);
        length += more > 0 ? (size_t)more : 0;
    }
    lw_interrupt_watch(on_signal, &measuring);
}

/* The status of a run whose report is written: the first failure of the two. */
static enum lw_status with_report(enum lw_status status, enum lw_status written,
                                  const struct lw_error *report_err, struct lw_error *err) {
    if (status != LW_OK || written == LW_OK) return status;
    *err = *report_err;
    return written;
}

/* ---- crossover ---- */

static enum lw_status report_only(const char *folder, struct lw_error *err) {
    struct lw_measure_store store;
    enum lw_status status = lw_measure_store_open(&store, folder, true, err);
    if (status == LW_OK && lw_measure_store_get(&store, "users"))
        status = lw_status_fail(err, LW_USAGE, "%s holds a run of lightwell-load scaling", folder);
    if (status == LW_OK) status = lw_crossover_report_write(&store, err);
    lw_measure_store_finish(&store);
    return status;
}

static enum lw_status run_crossover(const struct lw_crossover_options *options, const char *command,
                                    struct lw_error *err) {
    static struct lw_crossover_row row; /* some 100 kB: no place on the stack */
    struct lw_error report_err = {0};
    enum lw_status status = lw_crossover_row_open(&row, options, command, &signalled, err);
    if (status == LW_OK) status = lw_crossover_run(&row, err);
    if (row.base.store.expense_count && status != LW_USAGE) { /* which says that the folder is another's */
        const enum lw_status written = lw_crossover_report_write(&row.base.store, &report_err);
        status = with_report(status, written, &report_err, err);
    } else if (status == LW_BAD_DATA) { /* the scene's fault: the same command would fail again */
        if (lw_crossover_report_refuse(&row.base.store, err->text, &report_err) != LW_OK)
            lw_log(LW_LOG_WARNING, "%s", report_err.text);
    }
    lw_crossover_row_finish(&row);
    return status;
}

int lw_measure_crossover(int argc, char **argv) {
    struct lw_crossover_options options;
    struct lw_error err = {0};
    char command[COMMAND_SIZE];
    bool done = false;
    enum lw_status status = lw_crossover_options_parse(argc, argv, &options, &done, &err);
    if (status == LW_OK && !done && options.report_only) {
        status = report_only(options.base.folder, &err);
    } else if (status == LW_OK && !done) {
        prepare(argc, argv, command);
        status = run_crossover(&options, command, &err);
    }
    if (signalled) {
        lw_log(LW_LOG_INFO, "interrupted; the same command goes on");
        return LW_INTERRUPT_EXIT_CODE;
    }
    return status == LW_OK ? 0 : lw_log_failure(&err);
}

/* ---- scaling ---- */

static enum lw_status run_scaling(const struct lw_scaling_options *options, const char *command,
                                  struct lw_error *err) {
    static struct lw_scaling scaling; /* too large for the stack */
    enum lw_status status = lw_scaling_measure(options, command, &signalled, &scaling, err);
    if (scaling.side[LW_SCALING_PATHS].point_count || status == LW_OK) {
        struct lw_error report_err = {0};
        const enum lw_status written = lw_scaling_report_write(&scaling, &report_err);
        status = with_report(status, written, &report_err, err);
    }
    if (status == LW_OK) lw_scaling_report_print(&scaling);
    lw_scaling_finish(&scaling);
    return status;
}

int lw_measure_scaling(int argc, char **argv) {
    struct lw_scaling_options options;
    struct lw_error err = {0};
    char command[COMMAND_SIZE];
    bool done = false;
    enum lw_status status = lw_scaling_options_parse(argc, argv, &options, &done, &err);
    if (status == LW_OK && !done) {
        prepare(argc, argv, command);
        status = run_scaling(&options, command, &err);
    }
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
