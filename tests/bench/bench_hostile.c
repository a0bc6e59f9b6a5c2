/* bench_hostile: sessions that misbehave, to run beside lightwell-load and see what honest ones feel of it;
 * hostile.py does that with each kind in turn.
 *   bench_hostile HOST:PORT KIND COUNT SECONDS [FROM]
 * KIND   one of the list below; HOST:PORT is the address of its link. Kinds by TLS want a server by TLS
 * COUNT  connections, each opened again when it is closed
 * FROM   an address of this machine that they come from, such as 127.0.0.2
 * Whatever the server says is read and dropped. One line at the end: bytes written, how often they were
 * closed, and the processor time that this took. */
#include "client/include/lightwell/lightwell.h"
#include "client/lib/tls_trust.h"
#include "common/base/clock.h"
#include "common/base/options.h"
#include "common/tls/tls_stream.h"
#include "proto/message.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#define COUNT_MAX    10000
#define FLOOD_SIZE   (256u << 10)
#define AGAIN_NS     200000000u /* from a close to the next connection */
#define WRITE_ROUNDS 4          /* writes of a flood, before the next session has its turn */
#define RECORDS      256        /* TLS records in a round, a byte each */
#define FINER_TILES  1024u      /* as many as a session may list */
#define FINER_NS     1000000000u

/* name, link, what it does */
#define KINDS(X)                                                                                             \
    X(PING, "ping", TCP, "PING without end")                                                                 \
    X(INTEREST, "interest", TCP, "INTEREST with 4,096 tiles")                                                \
    X(FINER, "finer", TCP, "INTEREST with 1,024 tiles of finer levels, others each second")                  \
    X(EVERYTHING, "everything", TCP, "INTEREST of everything and of nothing, in turn")                       \
    X(ACK, "ack", TCP, "ACK of a frame that was had")                                                        \
    X(UPDATE, "update", TCP, "UPDATE without the right to")                                                  \
    X(CONNECT, "connect", TCP, "garbage, and again once it is refused")                                      \
    X(HELLO, "hello", TCP, "HELLO and nothing more")                                                         \
    X(HALF_HELLO, "half-hello", TCP, "3 kB of a HELLO of 60 kB")                                             \
    X(EMPTY_FRAMES, "empty-frames", WEBSOCKET, "frames without a byte")                                      \
    X(PING_FRAMES, "ping-frames", WEBSOCKET, "WebSocket pings")                                              \
    X(FRAGMENTS, "fragments", WEBSOCKET, "fragments of a byte")                                              \
    X(GET, "get", HTTP, "GET of /, one after another without end")                                           \
    X(NOT_MODIFIED, "not-modified", HTTP, "the same with a tag: 304 or 404")                                 \
    X(GET_ONCE, "get-once", HTTP, "GET of /, and again by a new connection")                                 \
    X(HALF_REQUEST, "half-request", HTTP, "3 kB of a request")                                               \
    X(RECORDS_OF_1, "records", TLS, "PING, a byte in a record")                                              \
    X(HANDSHAKES, "handshakes", TLS, "a handshake, and again")                                               \
    X(HALF_HANDSHAKE, "half-handshake", TLS, "a ClientHello")                                                \
    X(WEB_HANDSHAKES, "web-handshakes", HTTPS, "a handshake, and again")

enum link { TCP, WEBSOCKET, HTTP, TLS, HTTPS };

enum kind {
#define X(id, ...) id,
    KINDS(X)
#undef X
        KIND_COUNT
};

static const char *const links[] = {"TCP", "WebSocket", "HTTP", "TLS", "HTTPS"};
static const struct {
    const char *name;
    enum link link;
    const char *what;
} kinds[] = {
#define X(id, name, link, what) {name, link, what},
    KINDS(X)
#undef X
};

struct bytes {
    uint8_t *at;
    size_t size, capacity;
};

/* What a kind says: an opening, which may wait for an answer; then the flood. */
static struct script {
    struct bytes opening, flood;
    size_t first; /* bytes of the opening, before the answer; 0: it waits for none */
    size_t *part; /* FINER: where each list begins, and the end */
    size_t part_count;
} script;

struct peer {
    int socket;      /* -1: none */
    uint64_t due_ns; /* to connect */
    size_t begin;    /* bytes of the opening that were written */
    size_t flood;    /* bytes of the flood, modulo its size */
    size_t part_end; /* FINER: of the list that is being said */
    uint64_t part_due_ns;
    bool answered;
    struct lw_tls_stream *tls;
    struct lw_tls_output output;
    size_t sent; /* bytes of output */
};

static enum kind kind;
static struct ssl_ctx_st *trust;
static struct sockaddr_in own; /* family 0: any */

static void fail(const char *what) {
    fprintf(stderr, "bench_hostile: %s: %s\n", what, strerror(errno));
    exit(1);
}

/* ---- messages ---- */

static void add_bytes(struct bytes *bytes, const void *src, size_t size) {
    if (bytes->size + size > bytes->capacity) {
        bytes->capacity = 2 * (bytes->size + size);
        bytes->at = realloc(bytes->at, bytes->capacity);
        if (!bytes->at) fail("memory");
    }
    memcpy(bytes->at + bytes->size, src, size);
    bytes->size += size;
}

static void add_text(struct bytes *bytes, const char *text) { add_bytes(bytes, text, strlen(text)); }

static void add_message(struct bytes *bytes, const struct lw_message *message) {
    uint8_t *one;
    size_t size;
    if (lw_message_encode_alloc(message, &one, &size) != LW_OK) fail("message");
    add_bytes(bytes, one, size);
    free(one);
}

/* Masked with zeros; under 126 bytes. */
static void add_frame(struct bytes *bytes, uint8_t first, const void *src, size_t size) {
    const uint8_t header[6] = {first, (uint8_t)(0x80 | size)};
    add_bytes(bytes, header, sizeof header);
    add_bytes(bytes, src, size);
}

static void add_greeting(struct bytes *bytes) {
    add_message(bytes, &(struct lw_message){
                           .type = LW_MESSAGE_HELLO,
                           .hello = {.version = LW_WIRE_VERSION,
                                     .features = LW_FEATURES_READ | (kind == FINER ? LW_FEATURE_FINER : 0),
                                     .name = "hostile"}});
    add_message(bytes, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST});
}

static void write_opening(void) {
    struct bytes *bytes = &script.opening, greeting = {0};
    static uint8_t nothing[3000];
    add_greeting(&greeting);
    switch (kind) {
    case CONNECT:
        add_message(bytes, &(struct lw_message){.type = LW_MESSAGE_PING});
        break;
    case HALF_HELLO:
        lw_framing_write_header(nothing,
                                (struct lw_framing_header){.body_size = 60000, .type = LW_MESSAGE_HELLO});
        add_bytes(bytes, nothing, sizeof nothing);
        break;
    case HALF_REQUEST:
        add_text(bytes, "GET / HTTP/1.1\r\nHost: localhost\r\nX-Long: ");
        memset(nothing, 'x', sizeof nothing);
        add_bytes(bytes, nothing, sizeof nothing);
        break;
    case HELLO:
        add_message(bytes, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                                .hello = {.version = LW_WIRE_VERSION,
                                                          .features = LW_FEATURES_READ,
                                                          .name = "hostile"}});
        break;
    default:
        break;
    }
    if (kinds[kind].link == WEBSOCKET) {
        add_text(bytes, "GET /ws HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
                        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
                        "Sec-WebSocket-Protocol: lightwell\r\n\r\n");
        script.first = bytes->size;
        add_frame(bytes, 0x82, greeting.at, greeting.size);
    }
    if (kind <= UPDATE) add_bytes(bytes, greeting.at, greeting.size);
    free(greeting.at);
}

static void write_flood(void) {
    /* Object 0, level 0, tile 0: of any scene. */
    static struct lw_message_interest_tile tile[LW_MESSAGE_INTEREST_MAX];
    static const struct lw_scene_change hide = {LW_SCENE_CHANGE_OBJECT_HIDE, 0, 0, {0}};
    struct bytes *bytes = &script.flood;
    for (unsigned i = 0; bytes->size < FLOOD_SIZE; i++) {
        const size_t before = bytes->size;
        if (kind == PING || kind == RECORDS_OF_1)
            add_message(bytes, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = i});
        if (kind == INTEREST)
            add_message(bytes, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                                    .interest = {.stand_ins = true,
                                                                 .tile = tile,
                                                                 .tile_count = LW_MESSAGE_INTEREST_MAX}});
        if (kind == EVERYTHING)
            add_message(bytes,
                        &(struct lw_message){.type = LW_MESSAGE_INTEREST, .interest.everything = i % 2});
        if (kind == ACK) add_message(bytes, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = 1});
        if (kind == UPDATE)
            add_message(bytes,
                        &(struct lw_message){.type = LW_MESSAGE_UPDATE,
                                             .update = {.request = i, .change = &hide, .change_count = 1}});
        if (kind == EMPTY_FRAMES) add_frame(bytes, 0x82, NULL, 0);
        if (kind == PING_FRAMES) add_frame(bytes, 0x89, NULL, 0);
        if (kind == FRAGMENTS) add_frame(bytes, i ? 0x00 : 0x02, "", 1);
        if (kind == GET || kind == GET_ONCE) add_text(bytes, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
        if (kind == NOT_MODIFIED)
            add_text(bytes, "GET /nothing HTTP/1.1\r\nHost: localhost\r\nIf-None-Match: \"x\"\r\n\r\n");
        if (bytes->size == before || kind == GET_ONCE) return;
    }
}

/* ---- tiles of finer levels ---- */

static void check(enum lw_live_status status, const struct lw_live_error *err) {
    if (status == LW_LIVE_OK) return;
    fprintf(stderr, "bench_hostile: %s\n", err->text);
    exit(1);
}

/* Opens an honest session until it has the scene. */
static struct lw_live *open_scene(const char *host, uint16_t port, struct lw_live_scene *out_scene,
                                  uint32_t *out_levels) {
    struct lw_live_desc desc = {
        .struct_size = sizeof desc, .host = host, .port = port, .name = "scout", .finer_slots = 1};
    struct lw_live_stats stats = {.struct_size = sizeof stats};
    struct lw_live_finer finer = {.struct_size = sizeof finer};
    struct lw_live_error err;
    struct lw_live *live;
    check(lw_live_open(&desc, &live, &err), &err);
    while (!stats.has_scene) {
        check(lw_live_poll(live, 100, &err), &err);
        check(lw_live_get_stats(live, &stats, &err), &err);
    }
    check(lw_live_get_scene(live, out_scene, &err), &err);
    check(lw_live_get_finer(live, &finer, &err), &err);
    *out_levels = finer.level_count;
    return live;
}

static void add_part(const struct lw_message_interest_tile *tile, uint32_t count) {
    add_message(&script.flood, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                                    .interest = {.tile = tile, .tile_count = count}});
    script.part = realloc(script.part, (script.part_count + 2) * sizeof *script.part);
    if (!script.part) fail("memory");
    script.part[++script.part_count] = script.flood.size;
}

/* Lists all tiles of finer levels of the scene, FINER_TILES at a time. */
static void write_finer(const char *host, uint16_t port) {
    static struct lw_message_interest_tile tile[FINER_TILES];
    struct lw_live_scene scene = {.struct_size = sizeof scene};
    struct lw_live_pages pages = {.struct_size = sizeof pages};
    struct lw_live_error err;
    uint32_t levels, count = 0;
    uint64_t all = 0;
    struct lw_live *live = open_scene(host, port, &scene, &levels);
    script.part = calloc(1, sizeof *script.part);
    for (uint32_t object = 0; object < scene.object_count; object++)
        for (uint32_t k = 1; k <= levels; k++) {
            if (lw_live_get_pages(live, object, LW_LIVE_FINER + k, &pages, &err) != LW_LIVE_OK) continue;
            for (uint32_t t = 0; t < pages.columns * pages.rows; t++, all++) {
                tile[count++] = (struct lw_message_interest_tile){object, LW_LIVE_FINER + k, t};
                if (count < FINER_TILES) continue;
                add_part(tile, count);
                count = 0;
            }
        }
    if (count) add_part(tile, count);
    lw_live_close(live);
    printf("the scene has %llu tiles of finer levels: %zu lists\n", (unsigned long long)all,
           script.part_count);
    if (!script.part_count) exit(1);
}

/* Whether a session has a list to say now; begins its next one. */
static bool begins_part(struct peer *p, size_t number, uint64_t now_ns) {
    if (p->flood < p->part_end) return true;
    if (now_ns < p->part_due_ns) return false;
    const size_t part = (number + now_ns / FINER_NS) % script.part_count;
    p->flood = script.part[part];
    p->part_end = script.part[part + 1];
    p->part_due_ns = now_ns + FINER_NS;
    return true;
}

/* ---- connections ---- */

static bool is_by_tls(void) { return kinds[kind].link == TLS || kinds[kind].link == HTTPS; }

static void dial(struct peer *p, const struct addrinfo *to) {
    p->socket = socket(to->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (p->socket < 0) fail("socket");
    if (own.sin_family && bind(p->socket, (struct sockaddr *)&own, sizeof own) != 0) fail("bind");
    if (connect(p->socket, to->ai_addr, to->ai_addrlen) != 0 && errno != EINPROGRESS) fail("connect");
    p->begin = p->flood = p->part_end = p->sent = p->output.size = 0;
    p->answered = false;
    if (is_by_tls() && lw_tls_stream_create(trust, "localhost", &p->tls) != LW_OK) fail("TLS");
}

static void hang_up(struct peer *p, uint64_t now_ns) {
    const bool in_a_hurry =
        kind == CONNECT || kind == GET_ONCE || kind == HANDSHAKES || kind == WEB_HANDSHAKES;
    close(p->socket);
    lw_tls_stream_destroy(p->tls);
    p->tls = NULL;
    p->socket = -1;
    p->due_ns = now_ns + (in_a_hurry ? 0 : AGAIN_NS);
}

static ssize_t write_some(int socket, const uint8_t *bytes, size_t size) {
    const ssize_t n = send(socket, bytes, size, MSG_NOSIGNAL);
    return n < 0 && (errno == EAGAIN || errno == EINTR || errno == ENOTCONN) ? 0 : n;
}

/* What TLS has made. Returns bytes; below 0: it is closed. */
static ssize_t flush(struct peer *p) {
    const ssize_t n = write_some(p->socket, p->output.bytes + p->sent, p->output.size - p->sent);
    if (n < 0) return n;
    p->sent += (size_t)n;
    if (p->sent == p->output.size) p->sent = p->output.size = 0;
    return n;
}

/* Shakes hands, drops the rest. Returns whether it is closed, or has done what it came for. */
static bool drop_input(struct peer *p) {
    static uint8_t came[1u << 16], dropped[1u << 14];
    for (;;) {
        const ssize_t n = recv(p->socket, came, sizeof came, 0);
        if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) return true;
        if (n < 0 && errno == EAGAIN) return false;
        if (n < 0) continue;
        p->answered = true;
        if (kind == GET_ONCE) return true;
        if (!p->tls || kind == HALF_HANDSHAKE) continue;
        size_t got;
        lw_tls_stream_lend(p->tls, came, (size_t)n);
        do {
            got = 0;
            if (lw_tls_stream_read(p->tls, dropped, sizeof dropped, &got, &p->output, NULL) != LW_OK)
                return true;
        } while (got);
        if (lw_tls_stream_is_ready(p->tls) && kind != RECORDS_OF_1) {
            (void)flush(p);
            return true;
        }
    }
}

static ssize_t write_next_by_tls(struct peer *p) {
    size_t unused = 0;
    if (!p->begin) { /* the ClientHello */
        p->begin = 1;
        if (lw_tls_stream_read(p->tls, NULL, 0, &unused, &p->output, NULL) != LW_OK) return -1;
    }
    if (kind == RECORDS_OF_1 && lw_tls_stream_is_ready(p->tls) && p->output.size == p->sent)
        for (int i = 0; i < RECORDS; i++, p->flood = (p->flood + 1) % script.flood.size)
            if (lw_tls_stream_write(p->tls, script.flood.at + p->flood, 1, &p->output) != LW_OK) return -1;
    return p->output.size > p->sent ? flush(p) : 0;
}

/* Returns bytes; below 0: it is closed. */
static ssize_t write_next(struct peer *p) {
    const struct bytes *opening = &script.opening, *flood = &script.flood;
    if (p->tls) return write_next_by_tls(p);
    if (p->begin < opening->size) {
        const size_t end = p->answered || !script.first ? opening->size : script.first;
        const ssize_t n = write_some(p->socket, opening->at + p->begin, end - p->begin);
        if (n > 0) p->begin += (size_t)n;
        return n;
    }
    ssize_t total = 0;
    if (kind == FINER) {
        total = write_some(p->socket, flood->at + p->flood, p->part_end - p->flood);
        if (total > 0) p->flood += (size_t)total;
        return total;
    }
    for (unsigned i = 0; flood->size && i < WRITE_ROUNDS; i++) {
        if (kind == GET_ONCE && i) break;
        const ssize_t n = write_some(p->socket, flood->at + p->flood, flood->size - p->flood);
        if (n < 0) return n;
        p->flood = (p->flood + (size_t)n) % flood->size;
        total += n;
        if (!n) break;
    }
    return total;
}

static bool has_more_to_say(struct peer *p, size_t number, uint64_t now_ns) {
    if (p->tls)
        return !p->begin || p->output.size > p->sent ||
               (kind == RECORDS_OF_1 && lw_tls_stream_is_ready(p->tls));
    if (p->begin < script.opening.size) return p->answered || !script.first || p->begin < script.first;
    return kind == FINER ? begins_part(p, number, now_ns) : script.flood.size > 0;
}

static int usage(void) {
    fprintf(stderr, "bench_hostile HOST:PORT KIND COUNT SECONDS [FROM]\n");
    for (int k = 0; k < KIND_COUNT; k++)
        fprintf(stderr, "  %-15s %-10s %s\n", kinds[k].name, links[kinds[k].link], kinds[k].what);
    return 64;
}

static double cpu_s(void) {
    struct rusage use;
    getrusage(RUSAGE_SELF, &use);
    return (double)(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
           1e-6 * (double)(use.ru_utime.tv_usec + use.ru_stime.tv_usec);
}

int main(int argc, char **argv) {
    static struct peer peer[COUNT_MAX];
    static struct pollfd wait[COUNT_MAX];
    char host[256], service[8];
    uint16_t port;
    struct lw_error err = {0};
    const int count = argc >= 5 ? atoi(argv[3]) : 0;
    while (argc >= 5 && kind < KIND_COUNT && strcmp(argv[2], kinds[kind].name) != 0) kind++;
    if (argc < 5 || argc > 6 || kind == KIND_COUNT || count < 1 || count > COUNT_MAX ||
        lw_options_address(argv[1], host, sizeof host, &port, &err) != LW_OK)
        return usage();
    if (argc == 6) {
        own.sin_family = AF_INET;
        own.sin_addr.s_addr = inet_addr(argv[5]);
        if (own.sin_addr.s_addr == INADDR_NONE) return usage();
    }
    const struct addrinfo hints = {.ai_socktype = SOCK_STREAM};
    struct addrinfo *to;
    snprintf(service, sizeof service, "%u", (unsigned)port);
    if (getaddrinfo(host, service, &hints, &to) != 0) fail(host);
    if (is_by_tls() &&
        lw_tls_trust_create(&(struct lw_tls_trust_desc){true, NULL, true}, &trust, &err) != LW_OK)
        fail(err.text);
    write_opening();
    if (kind == FINER)
        write_finer(host, port);
    else
        write_flood();
    for (int i = 0; i < count; i++) peer[i].socket = -1;
    const uint64_t end_ns = lw_clock_ns() + (uint64_t)(atof(argv[4]) * 1e9);
    uint64_t written = 0, closed = 0, now_ns;
    while ((now_ns = lw_clock_ns()) < end_ns) {
        for (int i = 0; i < count; i++) {
            struct peer *p = &peer[i];
            if (p->socket < 0 && now_ns >= p->due_ns) dial(p, to);
            const bool writes = p->socket >= 0 && has_more_to_say(p, (size_t)i, now_ns);
            wait[i] = (struct pollfd){.fd = p->socket, .events = (short)(writes ? POLLIN | POLLOUT : POLLIN)};
        }
        poll(wait, (nfds_t)count, 10);
        for (int i = 0; i < count; i++) {
            struct peer *p = &peer[i];
            if (p->socket < 0 || !wait[i].revents) continue;
            ssize_t n = wait[i].revents & ~POLLOUT && drop_input(p) ? -1 : 0;
            if (n == 0 && wait[i].revents & POLLOUT) n = write_next(p);
            if (n >= 0) {
                written += (uint64_t)n;
                continue;
            }
            hang_up(p, now_ns);
            closed++;
        }
    }
    printf("%s: %d sessions, %.1f MB written, closed %llu times, %.2f CPU s\n", kinds[kind].name, count,
           (double)written * 1e-6, (unsigned long long)closed, cpu_s());
    return 0;
}
