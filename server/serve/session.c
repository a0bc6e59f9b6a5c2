#include "server/serve/session.h"

#include "common/clock.h"
#include "common/log.h"
#include "proto/message_reader.h"
#include "server/serve/message_rates.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BATCH_BYTES      (LW_SERVER_QUEUE_MAX / 2) /* one more chunk or tile keeps within LW_SERVER_QUEUE_MAX */
#define TURN_BATCHES     4u                        /* written at once before others get their turn */
#define LINGER_NS        1000000000u               /* from a refusal to the close */
#define TURN_MESSAGES    256u                      /* handled at once before others get their turn */
#define AHEAD            32u                       /* tiles for which a session asks the transcoder at once */
#define FULL_GRACE_COUNT 1024u                     /* refused connections that may wait for their close */

_Static_assert(BATCH_BYTES + LW_SESSION_CHUNK + 64 <= LW_SERVER_QUEUE_MAX, "a batch keeps within the queue");
_Static_assert(LW_SESSION_CHUNK <= LW_MESSAGE_CHUNK_MAX, "a chunk is a legal message");

enum state {
    EXPECTS_HELLO,
    WELCOMED,  /* may ask for the package */
    STREAMING, /* package chunks, then frames and tiles */
    LEAVING,   /* was refused: what it sends is dropped */
    CLOSED     /* waits for its link */
};

/* One UPDATED. */
struct answer {
    struct answer *next;
    struct lw_blob *blob;
};

/* What an INTEREST said. */
struct interest {
    bool everything, stand_ins;
    uint32_t tile_count;
    uint32_t *tile; /* lw_tile_id, each once */
};

struct lw_session {
    struct lw_session_transport *link;
    struct lw_session_shared *shared;
    struct lw_session *previous, *next;
    struct lw_session_form *form;   /* of light, that it gets */
    struct lw_session_queue *queue; /* in which it waits for its turn; NULL: in none */
    struct lw_session *previous_due, *next_due;
    enum state state;
    bool ended, welcomed;
    bool has_place;           /* of its address */
    bool controls;            /* may send updates */
    enum lw_tokens_role role; /* by its token; NONE: it needed none */
    struct lw_token token;    /* then, of that role */
    bool resumes;             /* may say what it has */
    uint64_t number;
    struct lw_session_peer peer;
    char name[2 * LW_MESSAGE_NAME_MAX + 4]; /* in quotes; "": no HELLO yet */
    uint64_t since_ns;                      /* connected; in LEAVING: refused */
    struct lw_message_reader input;
    struct lw_message_rates rates;  /* of what it says */
    struct lw_session_inbox *inbox; /* in which it is: then nothing is read; NULL: in none */
    struct lw_session *previous_unread, *next_unread;
    uint64_t looked_ns; /* when the tick last came */
    uint64_t heard_ns;  /* when bytes last came */

    struct lw_blob *control; /* welcome or refusal */
    enum lw_refusal refusal; /* in LEAVING */
    char refusal_text[LW_MESSAGE_TEXT_MAX + 1];
    bool pong_due, ping_due;
    bool pinged; /* since it was heard */
    uint64_t pong_token;
    struct answer *first_answer, *last_answer; /* to updates, not sent yet */
    uint32_t answer_count;
    struct lw_blob *partial_chunk; /* where a package request starts inside a chunk */
    uint32_t next_chunk;
    uint8_t *held; /* bit per part of the package that is not sent; NULL: all are */
    uint64_t frame_sent, frame_acked;
    bool settled_due;                  /* of the one sent */
    uint64_t *sent;                    /* per tile: the version sent; NULL before that matters */
    struct interest interest, waiting; /* what holds; what came since, if has_waiting */
    bool has_waiting;
    uint64_t interest_epoch; /* of the server, when interest was last taken up */
    uint64_t *
        wanted; /* bit per tile: to be sent; NULL: everything. Then once more: those that are not stand-ins */
    uint64_t generation;  /* of the snapshot that the walk below goes over */
    uint32_t *lacked;     /* what the walk goes over: tiles that it lacks, by priority; NULL: those that the
                                snapshot changed, as it had all of the one before */
    bool delta_follows;   /* to the delta sent last: of the tile that is looked at next */
    bool waits;           /* for what the transcoder makes of that tile */
    bool is_narrow;       /* its link takes less than changes: it gets coarse tiles before finer ones */
    bool refines;         /* narrow: it has all of these, and the walk goes over what they lack */
    bool link_was_full;   /* since the snapshot was new; */
    uint64_t judged;      /* its generation */
    uint32_t walk_left;   /* tiles still to look at */
    uint32_t walk_cursor; /* in lacked, or in changed */

    uint64_t rate_limit_bytes_hz; /* 0: none */
    double allowance;             /* bytes that it may be sent now; below 0: it has had too much */
    uint64_t allowed_ns;          /* as of then */
    bool is_paced;                /* something would have been sent but for that */

    bool is_writing;     /* the link has not taken all yet */
    uint64_t writing;    /* bytes of that */
    uint64_t given;      /* bytes handed to the link so far */
    uint64_t taken_last; /* of these the peer's, when progress was last looked at */
    uint64_t progress_ns;
};

struct lw_session *lw_session_next(const struct lw_session *session) {
    return session->next;
}

static void count(struct lw_session_shared *shared, uint64_t *counter, int64_t change) {
    uv_mutex_lock(&shared->stats_mutex);
    *counter += (uint64_t)change;
    uv_mutex_unlock(&shared->stats_mutex);
}

/* A line about a peer, unless there were many. */
static void LW_PRINTF(2, 3) tell(const struct lw_session *s, const char *format, ...) {
    char text[LW_MESSAGE_TEXT_MAX + 100];
    if (!lw_peer_log_allows(&s->shared->log, &s->peer.at, s->peer.address, lw_clock_ns())) return;
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    lw_log(LW_LOG_INFO, "session %" PRIu64 ": %s%s%s %s", s->number, s->peer.address, *s->name ? " " : "",
           s->name, text);
}

/* ---- what to send next ---- */

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

static struct lw_blob *next_answer(struct lw_session *s) {
    struct answer *answer = s->first_answer;
    if (!answer) return NULL;
    struct lw_blob *blob = answer->blob;
    s->first_answer = answer->next;
    if (!s->first_answer) s->last_answer = NULL;
    s->answer_count--;
    free(answer);
    return blob;
}

static bool holds_part(const struct lw_session *s, uint32_t part) {
    return s->held && s->held[part / 8] >> (part % 8) & 1;
}

/* What comes next is a chunk that the peer asked for, or the end. */
static void skip_held(struct lw_session *s) {
    const struct lw_session_shared *shared = s->shared;
    while (s->next_chunk < shared->chunk_count && holds_part(s, shared->chunk[s->next_chunk].part))
        s->next_chunk++;
}

static struct lw_blob *next_chunk(struct lw_session *s) {
    struct lw_blob *blob = s->partial_chunk;
    s->partial_chunk = NULL;
    if (blob || s->next_chunk == s->shared->chunk_count) return blob;
    blob = lw_blob_ref(s->shared->chunk[s->next_chunk++].blob);
    skip_held(s);
    return blob;
}

static struct lw_blob *next_frame(struct lw_session *s) {
    const struct lw_snapshot *snapshot = s->form->snapshot;
    if (s->frame_sent == snapshot->frame) return NULL;
    bool builds_on = snapshot->frame_delta && s->frame_sent && s->frame_sent == snapshot->previous_frame;
    struct lw_blob *blob = builds_on ? snapshot->frame_delta : snapshot->frame_full;
    s->frame_sent = snapshot->frame;
    s->settled_due = true;
    return blob ? lw_blob_ref(blob) : NULL;
}

static bool is_coarsest(const struct lw_atlas_map *map, uint32_t tile) {
    return map->place[tile].level + 1 == map->atlas[map->place[tile].object].level_count;
}

static size_t bit_words(const struct lw_atlas_map *map) { return (size_t)map->tile_count / 64 + 1; }

static bool is_set(const uint64_t *bits, uint32_t tile) { return bits[tile / 64] >> (tile % 64) & 1; }

static bool takes_coarse(const struct lw_session *s) { return s->is_narrow && !s->refines; }

static const struct lw_snapshot_tile *newest_of(const struct lw_session *s, uint32_t tile) {
    return &s->form->snapshot->tile[s->form->form][tile];
}

/* The version of a tile that will do. */
static uint64_t wanted_version(const struct lw_session *s, uint32_t tile) {
    const uint64_t newest = newest_of(s, tile)->version;
    return takes_coarse(s) ? lw_snapshot_coarse_version(newest) : newest;
}

static bool lacks(const struct lw_session *s, uint32_t tile) {
    const struct lw_atlas_map *map = s->shared->atlas_map;
    const struct lw_snapshot_tile *now = newest_of(s, tile);
    if (!now->blob || wanted_version(s, tile) <= s->sent[tile]) return false;
    if (!s->wanted || is_set(s->wanted + bit_words(map), tile)) return true;
    const bool covers = is_set(s->wanted, tile);
    if (covers && map->place[tile].level <= LW_ATLAS_READ_MAX) return true;
    if (!covers && !(s->interest.stand_ins && is_coarsest(map, tile))) return false;
    return lw_priority_is_due_to_stand_in(&s->form->priority, tile, lw_snapshot_frame_of(s->sent[tile]),
                                          lw_snapshot_frame_of(now->version));
}

static void end_walk(struct lw_session *s) {
    free(s->lacked);
    s->lacked = NULL;
    s->walk_left = s->walk_cursor = 0;
    s->delta_follows = false;
}

/* Makes the list of what a session lacks of the newest snapshot. */
static void walk_lacked(struct lw_session *s) {
    const struct lw_session_shared *shared = s->shared;
    struct lw_priority *priority = &s->form->priority;
    end_walk(s);
    lw_priority_list_begin(priority);
    for (uint32_t i = 0; i < shared->atlas_map->tile_count; i++) {
        const uint32_t id = shared->order[i];
        if (!lacks(s, id)) continue;
        lw_priority_list(
            priority, id,
            lw_priority_of(priority, id, lw_snapshot_frame_of(s->sent[id]), s->form->snapshot->frame));
    }
    if (!priority->listed_count) return;
    if (!(s->lacked = malloc(priority->listed_count * sizeof *s->lacked))) {
        lw_session_close(s, "out of memory");
        return;
    }
    lw_priority_list_end(priority, s->lacked);
    s->walk_left = priority->listed_count;
}

/* Whoever has not had all of the last snapshot when the next one comes, and not for want of turns, is on a narrow link. */
static void judge_link(struct lw_session *s) {
    if (s->judged == s->form->generation) return;
    s->judged = s->form->generation;
    if (s->walk_left && s->link_was_full && s->form->transcoder) s->is_narrow = true;
    s->link_was_full = false;
}

/* A session that had everything looks at what changed, in the order that all such sessions share; any other has its own. */
static void start_walk(struct lw_session *s) {
    const bool had_all = s->walk_left == 0 && s->generation + 1 == s->form->generation;
    judge_link(s);
    s->generation = s->form->generation;
    s->refines = false;
    if (!had_all) {
        walk_lacked(s);
        return;
    }
    end_walk(s);
    s->walk_left = s->form->changed_count;
}

/* What it will want next is asked for together. */
static void prepare_ahead(struct lw_session *s, const uint32_t *list) {
    const uint32_t count = s->walk_left < AHEAD ? s->walk_left : AHEAD;
    for (uint32_t i = 1; i < count; i++) {
        const uint32_t id = list[s->walk_cursor + i];
        if (lacks(s, id)) lw_deltas_prepare(&s->form->deltas, id, s->sent[id], takes_coarse(s));
    }
}

static struct lw_blob *next_tile_of_walk(struct lw_session *s) {
    const uint32_t *list = s->lacked ? s->lacked : s->form->changed;
    for (; s->walk_left; s->walk_cursor++, s->walk_left--) {
        const uint32_t id = list[s->walk_cursor];
        if (!s->delta_follows && !lacks(s, id)) continue;
        struct lw_delta delta;
        if (lw_deltas_next(&s->form->deltas, id, s->sent[id], takes_coarse(s), &delta) == LW_DELTAS_WAIT) {
            prepare_ahead(s, list);
            s->waits = true;
            return NULL;
        }
        s->sent[id] = delta.version;
        s->delta_follows = delta.version < wanted_version(s, id);
        if (!s->delta_follows) {
            s->walk_cursor++;
            s->walk_left--;
        }
        return lw_blob_ref(delta.blob);
    }
    end_walk(s);
    return NULL;
}

/* A narrow session that has all goes on with what is finer, until that is all, or there is a new snapshot. */
static struct lw_blob *next_tile(struct lw_session *s) {
    struct lw_blob *blob = next_tile_of_walk(s);
    if (blob || s->waits || !s->is_narrow) return blob;
    if (!s->refines) {
        s->refines = true;
        walk_lacked(s);
        if ((blob = next_tile_of_walk(s)) || s->waits) return blob;
    }
    s->is_narrow = s->refines = false;
    return NULL;
}

/* Once no tile is left. */
static struct lw_blob *next_settled(struct lw_session *s) {
    if (!s->settled_due || s->waits) return NULL;
    s->settled_due = false;
    return s->form->snapshot->settled ? lw_blob_ref(s->form->snapshot->settled) : NULL;
}

/* Whether the rate limit lets light through, or the package: what may be large and can wait. */
static bool is_allowed(struct lw_session *s) {
    if (s->rate_limit_bytes_hz && s->allowance <= 0) s->is_paced = s->link_was_full = true;
    return !s->is_paced;
}

/* Newcomers wait for a snapshot with their form: what there is of it may be of a time when somebody else
 * took it. */
static bool has_current_light(const struct lw_session *s) {
    return s->form->snapshot && (s->frame_sent || s->form->snapshot == s->shared->snapshot);
}

/* A reference to the next blob to send, or NULL if the session lacks nothing, or may not have it now. */
static struct lw_blob *next_blob(struct lw_session *s, bool *out_tile) {
    *out_tile = false;
    struct lw_blob *blob = s->control;
    s->control = NULL;
    if (blob || s->state == LEAVING) return blob;
    if ((blob = next_pong(s)) || (blob = next_ping(s))) return blob;
    const bool framed = s->state == STREAMING && !s->partial_chunk &&
                        s->next_chunk == s->shared->chunk_count && has_current_light(s);
    if (framed) {
        if (s->generation != s->form->generation) start_walk(s);
        if ((blob = next_frame(s))) return blob;
    }
    if ((blob = next_answer(s))) return blob; /* after the frame that shows what it answers */
    if (!is_allowed(s)) return NULL;
    if (!framed) return s->state == STREAMING ? next_chunk(s) : NULL;
    blob = next_tile(s);
    *out_tile = blob != NULL;
    return blob ? blob : next_settled(s);
}

/* ---- interest ---- */

/* Sets a tile's bit; returns whether it was set. */
static bool test_and_set(uint64_t *bits, uint32_t tile) {
    const uint64_t bit = 1ull << (tile % 64);
    const bool before = bits[tile / 64] & bit;
    bits[tile / 64] |= bit;
    return before;
}

/* Makes a session's bits those of listed tiles, and with stand-ins of the coarser ones that cover the same. */
static void mark(struct lw_session *s) {
    const struct lw_atlas_map *map = s->shared->atlas_map;
    uint64_t *listed_bits = s->wanted + bit_words(map);
    memset(s->wanted, 0, 2 * bit_words(map) * sizeof *s->wanted);
    for (uint32_t i = 0; i < s->interest.tile_count; i++) {
        const uint32_t listed = s->interest.tile[i];
        const struct lw_tile_place *place = &map->place[listed];
        test_and_set(listed_bits, listed);
        /* above a tile that has its bit all have theirs */
        if (test_and_set(s->wanted, listed) || !s->interest.stand_ins) continue;
        for (uint32_t l = place->level + 1; l < map->atlas[place->object].level_count; l++) {
            const uint32_t up = l - place->level;
            if (test_and_set(s->wanted,
                             lw_atlas_map_find(map, place->object, l, place->x >> up, place->y >> up).v))
                break;
        }
    }
}

/* One session more, or less, that takes light in this form. */
static void count_taker(struct lw_session_form *form, _Atomic uint32_t *forms_taken, bool more) {
    if (more ? !form->session_count++ : !--form->session_count) *forms_taken ^= 1u << form->form;
}

static void count_in(struct lw_session *s, const struct interest *interest) {
    if (interest->everything)
        lw_interest_union_add_everything(&s->shared->interest_union);
    else
        lw_interest_union_add(&s->shared->interest_union, interest->tile, interest->tile_count);
}

static void count_out(struct lw_session *s, const struct interest *interest) {
    if (interest->everything)
        lw_interest_union_remove_everything(&s->shared->interest_union);
    else
        lw_interest_union_remove(&s->shared->interest_union, interest->tile, interest->tile_count);
}

/* What has waited holds from now on. */
static void take_up_interest(struct lw_session *s) {
    const struct lw_atlas_map *map = s->shared->atlas_map;
    struct interest before = s->interest;
    if (s->waiting.everything) {
        free(s->wanted);
        s->wanted = NULL;
    } else if (!s->wanted && !(s->wanted = calloc(2 * bit_words(map), sizeof *s->wanted))) {
        lw_session_close(s, "out of memory");
        return;
    }
    s->interest = s->waiting;
    s->waiting = (struct interest){0};
    s->has_waiting = false;
    s->interest_epoch = s->shared->epoch;
    if (s->wanted) mark(s);
    if (s->state == STREAMING) { /* in this order, so that what is still wanted never counts as unwanted */
        count_in(s, &s->interest);
        count_out(s, &before);
    }
    free(before.tile);
    s->settled_due = s->frame_sent > 0;
    s->generation = 0; /* a walk anew */
}

/* ---- writing ---- */

struct batch {
    uint32_t blob_count, tile_count;
    size_t bytes;
    struct lw_blob *blob[LW_SESSION_TRANSPORT_BLOBS];
};

static void take_batch(struct lw_session *s, struct batch *batch) {
    batch->blob_count = batch->tile_count = 0;
    batch->bytes = 0;
    while (batch->blob_count < LW_SESSION_TRANSPORT_BLOBS && batch->bytes < BATCH_BYTES) {
        bool tile;
        struct lw_blob *blob = next_blob(s, &tile);
        if (!blob) break;
        batch->blob[batch->blob_count++] = blob;
        batch->bytes += blob->size;
        batch->tile_count += tile;
        s->allowance -= (double)blob->size;
    }
}

/* A client that leaves with light unread on its link resets it: nothing went wrong. */
static const char *reason(int result) {
    return result == UV_ECONNRESET || result == UV_EPIPE || result == UV_EOF ? "closed by the peer"
                                                                             : uv_strerror(result);
}

void lw_session_written(struct lw_session *s, int result, bool was_full) {
    s->is_writing = false;
    if (s->state == CLOSED) return;
    if (result < 0) {
        lw_session_close(s, reason(result));
        return;
    }
    count(s->shared, &s->shared->stats.bytes_sent, (int64_t)s->writing);
    s->link_was_full |= was_full;
    lw_session_set_due(s, false);
}

/* Returns 0 or libuv's error. */
static int write_batch(struct lw_session *s, const struct batch *batch) {
    const int written = s->link->ops->write(s->link, batch->blob, batch->blob_count);
    if (written < 0) return written;
    s->given += batch->bytes;
    s->writing = batch->bytes - (size_t)written;
    s->is_writing = s->writing > 0;
    count(s->shared, &s->shared->stats.tiles_sent, batch->tile_count);
    count(s->shared, &s->shared->stats.bytes_sent, written);
    return 0;
}

/* Writes until the link is full, nothing is left, or others should have their turn. */
static bool write_batches(struct lw_session *s) {
    for (unsigned round = 0; round < TURN_BATCHES && !s->is_writing && s->state != CLOSED; round++) {
        struct batch batch;
        take_batch(s, &batch);
        if (!batch.blob_count) return true;
        int result = write_batch(s, &batch);
        if (result < 0) lw_session_close(s, reason(result));
    }
    return false;
}

/* ---- whose turn it is ---- */

static void dequeue(struct lw_session *s) {
    struct lw_session_queue *queue = s->queue;
    if (!queue) return;
    s->queue = NULL;
    *(s->previous_due ? &s->previous_due->next_due : &queue->first) = s->next_due;
    *(s->next_due ? &s->next_due->previous_due : &queue->last) = s->previous_due;
}

/* At its end; and out of the one that it was in. */
static void enqueue(struct lw_session *s, struct lw_session_queue *queue) {
    dequeue(s);
    s->queue = queue;
    s->next_due = NULL;
    s->previous_due = queue->last;
    *(queue->last ? &queue->last->next_due : &queue->first) = s;
    queue->last = s;
}

static void leave_inbox(struct lw_session *s) {
    struct lw_session_inbox *inbox = s->inbox;
    if (!inbox) return;
    s->inbox = NULL;
    *(s->previous_unread ? &s->previous_unread->next_unread : &inbox->first) = s->next_unread;
    *(s->next_unread ? &s->next_unread->previous_unread : &inbox->last) = s->previous_unread;
}

/* At its end. The link keeps what it has meanwhile, and so does the peer. */
static void enter_inbox(struct lw_session *s, struct lw_session_inbox *inbox) {
    if (!s->inbox) s->link->ops->read(s->link, false);
    leave_inbox(s);
    s->inbox = inbox;
    s->next_unread = NULL;
    s->previous_unread = inbox->last;
    *(inbox->last ? &inbox->last->next_unread : &inbox->first) = s;
    inbox->last = s;
}

static void renew_allowance(struct lw_session *s, uint64_t now_ns) {
    const double rate_hz = (double)s->rate_limit_bytes_hz, since_s = 1e-9 * (double)(now_ns - s->allowed_ns);
    s->allowance = fmin(s->allowance + rate_hz * since_s, 1e-3 * LW_SERVER_BURST_MS * rate_hz);
    s->allowed_ns = now_ns;
    s->is_paced = false;
}

static void pump(struct lw_session *s) {
    if (s->rate_limit_bytes_hz) renew_allowance(s, lw_clock_ns());
    if (s->has_waiting && s->interest_epoch != s->shared->epoch) take_up_interest(s);
    s->waits = false;
    const bool has_all = write_batches(s);
    if (has_all && s->is_paced)
        enqueue(s, &s->shared->paced);
    else if (has_all && s->waits)
        enqueue(s, &s->shared->waiting);
    else if (!has_all && !s->is_writing)
        lw_session_set_due(s, false); /* more than one turn's */
    if (has_all && s->state == LEAVING && !s->ended) {
        s->ended = true; /* the peer's own close, or the time limit, ends the session */
        if (s->link->ops->end(s->link, s->refusal, s->refusal_text) < 0) lw_session_close(s, "link is gone");
    }
}

void lw_session_set_due(struct lw_session *s, bool asked) {
    struct lw_session_queue *due = s->shared->due;
    if (s->state == CLOSED || s->queue == &due[0] || (s->queue == &due[1] && !asked)) return;
    enqueue(s, &due[asked ? 0 : 1]);
}

static void end_waiting(struct lw_session_shared *shared, uint64_t now_ns) {
    for (struct lw_session *s = shared->slowed.first, *next; s; s = next) {
        next = s->next_unread;
        if (!lw_message_rates_wait(&s->rates, now_ns)) enter_inbox(s, &shared->unread);
    }
}

void lw_session_serve_paced(struct lw_session_shared *shared) {
    while (shared->paced.first) lw_session_set_due(shared->paced.first, false);
    end_waiting(shared, lw_clock_ns());
}

void lw_session_collect(struct lw_session_shared *shared) {
    bool any = false;
    for (unsigned f = 0; f < LW_LIGHT_FORM_COUNT; f++) any |= lw_deltas_collect(&shared->form[f].deltas);
    if (!any) return;
    while (shared->waiting.first) lw_session_set_due(shared->waiting.first, false);
}

bool lw_session_any_due(const struct lw_session_shared *shared) {
    return shared->due[0].first || shared->due[1].first || shared->unread.first;
}

void lw_session_serve_due(struct lw_session_shared *shared, uint64_t deadline_ns) {
    while ((shared->due[0].first || shared->due[1].first) && lw_clock_ns() < deadline_ns)
        for (int q = 0; q < 2; q++) {
            struct lw_session *s = shared->due[q].first;
            if (!s) continue;
            dequeue(s);
            pump(s);
        }
}

/* ---- the end ---- */

void lw_session_closed(struct lw_session *s) {
    struct lw_session_shared *shared = s->shared;
    assert(s->state == CLOSED);
    lw_blob_unref(s->control);
    for (struct lw_blob *blob; (blob = next_answer(s));) lw_blob_unref(blob);
    lw_blob_unref(s->partial_chunk);
    lw_message_reader_clear(&s->input);
    free(s->sent);
    free(s->lacked);
    free(s->wanted);
    free(s->interest.tile);
    free(s->waiting.tile);
    free(s->held);
    free(s);
    shared->on_close(shared->server);
}

static void unlink_session(struct lw_session *s) {
    if (s->previous)
        s->previous->next = s->next;
    else
        s->shared->first = s->next;
    if (s->next) s->next->previous = s->previous;
    s->shared->connection_count--;
}

static void count_session(const struct lw_session *s, int64_t change) {
    struct lw_server_stats *stats = &s->shared->stats;
    count(s->shared, &stats->sessions_now, change);
    if (s->form->form == LW_LIGHT_FORM_SPLIT) count(s->shared, &stats->sessions_drawing, change);
}

/* No longer one of those who are served. */
static void end_service(struct lw_session *s) {
    if (s->state == STREAMING) {
        count_out(s, &s->interest);
        count_taker(s->form, &s->shared->forms_taken, false);
    }
    if (s->has_place) lw_address_places_give(&s->shared->places, &s->peer.at);
    s->has_place = false;
    if (s->controls) lw_updates_forget(&s->shared->updates, s);
    s->controls = false;
    if (s->welcomed) count_session(s, -1);
    s->welcomed = false;
}

void lw_session_close(struct lw_session *s, const char *reason) {
    if (s->state == CLOSED) return;
    if (s->welcomed) tell(s, "left: %s", reason);
    end_service(s);
    if (s->state == LEAVING) s->shared->leaving_count--;
    dequeue(s);
    leave_inbox(s);
    s->state = CLOSED;
    unlink_session(s);
    s->link->ops->close(s->link);
}

void lw_session_lost(struct lw_session *s, int result) { lw_session_close(s, reason(result)); }

void lw_session_refuse(struct lw_session *s, enum lw_refusal code, const char *format, ...) {
    if (s->state == LEAVING || s->state == CLOSED) return;
    char *text = s->refusal_text;
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof s->refusal_text, format, args);
    va_end(args);
    s->refusal = code;
    tell(s, "%s: %s", s->welcomed ? "sent away" : "refused", text);
    end_service(s);
    if (s->inbox) { /* bytes that nobody reads would make its close a reset, which the refusal may not survive */
        leave_inbox(s);
        s->link->ops->read(s->link, true);
    }
    count(s->shared, &s->shared->stats.refused, 1);
    s->state = LEAVING;
    s->since_ns = lw_clock_ns();
    s->shared->leaving_count++;
    lw_blob_unref(s->control);
    s->control = NULL;
    struct lw_message message = {.type = LW_MESSAGE_REFUSAL, .refusal = {code, text, 0}};
    if (code == LW_REFUSAL_SHUTDOWN) message.refusal.retry_after_ms = s->shared->retry_after_ms;
    if (lw_blob_from_message(&message, &s->control) != LW_OK)
        lw_session_close(s, "out of memory");
    else
        lw_session_set_due(s, true);
}

/* ---- what the peer says ---- */

/* Who draws direct light gets the rest; all others get all of it, and are not told who would draw what. */
static void choose_form(struct lw_session *s, const struct lw_message_hello *hello,
                        struct lw_message_welcome *welcome) {
    if ((hello->features & LW_FEATURE_DRAWS) &&
        (welcome->client_lights_size || welcome->client_materials_size)) {
        s->form = &s->shared->form[LW_LIGHT_FORM_SPLIT];
        welcome->features |= LW_FEATURE_DRAWS;
        return;
    }
    welcome->client_lights = welcome->client_materials = NULL;
    welcome->client_lights_size = welcome->client_materials_size = 0;
}

/* Notes what the peer may do; false: it is refused. */
static bool admit(struct lw_session *s, const struct lw_message_hello *hello) {
    if (!s->shared->tokens || s->peer.may_control) return true;
    s->role = lw_tokens_role(s->shared->tokens, hello->token);
    if (s->role == LW_TOKENS_NONE) {
        lw_session_refuse(s, LW_REFUSAL_TOKEN, "%s",
                          hello->token ? "the token is not one of this server's"
                                       : "this server wants a token");
        return false;
    }
    memcpy(s->token.bytes, hello->token, sizeof s->token.bytes);
    s->peer.may_control = s->role == LW_TOKENS_CONTROL;
    return true;
}

void lw_session_check_token(struct lw_session *s) {
    if (s->role == LW_TOKENS_NONE || !s->shared->tokens) return;
    if (lw_tokens_role(s->shared->tokens, s->token.bytes) != s->role)
        lw_session_refuse(s, LW_REFUSAL_TOKEN, "the token is no longer one of this server's");
}

static void handle_hello(struct lw_session *s, const struct lw_message_hello *hello) {
    lw_peer_log_quote(s->name, sizeof s->name, hello->name && *hello->name ? hello->name : "nameless");
    if (hello->version != LW_WIRE_VERSION) {
        lw_session_refuse(s, LW_REFUSAL_VERSION, "this server speaks version %u of the protocol, not %u",
                          LW_WIRE_VERSION, hello->version);
        return;
    }
    if (!admit(s, hello)) return;
    const uint64_t lacking = s->shared->welcome.features & ~hello->features;
    if (lacking & LW_FEATURE_DCT) { /* tiles are encoded once: there are no others */
        lw_session_refuse(s, LW_REFUSAL_FEATURES,
                          "this server sends tiles of codec 4 (dct), which the client does not read: a newer "
                          "client does, and lightwelld --codec half sends others");
        return;
    }
    if (lacking) { /* so is the package */
        lw_session_refuse(s, LW_REFUSAL_FEATURES,
                          "this server's scene has textures, which are parts of the package that the client "
                          "does not read: a newer client does");
        return;
    }
    struct lw_message message = {.type = LW_MESSAGE_WELCOME, .welcome = s->shared->welcome};
    message.welcome.session = s->number;
    choose_form(s, hello, &message.welcome);
    s->controls = s->peer.may_control && s->shared->scene && (hello->features & LW_FEATURE_CONTROL);
    if (s->controls) message.welcome.features |= LW_FEATURE_CONTROL;
    lw_message_rates_trust(&s->rates, s->controls);
    s->resumes = hello->features & LW_FEATURE_RESUME;
    if (s->resumes) message.welcome.features |= LW_FEATURE_RESUME;
    if (lw_blob_from_message(&message, &s->control) != LW_OK) {
        lw_session_close(s, "out of memory");
        return;
    }
    s->rate_limit_bytes_hz = s->shared->rate_limit_bytes_hz;
    if (hello->rate_limit_bytes_hz &&
        (!s->rate_limit_bytes_hz || hello->rate_limit_bytes_hz < s->rate_limit_bytes_hz))
        s->rate_limit_bytes_hz = hello->rate_limit_bytes_hz;
    s->allowed_ns = lw_clock_ns();
    s->state = WELCOMED;
    s->welcomed = true;
    lw_session_set_due(s, true);
    count(s->shared, &s->shared->stats.sessions_total, 1);
    count_session(s, 1);
    tell(s, "joined%s", s->form->form == LW_LIGHT_FORM_SPLIT ? ", draws direct light" : "");
}

/* A request from inside a chunk: the rest of that chunk becomes a message of its own. */
static enum lw_status cut_chunk(struct lw_session *s, uint32_t chunk_index, uint64_t offset) {
    const struct lw_blob *whole = s->shared->chunk[chunk_index].blob;
    struct lw_framing_header header;
    struct lw_message message;
    enum lw_status status = lw_framing_read_header(whole->bytes, LW_FRAMING_BODY_MAX, &header, NULL);
    if (status == LW_OK)
        status = lw_message_decode(header, whole->bytes + LW_FRAMING_HEADER_SIZE, &message, NULL);
    if (status != LW_OK) return status;
    struct lw_message_package_chunk *chunk = &message.package_chunk;
    size_t skip = (size_t)(offset - chunk->offset);
    struct lw_message rest = {.type = LW_MESSAGE_PACKAGE_CHUNK,
                              .package_chunk = {offset, chunk->data + skip, chunk->size - skip}};
    status = lw_blob_from_message(&rest, &s->partial_chunk);
    lw_message_finish(&message);
    return status;
}

static bool make_sent(struct lw_session *s) {
    if (!s->sent) s->sent = calloc(s->shared->atlas_map->tile_count, sizeof *s->sent);
    return s->sent;
}

/* What an earlier session of the peer was sent counts as sent. */
static void handle_holds(struct lw_session *s, const struct lw_message_holds *holds) {
    const struct lw_snapshot *snapshot = s->form->snapshot;
    if (!make_sent(s)) {
        lw_session_close(s, "out of memory");
        return;
    }
    for (size_t i = 0; i < holds->tile_count; i++) {
        struct lw_message_held t = holds->tile[i];
        uint32_t id = lw_atlas_map_find_tile(s->shared->atlas_map, t.object, t.level, t.tile).v;
        if (id == UINT32_MAX || !snapshot || t.version > snapshot->tile[s->form->form][id].version) {
            lw_session_refuse(s, LW_REFUSAL_PROTOCOL,
                              "message HOLDS: there is no object %u, level %u, tile %u of version %" PRIu64,
                              t.object, t.level, t.tile, t.version);
            return;
        }
        s->sent[id] = t.version;
    }
}

/* False if there is no memory. */
static bool take_up_held(struct lw_session *s, const struct lw_message_package_request *request) {
    const size_t size = s->shared->welcome.part_count / 8 + 1;
    if (!request->held_size) return true;
    if (!(s->held = calloc(size, 1))) return false;
    memcpy(s->held, request->held, request->held_size < size ? request->held_size : size);
    return true;
}

static bool names_parts_that_exist(const struct lw_session *s,
                                   const struct lw_message_package_request *request) {
    for (size_t i = s->shared->welcome.part_count; i < 8 * request->held_size; i++)
        if (request->held[i / 8] >> (i % 8) & 1) return false;
    return true;
}

static void handle_package_request(struct lw_session *s, const struct lw_message_package_request *request) {
    const struct lw_session_shared *shared = s->shared;
    if (request->offset > shared->welcome.package_compressed_size) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL,
                          "message PACKAGE_REQUEST: offset is past the package's end");
        return;
    }
    if (!names_parts_that_exist(s, request)) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL,
                          "message PACKAGE_REQUEST: held names a part that is not there");
        return;
    }
    uint32_t at = 0;
    while (at < shared->chunk_count && shared->chunk[at].end <= request->offset) at++;
    bool done = make_sent(s) && take_up_held(s, request);
    const bool inside = request->offset > (at ? shared->chunk[at - 1].end : 0);
    if (done && inside && !holds_part(s, shared->chunk[at].part))
        done = cut_chunk(s, at, request->offset) == LW_OK;
    if (!done) {
        lw_session_close(s, "out of memory");
        return;
    }
    s->next_chunk = at + inside;
    skip_held(s);
    s->state = STREAMING;
    lw_session_set_due(s, true);
    count_in(s, &s->interest);
    count_taker(s->form, &s->shared->forms_taken, true);
}

/* Notes what a session wants. A peer may say so as often as it likes: the first one holds at once, later ones wait for the
 * next snapshot or tick, the last of them alone. */
static void handle_interest(struct lw_session *s, const struct lw_message_interest *said) {
    struct interest interest = {.everything = said->everything, .stand_ins = said->stand_ins};
    if (said->tile_count && !(interest.tile = malloc(said->tile_count * sizeof *interest.tile))) {
        lw_session_close(s, "out of memory");
        return;
    }
    for (size_t i = 0; i < said->tile_count; i++) {
        struct lw_message_interest_tile t = said->tile[i];
        uint32_t id = lw_atlas_map_find_tile(s->shared->atlas_map, t.object, t.level, t.tile).v;
        if (id == UINT32_MAX) {
            free(interest.tile);
            lw_session_refuse(s, LW_REFUSAL_PROTOCOL,
                              "message INTEREST: there is no object %u, level %u, tile %u", t.object, t.level,
                              t.tile);
            return;
        }
        interest.tile[i] = id;
    }
    uint64_t *listed = s->shared->listed;
    for (size_t i = 0; i < said->tile_count; i++)
        if (!test_and_set(listed, interest.tile[i])) interest.tile[interest.tile_count++] = interest.tile[i];
    for (uint32_t i = 0; i < interest.tile_count; i++) listed[interest.tile[i] / 64] = 0;
    free(s->waiting.tile);
    s->waiting = interest;
    s->has_waiting = true;
    if (s->interest_epoch == s->shared->epoch) return;
    take_up_interest(s);
    lw_session_set_due(s, true);
}

void lw_session_answer(struct lw_session *s, const struct lw_message_updated *answer) {
    if (s->answer_count >= LW_SERVER_ANSWERS_MAX) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message UPDATE: %u answers wait to be read",
                          LW_SERVER_ANSWERS_MAX);
        return;
    }
    struct answer *last = malloc(sizeof *last);
    const struct lw_message message = {.type = LW_MESSAGE_UPDATED, .updated = *answer};
    if (!last || lw_blob_from_message(&message, &last->blob) != LW_OK) {
        free(last);
        lw_session_close(s, "out of memory"); /* an answer must not be lost */
        return;
    }
    last->next = NULL;
    if (s->last_answer)
        s->last_answer->next = last;
    else
        s->first_answer = last;
    s->last_answer = last;
    s->answer_count++;
    lw_session_set_due(s, true);
}

static void handle_update(struct lw_session *s, const struct lw_message_update *update) {
    struct lw_session_shared *shared = s->shared;
    struct lw_message_updated refused = {.request = update->request};
    struct lw_error err = {0};
    uint32_t added[LW_MESSAGE_CHANGES_MAX], object;
    size_t added_count = 0;
    lw_scene_roster_save(&shared->roster);
    for (size_t i = 0; i < update->change_count && !refused.code; i++) {
        const struct lw_scene_change *change = &update->change[i];
        refused.code = lw_scene_change_check(shared->scene, change, &err);
        if (!refused.code) refused.code = lw_scene_roster_take(&shared->roster, change, &object, &err);
        if (!refused.code && change->kind == LW_SCENE_CHANGE_OBJECT_ADD) added[added_count++] = object;
        refused.change = refused.code ? (uint32_t)i : 0;
    }
    refused.text = err.text;
    if (!refused.code && !lw_updates_add(&shared->updates, s, update->request, update->change,
                                         update->change_count, added, added_count)) {
        refused.code = LW_SCENE_CHANGE_BUSY;
        refused.text = lw_scene_change_text(LW_SCENE_CHANGE_BUSY);
    }
    if (!refused.code) return;
    lw_scene_roster_go_back(&shared->roster); /* nothing of it is done */
    lw_session_answer(s, &refused);
}

/* Says that the peer has the light of a frame; how long that took is what we measure of links. */
static void handle_ack(struct lw_session *s, uint64_t frame) {
    const struct lw_session_shared *shared = s->shared;
    if (frame == 0 || frame > s->frame_sent || frame < s->frame_acked) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message ACK: frame %" PRIu64 " %s", frame,
                          frame && frame <= s->frame_sent ? "after a later one" : "was not sent");
        return;
    }
    if (frame == s->frame_acked) return;
    const bool first = s->frame_acked == 0;
    s->frame_acked = frame;
    if (first) return; /* that frame may have been there long before the session was */
    for (uint64_t back = 0; back < LW_SESSION_RECENT && back < shared->generation; back++) {
        const struct lw_session_recent *recent =
            &shared->recent[(shared->generation - back) % LW_SESSION_RECENT];
        if (recent->frame > frame) continue;
        if (recent->frame == frame) {
            const uint64_t ack_ns = lw_clock_ns() - recent->at_ns;
            lw_histogram_add(&s->shared->ack, ack_ns);
            lw_durations_add(&s->shared->ack_all, ack_ns);
        }
        return;
    }
}

static void handle_message(struct lw_session *s, const struct lw_message *m) {
    bool in_order = m->type == LW_MESSAGE_HELLO             ? s->state == EXPECTS_HELLO
                    : m->type == LW_MESSAGE_PACKAGE_REQUEST ? s->state == WELCOMED
                    : m->type == LW_MESSAGE_HOLDS           ? s->state == WELCOMED && s->resumes
                                                            : s->state == WELCOMED || s->state == STREAMING;
    if (!in_order) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message %s: out of order",
                          lw_message_name((uint16_t)m->type));
        return;
    }
    switch (m->type) {
    case LW_MESSAGE_HELLO:
        handle_hello(s, &m->hello);
        break;
    case LW_MESSAGE_PACKAGE_REQUEST:
        handle_package_request(s, &m->package_request);
        break;
    case LW_MESSAGE_HOLDS:
        handle_holds(s, &m->holds);
        break;
    case LW_MESSAGE_INTEREST:
        handle_interest(s, &m->interest);
        break;
    case LW_MESSAGE_UPDATE:
        if (s->controls)
            handle_update(s, &m->update);
        else
            lw_session_refuse(s, LW_REFUSAL_NOT_ALLOWED,
                              "message UPDATE: this session may not change the scene");
        break;
    case LW_MESSAGE_PING:
        s->pong_due = true;
        s->pong_token = m->ping.token;
        lw_session_set_due(s, true);
        break;
    case LW_MESSAGE_ACK:
        handle_ack(s, m->ack.frame);
        break;
    case LW_MESSAGE_PONG: /* this server does not ping */
        break;
    default:
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message %s: not one that a client sends",
                          lw_message_name((uint16_t)m->type));
    }
}

/* Takes one message; false: none is whole yet, or the session came to its end. */
static bool take_message(struct lw_session *s) {
    struct lw_framing_header header;
    struct lw_message message;
    struct lw_error err = {0};
    const uint8_t *body;
    enum lw_status status = lw_message_reader_take(&s->input, &header, &body, &err);
    if (status == LW_OK && !body) return false;
    if (status == LW_OK) status = lw_message_decode(header, body, &message, &err);
    if (status == LW_NO_MEMORY) {
        lw_session_close(s, "out of memory");
        return false;
    }
    if (status != LW_OK) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "%s", err.text);
        return false;
    }
    handle_message(s, &message);
    lw_message_finish(&message);
    (void)lw_message_rates_count(&s->rates, header, lw_clock_ns());
    return true;
}

/* Handles what is there, as far as others do not have to wait for it and the peer keeps to its rates. */
static void take_messages(struct lw_session *s) {
    unsigned count = 0;
    bool more = true;
    while (s->state < LEAVING && !s->rates.waits && count < TURN_MESSAGES && more) {
        more = take_message(s);
        count++;
    }
    if (s->state >= LEAVING) {
        lw_message_reader_clear(&s->input);
    } else if (lw_message_reader_keep(&s->input) != LW_OK) {
        lw_session_close(s, "out of memory");
    } else if (s->rates.waits) {
        enter_inbox(s, &s->shared->slowed);
    } else if (more) {
        enter_inbox(s, &s->shared->unread);
    } else if (s->inbox) {
        leave_inbox(s);
        s->link->ops->read(s->link, true);
    }
}

/* With what was kept before: while a session is in an inbox a link may still hand over what it had read. */
void lw_session_receive(struct lw_session *s, const uint8_t *bytes, size_t size) {
    if (s->state >= LEAVING) return;
    s->heard_ns = lw_clock_ns();
    s->pinged = false;
    lw_message_reader_lend(&s->input, bytes, size);
    if (!s->inbox)
        take_messages(s);
    else if (lw_message_reader_keep(&s->input) != LW_OK)
        lw_session_close(s, "out of memory");
}

void lw_session_read_on(struct lw_session_shared *shared) {
    const struct lw_session *last = shared->unread.last; /* each once */
    for (struct lw_session *s = shared->unread.first, *next; s; s = next) {
        next = s == last ? NULL : s->next_unread;
        take_messages(s);
    }
}

/* ---- the beginning ---- */

static void link_session(struct lw_session *s) {
    struct lw_session_shared *shared = s->shared;
    s->next = shared->first;
    if (s->next) s->next->previous = s;
    shared->first = s;
    shared->connection_count++;
}

struct lw_session *lw_session_open(struct lw_session_shared *shared, struct lw_session_transport *link,
                                   const struct lw_session_peer *peer) {
    struct lw_session *s = shared->leaving_count > FULL_GRACE_COUNT ? NULL : calloc(1, sizeof *s);
    if (!s) return NULL;
    s->link = link;
    s->shared = shared;
    s->peer = *peer;
    s->input.body_max = LW_FRAMING_CLIENT_BODY_MAX;
    s->form = &shared->form[LW_LIGHT_FORM_FULL];
    s->interest.everything = true;
    s->number = ++shared->number;
    s->since_ns = s->looked_ns = s->heard_ns = lw_clock_ns();
    lw_message_rates_init(&s->rates, s->since_ns);
    link_session(s);
    shared->on_open(shared->server);
    const uint32_t share = shared->address_sessions_max
                               ? shared->address_sessions_max
                               : lw_address_places_share(&peer->at, shared->sessions_max);
    if (shared->connection_count - shared->leaving_count > shared->sessions_max)
        lw_session_refuse(s, LW_REFUSAL_FULL, "the server has its %u sessions", shared->sessions_max);
    else if (!(s->has_place = lw_address_places_take(&shared->places, &peer->at, share)))
        lw_session_refuse(s, LW_REFUSAL_FULL, "this address has its %u sessions", share);
    return s;
}

/* Progress is what the peer takes: our own socket would take megabytes for one who reads nothing. */
static bool is_stalled(struct lw_session *s, uint64_t now_ns, struct lw_session_waiting *waiting) {
    size_t ours, socket;
    s->link->ops->waiting(s->link, &ours, &socket);
    waiting->bytes += ours;
    waiting->socket_bytes += socket;
    if (waiting->bytes_max < ours) waiting->bytes_max = ours;
    const uint64_t taken = s->given - ours - socket;
    if (!(ours + socket) || taken != s->taken_last) s->progress_ns = now_ns;
    s->taken_last = taken;
    return now_ns > s->progress_ns && now_ns - s->progress_ns > s->shared->stall_timeout_ns;
}

/* Pings a peer that says nothing; true: that did not help. What waits in an inbox was said, though it is not read. */
static bool is_silent(struct lw_session *s, uint64_t now_ns) {
    const uint64_t silence_ns = s->inbox || now_ns < s->heard_ns ? 0 : now_ns - s->heard_ns;
    if (!s->pinged && silence_ns > s->shared->silence_timeout_ns / 2) {
        s->pinged = s->ping_due = true;
        lw_session_set_due(s, true);
    }
    return silence_ns > s->shared->silence_timeout_ns;
}

void lw_session_tick(struct lw_session *s, uint64_t now_ns, struct lw_session_waiting *waiting) {
    uint64_t age_ns = now_ns > s->since_ns ? now_ns - s->since_ns : 0;
    const char *excess =
        lw_message_rates_judge(&s->rates, now_ns - s->looked_ns, s->shared->excess_timeout_ns);
    s->looked_ns = now_ns;
    if (s->state == LEAVING && age_ns > LINGER_NS)
        lw_session_close(s, "refused");
    else if (s->state == EXPECTS_HELLO && age_ns > s->shared->hello_timeout_ns)
        lw_session_refuse(s, LW_REFUSAL_TIMEOUT, "no hello in time");
    else if (s->state != LEAVING && excess)
        lw_session_refuse(s, LW_REFUSAL_RATE, "%s, for too long", excess);
    else if (s->state == WELCOMED && !s->controls && age_ns > s->shared->package_timeout_ns)
        lw_session_refuse(s, LW_REFUSAL_TIMEOUT, "no PACKAGE_REQUEST in time");
    else if (s->welcomed && is_silent(s, now_ns))
        lw_session_refuse(s, LW_REFUSAL_TIMEOUT, "nothing was heard, not even a PONG");
    else if (s->state != LEAVING && is_stalled(s, now_ns, waiting))
        lw_session_close(s, "takes no data");
    else if (s->has_waiting)
        lw_session_set_due(s, true);
}
