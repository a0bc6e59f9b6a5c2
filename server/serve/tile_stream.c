#include "server/serve/session_private.h"

#include <stdlib.h>

#define AHEAD 32u /* tiles for which a session asks the transcoder at once */

static bool is_coarsest(const struct lw_atlas_map *map, uint32_t tile) {
    return map->place[tile].level + 1 == map->atlas[map->place[tile].object].level_count;
}

static bool takes_coarse(const struct lw_session *s) { return s->is_narrow && !s->refines; }

static const struct lw_snapshot_tile *newest_of(const struct lw_session *s, uint32_t tile) {
    return &s->form->snapshot->tile[s->form->form][tile];
}

/* The version of a tile that will do. */
static uint64_t due_version(const struct lw_session *s, uint32_t tile) {
    const uint64_t newest = newest_of(s, tile)->version;
    return takes_coarse(s) ? lw_snapshot_coarse_version(newest) : newest;
}

static bool lacks(const struct lw_session *s, uint32_t tile) {
    const struct lw_atlas_map *map = s->shared->atlas_map;
    const struct lw_snapshot_tile *now = newest_of(s, tile);
    if (!now->blob || due_version(s, tile) <= s->sent[tile]) return false;
    if (!s->interest_bits ||
        lw_session_interest_is_set(s->interest_bits + lw_session_interest_words(s), tile))
        return true;
    const bool covers = lw_session_interest_is_set(s->interest_bits, tile);
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
        lw_session_lacks_memory(s);
        return;
    }
    lw_priority_list_end(priority, s->lacked);
    s->walk_left = priority->listed_count;
}

/* A session lacks some of the last snapshot when the next one comes. If its link was full meanwhile, it is
 * narrow. */
static void judge_link(struct lw_session *s) {
    if (s->judged == s->form->generation) return;
    s->judged = s->form->generation;
    if (s->walk_left && s->link_was_full && s->form->transcoder) s->is_narrow = true;
    s->link_was_full = false;
}

/* A session that had everything walks what changed, in the order that all such sessions share. Any other one
 * has a list of its own. */
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

struct lw_blob *lw_tile_stream_next_frame(struct lw_session *s) {
    const struct lw_snapshot *snapshot = s->form->snapshot;
    if (s->generation != s->form->generation) start_walk(s);
    if (s->frame_sent == snapshot->frame) return NULL;
    bool builds_on = snapshot->frame_delta && s->frame_sent && s->frame_sent == snapshot->previous_frame;
    struct lw_blob *blob = builds_on ? snapshot->frame_delta : snapshot->frame_full;
    s->frame_sent = snapshot->frame;
    s->settled_due = true;
    return blob ? lw_blob_ref(blob) : NULL;
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
        s->delta_follows = delta.version < due_version(s, id);
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
struct lw_blob *lw_tile_stream_next_tile(struct lw_session *s) {
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
struct lw_blob *lw_tile_stream_next_settled(struct lw_session *s) {
    if (!s->settled_due || s->waits || s->lacks_memory) return NULL;
    s->settled_due = false;
    return s->form->snapshot->settled ? lw_blob_ref(s->form->snapshot->settled) : NULL;
}

/* A new session waits for a snapshot with its form: an older one may be of a time when another session took
 * that form. */
bool lw_tile_stream_has_light(const struct lw_session *s) {
    return s->form->snapshot && (s->frame_sent || s->form->snapshot == s->shared->snapshot);
}
