/* bench_soak: clients that stay for hours, and whether their light is the server's. soak.py drives it.
 *   bench_soak HOST:PORT COUNT
 * Holds COUNT sessions that come back whenever they are lost, also to another scene. A line on stdin compares
 * them: a session that comes then gets the server's light afresh, and each tile of the others is held against
 * it. One line of JSON on stdout for each: how many tiles were compared, the largest difference over what the
 * tile's error allows (1: at its bound), how many are over it. Changes must be paused meanwhile. */
#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/options.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define COUNT_MAX  64
#define REST_S     90 /* for light to converge */
#define POLL_MS    5
#define DIFFERENCE 1e-4f /* share of a tile's mean light: rounding of different ways to the same tile */

struct host {
    char name[256];
    uint16_t port;
};

static struct lw_client *connect_client(const struct host *host, const struct lw_client *scene_of) {
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    const struct lw_client_desc desc = {.host = host->name,
                                        .port = host->port,
                                        .name = "bench_soak",
                                        .scene_of = scene_of,
                                        .timeout_ms = 20000};
    if (lw_client_create(&desc, &client, &err)) fprintf(stderr, "bench_soak: %s\n", err.text);
    return client;
}

/* Takes in messages; a lost client comes back, if need be to another scene. */
static void poll_client(struct lw_client *client, uint64_t *losses) {
    struct lw_error err = {0};
    if (!client || !lw_client_poll(client, POLL_MS, &err)) return;
    ++*losses;
    err = (struct lw_error){0};
    usleep(1000 * lw_client_return_ms(lw_client_retry_after_ms(client), 0, (uint32_t)*losses));
    if (lw_client_reconnect(client, &err) && lw_client_found_other_scene(client)) {
        lw_client_forget_scene(client);
        err = (struct lw_error){0};
        if (lw_client_reconnect(client, &err)) fprintf(stderr, "bench_soak: %s\n", err.text);
    }
}

static bool is_at_rest(struct lw_client *client, uint64_t *out_frame) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    const struct lw_atlas_map *map = lw_client_atlas_map(client);
    *out_frame = stats.frame;
    if (!map || !stats.frame || stats.settled_frame != stats.frame) return false;
    for (uint32_t t = 0; t < map->tile_count; t++)
        if (!lw_client_get_tile(client, (lw_tile_id){t}).version) return false;
    return true;
}

struct verdict {
    uint64_t tiles, over;
    double worst; /* a tile's largest difference over the allowed one */
};

/* One tile of two clients: the root of the mean squared difference against the tile's mean light. */
static void compare_tile(const struct lw_client *a, const struct lw_client *b, lw_tile_id id, float noise,
                         struct verdict *out) {
    const struct lw_atlas_map *map = lw_client_atlas_map(a);
    const struct lw_tile_place tile = map->place[id.v];
    const uint32_t left = tile.x * LW_TILE_SIDE, low = tile.y * LW_TILE_SIDE;
    const struct lw_client_level la = lw_client_get_level(a, tile.object, tile.level),
                                 lb = lw_client_get_level(b, tile.object, tile.level);
    double sum = 0, squares = 0;
    size_t count = 0;
    for (uint32_t y = low; y < low + tile.height && y < la.height; y++)
        for (uint32_t x = left; x < left + tile.width && x < la.width; x++)
            for (int c = 0; c < 3; c++) {
                const size_t at = 3 * ((size_t)y * la.width + x) + (size_t)c;
                const double d = (double)la.rgb[at] - (double)lb.rgb[at];
                sum += (double)lb.rgb[at];
                squares += d * d;
                count++;
            }
    if (!count || !(sum > 0)) return;
    const float error = fmaxf(lw_client_get_tile(a, id).error, lw_client_get_tile(b, id).error);
    const double allowed = (double)(DIFFERENCE + 2 * noise * error) * sum / (double)count;
    const double ratio = sqrt(squares / (double)count) / allowed;
    out->tiles++;
    out->over += ratio > 1;
    if (ratio > out->worst) out->worst = ratio;
}

static struct verdict compare(const struct lw_client *a, const struct lw_client *b) {
    struct verdict verdict = {0};
    struct lw_client_stats stats;
    lw_client_get_stats(b, &stats);
    for (uint32_t t = 0; t < lw_client_atlas_map(a)->tile_count; t++)
        compare_tile(a, b, (lw_tile_id){t}, stats.noise_shown, &verdict);
    return verdict;
}

/* Waits until all have the same frame in full, for some time. */
static bool wait_for_rest(struct lw_client **client, unsigned count, uint64_t *losses) {
    const uint64_t end_ns = lw_clock_ns() + REST_S * 1000000000ull;
    unsigned still = 0; /* rounds in which nothing has changed */
    uint64_t before = 0;
    while (lw_clock_ns() < end_ns) {
        bool rest = true;
        uint64_t first = 0, frame;
        for (unsigned i = 0; i < count; i++) {
            poll_client(client[i], losses);
            if (!client[i]) return false;
            rest = is_at_rest(client[i], &frame) && rest;
            if (!i) first = frame;
            rest = rest && frame == first;
        }
        still = rest && first == before ? still + 1 : 0;
        before = first;
        if (still >= 20) return true;
    }
    return false;
}

static void compare_all(const struct host *host, struct lw_client **client, unsigned count,
                        uint64_t *losses) {
    struct verdict all = {0};
    unsigned compared = 0;
    client[count] = connect_client(host, NULL); /* with nothing of the others */
    const bool rest = client[count] && wait_for_rest(client, count + 1, losses);
    for (unsigned i = 0; rest && i < count; i++) {
        if (memcmp(lw_client_package_hash(client[i]), lw_client_package_hash(client[count]),
                   LW_CLIENT_HASH_SIZE) != 0)
            continue;
        const struct verdict one = compare(client[i], client[count]);
        all.tiles += one.tiles, all.over += one.over, all.worst = fmax(all.worst, one.worst);
        compared++;
    }
    lw_client_destroy(client[count]);
    client[count] = NULL;
    printf("{\"rest\": %s, \"clients\": %u, \"tiles\": %llu, \"over\": %llu, \"worst\": %.4g, \"losses\": "
           "%llu}\n",
           rest ? "true" : "false", compared, (unsigned long long)all.tiles, (unsigned long long)all.over,
           all.worst, (unsigned long long)*losses);
    fflush(stdout);
}

int main(int argc, char **argv) {
    struct host host = {0};
    struct lw_client *client[COUNT_MAX + 1] = {0};
    char *colon = argc == 3 ? strrchr(argv[1], ':') : NULL;
    const unsigned count = argc == 3 ? (unsigned)strtoul(argv[2], NULL, 10) : 0;
    if (!colon || count < 1 || count > COUNT_MAX) {
        fprintf(stderr, "usage: bench_soak HOST:PORT COUNT, 1 to %d\n", COUNT_MAX);
        return 64;
    }
    snprintf(host.name, sizeof host.name, "%.*s", (int)(colon - argv[1]), argv[1]);
    host.port = (uint16_t)strtoul(colon + 1, NULL, 10);
    uint64_t losses = 0;
    for (unsigned i = 0; i < count; i++)
        if (!(client[i] = connect_client(&host, i ? client[0] : NULL))) return 69;
    for (;;) {
        struct pollfd order = {.fd = STDIN_FILENO, .events = POLLIN};
        char line[64];
        if (poll(&order, 1, 0) > 0) {
            if (read(STDIN_FILENO, line, sizeof line) <= 0) break;
            compare_all(&host, client, count, &losses);
        }
        for (unsigned i = 0; i < count; i++) poll_client(client[i], &losses);
    }
    for (unsigned i = count; i-- > 0;) lw_client_destroy(client[i]);
    return 0;
}
