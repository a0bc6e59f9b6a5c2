/* server.h: sessions over TCP and WebSocket on one libuv loop: hello, package, then tiles of the
 * newest snapshot, coarse first.
 * Flow:    snapshots -> [server: the tiles that each session lacks] -> writev -> link
 *          progress of the first light -> [server] -> waiting sessions
 *          interest of each session -> [server: union] -> solver
 *          scene updates -> [server: checked, in order] -> solver -> published -> answered
 *          of a relay: scene updates -> [server] -> server above -> [server] -> answered
 * Threads: the loop owns all sessions [loop]. lw_server_publish(), lw_server_take_interest(),
 *          lw_server_channels_taken(), lw_server_take_updates() and lw_server_stop() are [any]: they
 *          hand over, wake the loop and never wait for it. */
#ifndef LW_SERVE_SERVER_H
#define LW_SERVE_SERVER_H

#include "common/scene/scene_change.h"
#include "server/publish/snapshot.h"
#include "server/serve/admission/server_limits.h"
#include "server/serve/metrics/relay_tree.h"
#include "server/serve/metrics/server_page.h"
#include "server/serve/metrics/server_stats.h"
#include "server/serve/sessions/passed_updates.h"
#include "server/serve/transports/tls_context.h"

/** Calls from the loop to the program that runs the server; all [loop]. A zero hook is not called. */
struct lw_server_hooks {
    void *context;
    void (*beat)(void *context); /* every beat_ms while the loop turns, from the start of lw_server_run() */
    unsigned beat_ms;
    /* There may be something to take: interest, channels, updates. Between two turns of the loop; of a relay
     * alone. */
    void (*news)(void *context);
    void (*stopping)(void *context); /* once, when the server begins to end; it still listens */
    void (*reload)(void *context);   /* on SIGHUP: read files again. NULL: SIGHUP has its default effect */
    /* Makes a page of the monitoring port. Returns false if there is no page of that path. */
    bool (*page)(void *context, const char *path, struct lw_server_page *out_page);
};

/** Listening sockets that a server hands to its successor; -1: none. */
struct lw_server_sockets {
    int listen, http, metrics;
};

struct lw_waiting;

struct lw_server_desc {
    const char *host; /* numeric or a name */
    /* Sockets of the predecessor, used in place of host, port, http_* and metrics_*. Sockets that the server
     * takes are set to -1. It opens its control socket in lw_server_run(), after the predecessor has closed
     * its own. NULL: no predecessor. */
    struct lw_server_sockets *sockets;
    /* Path of the control socket, by which the server's user and root change the scene; "auto": the default
     * path (control_path.h), whose failure is only a warning. NULL: no control socket. Copied. */
    const char *control_socket;
    bool is_unix_only;  /* sessions come by the control socket alone: no --listen, no HTTP */
    const char *tokens; /* token file (tokens.h): each session needs a token. NULL: none needs one */
    struct lw_tls_context_desc tls; /* outlives the server. certificate NULL: TCP and HTTP without TLS */
    uint16_t port;                  /* 0: the system picks one */
    /* HTTP and WebSocket, if http_host is not NULL: web_server.h says what the strings mean. */
    const char *http_host, *http_root, *http_hosts, *http_origins;
    uint16_t http_port;                   /* 0: the system picks one */
    bool http_may_fail;                   /* a failure to listen is a warning: the server runs without HTTP */
    const char *metrics_host;             /* monitoring by hooks.page; NULL: none */
    uint16_t metrics_port;                /* 0: the system picks one */
    bool metrics_guarded;                 /* requires TLS and a token: Authorization: Bearer TOKEN */
    const struct lw_atlas_map *atlas_map; /* outlives the server */
    const uint8_t *package;               /* outlives the server, unless it takes it */
    size_t package_size;
    const uint8_t *finishes; /* finish package for clients that ask; outlives it, too. NULL: none */
    size_t finishes_size;
    bool takes_packages; /* both are malloc'ed: the server frees them as soon as they are compressed */
    const char *name;    /* for the welcome; outlives the server. NULL: lightwelld and its version */
    const char *servers; /* for the welcome over TCP: other servers of this light; outlives it. NULL: none */
    const char *web_servers; /* the same for pages: addresses of WebSockets, checked (serve_options.c) */
    uint64_t run;            /* for the welcome; 0: by chance */
    uint32_t bounces;        /* for the welcome */
    float target_error;      /* for the welcome */
    float noise_shown;       /* for the welcome; 0: no filter */
    uint64_t features;       /* LW_FEATURE_* that a client must have to decode tiles */
    uint32_t channels;       /* channels of tiles in snapshots, beside irradiance (tile_channels.h) */
    /* For the welcome: bit sets of client lights and materials (message.h). All zero: there is no
     * LW_TILE_CHANNEL_SPLIT. They outlive the server. */
    const uint8_t *client_lights, *client_materials;
    size_t client_lights_size, client_materials_size;
    /* Progress of the first light, for waiting sessions; outlives the server. NULL: sessions hear none. */
    const struct lw_waiting *first_light;
    /* The scene that updates are checked against, immutable. NULL: no session of a solver's server may send
     * updates; a relay's updates are forwarded unchecked. */
    const struct lw_scene *scene;
    /* A relay's: its number, and the numbers of the relays that its light comes through, the nearest first.
     * Then versions and frames are those of another server: no tile gets a form in wider steps, and a client
     * may hold a newer one. 0: it is none. */
    uint64_t relay;
    const uint64_t *relays_above; /* copied */
    uint32_t relays_above_count;  /* under LW_MESSAGE_RELAYS_MAX */
    uint32_t sessions_max;        /* 0: LW_SERVER_SESSIONS_MAX */
    /* Sessions of one address. 0: a tenth of sessions_max; for this machine's addresses nine tenths. */
    uint32_t address_sessions_max;
    uint64_t rate_limit_bytes_hz; /* per session; 0: no limit */
    uint32_t retry_after_ms;      /* for the goodbye: when clients may come back; 0: not said */
    struct lw_server_hooks hooks;
    unsigned hello_timeout_ms;   /* 0: LW_SERVER_HELLO_TIMEOUT_S */
    unsigned stall_timeout_ms;   /* 0: LW_SERVER_STALL_TIMEOUT_S */
    unsigned excess_timeout_ms;  /* 0: LW_SERVER_EXCESS_TIMEOUT_S */
    unsigned package_timeout_ms; /* 0: LW_SERVER_PACKAGE_TIMEOUT_S */
    unsigned silence_timeout_ms; /* 0: LW_SERVER_SILENCE_S */
};

struct lw_server;

/** Binds and listens; nothing is served before lw_server_run(). A thread begins to compress the packages.
 * Errors: LW_UNAVAILABLE naming the address in use and what to do; LW_NO_HOST; LW_OS; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_server_create(const struct lw_server_desc *desc,
                                              struct lw_server **out_server, struct lw_error *err);
/** Reads certificate, key and tokens again, and logs the result. Refuses sessions whose token was removed or
 * has another role. Keeps the earlier contents of a file that cannot be used. [loop], from hooks.reload */
void lw_server_reload(struct lw_server *server);
/** Duplicates the listening sockets for a successor, so that no connection is refused in between. The
 * receiver closes the sockets that it does not use. [loop] Errors: LW_OS. */
LW_MUST_CHECK enum lw_status lw_server_share_sockets(const struct lw_server *server,
                                                     struct lw_server_sockets *out_sockets,
                                                     struct lw_error *err);
void lw_server_sockets_close(struct lw_server_sockets *sockets);
/** Whether a signal or the operator ended it. Valid after lw_server_run(). */
bool lw_server_was_signalled(const struct lw_server *server);
/** The port of the TCP listener. */
uint16_t lw_server_port(const struct lw_server *server);
/** The port of the HTTP listener; 0: none. */
uint16_t lw_server_http_port(const struct lw_server *server);
/** The port of the monitoring listener; 0: none. */
uint16_t lw_server_metrics_port(const struct lw_server *server);
/** Serves until lw_server_stop(), SIGINT or SIGTERM; a second signal has its default effect. With
 * hooks.reload SIGHUP calls it, but stops a server whose terminal has gone. SIGPIPE is ignored from here on,
 * in the whole process. Call from one thread, once; that thread is the loop.
 * Errors: LW_OS; LW_NO_MEMORY, for the packages. */
LW_MUST_CHECK enum lw_status lw_server_run(struct lw_server *server, struct lw_error *err);
/** Hands a snapshot over and takes a reference to it. A newer snapshot replaces one that the loop has not
 * taken yet. [any] */
void lw_server_publish(struct lw_server *server, struct lw_snapshot *snapshot);
/** The union of all sessions' interest. */
struct lw_server_interest {
    bool everything; /* a session wants every tile; `levels` is NULL then */
    uint64_t number; /* this list's, from 1 on: snapshots say which one the solver had (snapshot.h) */
    /* Per lw_tile_id (lw_interest_union_levels(), lw_fine_turns_weigh()). The caller frees it. NULL: a
     * relay's. */
    uint8_t *levels;
    /* A relay's: the tiles that a session lists, by lw_tile_id. Tiles of finer levels come last, in the
     * order of fine_turns.h. The caller frees it. */
    uint32_t *tile;
    uint32_t tile_count;
};
/** Takes the union of interest if it differs from the one last taken, which is empty at first. Returns
 * whether it does. For one caller, at its own pace: changes in between are merged. [any] */
bool lw_server_take_interest(struct lw_server *server, struct lw_server_interest *out_interest);
/** The relays below, as they report themselves: at most LW_RELAY_TREE_MAX. Returns their number. [any] */
uint32_t lw_server_get_relays_below(struct lw_server *server, struct lw_relay_tree_node *out_node,
                                    uint32_t capacity);
/** The set of channels that sessions take now; 0: there is no session. A session gets frames from the first
 * snapshot on that has its channels. [any] */
uint32_t lw_server_channels_taken(const struct lw_server *server);
/** Takes the updates that sessions have sent. The server answers them when lw_server_publish() gets frame
 * `frame` or a later one. For one caller, at the beginning of each frame. *out_change: their changes, in
 * order, checked by lw_scene_change_check(); the caller frees it. Returns the number of updates; an update
 * may have no change. [any] */
size_t lw_server_take_updates(struct lw_server *server, uint64_t frame, struct lw_scene_change **out_change,
                              size_t *out_change_count);
/** Tells the server of changes that the caller makes in its first frame, such as those of the last run. The
 * server checks updates against the scene with these changes. To be called before lw_server_run().
 * Returns the number of valid changes before the first invalid one. */
size_t lw_server_begin_with_changes(struct lw_server *server, const struct lw_scene_change *change,
                                    size_t count);
/** A flag that is true while updates wait to be taken. It lives as long as the server. [any] */
const _Atomic bool *lw_server_updates_wait(const struct lw_server *server);
/** The same of a relay, one update at a time; the caller frees its changes. false: there is none. [any] */
bool lw_server_take_passed(struct lw_server *server, struct lw_passed_update *out_update);
/** The answer to one of them, copied. The session hears it with the frame that it says, or a later one.
 * false: there is no memory. [any] */
bool lw_server_answer_passed(struct lw_server *server, uint64_t number,
                             const struct lw_message_updated *answer);
/** No answer will come, and the server above may have made the update: its session is ended, as by a broken
 * link. [any] */
void lw_server_lose_passed(struct lw_server *server, uint64_t number);
/** The light comes through other relays now. Sessions of relays are ended. Relays connect again and get the
 * new state. [any] */
void lw_server_set_relays_above(struct lw_server *server, const uint64_t *above, uint32_t count);
/** For relays: the light goes on as another run, and its FRAMEs say so. Sessions that cannot read it are
 * ended. Their clients connect again and get the new state. To be called before lw_server_publish() of the
 * first such FRAME. [any] */
void lw_server_set_run(struct lw_server *server, uint64_t run);

/** Welcome and packages of the scene, for a publisher that serves it without sessions. */
struct lw_server_scene {
    struct lw_blob *welcome;                /* with every feature that there is */
    struct lw_blob **chunk, **finish_chunk; /* messages, in order */
    uint32_t chunk_count, finish_chunk_count;
    uint32_t channels; /* a bit for each channel that a session may ask for */
    uint64_t run;
};
/** lw_server_scene_finish() frees it. Waits until the packages are compressed. From the thread that calls
 * lw_server_run(), before that; afterwards [any]. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_server_get_scene(struct lw_server *server, struct lw_server_scene *out_scene);
void lw_server_scene_finish(struct lw_server_scene *scene);

/** Interest of clients without a session here. */
struct lw_server_outside {
    uint32_t channels;    /* a bit for each that is wanted; 0: there is nobody */
    bool everything;      /* then the lists do not count */
    const uint32_t *tile; /* ids of no finer level, each once */
    size_t tile_count;
    const uint64_t *fine; /* names of tiles of finer levels, under map->fine_names, each once */
    size_t fine_count;
};
/** For a solver's server: this counts as the interest of one session, instead of the outside interest before.
 * Tiles of finer levels for which there is no id are left out. outside: copied.
 * Returns false where there is no memory: then it stays as it was. [any] */
bool lw_server_set_outside(struct lw_server *server, const struct lw_server_outside *outside);
/** Replaces the relays below that have no session here: they take light from NATS. Copied; count: at most
 * LW_RELAY_TREE_MAX. [any] */
void lw_server_set_relays_outside(struct lw_server *server, const struct lw_relay_tree_node *node,
                                  uint32_t count);

/** Asks the loop to refuse new sessions, say goodbye and return from lw_server_run(). [any], and from signal
 * handlers by way of the loop's own SIGINT/SIGTERM watchers, which lw_server_run() installs. */
void lw_server_stop(struct lw_server *server);
/** Stops in favour of a successor that has the sockets: the goodbye asks clients to connect again after
 * LW_SERVER_RELAY_MS. A signal in between reaches the successor. [any] */
void lw_server_relay(struct lw_server *server);
/** Copies the statistics, consistent among themselves. [any] */
void lw_server_get_stats(const struct lw_server *server, struct lw_server_stats *out_stats);
void lw_server_destroy(struct lw_server *server);

#endif
