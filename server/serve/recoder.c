#include "server/serve/recoder.h"

#include "common/tile/tile_codec.h"

#include <pthread.h>
#include <stdlib.h>

struct lw_recoder {
    const struct lw_atlas_map *atlas_map;
    void (*wake)(void *context);
    void *context;
    pthread_t thread;
    struct lw_tile_codec *codec; /* the thread's, as is payload */
    uint8_t *payload;            /* lw_tile_codec_bound() */

    pthread_mutex_t mutex; /* guards what follows */
    pthread_cond_t asked_for;
    uint64_t asked, done, collected; /* jobs so far: each at its number modulo LW_RECODER_JOBS_MAX */
    bool stops;
    struct lw_recoder_job job[LW_RECODER_JOBS_MAX];
    struct lw_blob *made[LW_RECODER_JOBS_MAX]; /* of those that are done */
};

static enum lw_status read_tile(const struct lw_blob *blob, struct lw_message *out_message) {
    struct lw_frame_header header;
    enum lw_status status = lw_frame_read_header(blob->bytes, LW_FRAME_BODY_MAX, &header, NULL);
    if (status == LW_OK)
        status = lw_message_decode(header, blob->bytes + LW_FRAME_HEADER_SIZE, out_message, NULL);
    if (status == LW_OK && (out_message->type != LW_MESSAGE_TILE || out_message->tile.base ||
                            out_message->tile.codec != LW_TILE_CODEC_DCT)) {
        lw_message_finish(out_message);
        return LW_BAD_DATA;
    }
    return status;
}

/* NULL is no failure that anybody must hear of: there are other ways to the version. */
static struct lw_blob *make_delta(struct lw_recoder *r, const struct lw_recoder_job *job) {
    const struct lw_tile_place *place = &r->atlas_map->place[job->tile];
    struct lw_message from, to;
    struct lw_blob *blob = NULL;
    size_t size;
    if (read_tile(job->from, &from) != LW_OK) return NULL;
    if (read_tile(job->to, &to) != LW_OK) {
        lw_message_finish(&from);
        return NULL;
    }
    if (lw_tile_codec_encode_between(r->codec, from.tile.payload, from.tile.payload_size, to.tile.payload,
                                     to.tile.payload_size, place->width, place->height, r->payload,
                                     lw_tile_codec_bound(), &size) == LW_OK &&
        size < to.tile.payload_size) {
        struct lw_message delta = {.type = LW_MESSAGE_TILE, .tile = to.tile};
        delta.tile.base = job->base;
        delta.tile.payload = r->payload;
        delta.tile.payload_size = size;
        if (lw_blob_from_message(&delta, &blob) != LW_OK) blob = NULL;
    }
    lw_message_finish(&to);
    lw_message_finish(&from);
    return blob;
}

static void *work(void *context) {
    struct lw_recoder *r = context;
    pthread_mutex_lock(&r->mutex);
    while (!r->stops) {
        if (r->done == r->asked) {
            pthread_cond_wait(&r->asked_for, &r->mutex);
            continue;
        }
        const uint64_t at = r->done % LW_RECODER_JOBS_MAX;
        const struct lw_recoder_job job = r->job[at];
        pthread_mutex_unlock(&r->mutex);
        struct lw_blob *made = make_delta(r, &job);
        pthread_mutex_lock(&r->mutex);
        r->made[at] = made;
        r->done++;
        if (r->done == r->asked || r->done == r->collected + 1) r->wake(r->context);
    }
    pthread_mutex_unlock(&r->mutex);
    return NULL;
}

static void free_recoder(struct lw_recoder *r) {
    lw_tile_codec_destroy(r->codec);
    free(r->payload);
    free(r);
}

enum lw_status lw_recoder_create(const struct lw_atlas_map *atlas_map, void (*wake)(void *context),
                                 void *context, struct lw_recoder **out_recoder) {
    struct lw_recoder *r = calloc(1, sizeof *r);
    if (!r) return LW_NO_MEMORY;
    *r = (struct lw_recoder){.atlas_map = atlas_map, .wake = wake, .context = context};
    enum lw_status status = lw_tile_codec_create(&r->codec);
    if (status == LW_OK && !(r->payload = malloc(lw_tile_codec_bound()))) status = LW_NO_MEMORY;
    if (status != LW_OK) {
        free_recoder(r);
        return status;
    }
    pthread_mutex_init(&r->mutex, NULL); /* glibc's initialisers cannot fail */
    pthread_cond_init(&r->asked_for, NULL);
    if (pthread_create(&r->thread, NULL, work, r) != 0) {
        pthread_cond_destroy(&r->asked_for);
        pthread_mutex_destroy(&r->mutex);
        free_recoder(r);
        return LW_OS;
    }
    *out_recoder = r;
    return LW_OK;
}

static void unref_job(struct lw_recoder_job *job) {
    lw_blob_unref(job->from);
    lw_blob_unref(job->to);
}

void lw_recoder_destroy(struct lw_recoder *r) {
    if (!r) return;
    pthread_mutex_lock(&r->mutex);
    r->stops = true;
    pthread_cond_signal(&r->asked_for);
    pthread_mutex_unlock(&r->mutex);
    pthread_join(r->thread, NULL);
    for (struct lw_recoder_result result; lw_recoder_collect(r, &result);) lw_blob_unref(result.blob);
    for (; r->done < r->asked; r->done++) unref_job(&r->job[r->done % LW_RECODER_JOBS_MAX]);
    pthread_cond_destroy(&r->asked_for);
    pthread_mutex_destroy(&r->mutex);
    free_recoder(r);
}

bool lw_recoder_ask(struct lw_recoder *r, const struct lw_recoder_job *job) {
    pthread_mutex_lock(&r->mutex);
    const bool fits = r->asked - r->collected < LW_RECODER_JOBS_MAX;
    if (fits) {
        struct lw_recoder_job *at = &r->job[r->asked % LW_RECODER_JOBS_MAX];
        *at = *job;
        lw_blob_ref(at->from);
        lw_blob_ref(at->to);
        r->asked++;
        pthread_cond_signal(&r->asked_for);
    }
    pthread_mutex_unlock(&r->mutex);
    return fits;
}

bool lw_recoder_collect(struct lw_recoder *r, struct lw_recoder_result *out_result) {
    pthread_mutex_lock(&r->mutex);
    const bool any = r->collected < r->done;
    struct lw_recoder_job job;
    if (any) {
        const uint64_t at = r->collected++ % LW_RECODER_JOBS_MAX;
        job = r->job[at];
        *out_result = (struct lw_recoder_result){job.tile, job.base, job.version, r->made[at]};
    }
    pthread_mutex_unlock(&r->mutex);
    if (any) unref_job(&job);
    return any;
}
