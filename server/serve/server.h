/* server.h: sessions over TCP and WebSocket on one libuv loop: hello, package, then tiles of the
 * newest snapshot, coarse first.
 * Flow:    snapshots -> [server: per session, what it lacks] -> writev -> link
 *          how far the first light is -> [server] -> sessions that wait for it
 *          what each session wants -> [server] -> what any of them wants -> solver
 *          updates of the scene -> [server: checked, in order] -> solver -> published -> answered
 * Threads: the loop owns all sessions [loop]. lw_server_publish(), lw_server_take_interest(),
 *          lw_server_channels_taken(), lw_server_take_updates() and lw_server_stop() are [any]: they hand
 * over,
 *          wake the loop and never wait for it. */
#ifndef LW_SERVE_SERVER_H
#define LW_SERVE_SERVER_H

#include "common/scene/scene_change.h"
#include "server/publish/snapshot.h"
#include "server/serve/server_limits.h"
#include "server/serve/server_page.h"
#include "server/serve/server_stats.h"
#include "server/serve/tls_context.h"

/** What the loop asks of the program that runs the server, and tells it; all of it [loop]. Zero: nothing. */
struct lw_server_hooks {
    void *context;
    void (*beat)(void *context); /* every beat_ms while the loop turns, from the start of lw_server_run() */
    unsigned beat_ms;
    void (*stopping)(void *context); /* the server has begun to end; once */
    void (*reload)(void *context);   /* SIGHUP: files are to be read again; NULL: it has its default effect */
    /* Makes a page of the monitoring port; false: there is none of that path. */
    bool (*page)(void *context, const char *path, struct lw_server_page *out_page);
};

/** Sockets that listen, on behalf of a server that follows another; -1: none. */
struct lw_server_sockets {
    int listen, http, metrics;
};

struct lw_waiting;

struct lw_server_desc {
    const char *host; /* numeric or a name */
    /* Of the server before this one, in place of host, port and the others; NULL: there was none. What is
     * used is set to -1. The control socket is made in lw_server_run(), once that server has closed its
     * own. */
    struct lw_server_sockets *sockets;
    /* Where the server's user and root change the scene: a path, or "auto" (control_path.h), whose failure is
     * a warning; NULL: nowhere. Copied. */
    const char *control_socket;
    const char *tokens;             /* file of tokens.h: each session needs one of them; NULL: none does */
    struct lw_tls_context_desc tls; /* certificate NULL: TCP and HTTP are plain. It outlives the server */
    uint16_t port;                  /* 0: the system picks one */
    /* HTTP and WebSocket, if http_host is not NULL: web_server.h says what the strings mean. */
    const char *http_host, *http_root, *http_hosts, *http_origins;
    uint16_t http_port;       /* 0: the system picks one */
    bool http_may_fail;       /* then there is a warning, and no HTTP */
    const char *metrics_host; /* monitoring, by hooks.page; NULL: none */
    uint16_t metrics_port;    /* 0: the system picks one */
    bool metrics_guarded;     /* by TLS, and for who says a token of tokens: Authorization: Bearer TOKEN */
    const struct lw_atlas_map *atlas_map; /* outlives the server */
    const uint8_t *package;               /* outlives the server */
    size_t package_size;
    const uint8_t *finishes; /* finish package, for clients that ask; outlives the server. NULL: none */
    size_t finishes_size;
    uint32_t bounces;   /* for the welcome */
    float target_error; /* for the welcome */
    float noise_shown;  /* likewise; 0: nothing filters */
    uint64_t features;  /* LW_FEATURE_* that a client must have: what its tiles are made of */
    uint32_t channels;  /* of which snapshots may have tiles, beside irradiance (tile_channels.h) */
    /* For the welcome: who draws (message.h). Without a bit set there is no LW_LIGHT_FORM_SPLIT. They
     * outlive it. */
    const uint8_t *client_lights, *client_materials;
    size_t client_lights_size, client_materials_size;
    /* How far the first light is, for sessions that wait for it; outlives the server. NULL: they are not
     * told. */
    const struct lw_waiting *first_light;
    /* What updates are checked against, immutable; NULL: no session may send any. */
    const struct lw_scene *scene;
    uint32_t sessions_max; /* 0: LW_SERVER_SESSIONS_MAX */
    /* 0: a tenth of them for each address, for the own machine all but a tenth. */
    uint32_t address_sessions_max;
    uint64_t rate_limit_bytes_hz; /* to each session; 0: whatever its link takes */
    uint32_t retry_after_ms;      /* clients are told at the end when to come back; 0: nothing */
    struct lw_server_hooks hooks;
    unsigned hello_timeout_ms;   /* 0: LW_SERVER_HELLO_TIMEOUT_S */
    unsigned stall_timeout_ms;   /* 0: LW_SERVER_STALL_TIMEOUT_S */
    unsigned excess_timeout_ms;  /* 0: LW_SERVER_EXCESS_TIMEOUT_S */
    unsigned package_timeout_ms; /* 0: LW_SERVER_PACKAGE_TIMEOUT_S */
    unsigned silence_timeout_ms; /* 0: LW_SERVER_SILENCE_S */
};

struct lw_server;

/** Compresses the packages, binds and listens; nothing is served before lw_server_run().
 * Errors: LW_UNAVAILABLE naming the address in use and what to do; LW_NO_HOST; LW_OS; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_server_create(const struct lw_server_desc *desc,
                                              struct lw_server **out_server, struct lw_error *err);
/** Reads its files again: certificate and key, tokens. Sessions whose token has gone, or changed its role,
 * are refused. Where a file cannot be used what was read before holds. Logs what became of it. [loop], as
 * hooks.reload */
void lw_server_reload(struct lw_server *server);
/** Duplicates the sockets on which it listens, for a server that is to follow: nobody who connects in between
 * is turned away. The receiver closes what is left of them. [loop] Errors: LW_OS. */
LW_MUST_CHECK enum lw_status lw_server_share_sockets(const struct lw_server *server,
                                                     struct lw_server_sockets *out_sockets,
                                                     struct lw_error *err);
void lw_server_sockets_close(struct lw_server_sockets *sockets);
/** Whether a signal, or its operator, has asked it to end. Valid after lw_server_run(). */
bool lw_server_was_signalled(const struct lw_server *server);
/** The port that it listens on. */
uint16_t lw_server_port(const struct lw_server *server);
/** The same for HTTP; 0: it does not serve that. */
uint16_t lw_server_http_port(const struct lw_server *server);
/** The same for monitoring. */
uint16_t lw_server_metrics_port(const struct lw_server *server);
/** Serves until lw_server_stop(), SIGINT or SIGTERM; a second signal has its default effect. With
 * hooks.reload SIGHUP calls it, but stops a server whose terminal has gone. SIGPIPE is ignored from here on,
 * in the whole process. Call from one thread, once; that thread is the loop. Errors: LW_OS. */
LW_MUST_CHECK enum lw_status lw_server_run(struct lw_server *server, struct lw_error *err);
/** Hands over a snapshot: takes a reference of its own. Newer snapshots replace
 * older ones not yet seen. [any] */
void lw_server_publish(struct lw_server *server, struct lw_snapshot *snapshot);
/** What all sessions together want. */
struct lw_server_interest {
    bool everything; /* some session wants every tile; then there is no list */
    uint8_t *levels; /* per lw_tile_id, as lw_interest_union_levels() lists them; the taker's to free() */
};
/** Takes what sessions want if it is not what was last taken; before the first time, that is nothing. One
 * taker, at its own pace: changes in between are put together. Returns whether there is news. [any] */
bool lw_server_take_interest(struct lw_server *server, struct lw_server_interest *out_interest);
/** Which channels sessions take now: bit for each; 0: nobody takes any. A session gets frames once there is a
 * snapshot with its channels. [any] */
uint32_t lw_server_channels_taken(const struct lw_server *server);
/** Takes the updates that sessions have sent, for frame `frame`: they are answered once that one, or a later
 * one, has been handed over by lw_server_publish(). One taker, at the beginning of each frame.
 * *out_change: their changes, in order, all passed by lw_scene_change_check(); the taker's to free().
 * Returns how many updates; some may be without a change. [any] */
size_t lw_server_take_updates(struct lw_server *server, uint64_t frame, struct lw_scene_change **out_change,
                              size_t *out_change_count);
/** True while updates wait to be taken. Valid as long as the server. [any] */
const _Atomic bool *lw_server_updates_wait(const struct lw_server *server);
/** Asks the loop to refuse new sessions, say goodbye and return from lw_server_run(). [any], and from signal
 * handlers by way of the loop's own SIGINT/SIGTERM watchers, which lw_server_run() installs. */
void lw_server_stop(struct lw_server *server);
/** The same for one that is followed by another at once, created with its sockets: clients are told
 * LW_SERVER_RELAY_MS. A signal that comes in between reaches that one. [any] */
void lw_server_relay(struct lw_server *server);
/** A consistent copy. [any] */
void lw_server_get_stats(const struct lw_server *server, struct lw_server_stats *out_stats);
void lw_server_destroy(struct lw_server *server);

#endif
