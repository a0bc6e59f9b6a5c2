/* server_private.h: a server's state, and what its files do for one another. Each uses those below it:
 *
 *   server.c            the loop: its timers and signals, files that are read again, creating and ending
 *   server_listeners.c  the sockets that a server listens on, and connections that come in
 *   server_handover.c   what the loop and the solver's thread give each other
 *   server_packages.c   the scene's packages in compressed chunks
 *
 * Threads: [loop], but for what lw_server.mutex guards. For these files alone. */
#ifndef LW_SERVE_SERVER_PRIVATE_H
#define LW_SERVE_SERVER_PRIVATE_H

#include "server/serve/server.h"
#include "server/serve/sessions/session.h"
#include "server/serve/transports/tcp_transport.h"
#include "server/serve/web/web_server.h"

#define LW_SERVER_ENDPOINTS 4

/* Listening sockets. */
struct lw_server_endpoint {
    uv_stream_t *listener;
    struct lw_web_server **web; /* NULL: they are sessions by themselves */
    unsigned taken, most;       /* in a turn */
    bool is_held;               /* one more came: it is taken in the next turn */
};

/* The interest of relays over NATS, copied: they have no sessions. */
struct lw_server_outside_copy {
    uint32_t channels; /* bit for each; 0: nobody is there */
    bool everything;
    uint32_t *tile; /* room for all of them */
    size_t tile_count;
    uint64_t *fine; /* names of tiles of finer levels that have no place in `tile` yet */
    size_t fine_count;
};

/* A thread that compresses the packages while others begin their work. Its results are read once
 * lw_server_packages_await() has ended. */
struct lw_server_packer {
    uv_thread_t thread;
    bool runs;
    enum lw_status status;
    const uint8_t *package, *finishes;
    size_t package_size, finishes_size;
    bool takes_packages;
};

struct lw_server {
    uv_loop_t loop;
    struct lw_server_endpoint endpoint[LW_SERVER_ENDPOINTS];
    uv_tcp_t listener, http_listener, metrics_listener;
    uv_pipe_t control_listener;
    uv_tcp_t spare; /* for a connection that nothing else could take */
    uv_poll_t top;  /* on the highest descriptor (reserve_descriptors()) */
    int top_fd;     /* 0: none */
    uv_async_t wake;
    uv_prepare_t prepare; /* before the loop waits */
    uv_check_t check;     /* after it has waited */
    uv_idle_t busy;       /* runs while sessions are due: then it does not wait */
    uv_timer_t tick, lag; /* run while there are connections: an idle server sleeps */
    uv_timer_t beat;      /* runs if hooks want it */
    struct lw_server_hooks hooks;
    uint64_t lagged_ns;         /* when lag last came */
    uint64_t ticked_ns;         /* when tick last came */
    uint64_t window_ns;         /* when the window began that loop_lag and shared.ack belong to */
    uint32_t reported_channels; /* channels that sessions took when hooks.news was last called */
    struct lw_histogram loop_lag;
    struct lw_durations lag_all; /* the same since the start */
    uv_signal_t interrupt, terminate, hangup;
    bool has_terminal; /* its log goes to one */
    char *tokens_path;
    char *control_path; /* path of a socket still to be made */
    bool is_unix_only;
    bool stopping, signalled;
    uint16_t port, http_port, metrics_port;
    uint32_t *order;
    struct lw_session_shared shared;
    struct lw_tcp_transport_shared tcp;
    struct lw_server_outside_copy outside; /* as it counts */
    struct lw_web_server *web;             /* NULL: there is no HTTP */
    struct lw_web_server *metrics_web;     /* NULL: there is no monitoring */
    struct lw_server_packer packer;

    uv_mutex_t mutex;                   /* guards what follows; held for an assignment only */
    struct lw_snapshot *latest;         /* handed over, not yet seen by the loop */
    struct lw_server_interest interest; /* handed over, not yet taken by the solver */
    bool has_interest, stop_requested, relay_requested;
    bool has_above; /* handed over, not yet seen by the loop */
    uint64_t above[LW_MESSAGE_RELAYS_MAX];
    uint32_t above_count;
    uint64_t run;                               /* the same; 0: none */
    struct lw_server_outside_copy next_outside; /* the same */
    bool has_next_outside;
    bool runs;           /* the loop's thread is in lw_server_run() */
    clockid_t cpu_clock; /* its CPU clock; valid while it runs */
};

/** Closes a handle that was made, unless it is closing. */
static inline void lw_server_close_handle(uv_handle_t *handle) {
    if (handle->type != UV_UNKNOWN_HANDLE && !uv_is_closing(handle)) uv_close(handle, NULL);
}

#endif
