#include "server/publish/publisher.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/light/direction_form.h"
#include "common/tile/tile_codec.h"
#include "server/publish/frame_message.h"
#include "server/publish/levels.h"
#include "server/publish/white.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* One tile, as it was last sent. */
struct sent_tile {
    uint64_t version; /* 0: never */
    float error;
    float change; /* by the last version */
    float *value; /* width * height * planes; NULL: not sent, or without state of the encoder */
    struct lw_blob *blob;
    struct lw_blob *delta; /* the same as a delta on version `base`; NULL: none */
    uint64_t base;
    struct lw_tile_dct_history *history; /* what deltas build on */
};

struct worker {
    struct lw_solver_room room; /* for planes that the solver does not hold */
    struct lw_tile_codec *codec;
    uint8_t *payload, *delta; /* lw_tile_codec_bound() each */
    float value[LW_TILE_TEXELS_MAX * LW_TILE_CHANNEL_PLANES_MAX];
    float light[LW_TILE_TEXELS_MAX * 3]; /* the irradiance that a moment belongs to */
    uint8_t covered[LW_TILE_TEXELS_MAX];
    struct {
        uint64_t tiles, bytes;
    } encoded[LW_TILE_CHANNELS_MAX];
    uint64_t saturated;
    enum lw_status status;
};

/* One channel of all tiles. */
struct channel {
    uint32_t number;
    const struct lw_tile_channel *is;
    bool is_published;         /* a snapshot has had it */
    struct lw_levels **levels; /* per object; NULL: they are made when its tiles are encoded */
    struct sent_tile *sent;    /* per tile id */
    bool *changed;             /* per object: changed in this frame */
    lw_tile_id *fine;          /* tiles of finer levels that are sent, by id */
    uint32_t fine_count;
    float dark; /* W/m^2: looks black in this frame; 0: not light */
};

/* Form of an object's tiles in this frame. */
enum news { AS_SOLVED, HELD_BACK, LIT_AGAIN /* the first light since it was a spare */ };

struct lw_publisher {
    struct lw_publisher_desc desc;
    int threads;
    struct channel *channel[LW_TILE_CHANNELS_MAX]; /* NULL: not published */
    enum news *news;                               /* per object */
    bool *keeps_state;                             /* per object: what tiles' encoding goes on from */
    bool is_lean;                                  /* objects that nobody looks at keep none */
    uint64_t *unlit;         /* per object: 0; SPARE; or the frame since which it is none, until it is lit */
    struct worker *worker;   /* per thread */
    struct lw_white white;   /* of all light */
    struct lw_pose previous; /* the last one published */
    uint64_t previous_frame;
    uint64_t since; /* the first frame of those that could not be published since; 0: there is none */
    uint64_t saturated;
};

#define SPARE UINT64_MAX

static void forget_sent(struct sent_tile *sent) {
    free(sent->value);
    free(sent->history);
    lw_blob_unref(sent->blob);
    lw_blob_unref(sent->delta);
    *sent = (struct sent_tile){0};
}

/* After this the next version is sent whole. */
static void drop_state(struct sent_tile *sent) {
    free(sent->value);
    free(sent->history);
    sent->value = NULL;
    sent->history = NULL;
}

static void drop_levels(struct channel *channel, uint32_t object) {
    if (channel->levels[object]) lw_levels_finish(channel->levels[object]);
    free(channel->levels[object]);
    channel->levels[object] = NULL;
}

static void destroy_channel(const struct lw_atlas_map *map, struct channel *channel) {
    if (!channel) return;
    for (uint32_t o = 0; channel->levels && o < map->object_count; o++) drop_levels(channel, o);
    for (uint32_t t = 0; channel->sent && t < map->tile_count; t++) forget_sent(&channel->sent[t]);
    free(channel->fine);
    free(channel->changed);
    free(channel->sent);
    free(channel->levels);
    free(channel);
}

static enum lw_status create_channel(const struct lw_atlas_map *map, uint32_t number,
                                     struct channel **out_channel) {
    struct channel *channel = calloc(1, sizeof *channel);
    if (!channel) return LW_NO_MEMORY;
    channel->number = number;
    channel->is = lw_tile_channel_at(number);
    channel->levels = calloc((size_t)map->object_count + 1, sizeof *channel->levels);
    channel->sent = calloc((size_t)map->tile_count + 1, sizeof *channel->sent);
    channel->changed = calloc((size_t)map->object_count + 1, sizeof *channel->changed);
    if (!channel->levels || !channel->sent || !channel->changed) {
        destroy_channel(map, channel);
        return LW_NO_MEMORY;
    }
    *out_channel = channel;
    return LW_OK;
}

enum lw_status lw_publisher_set_channels(struct lw_publisher *p, uint32_t channels) {
    struct channel *made[LW_TILE_CHANNELS_MAX] = {0};
    LW_INVARIANT(channels >> LW_TILE_CHANNELS_MAX == 0);
    LW_TILE_CHANNELS_EACH (moment, channels) /* which is coded over its irradiance */
        channels |= lw_tile_channel_bit(lw_tile_channel_at(moment)->follows);
    enum lw_status status = LW_OK;
    for (unsigned f = 0; status == LW_OK && f < LW_TILE_CHANNELS_MAX; f++)
        if (channels >> f & 1 && !p->channel[f]) status = create_channel(p->desc.atlas_map, f, &made[f]);
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) {
        if (status != LW_OK) {
            destroy_channel(p->desc.atlas_map, made[f]);
        } else if (made[f]) {
            p->channel[f] = made[f];
        } else if (!(channels >> f & 1)) {
            destroy_channel(p->desc.atlas_map, p->channel[f]);
            p->channel[f] = NULL;
        }
        LW_INVARIANT(status != LW_OK || (p->channel[f] != NULL) == (channels >> f & 1));
    }
    return status;
}

/* Bytes of encoder state for all plain tiles of a channel, about. */
static uint64_t state_bytes(const struct lw_atlas_map *map) {
    uint64_t texels = 0;
    for (uint32_t id = 0; id < map->plain_count; id++)
        texels += (uint64_t)map->place[id].width * map->place[id].height;
    return texels *
           (sizeof(float[3]) + 1 + sizeof(float[3]) + sizeof(int16_t[3])); /* levels, value, history */
}

void lw_publisher_want(struct lw_publisher *p, const uint8_t *levels) {
    const struct lw_atlas_map *map = p->desc.atlas_map;
    if (!p->is_lean) return;
    for (uint32_t o = 0; o < map->object_count; o++) p->keeps_state[o] = !levels;
    for (uint32_t id = 0; levels && id < map->tile_count; id++)
        if (levels[id]) p->keeps_state[map->place[id].object] = true;
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) {
        for (uint32_t o = 0; p->channel[f] && o < map->object_count; o++)
            if (!p->keeps_state[o]) drop_levels(p->channel[f], o);
        for (uint32_t id = 0; p->channel[f] && id < map->plain_count; id++)
            if (!p->keeps_state[map->place[id].object]) drop_state(&p->channel[f]->sent[id]);
    }
}

/* What a scene's file has, and time 0. */
static enum lw_status begin_pose(struct lw_pose *out_pose, const struct lw_scene *scene) {
    struct lw_pose pose;
    enum lw_status status = lw_pose_init(&pose, scene);
    if (status != LW_OK) return status;
    status = lw_pose_init_copy(out_pose, &pose, scene);
    lw_pose_finish(&pose);
    return status;
}

enum lw_status lw_publisher_create(const struct lw_publisher_desc *desc,
                                   struct lw_publisher **out_publisher) {
    struct lw_publisher *p = calloc(1, sizeof *p);
    if (!p) return LW_NO_MEMORY;
    p->desc = *desc;
    if (!(p->desc.noise_shown > 0)) p->desc.noise_shown = 1;
    if (!(p->desc.step_widest > 0)) p->desc.step_widest = LW_PUBLISHER_STEP_WIDEST;
    p->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    p->news = calloc((size_t)desc->atlas_map->object_count + 1, sizeof *p->news);
    p->unlit = calloc((size_t)desc->atlas_map->object_count + 1, sizeof *p->unlit);
    p->keeps_state = calloc((size_t)desc->atlas_map->object_count + 1, sizeof *p->keeps_state);
    if (!(p->desc.state_max > 0)) p->desc.state_max = LW_PUBLISHER_STATE_MAX;
    p->is_lean = state_bytes(desc->atlas_map) > p->desc.state_max;
    p->worker = calloc((size_t)p->threads, sizeof *p->worker);
    enum lw_status status = LW_NO_MEMORY;
    if (!p->news || !p->unlit || !p->keeps_state || !p->worker) goto fail;
    for (uint32_t o = 0; o < desc->atlas_map->object_count; o++) p->keeps_state[o] = !p->is_lean;
    if ((status = lw_white_init(&p->white, desc->atlas_map)) != LW_OK) goto fail;
    if ((status = begin_pose(&p->previous, desc->scene)) != LW_OK) goto fail;
    for (int i = 0; i < p->threads; i++) {
        if ((status = lw_tile_codec_create(&p->worker[i].codec)) != LW_OK) goto fail;
        status = LW_NO_MEMORY;
        if (!(p->worker[i].payload = malloc(lw_tile_codec_bound()))) goto fail;
        if (!(p->worker[i].delta = malloc(lw_tile_codec_bound()))) goto fail;
    }
    if ((status = lw_publisher_set_channels(p, 1u << LW_TILE_CHANNEL_FULL)) != LW_OK) goto fail;
    *out_publisher = p;
    return LW_OK;
fail:
    lw_publisher_destroy(p);
    return status;
}

void lw_publisher_destroy(struct lw_publisher *p) {
    if (!p) return;
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) destroy_channel(p->desc.atlas_map, p->channel[f]);
    for (int i = 0; p->worker && i < p->threads; i++) {
        lw_tile_codec_destroy(p->worker[i].codec);
        free(p->worker[i].payload);
        free(p->worker[i].delta);
    }
    lw_pose_finish(&p->previous);
    lw_white_finish(&p->white);
    free(p->worker);
    free(p->keeps_state);
    free(p->unlit);
    free(p->news);
    free(p);
}

/* Level-0 tiles come first in an object's ids. */
static uint32_t level0_tiles(const struct lw_atlas *atlas) {
    return atlas->level[0].tiles_x * atlas->level[0].tiles_y;
}

/* Ids of an object's tiles of level 0, from the first up to but without the last. */
struct tile_range {
    uint32_t first, end;
};

static struct tile_range level0_of(const struct lw_atlas_map *map, uint32_t object) {
    const uint32_t first = map->first_tile[object];
    const uint32_t count = map->atlas[object]->level_count ? level0_tiles(map->atlas[object]) : 0;
    LW_INVARIANT(first + count <= map->tile_count);
    return (struct tile_range){first, first + count};
}

/* Whether frame `since` or a later one has touched a tile, or the tile was never sent. */
static bool has_news(const struct lw_publisher *p, const struct channel *channel, uint32_t id,
                     uint64_t since) {
    struct lw_solver_tile tile;
    p->desc.solver->ops->read_tile(p->desc.solver, (lw_tile_id){id}, &tile);
    return tile.solved_frame >= since || !channel->sent[id].version;
}

/* Makes the pyramid of an object. */
static enum lw_status make_levels(const struct lw_publisher *p, struct worker *worker,
                                  struct channel *channel, uint32_t object) {
    const struct tile_range tiles = level0_of(p->desc.atlas_map, object);
    struct lw_levels *levels = malloc(sizeof *levels);
    LW_INVARIANT(!channel->levels[object]);
    if (!levels) return LW_NO_MEMORY;
    const enum lw_status status = lw_levels_init(levels, channel->number, p->desc.atlas_map->atlas[object]);
    if (status != LW_OK) {
        free(levels);
        return status;
    }
    channel->levels[object] = levels;
    for (uint32_t id = tiles.first; id < tiles.end; id++) {
        struct lw_solver_tile tile;
        lw_solver_read_light(p->desc.solver, (lw_tile_id){id}, &worker->room, &tile);
        lw_levels_load_tile(levels, &p->desc.atlas_map->place[id], &tile);
    }
    if (tiles.first < tiles.end) lw_levels_build(levels);
    return LW_OK;
}

/* Brings white, and an object's pyramid if it is held, up to date with the solver. Returns false if no frame
 * since that one touched the object. */
static bool refresh_levels(struct lw_publisher *p, struct worker *worker, struct channel *channel,
                           uint32_t object, uint64_t since) {
    const struct tile_range tiles = level0_of(p->desc.atlas_map, object);
    const bool is_light = channel->is->coding == LW_TILE_CODING_LIGHT;
    struct lw_levels *levels = channel->levels[object];
    bool changed = false;
    if (worker->status != LW_OK) return false;
    for (uint32_t id = tiles.first; id < tiles.end; id++) {
        struct lw_solver_tile tile;
        if (!has_news(p, channel, id, since)) continue;
        changed = true;
        if (!levels && !is_light) break; /* nothing takes its planes */
        lw_solver_read_light(p->desc.solver, (lw_tile_id){id}, &worker->room, &tile);
        if (is_light) lw_white_note(&p->white, (lw_tile_id){id}, &tile);
        if (levels) lw_levels_load_tile(levels, &p->desc.atlas_map->place[id], &tile);
    }
    if (changed && levels) lw_levels_build(levels);
    return changed;
}

/* Whether all of an object has been solved since a frame. */
static bool is_lit(const struct lw_publisher *p, uint32_t object, uint64_t since) {
    const struct tile_range tiles = level0_of(p->desc.atlas_map, object);
    for (uint32_t id = tiles.first; id < tiles.end; id++) {
        struct lw_solver_tile tile;
        p->desc.solver->ops->read_tile(p->desc.solver, (lw_tile_id){id}, &tile);
        if ((tile.solved_frame < since || !tile.sample_count) && tile.has_surface) return false;
    }
    return true;
}

/* An object that was a spare is sent when all of it has light. Then it is always sent: clients wait for
 * it. */
static void note_unlit(struct lw_publisher *p, const struct lw_pose *pose, uint32_t object, uint64_t frame) {
    uint64_t *unlit = &p->unlit[object];
    p->news[object] = AS_SOLVED;
    if (pose->object_spare[object])
        *unlit = SPARE;
    else if (*unlit == SPARE)
        *unlit = frame;
    LW_INVARIANT(*unlit == SPARE || *unlit <= frame);
    if (!*unlit || *unlit == SPARE) return;
    p->news[object] = is_lit(p, object, *unlit) ? LIT_AGAIN : HELD_BACK;
}

float lw_publisher_error(const struct lw_atlas_map *map, const struct lw_solver *solver, lw_tile_id id,
                         uint32_t *out_bounces) {
    const struct lw_tile_place *place = &map->place[id.v];
    const struct lw_atlas_level *fine = &map->atlas[place->object]->level[0];
    float error = 0;
    uint32_t bounces = UINT32_MAX;
    uint32_t x0 = place->x << place->level, y0 = place->y << place->level;
    for (uint32_t y = y0; y < y0 + (1u << place->level) && y < fine->tiles_y; y++)
        for (uint32_t x = x0; x < x0 + (1u << place->level) && x < fine->tiles_x; x++) {
            struct lw_solver_tile tile;
            solver->ops->read_tile(solver, lw_atlas_map_find(map, place->object, 0, x, y), &tile);
            error = fmaxf(error, tile.error);
            bounces = tile.bounces < bounces ? tile.bounces : bounces;
        }
    LW_INVARIANT(error >= 0 && bounces < UINT32_MAX); /* there was a tile of level 0 */
    if (out_bounces) *out_bounces = bounces;
    return error;
}

/* Root mean square of the relative difference. A hundredth of the tile's mean is added to the divisor.
 * *out_mean: of `now`. */
static float find_ratio(const float *now, const float *then, size_t count, float *out_mean) {
    double mean = 0, sum = 0;
    for (size_t i = 0; i < count; i++) mean += (double)now[i];
    const float floor = (float)(0.01 * mean / (double)count) + 1e-12f;
    for (size_t i = 0; i < count; i++) {
        float relative = (now[i] - then[i]) / (then[i] + floor);
        sum += (double)(relative * relative);
    }
    *out_mean = (float)(mean / (double)count);
    LW_INVARIANT_DEAR(sum >= 0 && mean >= 0 && isfinite(sum) && isfinite(mean));
    return (float)sqrt(sum / (double)count);
}

/* Root mean square of the difference of plain values, over the root mean square of `now`. */
static float find_difference(const float *now, const float *then, size_t count, float *out_mean) {
    double square = 0, sum = 0;
    for (size_t i = 0; i < count; i++) {
        const double off = (double)now[i] - (double)then[i];
        square += (double)now[i] * (double)now[i];
        sum += off * off;
    }
    *out_mean = (float)sqrt(square / (double)count);
    return (float)sqrt(sum / (square + 1e-24 * (double)count));
}

static enum lw_status encode_tile(const struct lw_publisher *p, struct worker *worker,
                                  const struct channel *channel, struct sent_tile *sent,
                                  const struct lw_tile_place *place, bool keeps_state, float error,
                                  struct lw_tile_dct_coded *out_coded) {
    if (p->desc.codec != LW_TILE_CODEC_DCT) {
        out_coded->delta_size = 0;
        return lw_tile_codec_encode_half(worker->codec, channel->is, worker->value, place->width,
                                         place->height, worker->payload, lw_tile_codec_bound(),
                                         &out_coded->size, &out_coded->scale, &out_coded->saturated);
    }
    const size_t size = lw_tile_dct_history_size(channel->is, place->width, place->height);
    const bool begins = keeps_state && !sent->history;
    if (begins && !(sent->history = aligned_alloc(_Alignof(struct lw_tile_dct_history), size)))
        return LW_NO_MEMORY;
    if (sent->history && (begins || !sent->version)) memset(sent->history, 0, size);
    const float step = lw_publisher_step(
        error, p->desc.noise_shown, lw_atlas_finer(place->level) ? 0 : place->level, p->desc.step_widest);
    return lw_tile_codec_encode_dct(
        worker->codec,
        &(struct lw_tile_dct_source){worker->value, worker->covered, place->width, place->height,
                                     channel->is->step * step, channel->dark, channel->is},
        sent->history, worker->payload, worker->delta, lw_tile_codec_bound(), out_coded);
}

/* The tile whole and as a delta, as messages; out_delta NULL if one is enough. */
static enum lw_status make_tile_blobs(const struct lw_publisher *p, struct worker *worker,
                                      const struct sent_tile *sent, struct lw_message_tile *tile,
                                      const struct lw_tile_dct_coded *coded, struct lw_blob **out_blob,
                                      struct lw_blob **out_delta) {
    tile->codec = p->desc.codec;
    tile->scale = coded->scale;
    tile->payload = worker->payload;
    tile->payload_size = coded->size;
    struct lw_blob *blob;
    *out_delta = NULL;
    enum lw_status status =
        lw_blob_from_message(&(struct lw_message){.type = LW_MESSAGE_TILE, .tile = *tile}, &blob);
    LW_INVARIANT(coded->size > 0 && coded->size <= lw_tile_codec_bound() && coded->scale > 0);
    if (status == LW_OK && coded->delta_size && coded->delta_size < coded->size) {
        LW_INVARIANT(sent->version > 0 && sent->version < tile->version); /* there is what it builds on */
        tile->base = sent->version;
        tile->payload = worker->delta;
        tile->payload_size = coded->delta_size;
        status =
            lw_blob_from_message(&(struct lw_message){.type = LW_MESSAGE_TILE, .tile = *tile}, out_delta);
        if (status != LW_OK) lw_blob_unref(blob);
    }
    if (status == LW_OK) *out_blob = blob;
    return status;
}

static enum lw_status send_tile(const struct lw_publisher *p, struct worker *worker,
                                const struct channel *channel, lw_tile_id id, uint64_t frame, float error,
                                uint32_t bounces, float change) {
    const struct lw_tile_place *place = &p->desc.atlas_map->place[id.v];
    struct sent_tile *sent = &channel->sent[id.v];
    const size_t floats = (size_t)place->width * place->height * channel->is->planes;
    const bool keeps_state = p->keeps_state[place->object] || lw_atlas_finer(place->level);
    if (keeps_state && !sent->value && !(sent->value = malloc(floats * sizeof *sent->value)))
        return LW_NO_MEMORY;
    struct lw_tile_dct_coded coded;
    struct lw_blob *blob, *delta;
    enum lw_status status = encode_tile(p, worker, channel, sent, place, keeps_state, error, &coded);
    if (status == LW_OK)
        status = make_tile_blobs(p, worker, sent,
                                 &(struct lw_message_tile){.object = place->object,
                                                           .level = place->level,
                                                           .tile = lw_atlas_map_number(p->desc.atlas_map, id),
                                                           .version = lw_snapshot_version(frame),
                                                           .layer = channel->number,
                                                           .bounces = bounces,
                                                           .error = error},
                                 &coded, &blob, &delta);
    if (status != LW_OK) {
        /* The history may be ahead of the sent values: no delta may build on it. The sent blobs go, too: a
         * snapshot may follow in which this tile is held back. */
        lw_blob_unref(sent->blob);
        lw_blob_unref(sent->delta);
        sent->blob = sent->delta = NULL;
        sent->version = 0;
        return status;
    }
    LW_INVARIANT(lw_snapshot_version(frame) > sent->version);
    if (keeps_state) memcpy(sent->value, worker->value, floats * sizeof *sent->value);
    lw_blob_unref(sent->blob);
    lw_blob_unref(sent->delta);
    sent->blob = blob;
    sent->delta = delta;
    sent->base = sent->version;
    sent->version = lw_snapshot_version(frame);
    sent->error = error;
    sent->change = change;
    worker->encoded[channel->number].tiles++;
    worker->encoded[channel->number].bytes += delta ? delta->size : blob->size;
    worker->saturated += coded.saturated;
    return LW_OK;
}

/* A tile is also sent when it reaches the target error, since clients wait for that, and when views change
 * the level that they read. */
static bool is_of_another_class(const struct lw_publisher *p, float error, float sent_error) {
    return (error <= p->desc.target_error && sent_error > p->desc.target_error) ||
           lw_atlas_noise_level_min(error, p->desc.noise_shown) !=
               lw_atlas_noise_level_min(sent_error, p->desc.noise_shown);
}

/* By how much the worker's values differ from the sent ones. Sets *out_visible to the visible part of it:
 * large relative changes of dark light hardly are. */
static float find_change(const struct channel *channel, const struct worker *worker,
                         const struct sent_tile *sent, const struct lw_tile_place *place,
                         float *out_visible) {
    float mean;
    const float change = (channel->is->coding == LW_TILE_CODING_LIGHT ? find_ratio : find_difference)(
        worker->value, sent->value, (size_t)place->width * place->height * channel->is->planes, &mean);
    *out_visible = change * (mean / (mean + channel->dark + 1e-30f));
    return change;
}

/* Below this a change is noise, or cannot be seen. */
static float least_change(float error) {
    return fmaxf(LW_PUBLISHER_VISIBLE_CHANGE, LW_PUBLISHER_NOISE_SHARE * error);
}

/* ---- cosine moments ---- */

static bool has_channel(const struct lw_publisher *p, const struct channel *channel, uint32_t object) {
    return !channel->is->moment || !p->desc.directional || p->desc.directional[object];
}

/* Turns moments into directions (lw_direction_of()), which stay when all lights are dimmed alike. */
static void divide_by_light(struct worker *worker, const struct lw_tile_place *place) {
    for (uint32_t i = 0; i < place->width * place->height; i++) {
        float *moment = worker->value + 3 * i;
        const struct lw_vec3 r = lw_direction_of(moment, worker->light + 3 * i);
        moment[0] = r.x, moment[1] = r.y, moment[2] = r.z;
    }
}

static void store_tile(const struct lw_publisher *p, const struct channel *channel,
                       const struct lw_tile_place *place, struct worker *worker) {
    if (channel->is->moment) {
        const struct channel *irradiance = p->channel[channel->is->follows];
        lw_levels_store_tile(irradiance->levels[place->object], place, worker->light, worker->covered);
    }
    lw_levels_store_tile(channel->levels[place->object], place, worker->value, worker->covered);
    if (channel->is->moment) divide_by_light(worker, place);
}

static void consider_tile(const struct lw_publisher *p, struct worker *worker, const struct channel *channel,
                          lw_tile_id id, uint64_t frame) {
    const struct lw_tile_place *place = &p->desc.atlas_map->place[id.v];
    const struct sent_tile *sent = &channel->sent[id.v];
    if (worker->status != LW_OK || !channel->changed[place->object] ||
        !lw_levels_has_changed(channel->levels[place->object], place))
        return;
    uint32_t bounces;
    const float error = lw_publisher_error(p->desc.atlas_map, p->desc.solver, id, &bounces);
    store_tile(p, channel, place, worker);
    float visible = 1;
    if (sent->version && sent->value) {
        const float change = find_change(channel, worker, sent, place, &visible);
        if (!is_of_another_class(p, error, sent->error) && p->news[place->object] != LIT_AGAIN &&
            change <= least_change(error))
            return;
    }
    worker->status = send_tile(p, worker, channel, id, frame, error, bounces, visible);
}

/* The pyramids that encoding an object's tiles of a channel reads. */
static void ensure_levels(const struct lw_publisher *p, struct worker *worker, struct channel *channel,
                          uint32_t object) {
    struct channel *irradiance = channel->is->moment ? p->channel[channel->is->follows] : NULL;
    if (worker->status == LW_OK && !channel->levels[object])
        worker->status = make_levels(p, worker, channel, object);
    if (worker->status == LW_OK && irradiance && !irradiance->levels[object])
        worker->status = make_levels(p, worker, irradiance, object);
}

/* Pyramids are made again for an object that does not keep them, for as long as its tiles are encoded. */
static void encode_object(const struct lw_publisher *p, struct worker *worker, struct channel *channel,
                          uint32_t object, uint64_t frame) {
    const struct lw_atlas_map *map = p->desc.atlas_map;
    struct channel *irradiance = channel->is->moment ? p->channel[channel->is->follows] : NULL;
    const uint32_t first = map->first_tile[object],
                   end = object + 1 < map->object_count ? map->first_tile[object + 1] : map->plain_count;
    ensure_levels(p, worker, channel, object);
    for (uint32_t id = first; id < end; id++) consider_tile(p, worker, channel, (lw_tile_id){id}, frame);
    drop_levels(channel, object);
    if (irradiance) drop_levels(irradiance, object);
}

static void encode_tiles(struct lw_publisher *p, struct channel *channel, uint64_t frame) {
    const struct lw_atlas_map *map = p->desc.atlas_map;
#pragma omp parallel for schedule(dynamic, 4) num_threads(p->threads)
    for (uint32_t id = 0; id < map->plain_count; id++)
        if (p->keeps_state[map->place[id].object])
            consider_tile(p, &p->worker[omp_get_thread_num()], channel, (lw_tile_id){id}, frame);
    if (!p->is_lean) return;
#pragma omp parallel for schedule(dynamic, 4) num_threads(p->threads)
    for (uint32_t o = 0; o < map->object_count; o++)
        if (!p->keeps_state[o] && channel->changed[o])
            encode_object(p, &p->worker[omp_get_thread_num()], channel, o, frame);
}

/* ---- tiles of finer levels ---- */

static void load_fine(const struct channel *channel, const struct lw_solver_tile *tile,
                      struct worker *worker) {
    const uint32_t planes = channel->is->planes;
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        worker->covered[i] = tile->covered[i] || tile->filled[i];
        for (uint32_t p = 0; p < planes; p++)
            worker->value[i * planes + p] = worker->covered[i] ? tile->shown[channel->number][p][i] : 0;
        for (uint32_t c = 0; channel->is->moment && c < 3; c++)
            worker->light[i * 3 + c] = tile->shown[channel->is->follows][c][i];
    }
}

/* A tile is sent for the first time when it shows no more noise than this, or has no larger error than that
 * of level 0 below it, which views read until then. */
#define FINE_NOISE 0.008f

static bool is_ready(const struct lw_publisher *p, lw_tile_id id, float error) {
    struct lw_solver_tile below;
    if (error * p->desc.noise_shown <= FINE_NOISE) return true;
    p->desc.solver->ops->read_tile(p->desc.solver, lw_atlas_map_below(p->desc.atlas_map, id), &below);
    return error <= below.error;
}

static void consider_fine(const struct lw_publisher *p, struct worker *worker, const struct channel *channel,
                          lw_tile_id id, uint64_t frame) {
    const struct lw_tile_place *place = &p->desc.atlas_map->place[id.v];
    struct sent_tile *sent = &channel->sent[id.v];
    struct lw_solver_tile tile;
    if (worker->status != LW_OK || p->news[place->object] == HELD_BACK ||
        !has_channel(p, channel, place->object))
        return;
    p->desc.solver->ops->read_tile(p->desc.solver, id, &tile);
    if (sent->value ? tile.solved_frame < p->since : !is_ready(p, id, tile.error)) return;
    load_fine(channel, &tile, worker);
    if (channel->is->moment) divide_by_light(worker, place);
    float visible = 1;
    if (!sent->value)
        forget_sent(sent); /* it was withdrawn */
    else if (find_change(channel, worker, sent, place, &visible) <= least_change(tile.error))
        return;
    worker->status = send_tile(p, worker, channel, id, frame, tile.error, tile.bounces, visible);
}

/* Tells those who have a tile that it is there no more. */
static enum lw_status withdraw(const struct lw_publisher *p, struct channel *channel, lw_tile_id id,
                               uint64_t frame) {
    static const uint8_t nothing = 0;
    const struct lw_tile_place *place = &p->desc.atlas_map->place[id.v];
    struct sent_tile *sent = &channel->sent[id.v];
    struct lw_blob *blob;
    if (!sent->value) return LW_OK;
    const struct lw_message message = {.type = LW_MESSAGE_TILE,
                                       .tile = {.object = place->object,
                                                .level = place->level,
                                                .tile = lw_atlas_map_number(p->desc.atlas_map, id),
                                                .version = lw_snapshot_version(frame),
                                                .layer = channel->number,
                                                .codec = LW_TILE_CODEC_NONE,
                                                .scale = 1,
                                                .payload = &nothing,
                                                .payload_size = sizeof nothing}};
    enum lw_status status = lw_blob_from_message(&message, &blob);
    if (status != LW_OK) return status;
    forget_sent(sent);
    sent->version = lw_snapshot_version(frame);
    sent->blob = blob;
    return LW_OK;
}

static enum lw_status encode_fine(struct lw_publisher *p, struct channel *channel, uint64_t frame) {
    const struct lw_solver *solver = p->desc.solver;
    const lw_tile_id *tile = NULL;
    const uint32_t count = solver->ops->list_fine ? solver->ops->list_fine(solver, &tile) : 0;
    enum lw_status status = LW_OK;
    for (uint32_t i = 0; i < channel->fine_count && status == LW_OK; i++)
        if (!lw_tile_id_is_in(tile, count, channel->fine[i]))
            status = withdraw(p, channel, channel->fine[i], frame);
    if (status != LW_OK) return status;
    lw_tile_id *fine = realloc(channel->fine, (count + 1ul) * sizeof *fine);
    if (!fine) return LW_NO_MEMORY;
    if (count) memcpy(fine, tile, count * sizeof *fine);
    channel->fine = fine;
    channel->fine_count = count;
#pragma omp parallel for schedule(dynamic, 4) num_threads(p->threads)
    for (uint32_t i = 0; i < count; i++)
        consider_fine(p, &p->worker[omp_get_thread_num()], channel, fine[i], frame);
    return LW_OK;
}

static void refresh_object(struct lw_publisher *p, struct worker *worker, struct channel *channel,
                           uint32_t object, uint64_t since, bool has_light) {
    bool *changed = &channel->changed[object];
    *changed = false;
    if (!has_channel(p, channel, object)) return;
    *changed = has_light && refresh_levels(p, worker, channel, object, since);
    if (p->news[object] != AS_SOLVED) *changed = p->news[object] == LIT_AGAIN;
    if (*changed && p->keeps_state[object]) ensure_levels(p, worker, channel, object);
}

static void refresh_channel(struct lw_publisher *p, struct channel *channel, const struct lw_pose *pose,
                            uint64_t since, bool has_light) {
    has_light |= !channel->is_published;
#pragma omp parallel for schedule(dynamic, 1) num_threads(p->threads)
    for (uint32_t o = 0; o < p->desc.atlas_map->object_count; o++)
        refresh_object(p, &p->worker[omp_get_thread_num()], channel, o, since, has_light);
    if (has_light && channel->is->coding == LW_TILE_CODING_LIGHT) /* hidden objects have no light, or old */
        channel->dark = LW_PUBLISHER_DARK_SHARE * lw_white_find(&p->white, pose->object_hidden);
}

/* Which tiles of finer levels the solver has; those that it dropped have been withdrawn by now. */
static enum lw_status note_fine(const struct lw_publisher *p, struct lw_snapshot *snapshot) {
    const struct lw_solver *solver = p->desc.solver;
    const uint32_t plain = p->desc.atlas_map->plain_count, room = lw_atlas_map_room(p->desc.atlas_map);
    if (!room || !solver->ops->holds_fine) return LW_OK;
    snapshot->holds_fine = malloc(room * sizeof *snapshot->holds_fine);
    if (!snapshot->holds_fine) return LW_NO_MEMORY;
    for (uint32_t i = 0; i < room; i++)
        snapshot->holds_fine[i] = solver->ops->holds_fine(solver, (lw_tile_id){plain + i});
    return LW_OK;
}

static enum lw_status make_snapshot(struct lw_publisher *p, const struct lw_pose *pose,
                                    struct lw_message_frame *frame, struct lw_snapshot **out_snapshot) {
    const uint32_t tile_count = p->desc.atlas_map->tile_count;
    struct lw_snapshot *snapshot;
    uint32_t channels = 0;
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) channels |= (uint32_t)(p->channel[f] != NULL) << f;
    enum lw_status status = lw_snapshot_create(tile_count, channels, &snapshot);
    if (status != LW_OK) return status;
    snapshot->frame = frame->frame;
    snapshot->time_s = frame->time_s;
    snapshot->previous_frame = p->previous_frame;
    status = lw_frame_message_encode(p->desc.scene, pose, NULL, frame, &snapshot->frame_full);
    frame->base = p->previous_frame;
    if (status == LW_OK)
        status = lw_frame_message_encode(p->desc.scene, pose, &p->previous, frame, &snapshot->frame_delta);
    if (status == LW_OK)
        status = lw_blob_from_message(
            &(struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = frame->frame},
            &snapshot->settled);
    if (status == LW_OK) status = note_fine(p, snapshot);
    if (status != LW_OK) {
        lw_snapshot_unref(snapshot);
        return status;
    }
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++)
        for (uint32_t t = 0; p->channel[f] && t < tile_count; t++) {
            const struct sent_tile *sent = &p->channel[f]->sent[t];
            LW_INVARIANT(!sent->blob == !sent->version);
            if (!sent->blob) continue;
            LW_INVARIANT(sent->version <= lw_snapshot_version(frame->frame) &&
                         (!sent->delta || sent->base < sent->version));
            snapshot->tile[f][t] =
                (struct lw_snapshot_tile){.version = sent->version,
                                          .blob = lw_blob_ref(sent->blob),
                                          .base = sent->base,
                                          .delta = sent->delta ? lw_blob_ref(sent->delta) : NULL,
                                          .change = sent->change};
        }
    *out_snapshot = snapshot;
    return LW_OK;
}

enum lw_status lw_publisher_publish(struct lw_publisher *p, const struct lw_pose *pose, uint64_t frame,
                                    uint64_t solve_ns, uint64_t rays_total, uint64_t tiles_solved,
                                    struct lw_snapshot **out_snapshot, struct lw_publisher_stats *out_stats) {
    struct lw_publisher_stats stats = {0};
    LW_INVARIANT(frame > p->previous_frame && p->since <= frame);
    /* The first time there may be light that no frame of this solver has made. */
    const bool has_light = tiles_solved > 0 || !p->previous_frame || p->since;
    if (!p->since) p->since = frame; /* until all of it is published */
    uint64_t t0 = lw_clock_ns();
    for (int i = 0; i < p->threads; i++) {
        p->worker[i].status = LW_OK;
        p->worker[i].saturated = 0;
        memset(p->worker[i].encoded, 0, sizeof p->worker[i].encoded);
    }
    for (uint32_t o = 0; o < p->desc.atlas_map->object_count; o++) note_unlit(p, pose, o, frame);
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++)
        if (p->channel[f]) refresh_channel(p, p->channel[f], pose, p->since, has_light);
    uint64_t t1 = lw_clock_ns();
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++)
        if (p->channel[f]) {
            encode_tiles(p, p->channel[f], frame);
            enum lw_status status = encode_fine(p, p->channel[f], frame);
            if (status != LW_OK) return status;
        }
    for (int i = 0; i < p->threads; i++) {
        if (p->worker[i].status != LW_OK) return p->worker[i].status;
        for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) {
            stats.tiles_encoded += p->worker[i].encoded[f].tiles;
            stats.bytes_encoded += p->worker[i].encoded[f].bytes;
        }
        stats.split_tiles_encoded += p->worker[i].encoded[LW_TILE_CHANNEL_SPLIT].tiles;
        stats.split_bytes_encoded += p->worker[i].encoded[LW_TILE_CHANNEL_SPLIT].bytes;
        p->saturated += p->worker[i].saturated;
    }
    uint64_t t2 = lw_clock_ns();
    stats.levels_ns = t1 - t0;
    stats.encode_ns = t2 - t1;
    stats.saturated = p->saturated;

    struct lw_message_frame message = {.frame = frame,
                                       .time_s = pose->time_s,
                                       .solve_ns = solve_ns + (t2 - t0),
                                       .rays_total = rays_total,
                                       .tiles_solved = tiles_solved,
                                       .server_cpu_ns = lw_clock_process_cpu_ns()};
    memcpy(message.sky, pose->sky, sizeof message.sky);
    enum lw_status status = make_snapshot(p, pose, &message, out_snapshot);
    if (status != LW_OK) return status;
    lw_pose_copy(&p->previous, pose, p->desc.scene);
    p->previous_frame = frame;
    p->since = 0;
    for (uint32_t o = 0; o < p->desc.atlas_map->object_count; o++)
        if (p->news[o] == LIT_AGAIN) p->unlit[o] = 0;
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++)
        if (p->channel[f]) p->channel[f]->is_published = true;
    *out_stats = stats;
    return LW_OK;
}

static size_t channel_bytes(const struct lw_atlas_map *map, const struct channel *channel) {
    size_t bytes = 0;
    for (uint32_t o = 0; o < map->object_count; o++)
        for (uint32_t l = 0; channel->levels[o] && l < channel->levels[o]->count; l++)
            bytes += (size_t)channel->levels[o]->level[l].width * channel->levels[o]->level[l].height *
                     (4 * channel->is->planes + 1);
    for (uint32_t t = 0; t < map->tile_count; t++) {
        const struct sent_tile *sent = &channel->sent[t];
        if (sent->value)
            bytes += (size_t)map->place[t].width * map->place[t].height * 4 * channel->is->planes;
        if (sent->blob)
            bytes += sent->blob->size + (sent->delta ? sent->delta->size : 0) +
                     (sent->history
                          ? lw_tile_dct_history_size(channel->is, map->place[t].width, map->place[t].height)
                          : 0);
    }
    return bytes;
}

size_t lw_publisher_memory_bytes(const struct lw_publisher *p) {
    size_t bytes = lw_white_memory_bytes(&p->white);
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++)
        if (p->channel[f]) bytes += channel_bytes(p->desc.atlas_map, p->channel[f]);
    return bytes;
}
