#include "client/view/window/seeker.h"

#include "client/lib/package_cache.h"
#include "common/base/clock.h"
#include "common/tile/tile_channels.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#define CONNECT_TIMEOUT_MS 3000u

struct lw_seeker {
    char host[256];
    const char *name, *cache_folder;
    uint16_t port;
    struct lw_access access;
    bool draws_direct;
    bool seeking, under_way;
    unsigned attempt; /* since the link last held */
    uint64_t next_ns;
    pthread_t thread;
    _Atomic bool done;        /* the thread's last act */
    struct lw_client *client; /* the thread's until it is done */
};

enum lw_status lw_seeker_connect(const struct lw_seeker *seeker, unsigned timeout_ms,
                                 struct lw_client **out_client, struct lw_error *err) {
    return lw_client_create(&(struct lw_client_desc){.host = seeker->host,
                                                     .port = seeker->port,
                                                     .access = &seeker->access,
                                                     .name = seeker->name,
                                                     .timeout_ms = timeout_ms,
                                                     .cache_folder = seeker->cache_folder,
                                                     .wants_nothing = true,
                                                     .budget_ns = LW_SEEKER_BUDGET_NS,
                                                     .draws_direct = seeker->draws_direct,
                                                     .channel_features = LW_TILE_CHANNELS_DIRECTION,
                                                     .finer = LW_ATLAS_FINER_MAX,
                                                     .materials = true,
                                                     .watch = {.damaged = lw_package_cache_warn,
                                                               .unkept = lw_package_cache_warn_unkept}},
                            out_client, err);
}

static void *attempt(void *argument) {
    struct lw_seeker *seeker = argument;
    struct lw_error err = {0};
    struct lw_client *client = NULL;
    if (lw_seeker_connect(seeker, CONNECT_TIMEOUT_MS, &client, &err) == LW_OK) seeker->client = client;
    atomic_store_explicit(&seeker->done, true, memory_order_release);
    return NULL;
}

enum lw_status lw_seeker_create(const char *host, uint16_t port, const struct lw_access *access,
                                const char *name, const char *cache_folder, bool draws_direct,
                                struct lw_seeker **out_seeker, struct lw_error *err) {
    struct lw_seeker *seeker = calloc(1, sizeof *seeker);
    if (seeker == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the connection");
    snprintf(seeker->host, sizeof seeker->host, "%s", host);
    seeker->port = port;
    seeker->access = *access;
    seeker->name = name;
    seeker->cache_folder = cache_folder;
    seeker->draws_direct = draws_direct;
    lw_seeker_reset(seeker);
    *out_seeker = seeker;
    return LW_OK;
}

void lw_seeker_destroy(struct lw_seeker *seeker) {
    if (seeker == NULL) return;
    if (seeker->under_way) pthread_join(seeker->thread, NULL);
    lw_client_destroy(seeker->client);
    free(seeker);
}

static void wait_for_the_next(struct lw_seeker *seeker, uint32_t retry_after_ms) {
    seeker->next_ns = lw_clock_ns() +
                      lw_client_return_ms(retry_after_ms, seeker->attempt++, (uint32_t)getpid()) * 1000000ull;
}

void lw_seeker_start(struct lw_seeker *seeker, uint32_t retry_after_ms) {
    if (seeker->seeking) return;
    seeker->seeking = true;
    wait_for_the_next(seeker, retry_after_ms);
}

struct lw_client *lw_seeker_take(struct lw_seeker *seeker) {
    if (!seeker->seeking) return NULL;
    if (!seeker->under_way) {
        if (lw_clock_ns() < seeker->next_ns) return NULL;
        atomic_store(&seeker->done, false);
        seeker->under_way = pthread_create(&seeker->thread, NULL, attempt, seeker) == 0;
        if (!seeker->under_way) wait_for_the_next(seeker, 0);
        return NULL;
    }
    if (!atomic_load_explicit(&seeker->done, memory_order_acquire)) return NULL;
    pthread_join(seeker->thread, NULL);
    seeker->under_way = false;
    struct lw_client *client = seeker->client;
    seeker->client = NULL;
    if (client != NULL)
        seeker->seeking = false;
    else
        wait_for_the_next(seeker, 0);
    return client;
}

void lw_seeker_reset(struct lw_seeker *seeker) { seeker->attempt = 0; }
