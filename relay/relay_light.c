#include "relay/relay_light.h"

#include "common/base/invariant.h"
#include "common/scene/package.h"
#include "common/scene/pose.h"
#include "common/tile/tile_codec.h"
#include "relay/relay_fine.h"
#include "server/publish/frame_message.h"
#include "server/serve/sessions/passed_updates.h"
#include "server/serve/tiles/transcoder.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define SCALE_MAX 0x1p60f /* for codec 4 */
/* Frames between the beginnings of runs that are joined: no run comes to the frames of the next. */
#define RUN_FRAMES LW_PASSED_UPDATES_RUN_FRAMES
#define FRAME_MAX  (UINT64_MAX / 4) /* versions are twice as large */

struct tile {
    uint64_t version; /* 0: none */
    uint32_t codec;
    struct lw_blob *whole;
    uint64_t base; /* the version that `delta` builds on */
    struct lw_blob *delta;
    uint64_t published; /* the version that a snapshot had last; 0: none */
    struct lw_blob *published_whole;
    /* For finer levels alone: */
    uint64_t above;   /* the version that the server above calls it by; 0: no delta builds on it */
    bool is_in_doubt; /* the server above has not sent it, and may not have it */
};

/* What the session of a channel has said. */
struct feed {
    bool is_open, follows; /* follows: more parts of the frame may come */
    uint64_t frame, settled;
    struct lw_message_frame header; /* the frame's, without lists */
    struct lw_pose pose;
    bool has_pose;
    struct tile *tile; /* by tile id; NULL before the first session */
    uint32_t coarsest_missing;
};

struct lw_relay_light {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    bool has_map;
    struct lw_relay_fine fine;
    struct lw_tile_codec *codec;
    struct feed feed[LW_TILE_CHANNELS_MAX];
    uint64_t run;            /* run named in snapshots; 0: none */
    uint64_t before;         /* frames before the first of this run; a multiple of RUN_FRAMES */
    bool changed, completed; /* since the last snapshot: anything came; a SETTLED came */
    uint64_t frame;          /* the last snapshot's; 0: there was none */
    uint64_t previous_frame; /* the last snapshot's with an earlier frame */
    double time_s;           /* the last snapshot's */
    struct lw_pose pose;     /* as of the last snapshot */
    bool has_pose;
    struct lw_blob *frame_delta, *frame_full, *settled; /* the last snapshot's */
    uint8_t *payload;                                   /* lw_tile_codec_bound() */
    float texels[LW_TILE_TEXELS_MAX * LW_TILE_CHANNEL_PLANES_MAX];
};

/* ---- create ---- */

static enum lw_status complete(struct lw_relay_light *light, uint32_t finer) {
    enum lw_status status =
        lw_atlas_map_init_finer(&light->map, light->scene, finer, finer ? LW_RELAY_LIGHT_FINE_MAX : 0);
    light->has_map = status == LW_OK;
    if (status == LW_OK) status = lw_relay_fine_init(&light->fine, &light->map);
    if (status == LW_OK) status = lw_tile_codec_create(&light->codec);
    if (status == LW_OK && !(light->payload = malloc(lw_tile_codec_bound()))) status = LW_NO_MEMORY;
    if (status == LW_OK) {
        status = lw_pose_init(&light->pose, light->scene);
        light->has_pose = status == LW_OK;
    }
    return status;
}

enum lw_status lw_relay_light_create(const uint8_t *package, size_t size, uint32_t finer,
                                     struct lw_relay_light **out_light, struct lw_error *err) {
    struct lw_relay_light *light = calloc(1, sizeof *light);
    if (!light) return lw_status_fail(err, LW_NO_MEMORY, "scene package: out of memory");
    enum lw_status status = lw_package_read(package, size, &light->scene, err);
    if (status == LW_OK && (status = complete(light, finer)) != LW_OK)
        lw_status_fail(err, status, "scene package: %s", lw_status_text(status));
    if (status == LW_OK)
        *out_light = light;
    else
        lw_relay_light_destroy(light);
    return status;
}

static void finish_feed(const struct lw_relay_light *light, struct feed *feed) {
    for (uint32_t t = 0; feed->tile && t < light->map.tile_count; t++) {
        lw_blob_unref(feed->tile[t].whole);
        lw_blob_unref(feed->tile[t].delta);
        lw_blob_unref(feed->tile[t].published_whole);
    }
    free(feed->tile);
    if (feed->has_pose) lw_pose_finish(&feed->pose);
}

void lw_relay_light_destroy(struct lw_relay_light *light) {
    if (!light) return;
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) finish_feed(light, &light->feed[c]);
    lw_blob_unref(light->frame_delta);
    lw_blob_unref(light->frame_full);
    lw_blob_unref(light->settled);
    if (light->has_pose) lw_pose_finish(&light->pose);
    free(light->payload);
    lw_tile_codec_destroy(light->codec);
    lw_relay_fine_finish(&light->fine);
    if (light->has_map) lw_atlas_map_finish(&light->map);
    lw_scene_destroy(light->scene);
    free(light);
}

const struct lw_scene *lw_relay_light_scene(const struct lw_relay_light *light) { return light->scene; }
const struct lw_atlas_map *lw_relay_light_map(const struct lw_relay_light *light) { return &light->map; }

/* ---- tiles of finer levels ---- */

/* Nobody lists it any more. What clients had of it counts on for the case that they list it again. */
static void drop_fine(struct lw_relay_light *light, struct tile *tile) {
    const uint64_t published = tile->published;
    if (tile->version) light->changed = true;
    lw_blob_unref(tile->whole);
    lw_blob_unref(tile->delta);
    lw_blob_unref(tile->published_whole);
    *tile = (struct tile){.published = published};
}

/* Clients drop it, by the smallest version that is news to them. Where the frame has no room for that version
 * the tile stays in doubt: it is as new as the frame. */
static enum lw_status withdraw_fine(struct lw_relay_light *light, uint32_t channel, uint32_t id) {
    static const uint8_t nothing = 0;
    const struct feed *feed = &light->feed[channel];
    struct tile *tile = &feed->tile[id];
    const uint64_t newest = tile->version > tile->published ? tile->version : tile->published;
    const struct lw_tile_place *place = &light->map.place[id];
    struct lw_blob *blob;
    tile->above = 0;
    tile->is_in_doubt = newest > 0;
    if (!newest || newest >= lw_snapshot_version(feed->frame)) return LW_OK;
    const struct lw_message message = {.type = LW_MESSAGE_TILE,
                                       .tile = {.object = place->object,
                                                .level = place->level,
                                                .tile = lw_atlas_map_number(&light->map, (lw_tile_id){id}),
                                                .version = newest + 1,
                                                .layer = channel,
                                                .codec = LW_TILE_CODEC_NONE,
                                                .scale = 1,
                                                .payload = &nothing,
                                                .payload_size = sizeof nothing}};
    const enum lw_status status = lw_blob_from_message(&message, &blob);
    if (status != LW_OK) return status;
    lw_blob_unref(tile->whole);
    lw_blob_unref(tile->delta);
    tile->version = newest + 1;
    tile->codec = LW_TILE_CODEC_NONE;
    tile->whole = blob;
    tile->delta = NULL;
    tile->base = 0;
    tile->is_in_doubt = false;
    light->changed = true;
    return LW_OK;
}

/* The session that sent them is over. */
static void doubt_fine(struct lw_relay_light *light, struct feed *feed) {
    for (uint32_t id = light->map.plain_count; feed->tile && id < light->map.tile_count; id++) {
        struct tile *tile = &feed->tile[id];
        tile->above = 0;
        tile->is_in_doubt = tile->version && tile->codec != LW_TILE_CODEC_NONE;
    }
}

/* Returns whether any was dropped. */
static bool review_fine(struct lw_relay_light *light) {
    bool dropped = false;
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        struct feed *feed = &light->feed[c];
        for (uint32_t id = light->map.plain_count; feed->tile && id < light->map.tile_count; id++) {
            struct tile *tile = &feed->tile[id];
            const struct lw_relay_fine_tile *fine = lw_relay_fine_tile(&light->fine, id);
            if (!tile->version && !tile->published) continue;
            if (!fine->is_listed && !fine->asked) {
                dropped |= tile->version > 0;
                drop_fine(light, tile);
            } else if (fine->is_listed && feed->is_open && !(fine->asked >> c & 1) &&
                       tile->codec != LW_TILE_CODEC_NONE) {
                tile->above = 0; /* clients list it, and the server above is asked for others */
                tile->is_in_doubt = true;
            } else if (!tile->version)
                tile->is_in_doubt = true; /* a client may have it since before it was dropped */
        }
    }
    return dropped;
}

bool lw_relay_light_list(struct lw_relay_light *light, uint64_t number, const uint32_t *tile,
                         uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (tile[i] < light->map.plain_count) continue;
        const uint64_t name = lw_atlas_map_name(&light->map, (lw_tile_id){tile[i]});
        if (lw_relay_fine_tile(&light->fine, tile[i])->name == name) continue;
        for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) { /* the id is another tile's */
            if (!light->feed[c].tile) continue;
            LW_INVARIANT(!light->feed[c].tile[tile[i]].version);
            light->feed[c].tile[tile[i]] = (struct tile){0};
        }
    }
    lw_relay_fine_list(&light->fine, number, tile, count);
    return review_fine(light);
}

void lw_relay_light_ask(struct lw_relay_light *light, uint32_t channel, const lw_tile_id *tile,
                        uint32_t count) {
    lw_relay_fine_ask(&light->fine, channel, tile, count);
    (void)review_fine(light);
}

/* ---- sessions ---- */

static bool is_coarsest(const struct lw_atlas_map *map, uint32_t tile) {
    return map->place[tile].level + 1 == map->atlas[map->place[tile].object]->level_count;
}

void lw_relay_light_begin(struct lw_relay_light *light, uint32_t channel) {
    struct feed *feed = &light->feed[channel];
    LW_INVARIANT(channel < LW_TILE_CHANNELS_MAX && !feed->is_open);
    feed->is_open = true;
    feed->follows = false;
    feed->frame = feed->settled = 0;
    doubt_fine(light, feed);
}

void lw_relay_light_end(struct lw_relay_light *light, uint32_t channel) {
    light->feed[channel].is_open = false;
    lw_relay_light_ask(light, channel, NULL, 0);
}

static bool is_cut_off(const struct lw_relay_light *light) {
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        if (light->feed[c].is_open) return false;
    return true;
}

bool lw_relay_light_begin_run(struct lw_relay_light *light, uint64_t run) {
    uint64_t last =
        light->frame > light->before ? light->frame : light->before; /* the last run may have no frame */
    LW_INVARIANT(run && is_cut_off(light));
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        const struct feed *feed = &light->feed[c];
        if (feed->frame > last) last = feed->frame;
        for (uint32_t t = 0; feed->tile && t < light->map.tile_count; t++)
            if (lw_snapshot_frame_of(feed->tile[t].version) > last)
                last = lw_snapshot_frame_of(feed->tile[t].version);
    }
    const uint64_t before = (last / RUN_FRAMES + 1) * RUN_FRAMES;
    if (before > FRAME_MAX - RUN_FRAMES) return false;
    LW_INVARIANT(before > light->before && before > light->frame);
    light->before = before;
    light->run = run;
    return true;
}

void lw_relay_light_set_run(struct lw_relay_light *light, uint64_t run) { light->run = run; }
uint64_t lw_relay_light_run(const struct lw_relay_light *light) { return light->run; }
uint64_t lw_relay_light_ahead(const struct lw_relay_light *light) { return light->before; }

uint64_t lw_relay_light_count(uint64_t frame, uint64_t ahead) {
    return frame && frame <= FRAME_MAX ? frame + ahead : frame;
}

uint64_t lw_relay_light_frame_for_clients(const struct lw_relay_light *light, uint64_t frame) {
    return lw_relay_light_count(frame, light->before);
}

/* Servers leave out directions of objects that look the same without them: no tile of them is waited for. */
static bool is_awaited(const struct lw_relay_light *light, const struct feed *feed) {
    return !lw_tile_channel_at((uint32_t)(feed - light->feed))->moment;
}

/* What a channel needs, with its first FRAME. */
static enum lw_status make_room(const struct lw_relay_light *light, struct feed *feed) {
    if (!feed->has_pose) {
        if (lw_pose_init(&feed->pose, light->scene) != LW_OK) return LW_NO_MEMORY;
        feed->has_pose = true;
    }
    if (feed->tile) return LW_OK;
    if (!(feed->tile = calloc((size_t)light->map.tile_count + 1, sizeof *feed->tile))) return LW_NO_MEMORY;
    for (uint32_t t = 0; is_awaited(light, feed) && t < light->map.plain_count; t++)
        feed->coarsest_missing += is_coarsest(&light->map, t);
    return LW_OK;
}

static enum lw_status no_such(struct lw_error *err, const char *what, uint32_t number, uint32_t count) {
    return lw_status_fail(err, LW_PROTOCOL, "message FRAME: %s %" PRIu32 " of %" PRIu32, what, number, count);
}

/* The first `spares` of them are. */
static enum lw_status set_hidden(const struct lw_scene *scene, struct lw_pose *pose, const uint32_t *object,
                                 size_t count, size_t spares, bool hidden, struct lw_error *err) {
    for (size_t i = 0; i < count; i++) {
        if (object[i] >= scene->object_count)
            return no_such(err, hidden ? "hidden_object" : "shown_object", object[i], scene->object_count);
        pose->object_hidden[object[i]] = hidden;
        pose->object_spare[object[i]] = i < spares;
    }
    return LW_OK;
}

static enum lw_status set_pose(const struct lw_scene *scene, const struct lw_message_frame *frame,
                               struct lw_pose *pose, struct lw_error *err) {
    for (size_t i = 0; i < frame->transform_count; i++) {
        const struct lw_message_transform *transform = &frame->transform[i];
        if (transform->object >= scene->object_count)
            return no_such(err, "transform_object", transform->object, scene->object_count);
        pose->object_to_world[transform->object] = transform->object_to_world;
    }
    for (size_t i = 0; i < frame->light_count; i++) {
        const struct lw_message_light *light = &frame->light[i];
        if (light->light >= scene->light_count)
            return no_such(err, "light", light->light, scene->light_count);
        pose->light[light->light] =
            (struct lw_light_state){light->position_ws, light->direction_ws, light->intensity};
    }
    for (size_t i = 0; i < frame->material_count; i++) {
        const struct lw_message_material *m = &frame->material[i];
        if (m->material >= scene->material_count)
            return no_such(err, "material", m->material, scene->material_count);
        memcpy(pose->material[m->material].base_colour, m->base_colour, sizeof m->base_colour);
        memcpy(pose->material[m->material].emission, m->emission, sizeof m->emission);
    }
    enum lw_status status =
        set_hidden(scene, pose, frame->hidden, frame->hidden_count, frame->spare_count, true, err);
    return status == LW_OK ? set_hidden(scene, pose, frame->shown, frame->shown_count, 0, false, err)
                           : status;
}

/* Whether another message may carry on with the lists of this one. */
static bool is_full(const struct lw_message_frame *frame) {
    return frame->transform_count == LW_MESSAGE_TRANSFORMS_MAX ||
           frame->light_count == LW_MESSAGE_LIGHTS_MAX || frame->material_count == LW_MESSAGE_MATERIALS_MAX ||
           frame->hidden_count == LW_MESSAGE_VISIBLE_MAX || frame->shown_count == LW_MESSAGE_VISIBLE_MAX;
}

enum lw_status lw_relay_light_take_frame(struct lw_relay_light *light, uint32_t channel,
                                         const struct lw_message_frame *frame, struct lw_error *err) {
    struct feed *feed = &light->feed[channel];
    LW_INVARIANT(feed->is_open);
    const uint64_t last = lw_relay_light_frame(light, channel);
    if (!frame->frame || frame->frame < last || (frame->frame == last && !feed->follows))
        return lw_status_fail(err, LW_PROTOCOL, "message FRAME: number %" PRIu64 " after %" PRIu64,
                              frame->frame, last);
    if (frame->frame > FRAME_MAX - light->before)
        return lw_status_fail(err, LW_PROTOCOL, "message FRAME: numbers have come to their end");
    if (make_room(light, feed) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "message FRAME: out of memory");
    enum lw_status status = set_pose(light->scene, frame, &feed->pose, err);
    if (status != LW_OK) return status;
    feed->frame = frame->frame + light->before;
    feed->header = (struct lw_message_frame){.frame = feed->frame,
                                             .time_s = frame->time_s,
                                             .solve_ns = frame->solve_ns,
                                             .rays_total = frame->rays_total,
                                             .tiles_solved = frame->tiles_solved,
                                             .server_cpu_ns = frame->server_cpu_ns};
    memcpy(feed->header.sky, frame->sky, sizeof frame->sky);
    feed->follows = is_full(frame);
    light->changed = true;
    return LW_OK;
}

/* ---- tiles ---- */

static enum lw_status bad_tile(struct lw_error *err, const struct lw_message_tile *t, const char *why) {
    return lw_status_fail(err, LW_PROTOCOL,
                          "message TILE: object %" PRIu32 ", level %" PRIu32 ", tile %" PRIu32 ": %s",
                          t->object, t->level, t->tile, why);
}

/* The payload of the blob of a whole tile. */
static enum lw_status read_whole(const struct lw_blob *blob, struct lw_message *out_message) {
    const enum lw_status status = lw_message_decode_whole(blob->bytes, blob->size, out_message);
    LW_INVARIANT(status != LW_OK || (out_message->type == LW_MESSAGE_TILE && !out_message->tile.base));
    return status;
}

/* The whole tile, for clients without a version of it. */
static enum lw_status make_whole(struct lw_relay_light *light, const struct lw_tile_channel *channel,
                                 const struct tile *known, const struct lw_message_tile *t,
                                 const struct lw_tile_place *place, struct lw_blob **out_blob) {
    struct lw_message whole = {.type = LW_MESSAGE_TILE, .tile = *t}, base;
    if (!t->base) {
        const enum lw_status status =
            lw_tile_codec_decode(light->codec, channel, t->codec, t->payload, t->payload_size, t->scale,
                                 place->width, place->height, NULL, light->texels);
        return status == LW_OK ? lw_blob_from_message(&whole, out_blob) : status;
    }
    if (!(t->scale > 0 && t->scale <= SCALE_MAX)) return LW_BAD_DATA;
    enum lw_status status = read_whole(known->whole, &base);
    if (status != LW_OK) return status;
    status = lw_tile_codec_encode_sum(light->codec, channel, base.tile.payload, base.tile.payload_size,
                                      t->payload, t->payload_size, place->width, place->height,
                                      light->payload, lw_tile_codec_bound(), &whole.tile.payload_size);
    lw_message_finish(&base);
    whole.tile.base = 0;
    whole.tile.payload = light->payload;
    return status == LW_OK ? lw_blob_from_message(&whole, out_blob) : status;
}

static enum lw_status store(struct lw_relay_light *light, uint32_t channel, uint32_t id,
                            const struct lw_message_tile *t, struct lw_error *err) {
    struct feed *feed = &light->feed[channel];
    struct tile *known = &feed->tile[id];
    struct lw_blob *whole = NULL, *delta = NULL;
    enum lw_status status =
        make_whole(light, lw_tile_channel_at(channel), known, t, &light->map.place[id], &whole);
    if (status == LW_OK && t->base)
        status = lw_blob_from_message(&(struct lw_message){.type = LW_MESSAGE_TILE, .tile = *t}, &delta);
    if (status != LW_OK) {
        lw_blob_unref(whole);
        return status == LW_NO_MEMORY ? lw_status_fail(err, status, "message TILE: out of memory")
                                      : bad_tile(err, t, "the payload is damaged");
    }
    if (!known->version && id < light->map.plain_count && is_coarsest(&light->map, id) &&
        is_awaited(light, feed)) {
        LW_INVARIANT(feed->coarsest_missing > 0);
        feed->coarsest_missing--;
    }
    lw_blob_unref(known->whole);
    lw_blob_unref(known->delta);
    LW_INVARIANT(t->version > known->version && (!t->base || t->base == known->version));
    known->version = t->version;
    known->codec = t->codec;
    known->whole = whole;
    known->base = t->base;
    known->delta = delta;
    feed->settled = 0; /* another SETTLED follows */
    light->changed = true;
    return LW_OK;
}

/* A tile that came whole again, as it is. */
static bool is_published(const struct tile *known, const struct lw_message_tile *t) {
    struct lw_message published;
    if (!known->published_whole || t->version != known->published ||
        lw_message_decode_whole(known->published_whole->bytes, known->published_whole->size, &published) !=
            LW_OK)
        return false;
    const bool is_same = published.tile.codec == t->codec && published.tile.scale == t->scale &&
                         published.tile.payload_size == t->payload_size &&
                         !memcmp(published.tile.payload, t->payload, t->payload_size);
    lw_message_finish(&published);
    return is_same;
}

/* t: with the server's own version. counted: as clients count */
static enum lw_status take_fine(struct lw_relay_light *light, uint32_t channel,
                                const struct lw_message_tile *t, const struct lw_message_tile *counted,
                                struct lw_error *err) {
    const uint32_t id =
        lw_relay_fine_find(&light->fine, lw_atlas_map_name_tile(&light->map, t->object, t->level, t->tile));
    if (id == UINT32_MAX || !(lw_relay_fine_tile(&light->fine, id)->asked >> channel & 1))
        return LW_OK; /* it was under way when clients turned away */
    struct tile *known = &light->feed[channel].tile[id];
    if (t->codec == LW_TILE_CODEC_NONE)
        return withdraw_fine(light, channel, id) == LW_OK
                   ? LW_OK
                   : lw_status_fail(err, LW_NO_MEMORY, "message TILE: out of memory");
    if (!lw_tile_codec_is_known(t->codec)) return bad_tile(err, t, "its codec is unknown");
    if (t->base ? t->base != known->above || known->codec != LW_TILE_CODEC_DCT || t->codec != known->codec
                : t->version <= known->above)
        return LW_OK; /* its base is not here, or it is not newer */
    struct lw_message_tile own = *counted;
    if (known->is_in_doubt && !t->base && known->version == known->published && is_published(known, &own)) {
        known->above = t->version;
        known->is_in_doubt = false;
        return LW_OK;
    }
    /* clients that have the last published version get none that is not larger, unless it is the same */
    const uint64_t newest = known->version > known->published ? known->version : known->published;
    if (own.version < newest || (own.version == newest && known->version)) own.version = newest + 1;
    if (own.version > lw_snapshot_version(light->feed[channel].frame)) {
        known->above = 0; /* a later version comes whole, or this one in the next session */
        return LW_OK;
    }
    if (own.base) own.base = known->version;
    const enum lw_status status = store(light, channel, id, &own, err);
    if (status != LW_OK) return status;
    known->above = t->version;
    known->is_in_doubt = false;
    return LW_OK;
}

enum lw_status lw_relay_light_take_tile(struct lw_relay_light *light, uint32_t channel,
                                        const struct lw_message_tile *tile, struct lw_error *err) {
    struct feed *feed = &light->feed[channel];
    const struct lw_message_tile *t = tile;
    LW_INVARIANT(feed->is_open);
    if (!feed->frame) return lw_status_fail(err, LW_PROTOCOL, "message TILE: out of order");
    feed->follows = false;
    if (!lw_atlas_map_has_tile(&light->map, t->object, t->level, t->tile))
        return bad_tile(err, t, "it does not exist");
    if (t->layer >= lw_tile_channels()->count) return LW_OK;
    if (t->layer != channel) return bad_tile(err, t, "it is of another layer than the session gets");
    if (t->version > lw_snapshot_version(lw_relay_light_frame(light, channel)))
        return bad_tile(err, t, "its version is over twice the number of the frame");
    struct lw_message_tile counted = *tile; /* as clients count */
    counted.version += lw_snapshot_version(light->before);
    if (counted.base) counted.base += lw_snapshot_version(light->before);
    t = &counted;
    if (lw_atlas_finer(t->level)) return take_fine(light, channel, tile, t, err);
    const uint32_t id = lw_atlas_map_find_tile(&light->map, t->object, t->level, t->tile).v;
    if (!lw_tile_codec_is_known(t->codec)) return bad_tile(err, t, "its codec is unknown");
    const struct tile *known = &feed->tile[id];
    if (t->version <= known->version) return LW_OK;
    if (t->base &&
        (t->base != known->version || known->codec != LW_TILE_CODEC_DCT || t->codec != LW_TILE_CODEC_DCT))
        return bad_tile(err, t, "it builds on a version that is not here");
    return store(light, channel, id, t, err);
}

enum lw_status lw_relay_light_take_settled(struct lw_relay_light *light, uint32_t channel, uint64_t frame,
                                           struct lw_error *err) {
    struct feed *feed = &light->feed[channel];
    LW_INVARIANT(feed->is_open);
    if (!feed->frame || frame != lw_relay_light_frame(light, channel))
        return lw_status_fail(err, LW_PROTOCOL, "message SETTLED: out of order");
    feed->follows = false;
    for (uint32_t id = light->map.plain_count; id < light->map.tile_count; id++)
        if (feed->tile[id].is_in_doubt && withdraw_fine(light, channel, id) != LW_OK)
            return lw_status_fail(err, LW_NO_MEMORY, "message SETTLED: out of memory");
    if (feed->settled == feed->frame && !light->changed) return LW_OK;
    feed->settled = feed->frame;
    light->changed = light->completed = true;
    return LW_OK;
}

uint64_t lw_relay_light_version(const struct lw_relay_light *light, uint32_t channel, lw_tile_id tile) {
    const struct feed *feed = &light->feed[channel];
    LW_INVARIANT(tile.v < light->map.plain_count);
    const uint64_t version = feed->tile ? feed->tile[tile.v].version : 0,
                   before = lw_snapshot_version(light->before);
    return version > before ? version - before : 0;
}

uint64_t lw_relay_light_frame(const struct lw_relay_light *light, uint32_t channel) {
    const uint64_t frame = light->feed[channel].frame;
    LW_INVARIANT(!frame || !light->feed[channel].is_open || frame > light->before);
    return frame > light->before ? frame - light->before : 0;
}

bool lw_relay_light_has_first(const struct lw_relay_light *light, uint32_t channel) {
    const struct feed *feed = &light->feed[channel];
    return feed->tile && feed->frame && !feed->coarsest_missing;
}

/* ---- snapshots ---- */

static bool has_light(const struct feed *feed) {
    return feed->frame && feed->tile && !feed->coarsest_missing;
}

static bool is_shown(const struct feed *feed) { return feed->is_open && has_light(feed); }

/* The session that is furthest; NULL: none has a whole frame, or none has light. */
static const struct feed *find_newest(const struct lw_relay_light *light) {
    const struct feed *newest = NULL;
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        const struct feed *feed = &light->feed[c];
        if (!is_shown(feed)) continue;
        if (feed->follows) return NULL; /* its next message says more */
        if (!newest || feed->frame > newest->frame) newest = feed;
    }
    return newest;
}

enum lw_relay_light_news lw_relay_light_news(const struct lw_relay_light *light) {
    const struct feed *newest = light->changed ? find_newest(light) : NULL;
    if (!newest || newest->frame < light->frame) return LW_RELAY_LIGHT_NOTHING;
    return light->completed ? LW_RELAY_LIGHT_ALL : LW_RELAY_LIGHT_SOME;
}

static void keep_blob(struct lw_blob **kept, struct lw_blob *blob) {
    lw_blob_unref(*kept);
    *kept = blob;
}

/* The messages of a newer frame. */
static enum lw_status make_messages(struct lw_relay_light *light, const struct feed *newest) {
    struct lw_blob *full = NULL, *delta = NULL, *settled = NULL;
    struct lw_message_frame header = newest->header;
    header.run = light->run;
    header.base = 0;
    const struct lw_message settled_message = {.type = LW_MESSAGE_SETTLED, .settled.frame = newest->frame};
    enum lw_status status = lw_frame_message_encode(light->scene, &newest->pose, NULL, &header, &full);
    header.base = light->frame;
    if (status == LW_OK && light->frame)
        status = lw_frame_message_encode(light->scene, &newest->pose, &light->pose, &header, &delta);
    if (status == LW_OK) status = lw_blob_from_message(&settled_message, &settled);
    if (status != LW_OK) {
        lw_blob_unref(full);
        lw_blob_unref(delta);
        return status;
    }
    keep_blob(&light->frame_full, full);
    keep_blob(&light->frame_delta, delta);
    keep_blob(&light->settled, settled);
    lw_pose_copy(&light->pose, &newest->pose, light->scene);
    light->previous_frame = light->frame;
    light->frame = newest->frame;
    light->time_s = newest->header.time_s;
    return LW_OK;
}

/* For a tile whose newest version was in no snapshot yet. */
static void publish_tile(struct lw_relay_light *light, uint32_t channel, uint32_t id, struct tile *tile) {
    if (tile->published_whole && tile->base != tile->published) {
        keep_blob(&tile->delta, /* over several versions */
                  lw_transcoder_encode_delta(light->codec, lw_tile_channel_at(channel), &light->map.place[id],
                                             tile->published_whole, tile->published, tile->whole,
                                             light->payload));
        tile->base = tile->delta ? tile->published : 0;
    }
    tile->published = tile->version;
    keep_blob(&tile->published_whole, lw_blob_ref(tile->whole));
}

static void list_tiles(struct lw_relay_light *light, uint32_t channel, struct lw_snapshot *snapshot) {
    struct feed *feed = &light->feed[channel];
    for (uint32_t t = 0; t < light->map.tile_count; t++) {
        struct tile *tile = &feed->tile[t];
        if (!tile->version) continue;
        if (tile->version != tile->published) publish_tile(light, channel, t, tile);
        snapshot->tile[channel][t] =
            (struct lw_snapshot_tile){.version = tile->version,
                                      .blob = lw_blob_ref(tile->whole),
                                      .base = tile->base,
                                      .delta = tile->delta ? lw_blob_ref(tile->delta) : NULL};
    }
}

/* Which ids of finer levels have to stay. */
static enum lw_status note_held(const struct lw_relay_light *light, struct lw_snapshot *snapshot) {
    const uint32_t room = lw_atlas_map_room(&light->map), plain = light->map.plain_count;
    snapshot->interest = light->fine.interest;
    if (!room) return LW_OK;
    if (!(snapshot->holds_fine = malloc(room * sizeof *snapshot->holds_fine))) return LW_NO_MEMORY;
    for (uint32_t i = 0; i < room; i++)
        snapshot->holds_fine[i] = lw_relay_fine_is_held(&light->fine, plain + i);
    return LW_OK;
}

enum lw_status lw_relay_light_snapshot(struct lw_relay_light *light, struct lw_snapshot **out_snapshot) {
    const bool cut_off = light->frame && is_cut_off(light);
    const struct feed *newest = find_newest(light);
    struct lw_snapshot *snapshot;
    uint32_t channels = 0;
    *out_snapshot = NULL;
    if (!cut_off && (!newest || newest->frame < light->frame)) return LW_OK;
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        if (cut_off ? has_light(&light->feed[c]) : is_shown(&light->feed[c]))
            channels |= lw_tile_channel_bit(c);
    enum lw_status status = lw_snapshot_create(light->map.tile_count, channels, &snapshot);
    if (status != LW_OK) return status;
    if ((status = note_held(light, snapshot)) != LW_OK) {
        lw_snapshot_unref(snapshot);
        return status;
    }
    if (!cut_off && newest->frame > light->frame && (status = make_messages(light, newest)) != LW_OK) {
        lw_snapshot_unref(snapshot);
        return status;
    }
    snapshot->frame = light->frame;
    snapshot->time_s = light->time_s;
    snapshot->previous_frame = light->previous_frame;
    snapshot->frame_full = lw_blob_ref(light->frame_full);
    snapshot->frame_delta = light->frame_delta ? lw_blob_ref(light->frame_delta) : NULL;
    snapshot->settled = lw_blob_ref(light->settled);
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        if (!(channels >> c & 1)) continue;
        if (!cut_off && light->feed[c].settled != light->frame) snapshot->unsettled |= lw_tile_channel_bit(c);
        list_tiles(light, c, snapshot);
    }
    light->changed = light->completed = false;
    *out_snapshot = snapshot;
    return LW_OK;
}
