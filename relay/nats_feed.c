#include "relay/nats_feed.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/nats/nats_link.h"
#include "proto/message_reader.h"
#include "relay/nats_fine.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define MS_NS         1000000ull
#define WHO_MS        1000
#define API_MS        5000  /* for an answer of JetStream's */
#define FIRST_KEPT_MS 1000  /* for the first tile that is kept: perhaps there is none */
#define SYNC_MS       2000u /* for an answer of lightwelld's, then it is asked again */
#define SYNC_AGAIN_MS 50u   /* between two requests */
#define CHECK_MS      30000u
#define SEND_MS       15000 /* for the session to take what it is sent */
#define QUEUE_MAX     16384u
#define INPUT_SIZE    (64u << 10)
#define SYNC_SIZE_MAX (900u << 10) /* bytes of a request: a message of NATS has up to 1 MiB */

struct lw_nats_feed {
    struct lw_nats_wire_address address;
    uint64_t relay, run;
    struct lw_nats_link *link;
    jsCtx *jetstream;
    struct lw_message welcome; /* its lists are in welcome_message */
    natsMsg *welcome_message;
    int socket;
    pthread_t thread;
    _Atomic bool stopping;
    _Atomic(const struct lw_atlas_map *) map; /* NULL: not yet */

    /* The thread's. */
    struct lw_message_reader reader;
    uint8_t input[INPUT_SIZE];
    bool greets, asked; /* HELLO, PACKAGE_REQUEST have come */
    bool has_finer;     /* the session reads finer levels, and there are some */
    bool streams;       /* light is sent */
    uint32_t irradiance;
    uint32_t channel[LW_TILE_CHANNELS_MAX], channel_count; /* the irradiance, and those that follow it */
    _Atomic bool is_alive;                                 /* lightwelld is there */
    uint64_t heard_ns; /* last sign of lightwelld; of the session while lightwelld is gone */
    uint64_t want_ns;  /* when the next `want` is due; 0: now */
    uint8_t *interest; /* the last INTEREST, as it came; NULL: none: everything is wanted */
    size_t interest_size;
    uint32_t epoch;
    bool has_epoch;
    uint64_t frame;           /* the last one that was sent */
    bool lacks_frame;         /* what came since is lost: a whole FRAME has to come first */
    uint64_t *known;          /* by id (id_of()): the version that the session has */
    uint64_t *lacks, *listed; /* bit by id: to be asked for; asked for now */
    natsSubscription *frames, *alive, *answers, *all[LW_TILE_CHANNELS_MAX];
    natsSubscription **level;               /* by the id of the first tile of an object's level */
    uint64_t *wanted;                       /* bit by the first tile of an object's level */
    struct lw_nats_fine *fine, *next_fine;  /* listed tiles of finer levels, and the next list */
    natsSubscription **fine_level;          /* by channel, object and finer level; see fine_level_of() */
    char answer[LW_NATS_WIRE_SUBJECT_SIZE]; /* "SUBJECT." of answers */
    unsigned sync_number;
    bool syncs, lacks_any;
    uint64_t sync_ns, check_ns; /* when it was asked; when all is to be asked for, to be sure */
};

/* ---- ids of tiles ---- */

/* Numbers of a channel's tiles: ids of the map, then places of the tiles of finer levels that are listed. */
static uint32_t tile_room(const struct lw_nats_feed *feed) {
    return feed->map->plain_count + (feed->fine ? LW_NATS_WIRE_FINE_MAX : 0);
}
static uint32_t tile_count(const struct lw_nats_feed *feed) {
    return feed->map->plain_count + (feed->fine ? feed->fine->count : 0);
}

/* Ids: the tiles of the first channel, then those of the next one. */
static uint32_t id_of(const struct lw_nats_feed *feed, uint32_t nth, uint32_t tile) {
    return nth * tile_room(feed) + tile;
}
static uint32_t id_count(const struct lw_nats_feed *feed) { return id_of(feed, feed->channel_count, 0); }
static size_t words_of(const struct lw_nats_feed *feed) { return id_count(feed) / 64 + 1; }

/* Which of the session's channels it is; channel_count: none of them. */
static uint32_t nth_of(const struct lw_nats_feed *feed, uint32_t channel) {
    uint32_t nth = 0;
    while (nth < feed->channel_count && feed->channel[nth] != channel) nth++;
    return nth;
}

static bool is_set(const uint64_t *bits, uint32_t id) { return bits[id / 64] >> id % 64 & 1; }
static void set_bit(uint64_t *bits, uint32_t id) { bits[id / 64] |= 1ull << id % 64; }

static void clear_bit(uint64_t *bits, uint32_t id) { bits[id / 64] &= ~(1ull << id % 64); }

/* The number of a tile that is named as on the wire. UINT32_MAX: no such tile, or a finer one not listed. */
static uint32_t find_tile(const struct lw_nats_feed *feed, uint32_t object, uint32_t level, uint32_t tile) {
    const struct lw_atlas_map *map = feed->map;
    if (!lw_atlas_finer(level)) return lw_atlas_map_find_tile(map, object, level, tile).v;
    const uint64_t name = lw_atlas_map_name_tile(map, object, level, tile);
    if (!feed->fine || name == UINT64_MAX) return UINT32_MAX;
    const uint32_t place = lw_nats_fine_find(feed->fine, name);
    return place == LW_NATS_FINE_NONE ? UINT32_MAX : map->plain_count + place;
}

static uint32_t first_of(const struct lw_atlas_map *map, uint32_t tile) {
    return lw_atlas_map_first(map, map->place[tile].object, map->place[tile].level);
}

static bool is_heard(const struct lw_nats_feed *feed, uint32_t nth, uint32_t tile) {
    return feed->all[nth] || feed->level[id_of(feed, nth, first_of(feed->map, tile))];
}

/* ---- to the session ---- */

static enum lw_status send_bytes(struct lw_nats_feed *feed, const uint8_t *bytes, size_t size) {
    while (size && !feed->stopping) {
        const ssize_t sent = send(feed->socket, bytes, size, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent >= 0) {
            bytes += sent;
            size -= (size_t)sent;
            continue;
        }
        if (errno == EINTR) continue;
        struct pollfd polled = {.fd = feed->socket, .events = POLLOUT};
        if (errno != EAGAIN || poll(&polled, 1, SEND_MS) <= 0) return LW_CLOSED;
    }
    return size ? LW_CLOSED : LW_OK;
}

static enum lw_status send_message(struct lw_nats_feed *feed, const struct lw_message *message) {
    uint8_t *bytes;
    size_t size;
    enum lw_status status = lw_message_encode_alloc(message, &bytes, &size);
    if (status != LW_OK) return status;
    status = send_bytes(feed, bytes, size);
    free(bytes);
    return status;
}

/* Ends the session: it comes again, and finds what there is then. */
static enum lw_status refuse(struct lw_nats_feed *feed, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
static enum lw_status refuse(struct lw_nats_feed *feed, const char *format, ...) {
    char text[LW_MESSAGE_TEXT_MAX + 1];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    const struct lw_message message = {.type = LW_MESSAGE_REFUSAL,
                                       .refusal = {.code = LW_REFUSAL_SHUTDOWN, .text = text}};
    (void)send_message(feed, &message);
    return LW_CLOSED;
}

/* ---- JetStream ---- */

static void stream_name(const struct lw_nats_feed *feed, char dst[LW_NATS_WIRE_SUBJECT_SIZE]) {
    snprintf(dst, LW_NATS_WIRE_SUBJECT_SIZE, "lightwell-%s", feed->address.scene);
}

/* The newest message of a subject. Errors: LW_NO_INPUT: there is none; LW_UNAVAILABLE. */
static enum lw_status get_kept(struct lw_nats_feed *feed, const char *subject, natsMsg **out_message,
                               struct lw_error *err) {
    char stream[LW_NATS_WIRE_SUBJECT_SIZE];
    jsErrCode code = 0;
    stream_name(feed, stream);
    const natsStatus status = js_GetLastMsg(out_message, feed->jetstream, stream, subject, NULL, &code);
    if (status == NATS_OK) return LW_OK;
    if (code == JSNoMessageFoundErr || code == JSStreamNotFoundErr || status == NATS_NOT_FOUND)
        return lw_status_fail(err, LW_NO_INPUT, "no lightwelld publishes at %s", feed->address.name);
    return lw_status_fail(err, LW_UNAVAILABLE, "%s: %s", feed->address.name, lw_nats_link_text(status, code));
}

static enum lw_status read_payload(natsMsg *message, struct lw_nats_wire_prefix *out_prefix,
                                   struct lw_nats_wire_reader *out_reader) {
    const int size = natsMsg_GetDataLength(message);
    return lw_nats_wire_read_prefix(natsMsg_GetData(message), size > 0 ? (size_t)size : 0, out_prefix,
                                    out_reader);
}

static bool is_held(const struct lw_message_package_request *request, size_t part) {
    return part / 8 < request->held_size && request->held[part / 8] >> part % 8 & 1;
}

/* The chunk of a package that begins at an offset. Errors: also LW_PROTOCOL. */
static enum lw_status send_chunk(struct lw_nats_feed *feed, const struct lw_message_package *package,
                                 const struct lw_message_package_request *request, const char *subject,
                                 enum lw_message_type type, uint64_t *at, struct lw_error *err) {
    natsMsg *kept;
    enum lw_status status = get_kept(feed, subject, &kept, err);
    if (status != LW_OK) return status;
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader reader;
    struct lw_message chunk = {0};
    const uint8_t *raw = NULL;
    size_t raw_size;
    status = read_payload(kept, &prefix, &reader);
    if (status == LW_OK) status = lw_nats_wire_read(&reader, &chunk, &raw, &raw_size);
    if (status == LW_OK && (!raw || prefix.run != feed->run || chunk.type != type ||
                            chunk.package_chunk.offset != *at || !chunk.package_chunk.size))
        status = LW_PROTOCOL;
    if (status == LW_OK) {
        size_t part = 0;
        for (uint64_t end = 0; part < package->part_count; part++) {
            end += package->part_compressed_size[part];
            if (end > *at) break;
        }
        const bool is_sent = *at >= request->offset && !is_held(request, part);
        *at += chunk.package_chunk.size;
        if (is_sent) status = send_bytes(feed, raw, raw_size);
    }
    if (raw) lw_message_finish(&chunk);
    natsMsg_Destroy(kept);
    return status;
}

static enum lw_status send_package(struct lw_nats_feed *feed, const struct lw_message_package *package,
                                   const struct lw_message_package_request *request, const char *name,
                                   enum lw_message_type type) {
    struct lw_error err = {0};
    uint64_t at = 0;
    enum lw_status status = LW_OK;
    if (request->offset >= package->compressed_size) return LW_OK;
    for (uint32_t i = 0; status == LW_OK && !feed->stopping && at < package->compressed_size; i++) {
        char subject[LW_NATS_WIRE_SUBJECT_SIZE];
        lw_nats_wire_subject(subject, feed->address.scene, "kept.%s.%u", name, i);
        status = i < LW_NATS_WIRE_CHUNKS_MAX ? send_chunk(feed, package, request, subject, type, &at, &err)
                                             : LW_PROTOCOL;
    }
    if (status == LW_OK || status == LW_CLOSED) return status;
    return refuse(feed, "%s", err.status ? err.text : "a package is not whole there");
}

/* ---- light to the session ---- */

/* Messages of one payload that are the same frame. */
static enum lw_status send_frame(struct lw_nats_feed *feed, uint64_t number, const uint8_t *raw,
                                 size_t size) {
    LW_INVARIANT(number > feed->frame);
    feed->frame = number;
    feed->lacks_frame = false;
    return send_bytes(feed, raw, size);
}

static void lack(struct lw_nats_feed *feed, uint32_t id) {
    set_bit(feed->lacks, id);
    feed->lacks_any = true;
}

static void lack_heard(struct lw_nats_feed *feed) {
    for (uint32_t n = 0; n < feed->channel_count; n++)
        for (uint32_t t = 0; t < feed->map->plain_count; t++)
            if (is_heard(feed, n, t)) lack(feed, id_of(feed, n, t));
    for (uint32_t n = 0; n < feed->channel_count; n++)
        for (uint32_t t = feed->map->plain_count; t < tile_count(feed); t++) lack(feed, id_of(feed, n, t));
    feed->lacks_any = true; /* the FRAME at least */
}

static void lack_all(struct lw_nats_feed *feed) {
    feed->lacks_frame = true;
    lack_heard(feed);
}

/* A tile whole, or one that builds on what the session has; else it is asked for. */
static enum lw_status send_tile(struct lw_nats_feed *feed, const struct lw_message_tile *t,
                                const uint8_t *raw, size_t size) {
    const uint32_t nth = nth_of(feed, t->layer), tile = find_tile(feed, t->object, t->level, t->tile);
    if (tile == UINT32_MAX || nth == feed->channel_count) return LW_OK; /* none of ours */
    const uint32_t id = id_of(feed, nth, tile);
    if (t->version <= feed->known[id]) return LW_OK;
    if (t->version / 2 + t->version % 2 > feed->frame || (t->base && t->base != feed->known[id])) {
        lack(feed, id);
        return LW_OK;
    }
    feed->known[id] = t->version;
    return send_bytes(feed, raw, size);
}

static bool lacks_nothing(const struct lw_nats_feed *feed) {
    return feed->streams && !feed->lacks_frame && !feed->lacks_any && !feed->syncs;
}

/* A FRAME that is new. One with changes since a FRAME that was lost is lost, too. */
static enum lw_status take_frame(struct lw_nats_feed *feed, const struct lw_message_frame *frame,
                                 const uint8_t *raw, size_t size) {
    if (!frame->base || frame->base == feed->frame) return send_frame(feed, frame->frame, raw, size);
    lack_all(feed);
    return LW_OK;
}

/* is_answer: it was asked for: FRAMEs are whole */
static enum lw_status take_light(struct lw_nats_feed *feed, struct lw_nats_wire_reader *reader,
                                 bool is_answer, bool *out_is_end) {
    enum lw_status status = LW_OK;
    *out_is_end = true;
    while (status == LW_OK && reader->left) {
        struct lw_message m;
        const uint8_t *raw;
        size_t size;
        if (lw_nats_wire_read(reader, &m, &raw, &size) != LW_OK) return LW_PROTOCOL;
        *out_is_end = m.type == LW_MESSAGE_SETTLED;
        if (m.type == LW_MESSAGE_FRAME && (is_answer || !feed->lacks_frame)) {
            /* all parts of a frame that is new; after a loss, one that is not new tells that none was lost */
            if (m.frame.frame > feed->frame) {
                status = take_frame(feed, &m.frame, raw, size + reader->left);
                reader->left = 0;
            } else
                feed->lacks_frame &= !(is_answer && m.frame.frame == feed->frame);
        } else if (m.type == LW_MESSAGE_TILE && !feed->lacks_frame)
            status = send_tile(feed, &m.tile, raw, size);
        else if (m.type == LW_MESSAGE_SETTLED && !is_answer && lacks_nothing(feed) &&
                 m.settled.frame == feed->frame)
            status = send_bytes(feed, raw, size);
        lw_message_finish(&m);
    }
    return status;
}

/* Sends kept light: all that exists if lightwelld is gone, else tiles that need no request. */
static enum lw_status send_kept(struct lw_nats_feed *feed, natsMsg **tile, size_t tile_count) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    natsMsg *frame = NULL;
    lw_nats_wire_subject(subject, feed->address.scene, "kept.%u.frame", feed->irradiance);
    /* after the tiles: none is of a later frame */
    enum lw_status status = get_kept(feed, subject, &frame, NULL);
    if (status != LW_OK) return LW_OK; /* there is no light yet */
    for (size_t i = 0; status == LW_OK && i <= tile_count; i++) {
        struct lw_nats_wire_prefix prefix;
        struct lw_nats_wire_reader reader;
        bool is_end;
        if (read_payload(i ? tile[i - 1] : frame, &prefix, &reader) != LW_OK || prefix.run != feed->run)
            continue;
        status = take_light(feed, &reader, !i, &is_end);
        if (status == LW_PROTOCOL) status = LW_OK; /* a damaged tile is requested later */
    }
    natsMsg_Destroy(frame);
    return status;
}

/* Reads the kept tiles of a channel behind the first `count`, which are there; returns how many are then. */
static size_t read_kept(struct lw_nats_feed *feed, uint32_t channel, natsMsg **tile, size_t count) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE], stream[LW_NATS_WIRE_SUBJECT_SIZE];
    natsSubscription *subscription = NULL;
    jsSubOptions options;
    const size_t first = count;
    jsSubOptions_Init(&options);
    stream_name(feed, stream);
    options.Stream = stream;
    options.Ordered = true;
    options.Config.DeliverPolicy = js_DeliverLastPerSubject;
    lw_nats_wire_subject(subject, feed->address.scene, "kept.%u.*.*.*", channel);
    if (js_SubscribeSync(&subscription, feed->jetstream, subject, NULL, &options, NULL) == NATS_OK)
        for (uint64_t left = 1; left && count - first < LW_NATS_WIRE_TILES_MAX && !feed->stopping;) {
            jsMsgMetaData *meta = NULL;
            if (natsSubscription_NextMsg(&tile[count], subscription,
                                         count > first ? API_MS : FIRST_KEPT_MS) != NATS_OK)
                break;
            left = natsMsg_GetMetaData(&meta, tile[count]) == NATS_OK ? meta->NumPending : 0;
            jsMsgMetaData_Destroy(meta);
            count++;
        }
    lw_nats_link_unsubscribe(feed->link, subscription);
    return count;
}

/* Irradiance first: without it there is nothing else. */
static enum lw_status load_kept(struct lw_nats_feed *feed) {
    natsMsg **tile = calloc((size_t)feed->channel_count * LW_NATS_WIRE_TILES_MAX, sizeof(natsMsg *));
    size_t count = 0;
    if (!tile) return LW_NO_MEMORY;
    for (uint32_t n = 0; n < feed->channel_count && (!n || count); n++)
        count = read_kept(feed, feed->channel[n], tile, count);
    const enum lw_status status = send_kept(feed, tile, count);
    for (size_t i = 0; i < count; i++) natsMsg_Destroy(tile[i]);
    free(tile);
    return status;
}

/* ---- subscriptions ---- */

static void want_level(const struct lw_nats_feed *feed, uint32_t object, uint32_t level) {
    set_bit(feed->wanted, lw_atlas_map_first(feed->map, object, level));
}

/* Listed levels, coarser ones above them, and the coarsest of every object. */
static void list_levels(const struct lw_nats_feed *feed, const struct lw_message_interest *interest) {
    const struct lw_atlas_map *map = feed->map;
    for (uint32_t o = 0; o < map->object_count; o++)
        if (map->atlas[o]->level_count) want_level(feed, o, map->atlas[o]->level_count - 1);
    for (size_t i = 0; i < interest->tile_count; i++) {
        const struct lw_message_interest_tile *t = &interest->tile[i];
        if (t->object >= map->object_count) continue;
        for (uint32_t l = lw_atlas_finer(t->level) ? 0 : t->level; l < map->atlas[t->object]->level_count;
             l++)
            want_level(feed, t->object, l);
    }
}

static enum lw_status hear_level(struct lw_nats_feed *feed, uint32_t nth, uint32_t first) {
    const struct lw_atlas_map *map = feed->map;
    const uint32_t object = map->place[first].object, level = map->place[first].level;
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    lw_nats_wire_subject(subject, feed->address.scene, "live.%u.%u.%u", feed->channel[nth], object, level);
    const enum lw_status status =
        lw_nats_link_subscribe(feed->link, subject, &feed->level[id_of(feed, nth, first)]);
    if (status != LW_OK) return status;
    for (uint32_t t = first; !feed->all[nth] && t < map->plain_count && first_of(map, t) == first; t++)
        lack(feed, id_of(feed, nth, t));
    return LW_OK;
}

static enum lw_status hear_all(struct lw_nats_feed *feed, uint32_t nth) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    if (feed->all[nth]) return LW_OK;
    for (uint32_t t = 0; t < feed->map->plain_count; t++)
        if (!is_heard(feed, nth, t)) lack(feed, id_of(feed, nth, t));
    lw_nats_wire_subject(subject, feed->address.scene, "live.%u.*.*", feed->channel[nth]);
    return lw_nats_link_subscribe(feed->link, subject, &feed->all[nth]);
}

static void leave(struct lw_nats_feed *feed, natsSubscription **subscription) {
    lw_nats_link_unsubscribe(feed->link, *subscription);
    *subscription = NULL;
}

/* One subscription for all, or one for each wanted level of each object. Subscriptions to levels that nobody
 * wants any more end last. */
static enum lw_status hear_channel(struct lw_nats_feed *feed, uint32_t nth, bool everything) {
    const uint32_t tiles = feed->map->plain_count;
    natsSubscription **level = feed->level + id_of(feed, nth, 0);
    enum lw_status status = everything ? hear_all(feed, nth) : LW_OK;
    for (uint32_t t = 0; status == LW_OK && t < tiles; t++)
        if (is_set(feed->wanted, t) && !level[t]) status = hear_level(feed, nth, t);
    for (uint32_t t = 0; status == LW_OK && t < tiles; t++)
        if (level[t] && !is_set(feed->wanted, t)) leave(feed, &level[t]);
    if (status == LW_OK && !everything) leave(feed, &feed->all[nth]);
    return status;
}

/* ---- finer levels ---- */

static size_t fine_level_count(const struct lw_nats_feed *feed) {
    return feed->fine ? (size_t)feed->channel_count * feed->map->object_count * LW_ATLAS_FINER_MAX : 0;
}

static natsSubscription **fine_level_of(struct lw_nats_feed *feed, uint32_t nth, uint32_t object,
                                        uint32_t level) {
    return &feed->fine_level[((size_t)nth * feed->map->object_count + object) * LW_ATLAS_FINER_MAX +
                             lw_atlas_finer(level) - 1];
}

/* Moves versions and requests of listed tiles to their new places. Newly listed tiles are lacking. */
static void move_fine(struct lw_nats_feed *feed, uint32_t nth, uint64_t *known, uint8_t *flags) {
    const uint32_t first = id_of(feed, nth, feed->map->plain_count);
    for (uint32_t i = 0; i < feed->next_fine->count; i++) {
        const uint32_t was = lw_nats_fine_find(feed->fine, feed->next_fine->tile[i].name);
        const bool is_new = was == LW_NATS_FINE_NONE;
        known[i] = is_new ? 0 : feed->known[first + was];
        flags[i] =
            is_new ? 1 : (uint8_t)(is_set(feed->lacks, first + was) | is_set(feed->listed, first + was) << 1);
    }
    for (uint32_t i = 0; i < LW_NATS_WIRE_FINE_MAX; i++) {
        const bool is_listed = i < feed->next_fine->count;
        feed->known[first + i] = is_listed ? known[i] : 0;
        clear_bit(feed->lacks, first + i);
        clear_bit(feed->listed, first + i);
        if (is_listed && flags[i] & 1) lack(feed, first + i);
        if (is_listed && flags[i] & 2) set_bit(feed->listed, first + i);
    }
}

/* Subscribes to levels with a listed tile. */
static enum lw_status hear_fine(struct lw_nats_feed *feed, uint32_t nth) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    enum lw_status status = LW_OK;
    for (uint32_t i = 0; status == LW_OK && i < feed->next_fine->count; i++) {
        const struct lw_nats_fine_tile *t = &feed->next_fine->tile[i];
        natsSubscription **level = fine_level_of(feed, nth, t->object, t->level);
        if (*level) continue;
        lw_nats_wire_subject(subject, feed->address.scene, "fine.%u.%u.%u", feed->channel[nth], t->object,
                             t->level);
        status = lw_nats_link_subscribe(feed->link, subject, level);
    }
    return status;
}

/* Ends subscriptions to levels without a listed tile. Names are in the order of objects and levels. */
static void leave_fine(struct lw_nats_feed *feed, uint32_t nth) {
    const struct lw_nats_fine *fine = feed->fine;
    uint32_t at = 0;
    for (uint32_t o = 0; o < feed->map->object_count; o++)
        for (uint32_t k = 1; k <= LW_ATLAS_FINER_MAX; k++) {
            const uint32_t level = LW_ATLAS_FINER + k, from = at;
            while (at < fine->count && fine->tile[at].object == o && fine->tile[at].level == level) at++;
            if (at == from) leave(feed, fine_level_of(feed, nth, o, level));
        }
    LW_INVARIANT(at == fine->count);
}

/* interest: NULL: no tile of finer levels is listed */
static enum lw_status list_fine(struct lw_nats_feed *feed, const struct lw_message_interest *interest) {
    uint64_t known[LW_NATS_WIRE_FINE_MAX];
    uint8_t flags[LW_NATS_WIRE_FINE_MAX];
    enum lw_status status = LW_OK;
    if (!feed->fine) return LW_OK;
    lw_nats_fine_list(feed->next_fine, feed->map, interest);
    for (uint32_t n = 0; status == LW_OK && n < feed->channel_count; n++) status = hear_fine(feed, n);
    for (uint32_t n = 0; n < feed->channel_count; n++) move_fine(feed, n, known, flags);
    struct lw_nats_fine *before = feed->fine;
    feed->fine = feed->next_fine;
    feed->next_fine = before;
    for (uint32_t n = 0; n < feed->channel_count; n++) leave_fine(feed, n);
    return status;
}

static enum lw_status hear(struct lw_nats_feed *feed, const struct lw_message_interest *interest) {
    const bool everything = !interest || interest->everything;
    enum lw_status status = LW_OK;
    memset(feed->wanted, 0, (feed->map->plain_count / 64 + 1) * sizeof *feed->wanted);
    if (!everything) list_levels(feed, interest);
    for (uint32_t n = 0; status == LW_OK && n < feed->channel_count; n++)
        status = hear_channel(feed, n, everything);
    if (status == LW_OK) status = list_fine(feed, everything ? NULL : interest);
    return status == LW_NO_MEMORY ? status : LW_OK; /* without NATS: again when it is there */
}

/* As the session said it last; everything if it said nothing. */
static enum lw_status hear_interest(struct lw_nats_feed *feed) {
    struct lw_message message = {0};
    if (!feed->interest) return hear(feed, NULL);
    if (lw_message_decode_whole(feed->interest, feed->interest_size, &message) != LW_OK) return LW_PROTOCOL;
    const enum lw_status status = hear(feed, &message.interest);
    lw_message_finish(&message);
    return status;
}

/* ---- messages to lightwelld ---- */

static void publish(struct lw_nats_feed *feed, const char *what, const char *reply, const uint8_t *bytes,
                    size_t size) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    uint8_t *payload = malloc(LW_NATS_WIRE_PREFIX_SIZE + size);
    if (!payload) return; /* it is said again */
    lw_nats_wire_write_prefix(payload, (struct lw_nats_wire_prefix){0, feed->run});
    memcpy(payload + LW_NATS_WIRE_PREFIX_SIZE, bytes, size);
    size += LW_NATS_WIRE_PREFIX_SIZE;
    lw_nats_wire_subject(subject, feed->address.scene, "%s", what);
    if (reply && lw_nats_link_is_connected(feed->link))
        (void)natsConnection_PublishRequest(lw_nats_link_connection(feed->link), subject, reply, payload,
                                            (int)size);
    else if (!reply)
        (void)lw_nats_link_publish(feed->link, subject, payload, size);
    free(payload);
}

static void say_want(struct lw_nats_feed *feed, uint64_t now_ns) {
    const struct lw_message everything = {.type = LW_MESSAGE_INTEREST, .interest = {.everything = true}};
    uint8_t *made = NULL;
    size_t size = feed->interest_size;
    if (!feed->interest && lw_message_encode_alloc(&everything, &made, &size) != LW_OK) return;
    uint8_t *bytes = malloc(9 + size);
    if (bytes) {
        memcpy(bytes, &feed->relay, 8);
        bytes[8] = 0;
        for (uint32_t n = 0; n < feed->channel_count; n++)
            bytes[8] |= (uint8_t)lw_tile_channel_bit(feed->channel[n]);
        memcpy(bytes + 9, feed->interest ? feed->interest : made, size);
        publish(feed, "want", NULL, bytes, 9 + size);
    }
    free(bytes);
    free(made);
    feed->want_ns = now_ns + LW_NATS_WIRE_WANT_MS * MS_NS;
}

static bool lacks_of(const struct lw_nats_feed *feed, uint32_t nth) {
    for (uint32_t t = 0; t < tile_count(feed); t++)
        if (is_set(feed->lacks, id_of(feed, nth, t))) return true;
    return false;
}

static bool lacks_tiles(const struct lw_nats_feed *feed) {
    for (size_t i = 0; i < words_of(feed); i++)
        if (feed->lacks[i]) return true;
    return false;
}

/* As on the wire, without a version. */
static struct lw_message_held name_tile(const struct lw_nats_feed *feed, uint32_t tile) {
    const struct lw_atlas_map *map = feed->map;
    if (tile >= map->plain_count) {
        const struct lw_nats_fine_tile *t = &feed->fine->tile[tile - map->plain_count];
        return (struct lw_message_held){t->object, t->level, t->tile, 0};
    }
    const struct lw_tile_place *p = &map->place[tile];
    return (struct lw_message_held){p->object, p->level, lw_atlas_map_number(map, (lw_tile_id){tile}), 0};
}

/* Moves lacking tiles of a channel to the asked ones, and lists them. *from: where to look on. */
static size_t list_lacking(struct lw_nats_feed *feed, uint32_t nth, struct lw_message_held *held,
                           uint32_t *from) {
    size_t count = 0;
    for (; *from < tile_count(feed) && count < LW_MESSAGE_HOLDS_MAX; ++*from) {
        const uint32_t id = id_of(feed, nth, *from);
        if (!is_set(feed->lacks, id)) continue;
        held[count] = name_tile(feed, *from);
        held[count++].version = feed->known[id];
        set_bit(feed->listed, id);
        clear_bit(feed->lacks, id);
    }
    return count;
}

/* Writes what a request asks for, as much as it holds; its size. */
static size_t write_request(struct lw_nats_feed *feed, struct lw_message_held *held, uint8_t *bytes) {
    size_t size = 1, written = 0;
    uint32_t nth = 0, from = 0;
    while (nth + 1 < feed->channel_count && !lacks_of(feed, nth)) nth++;
    bytes[0] = (uint8_t)feed->channel[nth];
    for (bool is_full = false; !is_full;) {
        const size_t count = list_lacking(feed, nth, held, &from);
        const struct lw_message message = {.type = LW_MESSAGE_HOLDS, .holds = {held, count, 0}};
        if (!count) break;
        if (lw_message_encode(&message, bytes + size, SYNC_SIZE_MAX - size, &written) == LW_OK)
            size += written;
        is_full = size + lw_message_size(&message) > SYNC_SIZE_MAX;
    }
    return size;
}

/* Asks for tiles of one channel that it lacks, as many as a message holds. */
static void ask(struct lw_nats_feed *feed, uint64_t now_ns) {
    struct lw_message_held *held = malloc(LW_MESSAGE_HOLDS_MAX * sizeof *held);
    uint8_t *bytes = malloc(SYNC_SIZE_MAX);
    char reply[LW_NATS_WIRE_SUBJECT_SIZE + 16];
    if (held && bytes) {
        const size_t size = write_request(feed, held, bytes);
        feed->lacks_any = lacks_tiles(feed);
        snprintf(reply, sizeof reply, "%s.%u", feed->answer, ++feed->sync_number);
        publish(feed, "sync", reply, bytes, size);
    }
    free(held);
    free(bytes);
    feed->syncs = true;
    feed->sync_ns = now_ns;
}

/* Ends a request; without an answer its tiles are requested again. */
static void end_sync(struct lw_nats_feed *feed, bool done) {
    for (size_t i = 0; i < words_of(feed); i++) {
        if (!done) feed->lacks[i] |= feed->listed[i];
        feed->lacks_any |= feed->lacks[i] != 0;
        feed->listed[i] = 0;
    }
    feed->lacks_any |= feed->lacks_frame;
    feed->syncs = false;
}

static void ask_if_due(struct lw_nats_feed *feed, uint64_t now_ns) {
    if (feed->syncs && now_ns - feed->sync_ns > SYNC_MS * MS_NS) end_sync(feed, false);
    if (!feed->syncs && now_ns >= feed->check_ns) { /* in case a message got lost unnoticed */
        lack_heard(feed);
        feed->check_ns = now_ns + CHECK_MS * MS_NS;
    }
    if (!feed->syncs && feed->lacks_any && now_ns - feed->sync_ns >= SYNC_AGAIN_MS * MS_NS) ask(feed, now_ns);
}

/* ---- from NATS ---- */

static enum lw_status take_alive(struct lw_nats_feed *feed, struct lw_nats_wire_prefix prefix) {
    if (prefix.run != feed->run) return refuse(feed, "%s lights another run now", feed->address.name);
    feed->heard_ns = lw_clock_ns();
    if (!feed->is_alive && feed->streams) lack_all(feed);
    feed->is_alive = true;
    return LW_OK;
}

static enum lw_status take_answer(struct lw_nats_feed *feed, const char *subject,
                                  struct lw_nats_wire_reader *reader) {
    char expected[LW_NATS_WIRE_SUBJECT_SIZE + 16];
    bool is_end = false;
    snprintf(expected, sizeof expected, "%s.%u", feed->answer, feed->sync_number);
    if (strcmp(subject, expected) != 0) return LW_OK; /* an answer to an abandoned request */
    const bool settles = reader->left > 0;
    const enum lw_status status = take_light(feed, reader, true, &is_end);
    if (!is_end || status != LW_OK) return status;
    end_sync(feed, !feed->lacks_frame);
    if (feed->lacks_frame) { /* there is no light yet: its first FRAME says when to ask, or after a while */
        feed->lacks_any = false;
        feed->check_ns = lw_clock_ns() + SYNC_MS * MS_NS;
    }
    if (!settles || !lacks_nothing(feed)) return LW_OK;
    return send_message(feed, &(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = feed->frame});
}

static enum lw_status take_message(struct lw_nats_feed *feed, natsMsg *message) {
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader reader;
    char alive[LW_NATS_WIRE_SUBJECT_SIZE];
    const char *subject = natsMsg_GetSubject(message);
    bool is_end;
    if (read_payload(message, &prefix, &reader) != LW_OK) return LW_OK; /* none of ours */
    lw_nats_wire_subject(alive, feed->address.scene, "alive");
    if (strcmp(subject, alive) == 0) {
        const enum lw_status status = take_alive(feed, prefix);
        if (status != LW_OK) return status;
    }
    if (prefix.run != feed->run) return LW_OK;
    const bool is_other = feed->has_epoch && prefix.epoch != feed->epoch;
    feed->epoch = prefix.epoch;
    feed->has_epoch = true;
    if (!feed->streams) return LW_OK;
    if (is_other) { /* it has lost what it published meanwhile */
        end_sync(feed, false);
        lack_all(feed);
    }
    if (strcmp(subject, alive) == 0) return LW_OK;
    enum lw_status status = strncmp(subject, feed->answer, strlen(feed->answer)) == 0
                                ? take_answer(feed, subject, &reader)
                                : take_light(feed, &reader, false, &is_end);
    if (feed->lacks_frame && !feed->syncs) feed->lacks_any = true; /* there is light to ask for */
    if (status == LW_PROTOCOL) { /* from anyone: what it was to say is asked for */
        lack_all(feed);
        status = LW_OK;
    }
    return status;
}

static enum lw_status take_events(struct lw_nats_feed *feed) {
    natsMsg *message = NULL;
    enum lw_status status = LW_OK;
    while (status == LW_OK) switch (lw_nats_link_take(feed->link, &message)) {
        case LW_NATS_LINK_NOTHING:
            return LW_OK;
        case LW_NATS_LINK_MESSAGE:
            status = take_message(feed, message);
            natsMsg_Destroy(message);
            break;
        case LW_NATS_LINK_GONE:
            break; /* it may be back before anybody notices */
        case LW_NATS_LINK_BACK:
        case LW_NATS_LINK_DROPPED:
            feed->want_ns = 0;
            if (!feed->streams) break;
            end_sync(feed, false);
            lack_all(feed);
            break;
        }
    return status;
}

/* ---- from the session ---- */

static enum lw_status take_hello(struct lw_nats_feed *feed, const struct lw_message_hello *hello) {
    struct lw_message answer = feed->welcome;
    struct lw_message_welcome *w = &answer.welcome;
    if (feed->greets) return LW_PROTOCOL;
    w->features &= hello->features;
    if (!(w->features & LW_FEATURE_FINER)) w->finer = 0;
    feed->has_finer = w->finer > 0;
    if (!(w->features & LW_FEATURE_MATERIALS)) w->finish = (struct lw_message_package){0};
    if (!(w->features & LW_FEATURE_DRAWS)) {
        w->client_lights = w->client_materials = NULL;
        w->client_lights_size = w->client_materials_size = 0;
    }
    feed->irradiance = w->features & LW_FEATURE_DRAWS ? LW_TILE_CHANNEL_SPLIT : LW_TILE_CHANNEL_FULL;
    feed->channel_count = 0;
    const uint32_t channels = lw_tile_channels_for(w->features, UINT32_MAX);
    LW_TILE_CHANNELS_EACH (c, channels) feed->channel[feed->channel_count++] = c;
    LW_INVARIANT(feed->channel_count && feed->channel[0] == feed->irradiance);
    w->session = 1;
    feed->greets = true;
    return send_message(feed, &answer);
}

/* The bytes of a message, as it came. malloc'ed; NULL: no memory. */
static uint8_t *copy_message(struct lw_framing_header header, const uint8_t *body, size_t *out_size) {
    *out_size = LW_FRAMING_HEADER_SIZE + (size_t)header.body_size;
    uint8_t *bytes = malloc(*out_size);
    if (!bytes) return NULL;
    lw_framing_write_header(bytes, header);
    memcpy(bytes + LW_FRAMING_HEADER_SIZE, body, header.body_size);
    return bytes;
}

static enum lw_status take_interest(struct lw_nats_feed *feed, struct lw_framing_header header,
                                    const uint8_t *body) {
    size_t size;
    uint8_t *copy = copy_message(header, body, &size);
    if (!copy) return LW_NO_MEMORY;
    free(feed->interest);
    feed->interest = copy;
    feed->interest_size = size;
    feed->want_ns = 0;
    return feed->streams ? hear_interest(feed) : LW_OK;
}

static enum lw_status make_room(struct lw_nats_feed *feed) {
    const struct lw_atlas_map *map = feed->map;
    if (!map || feed->known) return LW_OK;
    LW_INVARIANT(feed->channel_count > 0);
    if (feed->has_finer) { /* first: ids are counted by it */
        feed->fine = calloc(1, sizeof *feed->fine);
        feed->next_fine = calloc(1, sizeof *feed->next_fine);
        feed->fine_level = calloc(fine_level_count(feed) + 1, sizeof(natsSubscription *));
        if (!feed->fine || !feed->next_fine || !feed->fine_level) return LW_NO_MEMORY;
    }
    feed->known = calloc((size_t)id_count(feed) + 1, sizeof *feed->known);
    feed->lacks = calloc(words_of(feed), sizeof *feed->lacks);
    feed->listed = calloc(words_of(feed), sizeof *feed->listed);
    feed->wanted = calloc(map->plain_count / 64 + 1, sizeof *feed->wanted);
    feed->level = calloc((size_t)id_count(feed) + 1, sizeof(natsSubscription *));
    return feed->known && feed->lacks && feed->listed && feed->wanted && feed->level ? LW_OK : LW_NO_MEMORY;
}

/* HOLDS is of irradiance. */
static enum lw_status take_holds(struct lw_nats_feed *feed, const struct lw_message_holds *holds) {
    const struct lw_atlas_map *map = feed->map;
    const enum lw_status status = make_room(feed);
    if (status != LW_OK || !map) return status;
    for (size_t i = 0; i < holds->tile_count; i++) {
        const struct lw_message_held *h = &holds->tile[i];
        if (lw_atlas_finer(h->level)) continue;
        const uint32_t id = lw_atlas_map_find_tile(map, h->object, h->level, h->tile).v;
        if (id < map->plain_count) feed->known[id_of(feed, 0, id)] = h->version;
    }
    return LW_OK;
}

static enum lw_status take_request(struct lw_nats_feed *feed, const struct lw_message *m) {
    const struct lw_message_package package = m->type == LW_MESSAGE_FINISH_REQUEST
                                                  ? feed->welcome.welcome.finish
                                                  : lw_message_welcome_package(&feed->welcome.welcome);
    if (m->type == LW_MESSAGE_FINISH_REQUEST)
        return send_package(feed, &package, &m->finish_request, "finishes", LW_MESSAGE_FINISH_CHUNK);
    feed->asked = true;
    return send_package(feed, &package, &m->package_request, "package", LW_MESSAGE_PACKAGE_CHUNK);
}

/* lightwelld checks it. A lost report is followed by another. */
static void forward_report(struct lw_nats_feed *feed, struct lw_framing_header header, const uint8_t *body) {
    size_t size;
    uint8_t *bytes = copy_message(header, body, &size);
    if (bytes) publish(feed, "report", NULL, bytes, size);
    free(bytes);
}

static enum lw_status handle(struct lw_nats_feed *feed, struct lw_framing_header header,
                             const uint8_t *body) {
    struct lw_message m;
    enum lw_status status = lw_message_decode(header, body, &m, NULL);
    if (status != LW_OK) return status;
    const bool is_regular = m.type == LW_MESSAGE_PING || m.type == LW_MESSAGE_REPORT;
    if (!feed->is_alive && !is_regular) feed->heard_ns = lw_clock_ns();
    if (m.type == LW_MESSAGE_HELLO)
        status = take_hello(feed, &m.hello);
    else if (m.type == LW_MESSAGE_INTEREST)
        status = take_interest(feed, header, body);
    else if (m.type == LW_MESSAGE_HOLDS)
        status = take_holds(feed, &m.holds);
    else if (m.type == LW_MESSAGE_PACKAGE_REQUEST || m.type == LW_MESSAGE_FINISH_REQUEST)
        status = take_request(feed, &m);
    else if (m.type == LW_MESSAGE_REPORT)
        forward_report(feed, header, body);
    else if (m.type == LW_MESSAGE_PING)
        status =
            send_message(feed, &(struct lw_message){.type = LW_MESSAGE_PONG, .pong.token = m.ping.token});
    lw_message_finish(&m);
    return status;
}

static enum lw_status take_session(struct lw_nats_feed *feed) {
    const ssize_t got = recv(feed->socket, feed->input, sizeof feed->input, MSG_DONTWAIT);
    if (got == 0) return LW_CLOSED;
    if (got < 0) return errno == EAGAIN || errno == EINTR ? LW_OK : LW_CLOSED;
    enum lw_status status = LW_OK;
    lw_message_reader_lend(&feed->reader, feed->input, (size_t)got);
    for (;;) {
        struct lw_framing_header header;
        const uint8_t *body;
        status = lw_message_reader_take(&feed->reader, &header, &body, NULL);
        if (status != LW_OK || !body) break;
        status = handle(feed, header, body);
        if (status != LW_OK) break;
    }
    return status == LW_OK ? lw_message_reader_keep(&feed->reader) : status;
}

/* ---- the thread ---- */

static bool holds_any(const struct lw_nats_feed *feed) {
    for (uint32_t t = 0; t < feed->map->plain_count; t++)
        if (feed->known[t]) return true;
    return false;
}

/* Subscribes first: live messages wait while kept light is read. */
static enum lw_status begin_light(struct lw_nats_feed *feed) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    enum lw_status status = make_room(feed);
    if (status != LW_OK) return status;
    const bool is_new = !holds_any(feed);
    lw_nats_wire_subject(subject, feed->address.scene, "live.%u.frame", feed->irradiance);
    if (lw_nats_link_subscribe(feed->link, subject, &feed->frames) != LW_OK) return LW_UNAVAILABLE;
    feed->streams = true;
    if ((status = hear_interest(feed)) != LW_OK) return status;
    say_want(feed, lw_clock_ns());
    if (is_new) status = load_kept(feed);
    lack_all(feed);
    feed->check_ns = lw_clock_ns() + CHECK_MS * MS_NS;
    return status;
}

static int time_left(const struct lw_nats_feed *feed) {
    return feed->streams && (feed->lacks_any || feed->syncs) ? (int)SYNC_AGAIN_MS : 500;
}

static enum lw_status turn(struct lw_nats_feed *feed) {
    struct pollfd polled[2] = {{.fd = feed->socket, .events = POLLIN},
                               {.fd = lw_nats_link_descriptor(feed->link), .events = POLLIN}};
    (void)poll(polled, 2, time_left(feed));
    if (feed->stopping) return LW_CLOSED;
    enum lw_status status = polled[0].revents ? take_session(feed) : LW_OK;
    if (status == LW_OK) status = take_events(feed);
    if (status == LW_OK && feed->asked && !feed->streams && feed->map)
        return begin_light(feed); /* it takes a while: messages that wait come before time-outs */
    if (status != LW_OK) return status;
    const uint64_t now_ns = lw_clock_ns();
    if (feed->streams && feed->is_alive) {
        if (now_ns >= feed->want_ns) say_want(feed, now_ns);
        ask_if_due(feed, now_ns);
    }
    if (now_ns - feed->heard_ns > LW_NATS_WIRE_SILENCE_MS * MS_NS)
        return refuse(feed, "no lightwelld publishes there now");
    return LW_OK;
}

static void *run(void *context) {
    struct lw_nats_feed *feed = context;
    enum lw_status status = LW_OK;
    while (status == LW_OK) status = turn(feed);
    if (status != LW_CLOSED) (void)refuse(feed, "%s", lw_status_text(status));
    shutdown(feed->socket, SHUT_WR); /* the session still reads the last bytes */
    nats_ReleaseThreadMemory();
    return NULL;
}

void lw_nats_feed_set_map(struct lw_nats_feed *feed, const struct lw_atlas_map *map) {
    LW_INVARIANT(!feed->map);
    feed->map = map;
    lw_nats_link_wake(feed->link);
}

bool lw_nats_feed_is_alive(const struct lw_nats_feed *feed) { return feed->is_alive; }

/* ---- create, destroy ---- */

/* Whether lightwelld is there, and of which run it is. */
static bool ask_who(struct lw_nats_feed *feed, uint64_t *out_run) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    uint8_t question[LW_NATS_WIRE_PREFIX_SIZE];
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader reader;
    natsMsg *answer = NULL;
    lw_nats_wire_subject(subject, feed->address.scene, "who");
    lw_nats_wire_write_prefix(question, (struct lw_nats_wire_prefix){0, 0});
    if (natsConnection_Request(&answer, lw_nats_link_connection(feed->link), subject, question,
                               sizeof question, WHO_MS) != NATS_OK)
        return false;
    const bool done = read_payload(answer, &prefix, &reader) == LW_OK;
    if (done) *out_run = prefix.run;
    natsMsg_Destroy(answer);
    return done;
}

static enum lw_status read_welcome(struct lw_nats_feed *feed, struct lw_error *err) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader reader;
    const uint8_t *raw = NULL;
    size_t size;
    lw_nats_wire_subject(subject, feed->address.scene, "kept.welcome");
    enum lw_status status = get_kept(feed, subject, &feed->welcome_message, err);
    if (status != LW_OK) return status;
    status = read_payload(feed->welcome_message, &prefix, &reader);
    if (status == LW_OK) status = lw_nats_wire_read(&reader, &feed->welcome, &raw, &size);
    if (status == LW_OK && (!raw || feed->welcome.type != LW_MESSAGE_WELCOME || !prefix.run ||
                            prefix.run != feed->welcome.welcome.run))
        status = LW_PROTOCOL;
    if (status != LW_OK) {
        if (raw) lw_message_finish(&feed->welcome);
        feed->welcome = (struct lw_message){0};
        return lw_status_fail(err, LW_PROTOCOL, "%s: what is kept there is no welcome", feed->address.name);
    }
    feed->run = prefix.run;
    return LW_OK;
}

static enum lw_status find_light(struct lw_nats_feed *feed, const struct lw_nats_feed_desc *desc,
                                 struct lw_error *err) {
    jsOptions options;
    uint64_t run = 0;
    jsOptions_Init(&options);
    options.Wait = API_MS;
    const natsStatus made =
        natsConnection_JetStream(&feed->jetstream, lw_nats_link_connection(feed->link), &options);
    if (made != NATS_OK)
        return lw_status_fail(err, LW_UNAVAILABLE, "%s: %s", feed->address.name, natsStatus_GetText(made));
    enum lw_status status = read_welcome(feed, err);
    if (status != LW_OK) return status == LW_NO_INPUT ? LW_UNAVAILABLE : status;
    feed->is_alive = ask_who(feed, &run);
    feed->heard_ns = lw_clock_ns();
    if (feed->is_alive && run != feed->run)
        return lw_status_fail(err, LW_UNAVAILABLE, "%s: a lightwelld is about to publish there",
                              feed->address.name);
    if (feed->is_alive || desc->takes_old) return LW_OK;
    return lw_status_fail(err, LW_UNAVAILABLE, "no lightwelld publishes at %s now", feed->address.name);
}

static enum lw_status listen_first(struct lw_nats_feed *feed, struct lw_error *err) {
    char subject[LW_NATS_WIRE_SUBJECT_SIZE];
    natsInbox *inbox = NULL;
    if (natsInbox_Create(&inbox) != NATS_OK) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    snprintf(feed->answer, sizeof feed->answer, "%s", (const char *)inbox);
    natsInbox_Destroy(inbox);
    lw_nats_wire_subject(subject, feed->address.scene, "alive");
    enum lw_status status = lw_nats_link_subscribe(feed->link, subject, &feed->alive);
    snprintf(subject, sizeof subject, "%.120s.*", feed->answer);
    if (status == LW_OK) status = lw_nats_link_subscribe(feed->link, subject, &feed->answers);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "%s: cannot subscribe", feed->address.name);
}

static void free_feed(struct lw_nats_feed *feed) {
    natsSubscription *const each[] = {feed->frames, feed->alive, feed->answers};
    lw_nats_link_close(feed->link);
    for (size_t i = 0; i < sizeof each / sizeof *each; i++) lw_nats_link_unsubscribe(feed->link, each[i]);
    for (uint32_t n = 0; n < feed->channel_count; n++) lw_nats_link_unsubscribe(feed->link, feed->all[n]);
    for (uint32_t i = 0; feed->level && i < id_count(feed); i++)
        lw_nats_link_unsubscribe(feed->link, feed->level[i]);
    for (size_t i = 0; feed->fine_level && i < fine_level_count(feed); i++)
        lw_nats_link_unsubscribe(feed->link, feed->fine_level[i]);
    jsCtx_Destroy(feed->jetstream);
    lw_nats_link_destroy(feed->link);
    if (feed->welcome.type) lw_message_finish(&feed->welcome);
    natsMsg_Destroy(feed->welcome_message);
    lw_message_reader_clear(&feed->reader);
    if (feed->socket >= 0) close(feed->socket);
    free(feed->interest);
    free(feed->known);
    free(feed->lacks);
    free(feed->listed);
    free(feed->wanted);
    free(feed->level);
    free(feed->fine_level);
    free(feed->fine);
    free(feed->next_fine);
    free(feed);
}

enum lw_status lw_nats_feed_create(const struct lw_nats_feed_desc *desc, struct lw_nats_feed **out_feed,
                                   int *out_socket, struct lw_error *err) {
    struct lw_nats_feed *feed = calloc(1, sizeof *feed);
    int pair[2] = {-1, -1};
    if (!feed) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    feed->address = *desc->address;
    feed->relay = desc->relay;
    feed->socket = -1;
    feed->lacks_frame = true;
    feed->reader.body_max = LW_FRAMING_CLIENT_BODY_MAX;
    enum lw_status status = lw_nats_link_create(
        &(struct lw_nats_link_desc){.url = feed->address.url,
                                    .name = feed->address.name,
                                    .tls_host = feed->address.tls ? feed->address.host : NULL,
                                    .trust = desc->trust,
                                    .client = "lightwell-relay " LW_VERSION,
                                    .timeout_ms = desc->timeout_ms,
                                    .queue_max = QUEUE_MAX},
        &feed->link, err);
    if (status == LW_OK) status = listen_first(feed, err);
    if (status == LW_OK) status = find_light(feed, desc, err);
    if (status == LW_OK && (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) != 0 ||
                            fcntl(pair[1], F_SETFL, O_NONBLOCK) != 0))
        status = lw_status_fail(err, LW_OS, "socketpair: %s", strerror(errno));
    feed->socket = pair[0];
    if (status == LW_OK && pthread_create(&feed->thread, NULL, run, feed) != 0)
        status = lw_status_fail(err, LW_OS, "cannot start a thread");
    if (status == LW_OK) {
        *out_feed = feed;
        *out_socket = pair[1];
        return LW_OK;
    }
    if (pair[1] >= 0) close(pair[1]);
    free_feed(feed);
    return status;
}

void lw_nats_feed_destroy(struct lw_nats_feed *feed) {
    if (!feed) return;
    feed->stopping = true;
    lw_nats_link_wake(feed->link);
    shutdown(feed->socket, SHUT_RDWR); /* a call that waits for room ends */
    pthread_join(feed->thread, NULL);
    free_feed(feed);
}
