/* host_port.h: a host and a port as one text.
 * Threads: [any]. */
#ifndef LW_COMMON_BASE_HOST_PORT_H
#define LW_COMMON_BASE_HOST_PORT_H

#include <stdio.h>
#include <string.h>

/** Writes HOST:PORT. An IPv6 address is put in brackets (RFC 3986, 3.2.2). A text too long for dst is cut. */
static inline void lw_host_port_format(char *dst, size_t size, const char *host, unsigned port) {
    snprintf(dst, size, strchr(host, ':') ? "[%s]:%u" : "%s:%u", host, port);
}

#endif
