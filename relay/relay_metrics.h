/* relay_metrics.h: what a running lightwell-relay tells of itself: /metrics, /healthz, /readyz.
 * Flow:    figures of the relay's thread and of the server -> [relay_metrics] -> monitoring
 * Threads: [any]. */
#ifndef LW_RELAY_METRICS_H
#define LW_RELAY_METRICS_H

#include "common/base/waiting.h"
#include "relay/relay.h"

struct lw_relay_metrics_state {
    double started_s; /* since the Unix epoch */
    bool is_stopping;
    struct lw_waiting_state first_light;
};

/** The page of a path; false: there is none. */
bool lw_relay_metrics_page(const struct lw_relay_stats *relay, const struct lw_relay_metrics_state *state,
                           const struct lw_server_stats *serve, const char *path,
                           struct lw_server_page *out_page);

#endif
