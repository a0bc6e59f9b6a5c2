#include "server/serve/sessions/updates.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

enum lw_status lw_updates_init(struct lw_updates *updates) {
    *updates = (struct lw_updates){0};
    return uv_mutex_init(&updates->mutex) < 0 ? LW_OS : LW_OK;
}

void lw_updates_finish(struct lw_updates *updates) {
    for (size_t i = 0; i < updates->entry_count; i++) free(updates->entry[i].added);
    free(updates->entry);
    free(updates->change);
    uv_mutex_destroy(&updates->mutex);
}

/* Under the mutex. */
static bool is_in_order(const struct lw_updates *u) {
    return u->taken_count <= u->entry_count && u->entry_count <= u->entry_capacity &&
           u->change_count <= u->change_capacity && u->change_count <= LW_UPDATES_CHANGES_MAX;
}

static bool grow(void **array, size_t *capacity, size_t needed, size_t size) {
    if (needed <= *capacity) return true;
    size_t grown_capacity = needed > 2 * *capacity ? needed : 2 * *capacity;
    void *grown = realloc(*array, grown_capacity * size);
    if (!grown) return false;
    *array = grown;
    *capacity = grown_capacity;
    return true;
}

static bool add(struct lw_updates *u, const struct lw_updates_entry *entry,
                const struct lw_scene_change *change, size_t count) {
    if (u->entry_count - u->taken_count >= LW_UPDATES_MAX || count > LW_UPDATES_CHANGES_MAX - u->change_count)
        return false;
    if (!grow((void **)&u->entry, &u->entry_capacity, u->entry_count + 1, sizeof *u->entry) ||
        !grow((void **)&u->change, &u->change_capacity, u->change_count + count, sizeof *u->change))
        return false;
    u->entry[u->entry_count++] = *entry;
    if (count) memcpy(u->change + u->change_count, change, count * sizeof *change);
    u->change_count += count;
    u->waiting = true;
    LW_INVARIANT(is_in_order(u));
    return true;
}

bool lw_updates_add(struct lw_updates *updates, struct lw_session *session, uint64_t request,
                    const struct lw_scene_change *change, size_t count, const uint32_t *added,
                    size_t added_count) {
    struct lw_updates_entry entry = {.session = session, .request = request, .added_count = added_count};
    if (added_count) {
        if (!(entry.added = malloc(added_count * sizeof *added))) return false;
        memcpy(entry.added, added, added_count * sizeof *added);
    }
    uv_mutex_lock(&updates->mutex);
    const bool taken = add(updates, &entry, change, count);
    uv_mutex_unlock(&updates->mutex);
    if (!taken) free(entry.added);
    return taken;
}

size_t lw_updates_take(struct lw_updates *u, uint64_t frame, struct lw_scene_change **out_change,
                       size_t *out_change_count) {
    uv_mutex_lock(&u->mutex);
    LW_INVARIANT(is_in_order(u));
    LW_INVARIANT(!u->taken_count || u->entry[u->taken_count - 1].frame <= frame); /* taken frame by frame */
    size_t count = u->entry_count - u->taken_count;
    for (size_t i = u->taken_count; i < u->entry_count; i++) u->entry[i].frame = frame;
    u->taken_count = u->entry_count;
    u->waiting = false;
    *out_change = u->change;
    *out_change_count = u->change_count;
    u->change = NULL;
    u->change_count = u->change_capacity = 0;
    uv_mutex_unlock(&u->mutex);
    return count;
}

bool lw_updates_next(struct lw_updates *u, uint64_t frame, struct lw_updates_entry *out_entry) {
    uv_mutex_lock(&u->mutex);
    bool has = u->taken_count && u->entry[0].frame <= frame;
    if (has) {
        LW_INVARIANT(is_in_order(u));
        *out_entry = u->entry[0];
        u->taken_count--;
        u->entry_count--;
        memmove(u->entry, u->entry + 1, u->entry_count * sizeof *u->entry);
    }
    uv_mutex_unlock(&u->mutex);
    return has;
}

void lw_updates_forget(struct lw_updates *u, const struct lw_session *session) {
    uv_mutex_lock(&u->mutex);
    for (size_t i = 0; i < u->entry_count; i++)
        if (u->entry[i].session == session) u->entry[i].session = NULL;
    uv_mutex_unlock(&u->mutex);
}
