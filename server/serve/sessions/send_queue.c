#include "server/serve/sessions/session_private.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define BATCH_BYTES  (LW_SERVER_QUEUE_MAX / 2) /* one more chunk or tile keeps within LW_SERVER_QUEUE_MAX */
#define TURN_BATCHES 4u                        /* written at once before others get their turn */

_Static_assert(BATCH_BYTES + LW_SESSION_CHUNK + 64 <= LW_SERVER_QUEUE_MAX, "a batch keeps within the queue");
_Static_assert(LW_SESSION_CHUNK <= LW_MESSAGE_CHUNK_MAX, "a chunk is a legal message");

static struct lw_blob *next_pong(struct lw_session *s) {
    if (!s->pong_due) return NULL;
    s->pong_due = false;
    struct lw_blob *blob = NULL;
    struct lw_message message = {.type = LW_MESSAGE_PONG, .pong.token = s->pong_token};
    return lw_blob_from_message(&message, &blob) == LW_OK ? blob : NULL; /* a client can do without */
}

static struct lw_blob *next_ping(struct lw_session *s) {
    if (!s->ping_due) return NULL;
    s->ping_due = false;
    struct lw_blob *blob = NULL;
    struct lw_message message = {.type = LW_MESSAGE_PING, .ping.token = s->number};
    return lw_blob_from_message(&message, &blob) == LW_OK ? blob : NULL; /* then it is not answered either */
}

/* Reports why there is no light for the peer yet, at most once a look, and then that there is light. A
 * session that has light from the start gets no report. */
static struct lw_blob *next_waiting(struct lw_session *s) {
    if (!s->shared->first_light || s->state != LW_SESSION_STREAMING ||
        s->sent_waiting.stage == LW_WAITING_READY)
        return NULL;
    struct lw_waiting_state now = {LW_WAITING_READY, 1};
    if (!lw_tile_stream_has_light(s)) {
        if (!s->first_light_due) return NULL;
        s->first_light_due = false;
        now = lw_waiting_read(s->shared->first_light);
        /* ready: the peer's channels come with the next frame */
        if (now.stage == LW_WAITING_UNKNOWN || now.stage == LW_WAITING_READY) return NULL;
    } else if (s->sent_waiting.stage == LW_WAITING_UNKNOWN) {
        return NULL;
    }
    struct lw_blob *blob = NULL;
    struct lw_message message = {.type = LW_MESSAGE_WAITING, .waiting = {now.stage, now.share}};
    if (lw_blob_from_message(&message, &blob) != LW_OK) return NULL; /* the next look finds it again */
    s->sent_waiting = now;
    s->sent_waiting_ns = lw_clock_ns();
    return blob;
}

static bool holds_part(const struct lw_session_sending *sending, uint32_t part) {
    return sending->held && sending->held[part / 8] >> (part % 8) & 1;
}

/* The next chunk is one that the peer asked for, or the end. */
static void skip_held(struct lw_session_sending *sending) {
    while (sending->next < sending->of->chunk_count &&
           holds_part(sending, sending->of->chunk[sending->next].part))
        sending->next++;
}

static bool has_chunks(const struct lw_session_sending *sending) {
    return sending->of && (sending->partial || sending->next < sending->of->chunk_count);
}

static struct lw_blob *next_chunk(struct lw_session_sending *sending) {
    struct lw_blob *blob = sending->partial;
    sending->partial = NULL;
    if (blob || !has_chunks(sending)) return blob;
    blob = lw_blob_ref(sending->of->chunk[sending->next++].blob);
    skip_held(sending);
    return blob;
}

/* A request from inside a chunk: the rest of that chunk becomes a message of its own. */
static enum lw_status cut_chunk(struct lw_session_sending *sending, const struct lw_blob *whole,
                                uint64_t offset) {
    struct lw_message message;
    enum lw_status status = lw_message_decode_whole(whole->bytes, whole->size, &message);
    if (status != LW_OK) return status;
    const struct lw_message_package_chunk *chunk = &message.package_chunk; /* FINISH_CHUNK is the same */
    const size_t skip = (size_t)(offset - chunk->offset);
    LW_INVARIANT(offset > chunk->offset && skip < chunk->size); /* inside, as its end says */
    const struct lw_message rest = {.type = message.type,
                                    .package_chunk = {offset, chunk->data + skip, chunk->size - skip}};
    status = lw_blob_from_message(&rest, &sending->partial);
    lw_message_finish(&message);
    return status;
}

/* False if there is no memory. */
static bool take_up_held(struct lw_session_sending *sending, size_t part_count,
                         const struct lw_message_package_request *request) {
    const size_t size = part_count / 8 + 1;
    if (!request->held_size) return true;
    if (!(sending->held = calloc(size, 1))) return false;
    memcpy(sending->held, request->held, request->held_size < size ? request->held_size : size);
    return true;
}

bool lw_send_queue_start(struct lw_session_sending *sending, const struct lw_session_package *package,
                         size_t part_count, const struct lw_message_package_request *request) {
    if (!take_up_held(sending, part_count, request)) return false;
    uint32_t at = 0;
    while (at < package->chunk_count && package->chunk[at].end <= request->offset) at++;
    const bool inside = request->offset > (at ? package->chunk[at - 1].end : 0);
    LW_INVARIANT(!sending->of && (!inside || at < package->chunk_count));
    if (inside && !holds_part(sending, package->chunk[at].part) &&
        cut_chunk(sending, package->chunk[at].blob, request->offset) != LW_OK)
        return false;
    sending->of = package;
    sending->next = at + inside;
    skip_held(sending);
    LW_INVARIANT(sending->next <= package->chunk_count);
    return true;
}

/* Finishes never delay the first light, and later they leave tiles most of a full link. */
static struct lw_blob *next_finish_chunk(struct lw_session *s, bool tiles_wait) {
    if (!has_chunks(&s->finishes) || !s->has_first_light) return NULL;
    if (tiles_wait && s->tiles_before > 0) return NULL;
    struct lw_blob *blob = next_chunk(&s->finishes);
    s->tiles_before = LW_SESSION_TILES_FIRST * (int64_t)blob->size;
    return blob;
}

static void count_tile(struct lw_session *s, const struct lw_blob *tile) {
    if (s->tiles_before > 0) s->tiles_before -= (int64_t)tile->size;
    if (!s->has_first_light && ++s->first_sent >= s->shared->first_tiles) s->has_first_light = true;
}

/* Whether the rate limit lets light through, or the package: both may be large and can wait. */
static bool is_allowed(struct lw_session *s) {
    if (s->rate_limit_bytes_hz && s->allowance <= 0) s->is_paced = s->link_was_full = true;
    return !s->is_paced;
}

/* A reference to the next blob to send, or NULL if the session lacks nothing, or may not have it now. */
static struct lw_blob *next_blob(struct lw_session *s, bool *out_tile) {
    *out_tile = false;
    struct lw_blob *blob = s->control;
    s->control = NULL;
    if (blob || s->state == LW_SESSION_LEAVING) return blob;
    if ((blob = next_pong(s)) || (blob = next_ping(s)) || (blob = next_waiting(s))) return blob;
    const bool framed =
        s->state == LW_SESSION_STREAMING && !has_chunks(&s->package) && lw_tile_stream_has_light(s);
    if (framed && (blob = lw_tile_stream_next_frame(s))) return blob;
    if ((blob = lw_session_take_answer(s))) return blob; /* after the frame that shows what it answers */
    if (!is_allowed(s)) return NULL;
    if (!framed) return s->state == LW_SESSION_STREAMING ? next_chunk(&s->package) : NULL;
    if ((blob = next_finish_chunk(s, true))) return blob;
    if ((blob = lw_tile_stream_next_tile(s))) {
        *out_tile = true;
        count_tile(s, blob);
        return blob;
    }
    if ((blob = lw_tile_stream_next_settled(s))) s->has_first_light = true;
    return blob ? blob : next_finish_chunk(s, false);
}

struct batch {
    uint32_t blob_count, tile_count;
    size_t bytes;
    struct lw_blob *blob[LW_SESSION_TRANSPORT_BLOBS];
};

static void take_batch(struct lw_session *s, struct batch *batch) {
    LW_INVARIANT(!s->is_writing); /* else what the link has would be lost */
    batch->blob_count = batch->tile_count = 0;
    batch->bytes = 0;
    while (batch->blob_count < LW_SESSION_TRANSPORT_BLOBS && batch->bytes < BATCH_BYTES && !s->lacks_memory) {
        bool tile;
        struct lw_blob *blob = next_blob(s, &tile);
        if (!blob) break;
        batch->blob[batch->blob_count++] = blob;
        batch->bytes += blob->size;
        batch->tile_count += tile;
        s->allowance -= (double)blob->size;
    }
}

/* Returns 0 or libuv's error. */
static int write_batch(struct lw_session *s, const struct batch *batch) {
    const int written = s->link->ops->write(s->link, batch->blob, batch->blob_count);
    if (written < 0) return written;
    LW_INVARIANT((size_t)written <= batch->bytes && batch->tile_count <= batch->blob_count);
    s->given += batch->bytes;
    s->writing = batch->bytes - (size_t)written;
    s->is_writing = s->writing > 0;
    lw_session_count(s->shared, &s->shared->stats.tiles_sent, batch->tile_count);
    lw_session_count(s->shared, &s->shared->stats.bytes_sent, written);
    return 0;
}

/* Writes until the link is full, nothing is left, or others should have their turn. */
bool lw_send_queue_write(struct lw_session *s) {
    for (unsigned round = 0; round < TURN_BATCHES && !s->is_writing && s->state != LW_SESSION_CLOSED;
         round++) {
        struct batch batch;
        take_batch(s, &batch);
        if (!batch.blob_count) return true;
        int result = write_batch(s, &batch);
        if (result < 0) lw_session_lost(s, result);
    }
    return false;
}

void lw_send_queue_renew_allowance(struct lw_session *s, uint64_t now_ns) {
    const double rate_hz = (double)s->rate_limit_bytes_hz, since_s = 1e-9 * (double)(now_ns - s->allowed_ns);
    s->allowance = fmin(s->allowance + rate_hz * since_s, 1e-3 * LW_SERVER_BURST_MS * rate_hz);
    LW_INVARIANT(now_ns >= s->allowed_ns && isfinite(s->allowance));
    s->allowed_ns = now_ns;
    s->is_paced = false;
}
