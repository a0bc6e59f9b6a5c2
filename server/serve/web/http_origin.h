/* http_origin.h: whether a browser's request is for this server, and from a page of it.
 * Flow:    headers Host, Origin -> [http_origin] -> yes or no
 * Threads: pure functions, [any].
 *
 * A page of another site must not reach a server on its visitor's machine: neither by a
 * WebSocket, which no same-origin policy holds back (RFC 6455, 10.2), nor by a name of its own
 * that leads here (DNS rebinding). */
#ifndef LW_SERVE_WEB_HTTP_ORIGIN_H
#define LW_SERVE_WEB_HTTP_ORIGIN_H

#include <stdbool.h>
#include <stddef.h>

#define LW_HTTP_ORIGIN_MAX 300u /* characters of a header that is looked at, terminator included */

/** The name or address in a Host header, without port and brackets, in lower case, as a browser may send it.
 * false: it is no host, or longer than fits; out_name is then of no use. */
bool lw_http_origin_host_name(const char *host, char *out_name, size_t name_size);

/** Whether a name is of the own machine: localhost, 127.0.0.0/8, ::1. */
bool lw_http_origin_is_loopback(const char *name);

/** Whether an Origin header names the host and port of the Host header. */
bool lw_http_origin_is_same(const char *origin, const char *host);

/** Whether a list, by commas, holds a text. NULL is an empty list. Letters compare without case. */
bool lw_http_origin_is_listed(const char *list, const char *text);

#endif
