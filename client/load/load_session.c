#include "client/load/load_session.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/base/random.h"
#include "proto/message_reader.h"

#include <assert.h>
#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SECOND_NS 1000000000ull
#define OUTBOX_MAX                                                                                           \
    (64u << 10) /* bytes that may wait before messages are dropped that a later one makes up for */
#define GOODBYE_NS     (2 * SECOND_NS) /* from our end of the link to closing without the server's */
#define LOOK_NS        (SECOND_NS / 2) /* from one look around to the next */
#define STAY_S         2.0             /* a teleporting user's stay in a place */
#define ALLOWANCE_S    0.2             /* most that a slow reader reads at once, in seconds of its rate */
#define RATE_MIN_SHARE 0.5 /* a stay shorter than this share of the measured time, or 1 s, has no rate */

enum state {
    CONNECTING,
    GREETING, /* has said hello */
    LOADING,  /* was welcomed; no FRAME yet */
    STREAMING,
    STOPPED, /* a never-reader after its first FRAME */
    LEAVING, /* has said goodbye: received data is dropped */
    CLOSED   /* waits for libuv */
};

struct lw_load_session {
    uv_tcp_t tcp;
    uv_connect_t connecting;
    uv_shutdown_t goodbye;
    struct lw_load_shared *shared;
    struct lw_load_session *previous, *next;
    uint32_t number;
    enum lw_load_reader reader;
    bool counts; /* its times go into the figures: not those of a few odd readers among others */
    enum state state;
    uint64_t began_ns, welcomed_ns, heard_ns, pinged_ns;
    uint32_t retry_after_ms; /* as the last REFUSAL said */
    uint64_t run;            /* the server's run that `known` is about */
    bool returns;            /* it was here before... */
    uint64_t broke_ns;       /* ...until then */
    uint64_t light_ns;       /* lw_load_session_light_ns() */
    unsigned attempt;
    uint64_t quiet_ns; /* STOPPED or LEAVING since */

    struct lw_tls_stream *tls; /* NULL: it is plain */
    int first_byte;            /* the first byte that the server sent; negative: none came */
    struct lw_message_reader input;
    double allowance; /* bytes that a slow reader may read now */
    uint64_t allowed_ns;
    bool paused;

    uint64_t package_received;
    uint64_t first_frame, frame, frame_acked, frame_settled, frames_measured;
    uint64_t *known;                  /* per tile: the version that it has; 0: none */
    struct lw_tile_held *held;        /* if it is followed */
    uint64_t *wanted;                 /* bit per tile; NULL: everything */
    uint64_t second_ns, second_bytes; /* began then; received since */
    bool second_counts;               /* it had its view then */
    /* bit per tile that is wanted since it last arrived; NULL: none but what never arrived */
    uint64_t *fresh;
    uint32_t missing; /* wanted tiles that it has no version of */
    bool has_view;    /* it had every wanted tile at some time */
    uint64_t view_since_ns, looked_ns;
    struct lw_package_hash chosen; /* hash of the tiles in the last INTEREST */
};

/* Whether our side has ended it. A message that still arrives is no mistake of the server's. */
static bool is_over(const struct lw_load_session *s) { return s->state >= LEAVING; }

bool lw_load_session_is_streaming(const struct lw_load_session *s) { return s->state == STREAMING; }
bool lw_load_session_is_live(const struct lw_load_session *s) { return s->state < LEAVING; }
enum lw_load_reader lw_load_session_reader(const struct lw_load_session *s) { return s->reader; }
uint64_t lw_load_session_light_ns(const struct lw_load_session *s) { return s->light_ns; }
struct lw_load_session *lw_load_session_next(const struct lw_load_session *s) {
    return s->next;
}

/* ---- the end ---- */

static void on_closed(uv_handle_t *handle) {
    struct lw_load_session *s = handle->data;
    s->shared->session_count--;
    lw_message_reader_clear(&s->input);
    if (s->held) s->shared->held_bytes -= lw_tile_held_bytes_max(&s->shared->scene->map);
    lw_tile_held_destroy(s->held);
    lw_tls_stream_destroy(s->tls);
    free(s->known);
    free(s->wanted);
    free(s->fresh);
    free(s);
}

static void set_over(struct lw_load_session *s, enum state state) {
    s->shared->live_count -= !is_over(s);
    s->state = state;
}

static void unlink_session(struct lw_load_session *s) {
    if (s->previous)
        s->previous->next = s->next;
    else
        s->shared->first = s->next;
    if (s->next) s->next->previous = s->previous;
}

static void link_session(struct lw_load_session *s) {
    struct lw_load_shared *shared = s->shared;
    s->next = shared->first;
    if (s->next) s->next->previous = s;
    shared->first = s;
    shared->live_count++;
    shared->session_count++;
}

/* reset: the peer learns of it at once, and loses data on its way. */
static void close_session(struct lw_load_session *s, bool reset) {
    if (s->state == CLOSED) return;
    set_over(s, CLOSED);
    unlink_session(s);
    if (!reset || uv_tcp_close_reset(&s->tcp, on_closed) < 0) uv_close((uv_handle_t *)&s->tcp, on_closed);
}

void lw_load_session_close(struct lw_load_session *s) { close_session(s, false); }

void lw_load_session_conclude(struct lw_load_session *s, uint64_t now_ns) {
    struct lw_load_figures *f = s->shared->figures;
    if (!f->measuring || !s->counts || !s->welcomed_ns || is_over(s)) return;
    uint64_t from_ns =
        s->welcomed_ns > s->shared->measured_from_ns ? s->welcomed_ns : s->shared->measured_from_ns;
    double there_s = now_ns > from_ns ? 1e-9 * (double)(now_ns - from_ns) : 0;
    if (there_s < fmin(1, RATE_MIN_SHARE * s->shared->options->seconds)) return;
    lw_histogram_add(&f->rate_mhz, (uint64_t)(1000 * (double)s->frames_measured / there_s + 0.5));
}

LW_PRINTF(3, 0)
static void count_fault(struct lw_load_shared *shared, enum lw_load_fault fault, const char *format,
                        va_list args) {
    char *first = shared->figures->first_fault[fault];
    if (shared->figures->fault[fault]++ == 0) {
        vsnprintf(first, sizeof shared->figures->first_fault[fault], format, args);
        lw_status_one_line(first);
    }
}

LW_PRINTF(3, 4)
static void note_fault(struct lw_load_shared *shared, enum lw_load_fault fault, const char *format, ...) {
    va_list args;
    va_start(args, format);
    count_fault(shared, fault, format, args);
    va_end(args);
}

/* Whether it is the connection, or the server, that failed, and not a message. */
static bool is_broken_link(enum lw_load_fault fault) {
    return fault == LW_LOAD_FAULT_CONNECT || fault == LW_LOAD_FAULT_REFUSED || fault == LW_LOAD_FAULT_LOST ||
           fault == LW_LOAD_FAULT_SILENCE;
}

/* The user comes back later, with what it has. false: there is no memory for that. */
static bool plan_return(struct lw_load_session *s, uint64_t now_ns) {
    struct lw_load_shared *shared = s->shared;
    struct lw_load_return *r = calloc(1, sizeof *r);
    if (!r) return false;
    const unsigned attempt = s->welcomed_ns ? 0 : s->attempt + 1;
    const uint32_t seed = lw_random_hash2((uint32_t)shared->options->seed, s->number);
    *r = (struct lw_load_return){.next = shared->returning,
                                 .number = s->number,
                                 .reader = s->reader,
                                 .attempt = attempt,
                                 .due_ns = now_ns +
                                           lw_client_return_ms(s->retry_after_ms, attempt, seed) * 1000000ull,
                                 .broke_ns = s->welcomed_ns || !s->returns ? now_ns : s->broke_ns,
                                 .light_ns = s->light_ns,
                                 .run = s->run,
                                 .known = s->known};
    s->known = NULL;
    shared->returning = r;
    shared->figures->broken += s->welcomed_ns != 0;
    return true;
}

/* Ends a session that did not want to end. */
LW_PRINTF(3, 4)
static void fail(struct lw_load_session *s, enum lw_load_fault fault, const char *format, ...) {
    if (is_over(s)) return;
    if (s->shared->options->reconnect && is_broken_link(fault) && plan_return(s, lw_clock_ns())) {
        lw_load_session_conclude(s, lw_clock_ns());
        lw_load_session_close(s);
        return;
    }
    va_list args;
    va_start(args, format);
    count_fault(s->shared, fault, format, args);
    va_end(args);
    if (s->welcomed_ns)
        s->shared->figures->lost++;
    else
        s->shared->figures->refused++;
    lw_load_session_conclude(s, lw_clock_ns());
    lw_load_session_close(s);
}

/* The link has broken. For a never-reader that is what it came for. */
static void lose(struct lw_load_session *s, const char *why) {
    if (s->state == STOPPED) {
        s->shared->figures->dropped++;
        lw_histogram_add(&s->shared->figures->drop, lw_clock_ns() - s->quiet_ns);
        lw_load_session_close(s);
    } else if (s->state == LEAVING) {
        lw_load_session_close(s);
    } else {
        fail(s, s->welcomed_ns ? LW_LOAD_FAULT_LOST : LW_LOAD_FAULT_CONNECT, "%s", why);
    }
}

/* ---- sending ---- */

struct outgoing {
    uv_write_t request;
    uint8_t *bytes;
};

static void on_sent(uv_write_t *request, int result) {
    struct outgoing *out = request->data;
    struct lw_load_session *s = request->handle->data;
    free(out->bytes);
    free(out);
    if (result < 0 && result != UV_ECANCELED) lose(s, uv_strerror(result));
}

/* Takes over `bytes`. */
static int queue(struct lw_load_session *s, uint8_t *bytes, size_t sent, size_t size) {
    struct outgoing *out = malloc(sizeof *out);
    if (!out) {
        free(bytes);
        return UV_ENOMEM;
    }
    *out = (struct outgoing){.bytes = bytes};
    out->request.data = out;
    uv_buf_t rest = uv_buf_init((char *)bytes + sent, (unsigned)(size - sent));
    int result = uv_write(&out->request, (uv_stream_t *)&s->tcp, &rest, 1, on_sent);
    if (result < 0) {
        free(bytes);
        free(out);
    }
    return result;
}

/* Sends what the link takes at once, and leaves the rest to libuv. Takes over `bytes`. */
static void send_bytes(struct lw_load_session *s, uint8_t *bytes, size_t size) {
    uv_buf_t all = uv_buf_init((char *)bytes, (unsigned)size);
    int result = uv_try_write((uv_stream_t *)&s->tcp, &all, 1);
    size_t sent = result > 0 ? (size_t)result : 0;
    if (result == UV_EAGAIN || (result >= 0 && sent < size)) {
        result = queue(s, bytes, sent, size);
    } else {
        free(bytes);
    }
    if (result < 0) lose(s, uv_strerror(result));
}

/* Sends what TLS has made. */
static void send_output(struct lw_load_session *s) {
    struct lw_tls_output *output = &s->shared->output;
    const size_t size = output->size;
    output->size = 0;
    if (!size) return;
    uint8_t *bytes = malloc(size);
    if (!bytes) {
        fail(s, LW_LOAD_FAULT_SYSTEM, "out of memory for a message");
        return;
    }
    memcpy(bytes, output->bytes, size);
    send_bytes(s, bytes, size);
}

static void send_by_tls(struct lw_load_session *s, const uint8_t *bytes, size_t size) {
    if (lw_tls_stream_write(s->tls, bytes, size, &s->shared->output) != LW_OK) {
        s->shared->output.size = 0;
        lose(s, "TLS failed");
        return;
    }
    send_output(s);
}

static void send_message(struct lw_load_session *s, const struct lw_message *message) {
    uint8_t *bytes;
    size_t size;
    if (is_over(s) || uv_stream_get_write_queue_size((uv_stream_t *)&s->tcp) > OUTBOX_MAX) return;
    if (lw_message_encode_alloc(message, &bytes, &size) != LW_OK) {
        fail(s, LW_LOAD_FAULT_SYSTEM, "out of memory for a message");
        return;
    }
    if (!s->tls) {
        send_bytes(s, bytes, size);
        return;
    }
    send_by_tls(s, bytes, size);
    free(bytes);
}

static void ping(struct lw_load_session *s, uint64_t now_ns) {
    s->pinged_ns = now_ns;
    send_message(s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = now_ns});
}

/* ---- what it wants to see ---- */

static struct lw_viewer_model_eye eye_of(const struct lw_load_session *s, uint64_t now_ns) {
    const struct lw_load_options *o = s->shared->options;
    const struct lw_viewer_model *model = s->shared->scene->viewer_model;
    double since_s = 1e-9 * (double)(now_ns - s->began_ns);
    uint32_t seed = (uint32_t)o->seed;
    if (o->path == LW_LOAD_WALK) return lw_viewer_model_walk(model, seed, s->number, since_s);
    uint32_t stay = o->path == LW_LOAD_TELEPORT ? (uint32_t)(since_s / STAY_S) : 0;
    return lw_viewer_model_place(model, seed, s->number, stay);
}

static void complete_view(struct lw_load_session *s, uint64_t now_ns) {
    struct lw_load_figures *f = s->shared->figures;
    uint64_t since_ns = s->view_since_ns;
    if (s->returns && !s->has_view) /* no user can connect before the server is back */
        since_ns = s->broke_ns > s->shared->run_began_ns ? s->broke_ns : s->shared->run_began_ns;
    struct lw_histogram *times = s->has_view ? &f->next_view : s->returns ? &f->served : &f->first_view;
    if (s->counts) lw_histogram_add(times, now_ns - since_ns);
    s->has_view = true;
}

/* Replaces the wanted tiles. The time until all are there counts from the request, or from one before it that
 * was not met. */
static void replace_wanted(struct lw_load_session *s, uint32_t count, uint64_t now_ns) {
    const uint32_t words = s->shared->scene->map.tile_count / 64 + 1;
    bool had_all = s->has_view && s->missing == 0;
    for (uint32_t i = 0; i < words; i++) s->fresh[i] |= ~s->wanted[i];
    memset(s->wanted, 0, words * sizeof *s->wanted);
    s->missing = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t id = s->shared->chosen[i].v;
        s->wanted[id / 64] |= 1ull << (id % 64);
        s->missing += s->known[id] == 0;
    }
    if (had_all) s->view_since_ns = now_ns;
    if (had_all && s->missing == 0) complete_view(s, now_ns);
}

/* Looks around, and says so if that shows other tiles than before. */
static void update_view(struct lw_load_session *s, uint64_t now_ns) {
    struct lw_load_shared *shared = s->shared;
    const struct lw_atlas_map *map = &shared->scene->map;
    struct lw_viewer_model_eye eye = eye_of(s, now_ns);
    struct lw_package_hash hash;
    s->looked_ns = now_ns;
    uint32_t count =
        lw_viewer_model_choose(shared->scene->viewer_model, &eye, shared->chosen, LW_MESSAGE_INTEREST_MAX);
    lw_package_hash((const uint8_t *)shared->chosen, count * sizeof *shared->chosen, &hash);
    if (memcmp(hash.bytes, s->chosen.bytes, sizeof hash.bytes) == 0) return;
    s->chosen = hash;
    for (uint32_t i = 0; i < count; i++) {
        const struct lw_tile_place *p = &map->place[shared->chosen[i].v];
        shared->named[i] = (struct lw_message_interest_tile){p->object, p->level,
                                                             lw_atlas_map_number(map, shared->chosen[i])};
    }
    replace_wanted(s, count, now_ns);
    send_message(
        s, &(struct lw_message){.type = LW_MESSAGE_INTEREST,
                                .interest = {.stand_ins = true, .tile = shared->named, .tile_count = count}});
}

/* ---- what the server says ---- */

static void out_of_order(struct lw_load_session *s, enum lw_message_type type) {
    fail(s, LW_LOAD_FAULT_ORDER, "message %s", lw_message_name((uint16_t)type));
}

/* Versions and frames of another run of the server are others. */
static void begin_run(struct lw_load_shared *shared, uint64_t run, uint64_t now_ns) {
    if (shared->run_count++) {
        lw_tile_check_forget(shared->check);
        shared->heard_before += shared->clock.count;
        shared->clock.count = 0;
    }
    shared->run = run;
    shared->run_began_ns = now_ns;
}

static void send_held(struct lw_load_session *s) {
    const struct lw_atlas_map *map = &s->shared->scene->map;
    struct lw_message_held held[LW_MESSAGE_HOLDS_MAX];
    size_t count = 0;
    for (uint32_t t = 0; t < map->tile_count; t++) {
        const struct lw_tile_place *p = &map->place[t];
        if (s->known[t])
            held[count++] = (struct lw_message_held){p->object, p->level,
                                                     lw_atlas_map_number(map, (lw_tile_id){t}), s->known[t]};
        if (count < LW_MESSAGE_HOLDS_MAX && (!count || t + 1 < map->tile_count)) continue;
        send_message(s, &(struct lw_message){.type = LW_MESSAGE_HOLDS, .holds = {held, count, 0}});
        count = 0;
    }
}

/* Tiles that it has from before the connection broke. The same run need not send them again. */
static void take_up(struct lw_load_session *s, const struct lw_message_welcome *welcome) {
    const uint32_t tiles = s->shared->scene->map.tile_count;
    s->shared->figures->returned++;
    if (!welcome->run || s->run != welcome->run) memset(s->known, 0, tiles * sizeof *s->known);
    s->missing = 0;
    for (uint32_t t = 0; t < tiles; t++) s->missing += s->known[t] == 0;
    if (welcome->features & LW_FEATURE_RESUME) send_held(s);
}

static void handle_welcome(struct lw_load_session *s, const struct lw_message_welcome *welcome,
                           uint64_t now_ns) {
    const struct lw_load_scene *scene = s->shared->scene;
    struct lw_load_figures *f = s->shared->figures;
    if (s->state != GREETING) {
        out_of_order(s, LW_MESSAGE_WELCOME);
        return;
    }
    /* who means to outlive the server's reloads may also come for the first time after one */
    if (s->shared->options->reconnect &&
        memcmp(welcome->package_hash.bytes, scene->hash.bytes, sizeof scene->hash.bytes) != 0) {
        s->shared->other_scene = true;
        lw_load_session_close(s);
        return;
    }
    if (welcome->version != LW_WIRE_VERSION ||
        memcmp(welcome->package_hash.bytes, scene->hash.bytes, sizeof scene->hash.bytes) != 0 ||
        welcome->package_compressed_size != scene->compressed_size) {
        fail(s, LW_LOAD_FAULT_PACKAGE, "its WELCOME names another package or version");
        return;
    }
    f->welcomed++;
    f->followed += s->held != NULL;
    s->welcomed_ns = now_ns;
    s->state = LOADING;
    if (!s->shared->run_count || welcome->run != s->shared->run) begin_run(s->shared, welcome->run, now_ns);
    if (s->returns) take_up(s, welcome);
    s->run = welcome->run;
    if (s->counts) lw_histogram_add(&f->connect, now_ns - s->began_ns);
    if (s->wanted) update_view(s, now_ns);
    s->package_received = s->shared->options->download ? 0 : scene->compressed_size;
    send_message(s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_REQUEST,
                                         .package_request.offset = s->package_received});
}

static void handle_chunk(struct lw_load_session *s, const struct lw_message_package_chunk *chunk,
                         uint64_t now_ns) {
    const struct lw_load_scene *scene = s->shared->scene;
    uint64_t left = scene->compressed_size - s->package_received;
    if (s->state != LOADING || chunk->offset != s->package_received || chunk->size > left) {
        out_of_order(s, LW_MESSAGE_PACKAGE_CHUNK);
        return;
    }
    if (memcmp(scene->compressed + chunk->offset, chunk->data, chunk->size) != 0) {
        fail(s, LW_LOAD_FAULT_PACKAGE, "the chunk at %llu differs", (unsigned long long)chunk->offset);
        return;
    }
    s->package_received += chunk->size;
    if (s->counts && s->package_received == scene->compressed_size)
        lw_histogram_add(&s->shared->figures->download, now_ns - s->began_ns);
}

static bool names_what_exists(const struct lw_load_scene *scene, const struct lw_message_frame *frame) {
    for (size_t i = 0; i < frame->transform_count; i++)
        if (frame->transform[i].object >= scene->object_count) return false;
    for (size_t i = 0; i < frame->light_count; i++)
        if (frame->light[i].light >= scene->light_count) return false;
    return true;
}

/* A frame that this session has not heard of before; a large one comes in several messages. */
static void begin_frame(struct lw_load_session *s, const struct lw_message_frame *frame, uint64_t now_ns) {
    struct lw_load_shared *shared = s->shared;
    struct lw_load_figures *f = shared->figures;
    (void)lw_frame_clock_hear(
        &shared->clock,
        (struct lw_frame_clock_entry){frame->frame, now_ns, frame->solve_ns, frame->server_cpu_ns});
    const uint64_t first_heard_ns = lw_frame_clock_find(&shared->clock, frame->frame)->heard_ns;
    f->frames++;
    s->frame = frame->frame;
    const uint64_t solve_ns = frame->solve_ns < first_heard_ns ? frame->solve_ns : 0;
    if (first_heard_ns - solve_ns > s->light_ns) s->light_ns = first_heard_ns - solve_ns;
    if (s->state == LOADING) {
        s->first_frame = frame->frame;
        s->state = STREAMING;
        if (s->missing == 0) complete_view(s, now_ns); /* a scene without tiles */
    } else if (s->counts && f->measuring) {
        lw_histogram_add(&f->frame, now_ns - first_heard_ns);
    }
    s->frames_measured += f->measuring;
    if (s->reader != LW_LOAD_NEVER) return;
    uv_read_stop((uv_stream_t *)&s->tcp);
    s->state = STOPPED;
    s->quiet_ns = now_ns;
    f->stopped++;
}

static void handle_frame(struct lw_load_session *s, const struct lw_message_frame *frame, uint64_t now_ns) {
    const struct lw_load_scene *scene = s->shared->scene;
    if (s->package_received < scene->compressed_size || (s->state != LOADING && s->state != STREAMING))
        out_of_order(s, LW_MESSAGE_FRAME);
    else if (frame->frame < s->frame)
        fail(s, LW_LOAD_FAULT_FRAME, "%llu after %llu", (unsigned long long)frame->frame,
             (unsigned long long)s->frame);
    else if (!names_what_exists(scene, frame))
        fail(s, LW_LOAD_FAULT_PLACE, "message FRAME");
    else if (frame->frame > s->frame)
        begin_frame(s, frame, now_ns);
}

/* What a user asked for is one thing and updates of what they have another: the first version after the
 * asking may be of any age, those after it were published while somebody waited for them. Our server numbers
 * a tile's versions by its frames, two a frame; with one that does not, updates count from when the frame of
 * that number was heard of, or not at all. */
static void note_update(struct lw_load_session *s, uint64_t version, uint64_t now_ns) {
    struct lw_load_figures *f = s->shared->figures;
    if (!f->measuring || !s->counts) return;
    const struct lw_frame_clock_entry *published = lw_frame_clock_find(&s->shared->clock, (version + 1) / 2);
    if (!published) return;
    lw_histogram_add(&f->update, now_ns - published->heard_ns);
    lw_histogram_add(&f->age, now_ns - published->heard_ns + published->solve_ns);
}

static bool bit_of(const uint64_t *bits, lw_tile_id id) { return bits[id.v / 64] >> (id.v % 64) & 1; }

static void note_good_tile(struct lw_load_session *s, const struct lw_tile_finding *finding, uint64_t version,
                           uint64_t now_ns) {
    const lw_tile_id id = finding->id;
    if (finding->before && !(s->fresh && bit_of(s->fresh, id))) note_update(s, version, now_ns);
    if (s->fresh) s->fresh[id.v / 64] &= ~(1ull << (id.v % 64));
    bool is_wanted = !s->wanted || bit_of(s->wanted, id);
    if (!finding->before && is_wanted && --s->missing == 0) complete_view(s, now_ns);
}

/* Notes the fault of a tile. A client ignores two of the faults: they do not end the session. */
static void note_bad_tile(struct lw_load_session *s, const struct lw_message_tile *t,
                          enum lw_tile_verdict verdict) {
    char where[96];
    snprintf(where, sizeof where, "object %u, level %u, tile %u, version %llu", t->object, t->level, t->tile,
             (unsigned long long)t->version);
    if (verdict == LW_TILE_NOWHERE) fail(s, LW_LOAD_FAULT_PLACE, "message TILE: %s", where);
    if (verdict == LW_TILE_DAMAGED) fail(s, LW_LOAD_FAULT_PAYLOAD, "%s", where);
    if (verdict == LW_TILE_BACKWARDS) note_fault(s->shared, LW_LOAD_FAULT_VERSION, "%s", where);
    if (verdict == LW_TILE_DIFFERENT) note_fault(s->shared, LW_LOAD_FAULT_DIFFERENT, "%s", where);
}

static void handle_tile(struct lw_load_session *s, const struct lw_message_tile *tile, uint64_t now_ns) {
    struct lw_tile_finding finding;
    if (s->state != STREAMING) {
        out_of_order(s, LW_MESSAGE_TILE);
        return;
    }
    s->shared->figures->tiles++;
    if (lw_tile_check_take(s->shared->check, tile, s->known, s->held, &finding) != LW_OK) {
        fail(s, LW_LOAD_FAULT_SYSTEM, "out of memory for a tile");
    } else if (finding.verdict == LW_TILE_GOOD) {
        note_good_tile(s, &finding, tile->version, now_ns);
    } else {
        note_bad_tile(s, tile, finding.verdict);
    }
}

static void handle_settled(struct lw_load_session *s, uint64_t frame, uint64_t now_ns) {
    struct lw_load_figures *f = s->shared->figures;
    if (s->state != STREAMING || frame != s->frame) {
        out_of_order(s, LW_MESSAGE_SETTLED);
        return;
    }
    if (frame == s->frame_settled) return; /* once more, after an INTEREST */
    s->frame_settled = frame;
    f->settled++;
    if (f->measuring && s->counts && frame > s->first_frame)
        lw_histogram_add(&f->whole, now_ns - lw_frame_clock_find(&s->shared->clock, frame)->heard_ns);
}

static void handle_pong(struct lw_load_session *s, uint64_t token, uint64_t now_ns) {
    if (token < s->began_ns || token > now_ns)
        fail(s, LW_LOAD_FAULT_ORDER, "message PONG: nobody sent such a PING");
    else if (s->counts && s->shared->figures->measuring)
        lw_histogram_add(&s->shared->figures->ping, now_ns - token);
}

static void handle_message(struct lw_load_session *s, const struct lw_message *m, uint64_t now_ns) {
    switch (m->type) {
    case LW_MESSAGE_WELCOME:
        handle_welcome(s, &m->welcome, now_ns);
        break;
    case LW_MESSAGE_REFUSAL:
        s->retry_after_ms = m->refusal.retry_after_ms;
        fail(s, s->welcomed_ns ? LW_LOAD_FAULT_LOST : LW_LOAD_FAULT_REFUSED, "%s",
             m->refusal.text && *m->refusal.text ? m->refusal.text : "the server did not say why");
        break;
    case LW_MESSAGE_PACKAGE_CHUNK:
        handle_chunk(s, &m->package_chunk, now_ns);
        break;
    case LW_MESSAGE_FRAME:
        handle_frame(s, &m->frame, now_ns);
        break;
    case LW_MESSAGE_TILE:
        handle_tile(s, &m->tile, now_ns);
        break;
    case LW_MESSAGE_SETTLED:
        handle_settled(s, m->settled.frame, now_ns);
        break;
    case LW_MESSAGE_PING:
        send_message(s, &(struct lw_message){.type = LW_MESSAGE_PONG, .pong.token = m->ping.token});
        break;
    case LW_MESSAGE_WAITING: /* so much is waited for anyway */
        break;
    case LW_MESSAGE_PONG:
        handle_pong(s, m->pong.token, now_ns);
        break;
    default:
        fail(s, LW_LOAD_FAULT_MESSAGE, "message %s: not one that a server sends",
             lw_message_name((uint16_t)m->type));
    }
}

/* ---- reading ---- */

/* Takes one message; returns whether there was one that did not break the session. */
static bool take_message(struct lw_load_session *s, uint64_t now_ns) {
    struct lw_framing_header header;
    struct lw_message message;
    struct lw_error err = {0};
    const uint8_t *body;
    enum lw_status status = lw_message_reader_take(&s->input, &header, &body, &err);
    if (status == LW_OK && !body) return false;
    /* types that we do not know are from a newer server */
    bool known = status == LW_OK && lw_message_name(header.type);
    if (known) status = lw_message_decode(header, body, &message, &err);
    if (status != LW_OK) {
        fail(s, status == LW_NO_MEMORY ? LW_LOAD_FAULT_SYSTEM : LW_LOAD_FAULT_MESSAGE, "%s", err.text);
        return false;
    }
    if (known) {
        handle_message(s, &message, now_ns);
        lw_message_finish(&message);
    }
    return true;
}

static void receive(struct lw_load_session *s, const uint8_t *data, size_t size, uint64_t now_ns) {
    if (s->welcomed_ns && s->run != s->shared->run) { /* others have heard of its end before us */
        fail(s, LW_LOAD_FAULT_LOST, "the server was started again");
        return;
    }
    lw_message_reader_lend(&s->input, data, size);
    while (s->state < STOPPED && take_message(s, now_ns)) {
    }
    if (s->state >= STOPPED)
        lw_message_reader_clear(&s->input);
    else if (lw_message_reader_keep(&s->input) != LW_OK)
        fail(s, LW_LOAD_FAULT_SYSTEM, "out of memory for a message");
}

static void on_alloc(uv_handle_t *handle, size_t suggested, uv_buf_t *out_buffer) {
    struct lw_load_session *s = handle->data;
    size_t size = sizeof s->shared->read_buffer;
    (void)suggested;
    if (s->reader == LW_LOAD_SLOW && s->allowance < (double)size)
        size = s->allowance < 1 ? 1 : (size_t)s->allowance;
    *out_buffer = uv_buf_init((char *)s->shared->read_buffer, (unsigned)size);
}

static void acknowledge(struct lw_load_session *s) {
    if (s->frame == s->frame_acked) return;
    s->frame_acked = s->frame;
    send_message(s, &(struct lw_message){.type = LW_MESSAGE_ACK, .ack.frame = s->frame});
}

/* ---- TLS ---- */

static void send_hello(struct lw_load_session *s) {
    s->state = GREETING;
    s->heard_ns = lw_clock_ns();
    const struct lw_access *access = &s->shared->options->access;
    send_message(s, &(struct lw_message){.type = LW_MESSAGE_HELLO,
                                         .hello = {.version = LW_WIRE_VERSION,
                                                   .features = LW_FEATURES_READ,
                                                   .name = "lightwell-load",
                                                   .token = access->has_token ? access->token.bytes : NULL}});
}

static void fail_tls(struct lw_load_session *s, const struct lw_error *cause) {
    struct lw_error err = {0};
    if (s->state != CONNECTING) {
        lose(s, cause->text);
        return;
    }
    (void)lw_tls_trust_explain(&err, "the server", cause, s->first_byte);
    fail(s, LW_LOAD_FAULT_CONNECT, "%s", err.text);
}

/* Decrypts received bytes, and hands the plain ones on. */
static void receive_by_tls(struct lw_load_session *s, const uint8_t *data, size_t size, uint64_t now_ns) {
    struct lw_error cause = {0};
    enum lw_status status;
    size_t got;
    if (size && s->first_byte < 0) s->first_byte = data[0];
    lw_tls_stream_lend(s->tls, data, size);
    do {
        got = 0;
        status = lw_tls_stream_read(s->tls, s->shared->record, sizeof s->shared->record, &got,
                                    &s->shared->output, &cause);
        send_output(s);
        if (status == LW_OK && got && !is_over(s)) receive(s, s->shared->record, got, now_ns);
    } while (status == LW_OK && got && s->state != CLOSED);
    if (s->state == CLOSED) return;
    if (status != LW_OK)
        fail_tls(s, &cause);
    else if (s->state == CONNECTING && lw_tls_stream_is_ready(s->tls))
        send_hello(s);
}

static void on_read(uv_stream_t *stream, ssize_t size, const uv_buf_t *buffer) {
    struct lw_load_session *s = stream->data;
    if (size == UV_EOF) {
        lose(s, "the server closed the connection");
        return;
    }
    if (size < 0) {
        lose(s, uv_strerror((int)size));
        return;
    }
    if (size == 0 || is_over(s)) return;
    uint64_t now_ns = lw_clock_ns();
    s->heard_ns = now_ns;
    s->shared->figures->bytes += (uint64_t)size;
    s->second_bytes += (uint64_t)size;
    if (s->tls)
        receive_by_tls(s, (const uint8_t *)buffer->base, (size_t)size, now_ns);
    else
        receive(s, (const uint8_t *)buffer->base, (size_t)size, now_ns);
    if (s->state == STREAMING) acknowledge(s);
    s->allowance -= (double)size;
    if (s->reader == LW_LOAD_SLOW && s->allowance < 1 && s->state < STOPPED) {
        s->paused = true;
        uv_read_stop(stream);
    }
}

/* ---- the beginning ---- */

static void on_connected(uv_connect_t *request, int result) {
    struct lw_load_session *s = request->handle->data;
    if (is_over(s)) return;
    if (result == 0) result = uv_read_start((uv_stream_t *)&s->tcp, on_alloc, on_read);
    if (result < 0) {
        fail(s, LW_LOAD_FAULT_CONNECT, "%s", uv_strerror(result));
        return;
    }
    (void)uv_tcp_nodelay(&s->tcp, 1);
    if (s->tls)
        receive_by_tls(s, NULL, 0, lw_clock_ns()); /* a client speaks first */
    else
        send_hello(s);
}

/* The kernel's buffers would read a few megabytes for someone who reads slowly. */
static void keep_buffers_small(struct lw_load_session *s) {
    int descriptor, size = LW_LOAD_SLOW_RECEIVE;
    if (uv_fileno((uv_handle_t *)&s->tcp, &descriptor) == 0)
        (void)setsockopt(descriptor, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
}

static enum lw_status allocate(struct lw_load_session *s) {
    const uint32_t tiles = s->shared->scene->map.tile_count;
    s->missing = tiles;
    if (s->shared->scene->trust &&
        lw_tls_stream_create(s->shared->scene->trust, s->shared->options->host, &s->tls) != LW_OK)
        return LW_NO_MEMORY;
    const size_t held_bytes = lw_tile_held_bytes_max(&s->shared->scene->map);
    /* a user who returns has versions without their light: such a session cannot be followed */
    if (!s->known && s->number % LW_LOAD_FOLLOWED_ONE_IN == 1 &&
        (!s->shared->held_bytes || s->shared->held_bytes + held_bytes <= LW_LOAD_FOLLOWED_BYTES)) {
        if (lw_tile_held_create(&s->shared->scene->map, &s->held) != LW_OK) return LW_NO_MEMORY;
        s->shared->held_bytes += held_bytes;
    }
    if (!s->known) s->known = calloc((size_t)tiles + 1, sizeof *s->known);
    if (s->shared->options->path == LW_LOAD_EVERYTHING) return s->known ? LW_OK : LW_NO_MEMORY;
    s->wanted = calloc(tiles / 64 + 1, sizeof *s->wanted);
    s->fresh = calloc(tiles / 64 + 1, sizeof *s->fresh);
    return s->known && s->wanted && s->fresh ? LW_OK : LW_NO_MEMORY;
}

static enum lw_status cannot_start(struct lw_load_shared *shared, int result) {
    note_fault(shared, LW_LOAD_FAULT_SYSTEM, "%s", uv_strerror(result));
    shared->figures->refused++;
    return result == UV_ENOMEM ? LW_NO_MEMORY : LW_OS;
}

/* before: the rest of the user's last session, whose memory it takes over; NULL: there was none. */
static enum lw_status start(struct lw_load_shared *shared, uint32_t number, enum lw_load_reader reader,
                            struct lw_load_return *before) {
    const struct sockaddr *address = (const struct sockaddr *)&shared->scene->address;
    shared->figures->asked++;
    struct lw_load_session *s = calloc(1, sizeof *s);
    int result = s ? uv_tcp_init_ex(shared->loop, &s->tcp, address->sa_family) : UV_ENOMEM;
    if (result < 0) {
        free(s);
        return cannot_start(shared, result);
    }
    s->tcp.data = s;
    s->first_byte = -1;
    s->input.body_max = LW_FRAMING_BODY_MAX;
    s->shared = shared;
    s->number = number;
    s->reader = reader;
    s->counts = reader == LW_LOAD_FAST || shared->options->odd_readers == shared->options->users;
    s->began_ns = s->view_since_ns = s->allowed_ns = lw_clock_ns();
    if (before) {
        s->returns = true;
        s->attempt = before->attempt;
        s->broke_ns = before->broke_ns;
        s->light_ns = before->light_ns;
        s->run = before->run;
        s->known = before->known;
        before->known = NULL;
    }
    link_session(s);
    if (reader != LW_LOAD_FAST) keep_buffers_small(s);
    result =
        allocate(s) == LW_OK ? uv_tcp_connect(&s->connecting, &s->tcp, address, on_connected) : UV_ENOMEM;
    if (result == 0) return LW_OK;
    lw_load_session_close(s);
    return cannot_start(shared, result);
}

enum lw_status lw_load_session_start(struct lw_load_shared *shared, uint32_t number,
                                     enum lw_load_reader reader) {
    return start(shared, number, reader, NULL);
}

static void free_return(struct lw_load_return *r) {
    free(r->known);
    free(r);
}

void lw_load_session_return_due(struct lw_load_shared *shared, uint64_t now_ns) {
    struct lw_load_return *due = NULL, *r;
    for (struct lw_load_return **at = &shared->returning; (r = *at);) {
        if (r->due_ns > now_ns) {
            at = &r->next;
            continue;
        }
        *at = r->next;
        r->next = due;
        due = r;
    }
    while ((r = due)) { /* starting may fail at once, and plan another return */
        due = r->next;
        (void)!start(shared, r->number, r->reader, r);
        free_return(r);
    }
}

void lw_load_session_forget_returning(struct lw_load_shared *shared) {
    for (struct lw_load_return *r; (r = shared->returning);) {
        shared->returning = r->next;
        free_return(r);
    }
}

/* ---- time ---- */

static void allow(struct lw_load_session *s, uint64_t now_ns) {
    double rate = s->shared->options->slow_bytes_hz;
    s->allowance =
        fmin(s->allowance + rate * 1e-9 * (double)(now_ns - s->allowed_ns), fmax(rate * ALLOWANCE_S, 1));
    s->allowed_ns = now_ns;
    if (!s->paused || s->allowance < 1) return;
    s->paused = false;
    int result = uv_read_start((uv_stream_t *)&s->tcp, on_alloc, on_read);
    if (result < 0) lose(s, uv_strerror(result));
}

/* A second that began before the measured time does not count: a newcomer's first light is in it. */
static void end_second(struct lw_load_session *s, uint64_t now_ns) {
    struct lw_load_figures *f = s->shared->figures;
    if (now_ns - s->second_ns < SECOND_NS) return;
    if (f->measuring && s->counts && s->second_counts && s->second_ns >= s->shared->measured_from_ns)
        lw_histogram_add(&f->second_bytes, (uint64_t)((double)s->second_bytes * (double)SECOND_NS /
                                                      (double)(now_ns - s->second_ns)));
    s->second_ns = now_ns;
    s->second_bytes = 0;
    s->second_counts = s->has_view;
}

void lw_load_session_tick(struct lw_load_session *s, uint64_t now_ns) {
    if (s->state <= GREETING && now_ns > s->began_ns + LW_LOAD_CONNECT_TIMEOUT_S * SECOND_NS)
        fail(s, LW_LOAD_FAULT_CONNECT, "no welcome within %u s", LW_LOAD_CONNECT_TIMEOUT_S);
    if (s->state == LEAVING && now_ns > s->quiet_ns + GOODBYE_NS) lw_load_session_close(s);
    if (s->reader == LW_LOAD_SLOW && s->state > CONNECTING && !is_over(s)) allow(s, now_ns);
    if (s->state <= GREETING || is_over(s)) return;
    if (s->reader == LW_LOAD_FAST && now_ns > s->heard_ns + LW_LOAD_SILENCE_S * SECOND_NS)
        fail(s, LW_LOAD_FAULT_SILENCE, "frame %llu was the last", (unsigned long long)s->frame);
    if (now_ns >= s->pinged_ns + LW_LOAD_PING_S * SECOND_NS) ping(s, now_ns);
    if (s->wanted && s->state == STREAMING && now_ns >= s->looked_ns + LOOK_NS) update_view(s, now_ns);
    if (s->state == STREAMING) end_second(s, now_ns);
}

static void on_goodbye(uv_shutdown_t *request, int result) {
    struct lw_load_session *s = request->handle->data;
    if (result < 0 && result != UV_ECANCELED) lw_load_session_close(s);
}

void lw_load_session_leave(struct lw_load_session *s, bool graceful) {
    uint64_t now_ns = lw_clock_ns();
    if (is_over(s)) return;
    s->shared->figures->left++;
    lw_load_session_conclude(s, now_ns);
    bool reads = s->state > CONNECTING && s->state != STOPPED && !s->paused;
    if (graceful && reads && uv_shutdown(&s->goodbye, (uv_stream_t *)&s->tcp, on_goodbye) == 0) {
        set_over(s, LEAVING);
        s->quiet_ns = now_ns;
        lw_message_reader_clear(&s->input);
    } else {
        close_session(s, !graceful);
    }
}
