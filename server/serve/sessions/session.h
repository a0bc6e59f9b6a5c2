/* session.h: one connected peer: what it said, what it was sent, what it gets next.
 * Flow:    transport -> messages -> [session] -> what it lacks of the newest snapshot -> transport
 * Threads: everything here is [loop]. For server.c and the transports alone.
 * session_private.h says which file does what. */
#ifndef LW_SERVE_SESSIONS_SESSION_H
#define LW_SERVE_SESSIONS_SESSION_H

#include "common/base/histogram.h"
#include "common/base/waiting.h"
#include "common/scene/scene_roster.h"
#include "server/serve/admission/address_rates.h"
#include "server/serve/admission/message_rates.h"
#include "server/serve/admission/peer_log.h"
#include "server/serve/admission/server_limits.h"
#include "server/serve/admission/tokens.h"
#include "server/serve/metrics/relay_tree.h"
#include "server/serve/metrics/server_stats.h"
#include "server/serve/sessions/passed_updates.h"
#include "server/serve/sessions/session_transport.h"
#include "server/serve/sessions/updates.h"
#include "server/serve/tiles/deltas.h"
#include "server/serve/tiles/fine_names.h"
#include "server/serve/tiles/interest_union.h"
#include "server/serve/tiles/priority.h"

#include <uv.h>

#define LW_SESSION_RECENT 64u /* snapshots whose arrival is remembered */

struct lw_session;

struct lw_session_limits {
    uint32_t sessions_max;
    uint32_t address_sessions_max; /* for one address; 0: lw_address_places_share() */
    uint64_t hello_timeout_ns, stall_timeout_ns, excess_timeout_ns, package_timeout_ns, silence_timeout_ns;
    uint64_t rate_limit_bytes_hz; /* to each session; 0: none */
};

/* Sessions that wait, in order. */
struct lw_session_queues {
    struct lw_session_queue {
        struct lw_session *first, *last;
    } due[2];                        /* a turn is coming: the first queue asked for it */
    struct lw_session_queue paced;   /* they are at their rate limit */
    struct lw_session_queue waiting; /* for the transcoder's answer */
    struct lw_session_inbox {
        struct lw_session *first, *last;
    } unread, slowed; /* with messages that had no turn; with messages that have to wait */
};

struct lw_session_channels {
    /* By number (tile_channels.h); zeroed where it is not served. */
    struct lw_session_channel {
        uint32_t number;
        uint32_t session_count;       /* sessions that get its tiles */
        struct lw_snapshot *snapshot; /* newest that has this channel; NULL before the first */
        uint64_t generation;          /* counts those */
        uint32_t *changed;            /* tile ids, by priority, that it changed against the one before */
        uint32_t changed_count;
        struct lw_transcoder *transcoder; /* NULL: tiles are of a codec that has no deltas */
        bool has_coarse;                  /* narrow links get tiles in wider steps: it makes those */
        struct lw_deltas deltas;          /* from the snapshot before to this one */
        struct lw_priority priority;
    } at[LW_TILE_CHANNELS_MAX];
    uint32_t served;        /* bit for each */
    _Atomic uint32_t taken; /* bit for each: some session is streamed to in it */
};

/** What all sessions of a server share. server.c owns it. */
struct lw_session_shared {
    struct lw_session_limits limits;
    const struct lw_atlas_map *atlas_map;
    struct lw_message_welcome welcome; /* without the session's number */
    /* The compressed packages, each part cut into LW_SESSION_CHUNK bytes. */
    struct lw_session_package {
        struct lw_session_chunk {
            struct lw_blob *blob; /* the message */
            uint64_t end;         /* where its data ends in the compressed package */
            uint32_t part;        /* its part of the package */
        } * chunk;
        uint32_t chunk_count;
    } package, finishes;                     /* finishes: without a chunk there are none */
    uint32_t first_tiles;                    /* the tiles of every object's coarsest level */
    const uint32_t *order;                   /* tile ids: every object's coarsest level first */
    uint64_t *listed;                        /* bit per tile, all 0: to find those that a list has twice */
    struct lw_interest_union interest_union; /* by all sessions that are streamed to */
    struct lw_fine_names fine;               /* ids of tiles that sessions list */
    const struct lw_scene *scene;            /* what updates are checked against; NULL: there are none */
    struct lw_scene_roster roster;           /* the scene's, after all updates so far */
    struct lw_updates updates;               /* of all sessions */
    bool is_relay;                           /* it forwards light, and updates: */
    struct lw_passed_updates passed;
    uint64_t relays[LW_MESSAGE_RELAYS_MAX]; /* a relay's own, then of the relays above */
    uint32_t relay_count;
    struct lw_relay_tree tree;            /* the relays below, as they report themselves */
    uint32_t reporting_count;             /* sessions of such */
    const struct lw_waiting *first_light; /* how far it is; NULL: nobody hears of it */
    uint64_t epoch; /* counts ticks and snapshots seen: in each, a session may change its mind once */
    struct lw_snapshot *snapshot; /* newest; NULL before the first */
    uint64_t generation;          /* counts the snapshots that the loop has seen */
    struct lw_session_channels channels;
    struct lw_session_recent {
        uint64_t frame, at_ns;
    } recent[LW_SESSION_RECENT]; /* by generation: when the loop got each of the last snapshots */
    struct lw_histogram ack;     /* ns from then to a session's ACK; the server empties it */
    struct lw_durations ack_all; /* the same since the start */

    struct lw_session *first; /* all connections */
    struct lw_session_queues queues;
    uint32_t place_count;       /* sessions that have one, until they are closed */
    uint32_t control_count;     /* sessions of these that may control, by a token */
    uint32_t turned_away_count; /* connections that got none */
    uint64_t number;            /* the last session's */
    uv_mutex_t stats_mutex;
    struct lw_server_stats stats; /* guarded by stats_mutex */
    uint32_t retry_after_ms;      /* goes with LW_REFUSAL_SHUTDOWN */
    const char *web_servers;      /* for the welcome of pages, in the place of its servers; NULL: none */
    struct lw_address_places places, turned_away; /* connections that have one; that got none */
    struct lw_address_rates connecting;
    struct lw_message_memory parse; /* for the message that is handled */
    struct lw_tokens *tokens;       /* NULL: nobody needs one */
    struct lw_peer_log log;
    /* Answers an operator; text: malloc'ed, at most LW_MESSAGE_REPORT_MAX bytes, or NULL. */
    enum lw_report_code (*ask)(void *server, const struct lw_message_ask *ask, char **out_text,
                               size_t *out_size);
    void (*on_open)(void *server);  /* there is a connection */
    void (*on_close)(void *server); /* one is gone */
    void *server;
};

#define LW_SESSION_CHUNK (64u << 10) /* bytes of package data in a PACKAGE_CHUNK */

/* Bytes of tiles that are sent before a FINISH_CHUNK, over its own, while tiles wait. */
#define LW_SESSION_TILES_FIRST 3u

/** Whether an address may connect once more; counts it then. Beyond that a session gets no place
 * (peer.is_too_many), or there is none. */
bool lw_session_may_connect(struct lw_session_shared *shared, const struct lw_address *at);

/** A session on a link that is there; the link outlives it. It may be refused at once. NULL: there is no
 * memory, or too many wait for their close. */
struct lw_session *lw_session_open(struct lw_session_shared *shared, struct lw_session_transport *link,
                                   const struct lw_session_peer *peer);

/* What a transport tells of its link; of bytes that have come it tells session_handlers.h. */
/** Counts bytes beside messages: frames of a WebSocket (LW_MESSAGE_RATES_FRAMES), or bytes that the link took
 * for itself (_OVERHEAD). Where they are too many the peer is not read for a time: it keeps the rest. */
void lw_session_count_other(struct lw_session *session, enum lw_message_rates_kind kind, size_t count);
/** The link has taken what write() left over, or result is libuv's error.
 * was_full  the link took no more for a time; a link that takes everything later does not say it */
void lw_session_written(struct lw_session *session, int result, bool was_full);
/** The peer has ended the link, or result is libuv's error. */
void lw_session_lost(struct lw_session *session, int result);
/** The link is gone, after its close(): frees the session. */
void lw_session_closed(struct lw_session *session);

/** Answers an update of the session, which is still there. */
void lw_session_answer(struct lw_session *session, const struct lw_message_updated *answer);

/** Looks at the session's time limits, and adds what waits to the counts. */
struct lw_session_waiting {
    uint64_t bytes, bytes_max, socket_bytes; /* as in struct lw_server_stats */
};
void lw_session_tick(struct lw_session *session, uint64_t now_ns, struct lw_session_waiting *waiting);

/** Says goodbye as well as it can, then closes. */
void lw_session_refuse(struct lw_session *session, enum lw_refusal code, const char *format, ...)
    LW_PRINTF(3, 4);

/** Refuses one whose token is none of the server's any more, or allows something else now. */
void lw_session_check_token(struct lw_session *session);

/** Closes at once; memory goes with lw_session_closed(). */
void lw_session_close(struct lw_session *session, const char *reason);

struct lw_session *lw_session_next(const struct lw_session *session);

/** Whether the peer said that it is a relay. */
bool lw_session_is_relay(const struct lw_session *session);
bool lw_session_reads_runs(const struct lw_session *session);

#endif
