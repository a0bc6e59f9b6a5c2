#include "client/measure/scaling.h"

#include "client/measure/command_line.h"
#include "client/measure/scaling_report.h"
#include "common/interrupt.h"
#include "common/log.h"
#include "common/wait_policy.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static _Atomic bool signalled;

static const struct lw_interrupt_phase measuring = {
    .answer =
        "stopping: what is measured is written after the frame under way; Ctrl-C again ends it at once"};

/* The first signal ends the measurement, the second the program. */
static void on_signal(int number) {
    (void)number;
    signalled = true;
}

static void print_result(const struct lw_scaling *x) {
    printf("report: %s/report.md\n", x->options.base.folder);
    if (x->shortfall) printf("no figures for counts of users: %s\n", x->shortfall);
    if (!x->repeats_done) return;
    printf("r(%u) = %.4g +- %.2g\n", x->count[0].users, x->first_ratio.mean, x->first_ratio.half);
    if (x->options.user_counts < 2) return;
    printf("m = %.4g +- %.2g\n", x->marginal.mean, x->marginal.half);
    printf("crossover at %.4g +- %.2g users\n", x->crossover.mean, x->crossover.half);
}

static enum lw_status run(const struct lw_scaling_options *options, const char *command,
                          struct lw_error *err) {
    static struct lw_scaling scaling; /* some 100 kB: no place on the stack */
    enum lw_status status = lw_scaling_report_prepare(options->base.folder, err);
    if (status != LW_OK) return status;
    lw_interrupt_watch(on_signal, &measuring);
    status = lw_scaling_measure(options, &signalled, &scaling, err);
    if (scaling.side[LW_SCALING_PATHS].point_count || status == LW_OK) {
        struct lw_error report_err = {0};
        enum lw_status written = lw_scaling_report_write(&scaling, command, &report_err);
        if (status == LW_OK && written != LW_OK) *err = report_err;
        if (status == LW_OK) status = written;
    }
    if (status == LW_OK) print_result(&scaling);
    lw_scaling_finish(&scaling);
    return status;
}

int lw_scaling_command(int argc, char **argv) {
    struct lw_scaling_options options;
    struct lw_error err = {0};
    char command[2048];
    bool done = false;
    enum lw_status status = lw_scaling_options_parse(argc, argv, &options, &done, &err);
    if (status == LW_OK && !done) {
        lw_wait_passively(argv - 1); /* argv[-1] is the program's own name: see scaling.h */
        lw_command_line_write(argc, argv, command, sizeof command);
        status = run(&options, command, &err);
    }
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
