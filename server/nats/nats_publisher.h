/* nats_publisher.h: hands the light of snapshots to NATS: changes as plain messages, the newest whole of each
 * tile and the packages in JetStream. Takes the interest of relays.
 * Flow:    snapshots -> [publisher] -> NATS -> relays (relay/nats_feed.h)
 *          relays -> NATS -> [publisher: union] -> wants()
 *          reports of relays -> NATS -> [publisher] -> reports()
 * Threads: a thread of its own, which alone waits for NATS. lw_nats_publisher_publish() and
 *          lw_nats_publisher_get_stats() are [any]; they wait for nothing.
 *
 * Subjects and payloads: proto/wire_format.md, "Light through NATS". Nothing is kept there that cannot be
 * made again. */
#ifndef LW_NATS_NATS_PUBLISHER_H
#define LW_NATS_NATS_PUBLISHER_H

#include "common/base/tls_trust_desc.h"
#include "proto/nats_wire.h"
#include "server/publish/snapshot.h"
#include "server/serve/metrics/relay_tree.h"

#define LW_NATS_PUBLISHER_KEEP_MS    5000u /* the newest whole of a tile that changes is kept so often */
#define LW_NATS_PUBLISHER_RELAYS_MAX 256u  /* relays at a time; each irradiance counts */
#define LW_NATS_PUBLISHER_FINE_MAX   2048u /* tiles of finer levels that the solver is asked for */

/** What relays want, all of them together. */
struct lw_nats_publisher_wants {
    uint32_t channels;    /* a bit for each: channels of irradiance, and where it comes from */
    bool everything;      /* then there is no list */
    const uint32_t *tile; /* ids of no finer level, each once */
    size_t tile_count;
    const uint64_t *fine; /* names of tiles of finer levels (atlas.h), each once */
    size_t fine_count;
};

struct lw_nats_publisher_desc {
    const struct lw_nats_wire_address *address; /* copied */
    struct lw_tls_trust_desc trust;             /* for an address of TLS */
    const struct lw_atlas_map *map;             /* outlives it */
    uint32_t object_count, light_count;
    uint32_t channels; /* a bit for each channel that the light may have (tile_channels.h) */
    uint64_t run;
    /* The welcome and the chunks of the packages, as sessions get them; copied references. */
    struct lw_blob *welcome, *const *chunk, *const *finish_chunk;
    uint32_t chunk_count, finish_chunk_count;
    /* Called in the publisher's thread when wants have changed; they are of that call. */
    void (*wants)(void *context, const struct lw_nats_publisher_wants *wants);
    /* Called in the publisher's thread with all relays that report, and those below them; each once, at most
     * LW_RELAY_TREE_MAX. They are of that call. NULL: nobody listens. */
    void (*reports)(void *context, const struct lw_relay_tree_node *node, uint32_t count);
    void *context;
};

struct lw_nats_publisher_stats {
    bool is_connected;
    bool is_stood_down; /* another lightwelld publishes under this name */
    uint32_t relays;    /* with interest; one that takes two channels of irradiance counts twice */
    uint64_t messages, bytes, kept, failures, requests, refused_messages;
};

struct lw_nats_publisher;

/** Connects, makes the stream, and hands over the packages. Errors: as lw_nats_link_create(); LW_UNAVAILABLE:
 * there is no JetStream, it is full, or another lightwelld publishes under this name; LW_USAGE: the scene has
 * more than NATS takes. */
LW_MUST_CHECK enum lw_status lw_nats_publisher_create(const struct lw_nats_publisher_desc *desc,
                                                      struct lw_nats_publisher **out_publisher,
                                                      struct lw_error *err);
/** Ends the thread; waits for a call of libnats that is under way. */
void lw_nats_publisher_destroy(struct lw_nats_publisher *publisher);

/** Takes a reference. A newer snapshot replaces one that the thread has not taken yet. [any] */
void lw_nats_publisher_publish(struct lw_nats_publisher *publisher, struct lw_snapshot *snapshot);
void lw_nats_publisher_get_stats(const struct lw_nats_publisher *publisher,
                                 struct lw_nats_publisher_stats *out_stats);

#endif
