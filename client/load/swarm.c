#include "client/load/swarm.h"

enum lw_status lw_swarm_run(const struct lw_load_options *options, bool *out_held, struct lw_error *err) {
    (void)options;
    (void)out_held;
    return lw_status_fail(err, LW_USAGE, "the load generator is not built yet");
}
