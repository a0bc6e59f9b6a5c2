/* tcp_proxy.h: a TCP proxy on 127.0.0.1 that the test cuts and opens again, in a thread of its own. */
#ifndef LW_TESTS_TCP_PROXY_H
#define LW_TESTS_TCP_PROXY_H

#include <stdbool.h>
#include <stdint.h>

struct lw_tcp_proxy;

/** Forwards connections at a free port to a port of 127.0.0.1, a few at a time. */
struct lw_tcp_proxy *lw_tcp_proxy_create(uint16_t to_port);
void lw_tcp_proxy_destroy(struct lw_tcp_proxy *proxy); /* NULL is fine */
uint16_t lw_tcp_proxy_port(const struct lw_tcp_proxy *proxy);
/** Ends all connections, and each new one at once, until it is opened. */
void lw_tcp_proxy_cut(struct lw_tcp_proxy *proxy);
void lw_tcp_proxy_open(struct lw_tcp_proxy *proxy);

#endif
