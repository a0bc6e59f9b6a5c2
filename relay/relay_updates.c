#include "relay/relay_updates.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#define MS_NS    1000000ull
#define SOON_MS  100  /* while updates wait for a connection, or for room in it */
#define REST_MS  1000 /* with a session: under LW_LINK_PING_S */
#define RETRY_NS (1000 * MS_NS)
#define IDLE_NS  (60000 * MS_NS)

/* A session that forwards the updates of one token, or of sessions without one. */
struct control {
    struct lw_relay_updates *updates;
    bool is_used, has_token;
    struct lw_token token;
    struct lw_relay_upstream *up; /* NULL: not connected */
    uint64_t ahead;               /* clients count the server's frames so */
    uint64_t retry_ns, used_ns;
    struct lw_passed_update *waiting; /* not sent yet */
    size_t waiting_count, waiting_capacity;
    uint64_t *sent; /* numbers of those that have no answer */
    size_t sent_count, sent_capacity;
};

struct lw_relay_updates {
    struct lw_relay_updates_light light;
    struct lw_access access;
    struct ssl_ctx_st *trust;
    unsigned timeout_ms;
    uint64_t relay;
    int wake; /* eventfd */
    pthread_t thread;
    _Atomic bool stopping;
    _Atomic uint64_t passed, cpu_ns;

    /* Guards what follows. The thread holds it when it calls the light's functions, but not while it
     * waits. */
    pthread_mutex_t mutex;
    struct lw_server *server; /* NULL: there is none */
    uint64_t retry_ns;        /* until then nobody connects */
    struct control control[LW_RELAY_UPDATES_TOKENS_MAX];
};

static void answer_busy(struct lw_relay_updates *u, uint64_t number, const char *text) {
    if (u->server)
        (void)lw_server_answer_passed(
            u->server, number, &(struct lw_message_updated){.code = LW_SCENE_CHANGE_BUSY, .text = text});
}

/* The server may have made the changes that were sent to it. It has made none of those that wait. */
static void end_session(struct control *c) {
    struct lw_relay_updates *u = c->updates;
    for (size_t i = 0; i < c->sent_count; i++)
        if (u->server) lw_server_lose_passed(u->server, c->sent[i]);
    c->sent_count = 0;
    lw_relay_upstream_destroy(c->up);
    c->up = NULL;
}

static void end_control(struct control *c, const char *why) {
    struct lw_relay_updates *u = c->updates;
    end_session(c);
    for (size_t i = 0; i < c->waiting_count; i++) {
        answer_busy(u, c->waiting[i].number, why);
        free(c->waiting[i].change);
    }
    c->waiting_count = 0;
}

static void free_control(struct control *c) {
    end_control(c, "");
    free(c->waiting);
    free(c->sent);
    *c = (struct control){0};
}

static void on_answered(void *context, const struct lw_message_updated *updated) {
    struct control *c = context;
    struct lw_relay_updates *u = c->updates;
    struct lw_message_updated answer = *updated;
    for (size_t i = 0; i < c->sent_count; i++) {
        if (c->sent[i] != updated->request) continue;
        memmove(c->sent + i, c->sent + i + 1, (--c->sent_count - i) * sizeof *c->sent);
        if (!u->server) return;
        answer.frame = lw_relay_light_count(updated->frame, c->ahead);
        if (!lw_server_answer_passed(u->server, updated->request, &answer))
            lw_server_lose_passed(u->server, updated->request);
        return;
    }
}

static struct control *find_control(struct lw_relay_updates *u, const struct lw_passed_update *update) {
    struct control *unused = NULL;
    for (struct control *c = u->control; c < u->control + LW_RELAY_UPDATES_TOKENS_MAX; c++) {
        if (!c->is_used && !unused) unused = c;
        if (c->is_used && c->has_token == update->has_token &&
            (!c->has_token || !memcmp(c->token.bytes, update->token.bytes, sizeof c->token.bytes)))
            return c;
    }
    if (unused)
        *unused = (struct control){
            .updates = u, .is_used = true, .has_token = update->has_token, .token = update->token};
    return unused;
}

static bool make_room(void **array, size_t *capacity, size_t count, size_t size) {
    if (count < *capacity) return true;
    const size_t grown_capacity = *capacity ? 2 * *capacity : 16;
    void *grown = realloc(*array, grown_capacity * size);
    if (!grown) return false;
    *array = grown;
    *capacity = grown_capacity;
    return true;
}

static void take_updates(struct lw_relay_updates *u) {
    struct lw_passed_update update;
    while (u->server && lw_server_take_passed(u->server, &update)) {
        struct control *c = find_control(u, &update);
        if (!c ||
            !make_room((void **)&c->waiting, &c->waiting_capacity, c->waiting_count, sizeof *c->waiting) ||
            !make_room((void **)&c->sent, &c->sent_capacity, c->sent_count + c->waiting_count,
                       sizeof *c->sent)) {
            answer_busy(u, update.number,
                        c ? "out of memory: nothing was changed"
                          : "too many tokens change the scene at once: nothing was changed");
            free(update.change);
            continue;
        }
        c->waiting[c->waiting_count++] = update;
        u->passed++;
    }
}

/* Without the mutex while it connects. */
static void connect_control(struct lw_relay_updates *u, struct control *c) {
    struct lw_error err = {0};
    const struct lw_relay_address address = u->light.where(u->light.context);
    const bool own = !c->has_token && u->access.has_token;
    const struct lw_token token = c->has_token ? c->token : u->access.token;
    const struct lw_relay_upstream_desc desc = {.host = address.host,
                                                .port = address.port,
                                                .token = c->has_token || own ? &token : NULL,
                                                .trust = u->trust,
                                                .nats_trust = &u->access.tls,
                                                .timeout_ms = u->timeout_ms,
                                                .relay = u->relay,
                                                .control = true};
    struct lw_relay_upstream *up = NULL;
    pthread_mutex_unlock(&u->mutex);
    const enum lw_status status = lw_relay_upstream_create(&desc, &up, &err);
    pthread_mutex_lock(&u->mutex);
    c->up = up;
    if (status == LW_OK &&
        u->light.is_of_run(u->light.context, lw_relay_upstream_welcome(up)->run, &c->ahead)) {
        lw_relay_upstream_set_answered(up, on_answered, c);
        return;
    }
    c->retry_ns = lw_clock_ns() + RETRY_NS;
    /* Nobody is there for other tokens either: they need not wait for a connect, one after another. */
    if (status != LW_OK && status != LW_NOT_ALLOWED) u->retry_ns = c->retry_ns;
    char text[LW_MESSAGE_TEXT_MAX + 1];
    snprintf(text, sizeof text, "nothing was changed: the server above: %.200s",
             status == LW_OK ? "its light is not here yet" : err.text);
    end_control(c, text);
}

static enum lw_status send_updates(struct control *c, struct lw_error *err) {
    size_t done = 0;
    enum lw_status status = LW_OK;
    for (bool sent = true; status == LW_OK && sent && done < c->waiting_count;) {
        struct lw_passed_update *update = &c->waiting[done];
        status =
            lw_relay_upstream_update(c->up, update->number, update->change, update->change_count, &sent, err);
        if (status != LW_OK || !sent) break;
        LW_INVARIANT(c->sent_count < c->sent_capacity);
        c->sent[c->sent_count++] = update->number;
        free(update->change);
        done++;
    }
    c->waiting_count -= done;
    memmove(c->waiting, c->waiting + done, c->waiting_count * sizeof *c->waiting);
    return status;
}

static void serve_control(struct lw_relay_updates *u, struct control *c) {
    struct lw_error err = {0};
    const uint64_t now_ns = lw_clock_ns();
    if (!c->is_used) return;
    if (c->waiting_count || c->sent_count) c->used_ns = now_ns;
    if (c->up && c->ahead != u->light.ahead(u->light.context)) end_session(c); /* light is of another run */
    if (!c->up && c->waiting_count && (now_ns < c->retry_ns || now_ns < u->retry_ns)) {
        end_control(c, "nothing was changed: there is no server above now");
        return;
    }
    if (!c->up && c->waiting_count) connect_control(u, c);
    if (!c->up) {
        if (now_ns - c->used_ns > IDLE_NS) free_control(c);
        return;
    }
    enum lw_status status = send_updates(c, &err);
    if (status == LW_OK) status = lw_relay_upstream_take(c->up, &err);
    if (status != LW_OK)
        end_control(c, "nothing was changed: the server above is gone");
    else if (now_ns - c->used_ns > IDLE_NS)
        free_control(c);
}

/* Time until something is due, ms; -1: nothing is. */
static int time_left(const struct lw_relay_updates *u) {
    int left_ms = -1;
    for (const struct control *c = u->control; c < u->control + LW_RELAY_UPDATES_TOKENS_MAX; c++) {
        if (c->waiting_count) return SOON_MS;
        if (c->is_used) left_ms = REST_MS;
    }
    return left_ms;
}

/* Without the mutex while it waits. */
static void wait_for_any(struct lw_relay_updates *u) {
    struct pollfd polled[1 + LW_RELAY_UPDATES_TOKENS_MAX];
    nfds_t count = 0;
    uint64_t wakes;
    polled[count++] = (struct pollfd){.fd = u->wake, .events = POLLIN};
    for (const struct control *c = u->control; c < u->control + LW_RELAY_UPDATES_TOKENS_MAX; c++) {
        if (!c->up) continue;
        short events;
        const int descriptor = lw_relay_upstream_descriptor(c->up, &events);
        polled[count++] = (struct pollfd){.fd = descriptor, .events = events};
    }
    const int left_ms = time_left(u);
    u->cpu_ns = lw_clock_read_ns(CLOCK_THREAD_CPUTIME_ID);
    pthread_mutex_unlock(&u->mutex);
    (void)poll(polled, count, left_ms);
    if (polled[0].revents & POLLIN) (void)!read(u->wake, &wakes, sizeof wakes);
    pthread_mutex_lock(&u->mutex);
}

static void *run(void *context) {
    struct lw_relay_updates *u = context;
    pthread_mutex_lock(&u->mutex);
    while (!u->stopping) {
        take_updates(u);
        for (uint32_t c = 0; c < LW_RELAY_UPDATES_TOKENS_MAX; c++) serve_control(u, &u->control[c]);
        wait_for_any(u);
    }
    for (uint32_t c = 0; c < LW_RELAY_UPDATES_TOKENS_MAX; c++) free_control(&u->control[c]);
    pthread_mutex_unlock(&u->mutex);
    return NULL;
}

enum lw_status lw_relay_updates_create(const struct lw_relay_updates_desc *desc,
                                       struct lw_relay_updates **out_updates, struct lw_error *err) {
    struct lw_relay_updates *u = calloc(1, sizeof *u);
    if (!u) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    u->light = desc->light;
    u->access = *desc->access;
    u->trust = desc->trust;
    u->timeout_ms = desc->timeout_ms;
    u->relay = desc->relay;
    u->wake = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    if (u->wake < 0) {
        free(u);
        return lw_status_fail(err, LW_OS, "eventfd: %s", strerror(errno));
    }
    pthread_mutex_init(&u->mutex, NULL); /* glibc's cannot fail */
    if (pthread_create(&u->thread, NULL, run, u) == 0) {
        *out_updates = u;
        return LW_OK;
    }
    pthread_mutex_destroy(&u->mutex);
    close(u->wake);
    free(u);
    return lw_status_fail(err, LW_OS, "cannot start a thread");
}

void lw_relay_updates_destroy(struct lw_relay_updates *u) {
    if (!u) return;
    u->stopping = true;
    lw_relay_updates_wake(u);
    pthread_join(u->thread, NULL);
    pthread_mutex_destroy(&u->mutex);
    close(u->wake);
    free(u);
}

void lw_relay_updates_serve(struct lw_relay_updates *u, struct lw_server *server) {
    pthread_mutex_lock(&u->mutex);
    LW_INVARIANT(!u->server);
    u->server = server;
    pthread_mutex_unlock(&u->mutex);
    lw_relay_updates_wake(u);
}

void lw_relay_updates_leave(struct lw_relay_updates *u) {
    pthread_mutex_lock(&u->mutex);
    u->server = NULL; /* before: its sessions end, nobody waits for an answer */
    for (uint32_t c = 0; c < LW_RELAY_UPDATES_TOKENS_MAX; c++)
        if (u->control[c].is_used) end_control(&u->control[c], "");
    pthread_mutex_unlock(&u->mutex);
}

void lw_relay_updates_wake(struct lw_relay_updates *u) {
    const uint64_t one = 1;
    (void)!write(u->wake, &one, sizeof one); /* full: it is awake already */
}

void lw_relay_updates_get_stats(const struct lw_relay_updates *u, struct lw_relay_updates_stats *out_stats) {
    *out_stats = (struct lw_relay_updates_stats){.passed = u->passed, .cpu_ns = u->cpu_ns};
}
