#include "client/lib/live_error.h"
#include "client/lib/live_scene.h"
#include "client/lib/live_state.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/tile/tile_channels.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#define PORT_DEFAULT      7780u
#define BUDGET_DEFAULT_US 2000u
#define HOLD_NS           500000u /* the thread takes messages in for this long before others have a turn */
#define WAIT_MS           100u    /* the thread reads the views at least that often */

/* ---- statuses ---- */

static const char *const status_text[] = {
    "success",
    "wrong call",
    "malformed data, or another scene",
    "host name unknown",
    "service unavailable",
    "internal error",
    "out of memory",
    "system error",
    "timed out",
    "protocol error",
    "connection closed",
    "the scene has not arrived yet",
    "not allowed",
    "another scene is lit now",
};

const char *lw_live_status_text(enum lw_live_status status) {
    return (unsigned)status < sizeof status_text / sizeof *status_text ? status_text[status]
                                                                       : "unknown status";
}

const char *lw_live_version(void) { return LW_VERSION; }

static enum lw_status init_lock(struct lw_live *live) {
    pthread_condattr_t attributes;
    if (pthread_mutex_init(&live->turn, NULL) || pthread_mutex_init(&live->data, NULL) ||
        pthread_condattr_init(&attributes))
        return LW_NO_MEMORY;
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    const int failure = pthread_cond_init(&live->news, &attributes);
    pthread_condattr_destroy(&attributes);
    return failure ? LW_NO_MEMORY : LW_OK;
}

/* ---- what the client calls ---- */

/* Others find no scene until it is ready, and need not wait for that. */
static enum lw_status take_scene(void *context, const struct lw_client *client, struct lw_error *err) {
    struct lw_live *live = context;
    const struct lw_scene *scene = lw_client_scene(client);
    LW_INVARIANT(!live->scene && !live->other_scene);
    lw_live_unlock(live);
    const bool as_it_is = live->flags & LW_LIVE_AS_IT_IS;
    enum lw_status status = lw_live_tiles_init(&live->tiles, client, as_it_is, live->finer_slots);
    if (status == LW_OK) status = lw_live_slots_init(&live->slots, &live->tiles, live->finer_slots);
    if (status == LW_OK) status = lw_live_interest_init(&live->interest, client, live->finer_slots, as_it_is);
    if (status == LW_OK) status = lw_live_scene_init(live, scene);
    lw_live_lock(live);
    if (status != LW_OK) return lw_status_fail(err, status, "%s", lw_status_text(status));
    live->scene = scene;
    live->interest.has_changed = true;
    return LW_OK;
}

static void take_tile(void *context, lw_tile_id tile) {
    lw_live_tiles_mark(&((struct lw_live *)context)->tiles, tile);
}

static void leave(void *context) { lw_live_unlock(context); }
static void enter(void *context) { lw_live_lock(context); }

static void rouse(const struct lw_live *live) {
    const uint64_t one = 1;
    if (live->has_thread) (void)!write(live->wake, &one, sizeof one);
}

static bool wait_for(void *context, int descriptor, bool for_writing, uint64_t deadline_ns) {
    struct lw_live *live = context;
    if (!live->has_thread) { /* the welcome of the first session, on the caller's thread */
        struct pollfd one = {descriptor, (short)(POLLIN | (for_writing ? POLLOUT : 0)), 0};
        const uint64_t now_ns = lw_clock_ns();
        (void)poll(&one, 1, now_ns < deadline_ns ? (int)((deadline_ns - now_ns) / 1000000 + 1) : 0);
        return true;
    }
    struct pollfd wait[2] = {{descriptor, (short)(POLLIN | (for_writing ? POLLOUT : 0)), 0},
                             {live->wake, POLLIN, 0}};
    const uint64_t now_ns = lw_clock_ns();
    lw_live_unlock(live);
    (void)poll(wait, 2, now_ns < deadline_ns ? (int)((deadline_ns - now_ns) / 1000000 + 1) : 0);
    uint64_t count;
    if (wait[1].revents && !atomic_load(&live->stops)) (void)!read(live->wake, &count, sizeof count);
    lw_live_lock(live);
    return !atomic_load(&live->stops);
}

/* ---- another scene ---- */

/* With the lock. Everything known of the scene that is over is over, too. */
static void forget_scene(struct lw_live *live) {
    live->scene = NULL;
    live->other_scene = false;
    live->answer = (struct lw_client_answer){0};
    lw_live_slots_finish(&live->slots);
    lw_live_tiles_finish(&live->tiles);
    lw_live_interest_finish(&live->interest);
    lw_live_scene_finish(live);
    lw_client_forget_scene(live->client);
}

static enum lw_live_status report_other_scene(struct lw_live *live, struct lw_live_error *err) {
    forget_scene(live);
    return lw_live_fail(err, LW_LIVE_OTHER_SCENE, "the server lights another scene now");
}

/* ---- the thread ---- */

/* Whether connecting again may help. */
static bool is_passing(enum lw_status status) {
    return status == LW_CLOSED || status == LW_TIMED_OUT || status == LW_UNAVAILABLE ||
           status == LW_NO_HOST || status == LW_OS;
}

static enum lw_status connect_again(struct lw_live *live, unsigned attempt, struct lw_error *err) {
    const uint32_t seed = (uint32_t)((uintptr_t)live >> 4) ^ (uint32_t)getpid();
    const unsigned wait_ms = lw_client_return_ms(lw_client_retry_after_ms(live->client), attempt, seed);
    if (!wait_for(live, -1, false, lw_clock_ns() + wait_ms * 1000000ull)) return LW_OK;
    enum lw_status status = lw_client_reconnect(live->client, err);
    live->is_connected = status == LW_OK;
    live->sessions += status == LW_OK;
    return status;
}

static enum lw_status take_in(struct lw_live *live, struct lw_error *err) {
    struct lw_client_stats before, after;
    enum lw_status status = lw_live_interest_update(&live->interest, live->client, lw_clock_ns());
    if (status != LW_OK) return lw_status_fail(err, status, "out of memory");
    lw_client_get_stats(live->client, &before);
    status = lw_client_poll(live->client, WAIT_MS, err);
    lw_client_get_stats(live->client, &after);
    live->is_connected = status == LW_OK;
    LW_INVARIANT(after.bytes >= before.bytes && after.tiles >= before.tiles);
    if (after.bytes == before.bytes) return status;
    live->taken++;
    pthread_cond_broadcast(&live->news);
    return status;
}

static void *run(void *context) {
    struct lw_live *live = context;
    unsigned attempt = 0;
    lw_live_lock(live);
    while (!atomic_load(&live->stops)) {
        struct lw_error err = {0};
        if (live->other_scene) { /* the caller may be reading the one before */
            attempt = 0;
            (void)wait_for(live, -1, false, lw_clock_ns() + WAIT_MS * 1000000ull);
            continue;
        }
        enum lw_status status =
            live->is_connected ? take_in(live, &err) : connect_again(live, attempt++, &err);
        if (live->is_connected) attempt = 0;
        if (status != LW_OK && lw_client_found_other_scene(live->client)) {
            live->other_scene = true;
            pthread_cond_broadcast(&live->news);
        } else if (status != LW_OK && !is_passing(status) && !atomic_load(&live->stops)) {
            live->ended = status;
            live->reason = err;
            pthread_cond_broadcast(&live->news);
            break;
        }
        lw_live_unlock(live);
        lw_live_lock(live);
    }
    lw_live_unlock(live);
    return NULL;
}

static enum lw_status start_thread(struct lw_live *live, struct lw_error *err) {
    live->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (live->wake < 0) return lw_status_fail(err, LW_OS, "cannot wake a thread: %s", strerror(errno));
    live->has_thread = true; /* it locks from its first line on */
    const int failure = pthread_create(&live->thread, NULL, run, live);
    if (!failure) return LW_OK;
    live->has_thread = false;
    return lw_status_fail(err, LW_OS, "cannot start a thread: %s", strerror(failure));
}

/* ---- open, poll, close ---- */

static enum lw_status open_client(struct lw_live *live, const struct lw_live_desc *desc,
                                  struct lw_error *err) {
    const bool has_thread = desc->flags & LW_LIVE_THREAD;
    struct lw_access access = {.has_token = desc->token != NULL,
                               .tls = {.wanted = desc->flags & (LW_LIVE_TLS | LW_LIVE_TLS_INSECURE),
                                       .ca = desc->ca_file,
                                       .trusts_all = desc->flags & LW_LIVE_TLS_INSECURE}};
    if (desc->ca_file && (desc->flags & (LW_LIVE_TLS | LW_LIVE_TLS_INSECURE)) != LW_LIVE_TLS)
        return lw_status_fail(err, LW_USAGE, "lw_live_desc: ca_file goes with LW_LIVE_TLS alone");
    if (desc->token && !lw_token_parse(desc->token, strlen(desc->token), &access.token))
        return lw_status_fail(err, LW_USAGE, "lw_live_desc: token is not 64 hexadecimal digits");
    struct lw_client_desc client = {
        .host = desc->host ? desc->host : "127.0.0.1",
        .port = desc->port ? desc->port : PORT_DEFAULT,
        .access = &access,
        .name = desc->name,
        .timeout_ms = desc->timeout_ms,
        .cache_folder = desc->cache_folder,
        .wants_nothing = desc->flags & LW_LIVE_WANTS_NOTHING,
        .control = desc->flags & LW_LIVE_CONTROL,
        .draws_direct = desc->flags & LW_LIVE_DRAWS_DIRECT,
        .materials = desc->flags & LW_LIVE_MATERIALS,
        .channel_features = desc->flags & LW_LIVE_DIRECTIONS ? LW_TILE_CHANNELS_DIRECTION : 0,
        .finer = desc->finer_slots ? LW_ATLAS_FINER_MAX : 0,
        .rate_limit_bytes_hz = desc->rate_limit_bytes_per_s,
        .budget_ns = has_thread ? HOLD_NS : 1000ull * (desc->budget_us ? desc->budget_us : BUDGET_DEFAULT_US),
        .watch = {.context = live, .scene = take_scene, .tile = take_tile}};
    if (has_thread) {
        client.watch.wait = wait_for;
        client.watch.leave = leave;
        client.watch.enter = enter;
    }
    enum lw_status status = lw_client_create(&client, &live->client, err);
    if (status != LW_OK) return status;
    live->is_connected = true;
    live->sessions = 1;
    return has_thread ? start_thread(live, err) : LW_OK;
}

/* As it was before it had a token and ca_file, or finer_slots. */
static bool read_former_desc(struct lw_live_desc *dst, const struct lw_live_desc *src) {
    const size_t size = lw_live_struct_size(src);
    return (size == offsetof(struct lw_live_desc, token) ||
            size == offsetof(struct lw_live_desc, finer_slots)) &&
           lw_live_read_struct(dst, size, src);
}

enum lw_live_status lw_live_open(const struct lw_live_desc *desc, struct lw_live **out_live,
                                 struct lw_live_error *err) {
    struct lw_live_desc d = {0};
    const uint32_t flags = LW_LIVE_THREAD | LW_LIVE_WANTS_NOTHING | LW_LIVE_DRAWS_DIRECT | LW_LIVE_CONTROL |
                           LW_LIVE_AS_IT_IS | LW_LIVE_TLS | LW_LIVE_TLS_INSECURE | LW_LIVE_MATERIALS |
                           LW_LIVE_DIRECTIONS;
    if (!out_live) return lw_live_fail(err, LW_LIVE_USAGE, "out_live is NULL");
    if (!lw_live_read_struct(&d, sizeof d, desc) && !read_former_desc(&d, desc))
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_desc: struct_size is not sizeof desc");
    if (d.flags & ~flags)
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_desc: flags has 0x%x, which is unknown",
                            (unsigned)(d.flags & ~flags));
    if (d.finer_slots > LW_LIVE_SLOTS_MAX)
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_desc: finer_slots is %u: there may be %u",
                            d.finer_slots, LW_LIVE_SLOTS_MAX);
    struct lw_live *live = calloc(1, sizeof *live);
    if (!live) return lw_live_fail(err, LW_LIVE_NO_MEMORY, "out of memory");
    live->flags = d.flags;
    live->finer_slots = d.finer_slots;
    live->wake = -1;
    struct lw_error cause = {0};
    enum lw_status status = init_lock(live);
    if (status == LW_OK) status = open_client(live, &d, &cause);
    if (status == LW_OK)
        *out_live = live;
    else
        lw_live_close(live);
    return lw_live_pass(err, status, &cause);
}

void lw_live_close(struct lw_live *live) {
    if (!live) return;
    if (live->has_thread) {
        atomic_store(&live->stops, true);
        rouse(live);
        pthread_join(live->thread, NULL);
        live->has_thread = false;
    }
    lw_client_destroy(live->client);
    lw_live_slots_finish(&live->slots);
    lw_live_tiles_finish(&live->tiles);
    lw_live_interest_finish(&live->interest);
    lw_live_scene_finish(live);
    if (live->wake >= 0) close(live->wake);
    pthread_cond_destroy(&live->news);
    pthread_mutex_destroy(&live->data);
    pthread_mutex_destroy(&live->turn);
    free(live);
}

/* Until the thread has taken in something that the caller does not know of. */
static enum lw_live_status wait_for_news(struct lw_live *live, uint32_t timeout_ms,
                                         struct lw_live_error *err) {
    const uint64_t deadline_ns = lw_clock_ns() + timeout_ms * 1000000ull;
    const struct timespec deadline = {(time_t)(deadline_ns / 1000000000u), (long)(deadline_ns % 1000000000u)};
    lw_live_lock(live);
    while (timeout_ms && live->taken == live->reported && live->ended == LW_OK && !live->other_scene)
        if (pthread_cond_timedwait(&live->news, &live->data, &deadline)) break;
    LW_INVARIANT(live->reported <= live->taken);
    live->reported = live->taken;
    enum lw_live_status status =
        live->other_scene ? report_other_scene(live, err) : lw_live_pass(err, live->ended, &live->reason);
    if (status == LW_LIVE_OTHER_SCENE) rouse(live);
    lw_live_unlock(live);
    return status;
}

enum lw_live_status lw_live_poll(struct lw_live *live, uint32_t timeout_ms, struct lw_live_error *err) {
    if (!live) return lw_live_fail(err, LW_LIVE_USAGE, "live is NULL");
    if (live->has_thread) return wait_for_news(live, timeout_ms, err);
    struct lw_error cause = {0};
    enum lw_status status = lw_live_interest_update(&live->interest, live->client, lw_clock_ns());
    if (status == LW_OK) status = lw_client_poll(live->client, timeout_ms, &cause);
    live->is_connected = status == LW_OK;
    return lw_live_pass(err, status, &cause);
}

enum lw_live_status lw_live_reconnect(struct lw_live *live, struct lw_live_error *err) {
    if (!live) return lw_live_fail(err, LW_LIVE_USAGE, "live is NULL");
    if (live->has_thread)
        return lw_live_fail(err, LW_LIVE_USAGE, "with LW_LIVE_THREAD the library connects again by itself");
    struct lw_error cause = {0};
    enum lw_status status = lw_client_reconnect(live->client, &cause);
    live->is_connected = status == LW_OK;
    live->sessions += status == LW_OK;
    if (status != LW_OK && lw_client_found_other_scene(live->client)) return report_other_scene(live, err);
    return lw_live_pass(err, status, &cause);
}

uint32_t lw_live_backoff_ms(uint32_t attempt, uint32_t seed) { return lw_client_backoff_ms(attempt, seed); }

int lw_live_descriptor(const struct lw_live *live) {
    return !live || live->has_thread ? -1 : lw_client_descriptor(live->client);
}

enum lw_live_status lw_live_get_stats(const struct lw_live *live, struct lw_live_stats *out_stats,
                                      struct lw_live_error *err) {
    if (!live) return lw_live_fail(err, LW_LIVE_USAGE, "live is NULL");
    struct lw_client_stats s;
    lw_live_lock(live);
    lw_client_get_stats(live->client, &s);
    struct lw_live_stats stats = {.is_connected = live->is_connected,
                                  .has_scene = live->scene != NULL,
                                  .has_light = s.first_ns != 0,
                                  .package_progress = lw_client_package_progress(live->client),
                                  .frame = s.frame,
                                  .settled_frame = s.settled_frame,
                                  .time_s = s.time_s,
                                  .changed_frame = s.changed_frame,
                                  .session = live->sessions,
                                  .tiles = s.tiles,
                                  .bytes = s.bytes,
                                  .decode_ns = s.decode_ns,
                                  .light_age_ns = s.light_age_ns,
                                  .dirty_tiles = live->scene ? live->tiles.dirty_count : 0,
                                  .bounces = s.bounces,
                                  .target_error = s.target_error,
                                  .finishes = (enum lw_live_finishes)lw_client_finishes(live->client)};
    lw_live_unlock(live);
    if (lw_live_write_struct(out_stats, &stats, sizeof stats)) return LW_LIVE_OK;
    return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_stats: struct_size is not sizeof *out_stats");
}

_Static_assert((int)LW_LIVE_FINISHES_COMING == LW_CLIENT_FINISHES_COMING &&
                   (int)LW_LIVE_FINISHES_THERE == LW_CLIENT_FINISHES_THERE,
               "numbers are for ever");

_Static_assert((int)LW_LIVE_WAITING_PLACING_TEXELS == LW_WAITING_PLACING_TEXELS &&
                   (int)LW_LIVE_WAITING_LOOKING_INSIDE == LW_WAITING_LOOKING_INSIDE &&
                   (int)LW_LIVE_WAITING_FIRST_LIGHT == LW_WAITING_FIRST_LIGHT &&
                   (int)LW_LIVE_WAITING_READY == LW_WAITING_READY,
               "numbers of stages are for ever");

enum lw_live_waiting lw_live_get_waiting(const struct lw_live *live, float *out_share) {
    struct lw_waiting_state waiting = {LW_WAITING_UNKNOWN, 0};
    if (live) {
        lw_live_lock(live);
        waiting = lw_client_waiting(live->client);
        lw_live_unlock(live);
    }
    if (out_share) *out_share = waiting.share;
    return (enum lw_live_waiting)waiting.stage;
}

const char *lw_live_waiting_text(enum lw_live_waiting waiting) { return lw_waiting_text((uint32_t)waiting); }

/* ---- wanted views and rectangles ---- */

enum lw_live_status lw_live_want_views(struct lw_live *live, const struct lw_live_view *view, size_t count,
                                       struct lw_live_error *err) {
    struct lw_live_view views[LW_LIVE_VIEWS_MAX];
    if (!live || (count && !view)) return lw_live_fail(err, LW_LIVE_USAGE, "live or view is NULL");
    if (count > LW_LIVE_VIEWS_MAX)
        return lw_live_fail(err, LW_LIVE_USAGE, "%zu views: there may be %u", count, LW_LIVE_VIEWS_MAX);
    memset(views, 0, sizeof views); /* compared byte by byte */
    for (size_t i = 0; i < count; i++) {
        if (!lw_live_read_struct(&views[i], sizeof views[i],
                                 (const char *)view + i * lw_live_struct_size(view)))
            return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_view %zu: struct_size is not sizeof *view", i);
        if (!views[i].width || !views[i].height)
            return lw_live_fail(err, LW_LIVE_USAGE, "view %zu has no pixels", i);
        for (int k = 0; k < 16; k++)
            if (!isfinite(views[i].view_projection[k]))
                return lw_live_fail(err, LW_LIVE_USAGE, "view %zu: view_projection[%d] is not finite", i, k);
    }
    lw_live_lock(live);
    struct lw_live_interest *interest = &live->interest;
    const bool is_new = !interest->is_active || count != interest->view_count ||
                        memcmp(views, interest->view, sizeof views) != 0;
    memcpy(interest->view, views, sizeof views);
    interest->view_count = (uint32_t)count;
    interest->is_active = true;
    interest->has_changed |= is_new;
    LW_INVARIANT(lw_clock_ns() >= interest->looked_ns);
    if (is_new && lw_clock_ns() - interest->looked_ns >= LW_LIVE_INTEREST_NS) rouse(live);
    lw_live_unlock(live);
    return LW_LIVE_OK;
}

/* Columns and rows of tiles that a rectangle touches. */
struct touched {
    uint32_t x, y, end_x, end_y;
};

static struct touched touched_by(const struct lw_live_rect *rect) {
    return (struct touched){rect->x / LW_TILE_SIDE, rect->y / LW_TILE_SIDE,
                            (rect->x + rect->width + LW_TILE_SIDE - 1) / LW_TILE_SIDE,
                            (rect->y + rect->height + LW_TILE_SIDE - 1) / LW_TILE_SIDE};
}

/* Lists the tiles that a rectangle touches, as far as there is room; those of finer levels get ids. Returns
 * how many there are. */
static size_t list_tiles(const struct lw_atlas_map *map, const struct lw_live_rect *rect, lw_tile_id *tile,
                         size_t count, size_t capacity) {
    const struct touched t = touched_by(rect);
    for (uint32_t y = t.y; y < t.end_y; y++)
        for (uint32_t x = t.x; x < t.end_x; x++) {
            const lw_tile_id id = lw_atlas_map_claim(map, rect->object, rect->level, x, y);
            if (id.v == UINT32_MAX) continue; /* no id is left for now */
            if (count < capacity) tile[count] = id;
            count++;
        }
    return count;
}

/* Refuses more tiles of finer levels than slots. rect: they lie within their levels */
static enum lw_live_status check_finer(const struct lw_live *live, const struct lw_live_rect *rect,
                                       size_t count, struct lw_live_error *err) {
    uint64_t finer = 0;
    for (size_t i = 0; i < count; i++) {
        const struct touched t = touched_by(&rect[i]);
        if (lw_atlas_finer(rect[i].level)) finer += (uint64_t)(t.end_x - t.x) * (t.end_y - t.y);
    }
    if (finer <= live->finer_slots) return LW_LIVE_OK;
    return lw_live_fail(err, LW_LIVE_USAGE, "%llu tiles of finer levels: lw_live_desc.finer_slots is %u",
                        (unsigned long long)finer, live->finer_slots);
}

enum lw_live_status lw_live_want_rects(struct lw_live *live, const struct lw_live_rect *rect, size_t count,
                                       struct lw_live_error *err) {
    if (!live || (count && !rect)) return lw_live_fail(err, LW_LIVE_USAGE, "live or rect is NULL");
    enum lw_live_status result = LW_LIVE_OK;
    enum lw_status status = LW_OK;
    size_t tiles = 0;
    lw_live_lock(live);
    if (count && !live->scene) result = lw_live_fail(err, LW_LIVE_NOT_READY, "the scene has not arrived yet");
    for (size_t i = 0; result == LW_LIVE_OK && i < count; i++)
        result = lw_live_tiles_check(&live->tiles, &rect[i], err);
    if (result == LW_LIVE_OK) result = check_finer(live, rect, count, err);
    for (size_t i = 0; result == LW_LIVE_OK && i < count; i++)
        tiles = list_tiles(live->tiles.map, &rect[i], live->interest.list, tiles, LW_CLIENT_INTEREST_MAX + 1);
    if (result == LW_LIVE_OK) {
        live->interest.is_active = false;
        if (tiles > LW_CLIENT_INTEREST_MAX)
            lw_client_want_everything(live->client);
        else
            status = lw_client_want(live->client, tiles ? live->interest.list : NULL, tiles);
        rouse(live);
    }
    lw_live_unlock(live);
    return result == LW_LIVE_OK ? lw_live_pass(err, status, NULL) : result;
}

void lw_live_want_everything(struct lw_live *live) {
    if (!live) return;
    lw_live_lock(live);
    live->interest.is_active = false;
    lw_client_want_everything(live->client);
    rouse(live);
    lw_live_unlock(live);
}

/* ---- finer levels ---- */

enum lw_live_status lw_live_get_finer(const struct lw_live *live, struct lw_live_finer *out_finer,
                                      struct lw_live_error *err) {
    if (!live) return lw_live_fail(err, LW_LIVE_USAGE, "live is NULL");
    lw_live_lock(live);
    struct lw_live_finer finer = {.slot_count = live->finer_slots};
    if (live->scene) {
        finer.level_count = lw_client_finer(live->client);
        finer.page_count = live->tiles.map->fine_names;
        finer.slots_used = live->slots.used;
        finer.slots_waiting = live->slots.waiting;
    }
    lw_live_unlock(live);
    if (lw_live_write_struct(out_finer, &finer, sizeof finer)) return LW_LIVE_OK;
    return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_finer: struct_size is not sizeof *out_finer");
}

enum lw_live_status lw_live_get_pages(const struct lw_live *live, uint32_t object, uint32_t level,
                                      struct lw_live_pages *out_pages, struct lw_live_error *err) {
    const struct lw_live_rect rect = {.object = object, .level = level};
    struct lw_live_pages pages = {0};
    if (!live) return lw_live_fail(err, LW_LIVE_USAGE, "live is NULL");
    if (!lw_atlas_finer(level)) return lw_live_fail(err, LW_LIVE_USAGE, "level %u has no pages", level);
    lw_live_lock(live);
    const enum lw_live_status result =
        live->scene ? lw_live_tiles_check(&live->tiles, &rect, err)
                    : lw_live_fail(err, LW_LIVE_NOT_READY, "the scene has not arrived yet");
    if (result == LW_LIVE_OK) {
        const struct lw_atlas_map *map = live->tiles.map;
        const struct lw_atlas_level *at = lw_atlas_level(map->atlas[object], level);
        pages.first = map->first_finer[object] + at->first_tile;
        pages.columns = at->tiles_x;
        pages.rows = at->tiles_y;
    }
    lw_live_unlock(live);
    if (result != LW_LIVE_OK) return result;
    if (lw_live_write_struct(out_pages, &pages, sizeof pages)) return LW_LIVE_OK;
    return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_pages: struct_size is not sizeof *out_pages");
}

size_t lw_live_take_slots(struct lw_live *live, uint64_t now_ns, size_t tiles_max,
                          struct lw_live_slot *out_slot, size_t capacity) {
    if (!live || !out_slot) return 0;
    lw_live_lock(live);
    const size_t count =
        live->scene ? lw_live_slots_take(&live->slots, now_ns, tiles_max, out_slot, capacity) : 0;
    lw_live_unlock(live);
    return count;
}

/* ---- changing the scene ---- */

_Static_assert((int)LW_LIVE_CHANGE_OBJECT_TRANSFORM == LW_SCENE_CHANGE_OBJECT_TRANSFORM &&
                   (int)LW_LIVE_CHANGE_LIGHT_RESTORE == LW_SCENE_CHANGE_LIGHT_RESTORE &&
                   (int)LW_LIVE_CHANGE_MATERIAL_RESTORE == LW_SCENE_CHANGE_MATERIAL_RESTORE &&
                   (int)LW_LIVE_CHANGE_RESET == LW_SCENE_CHANGE_RESET &&
                   (int)LW_LIVE_CHANGE_OBJECT_REMOVE == LW_SCENE_CHANGE_OBJECT_REMOVE,
               "numbers of changes are for ever");

/* How many values a kind has. An unknown one has none: the server names the mistake. */
static uint32_t value_count(enum lw_live_change_kind kind) {
#define X(name, number, of, values)                                                                          \
    if ((int)kind == number) return values;
    LW_SCENE_CHANGE_MAP(X)
#undef X
    return 0;
}

enum lw_live_status lw_live_change(struct lw_live *live, const struct lw_live_change *change, size_t count,
                                   uint64_t *out_request, struct lw_live_error *err) {
    if (!live || (count && !change)) return lw_live_fail(err, LW_LIVE_USAGE, "live or change is NULL");
    if (count > LW_CLIENT_CHANGES_MAX)
        return lw_live_fail(err, LW_LIVE_USAGE, "%zu changes: there may be %u", count, LW_CLIENT_CHANGES_MAX);
    struct lw_scene_change *ours = calloc(count + 1, sizeof *ours);
    if (!ours) return lw_live_fail(err, LW_LIVE_NO_MEMORY, "out of memory");
    enum lw_live_status result = LW_LIVE_OK;
    for (size_t i = 0; i < count && result == LW_LIVE_OK; i++) {
        struct lw_live_change c;
        if (!lw_live_read_struct(&c, sizeof c, (const char *)change + i * lw_live_struct_size(change))) {
            result =
                lw_live_fail(err, LW_LIVE_USAGE, "lw_live_change %zu: struct_size is not sizeof *change", i);
            continue;
        }
        ours[i] = (struct lw_scene_change){
            .kind = (uint32_t)c.kind, .target = c.target, .value_count = value_count(c.kind)};
        memcpy(ours[i].value, c.value, sizeof ours[i].value);
    }
    if (result == LW_LIVE_OK) {
        struct lw_error cause = {0};
        lw_live_lock(live);
        enum lw_status status = lw_client_update(live->client, ours, count, out_request, &cause);
        rouse(live);
        lw_live_unlock(live);
        result = lw_live_pass(err, status, &cause);
    }
    free(ours);
    return result;
}

int lw_live_next_answer(struct lw_live *live, struct lw_live_answer *out_answer) {
    struct lw_live_answer answer = {0};
    if (!live || lw_live_struct_size(out_answer) < sizeof answer) return 0;
    lw_live_lock(live);
    const bool any = lw_client_next_answer(live->client, &live->answer);
    lw_live_unlock(live);
    if (!any) return 0;
    answer = (struct lw_live_answer){.request = live->answer.request,
                                     .code = live->answer.code,
                                     .change = live->answer.change,
                                     .frame = live->answer.frame,
                                     .text = live->answer.text,
                                     .added = live->answer.added,
                                     .added_count = live->answer.added_count};
    return lw_live_write_struct(out_answer, &answer, sizeof answer);
}
