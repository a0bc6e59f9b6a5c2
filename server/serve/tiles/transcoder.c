#include "server/serve/tiles/transcoder.h"

#include "common/base/invariant.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

struct lw_transcoder {
    const struct lw_tile_channel *channel;
    const struct lw_atlas_map *atlas_map;
    void (*wake)(void *context);
    void *context;
    pthread_t thread;
    /* The thread's. */
    struct lw_tile_codec *codec;
    uint8_t *payload, *delta; /* lw_tile_codec_bound() each */
    float value[LW_TILE_TEXELS_MAX * LW_TILE_CHANNEL_PLANES_MAX];
    struct coarse {
        struct lw_tile_dct_history *history; /* NULL: none was made */
        uint64_t version;                    /* the last one made; 0: nothing builds on it */
        struct lw_tile_place place;          /* the history's tile's, */
        uint32_t life;                       /* and its life (struct lw_transcoder_job) */
    } * coarse;                              /* by tile id */

    pthread_mutex_t mutex; /* guards what follows */
    pthread_cond_t asked_for;
    uint64_t asked, done, collected; /* jobs so far: each at its number modulo LW_TRANSCODER_JOBS_MAX */
    bool stops;
    struct lw_transcoder_job job[LW_TRANSCODER_JOBS_MAX];
    struct lw_transcoder_result made[LW_TRANSCODER_JOBS_MAX]; /* results of done jobs */
};

static enum lw_status read_tile(const struct lw_blob *blob, struct lw_message *out_message) {
    enum lw_status status = lw_message_decode_whole(blob->bytes, blob->size, out_message);
    if (status == LW_OK && (out_message->type != LW_MESSAGE_TILE || out_message->tile.base ||
                            out_message->tile.codec != LW_TILE_CODEC_DCT)) {
        lw_message_finish(out_message);
        return LW_BAD_DATA;
    }
    return status;
}

/* The counters of jobs; under the mutex. */
static bool is_in_order(const struct lw_transcoder *r) {
    return r->collected <= r->done && r->done <= r->asked &&
           r->asked - r->collected <= LW_TRANSCODER_JOBS_MAX;
}

struct lw_blob *lw_transcoder_encode_delta(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                                           const struct lw_tile_place *place, const struct lw_blob *from,
                                           uint64_t base, const struct lw_blob *to, uint8_t *buffer) {
    struct lw_message old, new;
    struct lw_blob *blob = NULL;
    size_t size;
    if (read_tile(from, &old) != LW_OK) return NULL;
    if (read_tile(to, &new) != LW_OK) {
        lw_message_finish(&old);
        return NULL;
    }
    if (lw_tile_codec_encode_between(codec, channel, old.tile.payload, old.tile.payload_size,
                                     new.tile.payload, new.tile.payload_size, place->width, place->height,
                                     buffer, lw_tile_codec_bound(), &size) == LW_OK &&
        size < new.tile.payload_size) {
        struct lw_message delta = {.type = LW_MESSAGE_TILE, .tile = new.tile};
        delta.tile.base = base;
        delta.tile.payload = buffer;
        delta.tile.payload_size = size;
        if (lw_blob_from_message(&delta, &blob) != LW_OK) blob = NULL;
    }
    lw_message_finish(&new);
    lw_message_finish(&old);
    return blob;
}

/* Any whose power of two the scale of the tile is: then this one has the same. */
static float dark_for(float scale) { return 0.75f * scale; }

static float coarse_step(uint32_t q) {
    return exp2f(1 - (float)(q < LW_TRANSCODER_COARSER_Q ? 0 : q - LW_TRANSCODER_COARSER_Q) / 8);
}

/* An id of a finer level may be another tile's since. */
static void forget_others(struct coarse *coarse, const struct lw_transcoder_job *job) {
    if (coarse->life == job->life && memcmp(&coarse->place, &job->place, sizeof job->place) == 0) return;
    free(coarse->history);
    *coarse = (struct coarse){.place = job->place, .life = job->life};
}

static enum lw_status encode_coarse(struct lw_transcoder *r, struct coarse *coarse,
                                    const struct lw_tile_place *place, const struct lw_message_tile *tile,
                                    struct lw_tile_dct_coded *out_coded) {
    const size_t size = lw_tile_dct_history_size(r->channel, place->width, place->height);
    enum lw_status status =
        lw_tile_codec_decode(r->codec, r->channel, tile->codec, tile->payload, tile->payload_size,
                             tile->scale, place->width, place->height, NULL, r->value);
    if (status != LW_OK) return status;
    LW_INVARIANT(tile->payload_size > 1); /* it holds its step */
    if (!coarse->history) {
        coarse->history = aligned_alloc(_Alignof(struct lw_tile_dct_history), size);
        if (!coarse->history) return LW_NO_MEMORY;
        memset(coarse->history, 0, size);
    }
    /* Texels that are not covered are as smooth as they were made, and count like the rest. */
    return lw_tile_codec_encode_dct(r->codec,
                                    &(struct lw_tile_dct_source){r->value, NULL, place->width, place->height,
                                                                 coarse_step(tile->payload[1]),
                                                                 dark_for(tile->scale), r->channel},
                                    coarse->history, r->payload, r->delta, lw_tile_codec_bound(), out_coded);
}

static void make_coarse(struct lw_transcoder *r, const struct lw_transcoder_job *job,
                        struct lw_transcoder_result *out) {
    struct coarse *coarse = &r->coarse[job->tile];
    struct lw_message m;
    struct lw_tile_dct_coded coded = {0};
    forget_others(coarse, job);
    LW_INVARIANT(job->version > coarse->version); /* asked for in this order */
    if (read_tile(job->to, &m) != LW_OK) return;
    const bool smaller =
        encode_coarse(r, coarse, &job->place, &m.tile, &coded) == LW_OK && coded.size < m.tile.payload_size;
    struct lw_message made = {.type = LW_MESSAGE_TILE, .tile = m.tile};
    made.tile.version = job->version;
    made.tile.scale = coded.scale;
    made.tile.payload = r->payload;
    made.tile.payload_size = coded.size;
    if (smaller && lw_blob_from_message(&made, &out->blob) != LW_OK) out->blob = NULL;
    if (out->blob && coarse->version && coded.delta_size && coded.delta_size < coded.size) {
        made.tile.base = out->delta_base = coarse->version;
        made.tile.payload = r->delta;
        made.tile.payload_size = coded.delta_size;
        if (lw_blob_from_message(&made, &out->delta) != LW_OK) out->delta = NULL;
    }
    coarse->version = out->blob ? job->version : 0; /* nobody has it: nobody may build on it */
    lw_message_finish(&m);
}

static void *work(void *context) {
    struct lw_transcoder *r = context;
    pthread_mutex_lock(&r->mutex);
    while (!r->stops) {
        if (r->done == r->asked) {
            pthread_cond_wait(&r->asked_for, &r->mutex);
            continue;
        }
        LW_INVARIANT(is_in_order(r));
        const uint64_t at = r->done % LW_TRANSCODER_JOBS_MAX;
        const struct lw_transcoder_job job = r->job[at];
        pthread_mutex_unlock(&r->mutex);
        struct lw_transcoder_result made = {.tile = job.tile,
                                            .coarse = job.coarse,
                                            .life = job.life,
                                            .base = job.base,
                                            .version = job.version};
        if (job.from)
            made.blob = lw_transcoder_encode_delta(r->codec, r->channel, &job.place, job.from, job.base,
                                                   job.to, r->payload);
        else
            make_coarse(r, &job, &made);
        pthread_mutex_lock(&r->mutex);
        r->made[at] = made;
        r->done++;
        LW_INVARIANT(is_in_order(r));
        if (r->done == r->asked || r->done == r->collected + 1) r->wake(r->context);
    }
    pthread_mutex_unlock(&r->mutex);
    return NULL;
}

static void free_transcoder(struct lw_transcoder *r) {
    for (uint32_t t = 0; r->coarse && t < r->atlas_map->tile_count; t++) free(r->coarse[t].history);
    free(r->coarse);
    lw_tile_codec_destroy(r->codec);
    free(r->delta);
    free(r->payload);
    free(r);
}

enum lw_status lw_transcoder_create(const struct lw_tile_channel *channel,
                                    const struct lw_atlas_map *atlas_map, void (*wake)(void *context),
                                    void *context, struct lw_transcoder **out_transcoder) {
    struct lw_transcoder *r = calloc(1, sizeof *r);
    if (!r) return LW_NO_MEMORY;
    *r = (struct lw_transcoder){.channel = channel, .atlas_map = atlas_map, .wake = wake, .context = context};
    enum lw_status status = lw_tile_codec_create(&r->codec);
    r->payload = malloc(lw_tile_codec_bound());
    r->delta = malloc(lw_tile_codec_bound());
    r->coarse = calloc((size_t)atlas_map->tile_count + 1, sizeof *r->coarse);
    if (status == LW_OK && !(r->payload && r->delta && r->coarse)) status = LW_NO_MEMORY;
    if (status != LW_OK) {
        free_transcoder(r);
        return status;
    }
    pthread_mutex_init(&r->mutex, NULL); /* glibc's initialisers cannot fail */
    pthread_cond_init(&r->asked_for, NULL);
    if (pthread_create(&r->thread, NULL, work, r) != 0) {
        pthread_cond_destroy(&r->asked_for);
        pthread_mutex_destroy(&r->mutex);
        free_transcoder(r);
        return LW_OS;
    }
    *out_transcoder = r;
    return LW_OK;
}

static void unref_job(struct lw_transcoder_job *job) {
    lw_blob_unref(job->from);
    lw_blob_unref(job->to);
}

void lw_transcoder_destroy(struct lw_transcoder *r) {
    if (!r) return;
    pthread_mutex_lock(&r->mutex);
    r->stops = true;
    pthread_cond_signal(&r->asked_for);
    pthread_mutex_unlock(&r->mutex);
    pthread_join(r->thread, NULL);
    for (struct lw_transcoder_result result; lw_transcoder_collect(r, &result);) {
        lw_blob_unref(result.blob);
        lw_blob_unref(result.delta);
    }
    for (; r->done < r->asked; r->done++) unref_job(&r->job[r->done % LW_TRANSCODER_JOBS_MAX]);
    pthread_cond_destroy(&r->asked_for);
    pthread_mutex_destroy(&r->mutex);
    free_transcoder(r);
}

bool lw_transcoder_ask(struct lw_transcoder *r, const struct lw_transcoder_job *job) {
    LW_INVARIANT(job->tile < r->atlas_map->tile_count && job->version > job->base);
    pthread_mutex_lock(&r->mutex);
    const bool fits = r->asked - r->collected < LW_TRANSCODER_JOBS_MAX;
    if (fits) {
        struct lw_transcoder_job *at = &r->job[r->asked % LW_TRANSCODER_JOBS_MAX];
        *at = *job;
        at->place = r->atlas_map->place[job->tile];
        if (at->from) lw_blob_ref(at->from);
        lw_blob_ref(at->to);
        r->asked++;
        LW_INVARIANT(is_in_order(r));
        pthread_cond_signal(&r->asked_for);
    }
    pthread_mutex_unlock(&r->mutex);
    return fits;
}

bool lw_transcoder_collect(struct lw_transcoder *r, struct lw_transcoder_result *out_result) {
    pthread_mutex_lock(&r->mutex);
    const bool any = r->collected < r->done;
    struct lw_transcoder_job job;
    if (any) {
        const uint64_t at = r->collected++ % LW_TRANSCODER_JOBS_MAX;
        job = r->job[at];
        *out_result = r->made[at];
        LW_INVARIANT(is_in_order(r) && job.tile == out_result->tile && job.version == out_result->version);
    }
    pthread_mutex_unlock(&r->mutex);
    if (any) unref_job(&job);
    return any;
}
