#include "server/serve/sessions/passed_updates.h"

#include "common/base/invariant.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct lw_passed_updates_entry {
    struct lw_session *session; /* NULL: it is gone */
    uint64_t number, request;
    struct lw_passed_update up; /* its changes: NULL once it was taken */
    bool is_taken, is_answered, is_lost;
    uint32_t code, change;
    uint64_t frame;
    char text[LW_MESSAGE_TEXT_MAX + 1];
    uint32_t *added;
    size_t added_count;
};

enum lw_status lw_passed_updates_init(struct lw_passed_updates *updates) {
    *updates = (struct lw_passed_updates){0};
    return uv_mutex_init(&updates->mutex) < 0 ? LW_OS : LW_OK;
}

void lw_passed_updates_finish(struct lw_passed_updates *u) {
    for (size_t i = 0; i < u->entry_count; i++) {
        free(u->entry[i].up.change);
        free(u->entry[i].added);
    }
    free(u->entry);
    uv_mutex_destroy(&u->mutex);
}

/* Under the mutex, as what follows. */
static bool grow(struct lw_passed_updates *u) {
    if (u->entry_count < u->entry_capacity) return true;
    const size_t capacity = u->entry_capacity ? 2 * u->entry_capacity : 16;
    struct lw_passed_updates_entry *grown = realloc(u->entry, capacity * sizeof *grown);
    if (!grown) return false;
    u->entry = grown;
    u->entry_capacity = capacity;
    return true;
}

static void drop_entry(struct lw_passed_updates *u, struct lw_passed_updates_entry *e) {
    LW_INVARIANT(e >= u->entry && e < u->entry + u->entry_count);
    free(e->up.change);
    if (!e->is_taken) u->change_count -= e->up.change_count;
    u->entry_count--;
    memmove(e, e + 1, (size_t)(u->entry + u->entry_count - e) * sizeof *e);
}

static struct lw_passed_updates_entry *find(struct lw_passed_updates *u, uint64_t number) {
    for (size_t i = 0; i < u->entry_count; i++)
        if (u->entry[i].number == number) return &u->entry[i];
    return NULL;
}

bool lw_passed_updates_add(struct lw_passed_updates *u, struct lw_session *session,
                           const struct lw_token *token, const struct lw_message_update *update) {
    const size_t size = update->change_count * sizeof *update->change;
    struct lw_scene_change *change = malloc(size + 1);
    if (!change) return false;
    if (size) memcpy(change, update->change, size);
    uv_mutex_lock(&u->mutex);
    const bool fits = u->entry_count < LW_PASSED_UPDATES_MAX &&
                      update->change_count <= LW_PASSED_UPDATES_CHANGES_MAX - u->change_count && grow(u);
    if (fits) {
        struct lw_passed_updates_entry *e = &u->entry[u->entry_count++];
        *e = (struct lw_passed_updates_entry){.session = session,
                                              .number = ++u->number,
                                              .request = update->request,
                                              .up = {.number = u->number,
                                                     .has_token = token != NULL,
                                                     .change = change,
                                                     .change_count = update->change_count}};
        if (token) e->up.token = *token;
        u->change_count += update->change_count;
        u->waiting = true;
    }
    uv_mutex_unlock(&u->mutex);
    if (!fits) free(change);
    return fits;
}

bool lw_passed_updates_take(struct lw_passed_updates *u, struct lw_passed_update *out_update) {
    bool any = false;
    uv_mutex_lock(&u->mutex);
    for (size_t i = 0; i < u->entry_count && !any; i++) {
        struct lw_passed_updates_entry *e = &u->entry[i];
        if (e->is_taken) continue;
        any = e->is_taken = true;
        *out_update = e->up;
        e->up.change = NULL;
        LW_INVARIANT(u->change_count >= e->up.change_count);
        u->change_count -= e->up.change_count;
    }
    if (!any) u->waiting = false;
    uv_mutex_unlock(&u->mutex);
    return any;
}

bool lw_passed_updates_answer(struct lw_passed_updates *u, uint64_t number,
                              const struct lw_message_updated *answer) {
    uint32_t *added = NULL;
    const size_t size = answer->added_count * sizeof *added;
    if (size && !(added = malloc(size))) return false;
    if (size) memcpy(added, answer->added, size);
    uv_mutex_lock(&u->mutex);
    struct lw_passed_updates_entry *e = find(u, number);
    if (e && !e->is_answered) {
        LW_INVARIANT(e->is_taken && !e->added);
        e->is_answered = true;
        e->code = answer->code;
        e->change = answer->change;
        e->frame = answer->frame;
        snprintf(e->text, sizeof e->text, "%s", answer->text ? answer->text : "");
        e->added = added;
        e->added_count = answer->added_count;
        added = NULL;
    }
    uv_mutex_unlock(&u->mutex);
    free(added);
    return true;
}

void lw_passed_updates_lose(struct lw_passed_updates *u, uint64_t number) {
    uv_mutex_lock(&u->mutex);
    struct lw_passed_updates_entry *e = find(u, number);
    if (e && !e->is_answered) e->is_answered = e->is_lost = true;
    uv_mutex_unlock(&u->mutex);
}

static bool is_due(const struct lw_passed_updates_entry *e, uint64_t frame) {
    return e->is_answered && (e->is_lost || e->code || e->frame <= frame);
}

/* No frame of that run came to show it. */
static bool is_of_earlier_run(const struct lw_passed_updates_entry *e, uint64_t frame) {
    return !e->code && e->frame / LW_PASSED_UPDATES_RUN_FRAMES < frame / LW_PASSED_UPDATES_RUN_FRAMES;
}

/* Its text and list have to outlive the entry. */
static bool take_answer(const struct lw_passed_updates_entry *e, struct lw_passed_updates_done *out_done) {
    *out_done = (struct lw_passed_updates_done){.session = e->session, .is_lost = e->is_lost};
    if (e->is_lost) return true;
    const size_t text_size = strlen(e->text) + 1, size = e->added_count * sizeof *e->added;
    uint8_t *storage = malloc(size + text_size);
    if (!storage) return false;
    if (size) memcpy(storage, e->added, size);
    memcpy(storage + size, e->text, text_size);
    out_done->storage = storage;
    out_done->answer = (struct lw_message_updated){.request = e->request,
                                                   .code = e->code,
                                                   .change = e->change,
                                                   .text = (const char *)storage + size,
                                                   .frame = e->frame,
                                                   .added = (const uint32_t *)(void *)storage,
                                                   .added_count = e->added_count};
    return true;
}

bool lw_passed_updates_next(struct lw_passed_updates *u, uint64_t frame,
                            struct lw_passed_updates_done *out_done) {
    bool any = false;
    uv_mutex_lock(&u->mutex);
    for (size_t i = 0; i < u->entry_count && !any;) {
        struct lw_passed_updates_entry *e = &u->entry[i];
        if (!is_due(e, frame)) {
            i++;
            continue;
        }
        e->is_lost |= is_of_earlier_run(e, frame);
        any = e->session != NULL;
        if (any && !take_answer(e, out_done)) { /* no memory: the session hears that it is lost */
            *out_done = (struct lw_passed_updates_done){.session = e->session, .is_lost = true};
        }
        free(e->added);
        drop_entry(u, e);
    }
    uv_mutex_unlock(&u->mutex);
    return any;
}

void lw_passed_updates_forget(struct lw_passed_updates *u, const struct lw_session *session) {
    uv_mutex_lock(&u->mutex);
    for (size_t i = 0; i < u->entry_count; i++)
        if (u->entry[i].session == session) u->entry[i].session = NULL;
    uv_mutex_unlock(&u->mutex);
}
