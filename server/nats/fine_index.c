#include "server/nats/fine_index.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

static uint32_t room_of(const struct lw_fine_index *index) { return lw_atlas_map_room(index->map); }

static void forget(struct lw_fine_index *index) {
    for (uint32_t i = 0; index->tile && i < room_of(index); i++)
        index->tile[i] = (struct lw_fine_index_tile){.name = UINT64_MAX};
    index->entry_count = 0;
    index->is_sorted = true;
}

void lw_fine_index_init(struct lw_fine_index *index, const struct lw_atlas_map *map) {
    *index = (struct lw_fine_index){.map = map, .is_sorted = true};
}

void lw_fine_index_finish(struct lw_fine_index *index) {
    free(index->tile);
    free(index->entry);
    *index = (struct lw_fine_index){0};
}

static enum lw_status make_room(struct lw_fine_index *index) {
    const uint32_t room = room_of(index);
    if (index->tile) return LW_OK;
    struct lw_fine_index_tile *tile = malloc(room * sizeof *tile);
    struct lw_fine_index_entry *entry = malloc(room * sizeof *entry);
    if (!tile || !entry) {
        free(tile);
        free(entry);
        return LW_NO_MEMORY;
    }
    index->tile = tile;
    index->entry = entry;
    forget(index);
    return LW_OK;
}

/* What its TILE says. */
static enum lw_status read_tile(const struct lw_fine_index *index, const struct lw_blob *blob,
                                struct lw_fine_index_tile *out_tile) {
    struct lw_message message;
    const enum lw_status status = lw_message_decode_whole(blob->bytes, blob->size, &message);
    if (status != LW_OK) return status;
    const struct lw_message_tile *t = &message.tile;
    LW_INVARIANT(message.type == LW_MESSAGE_TILE);
    *out_tile =
        (struct lw_fine_index_tile){.name = lw_atlas_map_name_tile(index->map, t->object, t->level, t->tile),
                                    .object = t->object,
                                    .level = t->level};
    lw_message_finish(&message);
    LW_INVARIANT(out_tile->name != UINT64_MAX);
    return LW_OK;
}

/* before: NULL: there was none */
static enum lw_status follow_tile(struct lw_fine_index *index, uint32_t i,
                                  const struct lw_snapshot_tile *before, const struct lw_snapshot_tile *now) {
    struct lw_fine_index_tile *tile = &index->tile[i], next = {.name = UINT64_MAX};
    if (before && before->blob && before->blob == now->blob) {
        tile->had = now->version;
        return LW_OK;
    }
    const enum lw_status status = now->version ? read_tile(index, now->blob, &next) : LW_OK;
    if (status != LW_OK) return status;
    next.had = before && next.name == tile->name && now->version ? before->version : 0;
    *tile = next;
    return LW_OK;
}

enum lw_status lw_fine_index_follow(struct lw_fine_index *index, uint32_t channel,
                                    const struct lw_snapshot *before, const struct lw_snapshot *snapshot) {
    const uint32_t plain = index->map->plain_count, room = room_of(index);
    enum lw_status status = room ? make_room(index) : LW_OK;
    LW_INVARIANT(lw_snapshot_has(snapshot, channel));
    if (!index->is_whole) before = NULL;
    if (!before) forget(index);
    index->entry_count = 0;
    for (uint32_t i = 0; status == LW_OK && i < room; i++) {
        const struct lw_snapshot_tile *now = &snapshot->tile[channel][plain + i];
        status = follow_tile(index, i, before ? &before->tile[channel][plain + i] : NULL, now);
        if (status == LW_OK && now->version)
            index->entry[index->entry_count++] =
                (struct lw_fine_index_entry){index->tile[i].name, now->version, plain + i};
    }
    index->is_sorted = false;
    index->is_whole = status == LW_OK;
    if (status != LW_OK) forget(index);
    return status;
}

static int compare(const void *left, const void *right) {
    const struct lw_fine_index_entry *a = left, *b = right;
    if (a->name != b->name) return a->name < b->name ? -1 : 1;
    return (a->version < b->version) - (a->version > b->version);
}

uint32_t lw_fine_index_find(struct lw_fine_index *index, uint64_t name) {
    uint32_t low = 0, high = index->entry_count;
    if (!index->is_sorted && high) qsort(index->entry, high, sizeof *index->entry, compare);
    index->is_sorted = true;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (index->entry[middle].name < name)
            low = middle + 1;
        else
            high = middle;
    }
    return low < index->entry_count && index->entry[low].name == name ? index->entry[low].id
                                                                      : LW_FINE_INDEX_NONE;
}
