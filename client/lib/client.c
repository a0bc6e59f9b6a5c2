#include "client/lib/client.h"

#include "client/lib/download.h"
#include "client/lib/draws.h"
#include "client/lib/interest.h"
#include "client/lib/link.h"
#include "client/lib/package_cache.h"
#include "client/lib/replica.h"
#include "client/lib/servers.h"
#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/base/random.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TIMEOUT_DEFAULT_MS 5000u
#define POLL_BYTES_MAX     (8u << 20)
#define BUDGET_DEFAULT_NS  20000000u

/* An object, a level, a number for each tile. */
#define INTEREST_SCRATCH_SIZE (3 * LW_CLIENT_INTEREST_MAX * sizeof(uint32_t))

struct lw_client {
    char *name, *cache_folder; /* as given */
    struct lw_servers servers;
    struct lw_access access;
    struct ssl_ctx_st *trust; /* by TLS: whom it believes; NULL: in plain */
    unsigned timeout_ms;
    bool control, operate, draws_direct, materials, wants_nothing;
    uint32_t finer_max, finer; /* wanted; of this session */
    uint64_t channel_features,
        features; /* asked for beside irradiance; that the server takes up, of those offered */
    uint64_t rate_limit_bytes_hz, budget_ns;
    struct lw_client_watch watch;
    bool watch_has_scene, reported_damage;
    struct lw_link link;
    struct lw_message_memory memory; /* for the message that is being taken */
    /* The INTEREST that is being sent: LW_CLIENT_INTEREST_MAX tiles, and memory to encode them. */
    struct lw_message_interest_tile *interest_tile;
    uint32_t *interest_scratch;
    bool welcomed;
    struct lw_download download;        /* until the replica is there */
    struct lw_download finish_download; /* for finishes, while they come */
    enum lw_client_finishes finishes;
    bool finish_asked;                  /* since the last WELCOME */
    struct lw_package_hash finish_hash; /* the present finishes' */
    struct lw_replica *replica;         /* NULL before the package is complete */
    const struct lw_client *scene_of;
    bool found_other_scene; /* the last attempt to connect again did */
    struct lw_package_hash package_hash;
    uint64_t package_compressed_size;
    uint64_t run;  /* the server's */
    bool may_hold; /* we may say what we have */
    struct lw_draws draws;
    struct lw_interest interest;
    struct lw_waiting_state waiting; /* for the first light, as the server said last */
    bool may_update, may_ask;
    uint64_t asked;          /* the request of the last ASK */
    char *report;            /* the answer that has arrived, ended by a zero */
    uint32_t report_code;    /* its code */
    uint32_t retry_after_ms; /* as the last REFUSAL said */
    uint64_t updates_sent;
    struct lw_client_answer *answer; /* LW_CLIENT_UPDATES_MAX of them, or NULL: a ring */
    uint32_t answer_first, answer_count;
    uint32_t unanswered; /* updates whose answer has not arrived */
    uint32_t *added;     /* what the answer that was taken last points to */
    struct lw_client_stats stats;
    uint64_t bytes_before;                          /* received by earlier sessions */
    uint64_t frame_acked, frame_ns, frame_solve_ns; /* frame_ns: when the newest frame arrived */
};

/* ---- what the server says ---- */

static enum lw_status out_of_order(struct lw_error *err, enum lw_message_type type) {
    return lw_status_fail(err, LW_PROTOCOL, "message %s: out of order", lw_message_name((uint16_t)type));
}

static bool has_scene(const struct lw_client *c, const struct lw_package_hash *hash) {
    return c && c->replica && memcmp(c->package_hash.bytes, hash->bytes, sizeof hash->bytes) == 0;
}

static bool has_other_finishes(const struct lw_client *c, const struct lw_message_welcome *welcome) {
    return c->finishes == LW_CLIENT_FINISHES_THERE &&
           (!welcome->finish.size ||
            memcmp(c->finish_hash.bytes, welcome->finish.hash.bytes, sizeof c->finish_hash.bytes) != 0);
}

/* The session before this one has left a scene. */
static enum lw_status take_up_scene(struct lw_client *c, const struct lw_message_welcome *welcome,
                                    bool same_run, struct lw_error *err) {
    c->found_other_scene =
        memcmp(c->package_hash.bytes, welcome->package_hash.bytes, sizeof c->package_hash.bytes) != 0 ||
        has_other_finishes(c, welcome);
    if (c->found_other_scene) return lw_status_fail(err, LW_BAD_DATA, "it lights another scene now");
    lw_replica_forget_fine(c->replica);
    if (same_run) return LW_OK;
    lw_replica_begin_run(c->replica);
    c->may_hold = false;
    c->frame_acked = c->stats.frame = c->stats.settled_frame = c->stats.changed_frame = 0;
    return LW_OK;
}

/* From the folder of packages; NULL: it is not there, or damaged, which is logged once. */
static uint8_t *read_cached(struct lw_client *c, enum lw_package_cache_kind kind,
                            const struct lw_package_hash *hash, uint64_t size) {
    uint8_t *bytes;
    const enum lw_package_cache_found found =
        lw_package_cache_read(c->cache_folder, kind, hash, size, &bytes);
    if (found == LW_PACKAGE_CACHE_DAMAGED && !c->reported_damage && c->watch.damaged) {
        c->reported_damage = true;
        c->watch.damaged(c->watch.context, c->cache_folder);
    }
    return found == LW_PACKAGE_CACHE_FOUND ? bytes : NULL;
}

static uint8_t *find_part(void *client, const struct lw_package_hash *hash, uint64_t size) {
    return read_cached(client, LW_PACKAGE_CACHE_PART, hash, size);
}

/* Where it cannot be kept it is downloaded again: no harm. A package of several parts is kept as these, and
 * nothing of it twice. A failure of one part would be one of each. */
static void keep_parts(const struct lw_client *c, const struct lw_download *d,
                       enum lw_package_cache_kind kind) {
    uint64_t begin = 0;
    struct lw_error err = {0};
    LW_INVARIANT(lw_download_is_complete(d) && d->size == d->package_size);
    for (size_t i = 0; i < d->part_count && !err.status; begin = d->part[i++].end)
        if (!d->part[i].was_held &&
            lw_package_cache_write(c->cache_folder, kind, &d->part[i].hash, d->bytes + begin,
                                   (size_t)(d->part[i].end - begin), &err) != LW_OK &&
            c->watch.unkept)
            c->watch.unkept(c->watch.context, err.text);
}

/* There is a scene: which light of it will come? */
static enum lw_status begin_light(struct lw_client *c, struct lw_error *err) {
    if (!c->watch_has_scene) {
        c->watch_has_scene = true;
        enum lw_status status = c->watch.scene ? c->watch.scene(c->watch.context, c, err) : LW_OK;
        if (status != LW_OK) return status;
        lw_replica_set_watch(c->replica, c->watch.tile, c->watch.context);
    }
    enum lw_status status =
        lw_replica_set_channels(c->replica, lw_tile_channels_for(c->features, UINT32_MAX), err);
    return status == LW_OK ? lw_draws_set_scene(&c->draws, lw_replica_scene(c->replica), err) : status;
}

/* The download is complete. */
static enum lw_status take_package(struct lw_client *c, struct lw_error *err) {
    struct lw_replica *replica = NULL;
    LW_INVARIANT(!c->replica && c->welcomed && lw_download_is_complete(&c->download));
    if (c->watch.leave) c->watch.leave(c->watch.context);
    enum lw_status status = lw_replica_create(c->download.bytes, c->download.size, c->finer, &replica, err);
    const bool has_parts = c->download.part_count > 1;
    if (status == LW_OK && c->cache_folder)
        keep_parts(c, &c->download, has_parts ? LW_PACKAGE_CACHE_PART : LW_PACKAGE_CACHE_PACKAGE);
    if (c->watch.enter) c->watch.enter(c->watch.context);
    c->replica = replica;
    lw_download_finish(&c->download);
    c->stats.package_ns = lw_clock_ns();
    return status == LW_OK ? begin_light(c, err) : status;
}

/* Notes finishes that are to come; they are asked for once there is light. */
static enum lw_status begin_finishes(struct lw_client *c, const struct lw_message_welcome *welcome,
                                     bool same_run, struct lw_error *err) {
    c->finish_asked = false;
    if (c->finishes == LW_CLIENT_FINISHES_THERE) return LW_OK;
    const struct lw_message_package *finish = &welcome->finish;
    const bool goes_on =
        same_run && c->finish_download.zstd && finish->size &&
        !memcmp(c->finish_download.hash.bytes, finish->hash.bytes, sizeof finish->hash.bytes);
    if (goes_on) return LW_OK;
    lw_download_finish(&c->finish_download);
    c->finishes = LW_CLIENT_FINISHES_NONE;
    if (!c->materials || !finish->size || (c->replica && lw_replica_is_beside(c->replica))) return LW_OK;
    enum lw_status status = lw_download_init(&c->finish_download, "finish package", finish, NULL, NULL);
    if (status != LW_OK) return lw_status_fail(err, status, "out of memory");
    c->finishes = LW_CLIENT_FINISHES_COMING;
    return LW_OK;
}

static enum lw_status take_finishes(struct lw_client *c, struct lw_error *err) {
    struct lw_download *d = &c->finish_download;
    LW_INVARIANT(c->finishes == LW_CLIENT_FINISHES_COMING && lw_download_is_complete(d));
    LW_INVARIANT(!lw_replica_is_beside(c->replica)); /* its scene is another's to change */
    if (c->watch.leave) c->watch.leave(c->watch.context);
    enum lw_status status = lw_replica_read_finishes(c->replica, d->bytes, d->size, err);
    if (status == LW_OK && c->cache_folder) keep_parts(c, d, LW_PACKAGE_CACHE_PART);
    if (c->watch.enter) c->watch.enter(c->watch.context);
    c->finish_hash = d->hash;
    lw_download_finish(d);
    if (status != LW_OK) return status;
    lw_replica_show_finishes(c->replica);
    c->finishes = LW_CLIENT_FINISHES_THERE;
    c->stats.finishes_ns = lw_clock_ns();
    if (c->watch.finishes) c->watch.finishes(c->watch.context);
    return LW_OK;
}

static enum lw_status begin_download(struct lw_client *c, const struct lw_message_welcome *welcome,
                                     bool same_run, struct lw_error *err) {
    if (same_run && c->download.zstd) return LW_OK;
    lw_download_finish(&c->download);
    const struct lw_message_package package = lw_message_welcome_package(welcome);
    enum lw_status status =
        lw_download_init(&c->download, "scene package", &package, c->cache_folder ? find_part : NULL, c);
    if (status != LW_OK) return lw_status_fail(err, status, "out of memory");
    status = lw_download_begin(&c->download, err);
    return status == LW_OK && lw_download_is_complete(&c->download) ? take_package(c, err) : status;
}

/* From the folder of packages, if it is there. */
static enum lw_status load_cached(struct lw_client *c, const struct lw_message_welcome *welcome,
                                  struct lw_error *err) {
    uint8_t *bytes = c->cache_folder ? read_cached(c, LW_PACKAGE_CACHE_PACKAGE, &welcome->package_hash,
                                                   welcome->package_size)
                                     : NULL;
    if (!bytes) return LW_OK;
    enum lw_status status =
        lw_replica_create(bytes, (size_t)welcome->package_size, c->finer, &c->replica, err);
    free(bytes);
    c->stats.package_ns = lw_clock_ns();
    return status;
}

/* From the session before, another client, the folder, or the server. */
static enum lw_status find_scene(struct lw_client *c, const struct lw_message_welcome *welcome, bool same_run,
                                 struct lw_error *err) {
    if (c->replica) return take_up_scene(c, welcome, same_run, err);
    c->package_hash = welcome->package_hash;
    if (has_scene(c->scene_of, &welcome->package_hash)) {
        c->stats.package_ns = lw_clock_ns();
        return lw_replica_create_beside(c->scene_of->replica, &c->replica, err);
    }
    return load_cached(c, welcome, err);
}

static uint64_t offered_features(const struct lw_client *c) {
    return LW_FEATURES_READ | c->channel_features | (c->control ? LW_FEATURE_CONTROL : 0) |
           (c->operate ? LW_FEATURE_OPERATE : 0) | (c->draws_direct ? LW_FEATURE_DRAWS : 0) |
           (c->materials ? LW_FEATURE_MATERIALS : 0) | (c->finer_max ? LW_FEATURE_FINER : 0);
}

static enum lw_status handle_welcome(struct lw_client *c, const struct lw_message_welcome *welcome,
                                     struct lw_error *err) {
    if (c->welcomed) return out_of_order(err, LW_MESSAGE_WELCOME);
    if (welcome->version != LW_WIRE_VERSION)
        return lw_status_fail(err, LW_PROTOCOL,
                              "it speaks version %u of the protocol, this client version %u",
                              welcome->version, LW_WIRE_VERSION);
    c->welcomed = true;
    c->waiting = (struct lw_waiting_state){LW_WAITING_UNKNOWN, 0};
    c->package_compressed_size = c->stats.package_bytes = welcome->package_compressed_size;
    c->stats.finish_bytes = welcome->finish.size ? welcome->finish.compressed_size : 0;
    c->stats.bounces = welcome->bounces;
    c->stats.target_error = welcome->target_error;
    c->stats.noise_shown = welcome->noise_shown > 0 ? welcome->noise_shown : 1;
    c->finer = welcome->finer < c->finer_max ? welcome->finer : c->finer_max;
    c->features = welcome->features & offered_features(c);
    c->may_update = welcome->features & LW_FEATURE_CONTROL;
    c->may_ask = welcome->features & LW_FEATURE_OPERATE;
    c->may_hold = welcome->features & LW_FEATURE_RESUME;
    const bool same_run = welcome->run && welcome->run == c->run;
    c->run = 0;                   /* until what depends on it is taken over */
    if (c->operate) return LW_OK; /* it wants no scene */
    enum lw_status status = lw_draws_begin(&c->draws, welcome, c->draws_direct, err);
    if (status == LW_OK) status = find_scene(c, welcome, same_run, err);
    if (status == LW_OK) status = begin_finishes(c, welcome, same_run, err);
    if (status != LW_OK) return status;
    if (c->replica) lw_download_finish(&c->download); /* a former session's: it was found elsewhere */
    status = c->replica ? begin_light(c, err) : begin_download(c, welcome, same_run, err);
    if (status == LW_OK && lw_servers_found(&c->servers, welcome->servers) != LW_OK)
        status = lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (status == LW_OK) c->run = welcome->run;
    return status;
}

static enum lw_status handle_refusal(struct lw_client *c, const struct lw_message_refusal *refusal,
                                     struct lw_error *err) {
    const char *text = refusal->text && *refusal->text ? refusal->text : "it did not say why";
    c->retry_after_ms = refusal->retry_after_ms;
    if (refusal->code == LW_REFUSAL_TOKEN)
        return lw_status_fail(err, LW_NOT_ALLOWED, "it refused us: %s%s", text,
                              c->access.has_token ? "" : " (--token-file, LIGHTWELL_TOKEN)");
    if (c->welcomed) return lw_status_fail(err, LW_CLOSED, "it ended the session: %s", text);
    enum lw_status status = refusal->code == LW_REFUSAL_VERSION || refusal->code == LW_REFUSAL_PROTOCOL ||
                                    refusal->code == LW_REFUSAL_FEATURES
                                ? LW_PROTOCOL
                                : LW_UNAVAILABLE;
    return lw_status_fail(err, status, "it refused us: %s", text);
}

static enum lw_status handle_chunk(struct lw_client *c, const struct lw_message_package_chunk *chunk,
                                   struct lw_error *err) {
    if (!c->welcomed || c->replica) return out_of_order(err, LW_MESSAGE_PACKAGE_CHUNK);
    enum lw_status status = lw_download_add(&c->download, chunk, err);
    return status == LW_OK && lw_download_is_complete(&c->download) ? take_package(c, err) : status;
}

static enum lw_status handle_finish_chunk(struct lw_client *c, const struct lw_message_package_chunk *chunk,
                                          struct lw_error *err) {
    if (!c->finish_asked || c->finishes != LW_CLIENT_FINISHES_COMING)
        return out_of_order(err, LW_MESSAGE_FINISH_CHUNK);
    enum lw_status status = lw_download_add(&c->finish_download, chunk, err);
    return status == LW_OK && lw_download_is_complete(&c->finish_download) ? take_finishes(c, err) : status;
}

static enum lw_status handle_frame(struct lw_client *c, const struct lw_message_frame *frame,
                                   struct lw_error *err) {
    if (!c->replica) return out_of_order(err, LW_MESSAGE_FRAME);
    LW_INVARIANT(!c->download.zstd); /* the scene is there: nothing of it is to come */
    if (frame->frame < c->stats.frame)
        return lw_status_fail(err, LW_PROTOCOL, "message FRAME: number %llu after %llu",
                              (unsigned long long)frame->frame, (unsigned long long)c->stats.frame);
    enum lw_status status = lw_replica_take_frame(c->replica, frame, err);
    if (status != LW_OK) return status;
    if (frame->frame > c->stats.frame) c->stats.frames++; /* a large frame comes in several messages */
    if (frame->run) c->run = frame->run;                  /* what it holds counts there, too */
    c->stats.frame = frame->frame;
    c->stats.time_s = frame->time_s;
    c->stats.rays_total = frame->rays_total;
    c->stats.server_cpu_ns = frame->server_cpu_ns;
    memcpy(c->stats.sky, frame->sky, sizeof c->stats.sky);
    if (frame->material_count || frame->hidden_count || frame->shown_count)
        c->stats.changed_frame = frame->frame;
    LW_INVARIANT(c->stats.settled_frame <= c->stats.frame && c->stats.changed_frame <= c->stats.frame &&
                 c->frame_acked <= c->stats.frame);
    c->waiting = (struct lw_waiting_state){LW_WAITING_READY, 1};
    c->frame_ns = lw_clock_ns();
    c->frame_solve_ns = frame->solve_ns;
    return LW_OK;
}

static enum lw_status handle_tile(struct lw_client *c, const struct lw_message_tile *tile,
                                  struct lw_error *err) {
    if (!c->replica) return out_of_order(err, LW_MESSAGE_TILE);
    uint64_t began = lw_clock_ns();
    enum lw_status status = lw_replica_take_tile(c->replica, tile, err);
    c->stats.decode_ns += lw_clock_ns() - began;
    if (status != LW_OK) return status;
    c->stats.tiles++;
    if (!c->stats.first_ns && lw_replica_has_first(c->replica)) c->stats.first_ns = lw_clock_ns();
    return LW_OK;
}

static enum lw_status handle_settled(struct lw_client *c, uint64_t frame, struct lw_error *err) {
    if (!c->stats.frame || frame != c->stats.frame) return out_of_order(err, LW_MESSAGE_SETTLED);
    c->stats.settled_frame = frame;
    return LW_OK;
}

static enum lw_status handle_updated(struct lw_client *c, const struct lw_message_updated *updated,
                                     struct lw_error *err) {
    if (!c->unanswered) return out_of_order(err, LW_MESSAGE_UPDATED);
    uint32_t *added = NULL;
    if (updated->added_count) {
        if (!(added = malloc(updated->added_count * sizeof *added)))
            return lw_status_fail(err, LW_NO_MEMORY, "message UPDATED: out of memory");
        memcpy(added, updated->added, updated->added_count * sizeof *added);
    }
    LW_INVARIANT(c->unanswered + c->answer_count <= LW_CLIENT_UPDATES_MAX); /* the ring has room for it */
    c->unanswered--;
    struct lw_client_answer *answer =
        &c->answer[(c->answer_first + c->answer_count++) % LW_CLIENT_UPDATES_MAX];
    *answer = (struct lw_client_answer){.request = updated->request,
                                        .code = updated->code,
                                        .change = updated->change,
                                        .frame = updated->frame,
                                        .added = added,
                                        .added_count = updated->added_count};
    snprintf(answer->text, sizeof answer->text, "%s", updated->text ? updated->text : "");
    return LW_OK;
}

static enum lw_status handle_report(struct lw_client *c, const struct lw_message_report *report,
                                    struct lw_error *err) {
    if (!c->asked || report->request != c->asked || c->report) return out_of_order(err, LW_MESSAGE_REPORT);
    if (!(c->report = malloc(report->size + 1)))
        return lw_status_fail(err, LW_NO_MEMORY, "message REPORT: out of memory");
    if (report->size) memcpy(c->report, report->data, report->size);
    c->report[report->size] = '\0';
    c->report_code = report->code;
    return LW_OK;
}

static enum lw_status handle_waiting(struct lw_client *c, const struct lw_message_waiting *waiting,
                                     struct lw_error *err) {
    if (!c->welcomed) return out_of_order(err, LW_MESSAGE_WAITING);
    if (c->waiting.stage == LW_WAITING_READY) return LW_OK; /* the server may mean something new by it */
    const bool is_known = waiting->stage < LW_WAITING_STAGE_COUNT;
    c->waiting.stage = is_known ? (enum lw_waiting_stage)waiting->stage : LW_WAITING_UNKNOWN;
    c->waiting.share = waiting->share;
    return LW_OK;
}

static enum lw_status handle_ping(struct lw_client *c, uint64_t token, struct lw_error *err) {
    struct lw_message pong = {.type = LW_MESSAGE_PONG, .pong.token = token};
    return lw_link_send(&c->link, &pong, err);
}

static enum lw_status handle_message(struct lw_client *c, const struct lw_message *m, struct lw_error *err) {
    switch (m->type) {
    case LW_MESSAGE_WELCOME:
        return handle_welcome(c, &m->welcome, err);
    case LW_MESSAGE_REFUSAL:
        return handle_refusal(c, &m->refusal, err);
    case LW_MESSAGE_PACKAGE_CHUNK:
        return handle_chunk(c, &m->package_chunk, err);
    case LW_MESSAGE_FINISH_CHUNK:
        return handle_finish_chunk(c, &m->finish_chunk, err);
    case LW_MESSAGE_FRAME:
        return handle_frame(c, &m->frame, err);
    case LW_MESSAGE_TILE:
        return handle_tile(c, &m->tile, err);
    case LW_MESSAGE_SETTLED:
        return handle_settled(c, m->settled.frame, err);
    case LW_MESSAGE_UPDATED:
        return handle_updated(c, &m->updated, err);
    case LW_MESSAGE_REPORT:
        return handle_report(c, &m->report, err);
    case LW_MESSAGE_WAITING:
        return handle_waiting(c, &m->waiting, err);
    case LW_MESSAGE_PING:
        return handle_ping(c, m->ping.token, err);
    case LW_MESSAGE_PONG:
        return LW_OK;
    default:
        return lw_status_fail(err, LW_PROTOCOL, "message %s: not one that a server sends",
                              lw_message_name((uint16_t)m->type));
    }
}

/* Handles the next whole message, if there is one. Types that we do not know are from a newer server:
 * skipped. */
static enum lw_status take_one(struct lw_client *c, bool *out_taken, struct lw_error *err) {
    struct lw_framing_header header;
    struct lw_message message;
    const uint8_t *body;
    enum lw_status status = lw_link_take(&c->link, &header, &body, err);
    *out_taken = status == LW_OK && body;
    if (!*out_taken || !lw_message_name(header.type)) return status;
    status = lw_message_decode_with(header, body, &c->memory, &message, err);
    if (status != LW_OK) return status;
    status = handle_message(c, &message, err);
    lw_message_finish(&message);
    return status;
}

/* Handles messages that were read until a time (lw_clock_ns), but one at least. Before the welcome it stops
 * there: further messages belong to lw_client_poll(). */
static enum lw_status take_buffered(struct lw_client *c, uint64_t end_ns, bool *out_any,
                                    struct lw_error *err) {
    const bool was_welcomed = c->welcomed;
    *out_any = false;
    for (bool taken = true; taken && c->welcomed == was_welcomed && (!*out_any || lw_clock_ns() < end_ns);) {
        enum lw_status status = take_one(c, &taken, err);
        if (status != LW_OK) {
            lw_status_context(err, "%s", c->link.address);
            return status;
        }
        *out_any |= taken;
    }
    return LW_OK;
}

/* Reads and handles messages, within the bounds of one call. */
static enum lw_status take_all(struct lw_client *c, uint64_t end_ns, struct lw_error *err) {
    const uint64_t end_bytes = c->link.bytes_received + POLL_BYTES_MAX;
    const bool was_welcomed = c->welcomed;
    size_t size = 1;
    struct lw_error link_err = {0};
    enum lw_status link_status = LW_OK;
    while (size && link_status == LW_OK) {
        bool any;
        link_status = lw_link_receive(&c->link, &size, &link_err);
        /* also after the link's end: a refusal may be the last message */
        enum lw_status status = take_buffered(c, end_ns, &any, err);
        LW_INVARIANT(c->stats.bytes <= c->bytes_before + c->link.bytes_received);
        c->stats.bytes = c->bytes_before + c->link.bytes_received;
        if (status != LW_OK) return status;
        if (c->welcomed != was_welcomed) return LW_OK;
        if (c->link.bytes_received >= end_bytes || lw_clock_ns() >= end_ns) break;
    }
    return link_status == LW_OK ? LW_OK : lw_status_fail(err, link_status, "%s", link_err.text);
}

/* ---- what we say ---- */

_Static_assert(LW_CLIENT_INTEREST_MAX == LW_MESSAGE_INTEREST_MAX, "a list fits into a message");
_Static_assert(LW_LINK_OUTBOX_SIZE > 12 * LW_MESSAGE_INTEREST_MAX + 64, "and the message into the outbox");

/* Drops tiles of finer levels that are in neither list, ours or the sent one: the server sends them no
 * more, so that they would show old light. */
static void drop_unlisted(struct lw_client *c) {
    const struct lw_atlas_map *map = lw_replica_atlas_map(c->replica);
    for (uint32_t t = map->plain_count; t < map->tile_count; t++)
        if (lw_atlas_map_is_used(map, (lw_tile_id){t}) && !lw_interest_lists(&c->interest, (lw_tile_id){t}))
            lw_replica_release_fine(c->replica, (lw_tile_id){t});
}

/* Sends the interest set if it has changed. While the link is busy it waits: a later set may replace this
 * one. */
static enum lw_status send_interest(struct lw_client *c, struct lw_error *err) {
    const struct lw_interest_list *now = &c->interest.now;
    const uint64_t now_ns = lw_clock_ns();
    if (c->link.outbox_size || !lw_interest_is_due(&c->interest, now_ns)) return LW_OK;
    if (!c->interest_tile) c->interest_tile = malloc(LW_CLIENT_INTEREST_MAX * sizeof *c->interest_tile);
    if (!c->interest_scratch) c->interest_scratch = malloc(INTEREST_SCRATCH_SIZE);
    if (!c->interest_tile || !c->interest_scratch) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    LW_INVARIANT(now->count <= LW_CLIENT_INTEREST_MAX && (!now->count || c->replica));
    size_t count = 0;
    for (uint32_t i = 0; i < now->count; i++) {
        const struct lw_atlas_map *map = lw_replica_atlas_map(c->replica);
        const struct lw_tile_place *place = &map->place[now->tile[i].v];
        if (lw_atlas_finer(place->level) > c->finer) continue; /* another server may have fewer levels */
        c->interest_tile[count++] = (struct lw_message_interest_tile){place->object, place->level,
                                                                      lw_atlas_map_number(map, now->tile[i])};
    }
    struct lw_message message = {.type = LW_MESSAGE_INTEREST,
                                 .interest = {.everything = now->everything,
                                              .stand_ins = true,
                                              .tile = c->interest_tile,
                                              .tile_count = count},
                                 .scratch = c->interest_scratch,
                                 .scratch_size = INTEREST_SCRATCH_SIZE};
    enum lw_status status = lw_link_send(&c->link, &message, err);
    if (status != LW_OK) return status;
    if (lw_interest_tell(&c->interest, now_ns) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (c->replica) drop_unlisted(c);
    return LW_OK;
}

/* Views give out ids before anybody lists the tiles: with less than this share left, those go at once. */
#define FINE_FREE 4

static bool lacks_ids(const struct lw_atlas_map *map) {
    return map->fine && lw_fine_ids_free_count(map->fine) < LW_REPLICA_FINE_MAX / FINE_FREE;
}

/* Ids of finer levels that have become free stand for no tile. */
static void leave_out_free(struct lw_interest_list *list, const struct lw_atlas_map *map) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < list->count; i++)
        if (lw_atlas_map_is_used(map, list->tile[i])) list->tile[kept++] = list->tile[i];
    list->count = kept;
}

enum lw_status lw_client_want(struct lw_client *c, const lw_tile_id *tile, size_t count) {
    const struct lw_atlas_map *map = c->replica ? lw_replica_atlas_map(c->replica) : NULL;
    for (size_t i = 0; i < count; i++)
        if (!map || tile[i].v >= map->tile_count) return LW_USAGE;
    enum lw_status status = lw_interest_set(&c->interest, tile, count, LW_CLIENT_INTEREST_MAX);
    if (status != LW_OK || !map) return status;
    leave_out_free(&c->interest.now, map);
    if (lacks_ids(map)) drop_unlisted(c);
    return LW_OK;
}

void lw_client_want_everything(struct lw_client *c) { lw_interest_set_everything(&c->interest); }

_Static_assert(LW_CLIENT_CHANGES_MAX == LW_MESSAGE_CHANGES_MAX, "an update fits into a message");
_Static_assert(LW_LINK_OUTBOX_SIZE > LW_CLIENT_CHANGES_MAX * 60 + 64, "and the message into the outbox");

bool lw_client_may_update(const struct lw_client *c) { return c->may_update; }

enum lw_status lw_client_update(struct lw_client *c, const struct lw_scene_change *change, size_t count,
                                uint64_t *out_request, struct lw_error *err) {
    if (!c->may_update)
        return lw_status_fail(
            err, LW_UNAVAILABLE,
            "%s takes no updates from here: that takes its own machine, or a token for control",
            c->link.address);
    if (count > LW_CLIENT_CHANGES_MAX)
        return lw_status_fail(err, LW_USAGE, "an update has at most %u changes", LW_CLIENT_CHANGES_MAX);
    for (size_t i = 0; i < count; i++)
        if (change[i].value_count > LW_SCENE_CHANGE_VALUES_MAX)
            return lw_status_fail(err, LW_USAGE, "a change has at most %u values",
                                  LW_SCENE_CHANGE_VALUES_MAX);
    if (!c->answer && !(c->answer = calloc(LW_CLIENT_UPDATES_MAX, sizeof *c->answer)))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    const struct lw_message message = {
        .type = LW_MESSAGE_UPDATE,
        .update = {.request = c->updates_sent + 1, .change = change, .change_count = count}};
    bool fits = false;
    enum lw_status status = LW_OK;
    if (c->unanswered + c->answer_count < LW_CLIENT_UPDATES_MAX)
        status = lw_link_fits(&c->link, &message, &fits, err);
    if (status == LW_OK && !fits)
        status = lw_status_fail(err, LW_TIMED_OUT, "%s has other updates to answer first", c->link.address);
    if (status == LW_OK) status = lw_link_send(&c->link, &message, err);
    if (status != LW_OK) return status;
    c->unanswered++;
    LW_INVARIANT(c->unanswered + c->answer_count <= LW_CLIENT_UPDATES_MAX);
    c->updates_sent++;
    if (out_request) *out_request = c->updates_sent;
    return LW_OK;
}

bool lw_client_next_answer(struct lw_client *c, struct lw_client_answer *out_answer) {
    if (!c->answer_count) return false;
    LW_INVARIANT(c->answer_count <= LW_CLIENT_UPDATES_MAX && c->answer_first < LW_CLIENT_UPDATES_MAX);
    *out_answer = c->answer[c->answer_first];
    free(c->added);
    c->added = (uint32_t *)out_answer->added;
    c->answer_first = (c->answer_first + 1) % LW_CLIENT_UPDATES_MAX;
    c->answer_count--;
    return true;
}

bool lw_client_may_ask(const struct lw_client *c) { return c->may_ask; }

enum lw_status lw_client_ask(struct lw_client *c, uint32_t what, uint32_t return_after_ms,
                             struct lw_error *err) {
    if (!c->may_ask)
        return lw_status_fail(
            err, LW_NOT_ALLOWED,
            "%s answers operators over its own Unix socket alone: as its user or root, on its "
            "machine (lightwelld --control-socket)",
            c->link.address);
    free(c->report); /* nobody has taken it */
    c->report = NULL;
    const struct lw_message message = {.type = LW_MESSAGE_ASK, .ask = {++c->asked, what, return_after_ms}};
    return lw_link_send(&c->link, &message, err);
}

bool lw_client_take_report(struct lw_client *c, uint32_t *out_code, char **out_text) {
    if (!c->report) return false;
    *out_code = c->report_code;
    *out_text = c->report;
    c->report = NULL;
    return true;
}

/* ---- create, poll, destroy ---- */

static enum lw_status send_first(struct lw_client *c, const struct lw_message *message,
                                 struct lw_error *err) {
    enum lw_status status = lw_link_send(&c->link, message, err);
    if (status == LW_OK && c->link.outbox_size > LW_LINK_OUTBOX_SIZE / 2)
        return lw_status_fail(err, LW_CLOSED, "%s takes no data", c->link.address);
    return status;
}

/* Asks for its missing part; with a scene for its end: there is nothing to send. */
static enum lw_status ask_for_package(struct lw_client *c, struct lw_error *err) {
    struct lw_message request = {.type = LW_MESSAGE_PACKAGE_REQUEST,
                                 .package_request.offset = c->package_compressed_size};
    uint8_t *held = NULL;
    if (!c->replica && lw_download_request(&c->download, &request.package_request, &held) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    enum lw_status status = send_first(c, &request, err);
    free(held);
    return status;
}

/* Once there is light that can be shown. */
static enum lw_status ask_for_finishes(struct lw_client *c, struct lw_error *err) {
    struct lw_message request = {.type = LW_MESSAGE_FINISH_REQUEST};
    struct lw_download *d = &c->finish_download;
    uint8_t *held = NULL;
    if (c->finishes != LW_CLIENT_FINISHES_COMING || c->finish_asked || !c->replica || !c->stats.frame ||
        !lw_replica_has_first(c->replica))
        return LW_OK;
    LW_INVARIANT(d->zstd && !lw_download_is_complete(d));
    c->finish_asked = true;
    if (c->cache_folder) {
        lw_download_find_held(d, find_part, c);
        enum lw_status status = lw_download_begin(d, err);
        if (status != LW_OK || lw_download_is_complete(d)) return status ? status : take_finishes(c, err);
    }
    if (lw_download_request(d, &request.finish_request, &held) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    enum lw_status status = lw_link_send(&c->link, &request, err);
    free(held);
    return status;
}

#define HOLDS_AT_ONCE 1024u /* leaves room in the outbox for messages that must not be dropped */

/* Sends the list of tiles that the server need not send. Where the link is busy some are left out: they come
 * again. */
static enum lw_status send_held_tiles(struct lw_client *c, struct lw_error *err) {
    const struct lw_atlas_map *map = lw_replica_atlas_map(c->replica);
    struct lw_message_held *held = malloc(HOLDS_AT_ONCE * sizeof *held);
    if (!held) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    size_t count = 0;
    enum lw_status status = LW_OK;
    for (uint32_t t = 0; status == LW_OK && !c->link.outbox_size && t < map->plain_count; t++) {
        const uint64_t version = lw_replica_version_of_run(c->replica, (lw_tile_id){t});
        const struct lw_tile_place *p = &map->place[t];
        LW_INVARIANT(count < HOLDS_AT_ONCE);
        if (version)
            held[count++] = (struct lw_message_held){p->object, p->level,
                                                     lw_atlas_map_number(map, (lw_tile_id){t}), version};
        if (count < HOLDS_AT_ONCE && (!count || t + 1 < map->plain_count)) continue;
        const struct lw_message message = {.type = LW_MESSAGE_HOLDS,
                                           .holds = {.tile = held, .tile_count = count}};
        status = lw_link_send(&c->link, &message, err);
        count = 0;
    }
    free(held);
    return status;
}

/* Says which frame it has, so that no earlier one comes, and which tiles. */
static enum lw_status send_held(struct lw_client *c, struct lw_error *err) {
    const struct lw_message frame = {.type = LW_MESSAGE_HOLDS, .holds.frame = c->stats.frame};
    if (!c->replica || !c->may_hold) return LW_OK;
    const enum lw_status status = c->stats.frame ? lw_link_send(&c->link, &frame, err) : LW_OK;
    return status == LW_OK ? send_held_tiles(c, err) : status;
}

/* Until there is something to read, or a deadline. */
static enum lw_status wait_for_server(struct lw_client *c, uint64_t deadline_ns, struct lw_error *err) {
    if (!c->watch.wait || deadline_ns <= lw_clock_ns()) return lw_link_wait(&c->link, deadline_ns, err);
    if (!c->watch.wait(c->watch.context, c->link.socket, c->link.outbox_size > 0, deadline_ns))
        return lw_status_fail(err, LW_CLOSED, "the session is to end");
    return lw_link_wait(&c->link, 0, err); /* it pings, too */
}

static enum lw_status shake_hands(struct lw_client *c, struct lw_error *err) {
    uint64_t deadline_ns = lw_clock_ns() + c->timeout_ms * 1000000ull;
    struct lw_message hello = {.type = LW_MESSAGE_HELLO,
                               .hello = {.version = LW_WIRE_VERSION,
                                         .features = offered_features(c),
                                         .name = c->name,
                                         .rate_limit_bytes_hz = c->rate_limit_bytes_hz,
                                         .token = c->access.has_token ? c->access.token.bytes : NULL}};
    if (lw_message_validate(&hello, NULL) != LW_OK)
        return lw_status_fail(err, LW_USAGE,
                              "a client's name is at most %u bytes of UTF-8, without control characters",
                              LW_MESSAGE_NAME_MAX);
    struct lw_error cause = {0};
    enum lw_status status = send_first(c, &hello, &cause);
    while (status == LW_OK && !c->welcomed) {
        if (lw_clock_ns() >= deadline_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "%s does not answer: is it a lightwelld?",
                                  c->link.address);
        status = wait_for_server(c, deadline_ns, &cause);
        if (status == LW_OK) status = take_all(c, deadline_ns, &cause);
    }
    if (status == LW_OK && c->operate) return LW_OK;
    if (status == LW_OK) status = send_interest(c, &cause); /* before tiles can come */
    if (status == LW_OK) status = send_held(c, &cause);
    if (status == LW_OK) return ask_for_package(c, err);
    /* a peer that closes before WELCOME, or sends garbage, is no lightwelld */
    if (status == LW_PROTOCOL || status == LW_CLOSED)
        return lw_status_fail(err, LW_PROTOCOL, "no welcome from a lightwelld of this version: %s",
                              cause.text);
    return lw_status_fail(err, status, "%s", cause.text);
}

static enum lw_status connect_and_greet(struct lw_client *c, struct lw_error *err) {
    struct lw_link *fresh = malloc(sizeof *fresh); /* the client's own may be looked at meanwhile */
    if (!fresh) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (c->watch.leave) c->watch.leave(c->watch.context);
    enum lw_status status = lw_link_connect(
        fresh,
        &(struct lw_link_desc){.host = c->servers.host,
                               .port = c->servers.port,
                               .timeout_ms = c->timeout_ms,
                               .prefers_local = c->operate || (c->control && !c->access.has_token),
                               .tls = c->trust},
        err);
    if (c->watch.enter) c->watch.enter(c->watch.context);
    if (status == LW_OK) c->link = *fresh;
    free(fresh);
    return status == LW_OK ? shake_hands(c, err) : status;
}

enum lw_status lw_client_reconnect(struct lw_client *c, struct lw_error *err) {
    const uint64_t bytes_before = c->bytes_before + c->link.bytes_received;
    lw_link_finish(&c->link);
    c->link.bytes_received = c->link.outbox_size = 0;
    c->bytes_before = bytes_before;
    c->welcomed = c->may_update = c->found_other_scene = false;
    c->retry_after_ms = 0;
    c->unanswered = 0;
    c->frame_acked = c->stats.frame; /* the next one that comes is news to the server */
    lw_interest_forget(&c->interest);
    if (lw_servers_next(&c->servers) != LW_OK) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    const bool is_announced = lw_servers_is_announced(&c->servers);
    const uint64_t run = c->run;
    enum lw_status status = connect_and_greet(c, err);
    /* its server has named this one, but it lights something else: others are tried */
    if (is_announced && c->found_other_scene) {
        c->found_other_scene = false;
        c->run = run;
        if (err) err->status = LW_UNAVAILABLE;
        status = LW_UNAVAILABLE;
    }
    return status;
}

#define BACKOFF_FIRST_MS 50u
#define BACKOFF_MOST_MS  500u

unsigned lw_client_backoff_ms(unsigned attempt, uint32_t seed) {
    const unsigned least = attempt < 4 ? BACKOFF_FIRST_MS << attempt : BACKOFF_MOST_MS;
    return least + lw_random_hash2(seed, attempt) % (least + 1);
}

unsigned lw_client_return_ms(uint32_t retry_after_ms, unsigned attempt, uint32_t seed) {
    if (!retry_after_ms || attempt) return lw_client_backoff_ms(attempt, seed);
    return retry_after_ms + lw_random_hash2(seed, retry_after_ms) % (retry_after_ms / 2 + 1);
}

uint32_t lw_client_retry_after_ms(const struct lw_client *c) { return c->retry_after_ms; }

bool lw_client_found_other_scene(const struct lw_client *c) { return c->found_other_scene; }

static void drop_answers(struct lw_client *c) {
    for (; c->answer_count; c->answer_count--)
        free((uint32_t *)c->answer[c->answer_first++ % LW_CLIENT_UPDATES_MAX].added);
    c->answer_first = 0;
    free(c->added);
    c->added = NULL;
}

void lw_client_forget_scene(struct lw_client *c) {
    lw_replica_destroy(c->replica);
    c->replica = NULL;
    lw_download_finish(&c->download);
    lw_download_finish(&c->finish_download);
    c->finishes = LW_CLIENT_FINISHES_NONE;
    lw_draws_finish(&c->draws);
    lw_interest_finish(&c->interest);
    lw_interest_init(&c->interest);
    c->interest.now.everything = !c->wants_nothing;
    drop_answers(c);
    c->scene_of = NULL; /* it has the scene that is over */
    c->watch_has_scene = c->may_hold = c->found_other_scene = false;
    c->run = c->frame_acked = c->frame_ns = c->frame_solve_ns = 0;
    c->stats.frame = c->stats.settled_frame = c->stats.changed_frame = 0;
    c->stats.package_ns = c->stats.first_ns = c->stats.finishes_ns = 0;
    c->stats.time_s = 0;
}

enum lw_status lw_client_create(const struct lw_client_desc *desc, struct lw_client **out_client,
                                struct lw_error *err) {
    struct lw_client *c = calloc(1, sizeof *c);
    if (!c) return lw_status_fail(err, LW_NO_MEMORY, "cannot create a client: out of memory");
    c->link.socket = -1;
    c->stats.connected_ns = lw_clock_ns();
    c->scene_of = desc->scene_of;
    if (desc->access) c->access = *desc->access;
    c->timeout_ms = desc->timeout_ms ? desc->timeout_ms : TIMEOUT_DEFAULT_MS;
    c->control = desc->control;
    c->operate = desc->operate;
    c->draws_direct = desc->draws_direct;
    c->materials = desc->materials;
    c->finer_max = desc->finer < LW_ATLAS_FINER_MAX ? desc->finer : LW_ATLAS_FINER_MAX;
    c->channel_features = desc->channel_features;
    c->rate_limit_bytes_hz = desc->rate_limit_bytes_hz;
    c->budget_ns = desc->budget_ns ? desc->budget_ns : BUDGET_DEFAULT_NS;
    c->watch = desc->watch;
    lw_interest_init(&c->interest);
    c->wants_nothing = desc->wants_nothing;
    c->interest.now.everything = !desc->wants_nothing;
    c->name = strdup(desc->name ? desc->name : "liblightwell");
    c->cache_folder = desc->cache_folder ? strdup(desc->cache_folder) : NULL;
    enum lw_status status = lw_servers_init(&c->servers, desc->host, desc->port) == LW_OK && c->name &&
                                    (c->cache_folder || !desc->cache_folder)
                                ? lw_tls_trust_create(&c->access.tls, &c->trust, err)
                                : lw_status_fail(err, LW_NO_MEMORY, "cannot create a client: out of memory");
    c->access.tls.ca = NULL; /* it is the caller's */
    if (status == LW_OK) status = connect_and_greet(c, err);
    if (status == LW_OK)
        *out_client = c;
    else
        lw_client_destroy(c);
    return status;
}

const uint8_t *lw_client_package_hash(const struct lw_client *c) {
    static_assert(sizeof c->package_hash.bytes == LW_CLIENT_HASH_SIZE, "client.h says how long it is");
    return c->package_hash.bytes;
}

void lw_client_destroy(struct lw_client *c) {
    if (!c) return;
    lw_replica_destroy(c->replica);
    lw_download_finish(&c->download);
    lw_download_finish(&c->finish_download);
    lw_draws_finish(&c->draws);
    lw_link_finish(&c->link);
    lw_tls_trust_unref(c->trust);
    lw_interest_finish(&c->interest);
    drop_answers(c);
    free(c->answer);
    free(c->report);
    free(c->interest_tile);
    free(c->interest_scratch);
    lw_message_memory_finish(&c->memory);
    lw_servers_finish(&c->servers);
    free(c->name);
    free(c->cache_folder);
    free(c);
}

static enum lw_status wait_and_take(struct lw_client *c, unsigned timeout_ms, struct lw_error *err) {
    const uint64_t began_ns = lw_clock_ns();
    bool any; /* what came along with the welcome, or there was no time for */
    enum lw_status status = take_buffered(c, began_ns + c->budget_ns, &any, err);
    if (status == LW_OK) status = send_interest(c, err);
    if (status == LW_OK) status = wait_for_server(c, any ? 0 : lw_clock_ns() + timeout_ms * 1000000ull, err);
    const uint64_t now_ns = lw_clock_ns(), end_ns = (any ? began_ns : now_ns) + c->budget_ns;
    if (status == LW_OK && now_ns < end_ns) status = take_all(c, end_ns, err);
    if (status == LW_OK) status = ask_for_finishes(c, err);
    if (status != LW_OK || c->frame_acked == c->stats.frame) return status;
    c->frame_acked = c->stats.frame;
    struct lw_message ack = {.type = LW_MESSAGE_ACK, .ack.frame = c->stats.frame};
    return lw_link_send(&c->link, &ack, err);
}

enum lw_status lw_client_poll(struct lw_client *c, unsigned timeout_ms, struct lw_error *err) {
    enum lw_status status = wait_and_take(c, timeout_ms, err);
    /* A server that said goodbye waits for our end of the link; the client may live on with what it has. */
    if (status != LW_OK) lw_link_hang_up(&c->link);
    return status;
}

int lw_client_descriptor(const struct lw_client *c) { return c->link.socket; }

/* ---- scene, light, figures ---- */

const struct lw_scene *lw_client_scene(const struct lw_client *c) {
    return c->replica ? lw_replica_scene(c->replica) : NULL;
}

enum lw_client_finishes lw_client_finishes(const struct lw_client *c) { return c->finishes; }

float lw_client_package_progress(const struct lw_client *c) {
    return c->replica ? 1.0f : (float)((double)c->download.received / (double)c->download.compressed_size);
}

const struct lw_atlas_map *lw_client_atlas_map(const struct lw_client *c) {
    return c->replica ? lw_replica_atlas_map(c->replica) : NULL;
}

uint32_t lw_client_finer(const struct lw_client *c) {
    const uint32_t levels = c->replica ? lw_replica_atlas_map(c->replica)->finer_count : 0;
    return c->finer < levels ? c->finer : levels;
}

const struct lw_affine *lw_client_object_to_world(const struct lw_client *c, uint32_t object) {
    return c->replica ? lw_replica_object_to_world(c->replica, object) : NULL;
}

bool lw_client_object_hidden(const struct lw_client *c, uint32_t object) {
    return c->replica && lw_replica_object_hidden(c->replica, object);
}

enum lw_client_object_state lw_client_object_state(const struct lw_client *c, uint32_t object) {
    return c->replica ? lw_replica_object_state(c->replica, object) : LW_CLIENT_OBJECT_SPARE;
}

struct lw_client_light lw_client_get_light(const struct lw_client *c, uint32_t light) {
    const struct lw_light_state *state = c->replica ? lw_replica_light(c->replica, light) : NULL;
    if (!state) return (struct lw_client_light){0};
    return (struct lw_client_light){state->position_ws, state->direction_ws, state->intensity};
}

const struct lw_client_draws *lw_client_draws(const struct lw_client *c) {
    return c->draws.has_scene ? &c->draws.of : NULL;
}

struct lw_vec3 lw_client_own_emission(const struct lw_client *c, uint32_t material) {
    const struct lw_scene *own = c->replica ? lw_replica_own_scene(c->replica) : NULL;
    if (!own || material >= own->material_count) return lw_vec3(0, 0, 0);
    const float *emission = own->material[material].emission;
    return lw_vec3(emission[0], emission[1], emission[2]);
}

struct lw_client_level lw_client_get_level(const struct lw_client *c, uint32_t object, uint32_t level) {
    return c->replica ? lw_replica_get_level(c->replica, object, level) : (struct lw_client_level){0};
}

const float *lw_client_get_texels(const struct lw_client *c, uint32_t slot, uint32_t object, uint32_t level) {
    return c->replica ? lw_replica_get_texels(c->replica, slot, object, level) : NULL;
}

struct lw_client_tile lw_client_get_tile(const struct lw_client *c, lw_tile_id tile) {
    return c->replica ? lw_replica_get_tile(c->replica, tile) : (struct lw_client_tile){0};
}

struct lw_waiting_state lw_client_waiting(const struct lw_client *c) {
    return c->waiting;
}

void lw_client_get_stats(const struct lw_client *c, struct lw_client_stats *out_stats) {
    *out_stats = c->stats;
    if (c->frame_ns) out_stats->light_age_ns = c->frame_solve_ns + (lw_clock_ns() - c->frame_ns);
}
