#include "server/nats/nats_publisher.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/base/log.h"
#include "common/nats/nats_link.h"
#include "common/tile/tile_codec.h"
#include "server/nats/fine_index.h"
#include "server/nats/fine_wishes.h"
#include "server/nats/relay_reports.h"

#include <assert.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MS_NS         1000000ull
#define CONNECT_MS    5000u
#define WHO_MS        1000
#define QUEUE_MAX     4096u
#define KEEP_AT_ONCE  64u   /* tiles; new light goes first */
#define KEEP_WAITING  1024u /* messages for JetStream that have no answer */
#define KEEP_ANSWER_S 10u   /* for an answer of JetStream's */
#define RETRY_MS      10000u
#define IRRADIANCES   ((uint32_t)LW_TILE_CHANNEL_IRRADIANCES)
#define PATIENCE_MS   5000 /* for an answer of JetStream's API */

/* What a relay wants of one irradiance, and of the channels that follow it. */
struct want {
    uint64_t relay, heard_ns;
    uint32_t irradiance, channels;
    bool everything;
    uint32_t *tile;
    size_t tile_count;
    uint64_t *fine; /* names of tiles of finer levels */
    size_t fine_count;
};

struct irradiance {
    struct lw_snapshot *now; /* the last one that has this irradiance; NULL: none yet */
    uint64_t kept_frame;
};

struct channel {
    uint64_t *kept;   /* by tile: the version in JetStream; 0: none. NULL: nothing was kept */
    uint32_t keep_at; /* the next tile to look at; plain_count: all were */
    struct lw_fine_index fine;
};

struct lw_nats_publisher {
    struct lw_nats_wire_address address;
    const struct lw_atlas_map *map;
    uint64_t run;
    struct lw_blob *welcome, **chunk, **finish_chunk;
    uint32_t chunk_count, finish_chunk_count;
    void (*wants)(void *context, const struct lw_nats_publisher_wants *wants);
    void (*reports)(void *context, const struct lw_relay_tree_node *node, uint32_t count);
    void *context;
    struct lw_nats_link *link;
    pthread_t thread;
    bool has_thread;
    _Atomic bool stopping;

    pthread_mutex_t mutex;      /* guards what follows; held for assignments only */
    struct lw_snapshot *latest; /* handed over, not taken yet */
    struct lw_nats_publisher_stats stats;

    /* Answers of JetStream, written by threads of libnats. */
    struct acks {
        _Atomic uint32_t waiting;
        _Atomic bool failed;
        _Atomic int status, code;
    } * acks; /* the link's, once there is one */

    /* The thread's. */
    jsCtx *jetstream;
    natsSubscription *subscription[5];
    uint32_t epoch;
    struct irradiance irradiance[IRRADIANCES];
    struct channel channel[LW_TILE_CHANNELS_MAX];
    uint32_t served; /* channels that the light has: a bit for each */
    struct want want[LW_NATS_PUBLISHER_RELAYS_MAX];
    uint32_t want_count;
    bool wants_changed, warned_relays, stands_down, is_announced, warned_keep;
    uint32_t channels;          /* wanted by relays */
    uint64_t alive_ns, keep_ns; /* when the next is due */
    uint64_t retry_ns;          /* 0: nothing is to be tried again */
    uint64_t asked_ns;          /* when JetStream was last asked to keep something */
    uint8_t *payload;           /* the current message's */
    size_t payload_capacity;
    uint64_t *bits; /* one for each tile of no finer level */
    struct lw_fine_wishes wishes;
    uint64_t fine[LW_NATS_PUBLISHER_FINE_MAX]; /* the names that it gave last */
    struct lw_relay_reports relay_reports;
    struct lw_relay_tree_node tree[LW_RELAY_TREE_MAX];
};

/* ---- channels ---- */

static uint32_t irradiance_of(uint32_t channel) { return lw_tile_channel_at(channel)->follows; }

/* An irradiance, and the served channels that follow it. */
static uint32_t family_of(const struct lw_nats_publisher *p, uint32_t irradiance) {
    uint32_t family = 0;
    LW_TILE_CHANNELS_EACH (c, p->served)
        if (irradiance_of(c) == irradiance) family |= lw_tile_channel_bit(c);
    return family;
}

/* The newest snapshot of a channel's irradiance, if it has the channel; NULL: there are no such tiles now. */
static const struct lw_snapshot *now_of(const struct lw_nats_publisher *p, uint32_t channel) {
    const struct lw_snapshot *now = p->irradiance[irradiance_of(channel)].now;
    return now && lw_snapshot_has(now, channel) ? now : NULL;
}

/* Whether tiles of a channel are still to be looked at for JetStream. */
static bool is_to_keep(const struct lw_nats_publisher *p, uint32_t channel) {
    return now_of(p, channel) && p->channel[channel].keep_at < p->map->plain_count;
}

/* Whether all wanted tiles of an irradiance's channels are there: SETTLED may follow them. */
static bool is_settled(const struct lw_nats_publisher *p, const struct lw_snapshot *snapshot,
                       uint32_t irradiance) {
    const uint32_t wanted = p->channels & family_of(p, irradiance);
    return snapshot->settled && !(wanted & ~snapshot->channels) && !(snapshot->unsettled & wanted);
}

/* ---- payloads ---- */

static bool reserve(struct lw_nats_publisher *p, size_t size) {
    if (size <= p->payload_capacity) return true;
    uint8_t *grown = realloc(p->payload, size);
    if (!grown) return false;
    p->payload = grown;
    p->payload_capacity = size;
    return true;
}

/* The prefix, and messages behind it; NULL: none. 0: there is no memory. */
static size_t fill(struct lw_nats_publisher *p, const struct lw_blob *messages) {
    const size_t size = LW_NATS_WIRE_PREFIX_SIZE + (messages ? messages->size : 0);
    if (!reserve(p, size)) return 0;
    lw_nats_wire_write_prefix(p->payload, (struct lw_nats_wire_prefix){p->epoch, p->run});
    if (messages) memcpy(p->payload + LW_NATS_WIRE_PREFIX_SIZE, messages->bytes, messages->size);
    return size;
}

static void count(struct lw_nats_publisher *p, bool done, size_t size) {
    pthread_mutex_lock(&p->mutex);
    p->stats.messages += done;
    p->stats.bytes += done ? size : 0;
    p->stats.failures += !done;
    pthread_mutex_unlock(&p->mutex);
}

static void publish_to(struct lw_nats_publisher *p, const char *subject, const struct lw_blob *messages) {
    const size_t size = fill(p, messages);
    count(p, size && lw_nats_link_publish(p->link, subject, p->payload, size), size);
}

/* ---- JetStream ---- */

/* The thread may set it to 0 meanwhile. */
static void count_answer(struct acks *acks) {
    uint32_t waiting = acks->waiting;
    while (waiting && !atomic_compare_exchange_weak(&acks->waiting, &waiting, waiting - 1)) {
    }
}

static void on_kept(jsCtx *jetstream, natsMsg *message, jsPubAck *ack, jsPubAckErr *error, void *context) {
    (void)jetstream, (void)ack;
    struct acks *acks = context;
    count_answer(acks);
    if (error && !acks->failed) {
        acks->status = (int)error->Err;
        acks->code = (int)error->ErrCode;
        acks->failed = true;
    }
    natsMsg_Destroy(message);
}

static void stream_name(const struct lw_nats_publisher *p, char dst[LW_NATS_WIRE_SUBJECT_SIZE]) {
    snprintf(dst, LW_NATS_WIRE_SUBJECT_SIZE, "lightwell-%s", p->address.scene);
}

static enum lw_status jetstream_failure(const struct lw_nats_publisher *p, natsStatus status, jsErrCode code,
                                        struct lw_error *err) {
    const char *hint = lw_nats_link_lacks_jetstream(status, code)
                           ? ": start it with --jetstream, or jetstream {} in its configuration"
                           : "";
    return lw_status_fail(err, LW_UNAVAILABLE, "%s: %s%s", p->address.name, lw_nats_link_text(status, code),
                          hint);
}

static enum lw_status make_stream(struct lw_nats_publisher *p, struct lw_error *err) {
    char name[LW_NATS_WIRE_SUBJECT_SIZE], subject[LW_NATS_WIRE_SUBJECT_SIZE];
    const char *subjects[] = {subject};
    jsStreamConfig config;
    jsErrCode code = 0;
    stream_name(p, name);
    lw_nats_wire_subject(subject, p->address.scene, "kept.>");
    jsStreamConfig_Init(&config);
    config.Name = name;
    config.Subjects = subjects;
    config.SubjectsLen = 1;
    config.MaxMsgsPerSubject = 1;
    config.Discard = js_DiscardNew; /* full: it says so, and loses nothing that a newcomer needs */
    config.Storage = js_FileStorage;
    natsStatus status = js_AddStream(NULL, p->jetstream, &config, NULL, &code);
    if (code == JSStreamNameExistErr) { /* it has other settings: an operator's limits stay */
        code = 0;
        status = js_GetStreamInfo(NULL, p->jetstream, name, NULL, &code);
        if (status == NATS_INVALID_ARG) status = NATS_OK; /* no place for what it would say */
    }
    return status == NATS_OK ? LW_OK : jetstream_failure(p, status, code, err);
}

static enum lw_status keep_surely(struct lw_nats_publisher *p, const struct lw_blob *messages,
                                  const char *subject, struct lw_error *err) {
    jsErrCode code = 0;
    const size_t size = fill(p, messages);
    if (!size) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    const natsStatus status = js_Publish(NULL, p->jetstream, subject, p->payload, (int)size, NULL, &code);
    count(p, status == NATS_OK, size);
    return status == NATS_OK ? LW_OK : jetstream_failure(p, status, code, err);
}

static void forget_kept(struct lw_nats_publisher *p) {
    const uint32_t tiles = p->map->plain_count;
    for (uint32_t f = 0; f < IRRADIANCES; f++) p->irradiance[f].kept_frame = 0;
    LW_TILE_CHANNELS_EACH (c, p->served) {
        if (p->channel[c].kept) memset(p->channel[c].kept, 0, tiles * sizeof *p->channel[c].kept);
        p->channel[c].keep_at = tiles;
    }
}

/* All of the scene but its light, the welcome last: who finds that finds all. Light of before goes. */
static enum lw_status announce(struct lw_nats_publisher *p, struct lw_error *err) {
    char name[LW_NATS_WIRE_SUBJECT_SIZE], subject[LW_NATS_WIRE_SUBJECT_SIZE];
    jsErrCode code = 0;
    enum lw_status status = make_stream(p, err);
    if (status != LW_OK) return status;
    stream_name(p, name);
    const natsStatus purged = js_PurgeStream(p->jetstream, name, NULL, &code);
    if (purged != NATS_OK) return jetstream_failure(p, purged, code, err);
    for (uint32_t i = 0; status == LW_OK && i < p->chunk_count; i++) {
        lw_nats_wire_subject(subject, p->address.scene, "kept.package.%u", i);
        status = keep_surely(p, p->chunk[i], subject, err);
    }
    for (uint32_t i = 0; status == LW_OK && i < p->finish_chunk_count; i++) {
        lw_nats_wire_subject(subject, p->address.scene, "kept.finishes.%u", i);
        status = keep_surely(p, p->finish_chunk[i], subject, err);
    }
    lw_nats_wire_subject(subject, p->address.scene, "kept.welcome");
    if (status == LW_OK) status = keep_surely(p, p->welcome, subject, err);
    forget_kept(p);
    p->keep_ns = 0;
    p->is_announced = status == LW_OK;
    return status;
}

/* Asks without waiting for the answer. False: not now. */
static bool keep(struct lw_nats_publisher *p, const struct lw_blob *messages, const char *subject) {
    const size_t size = fill(p, messages);
    if (!size || p->acks->waiting >= KEEP_WAITING) return false;
    p->acks->waiting++;
    p->asked_ns = lw_clock_ns();
    const natsStatus status = js_PublishAsync(p->jetstream, subject, p->payload, (int)size, NULL);
    const bool done = status == NATS_OK;
    if (!done) {
        count_answer(p->acks);
        p->acks->status = (int)status;
        p->acks->code = 0;
        p->acks->failed = true;
    }
    count(p, done, size);
    pthread_mutex_lock(&p->mutex);
    p->stats.kept += done;
    pthread_mutex_unlock(&p->mutex);
    return done;
}

/* Returns whether JetStream takes more. */
static bool keep_tiles(struct lw_nats_publisher *p, uint32_t c) {
    const struct lw_snapshot *now = now_of(p, c);
    struct channel *channel = &p->channel[c];
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    if (!channel->kept) channel->kept = calloc((size_t)p->map->plain_count + 1, sizeof *channel->kept);
    for (uint32_t n = 0; channel->kept && n < KEEP_AT_ONCE && channel->keep_at < p->map->plain_count;
         channel->keep_at++) {
        const uint32_t t = channel->keep_at;
        const struct lw_snapshot_tile *tile = &now->tile[c][t];
        const struct lw_tile_place *place = &p->map->place[t];
        if (!tile->version || tile->version == channel->kept[t]) continue;
        lw_nats_wire_subject(subject, p->address.scene, "kept.%u.%u.%u.%u", c, place->object, place->level,
                             lw_atlas_map_number(p->map, (lw_tile_id){t}));
        if (!keep(p, tile->blob, subject)) return false;
        channel->kept[t] = tile->version;
        n++;
    }
    return true;
}

/* The FRAME goes first: no tile is of a later frame than it says. */
static void keep_irradiance(struct lw_nats_publisher *p, uint32_t f) {
    struct irradiance *irradiance = &p->irradiance[f];
    const uint32_t family = family_of(p, f);
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    bool takes_more = true, is_due = false;
    LW_TILE_CHANNELS_EACH (c, family) is_due |= is_to_keep(p, c);
    if (!is_due) return;
    if (irradiance->kept_frame != irradiance->now->frame) {
        lw_nats_wire_subject(subject, p->address.scene, "kept.%u.frame", f);
        if (!keep(p, irradiance->now->frame_full, subject)) return;
        irradiance->kept_frame = irradiance->now->frame;
    }
    LW_TILE_CHANNELS_EACH (c, family)
        if (takes_more && is_to_keep(p, c)) takes_more = keep_tiles(p, c);
}

static void retry_keeping(struct lw_nats_publisher *p, const char *why) {
    if (!p->warned_keep)
        lw_log(LW_LOG_WARNING, "%s: %s: relays that join find older light there, until it is mended",
               p->address.name, why);
    p->warned_keep = true;
    if (!p->is_announced) p->retry_ns = lw_clock_ns() + RETRY_MS * MS_NS;
    forget_kept(p);
    p->keep_ns = lw_clock_ns() + RETRY_MS * MS_NS;
}

/* All of it has been kept since the last failure. */
static void note_kept(struct lw_nats_publisher *p) {
    if (!p->warned_keep || p->acks->waiting) return;
    LW_TILE_CHANNELS_EACH (c, p->served)
        if (now_of(p, c) && (!p->irradiance[irradiance_of(c)].kept_frame || is_to_keep(p, c))) return;
    lw_log(LW_LOG_INFO, "%s: light is kept there again", p->address.name);
    p->warned_keep = false;
}

static void look_after_kept(struct lw_nats_publisher *p, uint64_t now_ns) {
    struct acks *acks = p->acks;
    if (acks->failed) {
        const int status = acks->status, code = acks->code;
        acks->failed = false;
        const bool was_announced = p->is_announced;
        if (status == NATS_NO_RESPONDERS) p->is_announced = false; /* the stream is gone: it is made again */
        if (was_announced) retry_keeping(p, lw_nats_link_text((natsStatus)status, (jsErrCode)code));
    } else
        note_kept(p);
    if (acks->waiting && now_ns - p->asked_ns > KEEP_ANSWER_S * 1000 * MS_NS) acks->waiting = 0; /* lost */
    if (!p->is_announced) return;
    if (now_ns >= p->keep_ns) {
        for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) p->channel[c].keep_at = 0;
        p->keep_ns = now_ns + LW_NATS_PUBLISHER_KEEP_MS * MS_NS;
    }
    for (uint32_t f = 0; f < IRRADIANCES; f++) keep_irradiance(p, f);
}

/* ---- light ---- */

/* The change since a version that relays have, or the whole tile. had: 0: they have no version. */
static const struct lw_blob *newest_for(const struct lw_snapshot_tile *tile, uint64_t had) {
    return had && tile->delta && tile->base == had ? tile->delta : tile->blob;
}

static void publish_tiles(struct lw_nats_publisher *p, uint32_t c, const struct lw_snapshot *snapshot) {
    const struct lw_snapshot *before = now_of(p, c);
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    for (uint32_t t = 0; t < p->map->plain_count; t++) {
        const struct lw_snapshot_tile *tile = &snapshot->tile[c][t];
        const uint64_t had = before ? before->tile[c][t].version : 0;
        if (tile->version <= had) continue;
        lw_nats_wire_subject(subject, p->address.scene, "live.%u.%u.%u", c, p->map->place[t].object,
                             p->map->place[t].level);
        publish_to(p, subject, newest_for(tile, had));
    }
}

static void publish_fine(struct lw_nats_publisher *p, uint32_t c, const struct lw_snapshot *snapshot) {
    const struct lw_fine_index *fine = &p->channel[c].fine;
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    for (uint32_t i = 0; fine->tile && i < lw_atlas_map_room(p->map); i++) {
        const struct lw_snapshot_tile *tile = &snapshot->tile[c][p->map->plain_count + i];
        if (tile->version <= fine->tile[i].had || fine->tile[i].name == UINT64_MAX) continue;
        lw_nats_wire_subject(subject, p->address.scene, "fine.%u.%u.%u", c, fine->tile[i].object,
                             fine->tile[i].level);
        publish_to(p, subject, newest_for(tile, fine->tile[i].had));
    }
}

/* Where there is no memory relays get tiles of finer levels later. */
static void follow_fine(struct lw_nats_publisher *p, uint32_t f, const struct lw_snapshot *snapshot) {
    const uint32_t family = family_of(p, f) & snapshot->channels;
    LW_TILE_CHANNELS_EACH (c, family)
        if (lw_fine_index_follow(&p->channel[c].fine, c, now_of(p, c), snapshot) != LW_OK)
            lw_log(LW_LOG_WARNING, "%s: out of memory for finer levels: relays get them later",
                   p->address.name);
}

/* What nobody wants is not published; who wants it later asks for what it lacks. */
static void publish_irradiance(struct lw_nats_publisher *p, uint32_t f, struct lw_snapshot *snapshot) {
    struct irradiance *irradiance = &p->irradiance[f];
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    if (!lw_snapshot_has(snapshot, f)) return;
    follow_fine(p, f, snapshot);
    if (p->channels >> f & 1) {
        const uint64_t last = irradiance->now ? irradiance->now->frame : 0;
        lw_nats_wire_subject(subject, p->address.scene, "live.%u.frame", f);
        if (snapshot->frame > last)
            publish_to(p, subject,
                       last && snapshot->frame_delta && snapshot->previous_frame == last
                           ? snapshot->frame_delta
                           : snapshot->frame_full);
        const uint32_t wanted = p->channels & family_of(p, f) & snapshot->channels;
        LW_TILE_CHANNELS_EACH (c, wanted) {
            publish_tiles(p, c, snapshot);
            publish_fine(p, c, snapshot);
        }
        if (is_settled(p, snapshot, f)) publish_to(p, subject, snapshot->settled);
    }
    lw_snapshot_unref(irradiance->now);
    irradiance->now = lw_snapshot_ref(snapshot);
}

static void take_snapshot(struct lw_nats_publisher *p) {
    pthread_mutex_lock(&p->mutex);
    struct lw_snapshot *snapshot = p->latest;
    p->latest = NULL;
    pthread_mutex_unlock(&p->mutex);
    if (!snapshot) return;
    for (uint32_t f = 0; f < IRRADIANCES; f++) publish_irradiance(p, f, snapshot);
    lw_snapshot_unref(snapshot);
}

/* ---- what relays ask ---- */

/* The relay has a tile that is no longer there: it withdraws it. */
static void publish_withdrawal(struct lw_nats_publisher *p, const char *reply, uint32_t c, uint64_t frame,
                               const struct lw_message_held *held) {
    static const uint8_t nothing = 0;
    const struct lw_message message = {.type = LW_MESSAGE_TILE,
                                       .tile = {.object = held->object,
                                                .level = held->level,
                                                .tile = held->tile,
                                                .version = lw_snapshot_version(frame),
                                                .layer = c,
                                                .codec = LW_TILE_CODEC_NONE,
                                                .scale = 1,
                                                .payload = &nothing,
                                                .payload_size = sizeof nothing}};
    struct lw_blob *blob;
    if (!held->version || held->version >= message.tile.version) return;
    if (lw_blob_from_message(&message, &blob) != LW_OK) return; /* it asks again */
    publish_to(p, reply, blob);
    lw_blob_unref(blob);
}

static void answer_held(struct lw_nats_publisher *p, const char *reply, uint32_t c,
                        const struct lw_snapshot *now, const struct lw_message_held *held) {
    const bool is_fine = lw_atlas_finer(held->level);
    uint32_t id = UINT32_MAX;
    if (!is_fine)
        id = lw_atlas_map_find_tile(p->map, held->object, held->level, held->tile).v;
    else {
        const uint64_t name = lw_atlas_map_name_tile(p->map, held->object, held->level, held->tile);
        if (name == UINT64_MAX) return;
        id = lw_fine_index_find(&p->channel[c].fine, name);
        if (id == LW_FINE_INDEX_NONE) publish_withdrawal(p, reply, c, now->frame, held);
    }
    if (id == UINT32_MAX) return;
    const struct lw_snapshot_tile *tile = &now->tile[c][id];
    if (tile->version && tile->version != held->version) publish_to(p, reply, tile->blob);
}

/* The tiles that are listed, and are not as the relay holds them, whole. A relay has subscribed before
 * it asks: later live messages build on the answer. An empty payload ends it. */
static enum lw_status answer_sync(struct lw_nats_publisher *p, struct lw_nats_wire_reader *reader,
                                  const char *reply) {
    const uint8_t *channel_byte = lw_nats_wire_read_bytes(reader, 1);
    if (!channel_byte || *channel_byte >= lw_tile_channels()->count) return LW_PROTOCOL;
    const uint32_t c = *channel_byte, f = irradiance_of(c);
    const struct lw_snapshot *now = now_of(p, c);
    enum lw_status status = LW_OK;
    if (p->irradiance[f].now) publish_to(p, reply, p->irradiance[f].now->frame_full);
    while (status == LW_OK && reader->left) {
        struct lw_message message;
        const uint8_t *raw;
        size_t size;
        status = lw_nats_wire_read(reader, &message, &raw, &size);
        if (status != LW_OK) break;
        if (message.type != LW_MESSAGE_HOLDS) status = LW_PROTOCOL;
        for (size_t i = 0; status == LW_OK && now && i < message.holds.tile_count; i++)
            answer_held(p, reply, c, now, &message.holds.tile[i]);
        lw_message_finish(&message);
    }
    publish_to(p, reply, now && is_settled(p, now, f) ? now->settled : NULL);
    return status;
}

static struct want *find_want(struct lw_nats_publisher *p, uint64_t relay, uint32_t irradiance) {
    for (struct want *w = p->want; w < p->want + p->want_count; w++)
        if (w->relay == relay && w->irradiance == irradiance) return w;
    if (p->want_count == LW_NATS_PUBLISHER_RELAYS_MAX) {
        if (!p->warned_relays)
            lw_log(LW_LOG_WARNING, "%s: more than %u relays: what further ones want is not heard",
                   p->address.name, LW_NATS_PUBLISHER_RELAYS_MAX);
        p->warned_relays = true;
        return NULL;
    }
    p->want[p->want_count] = (struct want){.relay = relay, .irradiance = irradiance};
    p->wants_changed = true;
    return &p->want[p->want_count++];
}

static void free_wanted(struct want *want) {
    free(want->tile);
    free(want->fine);
    want->tile = NULL;
    want->fine = NULL;
    want->tile_count = want->fine_count = 0;
}

/* Tiles that exist, each once: by id, and those of finer levels by name, the first ones of the list. Their
 * names are wanted once each by lw_fine_wishes_take(). */
static void list_tile(const struct lw_nats_publisher *p, const struct lw_message_interest_tile *t,
                      struct want *want) {
    if (lw_atlas_finer(t->level)) {
        const uint64_t name = lw_atlas_map_name_tile(p->map, t->object, t->level, t->tile);
        if (name != UINT64_MAX && want->fine_count < LW_NATS_WIRE_FINE_MAX)
            want->fine[want->fine_count++] = name;
        return;
    }
    const uint32_t id = lw_atlas_map_find_tile(p->map, t->object, t->level, t->tile).v;
    if (id >= p->map->plain_count || p->bits[id / 64] >> id % 64 & 1) return;
    p->bits[id / 64] |= 1ull << id % 64;
    want->tile[want->tile_count++] = id;
}

static enum lw_status list_wanted(const struct lw_nats_publisher *p,
                                  const struct lw_message_interest *interest, struct want *out_want) {
    struct want want = {.everything = interest->everything,
                        .tile = malloc((interest->tile_count + 1) * sizeof *want.tile),
                        .fine = malloc(LW_NATS_WIRE_FINE_MAX * sizeof *want.fine)};
    if (!want.tile || !want.fine) {
        free_wanted(&want);
        return LW_NO_MEMORY;
    }
    memset(p->bits, 0, (p->map->plain_count / 64 + 1) * sizeof *p->bits);
    for (size_t i = 0; i < interest->tile_count; i++) list_tile(p, &interest->tile[i], &want);
    *out_want = want;
    return LW_OK;
}

static bool is_same_want(const struct want *a, const struct want *b) {
    return a->everything == b->everything && a->channels == b->channels && a->tile_count == b->tile_count &&
           a->fine_count == b->fine_count &&
           (!a->tile_count || memcmp(a->tile, b->tile, a->tile_count * sizeof *a->tile) == 0) &&
           (!a->fine_count || memcmp(a->fine, b->fine, a->fine_count * sizeof *a->fine) == 0);
}

static enum lw_status read_want(const struct lw_nats_publisher *p, struct lw_nats_wire_reader *reader,
                                struct want *out_want) {
    const uint8_t *head = lw_nats_wire_read_bytes(reader, 9), *raw;
    const uint32_t irradiance = head ? lw_nats_wire_irradiance(head[8]) : UINT32_MAX;
    struct lw_message message;
    size_t size;
    if (irradiance == UINT32_MAX) return LW_PROTOCOL;
    enum lw_status status = lw_nats_wire_read(reader, &message, &raw, &size);
    if (status != LW_OK || !raw) return status == LW_OK ? LW_PROTOCOL : status;
    status = message.type == LW_MESSAGE_INTEREST && !reader->left
                 ? list_wanted(p, &message.interest, out_want)
                 : LW_PROTOCOL;
    lw_message_finish(&message);
    if (status != LW_OK) return status;
    memcpy(&out_want->relay, head, sizeof out_want->relay); /* a name: any order of bytes does */
    out_want->heard_ns = lw_clock_ns();
    out_want->irradiance = irradiance;
    out_want->channels = head[8];
    return LW_OK;
}

static enum lw_status take_want(struct lw_nats_publisher *p, struct lw_nats_wire_reader *reader) {
    struct want next;
    const enum lw_status status = read_want(p, reader, &next);
    if (status != LW_OK) return status;
    struct want *want = find_want(p, next.relay, next.irradiance);
    if (!want) {
        free_wanted(&next);
        return LW_OK;
    }
    p->wants_changed |= !is_same_want(want, &next);
    free_wanted(want);
    *want = next;
    return LW_OK;
}

static void forget_silent(struct lw_nats_publisher *p, uint64_t now_ns) {
    for (uint32_t i = 0; i < p->want_count;) {
        if (now_ns - p->want[i].heard_ns < LW_NATS_WIRE_SILENCE_MS * MS_NS) {
            i++;
            continue;
        }
        free_wanted(&p->want[i]);
        p->want[i] = p->want[--p->want_count];
        p->wants_changed = true;
        p->warned_relays = false;
    }
}

/* All plain tiles that relays want, each once. tile: room for them; returns how many there are. */
static size_t join_tiles(struct lw_nats_publisher *p, uint32_t *tile) {
    size_t count = 0;
    memset(p->bits, 0, (p->map->plain_count / 64 + 1) * sizeof *p->bits);
    for (const struct want *w = p->want; w < p->want + p->want_count; w++)
        for (size_t k = 0; k < w->tile_count; k++) {
            const uint32_t id = w->tile[k];
            if (p->bits[id / 64] >> id % 64 & 1) continue;
            p->bits[id / 64] |= 1ull << id % 64;
            tile[count++] = id;
        }
    return count;
}

/* The same of finer levels, as many as there are places. */
static size_t join_fine(struct lw_nats_publisher *p) {
    for (const struct want *w = p->want; w < p->want + p->want_count; w++)
        if (lw_fine_wishes_add(&p->wishes, w->fine, w->fine_count) != LW_OK)
            lw_log(LW_LOG_WARNING, "%s: out of memory for finer levels that a relay wants", p->address.name);
    return lw_fine_wishes_take(&p->wishes, p->fine, LW_NATS_PUBLISHER_FINE_MAX);
}

static void tell_wants(struct lw_nats_publisher *p) {
    struct lw_nats_publisher_wants wants = {.fine = p->fine};
    size_t most = 0;
    if (!p->wants_changed) return;
    for (uint32_t i = 0; i < p->want_count; i++) {
        wants.channels |= p->want[i].channels & p->served;
        wants.everything |= p->want[i].everything;
        most += p->want[i].tile_count;
    }
    uint32_t *tile = malloc((most + 1) * sizeof *tile);
    if (!tile) return; /* later */
    wants.tile = tile;
    wants.tile_count = wants.everything ? 0 : join_tiles(p, tile);
    wants.fine_count = wants.everything ? 0 : join_fine(p);
    p->channels = wants.channels;
    p->wants_changed = false;
    pthread_mutex_lock(&p->mutex);
    p->stats.relays = p->want_count;
    pthread_mutex_unlock(&p->mutex);
    if (p->wants) p->wants(p->context, &wants);
    free(tile);
}

/* ---- reports ---- */

static void tell_reports(struct lw_nats_publisher *p) {
    const uint32_t count = lw_relay_reports_list(&p->relay_reports, p->tree);
    if (p->reports) p->reports(p->context, p->tree, count);
}

static enum lw_status take_report(struct lw_nats_publisher *p, struct lw_nats_wire_reader *reader) {
    struct lw_message message;
    const uint8_t *raw;
    size_t size;
    enum lw_status status = lw_nats_wire_read(reader, &message, &raw, &size);
    if (status != LW_OK || !raw) return status == LW_OK ? LW_PROTOCOL : status;
    const struct lw_message_report *report = &message.report;
    status = message.type == LW_MESSAGE_REPORT && !reader->left && !report->request && !report->code
                 ? lw_relay_reports_take(&p->relay_reports, report->data, report->size, lw_clock_ns())
                 : LW_PROTOCOL;
    lw_message_finish(&message);
    if (status == LW_OK) tell_reports(p);
    return status;
}

/* ---- another lightwelld ---- */

/* If two began at once, one goes on. The other has emptied the stream, perhaps, and put its own welcome
 * there: all is announced again once it is silent. Its last word is an `alive`, so that it is heard. */
static void hear_other(struct lw_nats_publisher *p, uint64_t run) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    if (run == p->run || p->stands_down) return;
    if (run > p->run) {
        if (p->is_announced) p->retry_ns = lw_clock_ns() + 2 * LW_NATS_WIRE_ALIVE_MS * MS_NS;
        p->is_announced = false;
        return;
    }
    lw_log(LW_LOG_ERROR,
           "%s: another lightwelld publishes there: this one does no longer; give it another name",
           p->address.name);
    lw_nats_wire_subject(subject, p->address.scene, "alive");
    publish_to(p, subject, NULL);
    p->stands_down = true;
    for (uint32_t i = 0; i < p->want_count; i++) free_wanted(&p->want[i]);
    p->want_count = 0;
    p->wants_changed = true;
    tell_wants(p);
    lw_relay_reports_finish(&p->relay_reports);
    tell_reports(p);
    pthread_mutex_lock(&p->mutex);
    p->stats.is_stood_down = true;
    pthread_mutex_unlock(&p->mutex);
}

/* Whether a subject is "lightwell.SCENE." and this. */
static bool is_about(const struct lw_nats_publisher *p, const char *subject, const char *what) {
    char expected[LW_NATS_WIRE_SUBJECT_SIZE];
    lw_nats_wire_subject(expected, p->address.scene, "%s", what);
    return strcmp(subject, expected) == 0;
}

/* Bytes that are none of ours change nothing. */
static void take_message(struct lw_nats_publisher *p, natsMsg *message) {
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader reader;
    const char *subject = natsMsg_GetSubject(message), *reply = natsMsg_GetReply(message);
    enum lw_status status = lw_nats_wire_read_prefix(
        natsMsg_GetData(message), (size_t)natsMsg_GetDataLength(message), &prefix, &reader);
    if (status == LW_OK && is_about(p, subject, "alive"))
        hear_other(p, prefix.run);
    else if (status == LW_OK && !p->stands_down && is_about(p, subject, "who"))
        publish_to(p, reply ? reply : subject, NULL);
    else if (status == LW_OK && !p->stands_down && prefix.run == p->run) { /* for the current run */
        if (is_about(p, subject, "want")) status = take_want(p, &reader);
        if (is_about(p, subject, "report")) status = take_report(p, &reader);
        if (is_about(p, subject, "sync")) status = reply ? answer_sync(p, &reader, reply) : LW_PROTOCOL;
    }
    pthread_mutex_lock(&p->mutex);
    p->stats.requests++;
    p->stats.refused_messages += status == LW_PROTOCOL;
    pthread_mutex_unlock(&p->mutex);
    natsMsg_Destroy(message);
}

/* ---- the thread ---- */

/* Asks the link: an event may be older than the next cut. */
static void note_connection(struct lw_nats_publisher *p) {
    const bool is_connected = lw_nats_link_is_connected(p->link);
    pthread_mutex_lock(&p->mutex);
    p->stats.is_connected = is_connected;
    pthread_mutex_unlock(&p->mutex);
}

static void come_back(struct lw_nats_publisher *p) {
    struct lw_error err = {0};
    p->epoch++;
    p->acks->waiting = 0;
    p->retry_ns = 0;
    if (p->stands_down) return;
    p->is_announced = false;
    if (announce(p, &err) != LW_OK) retry_keeping(p, err.text);
}

static void take_events(struct lw_nats_publisher *p) {
    natsMsg *message = NULL;
    for (;;) switch (lw_nats_link_take(p->link, &message)) {
        case LW_NATS_LINK_NOTHING:
            return;
        case LW_NATS_LINK_MESSAGE:
            take_message(p, message);
            break;
        case LW_NATS_LINK_GONE:
            lw_log(LW_LOG_WARNING, "%s is gone: its relays get no light; sessions are served on",
                   p->address.name);
            note_connection(p);
            break;
        case LW_NATS_LINK_BACK:
            lw_log(LW_LOG_INFO, "%s is there again", p->address.name);
            note_connection(p);
            come_back(p);
            break;
        case LW_NATS_LINK_DROPPED: /* wants and requests: relays repeat them */
            break;
        }
}

static int time_left(const struct lw_nats_publisher *p, uint64_t now_ns) {
    LW_TILE_CHANNELS_EACH (c, p->served)
        if (p->is_announced && is_to_keep(p, c) && lw_nats_link_is_connected(p->link))
            return p->acks->waiting >= KEEP_WAITING ? 10 : 0;
    return p->alive_ns > now_ns ? (int)((p->alive_ns - now_ns) / MS_NS) + 1 : 0;
}

static void *run(void *context) {
    struct lw_nats_publisher *p = context;
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    lw_nats_wire_subject(subject, p->address.scene, "alive");
    while (!p->stopping) {
        take_events(p);
        const uint64_t now_ns = lw_clock_ns();
        forget_silent(p, now_ns);
        if (lw_relay_reports_forget_silent(&p->relay_reports, now_ns)) tell_reports(p);
        tell_wants(p);
        take_snapshot(p);
        if (!p->stands_down && lw_nats_link_is_connected(p->link)) {
            if (p->retry_ns && now_ns >= p->retry_ns) come_back(p);
            look_after_kept(p, now_ns);
            if (now_ns >= p->alive_ns) {
                publish_to(p, subject, NULL);
                p->alive_ns = now_ns + LW_NATS_WIRE_ALIVE_MS * MS_NS;
            }
        } else
            p->alive_ns = now_ns + LW_NATS_WIRE_ALIVE_MS * MS_NS;
        struct pollfd polled = {.fd = lw_nats_link_descriptor(p->link), .events = POLLIN};
        (void)poll(&polled, 1, time_left(p, lw_clock_ns()));
    }
    nats_ReleaseThreadMemory();
    return NULL;
}

/* ---- create, destroy ---- */

static enum lw_status check_size(const struct lw_nats_publisher_desc *desc, struct lw_error *err) {
    if (desc->map->plain_count > LW_NATS_WIRE_TILES_MAX)
        return lw_status_fail(err, LW_USAGE, "the scene has %u tiles, over %u: fewer with --texels-per-metre",
                              desc->map->plain_count, LW_NATS_WIRE_TILES_MAX);
    if (desc->object_count > LW_NATS_WIRE_OBJECTS_MAX || desc->light_count > LW_NATS_WIRE_OBJECTS_MAX)
        return lw_status_fail(err, LW_USAGE, "the scene has more than %u objects or lights",
                              LW_NATS_WIRE_OBJECTS_MAX);
    return LW_OK;
}

/* One asks, the other answers. */
static enum lw_status look_for_other(struct lw_nats_publisher *p, struct lw_error *err) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    uint8_t prefix[LW_NATS_WIRE_PREFIX_SIZE];
    natsMsg *answer = NULL;
    lw_nats_wire_subject(subject, p->address.scene, "who");
    lw_nats_wire_write_prefix(prefix, (struct lw_nats_wire_prefix){0, p->run});
    const natsStatus status = natsConnection_Request(&answer, lw_nats_link_connection(p->link), subject,
                                                     prefix, sizeof prefix, WHO_MS);
    natsMsg_Destroy(answer);
    if (status != NATS_OK) return LW_OK; /* nobody is there, or nobody who answers */
    return lw_status_fail(err, LW_UNAVAILABLE,
                          "another lightwelld publishes at %s: give another name, nats://HOST:PORT/NAME",
                          p->address.name);
}

static enum lw_status subscribe(struct lw_nats_publisher *p, struct lw_error *err) {
    static const char *const what[] = {"who", "alive", "want", "sync", "report"};
    static_assert(sizeof what / sizeof *what == sizeof p->subscription / sizeof *p->subscription, "one each");
    for (size_t i = 0; i < sizeof what / sizeof *what; i++) {
        char subject[LW_NATS_WIRE_SUBJECT_SIZE];
        lw_nats_wire_subject(subject, p->address.scene, "%s", what[i]);
        const enum lw_status status = lw_nats_link_subscribe(p->link, subject, &p->subscription[i]);
        if (status != LW_OK)
            return lw_status_fail(err, status, "%s: cannot subscribe to %s", p->address.name, subject);
    }
    return LW_OK;
}

static enum lw_status open_jetstream(struct lw_nats_publisher *p, struct lw_error *err) {
    jsOptions options;
    jsOptions_Init(&options);
    options.Wait = PATIENCE_MS;
    options.PublishAsync.AckHandler = on_kept;
    options.PublishAsync.AckHandlerClosure = p->acks;
    const natsStatus status =
        natsConnection_JetStream(&p->jetstream, lw_nats_link_connection(p->link), &options);
    return status == NATS_OK ? LW_OK : jetstream_failure(p, status, 0, err);
}

static struct lw_blob **ref_all(struct lw_blob *const *blob, uint32_t blob_count) {
    struct lw_blob **copy = malloc((blob_count + 1) * sizeof(struct lw_blob *));
    for (uint32_t i = 0; copy && i < blob_count; i++) copy[i] = lw_blob_ref(blob[i]);
    return copy;
}

static enum lw_status make_room(struct lw_nats_publisher *p, const struct lw_nats_publisher_desc *desc) {
    p->welcome = lw_blob_ref(desc->welcome);
    p->chunk = ref_all(desc->chunk, desc->chunk_count);
    p->finish_chunk = ref_all(desc->finish_chunk, desc->finish_chunk_count);
    p->chunk_count = p->chunk ? desc->chunk_count : 0;
    p->finish_chunk_count = p->finish_chunk ? desc->finish_chunk_count : 0;
    p->bits = calloc(p->map->plain_count / 64 + 1, sizeof *p->bits);
    p->acks = calloc(1, sizeof *p->acks);
    return p->chunk && p->finish_chunk && p->bits && p->acks ? LW_OK : LW_NO_MEMORY;
}

enum lw_status lw_nats_publisher_create(const struct lw_nats_publisher_desc *desc,
                                        struct lw_nats_publisher **out_publisher, struct lw_error *err) {
    enum lw_status status = check_size(desc, err);
    if (status != LW_OK) return status;
    LW_INVARIANT(desc->run && desc->chunk_count <= LW_NATS_WIRE_CHUNKS_MAX);
    struct lw_nats_publisher *p = calloc(1, sizeof *p);
    if (!p) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    p->address = *desc->address;
    p->map = desc->map;
    p->run = desc->run;
    p->served = desc->channels;
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) lw_fine_index_init(&p->channel[c].fine, p->map);
    p->wants = desc->wants;
    p->reports = desc->reports;
    p->context = desc->context;
    p->stats.is_connected = true;
    pthread_mutex_init(&p->mutex, NULL); /* glibc's cannot fail */
    status = make_room(p, desc);
    if (status != LW_OK) lw_status_fail(err, status, "out of memory");
    if (status == LW_OK)
        status = lw_nats_link_create(
            &(struct lw_nats_link_desc){.url = p->address.url,
                                        .name = p->address.name,
                                        .tls_host = p->address.tls ? p->address.host : NULL,
                                        .trust = desc->trust,
                                        .client = "lightwelld " LW_VERSION,
                                        .timeout_ms = CONNECT_MS,
                                        .queue_max = QUEUE_MAX},
            &p->link, err);
    if (status == LW_OK) lw_nats_link_own(p->link, p->acks);
    if (status == LW_OK) status = look_for_other(p, err);
    if (status == LW_OK) status = subscribe(p, err);
    if (status == LW_OK) status = open_jetstream(p, err);
    if (status == LW_OK) status = announce(p, err);
    if (status == LW_OK) {
        p->has_thread = pthread_create(&p->thread, NULL, run, p) == 0;
        if (!p->has_thread) status = lw_status_fail(err, LW_OS, "cannot start a thread");
    }
    if (status == LW_OK)
        *out_publisher = p;
    else
        lw_nats_publisher_destroy(p);
    return status;
}

static void unref_all(struct lw_blob **blob, uint32_t blob_count) {
    for (uint32_t i = 0; i < blob_count; i++) lw_blob_unref(blob[i]);
    free(blob);
}

void lw_nats_publisher_destroy(struct lw_nats_publisher *p) {
    if (!p) return;
    p->stopping = true;
    if (p->has_thread) {
        lw_nats_link_wake(p->link);
        pthread_join(p->thread, NULL);
    }
    if (!p->link) free(p->acks);
    lw_nats_link_close(p->link); /* the ends of subscriptions come after the last answer of JetStream */
    jsCtx_Destroy(p->jetstream);
    for (size_t i = 0; i < sizeof p->subscription / sizeof *p->subscription; i++)
        lw_nats_link_unsubscribe(p->link, p->subscription[i]);
    lw_nats_link_destroy(p->link);
    for (uint32_t i = 0; i < p->want_count; i++) free_wanted(&p->want[i]);
    lw_fine_wishes_finish(&p->wishes);
    lw_relay_reports_finish(&p->relay_reports);
    for (uint32_t f = 0; f < IRRADIANCES; f++) lw_snapshot_unref(p->irradiance[f].now);
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        lw_fine_index_finish(&p->channel[c].fine);
        free(p->channel[c].kept);
    }
    lw_snapshot_unref(p->latest);
    lw_blob_unref(p->welcome);
    unref_all(p->chunk, p->chunk_count);
    unref_all(p->finish_chunk, p->finish_chunk_count);
    pthread_mutex_destroy(&p->mutex);
    free(p->payload);
    free(p->bits);
    free(p);
}

void lw_nats_publisher_publish(struct lw_nats_publisher *p, struct lw_snapshot *snapshot) {
    lw_snapshot_ref(snapshot);
    pthread_mutex_lock(&p->mutex);
    struct lw_snapshot *unseen = p->latest;
    p->latest = snapshot;
    pthread_mutex_unlock(&p->mutex);
    lw_snapshot_unref(unseen);
    lw_nats_link_wake(p->link);
}

void lw_nats_publisher_get_stats(const struct lw_nats_publisher *p,
                                 struct lw_nats_publisher_stats *out_stats) {
    pthread_mutex_t *mutex = (pthread_mutex_t *)&p->mutex; /* locking leaves it as it was */
    pthread_mutex_lock(mutex);
    *out_stats = p->stats;
    pthread_mutex_unlock(mutex);
}
