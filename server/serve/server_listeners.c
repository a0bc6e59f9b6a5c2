#include "server/serve/server_listeners.h"

#include "common/base/clock.h"
#include "common/base/host_port.h"
#include "common/base/invariant.h"
#include "common/base/log.h"
#include "server/serve/transports/control_socket.h"

#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define BACKLOG      1024
#define ADDRESS_SIZE 300u

/* ---- connections ---- */

/* Anybody may cause any number of these. */
static void log_not_accepted(struct lw_server *server, const char *why) {
    static const struct lw_address nobody = {.bytes = {0}};
    if (lw_peer_log_allows(&server->shared.log, &nobody, "connections that were not accepted", lw_clock_ns()))
        lw_log(LW_LOG_WARNING, "cannot accept a connection: %s", why);
}

static void drop_connection(struct lw_server *server, struct lw_server_endpoint *endpoint);

static void on_spare_closed(uv_handle_t *handle) {
    struct lw_server *server = handle->data;
    if (uv_is_closing((uv_handle_t *)&server->wake)) return; /* all of them are */
    (void)uv_tcp_init(&server->loop, &server->spare);        /* took no memory the first time, either */
    for (int d = 0; d < LW_SERVER_ENDPOINTS; d++) drop_connection(server, &server->endpoint[d]);
}

/* libuv reports no further connection before the last one was accepted. Where there was no memory for it, it
 * is taken to be closed; another one beside it waits until the spare handle is closed. */
static void drop_connection(struct lw_server *server, struct lw_server_endpoint *endpoint) {
    if (!endpoint->is_held && !uv_is_closing((uv_handle_t *)&server->spare) &&
        uv_accept(endpoint->listener, (uv_stream_t *)&server->spare) == 0)
        uv_close((uv_handle_t *)&server->spare, on_spare_closed);
}

static const char *why_not(enum lw_status status) {
    return status == LW_UNAVAILABLE ? "too many, in all or of its address, too often, or out of memory"
                                    : lw_status_text(status);
}

static void take_connection(struct lw_server *server, struct lw_server_endpoint *endpoint) {
    const enum lw_status status = endpoint->web ? lw_web_server_accept(*endpoint->web, endpoint->listener)
                                                : lw_tcp_transport_accept(&server->tcp, endpoint->listener);
    if (status != LW_OK) log_not_accepted(server, why_not(status));
    drop_connection(server, endpoint);
}

/* One that is not taken in this turn keeps libuv from looking for more. */
static void on_connection(uv_stream_t *listener, int result) {
    struct lw_server *server = listener->data;
    struct lw_server_endpoint *endpoint = server->endpoint;
    while (endpoint->listener != listener) endpoint++;
    LW_INVARIANT_DEAR(!endpoint->is_held || result < 0); /* libuv waits until the one before is taken */
    if (result < 0)
        log_not_accepted(server, uv_strerror(result));
    else if (endpoint->taken == endpoint->most)
        endpoint->is_held = true;
    else {
        LW_INVARIANT(endpoint->taken < endpoint->most);
        endpoint->taken++;
        take_connection(server, endpoint);
    }
}

bool lw_server_listeners_any_held(const struct lw_server *server) {
    bool any = false;
    for (int d = 0; d < LW_SERVER_ENDPOINTS; d++) any |= server->endpoint[d].is_held;
    return any;
}

void lw_server_listeners_take_held(struct lw_server *server) {
    for (struct lw_server_endpoint *endpoint = server->endpoint;
         endpoint < server->endpoint + LW_SERVER_ENDPOINTS; endpoint++) {
        endpoint->taken = endpoint->is_held;
        if (!endpoint->is_held) continue;
        endpoint->is_held = false;
        if (!uv_is_closing((uv_handle_t *)endpoint->listener)) take_connection(server, endpoint);
    }
}

void lw_server_listeners_init(struct lw_server *server) {
    const unsigned most = LW_SERVER_TURN_CONNECTIONS,
                   by_https = server->tcp.tls ? LW_SERVER_TURN_HTTPS_CONNECTIONS : most;
    const struct lw_server_endpoint endpoints[LW_SERVER_ENDPOINTS] = {
        {.listener = (uv_stream_t *)&server->listener, .most = most},
        {.listener = (uv_stream_t *)&server->control_listener, .most = most},
        {.listener = (uv_stream_t *)&server->http_listener, .web = &server->web, .most = by_https},
        {.listener = (uv_stream_t *)&server->metrics_listener, .web = &server->metrics_web, .most = by_https},
    };
    memcpy(server->endpoint, endpoints, sizeof endpoints);
}

/* ---- sockets ---- */

/* option: which one names another address */
static enum lw_status listen_failure(struct lw_error *err, const char *address, const char *option,
                                     int result) {
    switch (result) {
    case UV_EADDRINUSE:
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "%s is already in use: another lightwelld? choose another with %s HOST:PORT",
                              address, option);
    case UV_EADDRNOTAVAIL:
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "%s is not an address of this machine: choose another with %s HOST:PORT",
                              address, option);
    case UV_EACCES:
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "%s needs more rights: choose a port above 1023 with %s HOST:PORT", address,
                              option);
    default:
        return lw_status_fail(err, LW_OS, "%s: cannot listen: %s", address, uv_strerror(result));
    }
}

static uint16_t port_of(const struct sockaddr_storage *bound) {
    return ntohs(bound->ss_family == AF_INET6 ? ((const struct sockaddr_in6 *)bound)->sin6_port
                                              : ((const struct sockaddr_in *)bound)->sin_port);
}

/* On a socket of the server before; *socket is -1 then. */
static enum lw_status take_over(uv_tcp_t *listener, int *socket, uint16_t *out_port, struct lw_error *err) {
    struct sockaddr_storage bound = {0};
    int length = sizeof bound, result = uv_tcp_open(listener, *socket);
    if (result == 0) *socket = -1;
    if (result == 0) result = uv_listen((uv_stream_t *)listener, BACKLOG, on_connection);
    if (result == 0) result = uv_tcp_getsockname(listener, (struct sockaddr *)&bound, &length);
    if (result < 0) return lw_status_fail(err, LW_OS, "cannot go on listening: %s", uv_strerror(result));
    *out_port = port_of(&bound);
    return LW_OK;
}

/* socket: the previous server's, to be used again; NULL: there is none */
static enum lw_status start_listening(uv_tcp_t *listener, int *socket, const char *host, uint16_t port,
                                      const char *option, uint16_t *out_port, struct lw_error *err) {
    if (socket) return take_over(listener, socket, out_port, err);
    char address[ADDRESS_SIZE], service[8];
    lw_host_port_format(address, sizeof address, host, port);
    snprintf(service, sizeof service, "%u", (unsigned)port);
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM, .ai_flags = AI_PASSIVE | AI_NUMERICSERV}, *found;
    int result = getaddrinfo(host, service, &hints, &found);
    if (result != 0)
        return lw_status_fail(err, LW_NO_HOST, "%s: cannot find the address to listen on: %s", address,
                              gai_strerror(result));
    result = uv_tcp_bind(listener, found->ai_addr, 0);
    freeaddrinfo(found);
    int receive_size = (int)LW_SERVER_RECEIVE_SIZE; /* connections have it from the listener */
    if (result == 0) result = uv_recv_buffer_size((uv_handle_t *)listener, &receive_size);
    if (result == 0) result = uv_listen((uv_stream_t *)listener, BACKLOG, on_connection);
    struct sockaddr_storage bound = {0};
    int length = sizeof bound;
    if (result == 0) result = uv_tcp_getsockname(listener, (struct sockaddr *)&bound, &length);
    if (result < 0) return listen_failure(err, address, option, result);
    *out_port = port_of(&bound);
    return LW_OK;
}

static int duplicate(const uv_tcp_t *listener) {
    uv_os_fd_t descriptor;
    if (uv_is_closing((const uv_handle_t *)listener) ||
        uv_fileno((const uv_handle_t *)listener, &descriptor) != 0)
        return -1;
    return fcntl(descriptor, F_DUPFD_CLOEXEC, 3);
}

enum lw_status lw_server_share_sockets(const struct lw_server *server, struct lw_server_sockets *out_sockets,
                                       struct lw_error *err) {
    struct lw_server_sockets sockets = {duplicate(&server->listener),
                                        server->http_port ? duplicate(&server->http_listener) : -1,
                                        server->metrics_port ? duplicate(&server->metrics_listener) : -1};
    if ((sockets.listen < 0 && !server->is_unix_only) || (server->http_port && sockets.http < 0) ||
        (server->metrics_port && sockets.metrics < 0)) {
        lw_server_sockets_close(&sockets);
        return lw_status_fail(err, LW_OS, "the sockets cannot be shared: %s", strerror(errno));
    }
    *out_sockets = sockets;
    return LW_OK;
}

void lw_server_sockets_close(struct lw_server_sockets *sockets) {
    int *const each[] = {&sockets->listen, &sockets->http, &sockets->metrics};
    for (size_t i = 0; i < sizeof each / sizeof *each; i++) {
        if (*each[i] >= 0) close(*each[i]);
        *each[i] = -1;
    }
}

enum lw_status lw_server_listeners_open_control(struct lw_server *server, const char *path,
                                                struct lw_error *err) {
    struct lw_error cause = {0};
    enum lw_status status = lw_control_socket_bind(&server->control_listener, path, server->port, &cause);
    const int result =
        status == LW_OK ? uv_listen((uv_stream_t *)&server->control_listener, BACKLOG, on_connection) : 0;
    if (result < 0) status = lw_status_fail(&cause, LW_OS, "%s: %s", path, uv_strerror(result));
    if (status == LW_OK) return LW_OK;
    lw_server_close_handle((uv_handle_t *)&server->control_listener);
    if (strcmp(path, "auto") != 0)
        return lw_status_fail(err, status, "%s: %s",
                              server->is_unix_only ? "--listen-unix" : "--control-socket", cause.text);
    lw_log(LW_LOG_WARNING, "the scene changes by tokens alone: no Unix socket: %s", cause.text);
    return LW_OK;
}

static enum lw_status start_http(struct lw_server *server, const struct lw_server_desc *desc,
                                 struct lw_error *err) {
    const struct lw_web_server_desc web = {.loop = &server->loop,
                                           .sessions = &server->shared,
                                           .tls = server->tcp.tls,
                                           .root = desc->http_root,
                                           .host = desc->http_host,
                                           .hosts = desc->http_hosts,
                                           .origins = desc->http_origins,
                                           .servers = desc->web_servers};
    struct lw_error cause = {0};
    if (!desc->http_host || desc->is_unix_only || (desc->sockets && desc->sockets->http < 0)) return LW_OK;
    enum lw_status status =
        start_listening(&server->http_listener, desc->sockets ? &desc->sockets->http : NULL, desc->http_host,
                        desc->http_port, "--http", &server->http_port, &cause);
    if (status == LW_OK) status = lw_web_server_create(&web, &server->web, &cause);
    if (status == LW_OK) return LW_OK;
    server->http_port = 0;
    lw_server_close_handle((uv_handle_t *)&server->http_listener);
    if (!desc->http_may_fail) return lw_status_fail(err, status, "%s", cause.text);
    lw_log(LW_LOG_WARNING, "browsers are not served: %s", cause.text);
    return LW_OK;
}

bool lw_server_listeners_page(void *context, const char *path, struct lw_server_page *out_page) {
    struct lw_server *server = context;
    if (!server->hooks.page(server->hooks.context, path, out_page)) return false;
    if (strcmp(path, "/metrics") == 0) lw_relay_tree_add_metrics(&server->shared.tree, out_page);
    return true;
}

static enum lw_status start_metrics(struct lw_server *server, const struct lw_server_desc *desc,
                                    struct lw_error *err) {
    if (!desc->metrics_host || (desc->sockets && desc->sockets->metrics < 0)) return LW_OK;
    LW_INVARIANT(desc->hooks.page);
    const struct lw_web_server_desc web = {.loop = &server->loop,
                                           .sessions = &server->shared,
                                           .host = desc->metrics_host,
                                           .hosts = desc->http_hosts,
                                           .tls = desc->metrics_guarded ? server->tcp.tls : NULL,
                                           .wants_token = desc->metrics_guarded,
                                           .page = lw_server_listeners_page,
                                           .page_context = server};
    enum lw_status status =
        start_listening(&server->metrics_listener, desc->sockets ? &desc->sockets->metrics : NULL,
                        desc->metrics_host, desc->metrics_port, "--metrics", &server->metrics_port, err);
    return status == LW_OK ? lw_web_server_create(&web, &server->metrics_web, err) : status;
}

enum lw_status lw_server_listeners_open(struct lw_server *server, const struct lw_server_desc *desc,
                                        struct lw_error *err) {
    enum lw_status status = LW_OK;
    if (!desc->is_unix_only)
        status = start_listening(&server->listener, desc->sockets ? &desc->sockets->listen : NULL,
                                 desc->host ? desc->host : "127.0.0.1", desc->port, "--listen", &server->port,
                                 err);
    if (status == LW_OK && desc->control_socket && desc->sockets)
        status = (server->control_path = strdup(desc->control_socket))
                     ? LW_OK
                     : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    else if (status == LW_OK && desc->control_socket)
        status = lw_server_listeners_open_control(server, desc->control_socket, err);
    if (status == LW_OK) status = start_http(server, desc, err);
    return status == LW_OK ? start_metrics(server, desc, err) : status;
}
