#include "tests/support/tcp_proxy.h"

#include "tests/support/support.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

#define LINKS   4
#define LOOK_MS 20 /* for a change of state */

struct lw_tcp_proxy {
    uint16_t to_port, port;
    int listener;
    int end[LINKS][2]; /* below 0: there is none */
    pthread_t thread;
    _Atomic bool is_cut, stops;
};

static struct sockaddr_in loopback(uint16_t port) {
    return (struct sockaddr_in){
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
}

static void close_link(int end[2]) {
    for (int i = 0; i < 2; i++) {
        if (end[i] >= 0) close(end[i]);
        end[i] = -1;
    }
}

static void accept_link(struct lw_tcp_proxy *p) {
    const struct sockaddr_in to = loopback(p->to_port);
    const int client = accept4(p->listener, NULL, NULL, SOCK_CLOEXEC);
    int i = 0;
    if (client < 0) return;
    while (i < LINKS && p->end[i][0] >= 0) i++;
    if (p->is_cut || i == LINKS) {
        close(client);
        return;
    }
    p->end[i][0] = client;
    p->end[i][1] = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (connect(p->end[i][1], (const struct sockaddr *)&to, sizeof to) != 0) close_link(p->end[i]);
}

/* Returns whether the link goes on. */
static bool forward(int from, int to) {
    uint8_t bytes[16u << 10];
    const ssize_t got = recv(from, bytes, sizeof bytes, 0);
    if (got <= 0) return false;
    for (ssize_t at = 0; at < got;) {
        const ssize_t sent = send(to, bytes + at, (size_t)(got - at), MSG_NOSIGNAL);
        if (sent <= 0) return false;
        at += sent;
    }
    return true;
}

static void *run(void *context) {
    struct lw_tcp_proxy *p = context;
    while (!p->stops) {
        struct pollfd polled[1 + 2 * LINKS] = {{.fd = p->listener, .events = POLLIN}};
        for (int i = 0; i < 2 * LINKS; i++)
            polled[1 + i] = (struct pollfd){.fd = p->end[i / 2][i % 2], .events = POLLIN};
        (void)poll(polled, 1 + 2 * LINKS, LOOK_MS);
        for (int i = 0; i < 2 * LINKS; i++) {
            int *end = p->end[i / 2];
            if (end[0] < 0) continue;
            if (p->is_cut || (polled[1 + i].revents && !forward(end[i % 2], end[1 - i % 2]))) close_link(end);
        }
        if (polled[0].revents) accept_link(p);
    }
    for (int i = 0; i < LINKS; i++) close_link(p->end[i]);
    return NULL;
}

struct lw_tcp_proxy *lw_tcp_proxy_create(uint16_t to_port) {
    struct lw_tcp_proxy *p = calloc(1, sizeof *p);
    struct sockaddr_in address = loopback(0);
    socklen_t size = sizeof address;
    assert_non_null(p);
    p->to_port = to_port;
    for (int i = 0; i < LINKS; i++) p->end[i][0] = p->end[i][1] = -1;
    p->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(p->listener, (struct sockaddr *)&address, size), 0);
    assert_int_equal(listen(p->listener, LINKS), 0);
    assert_int_equal(getsockname(p->listener, (struct sockaddr *)&address, &size), 0);
    p->port = ntohs(address.sin_port);
    assert_int_equal(pthread_create(&p->thread, NULL, run, p), 0);
    return p;
}

void lw_tcp_proxy_destroy(struct lw_tcp_proxy *p) {
    if (!p) return;
    p->stops = true;
    pthread_join(p->thread, NULL);
    close(p->listener);
    free(p);
}

uint16_t lw_tcp_proxy_port(const struct lw_tcp_proxy *p) { return p->port; }
void lw_tcp_proxy_cut(struct lw_tcp_proxy *p) { p->is_cut = true; }
void lw_tcp_proxy_open(struct lw_tcp_proxy *p) { p->is_cut = false; }
