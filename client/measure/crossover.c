#include "client/measure/crossover.h"

#include "client/measure/command_line.h"
#include "client/measure/crossover_report.h"
#include "client/measure/crossover_run.h"
#include "common/interrupt.h"
#include "common/log.h"
#include "common/wait_policy.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>

static _Atomic bool signalled;

static const struct lw_interrupt_phase measuring = {
    .answer = "stopping: what is measured stays, and the same command goes on; Ctrl-C again ends it at once"};

/* The first signal ends the measurement, the second the program. */
static void on_signal(int number) {
    (void)number;
    signalled = true;
}

static enum lw_status report_only(const char *folder, struct lw_error *err) {
    struct lw_measure_store store;
    enum lw_status status = lw_measure_store_open(&store, folder, true, err);
    if (status == LW_OK) status = lw_crossover_report_write(&store, err);
    lw_measure_store_finish(&store);
    return status;
}

static enum lw_status measure(const struct lw_crossover_options *options, const char *command,
                              struct lw_error *err) {
    static struct lw_crossover_row row; /* some 100 kB: no place on the stack */
    lw_interrupt_watch(on_signal, &measuring);
    enum lw_status status = lw_crossover_row_open(&row, options, command, &signalled, err);
    if (status == LW_OK) status = lw_crossover_run(&row, err);
    if (row.base.store.expense_count) {
        struct lw_error report_err = {0};
        const enum lw_status written = lw_crossover_report_write(&row.base.store, &report_err);
        if (status == LW_OK && written != LW_OK) *err = report_err;
        if (status == LW_OK) status = written;
    } else if (status == LW_BAD_DATA) { /* of the scene: the same command would fail again */
        struct lw_error report_err = {0};
        if (lw_crossover_report_refuse(&row.base.store, err->text, &report_err) != LW_OK)
            lw_log(LW_LOG_WARNING, "%s", report_err.text);
    }
    lw_crossover_row_finish(&row);
    return status;
}

int lw_crossover_command(int argc, char **argv) {
    struct lw_crossover_options options;
    struct lw_error err = {0};
    char command[2048];
    bool done = false;
    enum lw_status status = lw_crossover_options_parse(argc, argv, &options, &done, &err);
    if (status == LW_OK && !done) {
        lw_wait_passively(argv - 1); /* argv[-1] is the program's own name: see crossover.h */
        lw_command_line_write(argc, argv, command, sizeof command);
        status =
            options.report_only ? report_only(options.base.folder, &err) : measure(&options, command, &err);
    }
    if (signalled) {
        lw_log(LW_LOG_INFO, "interrupted; the same command goes on");
        return LW_INTERRUPT_EXIT_CODE;
    }
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
