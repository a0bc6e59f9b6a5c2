/* serve_options.h: the options of addresses and access, for all programs that serve.
 * Flow:    command line -> [serve_options] -> lw_server_desc; ports of a server -> files, lines of the log
 * Threads: main() only. */
#ifndef LW_SERVE_SERVE_OPTIONS_H
#define LW_SERVE_SERVE_OPTIONS_H

#include "common/base/options.h"
#include "server/serve/server.h"

#define LW_SERVE_OPTIONS_HTTP_PORT    7781
#define LW_SERVE_OPTIONS_HTTP         LW_OPTIONS_HOST ":7781"
#define LW_SERVE_OPTIONS_METRICS_PORT 7782

struct lw_serve_options {
    const char *listen, *listen_unix; /* listen_unix: NULL: by TCP */
    const char *port_file, *http, *http_port_file, *http_hosts, *http_origins, *web_root;
    const char *servers; /* servers that WELCOME names; NULL: none */
    const char *metrics, *metrics_port_file, *tokens, *control_socket, *tls_certificate, *tls_key;
    int64_t address_sessions; /* 0: the server's default */
    double link_rate, return_s;
    bool insecure, http_given;
    /* lw_serve_options_check(): the addresses in their parts */
    char host[256], http_host[256]; /* http_host "": none */
    char metrics_host[256];         /* "": none */
    uint16_t port, http_port, metrics_port;
    char found_root[1024]; /* where the browser client lies, unless web_root says so */
    /* The two kinds of servers, by commas: for programs, for pages. */
    char tcp_servers[LW_MESSAGE_SERVERS_MAX + 1], web_servers[LW_MESSAGE_SERVERS_MAX + 1];
};

/* clang-format off */
/** Initialiser with the default values. */
#define LW_SERVE_OPTIONS_DEFAULTS                                                                            \
    {.listen = LW_OPTIONS_ADDRESS, .http = LW_SERVE_OPTIONS_HTTP, .control_socket = "auto", .return_s = 2.0}

/** Rows of an option table. options: a struct lw_serve_options. */
#define LW_SERVE_OPTIONS(options)                                                                            \
    {"listen", "HOST:PORT",                                                                                  \
     "where to serve (default {}; port 0 picks one)",                                                        \
     LW_OPTION_STRING, &(options)->listen, 0, 0, NULL},                                                      \
    {"listen-unix", "PATH",                                                                                  \
     "serve this user and root alone, on this Unix socket, and neither --listen nor --http: for a "          \
     "lightwell-relay unix:PATH that serves the public (default: none)",                                     \
     LW_OPTION_STRING, &(options)->listen_unix, 0, 0, NULL},                                                 \
    {"port-file", "FILE",                                                                                    \
     "write the port to this file once the server serves",                                                   \
     LW_OPTION_STRING, &(options)->port_file, 0, 0, NULL},                                                   \
    {"http", "HOST:PORT|none",                                                                               \
     "where to serve the browser client, and WebSockets at /ws (default {}; port 0 "                        \
     "picks one)",                                                                                  \
     LW_OPTION_STRING, &(options)->http, 0, 0, &(options)->http_given},                                      \
    {"http-port-file", "FILE",                                                                               \
     "write the port of --http to this file once the server serves",                                         \
     LW_OPTION_STRING, &(options)->http_port_file, 0, 0, NULL},                                              \
    {"http-host", "NAMES",                                                                                   \
     "names of this server for browsers, separated by commas (default: its address, localhost)",             \
     LW_OPTION_STRING, &(options)->http_hosts, 0, 0, NULL},                                                  \
    {"http-origin", "ORIGINS",                                                                               \
     "origins whose pages may open WebSockets, such as https://example.org, separated by commas (default: "  \
     "our own pages alone)",                                                                                 \
     LW_OPTION_STRING, &(options)->http_origins, 0, 0, NULL},                                                \
    {"web-root", "FOLDER",                                                                                   \
     "the browser client's files (default: share/lightwell/web beside bin)",                                 \
     LW_OPTION_STRING, &(options)->web_root, 0, 0, NULL},                                                    \
    {"metrics", "HOST:PORT|none",                                                                            \
     "where to serve monitoring: /metrics, /healthz, /readyz (default none; a host alone: port "             \
     "7782; port 0 picks one)",                                                                              \
     LW_OPTION_STRING, &(options)->metrics, 0, 0, NULL},                                                     \
    {"metrics-port-file", "FILE",                                                                            \
     "write the port of --metrics to this file once the server serves",                                      \
     LW_OPTION_STRING, &(options)->metrics_port_file, 0, 0, NULL},                                           \
    {"control-socket", "PATH|auto|none",                                                                     \
     "the Unix socket through which this user and root change the scene (default {}: PORT.sock in "        \
     "$XDG_RUNTIME_DIR/lightwell or /run/lightwell, where lightwellctl looks for it)",                       \
     LW_OPTION_STRING, &(options)->control_socket, 0, 0, NULL},                                              \
    {"tokens", "FILE",                                                                                       \
     "a file with the tokens of clients, a line each: view TOKEN or control TOKEN (lightwellctl token "      \
     "makes one). SIGHUP reads it again. credential:NAME is a credential of systemd (default: no token is "  \
     "needed)",                                                                                              \
     LW_OPTION_STRING, &(options)->tokens, 0, 0, NULL},                                                      \
    {"tls-certificate", "FILE",                                                                              \
     "a PEM file with the certificate and its issuers below it. The server then accepts TLS 1.3 only, "      \
     "from programs and browsers. SIGHUP reads it again. credential:NAME is a credential of systemd "        \
     "(default: no TLS)",                                                                                    \
     LW_OPTION_STRING, &(options)->tls_certificate, 0, 0, NULL},                                             \
    {"tls-key", "FILE",                                                                                      \
     "a PEM file with the key of the certificate. Only its owner and its group may read it. "                \
     "credential:NAME as above",                                                                             \
     LW_OPTION_STRING, &(options)->tls_key, 0, 0, NULL},                                                     \
    {"insecure", NULL,                                                                                       \
     "allow addresses in --listen, --http and --metrics that other machines reach without TLS and "          \
     "tokens; a warning says so",                                                                            \
     LW_OPTION_FLAG, &(options)->insecure, 0, 0, NULL},                                                      \
    {"link-rate", "MBIT",                                                                                    \
     "limit of the bit rate to each client, Mbit/s; a client may ask for less (default: what its link "      \
     "takes)",                                                                                               \
     LW_OPTION_REAL, &(options)->link_rate, 0.01, 1e6, NULL},                                                \
    {"sessions-per-address", "N",                                                                            \
     "limit of the sessions of one address (default: 1,000, and 9,000 of this machine; the server has "      \
     "10,000 in all)",                                                                                       \
     LW_OPTION_INT, &(options)->address_sessions, 1, LW_SERVER_SESSIONS_MAX, NULL},                          \
    {"servers", "ADDRESSES",                                                                                 \
     "other servers of this light for clients whose server is gone, separated by commas: HOST:PORT for "     \
     "programs, ws://HOST:PORT/ws or wss://HOST:PORT/ws for pages (default: none)",                          \
     LW_OPTION_STRING, &(options)->servers, 0, 0, NULL},                                                     \
    {"return-after", "SECONDS",                                                                              \
     "seconds after which clients come back when the server ends; 0: the server names no time (default {})", \
     LW_OPTION_REAL, &(options)->return_s, 0, 3600, NULL}
/* clang-format on */

/** Checks of several options: addresses, and whether other machines reach them. Errors: LW_USAGE,
 * LW_NO_INPUT. */
LW_MUST_CHECK enum lw_status lw_serve_options_check(struct lw_serve_options *options, struct lw_error *err);
/** Sets a server's descriptor by the options, which outlive it. */
void lw_serve_options_fill(struct lw_serve_options *options, struct lw_server_desc *desc);
/** Writes the port files, --port-file last: who sees it finds the others written. Errors: as
 * lw_atomic_file_save(); then none is left. */
LW_MUST_CHECK enum lw_status lw_serve_options_write_ports(const struct lw_serve_options *options,
                                                          const struct lw_server *server,
                                                          struct lw_error *err);
/** Removes them: regular files only. */
void lw_serve_options_remove_ports(const struct lw_serve_options *options);
/** Logs where browsers and monitoring find the server. */
void lw_serve_options_tell(const struct lw_serve_options *options, const struct lw_server *server);
/** Address for clients, as in a URL, or unix:PATH. */
void lw_serve_options_where(const struct lw_serve_options *options, const struct lw_server *server, char *dst,
                            size_t size);
#define LW_SERVE_OPTIONS_WHERE_SIZE 280 /* bytes that this takes at most */

#endif
