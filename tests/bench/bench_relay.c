/* How much later light comes through relays: bench_relay SECONDS PORT PORT...
 * A client of this process at each port of 127.0.0.1, all of which serve the light of one daemon: the first
 * port is the daemon's. Prints, for each other port, how much later than at the first a FRAME and a version
 * of a tile came, in milliseconds. One clock; what the clients themselves take is in all of it. */
#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/log.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CLIENTS_MAX 8
#define FRAMES_MAX  (1u << 20)
#define DELAYS_MAX  (1u << 22)
#define RING        16u /* versions of a tile that are remembered */
#define WARM_NS     3000000000u

struct seen {
    uint64_t version, at_ns;
};

struct viewer {
    struct lw_client *client;
    struct seen *ring;  /* RING for each tile */
    uint64_t *frame_ns; /* by number, of those up to FRAMES_MAX */
    uint64_t frame;
    float *tile_ms, *frame_ms; /* later than at the first */
    size_t tiles, frames;
};

static struct viewer viewer[CLIENTS_MAX];
static int viewers;

static void *must(void *memory) {
    if (!memory) abort();
    return memory;
}

static void on_tile(void *context, lw_tile_id tile) {
    struct viewer *v = context;
    const uint64_t version = lw_client_get_tile(v->client, tile).version;
    if (v->ring) v->ring[(size_t)tile.v * RING + version / 2 % RING] = (struct seen){version, lw_clock_ns()};
}

static void on_frame(struct viewer *v) {
    struct lw_client_stats stats;
    lw_client_get_stats(v->client, &stats);
    if (stats.frame == v->frame) return;
    v->frame = stats.frame;
    if (stats.frame < FRAMES_MAX) v->frame_ns[stats.frame] = lw_clock_ns();
}

static double later_ms(uint64_t at_ns, uint64_t first_ns) {
    return ((double)at_ns - (double)first_ns) * 1e-6;
}

/* What the first has had for a while, and this one too. */
static void compare(struct viewer *v, uint32_t tile_count) {
    const struct viewer *first = &viewer[0];
    for (uint32_t i = 0; i < tile_count * RING; i++) {
        const struct seen *a = &first->ring[i], *b = &v->ring[i];
        if (a->version && a->version == b->version && v->tiles < DELAYS_MAX) {
            v->tile_ms[v->tiles++] = (float)later_ms(b->at_ns, a->at_ns);
            v->ring[i].version = 0; /* counted */
        }
    }
}

static int by_value(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static double quantile(float *value, size_t count, double q) {
    if (!count) return 0;
    qsort(value, count, sizeof *value, by_value);
    return (double)value[(size_t)(q * (double)(count - 1))];
}

static void poll_all(void) {
    struct pollfd polled[CLIENTS_MAX];
    struct lw_error err = {0};
    for (int i = 0; i < viewers; i++)
        polled[i] = (struct pollfd){.fd = lw_client_descriptor(viewer[i].client), .events = POLLIN};
    (void)poll(polled, (nfds_t)viewers, 100);
    for (int i = 0; i < viewers; i++) {
        if (lw_client_poll(viewer[i].client, 0, &err) != LW_OK) exit(lw_log_failure(&err));
        on_frame(&viewer[i]);
    }
}

static void connect_viewer(struct viewer *v, const char *port) {
    struct lw_error err = {0};
    const struct lw_client_desc desc = {.host = "127.0.0.1",
                                        .port = (uint16_t)atoi(port),
                                        .name = "bench_relay",
                                        .watch = {.context = v, .tile = on_tile}};
    v->frame_ns = must(calloc(FRAMES_MAX, sizeof *v->frame_ns));
    v->tile_ms = must(malloc(DELAYS_MAX * sizeof *v->tile_ms));
    v->frame_ms = must(malloc(FRAMES_MAX * sizeof *v->frame_ms));
    if (lw_client_create(&desc, &v->client, &err) != LW_OK) exit(lw_log_failure(&err));
}

int main(int argc, char **argv) {
    lw_log_init("bench_relay", LW_LOG_INFO);
    if (argc < 4 || argc > 2 + CLIENTS_MAX) {
        fprintf(stderr, "bench_relay SECONDS PORT PORT...\n");
        return 64;
    }
    for (viewers = 0; viewers < argc - 2; viewers++) connect_viewer(&viewer[viewers], argv[2 + viewers]);
    const uint64_t warm_ns = lw_clock_ns() + WARM_NS;
    for (bool all = false; !all;) { /* all have light, and what they want is known */
        poll_all();
        all = lw_clock_ns() > warm_ns;
        for (int i = 0; i < viewers; i++) all &= viewer[i].frame > 0;
    }
    const uint32_t tiles = lw_client_atlas_map(viewer[0].client)->tile_count;
    for (int i = 0; i < viewers; i++)
        viewer[i].ring = must(calloc((size_t)tiles * RING, sizeof *viewer[i].ring));
    const uint64_t began_ns = lw_clock_ns(), end_ns = began_ns + (uint64_t)(atof(argv[1]) * 1e9);
    for (uint64_t looked_ns = began_ns; lw_clock_ns() < end_ns;) {
        poll_all();
        if (lw_clock_ns() - looked_ns < 200000000u) continue;
        looked_ns = lw_clock_ns();
        for (int i = 1; i < viewers; i++) compare(&viewer[i], tiles);
    }
    printf("| port | frames | later p50, ms | p99 | tiles | later p50, ms | p90 | p99 |\n"
           "|---|---|---|---|---|---|---|---|\n");
    for (int i = 1; i < viewers; i++) {
        struct viewer *v = &viewer[i];
        for (uint32_t f = 0; f < FRAMES_MAX; f++)
            if (v->frame_ns[f] > began_ns && viewer[0].frame_ns[f] > began_ns)
                v->frame_ms[v->frames++] = (float)later_ms(v->frame_ns[f], viewer[0].frame_ns[f]);
        printf("| %s | %zu | %.2f | %.2f | %zu | %.2f | %.2f | %.2f |\n", argv[2 + i], v->frames,
               quantile(v->frame_ms, v->frames, 0.5), quantile(v->frame_ms, v->frames, 0.99), v->tiles,
               quantile(v->tile_ms, v->tiles, 0.5), quantile(v->tile_ms, v->tiles, 0.9),
               quantile(v->tile_ms, v->tiles, 0.99));
    }
    for (int i = 0; i < viewers; i++) {
        lw_client_destroy(viewer[i].client);
        free(viewer[i].ring);
        free(viewer[i].frame_ns);
        free(viewer[i].tile_ms);
        free(viewer[i].frame_ms);
    }
    return 0;
}
