/* bench_fanout: what it costs the network's thread to hand a snapshot to many sessions.
 *
 *     bench_fanout [--clients N] [--payload BYTES] [--tiles N] [--seconds S] [--tls | --never N]
 *
 * The server that ships, on loopback, with snapshots made by hand in which every tile is new; the next comes
 * when all have the last. One thread plays all clients: it says hello for them and drops what arrives. The
 * rows: the server; and, as what the system itself costs, the same bytes to as many connections by nothing
 * but epoll_wait() and writev() of 128 KiB. Compare CPU time within a run: all three threads share the
 * machine.
 * With --tls there is a row more: the server by TLS, to clients that shake hands and drop sealed bytes.
 * With --never N something else is asked: what N more clients that never read cost those who do. Rounds with
 * and without them take turns, on one server; of each, how long it takes from the moment at which a snapshot
 * is handed over until a client has the last byte of it, by client and snapshot. What else runs on the
 * machine only adds to that: on a busy one trust the quietest rounds. */
#include "tests/support/support.h"

#include "common/base/clock.h"
#include "common/base/histogram.h"
#include "common/base/log.h"
#include "common/tls/tls_stream.h"
#include "server/serve/server.h"
#include "tests/bench/bench_setup.h"
#include "tests/support/certificate.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/tcp.h>
#include <openssl/ssl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/uio.h>
#include <unistd.h>

#define EVENTS       256
#define DROP_BYTES   (4u << 20) /* at once, of one connection */
#define BATCH_BLOBS  64
#define NEVER_ROUNDS 16           /* with and without, each */
#define BATCH_BYTES  (128u << 10) /* as the server's */

struct bench {
    int64_t clients, payload, tiles, never;
    double seconds;
    bool by_tls;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_blob *frame, **blob; /* one for each tile */
    uint64_t snapshot_bytes;
    struct lw_server *server;
    pthread_t serving, dropping;
    int *client;
    int epoll; /* all clients, to read from */
    _Atomic bool over;
    _Atomic uint64_t dropped; /* bytes */
};

struct row {
    double wall_s, cpu_s;
    uint64_t bytes, tiles, resident;
};

static void give_up(const char *what) {
    fprintf(stderr, "bench_fanout: %s: %s\n", what, strerror(errno));
    exit(1);
}

static uint64_t resident_bytes(void) {
    unsigned long long size = 0, resident = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    if (!f || fscanf(f, "%llu %llu", &size, &resident) != 2) give_up("/proc/self/statm");
    fclose(f);
    return resident * (uint64_t)sysconf(_SC_PAGESIZE);
}

/* ---- snapshots ---- */

static struct lw_blob *message_blob(const struct lw_message *message) {
    struct lw_blob *blob;
    if (lw_blob_from_message(message, &blob) != LW_OK) give_up("a message");
    return blob;
}

static void make_blobs(struct bench *b) {
    uint32_t side = 1;
    while ((int64_t)(side + 1) * (side + 1) <= b->tiles) side++;
    b->scene = lw_support_squares(1, 1);
    b->scene->mesh[0].atlas_width = b->scene->mesh[0].atlas_height = side * LW_TILE_SIDE;
    if (lw_atlas_map_init(&b->map, b->scene) != LW_OK) give_up("tiles");
    b->frame = message_blob(&(struct lw_message){.type = LW_MESSAGE_FRAME, .frame.frame = 1});
    b->blob = calloc(b->map.tile_count, sizeof(struct lw_blob *));
    uint8_t *payload = malloc((size_t)b->payload);
    if (!b->blob || !payload) give_up("memory");
    for (uint32_t t = 0; t < b->map.tile_count; t++) {
        memset(payload, (int)t, (size_t)b->payload);
        b->blob[t] = message_blob(&(struct lw_message){.type = LW_MESSAGE_TILE,
                                                       .tile = {.tile = t,
                                                                .version = 1,
                                                                .codec = 1,
                                                                .scale = 1,
                                                                .payload = payload,
                                                                .payload_size = (size_t)b->payload}});
        b->snapshot_bytes += b->blob[t]->size;
    }
    free(payload);
}

/* Nobody decodes: the bytes may be the same in every version. */
static void publish(struct bench *b, uint64_t frame) {
    struct lw_snapshot *snapshot;
    if (lw_snapshot_create(b->map.tile_count, 1u << LW_TILE_CHANNEL_FULL, &snapshot) != LW_OK)
        give_up("a snapshot");
    snapshot->frame = frame;
    snapshot->frame_full = lw_blob_ref(b->frame);
    for (uint32_t t = 0; t < b->map.tile_count; t++)
        snapshot->tile[LW_TILE_CHANNEL_FULL][t] =
            (struct lw_snapshot_tile){.version = frame, .blob = lw_blob_ref(b->blob[t])};
    lw_server_publish(b->server, snapshot);
    lw_snapshot_unref(snapshot);
}

/* ---- clients ---- */

static void *drop_input(void *context) {
    struct bench *b = context;
    struct epoll_event event[EVENTS];
    while (!b->over) {
        int ready = epoll_wait(b->epoll, event, EVENTS, 50);
        for (int i = 0; i < ready; i++) {
            ssize_t size = recv(event[i].data.fd, NULL, DROP_BYTES, MSG_TRUNC | MSG_DONTWAIT);
            if (size > 0) b->dropped += (uint64_t)size;
        }
    }
    return NULL;
}

static int dial(uint16_t port) {
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int s = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (s < 0 || connect(s, (struct sockaddr *)&address, sizeof address) < 0) give_up("connect");
    return s;
}

static void watch(struct bench *b, int client) {
    struct epoll_event event = {.events = EPOLLIN, .data.fd = client};
    if (epoll_ctl(b->epoll, EPOLL_CTL_ADD, client, &event) < 0) give_up("epoll");
}

static void send_message(int s, const struct lw_message *message) {
    struct lw_blob *blob = message_blob(message);
    if (send(s, blob->bytes, blob->size, MSG_NOSIGNAL) != (ssize_t)blob->size) give_up("send");
    lw_blob_unref(blob);
}

static void send_hello(int s, uint64_t package_compressed_size) {
    send_message(s, &(struct lw_message){.type = LW_MESSAGE_HELLO, .hello.version = LW_WIRE_VERSION});
    send_message(s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST,
                                         .package_request.offset = package_compressed_size});
}

/* The same by TLS. Nothing more will be said, so that what made it may go. */
static void send_hello_by_tls(int s, SSL_CTX *trust, uint64_t package_compressed_size) {
    static uint8_t came[1u << 16];
    const struct lw_message said[] = {
        {.type = LW_MESSAGE_HELLO, .hello.version = LW_WIRE_VERSION},
        {.type = LW_MESSAGE_PACKAGE_REQUEST, .package_request.offset = package_compressed_size}};
    struct lw_tls_stream *stream;
    struct lw_tls_output output = {0};
    if (lw_tls_stream_create(trust, "localhost", &stream) != LW_OK) give_up("TLS");
    for (size_t got = 0; !lw_tls_stream_is_ready(stream);) {
        if (lw_tls_stream_read(stream, NULL, 0, &got, &output, NULL) != LW_OK) give_up("a handshake");
        if (send(s, output.bytes, output.size, MSG_NOSIGNAL) != (ssize_t)output.size) give_up("send");
        output.size = 0;
        if (lw_tls_stream_is_ready(stream)) break;
        const ssize_t n = recv(s, came, sizeof came, 0);
        if (n <= 0) give_up("a handshake");
        lw_tls_stream_lend(stream, came, (size_t)n);
    }
    for (int i = 0; i < 2; i++) {
        struct lw_blob *blob = message_blob(&said[i]);
        if (lw_tls_stream_write(stream, blob->bytes, blob->size, &output) != LW_OK) give_up("TLS");
        lw_blob_unref(blob);
    }
    if (send(s, output.bytes, output.size, MSG_NOSIGNAL) != (ssize_t)output.size) give_up("send");
    lw_tls_stream_destroy(stream);
    lw_tls_output_finish(&output);
}

/* A client that has the package needs only its compressed size, from the WELCOME. */
static uint64_t ask_size(uint16_t port) {
    uint8_t bytes[1024];
    struct lw_framing_header header;
    struct lw_message message;
    int s = dial(port);
    send_message(s, &(struct lw_message){.type = LW_MESSAGE_HELLO, .hello.version = LW_WIRE_VERSION});
    if (recv(s, bytes, LW_FRAMING_HEADER_SIZE, MSG_WAITALL) != LW_FRAMING_HEADER_SIZE ||
        lw_framing_read_header(bytes, sizeof bytes, &header, NULL) != LW_OK ||
        recv(s, bytes, header.body_size, MSG_WAITALL) != (ssize_t)header.body_size ||
        lw_message_decode(header, bytes, &message, NULL) != LW_OK || message.type != LW_MESSAGE_WELCOME)
        give_up("the server's welcome");
    uint64_t size = message.welcome.package_compressed_size;
    lw_message_finish(&message);
    close(s);
    return size;
}

/* ---- the server ---- */

static void *serve(void *context) {
    if (lw_server_run(((struct bench *)context)->server, NULL) != LW_OK) give_up("the server");
    return NULL;
}

static struct lw_server_stats stats_of(const struct bench *b) {
    struct lw_server_stats stats;
    lw_server_get_stats(b->server, &stats);
    return stats;
}

static void await_tiles(const struct bench *b, uint64_t tiles) {
    while (stats_of(b).tiles_sent < tiles) usleep(200);
}

static void start_server(struct bench *b, bool by_tls) {
    static const uint8_t package[1000] = {1};
    struct lw_server_desc desc = {.atlas_map = &b->map, .package = package, .package_size = sizeof package};
    char certificate[200], key[200];
    snprintf(certificate, sizeof certificate, "%s", lw_support_temporary("certificate.pem"));
    snprintf(key, sizeof key, "%s", lw_support_temporary("key.pem"));
    if (by_tls) {
        lw_certificate_make(certificate, key, "DNS:localhost", 1);
        desc.tls = (struct lw_tls_context_desc){.certificate = certificate, .key = key};
    }
    struct lw_error err = {0};
    if (lw_server_create(&desc, &b->server, &err) != LW_OK) exit(lw_log_failure(&err));
    if (pthread_create(&b->serving, NULL, serve, b) != 0) give_up("a thread");
}

static void end_server(struct bench *b) {
    lw_server_stop(b->server);
    pthread_join(b->serving, NULL);
    lw_server_destroy(b->server);
}

/* *package_size  as the server announces it; by TLS as it was before */
static struct row run_server(struct bench *b, SSL_CTX *trust, uint64_t *package_size,
                             struct lw_server_stats *out_stats) {
    start_server(b, trust);
    if (!trust) *package_size = ask_size(lw_server_port(b->server));
    const uint64_t before = resident_bytes();
    for (int64_t i = 0; i < b->clients; i++) {
        b->client[i] = dial(lw_server_port(b->server));
        if (trust)
            send_hello_by_tls(b->client[i], trust, *package_size);
        else
            send_hello(b->client[i], *package_size);
        watch(b, b->client[i]);
    }
    const uint64_t per_frame = (uint64_t)b->clients * b->map.tile_count;
    uint64_t frame = 1;
    publish(b, frame); /* by the end of this one all are there, and caches warm */
    await_tiles(b, per_frame);
    struct row row = {.resident = resident_bytes() - before};
    const struct lw_server_stats from = stats_of(b);
    const uint64_t began_ns = lw_clock_ns();
    do {
        publish(b, ++frame);
        await_tiles(b, frame * per_frame);
        row.wall_s = 1e-9 * (double)(lw_clock_ns() - began_ns);
    } while (row.wall_s < b->seconds);
    *out_stats = stats_of(b);
    row.cpu_s = 1e-9 * (double)(out_stats->loop_cpu_ns - from.loop_cpu_ns);
    row.tiles = out_stats->tiles_sent - from.tiles_sent;
    row.bytes = out_stats->bytes_sent - from.bytes_sent;
    end_server(b);
    for (int64_t i = 0; i < b->clients; i++) close(b->client[i]);
    return row;
}

/* ---- those who never read ---- */

/* Reads bytes for a client, by its socket. */
static void read_some(struct bench *b, int timeout_ms, uint64_t *got, void (*call)(void *, int client),
                      void *context) {
    struct epoll_event event[EVENTS];
    const int ready = epoll_wait(b->epoll, event, EVENTS, timeout_ms);
    for (int i = 0; i < ready; i++) {
        const ssize_t size = recv(event[i].data.fd, NULL, DROP_BYTES, MSG_TRUNC | MSG_DONTWAIT);
        if (size <= 0) continue;
        got[event[i].data.fd] += (uint64_t)size;
        if (call) call(context, event[i].data.fd);
    }
}

struct waiting {
    const uint64_t *got;
    uint64_t due, published_ns; /* bytes that a client has when it has all */
    int64_t left;
    struct lw_histogram latency;
    bool counts;
};

static void note_arrival(void *context, int client) {
    struct waiting *w = context;
    if (w->got[client] != w->due) return;
    w->left--;
    if (w->counts) lw_histogram_add(&w->latency, lw_clock_ns() - w->published_ns);
}

/* One round: p50 and p99, ns. */
static void run_never_round(struct bench *b, uint64_t package_size, bool with, uint64_t *frame, uint64_t *got,
                            uint64_t *due, double out_quantile[2]) {
    int *silent = calloc((size_t)b->never, sizeof *silent);
    if (!silent) give_up("memory");
    for (int64_t i = 0; with && i < b->never; i++)
        send_hello(silent[i] = dial(lw_server_port(b->server)), package_size);
    struct waiting w = {.got = got};
    const uint64_t began_ns = lw_clock_ns();
    for (double elapsed_s = 0; elapsed_s < b->seconds;
         elapsed_s = 1e-9 * (double)(lw_clock_ns() - began_ns)) {
        w.counts = elapsed_s > b->seconds / 3; /* sockets that nobody reads are full by then */
        w.left = b->clients;
        w.due = *due += b->snapshot_bytes + b->frame->size;
        w.published_ns = lw_clock_ns();
        publish(b, ++*frame);
        while (w.left) read_some(b, 1000, got, note_arrival, &w);
        usleep(5000);
    }
    out_quantile[0] = (double)lw_histogram_quantile(&w.latency, 0.5);
    out_quantile[1] = (double)lw_histogram_quantile(&w.latency, 0.99);
    for (int64_t i = 0; with && i < b->never; i++) close(silent[i]);
    free(silent);
    usleep(100000);
}

static int by_size(const void *x, const void *y) {
    const double a = *(const double *)x, b = *(const double *)y;
    return (a > b) - (a < b);
}

static void run_never(struct bench *b) {
    static uint64_t got[1 << 16];
    static double quantile[2][2][NEVER_ROUNDS]; /* without and with; p50 and p99 */
    start_server(b, false);
    const uint64_t package_size = ask_size(lw_server_port(b->server));
    uint64_t frame = 1, due = 0;
    publish(b, frame);
    for (int64_t i = 0; i < b->clients; i++) {
        b->client[i] = dial(lw_server_port(b->server));
        if (b->client[i] >= (int)(sizeof got / sizeof *got)) give_up("sockets");
        send_hello(b->client[i], package_size);
        watch(b, b->client[i]);
    }
    const uint64_t end_ns = lw_clock_ns() + 2000000000u; /* all have the first one, and welcomes */
    while (lw_clock_ns() < end_ns) read_some(b, 50, got, NULL, NULL);
    memset(got, 0, sizeof got);
    for (int round = 0; round < 2 * NEVER_ROUNDS; round++) {
        double pair[2];
        run_never_round(b, package_size, round % 2, &frame, got, &due, pair);
        for (int q = 0; q < 2; q++) quantile[round % 2][q][round / 2] = pair[q];
    }
    end_server(b);
    for (int64_t i = 0; i < b->clients; i++) close(b->client[i]);
    printf("%lld clients that read, %u tiles of %lld bytes, %d rounds of %g s each\n\n"
           "| | p50 ms | p99 ms | p99 ms of the quietest quarter |\n|---|---|---|---|\n",
           (long long)b->clients, b->map.tile_count, (long long)b->payload, NEVER_ROUNDS, b->seconds);
    for (int with = 0; with < 2; with++) {
        for (int q = 0; q < 2; q++) qsort(quantile[with][q], NEVER_ROUNDS, sizeof(double), by_size);
        printf("| %lld never read | %.2f | %.2f | %.2f |\n", with ? (long long)b->never : 0,
               1e-6 * quantile[with][0][NEVER_ROUNDS / 2], 1e-6 * quantile[with][1][NEVER_ROUNDS / 2],
               1e-6 * quantile[with][1][NEVER_ROUNDS / 4]);
    }
    printf("\nwith over without: p50 %.2f, p99 %.2f, p99 of the quietest quarter %.2f\n",
           quantile[1][0][NEVER_ROUNDS / 2] / quantile[0][0][NEVER_ROUNDS / 2],
           quantile[1][1][NEVER_ROUNDS / 2] / quantile[0][1][NEVER_ROUNDS / 2],
           quantile[1][1][NEVER_ROUNDS / 4] / quantile[0][1][NEVER_ROUNDS / 4]);
}

/* ---- nothing but the system ---- */

/* A connection's place in the blobs: what it has of the present round. */
struct bare {
    int socket;
    uint32_t next;
    size_t skip; /* bytes of the next blob that are gone */
};

static size_t write_some(struct bench *b, struct bare *c) {
    struct iovec vector[BATCH_BLOBS];
    int count = 0;
    size_t bytes = 0;
    for (uint32_t t = c->next; t < b->map.tile_count && count < BATCH_BLOBS && bytes < BATCH_BYTES; t++) {
        size_t skip = t == c->next ? c->skip : 0;
        vector[count++] = (struct iovec){b->blob[t]->bytes + skip, b->blob[t]->size - skip};
        bytes += b->blob[t]->size - skip;
    }
    ssize_t sent = writev(c->socket, vector, count);
    if (sent < 0 && errno == EAGAIN) return 0;
    if (sent < 0) give_up("writev");
    for (size_t left = (size_t)sent; left;) {
        size_t rest = b->blob[c->next]->size - c->skip, step = left < rest ? left : rest;
        c->skip = step == rest ? 0 : c->skip + step;
        c->next += step == rest;
        left -= step;
    }
    return (size_t)sent;
}

static void run_round(struct bench *b, struct bare *c, int writable, struct row *row) {
    struct epoll_event event[EVENTS];
    int64_t left = b->clients;
    for (int64_t i = 0; i < b->clients; i++) {
        c[i].next = 0;
        struct epoll_event out = {.events = EPOLLOUT, .data.ptr = &c[i]};
        if (epoll_ctl(writable, EPOLL_CTL_MOD, c[i].socket, &out) < 0) give_up("epoll");
    }
    while (left) {
        int ready = epoll_wait(writable, event, EVENTS, -1);
        for (int i = 0; i < ready; i++) {
            struct bare *at = event[i].data.ptr;
            row->bytes += write_some(b, at);
            if (at->next < b->map.tile_count) continue;
            struct epoll_event none = {.events = 0, .data.ptr = at};
            if (epoll_ctl(writable, EPOLL_CTL_MOD, at->socket, &none) < 0) give_up("epoll");
            left--;
        }
    }
    row->tiles += (uint64_t)b->clients * b->map.tile_count;
}

static struct row run_bare(struct bench *b) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof address;
    const int on = 1, low_water = 128 << 10, listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0),
              writable = epoll_create1(EPOLL_CLOEXEC);
    struct bare *c = calloc((size_t)b->clients, sizeof *c);
    if (!c || listener < 0 || writable < 0 ||
        bind(listener, (struct sockaddr *)&address, sizeof address) < 0 || listen(listener, 16) < 0 ||
        getsockname(listener, (struct sockaddr *)&address, &length) < 0)
        give_up("listen");
    for (int64_t i = 0; i < b->clients; i++) {
        b->client[i] = dial(ntohs(address.sin_port));
        watch(b, b->client[i]);
        c[i].socket = accept4(listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
        struct epoll_event none = {.events = 0, .data.ptr = &c[i]};
        if (c[i].socket < 0 || epoll_ctl(writable, EPOLL_CTL_ADD, c[i].socket, &none) < 0) give_up("accept");
        (void)setsockopt(c[i].socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        (void)setsockopt(c[i].socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &low_water, sizeof low_water);
    }
    struct row row = {0};
    run_round(b, c, writable, &row);
    row = (struct row){0};
    const uint64_t cpu_ns = lw_clock_thread_cpu_ns(), began_ns = lw_clock_ns();
    do {
        run_round(b, c, writable, &row);
        row.wall_s = 1e-9 * (double)(lw_clock_ns() - began_ns);
    } while (row.wall_s < b->seconds);
    row.cpu_s = 1e-9 * (double)(lw_clock_thread_cpu_ns() - cpu_ns);
    for (int64_t i = 0; i < b->clients; i++) {
        close(c[i].socket);
        close(b->client[i]);
    }
    close(writable);
    close(listener);
    free(c);
    return row;
}

/* ---- the whole ---- */

static void print_row(const char *name, const struct row *row) {
    printf("| %s | %.0f | %.2f | %.0f | %.2f | %.0f %% |\n", name, 1e-3 * (double)row->tiles / row->wall_s,
           1e-9 * (double)row->bytes / row->wall_s, 1e-3 * (double)row->tiles / row->cpu_s,
           1e-9 * (double)row->bytes / row->cpu_s, 100 * row->cpu_s / row->wall_s);
}

static void run_rows(struct bench *b) {
    struct lw_server_stats stats, unused;
    uint64_t package_size;
    SSL_CTX *trust = b->by_tls ? SSL_CTX_new(TLS_client_method()) : NULL; /* anybody */
    if (pthread_create(&b->dropping, NULL, drop_input, b) != 0) give_up("a thread");
    struct row server = run_server(b, NULL, &package_size, &stats), sealed = {0}, bare = run_bare(b);
    if (trust) sealed = run_server(b, trust, &package_size, &unused);
    SSL_CTX_free(trust);
    b->over = true;
    pthread_join(b->dropping, NULL);
    printf("%lld clients, %u tiles of %lld bytes, %.0f KB a snapshot\n\n", (long long)b->clients,
           b->map.tile_count, (long long)b->payload, 1e-3 * (double)b->snapshot_bytes);
    printf(
        "| | 1000 tiles/s | GB/s | 1000 tiles per CPU s | GB per CPU s | CPU |\n|---|---|---|---|---|---|\n");
    print_row("lightwelld's loop", &server);
    print_row("epoll and writev alone", &bare);
    if (trust) {
        print_row("lightwelld's loop, TLS", &sealed);
        printf("\nCPU time of the loop by TLS over that without, per byte: %.2f\n",
               sealed.cpu_s / (double)sealed.bytes / (server.cpu_s / (double)server.bytes));
    }
    printf("\nCPU time of the loop over that of the system alone, per byte: %.2f\n",
           server.cpu_s / (double)server.bytes / (bare.cpu_s / (double)bare.bytes));
    printf("memory: %.1f MB, %.1f KB a session; loop lag p99 %.1f ms, largest %.1f ms\n",
           1e-6 * (double)server.resident, 1e-3 * (double)server.resident / (double)b->clients,
           1e-6 * (double)stats.loop_lag_p99_ns, 1e-6 * (double)stats.loop_lag_max_ns);
}

static void measure(struct bench *b) {
    make_blobs(b);
    b->client = calloc((size_t)b->clients, sizeof *b->client);
    b->epoll = epoll_create1(EPOLL_CLOEXEC);
    if (!b->client || b->epoll < 0) give_up("clients");
    if (b->never)
        run_never(b);
    else
        run_rows(b);
    for (uint32_t t = 0; t < b->map.tile_count; t++) lw_blob_unref(b->blob[t]);
    free(b->blob);
    lw_blob_unref(b->frame);
    free(b->client);
    close(b->epoll);
    lw_atlas_map_finish(&b->map);
    lw_scene_destroy(b->scene);
}
static enum lw_status run(void *context, const char *none, struct lw_error *err) {
    (void)none, (void)err;
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) == 0) {
        limit.rlim_cur = limit.rlim_max; /* two for each client */
        (void)setrlimit(RLIMIT_NOFILE, &limit);
    }
    measure(context);
    return LW_OK;
}

int main(int argc, char **argv) {
    struct bench b = {.clients = 1000, .payload = 1300, .tiles = 256, .seconds = 6};
    const struct lw_option table[] = {
        BENCH_INT("clients", "sessions (default 1000)", &b.clients, 1, 9000),
        {"payload", "BYTES",
         "of a tile (default 1300, as the lossy codec makes them; the lossless one: 13000)", LW_OPTION_INT,
         &b.payload, 1, LW_MESSAGE_PAYLOAD_MAX, NULL},
        BENCH_INT("tiles", "of level 0; with the coarser ones a third more (default 256)", &b.tiles, 1, 4096),
        BENCH_INT("never",
                  "clients more that never read, in every other round: tell what that costs the others",
                  &b.never, 0, 9000),
        {"tls", NULL, "a row more: by TLS", LW_OPTION_FLAG, &b.by_tls, 0, 0, NULL},
        {"seconds", "S", "of each row or round (default 6: delays are told every 5)", LW_OPTION_REAL,
         &b.seconds, 0.01, 3600, NULL},
    };
    return BENCH_MAIN(argc, argv, table, .name = "bench_fanout",
                      .about = "What it costs to hand snapshots to many sessions.", .operand = "",
                      .context = &b, .runs_once = true);
}
