#include "server/serve/server.h"

#include "common/clock.h"
#include "common/invariant.h"
#include "common/log.h"
#include "common/slices.h"
#include "server/serve/sessions/fine_turns.h"
#include "server/serve/sessions/session.h"
#include "server/serve/sessions/turns.h"
#include "server/serve/transports/control_socket.h"
#include "server/serve/transports/tcp_transport.h"
#include "server/serve/web/web_server.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <netdb.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/random.h>
#include <sys/resource.h>
#include <unistd.h>
#include <zstd.h>

#define BACKLOG            1024
#define TICK_MS            (1000u / LW_SERVER_LOOKS_HZ)
#define LAG_MS             20u
#define END_MS             5000u    /* for handles to close */
#define TURN_NS            4000000u /* time of sending before the loop looks at other events */
#define COMPRESSION_LEVEL  3
#define ADDRESS_SIZE       300u
#define DESCRIPTORS_SPARED 8u /* the highest, of which a server takes one */
#define DESCRIPTORS_MAX    65536u

#define ENDPOINTS 4

/* Where connections come in. */
struct endpoint {
    uv_stream_t *listener;
    struct lw_web_server **web; /* NULL: they are sessions by themselves */
    unsigned taken, most;       /* in a turn */
    bool is_held;               /* one more came: it is taken in the next turn */
};

/* Interest of those who are no sessions. */
struct outside {
    uint32_t channels; /* bit for each; 0: nobody is there */
    bool everything;
    uint32_t *tile;
    size_t tile_count;
};

/* A thread that compresses the packages while others begin their work. What it makes is read once
 * await_packages() has ended. */
struct packer {
    uv_thread_t thread;
    bool runs;
    enum lw_status status;
    const uint8_t *package, *finishes;
    size_t package_size, finishes_size;
};

struct lw_server {
    uv_loop_t loop;
    struct endpoint endpoint[ENDPOINTS];
    uv_tcp_t listener, http_listener, metrics_listener;
    uv_pipe_t control_listener;
    uv_tcp_t spare; /* for a connection that nothing else could take */
    uv_poll_t top;  /* on the highest descriptor (reserve_descriptors()) */
    int top_fd;     /* 0: none */
    uv_async_t wake;
    uv_prepare_t prepare; /* before the loop waits */
    uv_check_t check;     /* after it has waited */
    uv_idle_t busy;       /* runs while sessions are due: then it does not wait */
    uv_timer_t tick, lag; /* run while there are connections: an idle server sleeps */
    uv_timer_t beat;      /* runs if hooks want it */
    struct lw_server_hooks hooks;
    uint64_t lagged_ns;     /* when lag last came */
    uint64_t ticked_ns;     /* when tick last came */
    uint64_t window_ns;     /* when the window began that loop_lag and shared.ack belong to */
    uint32_t told_channels; /* channels that sessions took when hooks.news was last called */
    struct lw_histogram loop_lag;
    struct lw_durations lag_all; /* the same since the start */
    uv_signal_t interrupt, terminate, hangup;
    bool has_terminal; /* its log goes to one */
    char *tokens_path;
    char *control_path; /* path of a socket still to be made */
    bool is_unix_only;
    bool stopping, signalled;
    uint16_t port, http_port, metrics_port;
    uint32_t *order;
    struct lw_session_shared shared;
    struct lw_tcp_transport_shared tcp;
    struct outside outside;            /* as it counts */
    struct lw_web_server *web;         /* NULL: there is no HTTP */
    struct lw_web_server *metrics_web; /* NULL: there is no monitoring */
    struct packer packer;

    uv_mutex_t mutex;                   /* guards what follows; held for an assignment only */
    struct lw_snapshot *latest;         /* handed over, not yet seen by the loop */
    struct lw_server_interest interest; /* handed over, not yet taken by the solver */
    bool has_interest, stop_requested, relay_requested;
    bool has_above; /* handed over, not yet seen by the loop */
    uint64_t above[LW_MESSAGE_RELAYS_MAX];
    uint32_t above_count;
    uint64_t run;                /* the same; 0: none */
    struct outside next_outside; /* the same */
    bool has_next_outside;
    bool runs;           /* the loop's thread is in lw_server_run() */
    clockid_t cpu_clock; /* its CPU clock; valid while it runs */
};

/* ---- the compressed packages ---- */

/* One of them on its way into messages. */
struct packing {
    enum lw_message_type type; /* its chunks' */
    struct lw_session_package *to;
    struct lw_message_package *told; /* its lists are allocated */
    uint32_t capacity;               /* chunks */
    ZSTD_CCtx *zstd;
    uint8_t *piece; /* LW_SESSION_CHUNK bytes */
};

static enum lw_status add_chunk(struct packing *p, uint32_t part, size_t size) {
    struct lw_session_package *to = p->to;
    if (to->chunk_count == p->capacity) {
        uint32_t grown_capacity = p->capacity ? p->capacity * 2 : 64;
        struct lw_session_chunk *grown = realloc(to->chunk, grown_capacity * sizeof *grown);
        if (!grown) return LW_NO_MEMORY;
        to->chunk = grown;
        p->capacity = grown_capacity;
    }
    uint64_t *compressed_size = &p->told->compressed_size;
    struct lw_session_chunk *chunk = &to->chunk[to->chunk_count];
    struct lw_message message = {.type = p->type, .package_chunk = {*compressed_size, p->piece, size}};
    enum lw_status status = lw_blob_from_message(&message, &chunk->blob);
    if (status == LW_OK) {
        *compressed_size += size;
        chunk->end = *compressed_size;
        LW_INVARIANT(to->chunk_count < p->capacity && size <= LW_SESSION_CHUNK);
        chunk->part = part;
        to->chunk_count++;
    }
    return status;
}

/* Straight into messages that all sessions share; the compressed whole never exists in one piece. */
static enum lw_status compress_part(struct packing *p, uint32_t part, const uint8_t *bytes, size_t size) {
    ZSTD_inBuffer in = {bytes, size, 0};
    if (ZSTD_isError(ZSTD_CCtx_setPledgedSrcSize(p->zstd, size))) return LW_INTERNAL;
    enum lw_status status = LW_OK;
    for (size_t left = 1; status == LW_OK && left;) {
        ZSTD_outBuffer out = {p->piece, LW_SESSION_CHUNK, 0};
        do {
            left = ZSTD_compressStream2(p->zstd, &out, &in, ZSTD_e_end);
        } while (!ZSTD_isError(left) && left && out.pos < out.size);
        status = ZSTD_isError(left) ? LW_NO_MEMORY : add_chunk(p, part, out.pos);
    }
    return status;
}

/* The lists of parts; free_parts() frees them. */
static enum lw_status list_parts(struct lw_message_package *told, const uint8_t *package, const uint64_t *end,
                                 size_t count) {
    uint64_t *size = malloc(2 * count * sizeof *size);
    struct lw_package_hash *hash = malloc(count * sizeof *hash);
    told->part_size = size;
    told->part_hash = hash;
    if (!size || !hash) return LW_NO_MEMORY;
    told->part_compressed_size = size + count;
    for (size_t i = 0; i < count; i++) {
        const uint64_t begin = i ? end[i - 1] : 0;
        LW_INVARIANT(end[i] > begin);
        size[i] = end[i] - begin;
        size[count + i] = 0;
        lw_package_hash(package + begin, (size_t)size[i], &hash[i]);
    }
    told->part_count = count;
    return LW_OK;
}

static void free_parts(struct lw_message_package *told) {
    free((void *)told->part_size); /* and part_compressed_size */
    free((void *)told->part_hash);
}

/* A package that ends as its parts do. */
static enum lw_status compress(struct packing *p, const uint8_t *bytes, const uint64_t *end, size_t count) {
    const size_t size = (size_t)end[count - 1];
    p->piece = malloc(LW_SESSION_CHUNK);
    p->zstd = ZSTD_createCCtx();
    enum lw_status status = p->piece && p->zstd ? list_parts(p->told, bytes, end, count) : LW_NO_MEMORY;
    if (status == LW_OK &&
        ZSTD_isError(ZSTD_CCtx_setParameter(p->zstd, ZSTD_c_compressionLevel, COMPRESSION_LEVEL)))
        status = LW_INTERNAL;
    p->told->size = size;
    lw_package_hash(bytes, size, &p->told->hash);
    for (size_t i = 0; status == LW_OK && i < count; i++) {
        const uint64_t begin = i ? end[i - 1] : 0, compressed = p->told->compressed_size;
        status = compress_part(p, (uint32_t)i, bytes + begin, (size_t)(end[i] - begin));
        ((uint64_t *)p->told->part_compressed_size)[i] = p->told->compressed_size - compressed;
    }
    ZSTD_freeCCtx(p->zstd);
    free(p->piece);
    LW_INVARIANT(status != LW_OK || p->to->chunk[p->to->chunk_count - 1].end == p->told->compressed_size);
    return status;
}

static enum lw_status compress_package(struct lw_session_shared *shared, const uint8_t *bytes, size_t size) {
    struct lw_message_welcome *w = &shared->welcome;
    struct lw_message_package told = {0};
    uint64_t *end = NULL;
    size_t count = 0;
    enum lw_status status = lw_package_cut(bytes, size, &end, &count);
    if (status == LW_OK)
        status = compress(
            &(struct packing){.type = LW_MESSAGE_PACKAGE_CHUNK, .to = &shared->package, .told = &told}, bytes,
            end, count);
    free(end);
    w->package_hash = told.hash;
    w->package_size = told.size;
    w->package_compressed_size = told.compressed_size;
    if (status != LW_OK || count == 1) { /* a package of one part: nothing more is announced */
        free_parts(&told);
        return status;
    }
    w->part_size = told.part_size;
    w->part_compressed_size = told.part_compressed_size;
    w->part_hash = told.part_hash;
    w->part_count = count;
    w->features |= LW_FEATURE_PARTS;
    return status;
}

/* Textures beyond the limit of parts are in the last one. */
static enum lw_status compress_finishes(struct lw_session_shared *shared, const uint8_t *bytes, size_t size) {
    uint64_t *end = NULL;
    size_t count = 0;
    if (!size) return LW_OK;
    enum lw_status status = lw_finish_package_cut(bytes, size, &end, &count);
    if (status == LW_OK && count > LW_MESSAGE_FINISH_PARTS_MAX) {
        LW_INVARIANT(end[count - 1] == size);
        count = LW_MESSAGE_FINISH_PARTS_MAX;
        end[count - 1] = size;
    }
    if (status == LW_OK)
        status = compress(&(struct packing){.type = LW_MESSAGE_FINISH_CHUNK,
                                            .to = &shared->finishes,
                                            .told = &shared->welcome.finish},
                          bytes, end, count);
    free(end);
    return status;
}

static void free_chunks(struct lw_session_package *package) {
    for (uint32_t i = 0; i < package->chunk_count; i++) lw_blob_unref(package->chunk[i].blob);
    free(package->chunk);
}

/* ---- the order of tiles ---- */

/* Levels count from fine to coarse and objects differ in their number of levels: each object's
 * coarsest level goes first, then each one's next finer, down to level 0. Finer levels come last. */
static enum lw_status make_order(const struct lw_atlas_map *map, uint32_t **out_order,
                                 uint32_t *out_coarsest) {
    uint32_t *order = malloc((map->tile_count ? map->tile_count : 1) * sizeof *order), filled = 0;
    if (!order) return LW_NO_MEMORY;
    for (uint32_t above = 0; above < LW_ATLAS_LEVELS_MAX; above++)
        for (uint32_t o = 0; o < map->object_count; o++) {
            const struct lw_atlas *atlas = &map->atlas[o];
            if (above >= atlas->level_count) continue;
            const struct lw_atlas_level *level = &atlas->level[atlas->level_count - 1 - above];
            for (uint32_t t = 0; t < level->tiles_x * level->tiles_y; t++)
                order[filled++] = map->first_tile[o] + level->first_tile + t;
            if (!above) *out_coarsest = filled;
        }
    LW_INVARIANT(filled == map->plain_count);
    while (filled < map->tile_count) order[filled] = filled, filled++;
    *out_order = order;
    return LW_OK;
}

/* ---- hand-over ---- */

/* A relay has dropped a tile of a finer level that nobody lists: its id may be another tile's next. */
static void forget_tile(struct lw_session_channel *channel, uint32_t id) {
    lw_deltas_forget(&channel->deltas, id);
    lw_priority_forget(&channel->priority, id);
}

/* Lists what a snapshot changes of a channel, in the order in which it goes to those who had all of the one
 * before. */
static void note_changed(const struct lw_server *server, struct lw_session_channel *channel,
                         const struct lw_snapshot *after) {
    const struct lw_snapshot *before = channel->snapshot;
    lw_priority_list_begin(&channel->priority);
    for (uint32_t i = 0; i < after->tile_count; i++) {
        const uint32_t id = server->order[i];
        const struct lw_snapshot_tile *tile = &after->tile[channel->number][id];
        const uint64_t had = before ? before->tile[channel->number][id].version : 0;
        if (had && !tile->version) forget_tile(channel, id);
        if (tile->version <= had) continue;
        lw_deltas_add(&channel->deltas, id, tile);
        lw_priority_note(&channel->priority, id, lw_snapshot_frame_of(tile->version), tile->change);
        lw_priority_list(&channel->priority, id,
                         lw_priority_of(&channel->priority, id, lw_snapshot_frame_of(had), after->frame));
    }
    channel->changed_count = channel->priority.listed_count;
    LW_INVARIANT(channel->changed_count <= after->tile_count);
    lw_priority_list_end(&channel->priority, channel->changed);
}

static void adopt_channel(const struct lw_server *server, struct lw_session_channel *channel,
                          struct lw_snapshot *snapshot) {
    note_changed(server, channel, snapshot);
    lw_snapshot_unref(channel->snapshot);
    channel->snapshot = lw_snapshot_ref(snapshot);
    channel->generation++;
}

/* Answers the updates that the snapshot shows. */
static void answer_updates(struct lw_session_shared *shared) {
    struct lw_updates_entry entry;
    while (lw_updates_next(&shared->updates, shared->snapshot->frame, &entry)) {
        if (entry.session)
            lw_session_answer(entry.session, &(struct lw_message_updated){.request = entry.request,
                                                                          .frame = entry.frame,
                                                                          .added = entry.added,
                                                                          .added_count = entry.added_count});
        free(entry.added);
    }
}

/* A relay: forwards the answers of the server above. */
static void answer_passed(struct lw_session_shared *shared) {
    struct lw_passed_updates_done done;
    const uint64_t frame = shared->snapshot ? shared->snapshot->frame : 0;
    while (shared->is_relay && lw_passed_updates_next(&shared->passed, frame, &done)) {
        if (done.is_lost)
            lw_session_refuse(done.session, LW_REFUSAL_SHUTDOWN,
                              "the server above is gone: an update may have been made or not");
        else
            lw_session_answer(done.session, &done.answer);
        free(done.storage);
    }
}

static void adopt(struct lw_server *server, struct lw_snapshot *snapshot) {
    struct lw_session_shared *shared = &server->shared;
    LW_INVARIANT(snapshot->tile_count == shared->atlas_map->tile_count);
    LW_INVARIANT(!shared->snapshot || snapshot->frame >= shared->snapshot->frame);
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++)
        if (shared->channels_served >> f & 1 && lw_snapshot_has(snapshot, f))
            adopt_channel(server, &shared->channel[f], snapshot);
    lw_fine_names_review(&shared->fine, snapshot);
    lw_snapshot_unref(shared->snapshot);
    shared->snapshot = snapshot;
    shared->generation++;
    shared->epoch++;
    shared->recent[shared->generation % LW_SESSION_RECENT] =
        (struct lw_session_recent){snapshot->frame, lw_clock_ns()};
    answer_updates(shared);
    answer_passed(shared);
    lw_turns_begin_snapshot(shared);
}

static void free_interest(struct lw_server_interest *interest) {
    free(interest->levels);
    free(interest->tile);
    *interest = (struct lw_server_interest){0};
}

/* For a relay: the tiles that some session lists. */
static bool list_wanted(const struct lw_session_shared *shared, struct lw_server_interest *list) {
    const struct lw_interest_union *interest_union = &shared->interest_union;
    const uint32_t tiles = interest_union->atlas_map->tile_count;
    uint32_t count = 0;
    for (uint32_t t = 0; t < tiles; t++) count += interest_union->count[t] > 0;
    if (!(list->tile = malloc(((size_t)count + 1) * sizeof *list->tile))) return false;
    for (uint32_t t = 0; t < tiles; t++)
        if (interest_union->count[t]) list->tile[list->tile_count++] = t;
    LW_INVARIANT(list->tile_count == count);
    return lw_fine_turns_order(shared, list->tile, list->tile_count);
}

/* For the solver: what the tiles that are listed cover. */
static bool list_levels(const struct lw_interest_union *interest_union, struct lw_server_interest *list) {
    if (!(list->levels = malloc((size_t)interest_union->atlas_map->tile_count + 1))) return false;
    lw_interest_union_levels(interest_union, list->levels);
    return true;
}

/* A list is made only once the solver has taken the last one: however often sessions change their minds,
 * that is one for each frame. */
static void hand_over_interest(struct lw_server *server) {
    struct lw_interest_union *interest_union = &server->shared.interest_union;
    if (!interest_union->changed) return;
    uv_mutex_lock(&server->mutex);
    bool untaken = server->has_interest;
    uv_mutex_unlock(&server->mutex);
    if (untaken) return; /* the taker wakes the loop */
    struct lw_server_interest list = {.everything = interest_union->everything > 0};
    const bool is_made = server->shared.is_relay ? list_wanted(&server->shared, &list)
                         : list.everything       ? true
                                                 : list_levels(interest_union, &list);
    if (!is_made) {
        free_interest(&list);
        return; /* later, perhaps */
    }
    list.number = ++server->shared.fine.interest;
    interest_union->changed = false;
    uv_mutex_lock(&server->mutex);
    LW_INVARIANT(!server->has_interest && !server->interest.levels &&
                 !server->interest.tile); /* only this thread hands one over */
    server->interest = list;
    server->has_interest = true;
    uv_mutex_unlock(&server->mutex);
}

bool lw_server_take_interest(struct lw_server *server, struct lw_server_interest *out_interest) {
    uv_mutex_lock(&server->mutex);
    bool news = server->has_interest;
    if (news) *out_interest = server->interest;
    server->has_interest = false;
    server->interest = (struct lw_server_interest){0};
    uv_mutex_unlock(&server->mutex);
    if (news) uv_async_send(&server->wake); /* there may be more by now */
    return news;
}

uint32_t lw_server_get_relays_below(struct lw_server *server, struct lw_relay_tree_node *out_node,
                                    uint32_t capacity) {
    return lw_relay_tree_get(&server->shared.tree, out_node, capacity);
}

uint32_t lw_server_channels_taken(const struct lw_server *server) { return server->shared.channels_taken; }

size_t lw_server_take_updates(struct lw_server *server, uint64_t frame, struct lw_scene_change **out_change,
                              size_t *out_change_count) {
    return lw_updates_take(&server->shared.updates, frame, out_change, out_change_count);
}

bool lw_server_take_passed(struct lw_server *server, struct lw_passed_update *out_update) {
    return lw_passed_updates_take(&server->shared.passed, out_update);
}

bool lw_server_answer_passed(struct lw_server *server, uint64_t number,
                             const struct lw_message_updated *answer) {
    const bool done = lw_passed_updates_answer(&server->shared.passed, number, answer);
    uv_async_send(&server->wake);
    return done;
}

void lw_server_lose_passed(struct lw_server *server, uint64_t number) {
    lw_passed_updates_lose(&server->shared.passed, number);
    uv_async_send(&server->wake);
}

void lw_server_set_relays_above(struct lw_server *server, const uint64_t *above, uint32_t count) {
    LW_INVARIANT(count < LW_MESSAGE_RELAYS_MAX);
    uv_mutex_lock(&server->mutex);
    if (count) memcpy(server->above, above, count * sizeof *above);
    server->above_count = count;
    server->has_above = true;
    uv_mutex_unlock(&server->mutex);
    uv_async_send(&server->wake);
}

void lw_server_set_run(struct lw_server *server, uint64_t run) {
    LW_INVARIANT(run && server->shared.is_relay);
    uv_mutex_lock(&server->mutex);
    server->run = run;
    uv_mutex_unlock(&server->mutex);
    uv_async_send(&server->wake);
}

const _Atomic bool *lw_server_updates_wait(const struct lw_server *server) {
    return &server->shared.updates.waiting;
}

static void take_held(struct lw_server *server);

static void on_busy(uv_idle_t *handle) { (void)handle; }

/* Sessions are due, or connections are held, when the loop would wait: it must not. */
static void keep_busy(struct lw_server *server) {
    bool any = lw_turns_any_due(&server->shared);
    for (int d = 0; d < ENDPOINTS; d++) any |= server->endpoint[d].is_held;
    if (any)
        uv_idle_start(&server->busy, on_busy);
    else
        uv_idle_stop(&server->busy);
}

/* Wakes the thread of a relay when its clients have another interest, updates to forward, or other
 * channels. */
static void wake_relay(struct lw_server *server) {
    const uint32_t channels = server->shared.channels_taken;
    if (!server->hooks.news) return;
    uv_mutex_lock(&server->mutex);
    const bool news = server->has_interest;
    uv_mutex_unlock(&server->mutex);
    if (news || server->shared.passed.waiting || channels != server->told_channels)
        server->hooks.news(server->hooks.context);
    server->told_channels = channels;
}

static void on_prepare(uv_prepare_t *handle) {
    hand_over_interest(handle->data);
    wake_relay(handle->data);
    keep_busy(handle->data);
}

/* A snapshot for a thousand sessions takes longer to hand out than a newcomer, or an UPDATE, should wait. */
static void on_check(uv_check_t *handle) {
    struct lw_server *server = handle->data;
    server->tcp.turn++;
    lw_turns_read_on(&server->shared);
    take_held(server);
    lw_turns_serve_due(&server->shared, lw_clock_ns() + TURN_NS);
}

/* ---- the end ---- */

static void close_handle(uv_handle_t *handle) {
    if (handle->type != UV_UNKNOWN_HANDLE && !uv_is_closing(handle)) uv_close(handle, NULL);
}

static void stop_when_empty(struct lw_server *server) {
    if (server->stopping && !server->shared.first) uv_stop(&server->loop);
}

/* What adds up since the start, for lw_server_get_stats(). */
static void publish_sums(struct lw_server *server, uint64_t now_ns) {
    struct lw_session_shared *shared = &server->shared;
    LW_INVARIANT(now_ns >= server->ticked_ns);
    uv_mutex_lock(&shared->stats_mutex);
    shared->stats.session_ns += shared->stats.sessions_now * (now_ns - server->ticked_ns);
    shared->stats.loop_lag = server->lag_all;
    shared->stats.ack = shared->ack_all;
    uv_mutex_unlock(&shared->stats_mutex);
    server->ticked_ns = now_ns;
}

static void on_session_closed(void *context) {
    struct lw_server *server = context;
    if (!server->shared.first) {
        publish_sums(server, lw_clock_ns());
        uv_timer_stop(&server->tick);
        uv_timer_stop(&server->lag);
    }
    stop_when_empty(server);
}

/* signalled: without a watcher the next signal has its default effect: a user who cannot wait signals twice.
 * Else watchers stay until the end: a caller that goes away ends our input, and then sends a signal. */
static void begin_stop(struct lw_server *server, bool signalled) {
    server->signalled |= signalled;
    if (signalled) {
        uv_signal_stop(&server->interrupt);
        uv_signal_stop(&server->terminate);
    }
    if (server->stopping) return;
    server->stopping = true;
    if (server->hooks.stopping) server->hooks.stopping(server->hooks.context);
    close_handle((uv_handle_t *)&server->listener);
    close_handle((uv_handle_t *)&server->control_listener);
    close_handle((uv_handle_t *)&server->http_listener);
    for (struct lw_session *s = server->shared.first, *next; s; s = next) {
        next = lw_session_next(s);
        lw_session_refuse(s, LW_REFUSAL_SHUTDOWN, "the server ends");
    }
    stop_when_empty(server);
}

static void on_signal(uv_signal_t *handle, int number) {
    struct lw_server *server = handle->data;
    lw_log(LW_LOG_INFO, "%s: stopping", number == SIGINT ? "interrupted" : "asked to end");
    begin_stop(server, true);
}

/* A terminal that closes sends the same signal; its server would be left without anybody to stop it. */
static void on_hangup(uv_signal_t *handle, int number) {
    struct lw_server *server = handle->data;
    if (server->has_terminal && !isatty(STDERR_FILENO)) {
        on_signal(handle, number);
        return;
    }
    if (server->stopping) return;
    lw_log(LW_LOG_INFO, "SIGHUP: reading files again");
    server->hooks.reload(server->hooks.context);
}

static void count_outside(struct lw_session_shared *shared, const struct outside *outside, bool more) {
    struct lw_interest_union *all = &shared->interest_union;
    if (!outside->channels) return;
    if (outside->everything)
        (more ? lw_interest_union_add_everything : lw_interest_union_remove_everything)(all);
    else
        (more ? lw_interest_union_add : lw_interest_union_remove)(all, outside->tile, outside->tile_count);
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        struct lw_session_channel *channel = &shared->channel[c];
        if (!(outside->channels >> c & 1)) continue;
        LW_INVARIANT(more || channel->session_count > 0);
        if (more ? !channel->session_count++ : !--channel->session_count) shared->channels_taken ^= 1u << c;
    }
}

static void take_outside(struct lw_server *server) {
    uv_mutex_lock(&server->mutex);
    const bool has_next = server->has_next_outside;
    struct outside next = server->next_outside;
    server->has_next_outside = false;
    server->next_outside = (struct outside){0};
    uv_mutex_unlock(&server->mutex);
    if (!has_next) return;
    next.channels &= server->shared.channels_served;
    /* in this order, so that a tile of both is never without interest */
    count_outside(&server->shared, &next, true);
    count_outside(&server->shared, &server->outside, false);
    free(server->outside.tile);
    server->outside = next;
}

static bool reads_no_runs(const struct lw_session *session) { return !lw_session_reads_runs(session); }

/* Such sessions are to come back at once. */
static void send_back(struct lw_session_shared *shared, bool (*is_such)(const struct lw_session *session),
                      const char *why) {
    const uint32_t return_ms = shared->retry_after_ms;
    shared->retry_after_ms = LW_SERVER_RELAY_MS;
    for (struct lw_session *s = shared->first, *next; s; s = next) {
        next = lw_session_next(s);
        if (is_such(s)) lw_session_refuse(s, LW_REFUSAL_SHUTDOWN, "%s", why);
    }
    shared->retry_after_ms = return_ms;
}

/* A relay below may have one of them below itself. */
static void take_relays_above(struct lw_server *server) {
    struct lw_session_shared *shared = &server->shared;
    uv_mutex_lock(&server->mutex);
    const bool has_above = server->has_above;
    if (has_above) {
        memcpy(shared->relays + 1, server->above, server->above_count * sizeof *server->above);
        shared->relay_count = 1 + server->above_count;
    }
    server->has_above = false;
    uv_mutex_unlock(&server->mutex);
    if (has_above) send_back(shared, lw_session_is_relay, "the light comes through other relays now");
}

/* Before the first snapshot of the run: a session that reads no runs must get none of its tiles. */
static void take_run(struct lw_server *server) {
    struct lw_session_shared *shared = &server->shared;
    uv_mutex_lock(&server->mutex);
    const uint64_t run = server->run;
    server->run = 0;
    uv_mutex_unlock(&server->mutex);
    if (!run) return;
    shared->welcome.run = run;
    send_back(shared, reads_no_runs, "the light goes on as another run");
}

static void on_wake(uv_async_t *handle) {
    struct lw_server *server = handle->data;
    uv_mutex_lock(&server->mutex);
    struct lw_snapshot *snapshot = server->latest;
    bool stop = server->stop_requested;
    if (server->relay_requested) server->shared.retry_after_ms = LW_SERVER_RELAY_MS;
    server->latest = NULL;
    uv_mutex_unlock(&server->mutex);
    take_run(server); /* before the snapshot: the run was set before it */
    if (snapshot) adopt(server, snapshot);
    answer_passed(&server->shared);
    take_relays_above(server);
    take_outside(server);
    lw_turns_collect(&server->shared);
    if (stop) begin_stop(server, false);
}

static void on_tick(uv_timer_t *handle) {
    struct lw_server *server = handle->data;
    struct lw_session_shared *shared = &server->shared;
    struct lw_session_waiting waiting = {0};
    uint64_t now_ns = lw_clock_ns();
    shared->epoch++;
    lw_peer_log_tell(&shared->log, now_ns);
    publish_sums(server, now_ns);
    for (struct lw_session *s = shared->first, *next; s; s = next) {
        next = lw_session_next(s);
        lw_session_tick(s, now_ns, &waiting);
    }
    uv_mutex_lock(&shared->stats_mutex);
    shared->stats.waiting_bytes = waiting.bytes;
    shared->stats.waiting_bytes_max = waiting.bytes_max;
    shared->stats.socket_bytes = waiting.socket_bytes;
    uv_mutex_unlock(&shared->stats_mutex);
}

/* Tells the delays of the window, and begins the next one. */
static void end_window(struct lw_server *server, uint64_t now_ns) {
    struct lw_session_shared *shared = &server->shared;
    const uint64_t lag_p99_ns = lw_histogram_quantile(&server->loop_lag, 0.99),
                   ack_p99_ns = lw_histogram_quantile(&shared->ack, 0.99);
    uv_mutex_lock(&shared->stats_mutex);
    shared->stats.loop_lag_p99_ns = lag_p99_ns;
    shared->stats.loop_lag_max_ns = server->loop_lag.max;
    shared->stats.ack_p99_ns = ack_p99_ns;
    uv_mutex_unlock(&shared->stats_mutex);
    LW_INVARIANT(lag_p99_ns <= server->loop_lag.max && now_ns >= server->window_ns);
    memset(&server->loop_lag, 0, sizeof server->loop_lag);
    memset(&shared->ack, 0, sizeof shared->ack);
    server->window_ns = now_ns;
}

static void add_lag(struct lw_server *server, uint64_t late_ns) {
    lw_histogram_add(&server->loop_lag, late_ns);
    lw_durations_add(&server->lag_all, late_ns);
}

/* Events that came while the loop was away had to wait for its return: a long absence counts once for each
 * look that it covered. */
static void on_lag(uv_timer_t *handle) {
    struct lw_server *server = handle->data;
    const uint64_t now_ns = lw_clock_ns(), interval_ns = LAG_MS * 1000000u,
                   due_ns = server->lagged_ns + interval_ns;
    uint64_t late_ns = now_ns > due_ns ? now_ns - due_ns : 0;
    add_lag(server, late_ns);
    for (; late_ns > interval_ns; late_ns -= interval_ns) add_lag(server, late_ns - interval_ns);
    server->lagged_ns = now_ns;
    lw_turns_serve_paced(&server->shared);
    if (now_ns - server->window_ns >= LW_SERVER_WINDOW_S * 1000000000ull) end_window(server, now_ns);
}

static void on_beat(uv_timer_t *handle) {
    const struct lw_server *server = handle->data;
    server->hooks.beat(server->hooks.context);
}

/* A text of whole lines that a report holds. */
static size_t cut_report(const char *text, size_t size) {
    if (size <= LW_MESSAGE_REPORT_MAX) return size;
    size = LW_MESSAGE_REPORT_MAX;
    while (size && text[size - 1] != '\n') size--;
    return size;
}

/* The program's page, with the relays below. */
static bool make_page(void *context, const char *path, struct lw_server_page *out_page) {
    struct lw_server *server = context;
    if (!server->hooks.page(server->hooks.context, path, out_page)) return false;
    if (strcmp(path, "/metrics") == 0) lw_relay_tree_add_metrics(&server->shared.tree, out_page);
    return true;
}

/* Answers a question over the control socket. */
static enum lw_report_code on_ask(void *context, const struct lw_message_ask *ask, char **out_text,
                                  size_t *out_size) {
    struct lw_server *server = context;
    struct lw_server_page page = {0};
    switch (ask->what) {
    case LW_ASK_STATS:
        if (!server->hooks.page || !make_page(server, "/metrics", &page)) return LW_REPORT_UNKNOWN;
        *out_text = page.text;
        *out_size = cut_report(page.text, page.size);
        return LW_REPORT_DONE;
    case LW_ASK_DRAIN:
        lw_log(LW_LOG_INFO, "asked to drain: stopping");
        if (ask->return_after_ms) server->shared.retry_after_ms = ask->return_after_ms;
        server->signalled = true;
        lw_server_stop(server);
        return LW_REPORT_DONE;
    default:
        return LW_REPORT_UNKNOWN;
    }
}

static void on_session_opened(void *context) {
    struct lw_server *server = context;
    if (uv_is_active((uv_handle_t *)&server->tick)) return;
    server->lagged_ns = server->window_ns = server->ticked_ns = lw_clock_ns();
    uv_timer_start(&server->tick, on_tick, TICK_MS, TICK_MS);
    uv_timer_start(&server->lag, on_lag, LAG_MS, LAG_MS);
}

/* Anybody may cause any number of these. */
static void log_not_accepted(struct lw_server *server, const char *why) {
    static const struct lw_address nobody = {.bytes = {0}};
    if (lw_peer_log_allows(&server->shared.log, &nobody, "connections that were not accepted", lw_clock_ns()))
        lw_log(LW_LOG_WARNING, "cannot accept a connection: %s", why);
}

static void drop_connection(struct lw_server *server, struct endpoint *endpoint);

static void on_spare_closed(uv_handle_t *handle) {
    struct lw_server *server = handle->data;
    if (uv_is_closing((uv_handle_t *)&server->wake)) return; /* all of them are */
    (void)uv_tcp_init(&server->loop, &server->spare);        /* took no memory the first time, either */
    for (int d = 0; d < ENDPOINTS; d++) drop_connection(server, &server->endpoint[d]);
}

/* libuv tells of no further connection before the last one was taken. Where there was no memory for it, it is
 * taken to be closed; another one beside it waits until the spare handle is closed. */
static void drop_connection(struct lw_server *server, struct endpoint *endpoint) {
    if (!endpoint->is_held && !uv_is_closing((uv_handle_t *)&server->spare) &&
        uv_accept(endpoint->listener, (uv_stream_t *)&server->spare) == 0)
        uv_close((uv_handle_t *)&server->spare, on_spare_closed);
}

static const char *why_not(enum lw_status status) {
    return status == LW_UNAVAILABLE ? "too many, in all or of its address, too often, or out of memory"
                                    : lw_status_text(status);
}

static void take_connection(struct lw_server *server, struct endpoint *endpoint) {
    const enum lw_status status = endpoint->web ? lw_web_server_accept(*endpoint->web, endpoint->listener)
                                                : lw_tcp_transport_accept(&server->tcp, endpoint->listener);
    if (status != LW_OK) log_not_accepted(server, why_not(status));
    drop_connection(server, endpoint);
}

/* One that is not taken in this turn keeps libuv from looking for more. */
static void on_connection(uv_stream_t *listener, int result) {
    struct lw_server *server = listener->data;
    struct endpoint *endpoint = server->endpoint;
    while (endpoint->listener != listener) endpoint++;
    LW_INVARIANT_DEAR(!endpoint->is_held || result < 0); /* libuv waits until the one before is taken */
    if (result < 0)
        log_not_accepted(server, uv_strerror(result));
    else if (endpoint->taken == endpoint->most)
        endpoint->is_held = true;
    else {
        LW_INVARIANT(endpoint->taken < endpoint->most);
        endpoint->taken++;
        take_connection(server, endpoint);
    }
}

static void take_held(struct lw_server *server) {
    for (struct endpoint *endpoint = server->endpoint; endpoint < server->endpoint + ENDPOINTS; endpoint++) {
        endpoint->taken = endpoint->is_held;
        if (!endpoint->is_held) continue;
        endpoint->is_held = false;
        if (!uv_is_closing((uv_handle_t *)endpoint->listener)) take_connection(server, endpoint);
    }
}

static void init_endpoints(struct lw_server *server) {
    const unsigned most = LW_SERVER_TURN_CONNECTIONS,
                   by_https = server->tcp.tls ? LW_SERVER_TURN_HTTPS_CONNECTIONS : most;
    const struct endpoint endpoints[ENDPOINTS] = {
        {.listener = (uv_stream_t *)&server->listener, .most = most},
        {.listener = (uv_stream_t *)&server->control_listener, .most = most},
        {.listener = (uv_stream_t *)&server->http_listener, .web = &server->web, .most = by_https},
        {.listener = (uv_stream_t *)&server->metrics_listener, .web = &server->metrics_web, .most = by_https},
    };
    memcpy(server->endpoint, endpoints, sizeof endpoints);
}

/* ---- files that are read again ---- */

static void log_certificate(const struct lw_server *server) {
    char about[256];
    lw_tls_context_about(server->tcp.tls, about, sizeof about);
    lw_log(LW_LOG_INFO, "TLS: %s", about);
}

static void reload_certificate(struct lw_server *server) {
    struct lw_error err = {0};
    if (!server->tcp.tls) return;
    if (lw_tls_context_reload(server->tcp.tls, &err) == LW_OK)
        log_certificate(server);
    else
        lw_log(LW_LOG_ERROR, "the certificate stays as it was: %s", err.text);
}

static void reload_tokens(struct lw_server *server) {
    struct lw_session_shared *shared = &server->shared;
    struct lw_error err = {0};
    struct lw_tokens *tokens;
    if (!server->tokens_path) return;
    if (lw_tokens_read(server->tokens_path, &tokens, &err) != LW_OK) {
        lw_log(LW_LOG_ERROR, "the tokens stay as they were: %s", err.text);
        return;
    }
    lw_tokens_destroy(shared->tokens);
    shared->tokens = tokens;
    lw_log(LW_LOG_INFO, "%u tokens from %s", tokens->count, server->tokens_path);
    for (struct lw_session *s = shared->first, *next; s; s = next) {
        next = lw_session_next(s);
        lw_session_check_token(s);
    }
}

void lw_server_reload(struct lw_server *server) {
    reload_certificate(server);
    reload_tokens(server);
}

static enum lw_status read_certificate(struct lw_server *server, const struct lw_server_desc *desc,
                                       struct lw_error *err) {
    if (!desc->tls.certificate) return LW_OK;
    const enum lw_status status = lw_tls_context_create(&desc->tls, &server->tcp.tls, err);
    if (status != LW_OK)
        lw_status_context(err, "--tls-certificate, --tls-key");
    else
        log_certificate(server);
    return status;
}

static enum lw_status read_tokens(struct lw_server *server, const struct lw_server_desc *desc,
                                  struct lw_error *err) {
    if (!desc->tokens) return LW_OK;
    server->tokens_path = strdup(desc->tokens);
    if (!server->tokens_path) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    const enum lw_status status = lw_tokens_read(desc->tokens, &server->shared.tokens, err);
    if (status != LW_OK) lw_status_context(err, "--tokens");
    return status;
}

/* ---- create, run, destroy ---- */

static void format_address(char *dst, const char *host, unsigned port) {
    snprintf(dst, ADDRESS_SIZE, strchr(host, ':') ? "[%s]:%u" : "%s:%u", host, port);
}

/* option: which one names another address */
static enum lw_status listen_failure(struct lw_error *err, const char *address, const char *option,
                                     int result) {
    switch (result) {
    case UV_EADDRINUSE:
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "%s is already in use: another lightwelld? choose another with %s HOST:PORT",
                              address, option);
    case UV_EADDRNOTAVAIL:
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "%s is not an address of this machine: choose another with %s HOST:PORT",
                              address, option);
    case UV_EACCES:
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "%s needs more rights: choose a port above 1023 with %s HOST:PORT", address,
                              option);
    default:
        return lw_status_fail(err, LW_OS, "%s: cannot listen: %s", address, uv_strerror(result));
    }
}

static uint16_t port_of(const struct sockaddr_storage *bound) {
    return ntohs(bound->ss_family == AF_INET6 ? ((const struct sockaddr_in6 *)bound)->sin6_port
                                              : ((const struct sockaddr_in *)bound)->sin_port);
}

/* On a socket of the server before; *socket is -1 then. */
static enum lw_status take_over(uv_tcp_t *listener, int *socket, uint16_t *out_port, struct lw_error *err) {
    struct sockaddr_storage bound = {0};
    int length = sizeof bound, result = uv_tcp_open(listener, *socket);
    if (result == 0) *socket = -1;
    if (result == 0) result = uv_listen((uv_stream_t *)listener, BACKLOG, on_connection);
    if (result == 0) result = uv_tcp_getsockname(listener, (struct sockaddr *)&bound, &length);
    if (result < 0) return lw_status_fail(err, LW_OS, "cannot go on listening: %s", uv_strerror(result));
    *out_port = port_of(&bound);
    return LW_OK;
}

/* socket: of the server before, on which it goes on; NULL: there is none */
static enum lw_status start_listening(uv_tcp_t *listener, int *socket, const char *host, uint16_t port,
                                      const char *option, uint16_t *out_port, struct lw_error *err) {
    if (socket) return take_over(listener, socket, out_port, err);
    char address[ADDRESS_SIZE], service[8];
    format_address(address, host, port);
    snprintf(service, sizeof service, "%u", (unsigned)port);
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM, .ai_flags = AI_PASSIVE | AI_NUMERICSERV}, *found;
    int result = getaddrinfo(host, service, &hints, &found);
    if (result != 0)
        return lw_status_fail(err, LW_NO_HOST, "%s: cannot find the address to listen on: %s", address,
                              gai_strerror(result));
    result = uv_tcp_bind(listener, found->ai_addr, 0);
    freeaddrinfo(found);
    int receive_size = (int)LW_SERVER_RECEIVE_SIZE; /* connections have it from the listener */
    if (result == 0) result = uv_recv_buffer_size((uv_handle_t *)listener, &receive_size);
    if (result == 0) result = uv_listen((uv_stream_t *)listener, BACKLOG, on_connection);
    struct sockaddr_storage bound = {0};
    int length = sizeof bound;
    if (result == 0) result = uv_tcp_getsockname(listener, (struct sockaddr *)&bound, &length);
    if (result < 0) return listen_failure(err, address, option, result);
    *out_port = port_of(&bound);
    return LW_OK;
}

static int duplicate(const uv_tcp_t *listener) {
    uv_os_fd_t descriptor;
    if (uv_is_closing((const uv_handle_t *)listener) ||
        uv_fileno((const uv_handle_t *)listener, &descriptor) != 0)
        return -1;
    return fcntl(descriptor, F_DUPFD_CLOEXEC, 3);
}

enum lw_status lw_server_share_sockets(const struct lw_server *server, struct lw_server_sockets *out_sockets,
                                       struct lw_error *err) {
    struct lw_server_sockets sockets = {duplicate(&server->listener),
                                        server->http_port ? duplicate(&server->http_listener) : -1,
                                        server->metrics_port ? duplicate(&server->metrics_listener) : -1};
    if ((sockets.listen < 0 && !server->is_unix_only) || (server->http_port && sockets.http < 0) ||
        (server->metrics_port && sockets.metrics < 0)) {
        lw_server_sockets_close(&sockets);
        return lw_status_fail(err, LW_OS, "the sockets cannot be shared: %s", strerror(errno));
    }
    *out_sockets = sockets;
    return LW_OK;
}

void lw_server_sockets_close(struct lw_server_sockets *sockets) {
    int *const each[] = {&sockets->listen, &sockets->http, &sockets->metrics};
    for (size_t i = 0; i < sizeof each / sizeof *each; i++) {
        if (*each[i] >= 0) close(*each[i]);
        *each[i] = -1;
    }
}

static enum lw_status start_control(struct lw_server *server, const char *path, struct lw_error *err) {
    struct lw_error cause = {0};
    enum lw_status status = lw_control_socket_bind(&server->control_listener, path, server->port, &cause);
    const int result =
        status == LW_OK ? uv_listen((uv_stream_t *)&server->control_listener, BACKLOG, on_connection) : 0;
    if (result < 0) status = lw_status_fail(&cause, LW_OS, "%s: %s", path, uv_strerror(result));
    if (status == LW_OK) return LW_OK;
    close_handle((uv_handle_t *)&server->control_listener);
    if (strcmp(path, "auto") != 0)
        return lw_status_fail(err, status, "%s: %s",
                              server->is_unix_only ? "--listen-unix" : "--control-socket", cause.text);
    lw_log(LW_LOG_WARNING, "the scene changes by tokens alone: no Unix socket: %s", cause.text);
    return LW_OK;
}

static enum lw_status start_http(struct lw_server *server, const struct lw_server_desc *desc,
                                 struct lw_error *err) {
    const struct lw_web_server_desc web = {.loop = &server->loop,
                                           .sessions = &server->shared,
                                           .tls = server->tcp.tls,
                                           .root = desc->http_root,
                                           .host = desc->http_host,
                                           .hosts = desc->http_hosts,
                                           .origins = desc->http_origins,
                                           .servers = desc->web_servers};
    struct lw_error cause = {0};
    if (!desc->http_host || desc->is_unix_only || (desc->sockets && desc->sockets->http < 0)) return LW_OK;
    enum lw_status status =
        start_listening(&server->http_listener, desc->sockets ? &desc->sockets->http : NULL, desc->http_host,
                        desc->http_port, "--http", &server->http_port, &cause);
    if (status == LW_OK) status = lw_web_server_create(&web, &server->web, &cause);
    if (status == LW_OK) return LW_OK;
    server->http_port = 0;
    close_handle((uv_handle_t *)&server->http_listener);
    if (!desc->http_may_fail) return lw_status_fail(err, status, "%s", cause.text);
    lw_log(LW_LOG_WARNING, "browsers are not served: %s", cause.text);
    return LW_OK;
}

static enum lw_status start_metrics(struct lw_server *server, const struct lw_server_desc *desc,
                                    struct lw_error *err) {
    if (!desc->metrics_host || (desc->sockets && desc->sockets->metrics < 0)) return LW_OK;
    LW_INVARIANT(desc->hooks.page);
    const struct lw_web_server_desc web = {.loop = &server->loop,
                                           .sessions = &server->shared,
                                           .host = desc->metrics_host,
                                           .hosts = desc->http_hosts,
                                           .tls = desc->metrics_guarded ? server->tcp.tls : NULL,
                                           .wants_token = desc->metrics_guarded,
                                           .page = make_page,
                                           .page_context = server};
    enum lw_status status =
        start_listening(&server->metrics_listener, desc->sockets ? &desc->sockets->metrics : NULL,
                        desc->metrics_host, desc->metrics_port, "--metrics", &server->metrics_port, err);
    return status == LW_OK ? lw_web_server_create(&web, &server->metrics_web, err) : status;
}

static void on_top(uv_poll_t *handle, int status, int events) { (void)handle, (void)status, (void)events; }

/* Where libuv lacks memory for its table of descriptors, it aborts: that is made now, for as many as there
 * may be. A reload has two servers in one process. */
static void reserve_descriptors(struct lw_server *server) {
    struct rlimit limit;
    const int event = eventfd(0, EFD_CLOEXEC);
    int top = -1;
    if (event < 0) return;
    if (getrlimit(RLIMIT_NOFILE, &limit) == 0 && limit.rlim_cur > DESCRIPTORS_SPARED)
        top = fcntl(event, F_DUPFD_CLOEXEC, (int)(limit.rlim_cur - DESCRIPTORS_SPARED));
    close(event);
    if (top < 0) return;
    if (uv_poll_init(&server->loop, &server->top, top) < 0) {
        close(top);
        return;
    }
    server->top_fd = top;
    (void)uv_poll_start(&server->top, UV_READABLE, on_top);
    (void)uv_poll_stop(&server->top);
}

static enum lw_status init_handles(struct lw_server *server, struct lw_error *err) {
    int result = uv_loop_init(&server->loop);
    if (result < 0) return lw_status_fail(err, LW_OS, "cannot start an event loop: %s", uv_strerror(result));
    server->loop.data = server; /* says that there is a loop to close */
    if ((result = uv_tcp_init(&server->loop, &server->listener)) < 0 ||
        (result = uv_tcp_init(&server->loop, &server->http_listener)) < 0 ||
        (result = uv_tcp_init(&server->loop, &server->metrics_listener)) < 0 ||
        (result = uv_pipe_init(&server->loop, &server->control_listener, 0)) < 0 ||
        (result = uv_tcp_init(&server->loop, &server->spare)) < 0 ||
        (result = uv_async_init(&server->loop, &server->wake, on_wake)) < 0 ||
        (result = uv_timer_init(&server->loop, &server->tick)) < 0 ||
        (result = uv_timer_init(&server->loop, &server->lag)) < 0 ||
        (result = uv_timer_init(&server->loop, &server->beat)) < 0 ||
        (result = uv_prepare_init(&server->loop, &server->prepare)) < 0 ||
        (result = uv_check_init(&server->loop, &server->check)) < 0 ||
        (result = uv_idle_init(&server->loop, &server->busy)) < 0 ||
        (result = uv_signal_init(&server->loop, &server->interrupt)) < 0 ||
        (result = uv_signal_init(&server->loop, &server->terminate)) < 0 ||
        (result = uv_signal_init(&server->loop, &server->hangup)) < 0)
        return lw_status_fail(err, LW_OS, "cannot start an event loop: %s", uv_strerror(result));
    server->listener.data = server->http_listener.data = server->metrics_listener.data = server;
    server->control_listener.data = server->spare.data = server;
    server->wake.data = server->tick.data = server->lag.data = server->beat.data = server;
    server->prepare.data = server->check.data = server->busy.data = server;
    server->interrupt.data = server->terminate.data = server->hangup.data = server;
    reserve_descriptors(server);
    return LW_OK;
}

static void wake_loop(void *context) {
    struct lw_server *server = context;
    uv_async_send(&server->wake);
}

static enum lw_status init_channel(struct lw_server *server, const struct lw_server_desc *desc,
                                   uint32_t number) {
    struct lw_session_channel *channel = &server->shared.channel[number];
    const uint32_t tiles = desc->atlas_map->tile_count;
    const struct lw_tile_channel *is = lw_tile_channel_at(number);
    channel->number = number;
    channel->changed = malloc((tiles ? tiles : 1) * sizeof *channel->changed);
    enum lw_status status = channel->changed ? LW_OK : LW_NO_MEMORY;
    if (status == LW_OK && (desc->features & LW_FEATURE_DCT))
        status = lw_transcoder_create(is, desc->atlas_map, wake_loop, server, &channel->transcoder);
    channel->has_coarse = channel->transcoder && !desc->relay;
    if (status == LW_OK) status = lw_deltas_init(&channel->deltas, tiles, channel->transcoder);
    return status == LW_OK ? lw_priority_init(&channel->priority, desc->atlas_map) : status;
}

static void finish_channel(struct lw_session_channel *channel) {
    lw_snapshot_unref(channel->snapshot);
    lw_deltas_finish(&channel->deltas);
    lw_priority_finish(&channel->priority);
    free(channel->changed);
}

static bool any_bit(const uint8_t *bits, size_t size) {
    for (size_t i = 0; i < size; i++)
        if (bits[i]) return true;
    return false;
}

/* The split form of light is served where clients may draw any. */
static enum lw_status init_channels(struct lw_server *server, const struct lw_server_desc *desc) {
    struct lw_message_welcome *welcome = &server->shared.welcome;
    uint32_t *served = &server->shared.channels_served;
    *served = desc->channels | lw_light_form_bit(LW_LIGHT_FORM_FULL);
    if (any_bit(desc->client_lights, desc->client_lights_size) ||
        any_bit(desc->client_materials, desc->client_materials_size)) {
        *served |= lw_light_form_bit(LW_LIGHT_FORM_SPLIT);
        if (*served >> LW_TILE_CHANNEL_DIRECTION & 1) *served |= 1u << LW_TILE_CHANNEL_DIRECTION_SPLIT;
        welcome->client_lights = desc->client_lights;
        welcome->client_lights_size = desc->client_lights_size;
        welcome->client_materials = desc->client_materials;
        welcome->client_materials_size = desc->client_materials_size;
    }
    enum lw_status status = LW_OK;
    for (uint32_t c = 0; status == LW_OK && c < LW_TILE_CHANNELS_MAX; c++)
        if (*served >> c & 1) status = init_channel(server, desc, c);
    return status;
}

static uint64_t timeout_ns(unsigned ms, unsigned default_s) {
    return 1000000ull * (ms ? ms : 1000 * default_s);
}

static enum lw_status init_shared(struct lw_server *server, const struct lw_server_desc *desc) {
    struct lw_session_shared *shared = &server->shared;
    shared->atlas_map = desc->atlas_map;
    shared->scene = desc->scene;
    shared->first_light = desc->first_light;
    shared->epoch = 1;
    shared->sessions_max = desc->sessions_max ? desc->sessions_max : LW_SERVER_SESSIONS_MAX;
    shared->address_sessions_max = desc->address_sessions_max;
    shared->parse.budget = LW_SERVER_PARSE_MAX;
    shared->on_open = on_session_opened;
    shared->ask = on_ask;
    shared->on_close = on_session_closed;
    shared->server = server;
    server->tcp.sessions = shared;
    shared->rate_limit_bytes_hz = desc->rate_limit_bytes_hz;
    shared->web_servers = desc->web_servers;
    shared->retry_after_ms = desc->retry_after_ms;
    shared->hello_timeout_ns = timeout_ns(desc->hello_timeout_ms, LW_SERVER_HELLO_TIMEOUT_S);
    shared->stall_timeout_ns = timeout_ns(desc->stall_timeout_ms, LW_SERVER_STALL_TIMEOUT_S);
    shared->excess_timeout_ns = timeout_ns(desc->excess_timeout_ms, LW_SERVER_EXCESS_TIMEOUT_S);
    shared->package_timeout_ns = timeout_ns(desc->package_timeout_ms, LW_SERVER_PACKAGE_TIMEOUT_S);
    shared->silence_timeout_ns = timeout_ns(desc->silence_timeout_ms, LW_SERVER_SILENCE_S);
    shared->welcome = (struct lw_message_welcome){.version = LW_WIRE_VERSION,
                                                  .features = desc->features,
                                                  .name = desc->name ? desc->name : "lightwelld " LW_VERSION,
                                                  .run = desc->run,
                                                  .servers = desc->servers,
                                                  .bounces = desc->bounces,
                                                  .target_error = desc->target_error,
                                                  .noise_shown = desc->noise_shown};
    if (!desc->run &&
        getrandom(&shared->welcome.run, sizeof shared->welcome.run, 0) != (ssize_t)sizeof shared->welcome.run)
        shared->welcome.run = 0; /* then nobody takes up where another run ended */
    LW_INVARIANT(desc->relays_above_count < LW_MESSAGE_RELAYS_MAX);
    shared->is_relay = desc->relay != 0;
    if (shared->is_relay) shared->relays[shared->relay_count++] = desc->relay;
    for (uint32_t i = 0; shared->is_relay && i < desc->relays_above_count; i++)
        shared->relays[shared->relay_count++] = desc->relays_above[i];
    uint32_t tiles = desc->atlas_map->tile_count;
    enum lw_status status = make_order(desc->atlas_map, &server->order, &shared->first_tiles);
    if (status == LW_OK && !(shared->listed = calloc(tiles / 64 + 1, sizeof *shared->listed)))
        status = LW_NO_MEMORY;
    if (status == LW_OK) status = lw_interest_union_init(&shared->interest_union, desc->atlas_map);
    if (status == LW_OK) status = lw_relay_tree_init(&shared->tree);
    if (status == LW_OK) status = lw_fine_names_init(&shared->fine, desc->atlas_map);
    if (status == LW_OK) status = init_channels(server, desc);
    if (status == LW_OK && shared->scene) status = lw_scene_roster_init(&shared->roster, shared->scene);
    shared->order = server->order;
    return status;
}

static void compress_packages(void *user) {
    struct lw_server *server = user;
    struct packer *p = &server->packer;
    p->status = compress_package(&server->shared, p->package, p->package_size);
    if (p->status == LW_OK) p->status = compress_finishes(&server->shared, p->finishes, p->finishes_size);
}

static void start_packer(struct lw_server *server, const struct lw_server_desc *desc) {
    server->packer = (struct packer){.package = desc->package,
                                     .package_size = desc->package_size,
                                     .finishes = desc->finishes,
                                     .finishes_size = desc->finishes_size};
    server->packer.runs = uv_thread_create(&server->packer.thread, compress_packages, server) == 0;
    if (!server->packer.runs) compress_packages(server);
}

static enum lw_status await_packages(struct lw_server *server) {
    if (server->packer.runs) uv_thread_join(&server->packer.thread);
    server->packer.runs = false;
    return server->packer.status;
}

/* One that follows another watches before that one ends: its watchers would leave a gap. */
static enum lw_status watch_signals(struct lw_server *server, struct lw_error *err) {
    int result = uv_signal_start(&server->interrupt, on_signal, SIGINT);
    if (result == 0) result = uv_signal_start(&server->terminate, on_signal, SIGTERM);
    if (result == 0 && server->hooks.reload) result = uv_signal_start(&server->hangup, on_hangup, SIGHUP);
    return result == 0 ? LW_OK : lw_status_fail(err, LW_OS, "cannot watch signals: %s", uv_strerror(result));
}

/* Every session is a descriptor. Failing to get more of them is no failure: accept() will say so when they
 * run out. More than these are of no use, and libwebsockets keeps a table of as many as there may be. */
static void set_descriptor_limit(void) {
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
    limit.rlim_cur = limit.rlim_max < DESCRIPTORS_MAX ? limit.rlim_max : DESCRIPTORS_MAX;
    (void)setrlimit(RLIMIT_NOFILE, &limit);
}

enum lw_status lw_server_create(const struct lw_server_desc *desc, struct lw_server **out_server,
                                struct lw_error *err) {
    LW_INVARIANT(desc->package_size > 0);
    struct lw_server *server = calloc(1, sizeof *server);
    if (!server || uv_mutex_init(&server->mutex) < 0) goto no_mutex;
    if (uv_mutex_init(&server->shared.stats_mutex) < 0) goto no_stats;
    if (lw_updates_init(&server->shared.updates) != LW_OK) goto no_updates;
    if (lw_passed_updates_init(&server->shared.passed) != LW_OK) goto no_passed;
    if (getrandom(&server->shared.places.seed, sizeof server->shared.places.seed, 0) < 0)
        server->shared.places.seed = 1;
    server->shared.turned_away.seed = server->shared.places.seed;
    server->shared.log.seed = server->shared.connecting.seed = server->shared.places.seed;
    server->hooks = desc->hooks;
    server->is_unix_only = desc->is_unix_only;
    server->has_terminal = isatty(STDERR_FILENO);
    set_descriptor_limit();
    enum lw_status status = init_handles(server, err);
    if (status == LW_OK) status = read_tokens(server, desc, err);
    if (status == LW_OK) status = read_certificate(server, desc, err);
    init_endpoints(server);
    if (status == LW_OK && !desc->is_unix_only)
        status = start_listening(&server->listener, desc->sockets ? &desc->sockets->listen : NULL,
                                 desc->host ? desc->host : "127.0.0.1", desc->port, "--listen", &server->port,
                                 err);
    if (status == LW_OK && desc->control_socket && desc->sockets)
        status = (server->control_path = strdup(desc->control_socket))
                     ? LW_OK
                     : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    else if (status == LW_OK && desc->control_socket)
        status = start_control(server, desc->control_socket, err);
    if (status == LW_OK) status = start_http(server, desc, err);
    if (status == LW_OK) status = start_metrics(server, desc, err);
    if (status == LW_OK && (status = init_shared(server, desc)) != LW_OK)
        lw_status_fail(err, status, "cannot create the server: %s", lw_status_text(status));
    if (status == LW_OK && desc->sockets) status = watch_signals(server, err);
    if (status != LW_OK) {
        lw_server_destroy(server);
        return status;
    }
    start_packer(server, desc); /* last: nothing else is written meanwhile */
    *out_server = server;
    return LW_OK;
no_passed:
    lw_updates_finish(&server->shared.updates);
no_updates:
    uv_mutex_destroy(&server->shared.stats_mutex);
no_stats:
    uv_mutex_destroy(&server->mutex);
no_mutex:
    free(server);
    return lw_status_fail(err, LW_NO_MEMORY, "cannot create the server: out of memory");
}

uint16_t lw_server_port(const struct lw_server *server) { return server->port; }
uint16_t lw_server_http_port(const struct lw_server *server) { return server->http_port; }
uint16_t lw_server_metrics_port(const struct lw_server *server) { return server->metrics_port; }

bool lw_server_was_signalled(const struct lw_server *server) { return server->signalled; }

enum lw_status lw_server_run(struct lw_server *server, struct lw_error *err) {
    lw_slices_ask_for_short();
    signal(SIGPIPE, SIG_IGN); /* libuv writes to closed sockets without asking for silence */
    enum lw_status status = await_packages(server);
    if (status != LW_OK)
        return lw_status_fail(err, status, "cannot prepare the scene package for clients: %s",
                              lw_status_text(status));
    status = watch_signals(server, err);
    if (status != LW_OK) return status;
    struct lw_error cause = {0};
    if (server->control_path && (status = start_control(server, server->control_path, &cause)) != LW_OK) {
        if (server->is_unix_only) return lw_status_fail(err, status, "%s", cause.text);
        lw_log(LW_LOG_WARNING, "%s", cause.text);
    }
    uv_prepare_start(&server->prepare, on_prepare);
    uv_check_start(&server->check, on_check);
    if (server->hooks.beat) uv_timer_start(&server->beat, on_beat, 0, server->hooks.beat_ms);
    uv_mutex_lock(&server->mutex);
    server->runs = pthread_getcpuclockid(pthread_self(), &server->cpu_clock) == 0;
    uv_mutex_unlock(&server->mutex);
    uv_run(&server->loop, UV_RUN_DEFAULT);
    uv_mutex_lock(&server->mutex);
    server->runs = false;
    uv_mutex_unlock(&server->mutex);
    return LW_OK;
}

void lw_server_publish(struct lw_server *server, struct lw_snapshot *snapshot) {
    lw_snapshot_ref(snapshot);
    uv_mutex_lock(&server->mutex);
    struct lw_snapshot *unseen = server->latest;
    LW_INVARIANT(!unseen || snapshot->frame >= unseen->frame);
    server->latest = snapshot;
    uv_mutex_unlock(&server->mutex);
    lw_snapshot_unref(unseen); /* freeing can take long: not under the lock */
    uv_async_send(&server->wake);
}

bool lw_server_set_outside(struct lw_server *server, uint32_t channels, bool everything, const uint32_t *tile,
                           size_t tile_count) {
    struct outside next = {.channels = channels, .everything = everything};
    if (!everything && tile_count) {
        if (!(next.tile = malloc(tile_count * sizeof *next.tile))) return false;
        memcpy(next.tile, tile, tile_count * sizeof *next.tile);
        next.tile_count = tile_count;
    }
    uv_mutex_lock(&server->mutex);
    uint32_t *unseen = server->next_outside.tile;
    server->next_outside = next;
    server->has_next_outside = true;
    uv_mutex_unlock(&server->mutex);
    free(unseen);
    uv_async_send(&server->wake);
    return true;
}

static struct lw_blob **ref_chunks(const struct lw_session_package *package) {
    struct lw_blob **chunk = malloc(((size_t)package->chunk_count + 1) * sizeof(struct lw_blob *));
    for (uint32_t i = 0; chunk && i < package->chunk_count; i++)
        chunk[i] = lw_blob_ref(package->chunk[i].blob);
    return chunk;
}

enum lw_status lw_server_get_scene(struct lw_server *server, struct lw_server_scene *out_scene) {
    const struct lw_session_shared *shared = &server->shared;
    enum lw_status status = await_packages(server);
    if (status != LW_OK) return status;
    struct lw_server_scene scene = {.run = shared->welcome.run};
    struct lw_message message = {.type = LW_MESSAGE_WELCOME, .welcome = shared->welcome};
    struct lw_message_welcome *w = &message.welcome;
    w->session = 1;
    w->servers = NULL; /* each has a list of its own */
    w->features |= LW_FEATURE_RESUME | (w->finish.size ? LW_FEATURE_MATERIALS : 0) |
                   (shared->channels_served >> LW_LIGHT_FORM_SPLIT & 1 ? LW_FEATURE_DRAWS : 0);
    status = lw_blob_from_message(&message, &scene.welcome);
    if (status != LW_OK) return status;
    scene.chunk = ref_chunks(&shared->package);
    scene.finish_chunk = ref_chunks(&shared->finishes);
    scene.chunk_count = scene.chunk ? shared->package.chunk_count : 0;
    scene.finish_chunk_count = scene.finish_chunk ? shared->finishes.chunk_count : 0;
    if (!scene.chunk || !scene.finish_chunk) {
        lw_server_scene_finish(&scene);
        return LW_NO_MEMORY;
    }
    *out_scene = scene;
    return LW_OK;
}

void lw_server_scene_finish(struct lw_server_scene *scene) {
    for (uint32_t i = 0; i < scene->chunk_count; i++) lw_blob_unref(scene->chunk[i]);
    for (uint32_t i = 0; i < scene->finish_chunk_count; i++) lw_blob_unref(scene->finish_chunk[i]);
    lw_blob_unref(scene->welcome);
    free(scene->chunk);
    free(scene->finish_chunk);
    *scene = (struct lw_server_scene){0};
}

void lw_server_stop(struct lw_server *server) {
    uv_mutex_lock(&server->mutex);
    server->stop_requested = true;
    uv_mutex_unlock(&server->mutex);
    uv_async_send(&server->wake);
}

void lw_server_relay(struct lw_server *server) {
    uv_mutex_lock(&server->mutex);
    server->relay_requested = true;
    uv_mutex_unlock(&server->mutex);
    lw_server_stop(server);
}

void lw_server_get_stats(const struct lw_server *server, struct lw_server_stats *out_stats) {
    uv_mutex_t *own = (uv_mutex_t *)&server->mutex;
    uv_mutex_t *mutex = (uv_mutex_t *)&server->shared.stats_mutex; /* locking leaves the server as it was */
    uv_mutex_lock(mutex);
    *out_stats = server->shared.stats;
    uv_mutex_unlock(mutex);
    uv_mutex_lock(own);
    out_stats->loop_cpu_ns = server->runs ? lw_clock_read_ns(server->cpu_clock) : 0;
    uv_mutex_unlock(own);
}

/* Ours alone: libwebsockets closes its own. */
static void close_handles(struct lw_server *server) {
    uv_handle_t *const handles[] = {
        (uv_handle_t *)&server->listener,      (uv_handle_t *)&server->control_listener,
        (uv_handle_t *)&server->http_listener, (uv_handle_t *)&server->metrics_listener,
        (uv_handle_t *)&server->spare,         (uv_handle_t *)&server->wake,
        (uv_handle_t *)&server->prepare,       (uv_handle_t *)&server->check,
        (uv_handle_t *)&server->busy,          (uv_handle_t *)&server->tick,
        (uv_handle_t *)&server->lag,           (uv_handle_t *)&server->beat,
        (uv_handle_t *)&server->interrupt,     (uv_handle_t *)&server->terminate,
        (uv_handle_t *)&server->hangup};
    for (size_t i = 0; i < sizeof handles / sizeof *handles; i++) close_handle(handles[i]);
    if (server->top_fd) close_handle((uv_handle_t *)&server->top);
}

/* Until all handles are closed. False: libwebsockets has lost one, as without memory it may. */
static bool run_to_the_end(uv_loop_t *loop) {
    const uint64_t limit_ns = lw_clock_ns() + END_MS * 1000000ull;
    while (uv_run(loop, UV_RUN_NOWAIT) != 0) {
        if (lw_clock_ns() > limit_ns) return false;
        usleep(1000);
    }
    return true;
}

void lw_server_destroy(struct lw_server *server) {
    if (!server) return;
    struct lw_session_shared *shared = &server->shared;
    (void)await_packages(server);
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) {
        lw_transcoder_destroy(shared->channel[f].transcoder); /* it wakes the loop, which goes now */
        shared->channel[f].transcoder = shared->channel[f].deltas.transcoder = NULL;
    }
    if (server->loop.data) {
        while (shared->first) lw_session_close(shared->first, "the server ends");
        lw_web_server_close(server->web);
        lw_web_server_close(server->metrics_web);
        close_handles(server);
        if (!run_to_the_end(&server->loop)) {
            lw_log(LW_LOG_WARNING, "some connection did not close: its memory stays");
            return; /* the rest of it stands in the loop, and so in here */
        }
        lw_web_server_destroy(server->web);
        lw_web_server_destroy(server->metrics_web);
        uv_loop_close(&server->loop);
        if (server->top_fd) close(server->top_fd);
    }
    lw_snapshot_unref(server->latest);
    lw_snapshot_unref(shared->snapshot);
    free_chunks(&shared->package);
    free_chunks(&shared->finishes);
    struct lw_message_package package = lw_message_welcome_package(&shared->welcome);
    free_parts(&package);
    free_parts(&shared->welcome.finish);
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) finish_channel(&shared->channel[f]);
    free(shared->listed);
    free(server->order);
    free_interest(&server->interest);
    free(server->outside.tile);
    free(server->next_outside.tile);
    lw_interest_union_finish(&shared->interest_union);
    lw_relay_tree_finish(&shared->tree);
    lw_fine_names_finish(&shared->fine);
    lw_updates_finish(&shared->updates);
    lw_passed_updates_finish(&shared->passed);
    lw_address_places_finish(&shared->places);
    lw_address_places_finish(&shared->turned_away);
    lw_message_memory_finish(&shared->parse);
    lw_scene_roster_finish(&shared->roster);
    lw_tokens_destroy(shared->tokens);
    lw_tls_context_destroy(server->tcp.tls);
    lw_tls_output_finish(&server->tcp.output);
    free(server->tokens_path);
    free(server->control_path);
    uv_mutex_destroy(&shared->stats_mutex);
    uv_mutex_destroy(&server->mutex);
    free(server);
}
