#include "server/serve/web/web_server.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "server/serve/transports/tcp_transport.h"
#include "server/serve/transports/tls_context.h"
#include "server/serve/transports/ws_transport.h"
#include "server/serve/web/content_coding.h"
#include "server/serve/web/http_origin.h"
#include "server/serve/web/web_files.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#define ENDPOINT     "/ws"
#define HEADERS_SIZE 4096u       /* bytes of an answer's headers */
#define PIECE        (64u << 10) /* bytes of its body, written at once */
#define ROOM         LWS_PRE + PIECE

/* lws_http_get_uri_and_method() */
enum method { GET = 0, HEAD = 7 };

struct lw_web_server {
    struct lws_context *context;
    struct lws_vhost *vhost;
    struct lws_protocols protocols[3];
    struct lw_web_files files;
    struct lw_tls_context *tls;             /* NULL: it speaks plain */
    struct ssl_ctx_st *ssl;                 /* libwebsockets' own, while there is a vhost; follows tls */
    char *host, *hosts, *origins, *servers; /* servers: apart by blanks, as in a policy */
    bool (*page)(void *context, const char *path, struct lw_server_page *out_page);
    void *page_context;
    bool wants_token;
    struct lw_ws_transport_shared sockets;
    uint32_t connection_count;       /* without sessions */
    struct lw_address_places places; /* these connections' */
    uint8_t room[ROOM];              /* for the current write: libwebsockets keeps the unwritten rest */
};

/* One peer: requests, one after another, or a session. */
struct connection {
    struct lw_web_server *server;
    struct lw_address at;
    struct lw_ws_transport *socket; /* it is a WebSocket */
    const uint8_t *body;            /* the unwritten rest of the answer */
    size_t body_size;
    char *made; /* a page that was made for this one */
    char host[LW_HTTP_ORIGIN_MAX];
    double requests; /* so far, less what time has made good */
    uint64_t asked_ns;
    bool is_slowed;
    bool is_public; /* pages of any origin may read the answer */
};

/* Where there is no client. */
static const char page[] =
    "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>lightwelld</title>\n"
    "<h1>lightwelld serves light here</h1>\n"
    "<p>The browser client is not installed: its folder is missing or empty. Start lightwelld with "
    "<code>--web-root FOLDER</code>, or build the client and install it.</p>\n"
    "<p>Programs connect by TCP, or by WebSocket at <code>" ENDPOINT "</code>.</p></html>\n";

/* ---- answers ---- */

static bool add_header(struct lws *wsi, uint8_t **at, uint8_t *end, const char *name, const char *value) {
    return lws_add_http_header_by_name(wsi, (const unsigned char *)name, (const unsigned char *)value,
                                       (int)strlen(value), at, end) == 0;
}

/* Rights of a page of ours: our own files, our own WebSocket, and those of other servers.
 * The Host was looked at before. An IPv6 address is no source of a policy (CSP3, host-part): 'self' stands
 * for it, and for its WebSockets where the browser follows CSP3. */
static bool add_policy(struct lws *wsi, const struct connection *c, uint8_t **at, uint8_t *end) {
    char policy[HEADERS_SIZE], sockets[2 * LW_HTTP_ORIGIN_MAX + 20] = "";
    const char *servers = c->server->servers;
    if (*c->host != '[') snprintf(sockets, sizeof sockets, " ws://%s wss://%s", c->host, c->host);
    snprintf(policy, sizeof policy,
             "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; "
             "img-src 'self' data: blob:; connect-src 'self'%s%s%s; base-uri 'none'; "
             "form-action 'none'; frame-ancestors 'none'",
             sockets, *servers ? " " : "", servers);
    return add_header(wsi, at, end, "content-security-policy:", policy);
}

static bool add_common(struct lws *wsi, uint8_t **at, uint8_t *end) {
    return add_header(wsi, at, end, "x-content-type-options:", "nosniff") &&
           add_header(wsi, at, end, "referrer-policy:", "no-referrer") &&
           add_header(wsi, at, end, "cross-origin-opener-policy:", "same-origin") &&
           add_header(wsi, at, end, "cross-origin-embedder-policy:", "require-corp") &&
           add_header(wsi, at, end, "cross-origin-resource-policy:", "same-origin");
}

/* Further headers about a file. */
struct about {
    const char *tag;    /* NULL: the answer is made for this request */
    const char *coding; /* NULL: none */
    bool varies;        /* with Accept-Encoding */
};

/* Writes headers from server->room on. Returns 0, or -1: the connection is to be closed. */
static int write_headers(struct lws *wsi, struct connection *c, unsigned status, const char *type,
                         size_t size, const struct about *about) {
    uint8_t *begin = c->server->room + LWS_PRE, *at = begin, *end = begin + HEADERS_SIZE;
    char length[24];
    snprintf(length, sizeof length, "%zu", size);
    bool done = lws_add_http_header_status(wsi, status, &at, end) == 0 && add_common(wsi, &at, end) &&
                add_header(wsi, &at, end, "cache-control:", about->tag ? "no-cache" : "no-store");
    if (done && about->tag) done = add_header(wsi, &at, end, "etag:", about->tag);
    if (done && about->coding) done = add_header(wsi, &at, end, "content-encoding:", about->coding);
    if (done && about->varies) done = add_header(wsi, &at, end, "vary:", "accept-encoding");
    if (done && type)
        done = add_header(wsi, &at, end, "content-type:", type) &&
               add_header(wsi, &at, end, "content-length:", length);
    if (done && type && strncmp(type, "text/html", 9) == 0) done = add_policy(wsi, c, &at, end);
    if (done && c->is_public) done = add_header(wsi, &at, end, "access-control-allow-origin:", "*");
    if (done && status == 405) done = add_header(wsi, &at, end, "allow:", "GET, HEAD");
    if (done && status == 429) done = add_header(wsi, &at, end, "retry-after:", "1");
    if (done && status == 401) done = add_header(wsi, &at, end, "www-authenticate:", "Bearer");
    if (done && status >= 400 && status != 404) done = add_header(wsi, &at, end, "connection:", "close");
    if (!done || lws_finalize_http_header(wsi, &at, end)) return -1;
    return lws_write(wsi, begin, (size_t)(at - begin), LWS_WRITE_HTTP_HEADERS) < 0 ? -1 : 0;
}

/* The next request may come. */
static int end_answer(struct lws *wsi) { return lws_http_transaction_completed(wsi) ? -1 : 0; }

/* A short answer in one go; after it the connection is closed: what else the
 * peer sends makes no difference. */
static int refuse(struct lws *wsi, struct connection *c, unsigned status, const char *text) {
    const size_t size = strlen(text);
    if (write_headers(wsi, c, status, "text/plain; charset=utf-8", size, &(struct about){0}) < 0) return -1;
    memcpy(c->server->room + LWS_PRE, text, size);
    (void)lws_write(wsi, c->server->room + LWS_PRE, size, LWS_WRITE_HTTP_FINAL);
    return -1;
}

static int write_body(struct lws *wsi, struct connection *c) {
    const size_t size = c->body_size < PIECE ? c->body_size : PIECE;
    const bool last = size == c->body_size;
    LW_INVARIANT(size > 0 && size <= PIECE && !c->socket);
    memcpy(c->server->room + LWS_PRE, c->body, size);
    if (lws_write(wsi, c->server->room + LWS_PRE, size, last ? LWS_WRITE_HTTP_FINAL : LWS_WRITE_HTTP) < 0)
        return -1;
    c->body += size;
    c->body_size -= size;
    if (last) return end_answer(wsi);
    lws_set_timeout(wsi, PENDING_TIMEOUT_HTTP_CONTENT, LW_WEB_SERVER_ANSWER_S);
    lws_callback_on_writable(wsi);
    return 0;
}

static int answer(struct lws *wsi, struct connection *c, unsigned status, const char *type,
                  const uint8_t *bytes, size_t size, const struct about *about, bool head) {
    if (write_headers(wsi, c, status, type, size, about) < 0) return -1;
    LW_INVARIANT_DEAR(!c->body_size); /* one answer at a time */
    if (head || !size) return end_answer(wsi);
    c->body = bytes;
    c->body_size = size;
    lws_set_timeout(wsi, PENDING_TIMEOUT_HTTP_CONTENT, LW_WEB_SERVER_ANSWER_S);
    lws_callback_on_writable(wsi);
    return 0;
}

/* ---- requests ---- */

/* A header's text; false: it is absent, or longer than fits. */
static bool get_header(struct lws *wsi, enum lws_token_indexes which, char *dst, size_t size) {
    return lws_hdr_total_length(wsi, which) > 0 && lws_hdr_copy(wsi, dst, (int)size, which) > 0;
}

static bool has_header(struct lws *wsi, enum lws_token_indexes which) {
    return lws_hdr_total_length(wsi, which) > 0;
}

/* By the address that the connection is at. */
static bool is_own_address(struct lws *wsi, const char *name) {
    struct sockaddr_storage address = {0};
    socklen_t length = sizeof address;
    char text[64] = "";
    if (getsockname(lws_get_socket_fd(wsi), (struct sockaddr *)&address, &length) != 0) return false;
    if (address.ss_family == AF_INET6)
        uv_ip6_name((const struct sockaddr_in6 *)&address, text, sizeof text);
    else if (address.ss_family == AF_INET)
        uv_ip4_name((const struct sockaddr_in *)&address, text, sizeof text);
    const char *v4 = strncasecmp(text, "::ffff:", 7) == 0 ? text + 7 : text;
    return strcasecmp(text, name) == 0 || strcasecmp(v4, name) == 0;
}

/* Notes the Host, which must be one of ours. */
static bool check_host(struct lws *wsi, struct connection *c) {
    char name[LW_HTTP_ORIGIN_MAX];
    *c->host = '\0';
    if (!get_header(wsi, WSI_TOKEN_HOST, c->host, sizeof c->host) ||
        !lw_http_origin_host_name(c->host, name, sizeof name) ||
        !(lw_http_origin_is_loopback(name) || strcasecmp(name, c->server->host) == 0 ||
          lw_http_origin_is_listed(c->server->hosts, name) || is_own_address(wsi, name))) {
        *c->host = '\0';
        return false;
    }
    return true;
}

static int refuse_host(struct lws *wsi, struct connection *c) {
    return refuse(wsi, c, 403,
                  "This server does not go by that name: lightwelld --http-host NAME adds one.\n");
}

static bool check_origin(struct lws *wsi, const struct connection *c) {
    char origin[LW_HTTP_ORIGIN_MAX];
    if (!has_header(wsi, WSI_TOKEN_ORIGIN)) return true; /* no browser */
    return get_header(wsi, WSI_TOKEN_ORIGIN, origin, sizeof origin) &&
           (lw_http_origin_is_same(origin, c->host) || lw_http_origin_is_listed(c->server->origins, origin));
}

static int refuse_origin(struct lws *wsi, struct connection *c) {
    return refuse(wsi, c, 403,
                  "Pages of that origin may not connect: lightwelld --http-origin ORIGIN adds one.\n");
}

static int answer_nothing(struct lws *wsi, struct connection *c, bool head) {
    static const char text[] = "There is no such page.\n";
    return answer(wsi, c, 404, "text/plain; charset=utf-8", (const uint8_t *)text, sizeof text - 1,
                  &(struct about){0}, head);
}

static int answer_page(struct lws *wsi, struct connection *c, const char *path, bool head) {
    struct lw_server_page made = {0};
    if (!c->server->page(c->server->page_context, path, &made)) return answer_nothing(wsi, c, head);
    free(c->made);
    c->made = made.text;
    return answer(wsi, c, made.status, made.type, (const uint8_t *)made.text, made.size, &(struct about){0},
                  head);
}

/* A file, in the coding that the client wants of those it has. */
static int answer_file(struct lws *wsi, struct connection *c, const struct lw_web_file *file, bool head) {
    char accept[LW_CONTENT_CODING_ACCEPT_MAX], tag[64];
    const unsigned codings = lw_web_files_codings(file);
    const bool says = get_header(wsi, WSI_TOKEN_HTTP_ACCEPT_ENCODING, accept, sizeof accept);
    const enum lw_content_coding coding = lw_content_coding_choose(says ? accept : NULL, codings);
    if (coding == LW_CONTENT_CODING_NONE)
        return refuse(wsi, c, 406, "Accept-Encoding excludes all that this file has.\n");
    const struct lw_web_file *sent = coding == LW_CONTENT_CODING_IDENTITY ? file : file->coded[coding];
    const struct about about = {
        .tag = sent->tag, .coding = lw_content_coding_name(coding), .varies = codings != 0};
    if (get_header(wsi, WSI_TOKEN_HTTP_IF_NONE_MATCH, tag, sizeof tag) && strstr(tag, sent->tag))
        return answer(wsi, c, 304, NULL, NULL, 0, &about, true);
    return answer(wsi, c, 200, file->type, sent->bytes, sent->size, &about, head);
}

static bool is_plain_at_tls(struct lws *wsi, const struct connection *c) {
    return c->server->tls && !lws_is_ssl(wsi);
}

static int refuse_plain(struct lws *wsi, struct connection *c) {
    return refuse(wsi, c, 400, "This server speaks TLS alone: its addresses begin with https.\n");
}

/* A monitor sends "Bearer TOKEN", with the digits of a token. */
static bool says_token(struct lws *wsi, const struct lw_session_shared *sessions) {
    static const char scheme[] = "Bearer ";
    char text[sizeof scheme + 2 * LW_TOKEN_SIZE];
    struct lw_token token;
    if (!sessions->tokens || !get_header(wsi, WSI_TOKEN_HTTP_AUTHORIZATION, text, sizeof text) ||
        strncasecmp(text, scheme, sizeof scheme - 1) != 0 ||
        !lw_token_parse(text + sizeof scheme - 1, strlen(text + sizeof scheme - 1), &token))
        return false;
    const bool known = lw_tokens_role(sessions->tokens, token.bytes) != LW_TOKENS_NONE;
    explicit_bzero(&token, sizeof token);
    explicit_bzero(text, sizeof text);
    return known;
}

/* Counts one more. */
static bool asks_too_often(struct connection *c) {
    const uint64_t now_ns = lw_clock_ns();
    LW_INVARIANT(now_ns >= c->asked_ns && c->requests >= 0);
    const double made_good = 1e-9 * (double)(now_ns - c->asked_ns) * LW_WEB_SERVER_REQUESTS_HZ;
    c->requests = c->requests > made_good ? c->requests - made_good + 1 : 1;
    c->asked_ns = now_ns;
    return c->requests > LW_WEB_SERVER_REQUESTS_BURST;
}

/* After a time in which nothing more is read: it would only come back, and as fast. */
static int slow_down(struct lws *wsi, struct connection *c) {
    c->is_slowed = true;
    lws_rx_flow_control(wsi, 0);
    lws_set_timeout(wsi, PENDING_TIMEOUT_HTTP_CONTENT, LW_WEB_SERVER_ANSWER_S);
    lws_set_timer_usecs(wsi, LW_WEB_SERVER_SLOWED_S * LWS_USEC_PER_SEC);
    return 0;
}

static int refuse_haste(struct lws *wsi, struct connection *c) {
    return c->is_slowed ? refuse(wsi, c, 429, "Too many requests on one connection: ask more slowly.\n") : 0;
}

static int handle_request(struct lws *wsi, struct connection *c, const char *path) {
    struct lw_web_server *server = c->server;
    char *uri;
    int uri_length;
    const int method = lws_http_get_uri_and_method(wsi, &uri, &uri_length);
    if (asks_too_often(c)) return slow_down(wsi, c);
    if (is_plain_at_tls(wsi, c)) return refuse_plain(wsi, c);
    /* A browser hides from a page why its WebSocket was refused: the page asks for the same path by GET. The
     * answer says no more than the refusal. */
    c->is_public = !server->page && strcmp(path, ENDPOINT) == 0;
    if (!check_host(wsi, c)) return refuse_host(wsi, c);
    if (server->wants_token && !says_token(wsi, server->sockets.sessions))
        return refuse(wsi, c, 401, "This wants a token of the server's: Authorization: Bearer TOKEN.\n");
    if (method != GET && method != HEAD) return refuse(wsi, c, 405, "There is GET and HEAD.\n");
    if (has_header(wsi, WSI_TOKEN_HTTP_CONTENT_LENGTH) || has_header(wsi, WSI_TOKEN_HTTP_TRANSFER_ENCODING))
        return refuse(wsi, c, 400, "A request has no body here.\n");
    if (server->page) return answer_page(wsi, c, path, method == HEAD);
    if (strcmp(path, ENDPOINT) == 0)
        return check_origin(wsi, c) ? refuse(wsi, c, 426, "This is for WebSockets.\n")
                                    : refuse_origin(wsi, c);
    const struct lw_web_file *file = lw_web_files_find(&server->files, path);
    if (!file && !server->files.count && strcmp(path, "/") == 0)
        return answer(wsi, c, 200, "text/html; charset=utf-8", (const uint8_t *)page, sizeof page - 1,
                      &(struct about){0}, method == HEAD);
    return file ? answer_file(wsi, c, file, method == HEAD) : answer_nothing(wsi, c, method == HEAD);
}

/* Returns 0: libwebsockets goes on with the handshake. */
static int handle_upgrade(struct lws *wsi, struct connection *c, const char *what) {
    char path[sizeof ENDPOINT + 1];
    if (is_plain_at_tls(wsi, c)) return refuse_plain(wsi, c);
    if (!check_host(wsi, c)) return refuse_host(wsi, c);
    if (c->server->page || strcasecmp(what, "websocket") != 0 ||
        !get_header(wsi, WSI_TOKEN_GET_URI, path, sizeof path) || strcmp(path, ENDPOINT) != 0)
        return refuse(wsi, c, 404, "WebSockets are at " ENDPOINT ".\n");
    if (!check_origin(wsi, c)) return refuse_origin(wsi, c);
    if (!has_header(wsi, WSI_TOKEN_PROTOCOL))
        return refuse(wsi, c, 400, "The WebSocket's protocol must be " LW_WS_TRANSPORT_PROTOCOL ".\n");
    return 0;
}

/* ---- events ---- */

static struct connection *connection_of(struct lws *wsi) { return lws_get_opaque_user_data(wsi); }

/* One more that is no session, if there is a place for its address. */
static bool take_place(struct lw_web_server *server, const struct lw_address *at) {
    if (server->connection_count >= LW_WEB_SERVER_CONNECTIONS_MAX ||
        lw_address_places_take(&server->places, at,
                               lw_address_places_share(at, LW_WEB_SERVER_CONNECTIONS_MAX)) != LW_OK)
        return false;
    server->connection_count++;
    LW_INVARIANT(server->connection_count <= LW_WEB_SERVER_CONNECTIONS_MAX);
    return true;
}

static void give_place_back(struct lw_web_server *server, const struct lw_address *at) {
    lw_address_places_give(&server->places, at);
    LW_INVARIANT(server->connection_count > 0);
    server->connection_count--;
}

static void free_connection(struct lws *wsi, struct connection *c) {
    lws_set_opaque_user_data(wsi, NULL);
    if (!c->socket) give_place_back(c->server, &c->at);
    lw_ws_transport_destroy(c->socket);
    free(c->made);
    free(c);
}

/* libwebsockets has made an SSL_CTX. */
static int set_identity(struct lw_web_server *server, struct ssl_ctx_st *ssl) {
    if (!server->tls || lw_tls_context_lead(server->tls, ssl) != LW_OK) return 1;
    server->ssl = ssl;
    return 0;
}

static int on_http(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t size) {
    (void)size;
    if (reason == LWS_CALLBACK_OPENSSL_LOAD_EXTRA_SERVER_VERIFY_CERTS)
        return set_identity(lws_context_user(lws_get_context(wsi)), user);
    struct connection *c = wsi ? connection_of(wsi) : NULL;
    if (!c) return 0;
    switch (reason) {
    case LWS_CALLBACK_HTTP:
        return handle_request(wsi, c, in);
    case LWS_CALLBACK_HTTP_WRITEABLE:
        return c->body_size ? write_body(wsi, c) : 0;
    case LWS_CALLBACK_TIMER:
        return refuse_haste(wsi, c);
    case LWS_CALLBACK_HTTP_CONFIRM_UPGRADE:
        return handle_upgrade(wsi, c, in);
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: /* a WebSocket asked for no protocol of ours */
    case LWS_CALLBACK_HTTP_BODY:
        return -1;
    case LWS_CALLBACK_WSI_DESTROY:
        free_connection(wsi, c);
        return 0;
    default:
        return 0;
    }
}

static int open_socket(struct lws *wsi, struct connection *c) {
    LW_INVARIANT(!c->socket); /* it is opened once: its place is given back here */
    c->socket = lw_ws_transport_open(&c->server->sockets, wsi);
    if (!c->socket) return -1;
    give_place_back(c->server, &c->at); /* it has one of a session now */
    return 0;
}

/* The protocol has bytes alone. */
static int refuse_text(struct lws *wsi) {
    static unsigned char reason[] = "messages must be binary";
    lws_close_reason(wsi, LWS_CLOSE_STATUS_UNACCEPTABLE_OPCODE, reason, sizeof reason - 1);
    return -1;
}

static int on_socket(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t size) {
    (void)user;
    struct connection *c = wsi ? connection_of(wsi) : NULL;
    if (!c) return 0;
    switch (reason) {
    case LWS_CALLBACK_ESTABLISHED:
        return open_socket(wsi, c);
    case LWS_CALLBACK_RECEIVE:
        return lws_frame_is_binary(wsi) ? lw_ws_transport_receive(c->socket, in, size) : refuse_text(wsi);
    case LWS_CALLBACK_RECEIVE_PONG:
        return lw_ws_transport_receive(c->socket, NULL, 0);
    case LWS_CALLBACK_SERVER_WRITEABLE:
        return lw_ws_transport_writeable(c->socket);
    case LWS_CALLBACK_CLOSED:
        if (c->socket) lw_ws_transport_lost(c->socket);
        return 0;
    case LWS_CALLBACK_WSI_DESTROY:
        free_connection(wsi, c);
        return 0;
    default:
        return 0;
    }
}

/* ---- connections ---- */

static void on_handle_closed(uv_handle_t *handle) { free(handle); }

/* The next connection as a descriptor of its own, if its address has a place for it. */
static enum lw_status take_descriptor(struct lw_web_server *server, uv_stream_t *listener,
                                      struct lw_address *out_at, int *out_descriptor) {
    enum lw_status status = LW_OS;
    uv_os_fd_t accepted;
    uv_tcp_t *tcp = malloc(sizeof *tcp);
    if (!tcp) return LW_NO_MEMORY;
    if (uv_tcp_init(listener->loop, tcp) < 0) {
        free(tcp);
        return LW_OS;
    }
    if (uv_accept(listener, (uv_stream_t *)tcp) == 0 && uv_fileno((uv_handle_t *)tcp, &accepted) == 0) {
        *out_at = lw_tcp_transport_peer(accepted).at;
        const bool may =
            lw_session_may_connect(server->sockets.sessions, out_at) && take_place(server, out_at);
        *out_descriptor = may ? fcntl(accepted, F_DUPFD_CLOEXEC, 0) : -1;
        status = !may ? LW_UNAVAILABLE : *out_descriptor < 0 ? LW_OS : LW_OK;
        if (may && status != LW_OK) give_place_back(server, out_at);
    }
    uv_close((uv_handle_t *)tcp, on_handle_closed);
    return status;
}

enum lw_status lw_web_server_accept(struct lw_web_server *server, uv_stream_t *listener) {
    int descriptor;
    struct lw_address at;
    const enum lw_status status = take_descriptor(server, listener, &at, &descriptor);
    if (status != LW_OK) return status;
    struct connection *c = calloc(1, sizeof *c);
    if (!c) {
        give_place_back(server, &at);
        close(descriptor);
        return LW_NO_MEMORY;
    }
    c->server = server;
    c->at = at;
    struct lws *wsi = lws_adopt_socket_vhost(server->vhost, descriptor);
    if (!wsi) { /* libwebsockets has closed it */
        give_place_back(server, &c->at);
        free(c);
        return LW_OS;
    }
    lws_set_opaque_user_data(wsi, c);
    lws_set_timeout(wsi, PENDING_TIMEOUT_ESTABLISH_WITH_SERVER, LW_WEB_SERVER_REQUEST_S);
    lws_cancel_service(server->context); /* it looks at its timers after events of its own alone */
    return LW_OK;
}

/* ---- beginning and end ---- */

static enum lw_status read_files(struct lw_web_server *server, const char *root, struct lw_error *err) {
    struct lw_error cause = {0};
    const enum lw_status status = root ? lw_web_files_read(root, &server->files, &cause) : LW_NO_INPUT;
    if (status == LW_OK || status == LW_NO_INPUT) return LW_OK;
    return lw_status_fail(err, status, "%s", cause.text);
}

static char *copy(const char *text) { return strdup(text ? text : ""); }

static enum lw_status start(struct lw_web_server *server, uv_loop_t *loop, struct lw_error *err) {
    void *loops[] = {loop};
    server->protocols[0] = (struct lws_protocols){.name = "http", .callback = on_http};
    server->protocols[1] = (struct lws_protocols){.name = LW_WS_TRANSPORT_PROTOCOL,
                                                  .callback = on_socket,
                                                  .rx_buffer_size = LW_SERVER_TURN_FRAMES_READ - LWS_PRE};
    lws_set_log_level(0, NULL); /* peers could fill a log */
    const uint64_t tls = server->tls
                             ? LWS_SERVER_OPTION_DO_SSL_GLOBAL_INIT | LWS_SERVER_OPTION_CREATE_VHOST_SSL_CTX |
                                   LWS_SERVER_OPTION_ALLOW_NON_SSL_ON_SSL_PORT |
                                   LWS_SERVER_OPTION_ALLOW_HTTP_ON_HTTPS_LISTENER
                             : 0; /* plain HTTP gets an answer that names the mistake: refuse_plain() */
    const struct lws_context_creation_info info = {
        .port = CONTEXT_PORT_NO_LISTEN_SERVER,
        .protocols = server->protocols,
        .options = LWS_SERVER_OPTION_LIBUV | LWS_SERVER_OPTION_EXPLICIT_VHOSTS |
                   LWS_SERVER_OPTION_SKIP_SERVER_CANONICAL_NAME | LWS_SERVER_OPTION_DISABLE_OS_CA_CERTS | tls,
        .foreign_loops = loops,
        .alpn = "http/1.1",
        .user = server,
        .timeout_secs = LW_WEB_SERVER_REQUEST_S,
        .timeout_secs_ah_idle = LW_WEB_SERVER_REQUEST_S,
        .keepalive_timeout = LW_WEB_SERVER_REQUEST_S,
        .max_http_header_data = LW_WEB_SERVER_HEADER_MAX,
        .max_http_header_data2 = LW_WEB_SERVER_HEADER_MAX,
        .pt_serv_buf_size = LW_SERVER_TURN_READ,
        .gid = (gid_t)-1,
        .uid = (uid_t)-1};
    server->context = lws_create_context(&info);
    if (server->context) server->vhost = lws_create_vhost(server->context, &info);
    if (server->vhost) return LW_OK;
    return lw_status_fail(
        err, LW_OS,
        "cannot start HTTP: is libwebsockets' part for libuv installed (libwebsockets-evlib-uv)?");
}

enum lw_status lw_web_server_create(const struct lw_web_server_desc *desc, struct lw_web_server **out_server,
                                    struct lw_error *err) {
    struct lw_web_server *server = calloc(1, sizeof *server);
    if (!server) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    server->sockets.sessions = desc->sessions;
    server->tls = desc->tls;
    server->places.seed = desc->sessions->places.seed;
    server->host = copy(desc->host);
    server->hosts = copy(desc->hosts);
    server->origins = copy(desc->origins);
    server->servers = copy(desc->servers);
    for (char *at = server->servers; at && (at = strchr(at, ',')); at++) *at = ' ';
    server->page = desc->page;
    server->page_context = desc->page_context;
    server->wants_token = desc->wants_token;
    enum lw_status status = server->host && server->hosts && server->origins && server->servers
                                ? read_files(server, desc->root, err)
                                : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (status == LW_OK) status = start(server, desc->loop, err);
    if (status == LW_OK) {
        *out_server = server;
        return LW_OK;
    }
    lw_web_server_close(server);
    for (int i = 0; i < 10; i++) (void)uv_run(desc->loop, UV_RUN_NOWAIT); /* handles of libwebsockets */
    lw_web_server_destroy(server);
    return status;
}

void lw_web_server_close(struct lw_web_server *server) {
    if (!server || !server->context) return;
    if (server->tls) lw_tls_context_let_go(server->tls, server->ssl);
    lws_context_destroy(server->context);
}

/* The second call frees what the first one has closed. */
void lw_web_server_destroy(struct lw_web_server *server) {
    if (!server) return;
    if (server->context) lws_context_destroy(server->context);
    LW_INVARIANT_DEAR(!server->connection_count); /* each gave its place back */
    lw_web_files_finish(&server->files);
    lw_address_places_finish(&server->places);
    free(server->host);
    free(server->hosts);
    free(server->origins);
    free(server->servers);
    free(server);
}
