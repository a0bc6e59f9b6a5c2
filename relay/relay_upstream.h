/* relay_upstream.h: one session with the server above: a client that takes light without decoding it, or one
 * that passes updates on.
 * Flow:    server above -> [relay_upstream] -> package, finishes; FRAME, TILE, SETTLED -> relay_light
 *          interest -> [relay_upstream] -> server above
 * Threads: one thread at a time. */
#ifndef LW_RELAY_UPSTREAM_H
#define LW_RELAY_UPSTREAM_H

#include "client/lib/access.h"
#include "common/base/waiting.h"
#include "proto/message.h"
#include "relay/relay_light.h"

/** Where a server is. */
struct lw_relay_address {
    char host[256]; /* or unix:PATH, or an address of NATS (nats_wire.h) */
    uint16_t port;
};

struct lw_relay_upstream;

struct lw_relay_upstream_desc {
    const char *host; /* or unix:PATH, or an address of NATS (nats_wire.h) */
    uint16_t port;
    const struct lw_token *token;               /* NULL: none */
    struct ssl_ctx_st *trust;                   /* NULL: in plain */
    const struct lw_tls_trust_desc *nats_trust; /* whom to believe at an address of NATS by TLS */
    unsigned timeout_ms;                        /* for connecting, and for the welcome */
    uint64_t relay;                             /* number of this relay */
    bool control;                               /* it passes updates on, and takes no light */
    bool has_light;           /* it has such light already: that of a server that is gone is no use */
    bool draws;               /* it wants light without that of client lights, if the server has it */
    const char *cache_folder; /* for packages; outlives it. NULL: none */
};

/** What a WELCOME says of the light, without the session's own things. */
struct lw_relay_welcome {
    uint64_t run; /* as the last WELCOME or FRAME named it; 0: unknown: no two sessions have the same light */
    struct lw_package_hash package_hash, finish_hash;
    uint64_t package_size, finish_size; /* finish_size 0: there are none */
    uint64_t features;                  /* LW_FEATURE_DCT, or 0 */
    uint32_t finer;                     /* levels that are finer than level 0 */
    uint32_t bounces;
    float target_error, noise_shown;
    bool has_draws;      /* the bits below are known; not so if the session did not ask */
    bool has_directions; /* tiles of where its light comes from */
    uint8_t *client_lights, *client_materials;
    size_t client_lights_size, client_materials_size;
};
/** Whether two sessions have light of the same scene: their WELCOMEs differ in nothing but the run. */
bool lw_relay_welcome_same_scene(const struct lw_relay_welcome *a, const struct lw_relay_welcome *b);

/** Connects, says hello, and waits for the welcome. Errors: as lw_link_connect(); LW_NOT_ALLOWED: it takes
 * no such token, or the session may not send updates; LW_PROTOCOL; LW_USAGE: a loop of relays. */
LW_MUST_CHECK enum lw_status lw_relay_upstream_create(const struct lw_relay_upstream_desc *desc,
                                                      struct lw_relay_upstream **out_upstream,
                                                      struct lw_error *err);
void lw_relay_upstream_destroy(struct lw_relay_upstream *upstream);

const struct lw_relay_welcome *lw_relay_upstream_welcome(const struct lw_relay_upstream *upstream);
/** The channel of light that the session gets. */
uint32_t lw_relay_upstream_channel(const struct lw_relay_upstream *upstream);
/** Whether its server is there: NATS may have light of one that is gone. */
bool lw_relay_upstream_is_current(const struct lw_relay_upstream *upstream);
/** Relays that the light comes through, the nearest first: under LW_MESSAGE_RELAYS_MAX. */
const uint64_t *lw_relay_upstream_relays(const struct lw_relay_upstream *upstream, uint32_t *out_count);
const char *lw_relay_upstream_address(const struct lw_relay_upstream *upstream);
uint64_t lw_relay_upstream_bytes(const struct lw_relay_upstream *upstream); /* received */
uint64_t lw_relay_upstream_tiles(const struct lw_relay_upstream *upstream); /* received */
/** When to come back, as its REFUSAL said, ms; 0: it did not. */
uint32_t lw_relay_upstream_retry_after_ms(const struct lw_relay_upstream *upstream);

/** Asks for the package, or takes it from the folder; it is there once lw_relay_upstream_light() is not NULL.
 * Errors: as lw_relay_upstream_take(). */
LW_MUST_CHECK enum lw_status lw_relay_upstream_begin(struct lw_relay_upstream *upstream,
                                                     struct lw_error *err);
/** Tells the server which tiles of its run `light` holds, and takes changes to them from now on.
 * light  of the scene of lw_relay_upstream_welcome() and its run (lw_relay_light_begin_run()); outlives it */
LW_MUST_CHECK enum lw_status lw_relay_upstream_resume(struct lw_relay_upstream *upstream,
                                                      struct lw_relay_light *light, struct lw_error *err);
/** NULL before the package is there. After lw_relay_upstream_begin() it belongs to the upstream until
 * lw_relay_upstream_give(). */
struct lw_relay_light *lw_relay_upstream_light(const struct lw_relay_upstream *upstream);
/** Whether finishes are there, or there are none. They are asked for once there is light. */
bool lw_relay_upstream_has_finishes(const struct lw_relay_upstream *upstream);

/** A scene, with its description for clients. */
struct lw_relay_scene {
    struct lw_relay_welcome welcome;
    uint8_t *package, *finishes; /* finishes: NULL: none */
    size_t package_size, finishes_size;
    struct lw_relay_light *light;
};
void lw_relay_scene_finish(struct lw_relay_scene *scene);
/** Hands its scene over, complete; it goes on with its light. */
void lw_relay_upstream_give(struct lw_relay_upstream *upstream, struct lw_relay_scene *out_scene);

/** The tiles that clients want. They are sent to the server when it is time; over LW_MESSAGE_INTEREST_MAX
 * tiles: everything. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_relay_upstream_want(struct lw_relay_upstream *upstream, bool everything,
                                                    const uint32_t *tile, uint32_t count);

/** Sends an update; *out_sent: false: the link is busy, or too many wait: later. Errors: LW_CLOSED. */
LW_MUST_CHECK enum lw_status lw_relay_upstream_update(struct lw_relay_upstream *upstream, uint64_t request,
                                                      const struct lw_scene_change *change, size_t count,
                                                      bool *out_sent, struct lw_error *err);
/** The caller of lw_relay_upstream_take() hears of answers here; `updated` is of that call. */
typedef void lw_relay_upstream_answered(void *context, const struct lw_message_updated *updated);
void lw_relay_upstream_set_answered(struct lw_relay_upstream *upstream, lw_relay_upstream_answered *answered,
                                    void *context);
/** Reports this relay and the ones below it (server/serve/metrics/relay_tree.h), if the server above lists
 * relays and the link has room. Errors: LW_CLOSED, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_relay_upstream_report(struct lw_relay_upstream *upstream, const char *text,
                                                      size_t size, struct lw_error *err);
/** Progress of its first light: WAITING raises it. NULL: nobody wants to know. Outlives it. */
void lw_relay_upstream_set_waiting(struct lw_relay_upstream *upstream, struct lw_waiting *waiting);

/** Whether something waits for its time: lw_relay_upstream_take() is due within LW_INTEREST_TELL_NS. */
bool lw_relay_upstream_is_waiting(const struct lw_relay_upstream *upstream);
/** For poll(): its descriptor and events. */
int lw_relay_upstream_descriptor(const struct lw_relay_upstream *upstream, short *out_events);
/** Takes all that came, without waiting, and sends all that is due; to be called at least every
 * LW_LINK_PING_S.
 * Errors: LW_CLOSED, LW_TIMED_OUT, LW_PROTOCOL, LW_BAD_DATA, LW_NO_MEMORY; then it is to be destroyed. */
LW_MUST_CHECK enum lw_status lw_relay_upstream_take(struct lw_relay_upstream *upstream, struct lw_error *err);

#endif
