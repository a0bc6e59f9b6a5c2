#include "server/serve/server.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/base/log.h"
#include "common/base/slices.h"
#include "server/serve/server_handover.h"
#include "server/serve/server_listeners.h"
#include "server/serve/server_packages.h"
#include "server/serve/sessions/turns.h"

#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/random.h>
#include <sys/resource.h>
#include <unistd.h>

#define TICK_MS            (1000u / LW_SERVER_LOOKS_HZ)
#define LAG_MS             20u
#define END_MS             5000u    /* for handles to close */
#define TURN_NS            4000000u /* time of sending before the loop looks at other events */
#define DESCRIPTORS_SPARED 8u       /* the highest, of which a server takes one */
#define DESCRIPTORS_MAX    65536u

/* ---- the order of tiles ---- */

/* Levels count from fine to coarse and objects differ in their number of levels: each object's
 * coarsest level goes first, then each one's next finer, down to level 0. Finer levels come last. */
static enum lw_status make_order(const struct lw_atlas_map *map, uint32_t **out_order,
                                 uint32_t *out_coarsest) {
    uint32_t *order = malloc((map->tile_count ? map->tile_count : 1) * sizeof *order), filled = 0;
    if (!order) return LW_NO_MEMORY;
    for (uint32_t above = 0; above < LW_ATLAS_LEVELS_MAX; above++)
        for (uint32_t o = 0; o < map->object_count; o++) {
            const struct lw_atlas *atlas = map->atlas[o];
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

static void on_busy(uv_idle_t *handle) { (void)handle; }

/* Sessions are due, or connections are held, when the loop would wait: it must not. */
static void keep_busy(struct lw_server *server) {
    if (lw_turns_any_due(&server->shared) || lw_server_listeners_any_held(server))
        uv_idle_start(&server->busy, on_busy);
    else
        uv_idle_stop(&server->busy);
}

static void on_prepare(uv_prepare_t *handle) {
    lw_server_handover_interest(handle->data);
    lw_server_handover_wake_relay(handle->data);
    keep_busy(handle->data);
}

/* A snapshot for a thousand sessions takes longer to hand out than a newcomer, or an UPDATE, should wait. */
static void on_check(uv_check_t *handle) {
    struct lw_server *server = handle->data;
    server->tcp.turn++;
    lw_turns_read_on(&server->shared);
    lw_server_listeners_take_held(server);
    lw_turns_serve_due(&server->shared, lw_clock_ns() + TURN_NS);
}

/* ---- the end ---- */

static void stop_when_empty(struct lw_server *server) {
    if (server->stopping && !server->shared.first) uv_stop(&server->loop);
}

/* Sums since the start, for lw_server_get_stats(). */
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
    lw_server_close_handle((uv_handle_t *)&server->listener);
    lw_server_close_handle((uv_handle_t *)&server->control_listener);
    lw_server_close_handle((uv_handle_t *)&server->http_listener);
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

static void on_wake(uv_async_t *handle) {
    if (lw_server_handover_take(handle->data)) begin_stop(handle->data, false);
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

/* Answers a question over the control socket. */
static enum lw_report_code on_ask(void *context, const struct lw_message_ask *ask, char **out_text,
                                  size_t *out_size) {
    struct lw_server *server = context;
    struct lw_server_page page = {0};
    switch (ask->what) {
    case LW_ASK_STATS:
        if (!server->hooks.page || !lw_server_listeners_page(server, "/metrics", &page))
            return LW_REPORT_UNKNOWN;
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
    struct lw_session_channel *channel = &server->shared.channels.at[number];
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

/* Split irradiance is served where clients may draw any. */
static enum lw_status init_channels(struct lw_server *server, const struct lw_server_desc *desc) {
    struct lw_message_welcome *welcome = &server->shared.welcome;
    uint32_t *served = &server->shared.channels.served;
    *served = desc->channels | lw_tile_channel_bit(LW_TILE_CHANNEL_FULL);
    if (any_bit(desc->client_lights, desc->client_lights_size) ||
        any_bit(desc->client_materials, desc->client_materials_size)) {
        *served |= lw_tile_channel_bit(LW_TILE_CHANNEL_SPLIT);
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
    shared->limits.sessions_max = desc->sessions_max ? desc->sessions_max : LW_SERVER_SESSIONS_MAX;
    shared->limits.address_sessions_max = desc->address_sessions_max;
    shared->parse.budget = LW_SERVER_PARSE_MAX;
    shared->on_open = on_session_opened;
    shared->ask = on_ask;
    shared->on_close = on_session_closed;
    shared->server = server;
    server->tcp.sessions = shared;
    shared->limits.rate_limit_bytes_hz = desc->rate_limit_bytes_hz;
    shared->web_servers = desc->web_servers;
    shared->retry_after_ms = desc->retry_after_ms;
    shared->limits.hello_timeout_ns = timeout_ns(desc->hello_timeout_ms, LW_SERVER_HELLO_TIMEOUT_S);
    shared->limits.stall_timeout_ns = timeout_ns(desc->stall_timeout_ms, LW_SERVER_STALL_TIMEOUT_S);
    shared->limits.excess_timeout_ns = timeout_ns(desc->excess_timeout_ms, LW_SERVER_EXCESS_TIMEOUT_S);
    shared->limits.package_timeout_ns = timeout_ns(desc->package_timeout_ms, LW_SERVER_PACKAGE_TIMEOUT_S);
    shared->limits.silence_timeout_ns = timeout_ns(desc->silence_timeout_ms, LW_SERVER_SILENCE_S);
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
    lw_server_listeners_init(server);
    if (status == LW_OK) status = lw_server_listeners_open(server, desc, err);
    if (status == LW_OK && (status = init_shared(server, desc)) != LW_OK)
        lw_status_fail(err, status, "cannot create the server: %s", lw_status_text(status));
    if (status == LW_OK && desc->sockets) status = watch_signals(server, err);
    if (status != LW_OK) {
        lw_server_destroy(server);
        return status;
    }
    lw_server_packages_start(server, desc); /* last: nothing else is written meanwhile */
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
    enum lw_status status = lw_server_packages_await(server);
    if (status != LW_OK)
        return lw_status_fail(err, status, "cannot prepare the scene package for clients: %s",
                              lw_status_text(status));
    status = watch_signals(server, err);
    if (status != LW_OK) return status;
    struct lw_error cause = {0};
    if (server->control_path &&
        (status = lw_server_listeners_open_control(server, server->control_path, &cause)) != LW_OK) {
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

static struct lw_blob **ref_chunks(const struct lw_session_package *package) {
    struct lw_blob **chunk = malloc(((size_t)package->chunk_count + 1) * sizeof(struct lw_blob *));
    for (uint32_t i = 0; chunk && i < package->chunk_count; i++)
        chunk[i] = lw_blob_ref(package->chunk[i].blob);
    return chunk;
}

enum lw_status lw_server_get_scene(struct lw_server *server, struct lw_server_scene *out_scene) {
    const struct lw_session_shared *shared = &server->shared;
    enum lw_status status = lw_server_packages_await(server);
    if (status != LW_OK) return status;
    struct lw_server_scene scene = {.run = shared->welcome.run, .channels = shared->channels.served};
    struct lw_message message = {.type = LW_MESSAGE_WELCOME, .welcome = shared->welcome};
    struct lw_message_welcome *w = &message.welcome;
    w->session = 1;
    w->servers = NULL; /* each has a list of its own */
    w->features |= LW_FEATURE_RESUME | LW_FEATURE_TREE | (w->finish.size ? LW_FEATURE_MATERIALS : 0) |
                   lw_tile_channels_features(shared->channels.served);
    w->finer = shared->atlas_map->finer_count;
    if (w->finer) w->features |= LW_FEATURE_FINER;
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
    for (size_t i = 0; i < sizeof handles / sizeof *handles; i++) lw_server_close_handle(handles[i]);
    if (server->top_fd) lw_server_close_handle((uv_handle_t *)&server->top);
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
    (void)!lw_server_packages_await(server);
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) {
        lw_transcoder_destroy(shared->channels.at[f].transcoder); /* it wakes the loop, which goes now */
        shared->channels.at[f].transcoder = shared->channels.at[f].deltas.transcoder = NULL;
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
    lw_server_handover_finish(server);
    lw_snapshot_unref(shared->snapshot);
    lw_server_packages_finish(shared);
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) finish_channel(&shared->channels.at[f]);
    free(shared->listed);
    free(server->order);
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
