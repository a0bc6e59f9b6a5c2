#include "server/serve/server_handover.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "server/serve/sessions/fine_turns.h"
#include "server/serve/sessions/turns.h"

#include <stdlib.h>
#include <string.h>

/* ---- snapshots, and the answers that they bring ---- */

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
        if (shared->channels.served >> f & 1 && lw_snapshot_has(snapshot, f))
            adopt_channel(server, &shared->channels.at[f], snapshot);
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

/* ---- interest ---- */

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

/* For the solver: what the tiles that are listed cover, and turns of those of finer levels. */
static bool list_levels(const struct lw_server *server, struct lw_server_interest *list) {
    const struct lw_interest_union *interest_union = &server->shared.interest_union;
    if (!(list->levels = malloc((size_t)interest_union->atlas_map->tile_count + 1))) return false;
    lw_interest_union_levels(interest_union, list->levels);
    return lw_fine_turns_weigh(&server->shared, server->outside.tile, server->outside.tile_count,
                               list->levels);
}

void lw_server_handover_interest(struct lw_server *server) {
    struct lw_interest_union *interest_union = &server->shared.interest_union;
    if (!interest_union->changed) return;
    uv_mutex_lock(&server->mutex);
    bool untaken = server->has_interest;
    uv_mutex_unlock(&server->mutex);
    if (untaken) return; /* the taker wakes the loop */
    struct lw_server_interest list = {.everything = interest_union->everything > 0};
    const bool is_made = server->shared.is_relay ? list_wanted(&server->shared, &list)
                         : list.everything       ? true
                                                 : list_levels(server, &list);
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

void lw_server_handover_wake_relay(struct lw_server *server) {
    const uint32_t channels = server->shared.channels.taken;
    if (!server->hooks.news) return;
    uv_mutex_lock(&server->mutex);
    const bool news = server->has_interest;
    uv_mutex_unlock(&server->mutex);
    if (news || server->shared.passed.waiting || channels != server->reported_channels)
        server->hooks.news(server->hooks.context);
    server->reported_channels = channels;
}

/* ---- the solver's side ---- */

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

void lw_server_set_relays_outside(struct lw_server *server, const struct lw_relay_tree_node *node,
                                  uint32_t count) {
    lw_relay_tree_set_outside(&server->shared.tree, node, count);
}

uint32_t lw_server_channels_taken(const struct lw_server *server) { return server->shared.channels.taken; }

size_t lw_server_take_updates(struct lw_server *server, uint64_t frame, struct lw_scene_change **out_change,
                              size_t *out_change_count) {
    return lw_updates_take(&server->shared.updates, frame, out_change, out_change_count);
}

size_t lw_server_begin_with_changes(struct lw_server *server, const struct lw_scene_change *change,
                                    size_t count) {
    struct lw_session_shared *shared = &server->shared;
    for (size_t i = 0; i < count; i++) {
        struct lw_error err = {0};
        uint32_t object;
        if (lw_scene_change_check(shared->scene, &change[i], &err) != LW_SCENE_CHANGE_OK ||
            lw_scene_roster_take(&shared->roster, &change[i], &object, &err) != LW_SCENE_CHANGE_OK)
            return i;
    }
    return count;
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

static void free_outside(struct lw_server_outside_copy *outside) {
    free(outside->tile);
    free(outside->fine);
    *outside = (struct lw_server_outside_copy){0};
}

bool lw_server_set_outside(struct lw_server *server, const struct lw_server_outside *outside) {
    struct lw_server_outside_copy next = {.channels = outside->channels, .everything = outside->everything};
    if (!outside->everything) {
        next.tile_count = outside->tile_count;
        next.fine_count = outside->fine_count;
        next.tile = malloc((next.tile_count + next.fine_count + 1) * sizeof *next.tile);
        next.fine = malloc((next.fine_count + 1) * sizeof *next.fine);
        if (!next.tile || !next.fine) {
            free_outside(&next);
            return false;
        }
        if (next.tile_count) memcpy(next.tile, outside->tile, next.tile_count * sizeof *next.tile);
        if (next.fine_count) memcpy(next.fine, outside->fine, next.fine_count * sizeof *next.fine);
    }
    uv_mutex_lock(&server->mutex);
    struct lw_server_outside_copy unseen = server->next_outside;
    server->next_outside = next;
    server->has_next_outside = true;
    uv_mutex_unlock(&server->mutex);
    free_outside(&unseen);
    uv_async_send(&server->wake);
    return true;
}

/* ---- the loop's side ---- */

static void count_outside(struct lw_session_shared *shared, const struct lw_server_outside_copy *outside,
                          bool more) {
    struct lw_interest_union *all = &shared->interest_union;
    if (!outside->channels) return;
    if (outside->everything)
        (more ? lw_interest_union_add_everything : lw_interest_union_remove_everything)(all);
    else
        (more ? lw_interest_union_add : lw_interest_union_remove)(all, outside->tile, outside->tile_count);
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++) {
        struct lw_session_channel *channel = &shared->channels.at[c];
        if (!(outside->channels >> c & 1)) continue;
        LW_INVARIANT(more || channel->session_count > 0);
        if (more ? !channel->session_count++ : !--channel->session_count) shared->channels.taken ^= 1u << c;
    }
}

/* Gives ids to the tiles of finer levels; those that get none are left out. */
static void name_fine(struct lw_session_shared *shared, struct lw_server_outside_copy *outside) {
    for (size_t i = 0; i < outside->fine_count; i++) {
        const uint32_t id = lw_atlas_map_claim_name(shared->atlas_map, outside->fine[i]).v;
        if (id != UINT32_MAX) outside->tile[outside->tile_count++] = id;
    }
    free(outside->fine);
    outside->fine = NULL;
    outside->fine_count = 0;
    lw_fine_names_add(&shared->fine, outside->tile, (uint32_t)outside->tile_count);
}

static void take_outside(struct lw_server *server) {
    struct lw_session_shared *shared = &server->shared;
    uv_mutex_lock(&server->mutex);
    const bool has_next = server->has_next_outside;
    struct lw_server_outside_copy next = server->next_outside;
    server->has_next_outside = false;
    server->next_outside = (struct lw_server_outside_copy){0};
    uv_mutex_unlock(&server->mutex);
    if (!has_next) return;
    next.channels &= shared->channels.served;
    /* in this order, so that a tile of both is never without interest */
    name_fine(shared, &next);
    count_outside(shared, &next, true);
    count_outside(shared, &server->outside, false);
    shared->interest_union.changed |=
        lw_fine_names_remove(&shared->fine, server->outside.tile, (uint32_t)server->outside.tile_count);
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

bool lw_server_handover_take(struct lw_server *server) {
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
    return stop;
}

void lw_server_handover_finish(struct lw_server *server) {
    lw_snapshot_unref(server->latest);
    free_interest(&server->interest);
    free_outside(&server->outside);
    free_outside(&server->next_outside);
}
