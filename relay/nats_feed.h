/* nats_feed.h: light from NATS as a server tells it: a thread at the far end of a socket pair, which speaks
 * the protocol's server side.
 * Flow:    NATS -> [feed] -> socket -> relay_upstream
 *          INTEREST, HOLDS, REPORT -> socket -> [feed] -> subscriptions, requests -> NATS -> lightwelld
 * Threads: a thread of its own; these functions are for the session's thread, one at a time.
 *
 * The session takes and checks its bytes as those of any server. The feed gives what the protocol allows: no
 * tile that builds on a version that it has not given, no tile of a later frame. Where something was lost it
 * asks for it, and until it has it says no SETTLED. */
#ifndef LW_RELAY_NATS_FEED_H
#define LW_RELAY_NATS_FEED_H

#include "common/base/tls_trust_desc.h"
#include "common/tile/atlas.h"
#include "proto/nats_wire.h"

struct lw_nats_feed;

struct lw_nats_feed_desc {
    const struct lw_nats_wire_address *address; /* copied */
    struct lw_tls_trust_desc trust;             /* for an address of TLS */
    uint64_t relay;                             /* number of the relay */
    unsigned timeout_ms;                        /* for connecting */
    bool takes_old;                             /* light of a lightwelld that is gone is better than none */
};

/** Connects, and finds the scene's light. *out_socket: the session's end; the caller closes it.
 * Errors: as lw_nats_link_create(); LW_UNAVAILABLE: no JetStream, or no lightwelld publishes there. */
LW_MUST_CHECK enum lw_status lw_nats_feed_create(const struct lw_nats_feed_desc *desc,
                                                 struct lw_nats_feed **out_feed, int *out_socket,
                                                 struct lw_error *err);
/** Ends the thread; waits for a call of libnats that is under way. */
void lw_nats_feed_destroy(struct lw_nats_feed *feed);

/** The scene is read: light may come. map: outlives the feed. To be called before HOLDS. */
void lw_nats_feed_set_map(struct lw_nats_feed *feed, const struct lw_atlas_map *map);
/** Whether lightwelld is there; else its light is of before. */
bool lw_nats_feed_is_alive(const struct lw_nats_feed *feed);

#endif
