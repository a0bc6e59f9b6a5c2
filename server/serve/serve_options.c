#include "server/serve/serve_options.h"

#include "common/base/atomic_file.h"
#include "common/base/control_path.h"
#include "common/base/host_port.h"
#include "common/base/log.h"
#include "common/base/program_path.h"
#include "server/serve/admission/exposure.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static enum lw_status parse_http(struct lw_serve_options *o, struct lw_error *err) {
    struct stat st;
    if (strcmp(o->http, "none") == 0) return LW_OK;
    if (o->web_root && (stat(o->web_root, &st) != 0 || !S_ISDIR(st.st_mode)))
        return lw_status_fail(err, LW_NO_INPUT, "--web-root: %s is no folder", o->web_root);
    const enum lw_status status = lw_options_address_or(o->http, LW_SERVE_OPTIONS_HTTP_PORT, o->http_host,
                                                        sizeof o->http_host, &o->http_port, err);
    if (status != LW_OK) lw_status_context(err, "--http");
    return status;
}

static enum lw_status parse_metrics(struct lw_serve_options *o, struct lw_error *err) {
    if (!o->metrics || strcmp(o->metrics, "none") == 0) return LW_OK;
    const enum lw_status status =
        lw_options_address_or(o->metrics, LW_SERVE_OPTIONS_METRICS_PORT, o->metrics_host,
                              sizeof o->metrics_host, &o->metrics_port, err);
    if (status != LW_OK) lw_status_context(err, "--metrics");
    return status;
}

static enum lw_status check_exposure(const struct lw_serve_options *o, struct lw_error *err) {
    const struct lw_exposure exposure = {
        .has_tls = o->tls_certificate != NULL, .has_tokens = o->tokens != NULL, .is_insecure = o->insecure};
    enum lw_status status = o->listen_unix ? LW_OK : lw_exposure_check(&exposure, "--listen", o->host, err);
    if (status == LW_OK && *o->http_host) status = lw_exposure_check(&exposure, "--http", o->http_host, err);
    if (status == LW_OK && *o->metrics_host)
        status = lw_exposure_check(&exposure, "--metrics", o->metrics_host, err);
    return status;
}

/* Finds it in an install tree, or in the build. "": there is none. */
static void find_web_root(char *dst, size_t size) {
    static const char *const beside[] = {"../share/lightwell/web", "../web"};
    *dst = '\0';
    for (size_t i = 0; i < sizeof beside / sizeof *beside && !*dst; i++) {
        lw_program_path(beside[i], dst, size);
        if (strcmp(dst, beside[i]) == 0) *dst = '\0'; /* it is not there */
    }
}

/* HOST:PORT, where a program can connect. */
static enum lw_status check_tcp_server(const char *text, struct lw_error *err) {
    char host[256];
    uint16_t port = 0;
    enum lw_status status = lw_options_address(text, host, sizeof host, &port, err);
    const char *colon = strrchr(text, ':'), *bracket = strrchr(text, ']');
    if (status == LW_OK && (!port || !colon || colon == text || (bracket && bracket > colon)))
        return lw_status_fail(err, LW_USAGE, "address \"%.200s\" is not HOST:PORT, with a port", text);
    return status;
}

#define DIGITS "0123456789"
#define HOST   "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ" DIGITS "-."

/* A WebSocket's address. It becomes a part of the page's policy (web_server.c): so it has few characters, and
 * its host is no IPv6 address, which policies cannot name. */
static enum lw_status check_web_server(const char *text, struct lw_error *err) {
    const char *host = strstr(text, "://") + 3, *at = host + strspn(host, HOST);
    bool is_one = at > host;
    if (*at == ':') {
        const size_t digits = strspn(at + 1, DIGITS);
        const unsigned long port = strtoul(at + 1, NULL, 10);
        is_one = is_one && digits && digits <= 5 && port && port <= UINT16_MAX;
        at += 1 + digits;
    }
    if (*at == '/') at += strspn(at, HOST "/_~%");
    if (is_one && !*at) return LW_OK;
    return lw_status_fail(err, LW_USAGE, "address \"%.200s\" is not ws://HOST:PORT/PATH", text);
}

static void append_server(char list[LW_MESSAGE_SERVERS_MAX + 1], const char *text) {
    const size_t size = strlen(list);
    snprintf(list + size, LW_MESSAGE_SERVERS_MAX + 1 - size, "%s%s", size ? "," : "", text);
}

/* Each is where a client can connect: programs by TCP, pages by WebSocket. */
static enum lw_status sort_servers(struct lw_serve_options *o, struct lw_error *err) {
    char text[300];
    *o->tcp_servers = *o->web_servers = '\0';
    if (strlen(o->servers) > LW_MESSAGE_SERVERS_MAX)
        return lw_status_fail(err, LW_USAGE, "--servers: over %u bytes", LW_MESSAGE_SERVERS_MAX);
    for (const char *at = o->servers; at; at = (at = strchr(at, ',')) ? at + 1 : NULL) {
        const size_t size = strcspn(at, ",");
        snprintf(text, sizeof text, "%.*s", (int)size, at);
        const bool is_web = !strncmp(text, "ws://", 5) || !strncmp(text, "wss://", 6);
        enum lw_status status = is_web ? check_web_server(text, err) : check_tcp_server(text, err);
        if (status == LW_OK && size >= sizeof text)
            status = lw_status_fail(err, LW_USAGE, "address \"%.60s...\" is too long", text);
        if (status != LW_OK) {
            lw_status_context(err, "--servers");
            return status;
        }
        append_server(is_web ? o->web_servers : o->tcp_servers, text);
    }
    return LW_OK;
}

/* Values that are the default say nothing: a file of all options has them. */
static enum lw_status check_unix(const struct lw_serve_options *o, struct lw_error *err) {
    const struct {
        const char *option;
        bool is_set;
    } other[] = {{"--listen", strcmp(o->listen, LW_OPTIONS_ADDRESS) != 0},
                 {"--http", strcmp(o->http, LW_SERVE_OPTIONS_HTTP) != 0 && strcmp(o->http, "none") != 0},
                 {"--control-socket", strcmp(o->control_socket, "auto") != 0},
                 {"--port-file", o->port_file != NULL},
                 {"--http-port-file", o->http_port_file != NULL}};
    for (size_t i = 0; i < sizeof other / sizeof *other; i++)
        if (other[i].is_set)
            return lw_status_fail(err, LW_USAGE, "--listen-unix serves on that socket alone: leave %s away",
                                  other[i].option);
    if (!*o->listen_unix || strlen(o->listen_unix) >= LW_CONTROL_PATH_SIZE)
        return lw_status_fail(err, LW_USAGE, "--listen-unix: a path has 1 to %u bytes",
                              LW_CONTROL_PATH_SIZE - 1);
    return LW_OK;
}

enum lw_status lw_serve_options_check(struct lw_serve_options *o, struct lw_error *err) {
    if (!o->tls_certificate != !o->tls_key)
        return lw_status_fail(err, LW_USAGE, "--tls-certificate and --tls-key need each other");
    enum lw_status status = lw_options_address(o->listen, o->host, sizeof o->host, &o->port, err);
    if (status != LW_OK) {
        lw_status_context(err, "--listen");
        return status;
    }
    find_web_root(o->found_root, sizeof o->found_root);
    if (o->listen_unix) status = check_unix(o, err);
    if (status == LW_OK && !o->listen_unix) status = parse_http(o, err);
    if (status == LW_OK) status = parse_metrics(o, err);
    if (status == LW_OK && o->servers) status = sort_servers(o, err);
    return status == LW_OK ? check_exposure(o, err) : status;
}

void lw_serve_options_fill(struct lw_serve_options *o, struct lw_server_desc *desc) {
    desc->host = o->host;
    desc->port = o->port;
    desc->tokens = o->tokens;
    desc->servers = o->tcp_servers;
    desc->web_servers = o->web_servers;
    desc->tls = (struct lw_tls_context_desc){o->tls_certificate, o->tls_key};
    desc->is_unix_only = o->listen_unix != NULL;
    desc->control_socket = o->listen_unix                      ? o->listen_unix
                           : strcmp(o->control_socket, "none") ? o->control_socket
                                                               : NULL;
    desc->http_host = *o->http_host ? o->http_host : NULL;
    desc->http_port = o->http_port;
    desc->http_hosts = o->http_hosts;
    desc->http_origins = o->http_origins;
    desc->http_root = o->web_root ? o->web_root : o->found_root;
    desc->http_may_fail = !o->http_given;
    desc->metrics_host = *o->metrics_host ? o->metrics_host : NULL;
    desc->metrics_port = o->metrics_port;
    desc->metrics_guarded = *o->metrics_host && !o->insecure && !lw_exposure_is_loopback(o->metrics_host);
    desc->retry_after_ms = (uint32_t)(1000 * o->return_s);
    desc->address_sessions_max = (uint32_t)o->address_sessions;
    desc->rate_limit_bytes_hz = (uint64_t)(o->link_rate * 1e6 / 8);
}

static enum lw_status write_port(const char *path, const char *option, unsigned port, struct lw_error *err) {
    if (!path) return LW_OK;
    char text[16];
    int length = snprintf(text, sizeof text, "%u\n", port);
    enum lw_status status = lw_atomic_file_save(path, text, (size_t)length, err);
    if (status != LW_OK) lw_status_context(err, "%s", option);
    return status;
}

enum lw_status lw_serve_options_write_ports(const struct lw_serve_options *o, const struct lw_server *server,
                                            struct lw_error *err) {
    const unsigned http_port = lw_server_http_port(server);
    const unsigned metrics_port = lw_server_metrics_port(server);
    enum lw_status status = LW_OK;
    if (http_port) status = write_port(o->http_port_file, "--http-port-file", http_port, err);
    if (status == LW_OK && metrics_port)
        status = write_port(o->metrics_port_file, "--metrics-port-file", metrics_port, err);
    if (status == LW_OK) status = write_port(o->port_file, "--port-file", lw_server_port(server), err);
    if (status != LW_OK) lw_serve_options_remove_ports(o);
    return status;
}

/* A pipe or a device was written to, but is not ours. */
static void remove_port(const char *path) {
    struct stat st;
    if (path && lstat(path, &st) == 0 && S_ISREG(st.st_mode)) unlink(path);
}

void lw_serve_options_remove_ports(const struct lw_serve_options *o) {
    remove_port(o->port_file);
    remove_port(o->http_port_file);
    remove_port(o->metrics_port_file);
}

void lw_serve_options_where(const struct lw_serve_options *o, const struct lw_server *server, char *dst,
                            size_t size) {
    if (o->listen_unix)
        snprintf(dst, size, "unix:%s", o->listen_unix);
    else
        lw_host_port_format(dst, size, o->host, lw_server_port(server));
}

void lw_serve_options_tell(const struct lw_serve_options *o, const struct lw_server *server) {
    char address[sizeof o->host + 16];
    if (lw_server_http_port(server)) {
        lw_host_port_format(address, sizeof address, o->http_host, lw_server_http_port(server));
        lw_log(LW_LOG_INFO, "in a browser: http%s://%s/", o->tls_certificate ? "s" : "", address);
    }
    if (lw_server_metrics_port(server)) {
        lw_host_port_format(address, sizeof address, o->metrics_host, lw_server_metrics_port(server));
        lw_log(LW_LOG_INFO, "monitoring: http://%s/metrics", address);
    }
}
