/* relay_updates.h: the thread that forwards the updates of clients to a server above, and its answers to the
 * clients.
 * Flow:    clients -> lw_server_take_passed() -> [relay_updates] -> relay_upstream -> server above
 *          server above -> relay_upstream -> [relay_updates] -> lw_server_answer_passed() -> clients
 * Threads: a thread of its own: light does not wait for a connect. These functions are for main(), but
 *          lw_relay_updates_wake() and lw_relay_updates_get_stats() are [any]. */
#ifndef LW_RELAY_RELAY_UPDATES_H
#define LW_RELAY_RELAY_UPDATES_H

#include "relay/relay_upstream.h"
#include "server/serve/server.h"

#define LW_RELAY_UPDATES_TOKENS_MAX 64u /* tokens whose updates are forwarded at once */

/** What the thread asks of the relay's light. [the thread] */
struct lw_relay_updates_light {
    void *context;
    /** Where updates go now. */
    struct lw_relay_address (*where)(void *context);
    /** Whether the clients' light is of that run of the server above. */
    bool (*is_of_run)(void *context, uint64_t run);
    /** The clients' number of a frame of the server above. */
    uint64_t (*frame_for_clients)(void *context, uint64_t frame);
};

struct lw_relay_updates_desc {
    struct lw_relay_updates_light light;
    const struct lw_access *access; /* copied; its token is for updates of sessions without one */
    struct ssl_ctx_st *trust;       /* outlives it. NULL: in plain */
    unsigned timeout_ms;            /* for connecting */
    uint64_t relay;                 /* number of the relay */
};

struct lw_relay_updates_stats {
    uint64_t passed; /* updates of clients */
    uint64_t cpu_ns; /* processor time of the thread */
};

struct lw_relay_updates;

/** Starts the thread. Errors: LW_NO_MEMORY, LW_OS. */
LW_MUST_CHECK enum lw_status lw_relay_updates_create(const struct lw_relay_updates_desc *desc,
                                                     struct lw_relay_updates **out_updates,
                                                     struct lw_error *err);
/** Ends the thread; waits for a connect that is under way. */
void lw_relay_updates_destroy(struct lw_relay_updates *updates);

/** Forwards the updates of a server's clients, until lw_relay_updates_leave(). */
void lw_relay_updates_serve(struct lw_relay_updates *updates, struct lw_server *server);
void lw_relay_updates_leave(struct lw_relay_updates *updates);

/** There is something to take from the server. */
void lw_relay_updates_wake(struct lw_relay_updates *updates);
void lw_relay_updates_get_stats(const struct lw_relay_updates *updates,
                                struct lw_relay_updates_stats *out_stats);

#endif
