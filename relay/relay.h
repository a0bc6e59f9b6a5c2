/* relay.h: the thread that feeds a server from the server above: finds one of several, keeps sessions with
 * it, passes light down and interest up. Updates have a thread of their own: relay_updates.h.
 * Flow:    servers above -> relay_upstream -> relay_light -> [relay] -> lw_server_publish() -> clients
 *          clients -> lw_server_take_interest() -> [relay] -> relay_upstream -> server above
 * Threads: a thread of its own. These functions are for main(), but lw_relay_wake() and lw_relay_get_stats()
 *          are [any].
 *
 * A server is of one scene and one run of the server above. When these change, the thread takes the new scene
 * in, and asks the server to end in favour of another one:
 *
 *     lw_relay_create()
 *     while (lw_relay_next_scene() is not NULL): a server of it, lw_relay_serve(), lw_server_run(),
 *         lw_relay_leave(), lw_server_destroy()
 *     lw_relay_destroy() */
#ifndef LW_RELAY_RELAY_H
#define LW_RELAY_RELAY_H

#include "relay/relay_upstream.h"
#include "server/serve/server.h"

#define LW_RELAY_UPSTREAMS_MAX 16u
/* Tiles of a frame wait for the rest of it for so long, then they are forwarded. */
#define LW_RELAY_HOLD_MS 20u
/* A channel that no client takes any more is kept for so long: clients come back. */
#define LW_RELAY_CHANNEL_LINGERS_MS 10000u

struct lw_relay_desc {
    const struct lw_relay_address *upstream; /* copied; tried in turn */
    uint32_t upstream_count;                 /* 1 to LW_RELAY_UPSTREAMS_MAX */
    const struct lw_relay_address *updates;  /* copied; updates go there. NULL: to the upstream */
    const struct lw_access *access; /* copied: for light, and for updates of sessions without token */
    const char *cache_folder;       /* for packages; outlives the relay. NULL: none */
    unsigned timeout_ms;            /* for connecting; 0: 5000 */
};

struct lw_relay_stats {
    bool is_connected;
    uint64_t lost_ns; /* how long there has been no server above; 0: there is one, or there was none yet */
    uint64_t connects, failures, bytes_received, tiles_received, snapshots, interest_tiles, updates_passed,
        cpu_ns;
    bool wants_everything, has_light;
    uint64_t frame;    /* the last snapshot's */
    char address[300]; /* names the server above, the last one that there was */
};

struct lw_relay;

/** Starts the thread, which connects. Errors: as lw_tls_trust_create(); LW_NO_MEMORY, LW_OS. */
LW_MUST_CHECK enum lw_status lw_relay_create(const struct lw_relay_desc *desc, struct lw_relay **out_relay,
                                             struct lw_error *err);
/** Ends the thread; waits for a connect that is under way. */
void lw_relay_destroy(struct lw_relay *relay);

uint64_t lw_relay_number(const struct lw_relay *relay);
/** How far the first light of the scene is; lives as long as the relay. */
const struct lw_waiting *lw_relay_waiting(const struct lw_relay *relay);

/** Waits for a scene that lw_relay_next_scene() has not given yet, up to timeout_ms; NULL: there is none. The
 * scene before it is freed: no server may use it. The relay's; until the next call. */
const struct lw_relay_scene *lw_relay_next_scene(struct lw_relay *relay, unsigned timeout_ms);
/** Feeds a server that was made for that scene, until lw_relay_leave(). */
/** name: where the server serves, for reports to the server above */
void lw_relay_serve(struct lw_relay *relay, struct lw_server *server, const char *name);
void lw_relay_leave(struct lw_relay *relay);
/** Whether another scene waits for lw_relay_next_scene(). [any] */
bool lw_relay_has_next(const struct lw_relay *relay);

/** There is something to take from the server: for its hooks.news. [any] */
void lw_relay_wake(struct lw_relay *relay);
/** Relays above, for lw_server_desc: under LW_MESSAGE_RELAYS_MAX. */
uint32_t lw_relay_above(struct lw_relay *relay, uint64_t out_above[LW_MESSAGE_RELAYS_MAX]);
void lw_relay_get_stats(struct lw_relay *relay, struct lw_relay_stats *out_stats);

#endif
