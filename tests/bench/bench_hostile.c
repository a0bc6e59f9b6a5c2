/* bench_hostile: sessions that misbehave, to run beside lightwell-load and see what honest ones feel of it.
 *   bench_hostile HOST:PORT KIND COUNT SECONDS
 * KIND  ping       PING as fast as the link takes them
 *       interest   INTEREST with 4,096 tiles, likewise
 *       everything INTEREST of everything and of nothing, in turn
 *       ack        ACK of a frame that was had, likewise
 *       hello      HELLO and nothing more
 *       connect    garbage, then again once it is refused
 *       mixed      all of them in turn, by number
 * COUNT sessions, each opened again when it is closed. One line at the end: what was written,
 * how often they were closed. */
#include "common/clock.h"
#include "common/options.h"
#include "proto/message.h"

#include <errno.h>
#include <netdb.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define COUNT_MAX    10000
#define FLOOD_SIZE   (256u << 10)
#define AGAIN_NS     200000000u /* from a close to the next connection */
#define WRITE_ROUNDS 4          /* of a flood, before the next session has its turn */

enum kind { PING, INTEREST, EVERYTHING, ACK, HELLO, CONNECT, KINDS };

static const char *const names[] = {"ping", "interest", "everything", "ack", "hello", "connect", "mixed"};

struct bytes {
    uint8_t *at;
    size_t size, capacity;
};

struct peer {
    int socket; /* -1: none */
    enum kind kind;
    uint64_t due_ns; /* to connect */
    size_t begin;    /* bytes of the opening that were written */
    size_t flood;    /* bytes of the flood, modulo its size */
};

static void fail(const char *what) {
    fprintf(stderr, "bench_hostile: %s: %s\n", what, strerror(errno));
    exit(1);
}

static void add(struct bytes *bytes, const struct lw_message *message) {
    uint8_t *one;
    size_t size;
    if (lw_message_encode_alloc(message, &one, &size) != LW_OK) fail("message");
    if (bytes->size + size > bytes->capacity) {
        bytes->capacity = 2 * (bytes->size + size);
        bytes->at = realloc(bytes->at, bytes->capacity);
        if (!bytes->at) fail("memory");
    }
    memcpy(bytes->at + bytes->size, one, size);
    bytes->size += size;
    free(one);
}

static struct bytes opening_of(enum kind kind) {
    struct bytes bytes = {0};
    if (kind == CONNECT) {
        add(&bytes, &(struct lw_message){.type = LW_MESSAGE_PING});
        return bytes;
    }
    add(&bytes, &(struct lw_message){
                    .type = LW_MESSAGE_HELLO,
                    .hello = {.version = LW_WIRE_VERSION, .features = LW_FEATURES_READ, .name = "hostile"}});
    if (kind == INTEREST || kind == EVERYTHING || kind == ACK)
        add(&bytes, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST});
    return bytes;
}

static struct bytes flood_of(enum kind kind) {
    /* Object 0, level 0, tile 0: of any scene. */
    static struct lw_message_interest_tile tile[LW_MESSAGE_INTEREST_MAX];
    struct bytes bytes = {0};
    for (unsigned i = 0; kind <= ACK && bytes.size < FLOOD_SIZE; i++) {
        if (kind == PING) add(&bytes, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = i});
        if (kind == INTEREST)
            add(&bytes,
                &(struct lw_message){
                    .type = LW_MESSAGE_INTEREST,
                    .interest = {.stand_ins = true, .tile = tile, .tile_count = LW_MESSAGE_INTEREST_MAX}});
        if (kind == EVERYTHING)
            add(&bytes, &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest.everything = i % 2});
        if (kind == ACK) add(&bytes, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = 1});
    }
    return bytes;
}

static void dial(struct peer *p, const struct addrinfo *to) {
    p->socket = socket(to->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (p->socket < 0) fail("socket");
    if (connect(p->socket, to->ai_addr, to->ai_addrlen) != 0 && errno != EINPROGRESS) fail("connect");
    p->begin = p->flood = 0;
}

/* Returns whether it is closed. */
static bool drop_input(struct peer *p) {
    static char dropped[1u << 16];
    for (;;) {
        const ssize_t n = recv(p->socket, dropped, sizeof dropped, 0);
        if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) return true;
        if (n < 0 && errno == EAGAIN) return false;
    }
}

static ssize_t write_some(int socket, const uint8_t *bytes, size_t size) {
    const ssize_t n = send(socket, bytes, size, MSG_NOSIGNAL);
    return n < 0 && (errno == EAGAIN || errno == EINTR || errno == ENOTCONN) ? 0 : n;
}

/* Returns bytes; below 0: it is closed. */
static ssize_t flood(struct peer *p, const struct bytes *opening, const struct bytes *more) {
    ssize_t total = 0;
    if (p->begin < opening->size) {
        const ssize_t n = write_some(p->socket, opening->at + p->begin, opening->size - p->begin);
        if (n < 0) return n;
        p->begin += (size_t)n;
        return n;
    }
    for (unsigned i = 0; more->size && i < WRITE_ROUNDS; i++) {
        const ssize_t n = write_some(p->socket, more->at + p->flood, more->size - p->flood);
        if (n < 0) return n;
        p->flood = (p->flood + (size_t)n) % more->size;
        total += n;
        if (!n) break;
    }
    return total;
}

int main(int argc, char **argv) {
    static struct peer peer[COUNT_MAX];
    static struct pollfd wait[COUNT_MAX];
    struct bytes opening[KINDS], more[KINDS];
    char host[256], service[8];
    uint16_t port;
    struct lw_error err = {0};
    unsigned kind = 0;
    const int count = argc == 5 ? atoi(argv[3]) : 0;
    while (argc == 5 && kind <= KINDS && strcmp(argv[2], names[kind]) != 0) kind++;
    if (argc != 5 || kind > KINDS || count < 1 || count > COUNT_MAX ||
        lw_options_address(argv[1], host, sizeof host, &port, &err) != LW_OK) {
        fprintf(stderr,
                "bench_hostile HOST:PORT ping|interest|everything|ack|hello|connect|mixed COUNT SECONDS\n");
        return 64;
    }
    const uint64_t end_ns = lw_clock_ns() + (uint64_t)(atof(argv[4]) * 1e9);
    const struct addrinfo hints = {.ai_socktype = SOCK_STREAM};
    struct addrinfo *to;
    snprintf(service, sizeof service, "%u", (unsigned)port);
    if (getaddrinfo(host, service, &hints, &to) != 0) fail(host);
    for (unsigned k = 0; k < KINDS; k++) {
        opening[k] = opening_of((enum kind)k);
        more[k] = flood_of((enum kind)k);
    }
    for (int i = 0; i < count; i++)
        peer[i] =
            (struct peer){.socket = -1, .kind = kind == KINDS ? (enum kind)(i % KINDS) : (enum kind)kind};
    uint64_t written = 0, closed = 0, now_ns;
    while ((now_ns = lw_clock_ns()) < end_ns) {
        for (int i = 0; i < count; i++) {
            struct peer *p = &peer[i];
            if (p->socket < 0 && now_ns >= p->due_ns) dial(p, to);
            const bool writes = p->begin < opening[p->kind].size || more[p->kind].size;
            wait[i] = (struct pollfd){.fd = p->socket, .events = (short)(writes ? POLLIN | POLLOUT : POLLIN)};
        }
        poll(wait, (nfds_t)count, 10);
        for (int i = 0; i < count; i++) {
            struct peer *p = &peer[i];
            if (p->socket < 0 || !wait[i].revents) continue;
            ssize_t n = wait[i].revents & ~POLLOUT && drop_input(p) ? -1 : 0;
            if (n == 0 && wait[i].revents & POLLOUT) n = flood(p, &opening[p->kind], &more[p->kind]);
            if (n >= 0) {
                written += (uint64_t)n;
                continue;
            }
            close(p->socket);
            p->socket = -1;
            p->due_ns = now_ns + (p->kind == CONNECT ? 0 : AGAIN_NS);
            closed++;
        }
    }
    printf("%s: %d sessions, %.1f MB written, closed %llu times\n", names[kind], count,
           (double)written * 1e-6, (unsigned long long)closed);
    return 0;
}
