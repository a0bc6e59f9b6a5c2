/* server_stats.h: what a server counts: session -> server -> daemon_metrics. Copied under a mutex. */
#ifndef LW_SERVE_METRICS_SERVER_STATS_H
#define LW_SERVE_METRICS_SERVER_STATS_H

#include "server/serve/metrics/durations.h"

/** Sessions are peers that were welcomed; refused counts the refusals sent. */
struct lw_server_stats {
    uint64_t sessions_now, sessions_total, bytes_sent, tiles_sent, refused;
    uint64_t sessions_drawing; /* sessions now that get LW_TILE_CHANNEL_SPLIT */
    uint64_t loop_cpu_ns;      /* CPU time of the loop's thread; 0 before lw_server_run() */
    /* In the last whole window of LW_SERVER_WINDOW_S with connections; 0 before the first. */
    uint64_t loop_lag_p99_ns, loop_lag_max_ns; /* how late the loop came to due work */
    uint64_t ack_p99_ns; /* from the moment the loop had a frame to a session's ACK of it */
    /* As of the last look, LW_SERVER_LOOKS_HZ times a second. */
    uint64_t waiting_bytes, waiting_bytes_max; /* not taken by links: in all, and one session's most */
    uint64_t socket_bytes;                     /* taken by links and not by the peers' systems: in all */
    /* Since the start, as of the same look. */
    uint64_t session_ns;               /* sum of the times that sessions lasted */
    struct lw_durations loop_lag, ack; /* over all windows together */
};

#endif
