#include "client/load/crossover.h"

#include "common/log.h"

int lw_crossover_command(int argc, char **argv) {
    (void)argc;
    (void)argv;
    struct lw_error err = {0};
    lw_status_fail(&err, LW_USAGE, "crossover is not built yet");
    return lw_log_failure(&err);
}
