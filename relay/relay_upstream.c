#include "relay/relay_upstream.h"

#include "client/lib/download.h"
#include "client/lib/interest.h"
#include "client/lib/link.h"
#include "client/lib/package_cache.h"
#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/base/log.h"
#include "relay/nats_feed.h"

#include <poll.h>
#include <stdlib.h>
#include <string.h>

#define NAME          "lightwell-relay " LW_VERSION
#define HOLDS_AT_ONCE 1024u /* half of what a message may have: it fits into an outbox */
#define UPDATES_MAX   1024u /* without an answer */
/* A session for light offers these besides. */
#define FEATURES_OF_LIGHT (LW_FEATURE_MATERIALS | LW_FEATURE_FINER | LW_FEATURE_TREE | LW_FEATURE_DIRECTION)

struct lw_relay_upstream {
    struct lw_link link;
    struct lw_nats_feed *feed; /* at the other end of the link; NULL: a server */
    struct lw_message_memory memory;
    uint64_t relay;
    bool control, welcomed, has_asked, owns_light, finish_asked, reads_parts;
    const char *cache_folder;
    bool warned_damage;
    struct lw_relay_welcome welcome;
    uint64_t features, package_compressed_size;
    uint64_t relays[LW_MESSAGE_RELAYS_MAX];
    uint32_t relay_count, retry_after_ms;
    uint32_t channel, channels; /* the irradiance that comes; that, and its directions: a bit for each */
    struct lw_download download, finish_download;
    struct lw_relay_scene scene; /* in the making; its light is the one below */
    struct lw_relay_light *light;
    bool has_finishes;
    struct lw_interest interest;
    bool is_unsent;                                 /* it may have changed since it was sent */
    struct lw_message_interest_tile *interest_tile; /* LW_MESSAGE_INTEREST_MAX; made when first needed */
    uint64_t acked, tiles;
    uint32_t unanswered;
    lw_relay_upstream_answered *answered;
    void *answered_context;
    struct lw_waiting *waiting;
};

static bool is_same_hash(const struct lw_package_hash *a, const struct lw_package_hash *b) {
    return memcmp(a->bytes, b->bytes, sizeof a->bytes) == 0;
}

static bool are_same_bits(const uint8_t *a, size_t a_size, const uint8_t *b, size_t b_size) {
    return a_size == b_size && (!a_size || memcmp(a, b, a_size) == 0);
}

bool lw_relay_welcome_same_scene(const struct lw_relay_welcome *a, const struct lw_relay_welcome *b) {
    return is_same_hash(&a->package_hash, &b->package_hash) && a->package_size == b->package_size &&
           is_same_hash(&a->finish_hash, &b->finish_hash) && a->finish_size == b->finish_size &&
           a->features == b->features && a->has_directions == b->has_directions && a->finer == b->finer &&
           a->bounces == b->bounces && a->target_error == b->target_error &&
           a->noise_shown == b->noise_shown &&
           (!a->has_draws || !b->has_draws ||
            (are_same_bits(a->client_lights, a->client_lights_size, b->client_lights,
                           b->client_lights_size) &&
             are_same_bits(a->client_materials, a->client_materials_size, b->client_materials,
                           b->client_materials_size)));
}

static void free_welcome(struct lw_relay_welcome *welcome) {
    free(welcome->client_lights);
    free(welcome->client_materials);
    welcome->client_lights = welcome->client_materials = NULL;
}

void lw_relay_scene_finish(struct lw_relay_scene *scene) {
    lw_relay_light_destroy(scene->light);
    free_welcome(&scene->welcome);
    free(scene->package);
    free(scene->finishes);
    *scene = (struct lw_relay_scene){0};
}

/* ---- packages ---- */

/* From the folder of packages; NULL: it is not there, or not as it should be, which is reported once. */
static uint8_t *read_cached(struct lw_relay_upstream *up, enum lw_package_cache_kind kind,
                            const struct lw_package_hash *hash, uint64_t size) {
    uint8_t *bytes = NULL;
    if (!up->cache_folder) return NULL;
    const enum lw_package_cache_found found =
        lw_package_cache_read(up->cache_folder, kind, hash, size, &bytes);
    if (found == LW_PACKAGE_CACHE_DAMAGED && !up->warned_damage) {
        up->warned_damage = true;
        lw_package_cache_warn(NULL, up->cache_folder);
    }
    return found == LW_PACKAGE_CACHE_FOUND ? bytes : NULL;
}

static uint8_t *find_part(void *upstream, const struct lw_package_hash *hash, uint64_t size) {
    return read_cached(upstream, LW_PACKAGE_CACHE_PART, hash, size);
}

/* A write that has failed once would fail for each part. */
static void keep_parts(const struct lw_relay_upstream *up, const struct lw_download *d,
                       enum lw_package_cache_kind kind) {
    uint64_t begin = 0;
    struct lw_error err = {0};
    LW_INVARIANT(lw_download_is_complete(d));
    for (size_t i = 0; up->cache_folder && i < d->part_count && !err.status; begin = d->part[i++].end)
        if (!d->part[i].was_held &&
            lw_package_cache_write(up->cache_folder, kind, &d->part[i].hash, d->bytes + begin,
                                   (size_t)(d->part[i].end - begin), &err) != LW_OK)
            lw_package_cache_warn_unkept(NULL, err.text);
}

static void begin_channels(const struct lw_relay_upstream *up) {
    LW_TILE_CHANNELS_EACH (channel, up->channels) lw_relay_light_begin(up->light, channel);
}

static enum lw_status take_package(struct lw_relay_upstream *up, uint8_t *package, size_t size,
                                   struct lw_error *err) {
    up->scene.package = package;
    up->scene.package_size = size;
    enum lw_status status = lw_relay_light_create(package, size, up->welcome.finer, &up->light, err);
    if (status != LW_OK) return status;
    up->owns_light = true;
    begin_channels(up);
    if (up->feed) lw_nats_feed_set_map(up->feed, lw_relay_light_map(up->light));
    return LW_OK;
}

static enum lw_status end_download(struct lw_relay_upstream *up, struct lw_error *err) {
    struct lw_download *d = &up->download;
    keep_parts(up, d, d->part_count > 1 ? LW_PACKAGE_CACHE_PART : LW_PACKAGE_CACHE_PACKAGE);
    uint8_t *package = d->bytes;
    const size_t size = d->size;
    d->bytes = NULL;
    lw_download_finish(d);
    return take_package(up, package, size, err);
}

static void end_finishes(struct lw_relay_upstream *up) {
    struct lw_download *d = &up->finish_download;
    keep_parts(up, d, LW_PACKAGE_CACHE_PART);
    up->scene.finishes = d->bytes;
    up->scene.finishes_size = d->size;
    up->has_finishes = true;
    d->bytes = NULL;
    lw_download_finish(d);
}

/* ---- what the server says ---- */

static enum lw_status out_of_order(struct lw_error *err, enum lw_message_type type) {
    return lw_status_fail(err, LW_PROTOCOL, "message %s: out of order", lw_message_name((uint16_t)type));
}

static uint8_t *copy_bits(const uint8_t *bits, size_t size) {
    uint8_t *copy = malloc(size + 1);
    if (copy && size) memcpy(copy, bits, size);
    return copy;
}

static enum lw_status note_welcome(struct lw_relay_upstream *up, const struct lw_message_welcome *w) {
    struct lw_relay_welcome *welcome = &up->welcome;
    *welcome = (struct lw_relay_welcome){.run = w->run,
                                         .package_hash = w->package_hash,
                                         .finish_hash = w->finish.hash,
                                         .package_size = w->package_size,
                                         .finish_size = w->finish.size,
                                         .bounces = w->bounces,
                                         .target_error = w->target_error,
                                         .noise_shown = w->noise_shown,
                                         .features = w->features & LW_FEATURE_DCT,
                                         .finer = w->features & LW_FEATURE_FINER ? w->finer : 0,
                                         .has_draws = w->features & LW_FEATURE_DRAWS,
                                         .has_directions = w->features & LW_FEATURE_DIRECTION};
    if (!welcome->has_draws) return LW_OK;
    welcome->client_lights_size = w->client_lights_size;
    welcome->client_materials_size = w->client_materials_size;
    welcome->client_lights = copy_bits(w->client_lights, w->client_lights_size);
    welcome->client_materials = copy_bits(w->client_materials, w->client_materials_size);
    return welcome->client_lights && welcome->client_materials ? LW_OK : LW_NO_MEMORY;
}

/* The light would come back to us, or through too many. */
static enum lw_status note_relays(struct lw_relay_upstream *up, const struct lw_message_welcome *w,
                                  struct lw_error *err) {
    LW_INVARIANT(w->relay_count <= LW_MESSAGE_RELAYS_MAX);
    for (size_t i = 0; i < w->relay_count; i++) {
        if (w->relays[i] == up->relay)
            return lw_status_fail(err, LW_USAGE, "a loop of relays: its light comes through this one");
        up->relays[i] = w->relays[i];
    }
    up->relay_count = (uint32_t)w->relay_count;
    if (up->relay_count < LW_MESSAGE_RELAYS_MAX) return LW_OK;
    return lw_status_fail(err, LW_USAGE, "its light comes through %u relays already", up->relay_count);
}

static enum lw_status handle_welcome(struct lw_relay_upstream *up, const struct lw_message_welcome *w,
                                     struct lw_error *err) {
    if (up->welcomed) return out_of_order(err, LW_MESSAGE_WELCOME);
    if (w->version != LW_WIRE_VERSION)
        return lw_status_fail(err, LW_PROTOCOL, "it speaks version %u of the protocol, this relay version %u",
                              w->version, LW_WIRE_VERSION);
    up->welcomed = true;
    enum lw_status status = note_relays(up, w, err);
    if (status != LW_OK) return status;
    up->features = w->features;
    up->channel = w->features & LW_FEATURE_DRAWS ? LW_TILE_CHANNEL_SPLIT : LW_TILE_CHANNEL_FULL;
    up->channels = lw_tile_channels_for(w->features, UINT32_MAX);
    up->package_compressed_size = w->package_compressed_size;
    up->welcome.run = w->run;
    if (up->control && !(w->features & LW_FEATURE_CONTROL))
        return lw_status_fail(err, LW_NOT_ALLOWED, "it takes no updates from here");
    if (up->control) return LW_OK;
    const struct lw_message_package package = lw_message_welcome_package(w);
    status = note_welcome(up, w);
    if (status == LW_OK)
        status = lw_download_init(&up->download, "scene package", &package,
                                  up->cache_folder ? find_part : NULL, up);
    if (status == LW_OK && w->finish.size)
        status = lw_download_init(&up->finish_download, "finish package", &w->finish, NULL, NULL);
    up->has_finishes = !w->finish.size;
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "out of memory");
}

static enum lw_status handle_refusal(struct lw_relay_upstream *up, const struct lw_message_refusal *refusal,
                                     struct lw_error *err) {
    const char *text = refusal->text && *refusal->text ? refusal->text : "it did not say why";
    up->retry_after_ms = refusal->retry_after_ms;
    const enum lw_status status = refusal->code == LW_REFUSAL_TOKEN  ? LW_NOT_ALLOWED
                                  : refusal->code == LW_REFUSAL_LOOP ? LW_USAGE
                                  : up->welcomed                     ? LW_CLOSED
                                                                     : LW_UNAVAILABLE;
    return lw_status_fail(err, status, "it %s: %s", up->welcomed ? "ended the session" : "refused us", text);
}

static enum lw_status handle_chunk(struct lw_relay_upstream *up, const struct lw_message_package_chunk *chunk,
                                   struct lw_error *err) {
    if (!up->has_asked || up->light) return out_of_order(err, LW_MESSAGE_PACKAGE_CHUNK);
    enum lw_status status = lw_download_add(&up->download, chunk, err);
    return status == LW_OK && lw_download_is_complete(&up->download) ? end_download(up, err) : status;
}

static enum lw_status handle_finish_chunk(struct lw_relay_upstream *up,
                                          const struct lw_message_package_chunk *chunk,
                                          struct lw_error *err) {
    if (!up->finish_asked || up->has_finishes) return out_of_order(err, LW_MESSAGE_FINISH_CHUNK);
    enum lw_status status = lw_download_add(&up->finish_download, chunk, err);
    if (status == LW_OK && lw_download_is_complete(&up->finish_download)) end_finishes(up);
    return status;
}

static enum lw_status handle_updated(struct lw_relay_upstream *up, const struct lw_message_updated *updated,
                                     struct lw_error *err) {
    if (!up->unanswered) return out_of_order(err, LW_MESSAGE_UPDATED);
    up->unanswered--;
    if (up->answered) up->answered(up->answered_context, updated);
    return LW_OK;
}

static enum lw_status handle_light(struct lw_relay_upstream *up, const struct lw_message *m,
                                   struct lw_error *err) {
    if (!up->light || !up->has_asked) return out_of_order(err, m->type);
    if (up->waiting) lw_waiting_raise(up->waiting, LW_WAITING_READY, 1, 1);
    if (m->type == LW_MESSAGE_FRAME && m->frame.run) up->welcome.run = m->frame.run;
    if (m->type == LW_MESSAGE_TILE) {
        const uint32_t layer = m->tile.layer;
        const bool is_other = layer < LW_TILE_CHANNELS_MAX && up->channels >> layer & 1;
        up->tiles++;
        return lw_relay_light_take_tile(up->light, is_other ? layer : up->channel, &m->tile, err);
    }
    enum lw_status status = LW_OK;
    LW_TILE_CHANNELS_EACH (channel, up->channels)
        if (status == LW_OK)
            status = m->type == LW_MESSAGE_FRAME
                         ? lw_relay_light_take_frame(up->light, channel, &m->frame, err)
                         : lw_relay_light_take_settled(up->light, channel, m->settled.frame, err);
    return status;
}

static void handle_waiting(const struct lw_relay_upstream *up, const struct lw_message_waiting *waiting) {
    if (up->waiting && waiting->stage < LW_WAITING_READY)
        lw_waiting_raise(up->waiting, (enum lw_waiting_stage)waiting->stage,
                         (uint64_t)(100 * (double)waiting->share), 100);
}

static enum lw_status handle_message(struct lw_relay_upstream *up, const struct lw_message *m,
                                     struct lw_error *err) {
    const struct lw_message pong = {.type = LW_MESSAGE_PONG, .pong.token = m->ping.token};
    switch (m->type) {
    case LW_MESSAGE_WELCOME:
        return handle_welcome(up, &m->welcome, err);
    case LW_MESSAGE_REFUSAL:
        return handle_refusal(up, &m->refusal, err);
    case LW_MESSAGE_PACKAGE_CHUNK:
        return handle_chunk(up, &m->package_chunk, err);
    case LW_MESSAGE_FINISH_CHUNK:
        return handle_finish_chunk(up, &m->finish_chunk, err);
    case LW_MESSAGE_FRAME:
    case LW_MESSAGE_TILE:
    case LW_MESSAGE_SETTLED:
        return handle_light(up, m, err);
    case LW_MESSAGE_UPDATED:
        return handle_updated(up, &m->updated, err);
    case LW_MESSAGE_WAITING:
        if (!up->welcomed) return out_of_order(err, m->type);
        handle_waiting(up, &m->waiting);
        return LW_OK;
    case LW_MESSAGE_PING:
        return lw_link_send(&up->link, &pong, err);
    case LW_MESSAGE_PONG:
        return LW_OK;
    default:
        return lw_status_fail(err, LW_PROTOCOL, "message %s: not one that a server sends",
                              lw_message_name((uint16_t)m->type));
    }
}

/* Takes the messages that were read. Before the welcome it stops there. */
static enum lw_status take_read(struct lw_relay_upstream *up, struct lw_error *err) {
    const bool was_welcomed = up->welcomed;
    while (up->welcomed == was_welcomed) {
        struct lw_framing_header header;
        struct lw_message message;
        const uint8_t *body;
        enum lw_status status = lw_link_take(&up->link, &header, &body, err);
        if (status != LW_OK || !body) return status;
        if (!lw_message_name(header.type)) continue; /* from a newer server */
        status = lw_message_decode_with(header, body, &up->memory, &message, err);
        if (status != LW_OK) return status;
        status = handle_message(up, &message, err);
        lw_message_finish(&message);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

/* Reads once and takes all that came. A refusal may be the last message: it counts before the link's end. */
static enum lw_status receive(struct lw_relay_upstream *up, struct lw_error *err) {
    struct lw_error cause = {0}, link_cause = {0};
    size_t size;
    const enum lw_status link_status = lw_link_receive(&up->link, &size, &link_cause);
    enum lw_status status = take_read(up, &cause);
    if (status == LW_OK) status = link_status;
    if (status == LW_OK) return LW_OK;
    return lw_status_fail(err, status, "%s%s%s", cause.status ? up->link.address : "",
                          cause.status ? ": " : "", cause.status ? cause.text : link_cause.text);
}

/* ---- what we say ---- */

/* Waits until the outbox has room: nothing of what begins a session may be dropped. */
static enum lw_status send_surely(struct lw_relay_upstream *up, const struct lw_message *message,
                                  uint64_t deadline_ns, struct lw_error *err) {
    bool fits = false;
    for (;;) {
        enum lw_status status = lw_link_fits(&up->link, message, &fits, err);
        if (status != LW_OK) return status;
        if (fits) return lw_link_send(&up->link, message, err);
        const uint64_t now_ns = lw_clock_ns();
        if (now_ns >= deadline_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "%s takes no data", up->link.address);
        struct pollfd wait = {.fd = up->link.socket, .events = POLLOUT};
        (void)poll(&wait, 1, (int)((deadline_ns - now_ns) / 1000000 + 1));
    }
}

static enum lw_status send_interest(struct lw_relay_upstream *up, struct lw_error *err) {
    const struct lw_interest_list *now = &up->interest.now;
    const struct lw_atlas_map *map = up->light ? lw_relay_light_map(up->light) : NULL;
    const uint64_t now_ns = lw_clock_ns();
    if (up->link.outbox_size) return LW_OK;
    if (!lw_interest_is_due(&up->interest, now_ns)) {
        if (now_ns - up->interest.sent_ns > LW_INTEREST_SHED_NS) up->is_unsent = false; /* it is the same */
        return LW_OK;
    }
    if (!up->interest_tile &&
        !(up->interest_tile = malloc(LW_MESSAGE_INTEREST_MAX * sizeof *up->interest_tile)))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    LW_INVARIANT(now->count <= LW_MESSAGE_INTEREST_MAX && (!now->count || map));
    for (uint32_t i = 0; i < now->count; i++) {
        const struct lw_tile_place *place = &map->place[now->tile[i].v];
        up->interest_tile[i] = (struct lw_message_interest_tile){place->object, place->level,
                                                                 lw_atlas_map_number(map, now->tile[i])};
    }
    const struct lw_message message = {.type = LW_MESSAGE_INTEREST,
                                       .interest = {.everything = now->everything,
                                                    .stand_ins = true,
                                                    .tile = up->interest_tile,
                                                    .tile_count = now->count}};
    enum lw_status status = lw_link_send(&up->link, &message, err);
    LW_TILE_CHANNELS_EACH (channel, up->channels)
        if (status == LW_OK && up->light) lw_relay_light_ask(up->light, channel, now->tile, now->count);
    if (status == LW_OK && lw_interest_tell(&up->interest, now_ns) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    up->is_unsent = false;
    return status;
}

/* Requests the missing parts of a package. download NULL: none is, and the request begins the stream of
 * light. */
static enum lw_status request_package(struct lw_relay_upstream *up, enum lw_message_type type,
                                      const struct lw_download *download, struct lw_error *err) {
    struct lw_message request = {.type = type};
    uint8_t *held = NULL;
    if (!download)
        request.package_request.offset = up->package_compressed_size;
    else if (lw_download_request(download, &request.package_request, &held) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    const enum lw_status status =
        send_surely(up, &request, lw_clock_ns() + LW_LINK_SILENCE_S * 1000000000ull, err);
    free(held);
    return status;
}

enum lw_status lw_relay_upstream_begin(struct lw_relay_upstream *up, struct lw_error *err) {
    LW_INVARIANT(!up->control && !up->has_asked && !up->light);
    const struct lw_relay_welcome *welcome = &up->welcome;
    enum lw_status status = LW_OK;
    uint8_t *package =
        read_cached(up, LW_PACKAGE_CACHE_PACKAGE, &welcome->package_hash, welcome->package_size);
    if (package)
        status = take_package(up, package, (size_t)welcome->package_size, err);
    else if ((status = lw_download_begin(&up->download, err)) == LW_OK &&
             lw_download_is_complete(&up->download))
        status = end_download(up, err);
    if (status == LW_OK) status = send_interest(up, err); /* before tiles can come */
    if (status == LW_OK)
        status = request_package(up, LW_MESSAGE_PACKAGE_REQUEST, up->light ? NULL : &up->download, err);
    up->has_asked = status == LW_OK;
    if (up->light) lw_download_finish(&up->download);
    return status;
}

static enum lw_status send_held(struct lw_relay_upstream *up, struct lw_error *err) {
    const struct lw_atlas_map *map = lw_relay_light_map(up->light);
    const uint64_t deadline_ns = lw_clock_ns() + LW_LINK_SILENCE_S * 1000000000ull;
    struct lw_message_held *held = malloc(HOLDS_AT_ONCE * sizeof *held);
    enum lw_status status = held ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    size_t count = 0;
    for (uint32_t t = 0; status == LW_OK && t < map->plain_count; t++) {
        const uint64_t version = lw_relay_light_version(up->light, up->channel, (lw_tile_id){t});
        const struct lw_tile_place *p = &map->place[t];
        if (version)
            held[count++] = (struct lw_message_held){p->object, p->level,
                                                     lw_atlas_map_number(map, (lw_tile_id){t}), version};
        if (count < HOLDS_AT_ONCE && (!count || t + 1 < map->plain_count)) continue;
        status = send_surely(up, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, count, 0}},
                             deadline_ns, err);
        count = 0;
    }
    free(held);
    return status;
}

enum lw_status lw_relay_upstream_resume(struct lw_relay_upstream *up, struct lw_relay_light *light,
                                        struct lw_error *err) {
    LW_INVARIANT(!up->control && !up->has_asked && !up->light);
    up->light = light;
    up->has_finishes = true;
    begin_channels(up);
    if (up->feed) lw_nats_feed_set_map(up->feed, lw_relay_light_map(light));
    lw_download_finish(&up->download);
    lw_download_finish(&up->finish_download);
    enum lw_status status = send_interest(up, err);
    if (status == LW_OK && (up->features & LW_FEATURE_RESUME)) status = send_held(up, err);
    if (status == LW_OK) status = request_package(up, LW_MESSAGE_PACKAGE_REQUEST, NULL, err);
    up->has_asked = status == LW_OK;
    return status;
}

static enum lw_status ask_for_finishes(struct lw_relay_upstream *up, struct lw_error *err) {
    struct lw_download *d = &up->finish_download;
    if (up->has_finishes || up->finish_asked || !up->light) return LW_OK;
    if (up->cache_folder && d->zstd) { /* parts on disk need not wait for light */
        lw_download_find_held(d, find_part, up);
        enum lw_status status = lw_download_begin(d, err);
        if (status != LW_OK) return status;
        if (lw_download_is_complete(d)) {
            end_finishes(up);
            return LW_OK;
        }
    }
    if (!lw_relay_light_has_first(up->light, up->channel)) return LW_OK;
    up->finish_asked = true;
    return request_package(up, LW_MESSAGE_FINISH_REQUEST, d, err);
}

static enum lw_status acknowledge(struct lw_relay_upstream *up, struct lw_error *err) {
    const uint64_t frame = up->light && up->has_asked ? lw_relay_light_frame(up->light, up->channel) : 0;
    if (frame <= up->acked) return LW_OK;
    up->acked = frame;
    return lw_link_send(&up->link, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = frame}, err);
}

enum lw_status lw_relay_upstream_want(struct lw_relay_upstream *up, bool everything, const uint32_t *tile,
                                      uint32_t count) {
    up->is_unsent = true;
    if (!everything)
        return lw_interest_set(&up->interest, (const lw_tile_id *)tile, count, LW_MESSAGE_INTEREST_MAX);
    lw_interest_set_everything(&up->interest);
    return LW_OK;
}

enum lw_status lw_relay_upstream_update(struct lw_relay_upstream *up, uint64_t request,
                                        const struct lw_scene_change *change, size_t count, bool *out_sent,
                                        struct lw_error *err) {
    const struct lw_message message = {
        .type = LW_MESSAGE_UPDATE, .update = {.request = request, .change = change, .change_count = count}};
    LW_INVARIANT(up->control);
    *out_sent = false;
    if (up->unanswered == UPDATES_MAX) return LW_OK;
    bool fits;
    enum lw_status status = lw_link_fits(&up->link, &message, &fits, err);
    if (status != LW_OK || !fits) return status;
    status = lw_link_send(&up->link, &message, err);
    if (status != LW_OK) return status;
    up->unanswered++;
    *out_sent = true;
    return LW_OK;
}

enum lw_status lw_relay_upstream_report(struct lw_relay_upstream *up, const char *text, size_t size,
                                        struct lw_error *err) {
    const struct lw_message message = {.type = LW_MESSAGE_REPORT,
                                       .report = {.data = (const uint8_t *)text, .size = size}};
    bool fits;
    if (!(up->features & LW_FEATURE_TREE)) return LW_OK;
    enum lw_status status = lw_link_fits(&up->link, &message, &fits, err);
    return status == LW_OK && fits ? lw_link_send(&up->link, &message, err) : status;
}

void lw_relay_upstream_set_answered(struct lw_relay_upstream *up, lw_relay_upstream_answered *answered,
                                    void *context) {
    up->answered = answered;
    up->answered_context = context;
}

void lw_relay_upstream_set_waiting(struct lw_relay_upstream *up, struct lw_waiting *waiting) {
    up->waiting = waiting;
}

/* ---- create, take, destroy ---- */

static enum lw_status shake_hands(struct lw_relay_upstream *up, const struct lw_relay_upstream_desc *desc,
                                  struct lw_error *err) {
    const uint64_t deadline_ns = lw_clock_ns() + desc->timeout_ms * 1000000ull;
    const struct lw_message hello = {
        .type = LW_MESSAGE_HELLO,
        .hello = {.version = LW_WIRE_VERSION,
                  .features = LW_FEATURES_READ | (desc->control ? LW_FEATURE_CONTROL : FEATURES_OF_LIGHT) |
                              (desc->draws ? LW_FEATURE_DRAWS : 0),
                  .name = NAME,
                  .token = desc->token ? desc->token->bytes : NULL,
                  .relay = desc->control ? 0 : desc->relay}};
    enum lw_status status = lw_link_send(&up->link, &hello, err);
    while (status == LW_OK && !up->welcomed) {
        if (lw_clock_ns() >= deadline_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "%s does not answer: is it a lightwelld?",
                                  up->link.address);
        status = lw_link_wait(&up->link, deadline_ns, err);
        if (status == LW_OK) status = receive(up, err);
    }
    return status;
}

static enum lw_status connect_feed(struct lw_relay_upstream *up, const struct lw_relay_upstream_desc *desc,
                                   struct lw_error *err) {
    struct lw_nats_wire_address address;
    int socket;
    enum lw_status status = lw_nats_wire_address(desc->host, &address, err);
    if (status == LW_OK && desc->control)
        status = lw_status_fail(err, LW_NOT_ALLOWED,
                                "NATS carries no changes: --updates names the lightwelld that takes them");
    if (status == LW_OK)
        status = lw_nats_feed_create(&(struct lw_nats_feed_desc){.address = &address,
                                                                 .trust = *desc->nats_trust,
                                                                 .relay = desc->relay,
                                                                 .timeout_ms = desc->timeout_ms,
                                                                 .takes_old = !desc->has_light},
                                     &up->feed, &socket, err);
    if (status != LW_OK) return status;
    return lw_link_connect(&up->link, &(struct lw_link_desc){.host = address.name, .socket = &socket}, err);
}

enum lw_status lw_relay_upstream_create(const struct lw_relay_upstream_desc *desc,
                                        struct lw_relay_upstream **out_upstream, struct lw_error *err) {
    struct lw_relay_upstream *up = calloc(1, sizeof *up);
    if (!up) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    up->relay = desc->relay;
    up->control = desc->control;
    up->cache_folder = desc->cache_folder;
    lw_interest_init(&up->interest);
    up->interest.now.everything = false; /* nothing but stand-ins, until clients want more */
    const struct lw_link_desc link = {.host = desc->host,
                                      .port = desc->port,
                                      .timeout_ms = desc->timeout_ms,
                                      .prefers_local = desc->control && !desc->token,
                                      .tls = desc->trust};
    enum lw_status status = lw_nats_wire_is_address(desc->host) ? connect_feed(up, desc, err)
                                                                : lw_link_connect(&up->link, &link, err);
    if (status != LW_OK) {
        lw_nats_feed_destroy(up->feed);
        lw_interest_finish(&up->interest);
        free(up);
        return status;
    }
    if ((status = shake_hands(up, desc, err)) == LW_OK)
        *out_upstream = up;
    else
        lw_relay_upstream_destroy(up);
    return status;
}

void lw_relay_upstream_destroy(struct lw_relay_upstream *up) {
    if (!up) return;
    lw_nats_feed_destroy(up->feed); /* it uses the light's map */
    LW_TILE_CHANNELS_EACH (channel, up->channels)
        if (up->light) lw_relay_light_end(up->light, channel);
    if (up->owns_light) lw_relay_light_destroy(up->light);
    free(up->scene.package);
    free(up->scene.finishes);
    free_welcome(&up->welcome);
    lw_download_finish(&up->download);
    lw_download_finish(&up->finish_download);
    lw_interest_finish(&up->interest);
    free(up->interest_tile);
    lw_message_memory_finish(&up->memory);
    lw_link_finish(&up->link);
    free(up);
}

void lw_relay_upstream_give(struct lw_relay_upstream *up, struct lw_relay_scene *out_scene) {
    LW_INVARIANT(up->owns_light && up->has_finishes);
    *out_scene = up->scene;
    out_scene->light = up->light;
    out_scene->welcome = up->welcome;
    out_scene->welcome.client_lights = copy_bits(up->welcome.client_lights, up->welcome.client_lights_size);
    out_scene->welcome.client_materials =
        copy_bits(up->welcome.client_materials, up->welcome.client_materials_size);
    up->scene = (struct lw_relay_scene){0};
    up->owns_light = false;
}

bool lw_relay_upstream_is_waiting(const struct lw_relay_upstream *up) { return up->is_unsent; }

int lw_relay_upstream_descriptor(const struct lw_relay_upstream *up, short *out_events) {
    *out_events = (short)(POLLIN | (up->link.outbox_size || up->link.sealed.size ? POLLOUT : 0));
    return up->link.socket;
}

enum lw_status lw_relay_upstream_take(struct lw_relay_upstream *up, struct lw_error *err) {
    enum lw_status status = lw_link_wait(&up->link, 0, err); /* it pings, too */
    if (status == LW_OK) status = receive(up, err);
    if (status == LW_OK && !up->control) status = send_interest(up, err);
    if (status == LW_OK && up->has_asked) status = ask_for_finishes(up, err);
    return status == LW_OK ? acknowledge(up, err) : status;
}

const struct lw_relay_welcome *lw_relay_upstream_welcome(const struct lw_relay_upstream *up) {
    return &up->welcome;
}
uint32_t lw_relay_upstream_channel(const struct lw_relay_upstream *up) { return up->channel; }
bool lw_relay_upstream_is_current(const struct lw_relay_upstream *up) {
    return !up->feed || lw_nats_feed_is_alive(up->feed);
}
const char *lw_relay_upstream_address(const struct lw_relay_upstream *up) { return up->link.address; }
uint64_t lw_relay_upstream_bytes(const struct lw_relay_upstream *up) { return up->link.bytes_received; }
uint64_t lw_relay_upstream_tiles(const struct lw_relay_upstream *up) { return up->tiles; }
struct lw_relay_light *lw_relay_upstream_light(const struct lw_relay_upstream *up) {
    return up->light;
}
bool lw_relay_upstream_has_finishes(const struct lw_relay_upstream *up) { return up->has_finishes; }

const uint64_t *lw_relay_upstream_relays(const struct lw_relay_upstream *up, uint32_t *out_count) {
    *out_count = up->relay_count;
    return up->relays;
}

uint32_t lw_relay_upstream_retry_after_ms(const struct lw_relay_upstream *up) { return up->retry_after_ms; }
