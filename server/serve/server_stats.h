/* server_stats.h: what a server counts: session -> server -> daemon_metrics. Copied under a mutex. */
#ifndef LW_SERVE_SERVER_STATS_H
#define LW_SERVE_SERVER_STATS_H

#include "server/serve/durations.h"

/** Sessions are peers that were welcomed; refused counts the refusals sent. */
struct lw_server_stats {
    uint64_t sessions_now, sessions_total, bytes_sent, tiles_sent, refused;
    uint64_t sessions_drawing; /* of those now: they get LW_LIGHT_FORM_SPLIT */
    uint64_t loop_cpu_ns;      /* CPU time of the loop's thread; 0 before lw_server_run() */
    /* Of the last whole window of LW_SERVER_WINDOW_S with connections; 0 before there was one. */
    uint64_t loop_lag_p99_ns, loop_lag_max_ns; /* how late the loop came to what was due */
    uint64_t ack_p99_ns; /* from the moment the loop had a frame to a session's ACK of it */
    /* As of the last look, LW_SERVER_LOOKS_HZ times a second. */
    uint64_t waiting_bytes, waiting_bytes_max; /* that links have not taken: in all, and of one session */
    uint64_t socket_bytes;                     /* that they have, and the peers' systems have not: in all */
    /* Since the start, as of the same look. */
    uint64_t session_ns;               /* that sessions lasted, added up */
    struct lw_durations loop_lag, ack; /* of the windows above, all of them together */
};

#endif
