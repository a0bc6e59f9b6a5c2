/* plan_replay: makes the plans of a log again (lightwelld --plan-log), and tells them.
 *
 *   plan_replay LOG          a line for each list of each frame
 *   plan_replay LOG FRAME    of one frame, each entry */
#include "server/solve/adapt/plan_log.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv) {
    struct lw_error err = {0};
    uint64_t plans = 0;
    if (argc < 2 || argc > 3) {
        fprintf(stderr, "Usage: plan_replay LOG [FRAME]\n");
        return 64;
    }
    enum lw_status status =
        lw_plan_log_replay(argv[1], stdout, argc > 2 ? strtoull(argv[2], NULL, 10) : 0, &plans, &err);
    if (status != LW_OK) {
        fprintf(stderr, "plan_replay: %s\n", err.text);
        return lw_status_exit_code(status);
    }
    printf("%" PRIu64 " plans, each the same when made again\n", plans);
    return 0;
}
