#include "relay/relay.h"

#include "client/lib/client.h"
#include "client/lib/link.h"
#include "common/base/clock.h"
#include "common/base/host_port.h"
#include "common/base/invariant.h"
#include "common/base/log.h"
#include "proto/nats_wire.h"
#include "relay/relay_updates.h"
#include "server/serve/admission/server_limits.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/random.h>
#include <time.h>
#include <unistd.h>

#define TIMEOUT_DEFAULT_MS 5000u
#define MS_NS              1000000ull
#define SOON_MS            100            /* while something waits for its time, such as an INTEREST */
#define REST_MS            1000           /* else: under LW_LINK_PING_S */
#define REPORT_NS          (2000 * MS_NS) /* between two reports to the server above */
#define WAITS_MAX          20u            /* then there are two servers at one address */

struct lw_relay {
    struct lw_relay_address upstream[LW_RELAY_UPSTREAMS_MAX];
    uint32_t upstream_count;
    struct lw_relay_address updates_address; /* host "": updates go to the upstream that is tried */
    struct lw_relay_updates *updates;
    struct lw_access access;
    struct ssl_ctx_st *trust;
    const char *cache_folder;
    unsigned timeout_ms;
    uint64_t number;
    struct lw_waiting waiting;
    int wake; /* eventfd */
    pthread_t thread;
    _Atomic bool stopping;

    pthread_mutex_t mutex; /* guards what follows, but for what only the thread uses; not held in waits */
    pthread_cond_t changed;
    struct lw_server *server;           /* NULL: there is none */
    char name[LW_MESSAGE_NAME_MAX + 1]; /* where it serves */
    bool owes;                          /* the server has had no snapshot yet */
    struct lw_relay_scene scene, next;
    bool has_scene;
    uint64_t above_run;    /* run of the server above that lights `scene` */
    uint64_t run;          /* the name of its light for clients */
    bool owes_run;         /* the server has not heard of that */
    _Atomic bool has_next; /* next is complete: it waits for lw_relay_next_scene() */
    uint64_t above[LW_MESSAGE_RELAYS_MAX];
    uint32_t above_count;
    struct lw_relay_stats stats;
    uint64_t lost_at_ns; /* 0: it is there, or was not yet */

    pthread_mutex_t stats_mutex;       /* guards what follows, for those who may not wait */
    struct lw_relay_stats shown_stats; /* as of the thread's last turn */
    uint64_t shown_lost_at_ns;

    /* The thread's. */
    struct lw_relay_upstream *feed[LW_TILE_CHANNELS_MAX]; /* for `scene` */
    uint64_t feed_run[LW_TILE_CHANNELS_MAX];              /* last run that each session named */
    struct lw_relay_upstream *newcomer;                   /* for another scene, which is coming, or is next */
    uint32_t main_channel;                                /* the channel of the scene's first session */
    uint64_t taken_ns[LW_TILE_CHANNELS_MAX];              /* when a client last took it */
    uint32_t at, tries; /* the upstream that is tried; since the last success */
    unsigned rounds;
    unsigned waits; /* for a session to hear of another run */
    uint64_t retry_ns;
    bool everything; /* what clients want */
    uint32_t *tile;
    uint32_t tile_count;
    uint64_t some_ns; /* when the first tile came that is in no snapshot; 0: none */
    bool warned_memory;
    uint64_t reported_ns, reported_bytes; /* when the last report was made; sent to clients by then */
    struct lw_relay_tree_node below[LW_RELAY_TREE_MAX];
    char report[LW_RELAY_TREE_TEXT_MAX];
};

/* ---- upstream: found, lost ---- */

static const char *name_of(const struct lw_relay *r, char *dst, size_t size) {
    const struct lw_relay_address *a = &r->upstream[r->at];
    struct lw_nats_wire_address nats;
    if (lw_nats_wire_address(a->host, &nats, NULL) == LW_OK) /* no password */
        snprintf(dst, size, "%s", nats.name);
    else if (strncmp(a->host, LW_ACCESS_UNIX, strlen(LW_ACCESS_UNIX)) == 0)
        snprintf(dst, size, "%s", a->host);
    else
        lw_host_port_format(dst, size, a->host, a->port);
    return dst;
}

static bool has_feed(const struct lw_relay *r) {
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        if (r->feed[c]) return true;
    return false;
}

static bool has_feed_of(const struct lw_relay *r, const char *address) {
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        if (r->feed[c] && strcmp(lw_relay_upstream_address(r->feed[c]), address) == 0) return true;
    return false;
}

static uint32_t seed_of(const struct lw_relay *r) { return (uint32_t)(r->number ^ r->number >> 32); }

/* After a failure: the next of them at once, and after the last one a wait. */
static void try_next(struct lw_relay *r) {
    r->stats.failures++;
    r->at = (r->at + 1) % r->upstream_count;
    if (++r->tries % r->upstream_count == 0)
        r->retry_ns = lw_clock_ns() + lw_client_backoff_ms(r->rounds++, seed_of(r)) * MS_NS;
}

static void note_found(struct lw_relay *r) {
    if (r->lost_at_ns) lw_log(LW_LOG_INFO, "%s is there: light goes on", r->stats.address);
    r->lost_at_ns = 0;
    r->stats.is_connected = true;
}

/* A server that has just begun has no light yet: until then clients have that of before. */
static void look_for_light(struct lw_relay *r) {
    for (uint32_t c = 0; (r->lost_at_ns || !r->stats.is_connected) && c < LW_TILE_CHANNELS_MAX; c++)
        if (r->feed[c] && lw_relay_upstream_is_current(r->feed[c]) && lw_relay_light_frame(r->scene.light, c))
            note_found(r);
}

static void note_lost(struct lw_relay *r, uint32_t retry_after_ms) {
    r->tries = 0;
    r->rounds = 0;
    r->retry_ns = lw_clock_ns() + lw_client_return_ms(retry_after_ms, 0, seed_of(r)) * MS_NS;
    if (has_feed(r)) return;
    r->stats.is_connected = false;
    r->owes = r->owes || r->server; /* light stays: of every channel that there is any of */
    if (!r->lost_at_ns) r->lost_at_ns = lw_clock_ns();
}

static void add_received(struct lw_relay_stats *stats, const struct lw_relay_upstream *up) {
    stats->bytes_received += lw_relay_upstream_bytes(up);
    stats->tiles_received += lw_relay_upstream_tiles(up);
}

static void close_upstream(struct lw_relay *r, struct lw_relay_upstream **up) {
    if (*up) add_received(&r->stats, *up);
    lw_relay_upstream_destroy(*up);
    *up = NULL;
}

/* With a bounded log: the same line again and again says nothing. */
static void log_failure(const struct lw_relay *r, const struct lw_error *err) {
    const enum lw_log_level level = r->rounds < 2 ? LW_LOG_WARNING : LW_LOG_DEBUG;
    char name[300];
    if (r->rounds > 2) return;
    lw_log(level, "no light from %s: %s%s", name_of(r, name, sizeof name), err->text,
           r->has_scene ? "; clients keep what they have" : "");
}

static void follow_relays(struct lw_relay *r, const struct lw_relay_upstream *up) {
    uint32_t count;
    const uint64_t *above = lw_relay_upstream_relays(up, &count);
    if (count == r->above_count && !memcmp(above, r->above, count * sizeof *above)) return;
    memcpy(r->above, above, count * sizeof *above);
    r->above_count = count;
    if (r->server) lw_server_set_relays_above(r->server, above, count);
}

/* A session of the light that clients have: goes on with it. */
static enum lw_status resume(struct lw_relay *r, struct lw_relay_upstream *up, struct lw_error *err) {
    const uint32_t channel = lw_relay_upstream_channel(up);
    lw_relay_upstream_set_waiting(up, &r->waiting);
    enum lw_status status = lw_relay_upstream_want(up, r->everything, r->tile, r->tile_count);
    if (status == LW_OK) status = lw_relay_upstream_resume(up, r->scene.light, err);
    if (status != LW_OK) return lw_status_fail(err, status, "%s", lw_status_text(status));
    r->feed[channel] = up;
    r->feed_run[channel] = r->above_run;
    r->stats.is_connected = lw_relay_upstream_is_current(up);
    return LW_OK;
}

/* Relays that hear of the same runs in turn have the same name for all of them: splitmix64's mixer. */
static uint64_t join_runs(uint64_t run, uint64_t next) {
    uint64_t z = run + 0x9e3779b97f4a7c15u * (next | 1);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return z + !z;
}

/* The server hears of the run with its first light. */
static void set_run(struct lw_relay *r, uint64_t run) {
    r->run = run;
    r->owes_run = true;
}

static void announce_run(struct lw_relay *r, uint64_t frame) {
    if (!r->owes_run || frame < lw_relay_light_frame_for_clients(r->scene.light, 1)) return;
    lw_server_set_run(r->server, r->run);
    r->owes_run = false;
}

/* The server above has begun again, with the same scene: sessions of clients go on. False: they cannot. */
static bool begin_run(struct lw_relay *r, const struct lw_relay_upstream *up) {
    const uint64_t above_run = lw_relay_upstream_welcome(up)->run, run = join_runs(r->run, above_run);
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) close_upstream(r, &r->feed[c]);
    if (!lw_relay_light_begin_run(r->scene.light, run)) return false;
    lw_log(
        LW_LOG_INFO,
        "%s lights the same scene in another run: clients go on with it. Changes that they made before are "
        "gone, unless it has --keep-changes",
        lw_relay_upstream_address(up));
    r->above_run = above_run;
    set_run(r, run);
    return true;
}

/* A relay above has gone on with another run. Where we count as it does, so do our clients know it. */
static void follow_runs(struct lw_relay *r) {
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        const uint64_t run = r->feed[c] ? lw_relay_upstream_welcome(r->feed[c])->run : r->feed_run[c];
        if (run == r->feed_run[c]) continue;
        r->feed_run[c] = run;
        if (run == r->above_run) continue; /* another session named it first */
        r->above_run = run;
        if (lw_relay_light_ahead(r->scene.light)) continue;
        lw_relay_light_set_run(r->scene.light, run);
        set_run(r, run);
    }
}

/* A session of other light: clients keep what they have until its scene is there. */
static enum lw_status begin_newcomer(struct lw_relay *r, struct lw_relay_upstream *up, struct lw_error *err) {
    if (r->has_scene)
        lw_log(LW_LOG_WARNING, "%s lights %s now: clients go over to it", lw_relay_upstream_address(up),
               memcmp(&lw_relay_upstream_welcome(up)->package_hash, &r->scene.welcome.package_hash,
                      sizeof(struct lw_package_hash))
                   ? "another scene"
                   : "the scene in another way");
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) close_upstream(r, &r->feed[c]);
    const enum lw_status status = lw_relay_upstream_begin(up, err);
    if (status == LW_OK) r->newcomer = up;
    return status;
}

/* Without the mutex while it connects. draws: which irradiance it is to bring */
static void connect_feed(struct lw_relay *r, bool draws) {
    const uint32_t irradiance = draws ? LW_TILE_CHANNEL_SPLIT : LW_TILE_CHANNEL_FULL;
    struct lw_relay_upstream *up = NULL;
    struct lw_error err = {0};
    const struct lw_relay_upstream_desc desc = {
        .host = r->upstream[r->at].host,
        .port = r->upstream[r->at].port,
        .token = r->access.has_token ? &r->access.token : NULL,
        .trust = r->trust,
        .nats_trust = &r->access.tls,
        .timeout_ms = r->timeout_ms,
        .relay = r->number,
        .has_light = r->has_scene && lw_relay_light_has_first(r->scene.light, irradiance),
        .draws = draws,
        .cache_folder = r->cache_folder};
    pthread_mutex_unlock(&r->mutex);
    enum lw_status status = lw_relay_upstream_create(&desc, &up, &err);
    pthread_mutex_lock(&r->mutex);
    if (status == LW_OK) {
        const struct lw_relay_welcome *welcome = lw_relay_upstream_welcome(up);
        const bool is_scene = r->has_scene && lw_relay_welcome_same_scene(welcome, &r->scene.welcome) &&
                              lw_relay_upstream_channel(up) == irradiance;
        r->stats.connects++;
        snprintf(r->stats.address, sizeof r->stats.address, "%s", lw_relay_upstream_address(up));
        follow_relays(r, up);
        const bool is_run = welcome->run && welcome->run == r->above_run;
        if (is_scene && !is_run && has_feed_of(r, lw_relay_upstream_address(up)) && r->waits++ < WAITS_MAX) {
            /* it goes on with another run: the session that there is is about to hear of it, or to end */
            lw_relay_upstream_destroy(up);
            r->retry_ns = lw_clock_ns() + SOON_MS * MS_NS;
            return;
        }
        const bool goes_on = is_scene && (is_run || begin_run(r, up));
        status = goes_on ? resume(r, up, &err) : begin_newcomer(r, up, &err);
    }
    if (status == LW_OK) {
        r->tries = r->rounds = r->waits = 0;
        r->retry_ns = 0;
        return;
    }
    log_failure(r, &err);
    lw_relay_upstream_destroy(up);
    try_next(r);
}

/* The channels that clients take, and those that they took not long ago. With none, the one that there is:
 * what joins finds light. */
static uint32_t choose_channels(struct lw_relay *r, uint64_t now_ns) {
    const uint32_t taken = r->server ? lw_server_channels_taken(r->server) : 0;
    uint32_t channels = taken;
    for (uint32_t c = 0; c < LW_TILE_CHANNEL_IRRADIANCES; c++) {
        if (taken >> c & 1) r->taken_ns[c] = now_ns;
        if (r->feed[c] && r->taken_ns[c] && now_ns - r->taken_ns[c] < LW_RELAY_CHANNEL_LINGERS_MS * MS_NS)
            channels |= lw_tile_channel_bit(c);
    }
    if (channels) return channels;
    for (uint32_t c = 0; c < LW_TILE_CHANNEL_IRRADIANCES; c++)
        if (r->feed[c]) return lw_tile_channel_bit(c);
    return lw_tile_channel_bit(r->main_channel);
}

static void follow_channels(struct lw_relay *r) {
    const uint64_t now_ns = lw_clock_ns();
    if (r->newcomer || r->has_next) return;
    if (!r->has_scene) {
        if (now_ns >= r->retry_ns) connect_feed(r, true);
        return;
    }
    const uint32_t channels = choose_channels(r, now_ns);
    for (uint32_t c = 0; c < LW_TILE_CHANNEL_IRRADIANCES && !r->newcomer; c++) {
        if (r->feed[c] && !(channels >> c & 1)) close_upstream(r, &r->feed[c]);
        if (!r->feed[c] && channels >> c & 1 && lw_clock_ns() >= r->retry_ns)
            connect_feed(r, c == LW_TILE_CHANNEL_SPLIT);
    }
}

/* ---- interest ---- */

/* The server above is asked for the first tiles of a list. Tiles of finer levels give way: more
 * than the message takes are everything, which has none of them. */
static uint32_t count_asked(const struct lw_atlas_map *map, const struct lw_server_interest *interest) {
    uint32_t plain = interest->tile_count;
    while (plain && interest->tile[plain - 1] >= map->plain_count) plain--;
    const uint32_t room = plain < LW_MESSAGE_INTEREST_MAX ? LW_MESSAGE_INTEREST_MAX - plain : 0,
                   most = room < LW_SESSION_FINE_MAX ? room : LW_SESSION_FINE_MAX,
                   fine = interest->tile_count - plain;
    return plain + (fine < most ? fine : most);
}

/* Ids of tiles of finer levels are free again with a snapshot that knows the newest list: one is due where
 * they run short. */
static bool owes_ids(const struct lw_relay *r) {
    const struct lw_atlas_map *map = lw_relay_light_map(r->scene.light);
    return map->fine && lw_fine_ids_free_count(map->fine) < lw_atlas_map_room(map) / 4;
}

static void follow_interest(struct lw_relay *r) {
    struct lw_server_interest interest;
    if (!r->server || !lw_server_take_interest(r->server, &interest)) return;
    free(interest.levels);
    free(r->tile);
    r->everything = interest.everything;
    r->tile = interest.tile;
    r->tile_count = count_asked(lw_relay_light_map(r->scene.light), &interest);
    r->stats.wants_everything = r->everything || r->tile_count > LW_MESSAGE_INTEREST_MAX;
    r->stats.interest_tiles = r->everything ? 0 : interest.tile_count;
    r->owes |= lw_relay_light_list(r->scene.light, interest.number, interest.tile, interest.tile_count);
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        if (r->feed[c] && lw_relay_upstream_want(r->feed[c], r->everything, r->tile, r->tile_count) != LW_OK)
            lw_log(LW_LOG_WARNING, "out of memory for what clients want: they get what was wanted before");
    r->owes |= owes_ids(r);
}

/* ---- updates: what their thread asks ---- */

static struct lw_relay_address where_updates_go(void *context) {
    struct lw_relay *r = context;
    if (*r->updates_address.host) return r->updates_address;
    pthread_mutex_lock(&r->mutex);
    const struct lw_relay_address address = r->upstream[r->at];
    pthread_mutex_unlock(&r->mutex);
    return address;
}

static bool is_of_run(void *context, uint64_t run, uint64_t *out_ahead) {
    struct lw_relay *r = context;
    pthread_mutex_lock(&r->mutex);
    const bool is = r->has_scene && r->above_run == run;
    *out_ahead = r->has_scene ? lw_relay_light_ahead(r->scene.light) : 0;
    pthread_mutex_unlock(&r->mutex);
    return is;
}

static uint64_t ahead(void *context) {
    uint64_t ahead;
    (void)is_of_run(context, 0, &ahead);
    return ahead;
}

/* ---- light ---- */

static void take_newcomer(struct lw_relay *r) {
    struct lw_error err = {0};
    if (!r->newcomer) return;
    if (lw_relay_upstream_take(r->newcomer, &err) != LW_OK) {
        lw_log(LW_LOG_WARNING, "%s", err.text);
        const uint32_t retry_after_ms = lw_relay_upstream_retry_after_ms(r->newcomer);
        close_upstream(r, &r->newcomer); /* if its scene is complete that waits all the same */
        note_lost(r, retry_after_ms);
        return;
    }
    const struct lw_relay_light *light = lw_relay_upstream_light(r->newcomer);
    if (r->has_next || !light || !lw_relay_upstream_has_finishes(r->newcomer)) return;
    /* a relay with light keeps it until there is other light */
    if (r->has_scene && !lw_relay_light_has_first(light, lw_relay_upstream_channel(r->newcomer))) return;
    lw_relay_upstream_give(r->newcomer, &r->next);
    r->has_next = true;
    pthread_cond_broadcast(&r->changed);
    if (r->server) lw_server_relay(r->server);
}

static void take_feeds(struct lw_relay *r) {
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        struct lw_error err = {0};
        if (!r->feed[c] || lw_relay_upstream_take(r->feed[c], &err) == LW_OK) continue;
        const uint32_t retry_after_ms = lw_relay_upstream_retry_after_ms(r->feed[c]);
        lw_log(LW_LOG_WARNING, "%s; clients keep the light that they have", err.text);
        close_upstream(r, &r->feed[c]);
        note_lost(r, retry_after_ms);
    }
}

static void publish(struct lw_relay *r) {
    struct lw_snapshot *snapshot;
    if (!r->server) return;
    const enum lw_relay_light_news news = lw_relay_light_news(r->scene.light);
    const uint64_t now_ns = lw_clock_ns();
    if (news == LW_RELAY_LIGHT_SOME && !r->some_ns) r->some_ns = now_ns;
    if (!r->owes && (news == LW_RELAY_LIGHT_NOTHING ||
                     (news == LW_RELAY_LIGHT_SOME && now_ns - r->some_ns < LW_RELAY_HOLD_MS * MS_NS)))
        return;
    if (lw_relay_light_snapshot(r->scene.light, &snapshot) != LW_OK) {
        if (!r->warned_memory)
            lw_log(LW_LOG_WARNING, "out of memory for new light: clients keep what they have");
        r->warned_memory = true;
        return;
    }
    r->warned_memory = false;
    r->some_ns = 0;
    if (!snapshot) return;
    r->owes = false;
    r->stats.snapshots++;
    r->stats.frame = snapshot->frame;
    r->stats.has_light = true;
    announce_run(r, snapshot->frame);
    lw_server_publish(r->server, snapshot);
    lw_snapshot_unref(snapshot);
}

/* ---- reports ---- */

/* This relay and those below it, to the server above. */
static void report(struct lw_relay *r) {
    const uint64_t now_ns = lw_clock_ns();
    struct lw_server_stats stats;
    struct lw_error err = {0};
    uint32_t c = 0;
    if (!r->server || now_ns - r->reported_ns < REPORT_NS) return;
    lw_server_get_stats(r->server, &stats);
    const double elapsed_s = 1e-9 * (double)(now_ns - r->reported_ns);
    const uint64_t sent = stats.bytes_sent > r->reported_bytes ? stats.bytes_sent - r->reported_bytes : 0;
    r->below[0] = (struct lw_relay_tree_node){
        .relay = r->number,
        .sessions = stats.sessions_now,
        .light_age_ms = r->lost_at_ns ? (now_ns - r->lost_at_ns) / MS_NS : 0,
        .sent_bytes_hz = r->reported_ns ? (uint64_t)((double)sent / elapsed_s) : 0};
    memcpy(r->below[0].name, r->name, sizeof r->name);
    const uint32_t count = 1 + lw_server_get_relays_below(r->server, r->below + 1, LW_RELAY_TREE_MAX - 1);
    r->reported_ns = now_ns;
    r->reported_bytes = stats.bytes_sent;
    while (c < LW_TILE_CHANNELS_MAX && !r->feed[c]) c++;
    if (c == LW_TILE_CHANNELS_MAX) return;
    const size_t size = lw_relay_tree_write(r->below, count, r->report, sizeof r->report);
    if (lw_relay_upstream_report(r->feed[c], r->report, size, &err) != LW_OK)
        lw_log(LW_LOG_DEBUG, "%s", err.text); /* the session's next turn ends it */
}

/* ---- the thread ---- */

/* How long nothing is due, ms. */
static int time_left(const struct lw_relay *r) {
    const uint64_t now_ns = lw_clock_ns();
    bool soon = !has_feed(r) && !r->newcomer;
    if (r->some_ns) return LW_RELAY_HOLD_MS;
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        soon |= r->feed[c] && lw_relay_upstream_is_waiting(r->feed[c]);
    if (!soon) return REST_MS;
    if (r->retry_ns <= now_ns) return SOON_MS;
    const uint64_t left_ms = (r->retry_ns - now_ns) / MS_NS + 1;
    return left_ms < SOON_MS ? (int)left_ms : SOON_MS;
}

static void add_poll(struct pollfd *polled, nfds_t *count, const struct lw_relay_upstream *up) {
    if (!up) return;
    short events;
    const int descriptor = lw_relay_upstream_descriptor(up, &events);
    polled[(*count)++] = (struct pollfd){.fd = descriptor, .events = events};
}

/* Without the mutex while it waits. */
static void wait_for_any(struct lw_relay *r) {
    struct pollfd polled[2 + LW_TILE_CHANNELS_MAX];
    nfds_t count = 0;
    uint64_t wakes;
    polled[count++] = (struct pollfd){.fd = r->wake, .events = POLLIN};
    add_poll(polled, &count, r->newcomer);
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) add_poll(polled, &count, r->feed[c]);
    const int left_ms = time_left(r);
    pthread_mutex_unlock(&r->mutex);
    (void)poll(polled, count, left_ms);
    if (polled[0].revents & POLLIN) (void)!read(r->wake, &wakes, sizeof wakes);
    pthread_mutex_lock(&r->mutex);
}

static void publish_stats(struct lw_relay *r) {
    struct lw_relay_stats stats = r->stats;
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        if (r->feed[c]) add_received(&stats, r->feed[c]);
    if (r->newcomer) add_received(&stats, r->newcomer);
    stats.cpu_ns = lw_clock_read_ns(CLOCK_THREAD_CPUTIME_ID);
    pthread_mutex_lock(&r->stats_mutex);
    r->shown_stats = stats;
    r->shown_lost_at_ns = r->lost_at_ns;
    pthread_mutex_unlock(&r->stats_mutex);
}

static void *run(void *context) {
    struct lw_relay *r = context;
    pthread_mutex_lock(&r->mutex);
    while (!r->stopping) {
        follow_channels(r);
        take_newcomer(r);
        take_feeds(r);
        follow_runs(r);
        look_for_light(r);
        follow_interest(r);
        publish(r);
        report(r);
        publish_stats(r);
        wait_for_any(r);
    }
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) close_upstream(r, &r->feed[c]);
    close_upstream(r, &r->newcomer);
    pthread_mutex_unlock(&r->mutex);
    return NULL;
}

/* ---- for main() ---- */

static void wake(struct lw_relay *r) {
    const uint64_t one = 1;
    (void)!write(r->wake, &one, sizeof one); /* full: it is awake already */
}

static void free_relay(struct lw_relay *r) {
    lw_relay_scene_finish(&r->scene);
    lw_relay_scene_finish(&r->next);
    lw_tls_trust_unref(r->trust);
    if (r->wake >= 0) close(r->wake);
    free(r->tile);
    free(r);
}

static enum lw_status start(struct lw_relay *r, struct lw_error *err) {
    pthread_condattr_t attributes;
    if (getrandom(&r->number, sizeof r->number, 0) != (ssize_t)sizeof r->number)
        return lw_status_fail(err, LW_OS, "no random number: %s", strerror(errno));
    r->number += !r->number; /* 0 is no relay */
    r->wake = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    if (r->wake < 0) return lw_status_fail(err, LW_OS, "eventfd: %s", strerror(errno));
    pthread_mutex_init(&r->mutex, NULL); /* glibc's initialisers cannot fail */
    pthread_mutex_init(&r->stats_mutex, NULL);
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&r->changed, &attributes);
    pthread_condattr_destroy(&attributes);
    if (pthread_create(&r->thread, NULL, run, r) == 0) return LW_OK;
    pthread_cond_destroy(&r->changed);
    pthread_mutex_destroy(&r->stats_mutex);
    pthread_mutex_destroy(&r->mutex);
    return lw_status_fail(err, LW_OS, "cannot start a thread");
}

enum lw_status lw_relay_create(const struct lw_relay_desc *desc, struct lw_relay **out_relay,
                               struct lw_error *err) {
    LW_INVARIANT(desc->upstream_count - 1 < LW_RELAY_UPSTREAMS_MAX);
    struct lw_relay *r = calloc(1, sizeof *r);
    if (!r) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    memcpy(r->upstream, desc->upstream, desc->upstream_count * sizeof *r->upstream);
    r->upstream_count = desc->upstream_count;
    if (desc->updates) r->updates_address = *desc->updates;
    r->access = *desc->access;
    r->cache_folder = desc->cache_folder;
    r->timeout_ms = desc->timeout_ms ? desc->timeout_ms : TIMEOUT_DEFAULT_MS;
    r->wake = -1;
    r->main_channel = LW_TILE_CHANNEL_FULL;
    enum lw_status status = lw_tls_trust_create(&desc->access->tls, &r->trust, err);
    if (status == LW_OK) status = start(r, err);
    if (status != LW_OK) {
        free_relay(r);
        return status;
    }
    const struct lw_relay_updates_desc updates = {
        .light = {.context = r, .where = where_updates_go, .is_of_run = is_of_run, .ahead = ahead},
        .access = desc->access,
        .trust = r->trust,
        .timeout_ms = r->timeout_ms,
        .relay = r->number};
    if ((status = lw_relay_updates_create(&updates, &r->updates, err)) == LW_OK)
        *out_relay = r;
    else
        lw_relay_destroy(r);
    return status;
}

void lw_relay_destroy(struct lw_relay *r) {
    if (!r) return;
    lw_relay_updates_destroy(r->updates);
    r->updates = NULL;
    r->stopping = true;
    wake(r);
    pthread_join(r->thread, NULL);
    pthread_cond_destroy(&r->changed);
    pthread_mutex_destroy(&r->stats_mutex);
    pthread_mutex_destroy(&r->mutex);
    free_relay(r);
}

uint64_t lw_relay_number(const struct lw_relay *r) { return r->number; }
const struct lw_waiting *lw_relay_waiting(const struct lw_relay *r) { return &r->waiting; }
bool lw_relay_has_next(const struct lw_relay *r) { return r->has_next; }

/* The session that brought it feeds it from now on. */
static void adopt_next(struct lw_relay *r) {
    LW_INVARIANT(!r->server && !has_feed(r)); /* dropped when the newcomer came */
    lw_relay_scene_finish(&r->scene);
    r->scene = r->next;
    r->next = (struct lw_relay_scene){0};
    r->has_scene = true;
    r->has_next = false;
    r->above_run = r->run = r->scene.welcome.run;
    r->owes_run = false;
    r->stats.has_light = false;
    r->waiting = (struct lw_waiting){0};
    r->some_ns = 0;
    free(r->tile);
    r->tile = NULL;
    r->tile_count = 0;
    r->everything = false;
    if (!r->newcomer) return;
    r->main_channel = lw_relay_upstream_channel(r->newcomer);
    r->feed[r->main_channel] = r->newcomer;
    r->feed_run[r->main_channel] = r->above_run;
    lw_relay_upstream_set_waiting(r->newcomer, &r->waiting);
    if (lw_relay_upstream_is_current(r->newcomer))
        note_found(r);
    else if (!r->lost_at_ns)
        r->lost_at_ns = lw_clock_ns();
    r->newcomer = NULL;
}

const struct lw_relay_scene *lw_relay_next_scene(struct lw_relay *r, unsigned timeout_ms) {
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += timeout_ms / 1000;
    until.tv_nsec += (long)(timeout_ms % 1000) * 1000000;
    if (until.tv_nsec >= 1000000000) {
        until.tv_nsec -= 1000000000;
        until.tv_sec++;
    }
    pthread_mutex_lock(&r->mutex);
    int waited = 0;
    while (!r->has_next && waited == 0) waited = pthread_cond_timedwait(&r->changed, &r->mutex, &until);
    const bool has = r->has_next;
    if (has) adopt_next(r);
    pthread_mutex_unlock(&r->mutex);
    return has ? &r->scene : NULL;
}

void lw_relay_serve(struct lw_relay *r, struct lw_server *server, const char *name) {
    pthread_mutex_lock(&r->mutex);
    LW_INVARIANT(!r->server && r->has_scene);
    r->server = server;
    r->reported_ns = r->reported_bytes = 0;
    lw_relay_tree_name(r->name, name);
    r->owes = true;
    lw_server_set_relays_above(server, r->above, r->above_count);
    if (r->has_next) lw_server_relay(server);
    pthread_mutex_unlock(&r->mutex);
    wake(r);
    lw_relay_updates_serve(r->updates, server);
}

void lw_relay_leave(struct lw_relay *r) {
    lw_relay_updates_leave(r->updates);
    pthread_mutex_lock(&r->mutex);
    r->server = NULL;
    pthread_mutex_unlock(&r->mutex);
}

void lw_relay_wake(struct lw_relay *r) {
    wake(r);
    lw_relay_updates_wake(r->updates);
}

uint32_t lw_relay_above(struct lw_relay *r, uint64_t out_above[LW_MESSAGE_RELAYS_MAX]) {
    pthread_mutex_lock(&r->mutex);
    const uint32_t count = r->above_count;
    memcpy(out_above, r->above, count * sizeof *out_above);
    pthread_mutex_unlock(&r->mutex);
    return count;
}

void lw_relay_get_stats(struct lw_relay *r, struct lw_relay_stats *out_stats) {
    struct lw_relay_updates_stats updates;
    lw_relay_updates_get_stats(r->updates, &updates);
    pthread_mutex_lock(&r->stats_mutex);
    *out_stats = r->shown_stats;
    out_stats->updates_passed = updates.passed;
    out_stats->cpu_ns += updates.cpu_ns;
    out_stats->lost_ns = r->shown_lost_at_ns ? lw_clock_ns() - r->shown_lost_at_ns : 0;
    pthread_mutex_unlock(&r->stats_mutex);
}
