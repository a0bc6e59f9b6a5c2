/* lightwell-load.c: a load test of a server, the cost of its light beside opponents (crossover), and the
 * number of users from which on sharing is cheaper (scaling). */
#include "client/load/load_options.h"
#include "client/load/load_test.h"
#include "client/measure/measure.h"
#include "common/base/log.h"

#include <stdlib.h>
#include <string.h>

static int run_load_test(int argc, char **argv) {
    struct lw_load_options options;
    struct lw_load_report *report = NULL;
    struct lw_error err = {0};
    bool done = false, held = true;
    enum lw_status status = lw_load_options_parse(argc, argv, &options, &done, &err);
    if (status == LW_OK && !done) status = lw_load_test_run(&options, &report, &err);
    if (status == LW_OK && report) {
        status = lw_load_report_print(&options, report, &err);
        held = lw_load_report_check(&options, report);
    }
    free(report);
    if (status != LW_OK) return lw_log_failure(&err);
    return held ? 0 : 1;
}

int main(int argc, char **argv) {
    lw_log_init("lightwell-load", LW_LOG_INFO);
    if (argc > 1 && strcmp(argv[1], "crossover") == 0) return lw_measure_crossover(argc - 1, argv + 1);
    if (argc > 1 && strcmp(argv[1], "scaling") == 0) return lw_measure_scaling(argc - 1, argv + 1);
    return run_load_test(argc, argv);
}
