#include "server/serve/sessions/session_private.h"

#include "common/base/invariant.h"

#include <stdlib.h>

#define AHEAD 32u /* tiles for which a session asks the transcoder at once */

static bool is_coarsest(const struct lw_atlas_map *map, uint32_t tile) {
    return map->place[tile].level + 1 == map->atlas[map->place[tile].object]->level_count;
}

static bool takes_coarse(const struct lw_session_take *t) { return t->is_narrow && !t->refines; }

static const struct lw_snapshot_tile *newest_of(const struct lw_session_take *t, uint32_t tile) {
    return &t->channel->snapshot->tile[t->channel->number][tile];
}

/* The version of a tile that will do. */
static uint64_t due_version(const struct lw_session_take *t, uint32_t tile) {
    const uint64_t newest = newest_of(t, tile)->version;
    LW_INVARIANT_DEAR(newest > 0);
    return takes_coarse(t) ? lw_snapshot_coarse_version(newest) : newest;
}

static bool lacks(const struct lw_session *s, const struct lw_session_take *t, uint32_t tile) {
    const struct lw_atlas_map *map = s->shared->atlas_map;
    const struct lw_snapshot_tile *now = newest_of(t, tile);
    if (tile >= lw_session_tiles(s)) return false;
    if (!now->blob || due_version(t, tile) <= t->sent[tile]) return false;
    /* who looks at everything names no tile, and may know of no finer level */
    if (!s->interest_bits && lw_atlas_finer(map->place[tile].level)) return false;
    if (!s->interest_bits ||
        lw_session_interest_is_set(s->interest_bits + lw_session_interest_words(s), tile))
        return true;
    const bool covers = lw_session_interest_is_set(s->interest_bits, tile);
    if (covers && map->place[tile].level <= LW_ATLAS_READ_MAX) return true;
    if (!covers && !(s->interest.stand_ins && is_coarsest(map, tile))) return false;
    return lw_priority_is_due_to_stand_in(&t->channel->priority, tile, lw_snapshot_frame_of(t->sent[tile]),
                                          lw_snapshot_frame_of(now->version));
}

static void end_walk(struct lw_session_take *t) {
    free(t->lacked);
    t->lacked = NULL;
    t->walk_left = t->walk_cursor = 0;
    t->delta_follows = false;
}

/* Makes the list of what a session lacks of the newest snapshot. */
static void walk_lacked(struct lw_session *s, struct lw_session_take *t) {
    const struct lw_session_shared *shared = s->shared;
    struct lw_priority *priority = &t->channel->priority;
    end_walk(t);
    lw_priority_list_begin(priority);
    for (uint32_t i = 0; i < lw_session_tiles(s); i++) { /* tiles of finer levels come last */
        const uint32_t id = shared->order[i];
        if (!lacks(s, t, id)) continue;
        lw_priority_list(
            priority, id,
            lw_priority_of(priority, id, lw_snapshot_frame_of(t->sent[id]), t->channel->snapshot->frame));
    }
    if (!priority->listed_count) return;
    if (!(t->lacked = malloc(priority->listed_count * sizeof *t->lacked))) {
        lw_session_lacks_memory(s);
        return;
    }
    lw_priority_list_end(priority, t->lacked);
    LW_INVARIANT(priority->listed_count <= shared->atlas_map->tile_count);
    t->walk_left = priority->listed_count;
}

/* A session lacks some of the last snapshot when the next one comes. If its link was full meanwhile, it is
 * narrow. */
static void judge_link(struct lw_session_take *t, bool link_was_full) {
    if (t->judged == t->channel->generation) return;
    t->judged = t->channel->generation;
    if (t->walk_left && link_was_full && t->channel->has_coarse) t->is_narrow = true;
}

/* A session that had everything walks what changed, in the order that all such sessions share. Any other one
 * has a list of its own. */
static void start_walk(struct lw_session *s, struct lw_session_take *t) {
    LW_INVARIANT(t->generation < t->channel->generation);
    const bool had_all = t->walk_left == 0 && t->generation + 1 == t->channel->generation;
    judge_link(t, s->link_was_full);
    t->generation = t->channel->generation;
    t->refines = false;
    if (!had_all) {
        walk_lacked(s, t);
        return;
    }
    end_walk(t);
    t->walk_left = t->channel->changed_count;
}

/* What the link did before counts until the channels' walks have begun. */
static void start_walks(struct lw_session *s) {
    bool is_new = false;
    for (struct lw_session_take *t = s->take; t < s->take + s->take_count; t++) {
        is_new |= t->judged != t->channel->generation;
        if (t->generation == t->channel->generation) continue;
        start_walk(s, t);
        s->settled_due = s->frame_sent > 0; /* a relay may have more of the same frame */
    }
    if (is_new) s->link_was_full = false;
}

struct lw_blob *lw_tile_stream_next_frame(struct lw_session *s) {
    const struct lw_snapshot *snapshot = s->take[0].channel->snapshot;
    LW_INVARIANT_DEAR(s->take_count > 0 && s->frame_sent <= snapshot->frame);
    start_walks(s);
    if (s->frame_sent == snapshot->frame) return NULL;
    bool builds_on = snapshot->frame_delta && s->frame_sent && s->frame_sent == snapshot->previous_frame;
    struct lw_blob *blob = builds_on ? snapshot->frame_delta : snapshot->frame_full;
    s->frame_sent = snapshot->frame;
    s->settled_due = true;
    return blob ? lw_blob_ref(blob) : NULL;
}

/* What it will want next is asked for together. */
static void prepare_ahead(const struct lw_session *s, const struct lw_session_take *t, const uint32_t *list) {
    const uint32_t count = t->walk_left < AHEAD ? t->walk_left : AHEAD;
    for (uint32_t i = 1; i < count; i++) {
        const uint32_t id = list[t->walk_cursor + i];
        if (lacks(s, t, id)) lw_deltas_prepare(&t->channel->deltas, id, t->sent[id], takes_coarse(t));
    }
}

static struct lw_blob *next_tile_of_walk(struct lw_session *s, struct lw_session_take *t) {
    const uint32_t *list = t->lacked ? t->lacked : t->channel->changed;
    LW_INVARIANT_DEAR(t->generation == t->channel->generation); /* the list is of this snapshot */
    LW_INVARIANT_DEAR(t->lacked || !t->walk_left ||
                      t->walk_cursor + t->walk_left <= t->channel->changed_count);
    for (; t->walk_left; t->walk_cursor++, t->walk_left--) {
        const uint32_t id = list[t->walk_cursor];
        if (!t->delta_follows && !lacks(s, t, id)) continue;
        struct lw_delta delta;
        if (lw_deltas_next(&t->channel->deltas, id, t->sent[id], takes_coarse(t), &delta) == LW_DELTAS_WAIT) {
            prepare_ahead(s, t, list);
            s->waits = true;
            return NULL;
        }
        LW_INVARIANT(delta.version > t->sent[id]);
        LW_INVARIANT_DEAR(delta.version <= newest_of(t, id)->version);
        t->sent[id] = delta.version;
        t->delta_follows = delta.version < due_version(t, id);
        if (!t->delta_follows) {
            t->walk_cursor++;
            t->walk_left--;
        }
        return lw_blob_ref(delta.blob);
    }
    end_walk(t);
    return NULL;
}

/* A narrow session that has all coarse tiles goes on with finer ones, until it has all, or a new snapshot
 * comes. */
static struct lw_blob *next_tile_of(struct lw_session *s, struct lw_session_take *t) {
    struct lw_blob *blob = next_tile_of_walk(s, t);
    if (blob || s->waits || !t->is_narrow) return blob;
    if (!t->refines) {
        t->refines = true;
        walk_lacked(s, t);
        if ((blob = next_tile_of_walk(s, t)) || s->waits) return blob;
    }
    t->is_narrow = t->refines = false;
    return NULL;
}

struct lw_blob *lw_tile_stream_next_tile(struct lw_session *s) {
    struct lw_blob *blob = NULL;
    for (struct lw_session_take *t = s->take; t < s->take + s->take_count && !blob && !s->waits; t++)
        blob = next_tile_of(s, t);
    return blob;
}

/* Once no tile is left. */
struct lw_blob *lw_tile_stream_next_settled(struct lw_session *s) {
    if (!s->settled_due || s->waits || s->lacks_memory) return NULL;
    const struct lw_snapshot *snapshot = s->take[0].channel->snapshot;
    for (uint32_t i = 0; i < s->take_count; i++)
        if (snapshot->unsettled >> s->take[i].channel->number & 1) return NULL; /* a later one says it */
    s->settled_due = false;
    return snapshot->settled ? lw_blob_ref(snapshot->settled) : NULL;
}

/* A new session waits for a snapshot with its channels: an older one may be of a time when another session
 * took them. It waits also for the frame that its peer has from another relay. */
bool lw_tile_stream_has_light(const struct lw_session *s) {
    bool has = true;
    for (const struct lw_session_take *t = s->take; t < s->take + s->take_count; t++)
        has &= t->channel->snapshot && (s->frame_sent || t->channel->snapshot == s->shared->snapshot) &&
               t->channel->snapshot->frame >= s->frame_held;
    return has;
}
