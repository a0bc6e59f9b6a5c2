/* web_server.h: HTTP for browsers: the files of the client, and WebSockets at /ws that are sessions.
 * Flow:    listener -> [web_server] -> web_files, or ws_transport -> session
 * Threads: everything here is [loop], but for what it reads at the start.
 *
 * libwebsockets does HTTP on the server's own loop; this makes the answers. Limits are
 * those of docs/access.md. */
#ifndef LW_SERVE_WEB_WEB_SERVER_H
#define LW_SERVE_WEB_WEB_SERVER_H

#include "server/serve/metrics/server_page.h"
#include "server/serve/sessions/session.h"

#define LW_WEB_SERVER_CONNECTIONS_MAX 1024u /* connections without a session (yet) */
#define LW_WEB_SERVER_HEADER_MAX      8192u /* bytes of a request's headers */
#define LW_WEB_SERVER_REQUEST_S       10u   /* for a request to come, and between two */
#define LW_WEB_SERVER_REQUESTS_HZ     20u   /* from one connection */
#define LW_WEB_SERVER_REQUESTS_BURST  40u
#define LW_WEB_SERVER_SLOWED_S        1u  /* from one more than that to the 429 */
#define LW_WEB_SERVER_ANSWER_S        20u /* for each 64 kB of an answer to be taken */

struct lw_web_server_desc {
    uv_loop_t *loop;
    struct lw_session_shared *sessions;
    struct lw_tls_context *tls; /* certificates for HTTPS; NULL: HTTP. Outlives it */
    const char *root;           /* folder of the client's files */
    const char *host;           /* it listens on this host: a Host may name it */
    const char *hosts;          /* further names that a Host may have, by commas; NULL: none */
    const char *origins;        /* further Origins that may open a WebSocket, by commas; NULL: none */
    const char *servers; /* WebSockets of other servers that our page may open, by commas; NULL: none */
    /* For monitoring: pages are made when they are asked for, and there are neither files
     * nor WebSockets. May be NULL. */
    bool (*page)(void *context, const char *path, struct lw_server_page *out_page);
    void *page_context;
    bool wants_token; /* a request has to say one of the sessions' tokens, of either role */
};

struct lw_web_server;

/** Reads the client's files. Without them a page says what to do.
 * Errors: as lw_web_files_read(); LW_OS: libwebsockets does not start. */
LW_MUST_CHECK enum lw_status lw_web_server_create(const struct lw_web_server_desc *desc,
                                                  struct lw_web_server **out_server, struct lw_error *err);

/** Takes the next connection of a listener. Errors: LW_NO_MEMORY, LW_OS; LW_UNAVAILABLE: its address has too
 * many, or connects too often. Then it is closed, or the listener may still have it. */
LW_MUST_CHECK enum lw_status lw_web_server_accept(struct lw_web_server *server, uv_stream_t *listener);

/** Begins to close all connections. Then run the loop until it has nothing
 * left, and destroy. NULL is fine. */
void lw_web_server_close(struct lw_web_server *server);
void lw_web_server_destroy(struct lw_web_server *server);

#endif
