#include "common/tile/fine_ids.h"

#include "common/base/invariant.h"

#include <stdatomic.h>
#include <stdlib.h>

struct entry {
    uint64_t name;
    uint32_t next; /* in its bucket, or among the free ones */
    bool is_claimed;
};

struct lw_fine_ids {
    uint32_t room;
    _Atomic uint32_t free_count;
    uint32_t first_free, last_free;
    struct lw_tile_place *place; /* per id */
    struct entry *entry;         /* per id */
    _Atomic uint32_t *bucket;    /* a power of two of them */
    uint32_t bucket_bits;
    atomic_flag is_claiming;
};

/* Fibonacci hashing: the golden ratio of 2^64 spreads names that follow one another. */
static uint32_t bucket_of(const struct lw_fine_ids *ids, uint64_t name) {
    return (uint32_t)(name * 0x9e3779b97f4a7c15ull >> (64 - ids->bucket_bits));
}

enum lw_status lw_fine_ids_create(uint32_t room, struct lw_tile_place *place, struct lw_fine_ids **out_ids) {
    struct lw_fine_ids *ids = calloc(1, sizeof *ids);
    LW_INVARIANT(room > 0 && room < LW_FINE_IDS_NONE / 4);
    if (!ids) return LW_NO_MEMORY;
    ids->room = room;
    ids->free_count = room;
    ids->last_free = room - 1;
    ids->place = place;
    for (ids->bucket_bits = 1; 1u << ids->bucket_bits < 2 * room;) ids->bucket_bits++;
    ids->entry = calloc(room, sizeof *ids->entry);
    ids->bucket = malloc((1ul << ids->bucket_bits) * sizeof *ids->bucket);
    if (!ids->entry || !ids->bucket) {
        lw_fine_ids_destroy(ids);
        return LW_NO_MEMORY;
    }
    for (uint32_t i = 0; i < room; i++) ids->entry[i].next = i + 1 < room ? i + 1 : LW_FINE_IDS_NONE;
    for (uint32_t b = 0; b < 1u << ids->bucket_bits; b++) ids->bucket[b] = LW_FINE_IDS_NONE;
    *out_ids = ids;
    return LW_OK;
}

void lw_fine_ids_destroy(struct lw_fine_ids *ids) {
    if (!ids) return;
    free(ids->entry);
    free(ids->bucket);
    free(ids);
}

uint32_t lw_fine_ids_find(const struct lw_fine_ids *ids, uint64_t name) {
    uint32_t id = atomic_load_explicit(&ids->bucket[bucket_of(ids, name)], memory_order_acquire);
    while (id != LW_FINE_IDS_NONE && ids->entry[id].name != name) id = ids->entry[id].next;
    return id;
}

/* The id for a name that has none. An entry is whole before its bucket leads to it: finding needs no lock. */
static uint32_t take_free(struct lw_fine_ids *ids, uint64_t name, const struct lw_tile_place *place) {
    const uint32_t id = ids->first_free, b = bucket_of(ids, name);
    if (!ids->free_count) return LW_FINE_IDS_NONE;
    LW_INVARIANT(id < ids->room && !ids->entry[id].is_claimed);
    ids->first_free = ids->entry[id].next;
    ids->free_count--;
    ids->entry[id] = (struct entry){name, ids->bucket[b], true};
    ids->place[id] = *place;
    atomic_store_explicit(&ids->bucket[b], id, memory_order_release);
    return id;
}

uint32_t lw_fine_ids_claim(struct lw_fine_ids *ids, uint64_t name, const struct lw_tile_place *place) {
    uint32_t id = lw_fine_ids_find(ids, name);
    if (id != LW_FINE_IDS_NONE) return id;
    while (atomic_flag_test_and_set_explicit(&ids->is_claiming, memory_order_acquire)) continue;
    id = lw_fine_ids_find(ids, name); /* another thread may have claimed it meanwhile */
    if (id == LW_FINE_IDS_NONE) id = take_free(ids, name, place);
    atomic_flag_clear_explicit(&ids->is_claiming, memory_order_release);
    return id;
}

static void leave_bucket(struct lw_fine_ids *ids, uint32_t id) {
    const uint32_t b = bucket_of(ids, ids->entry[id].name), after = ids->entry[id].next;
    uint32_t before = ids->bucket[b];
    if (before == id) {
        ids->bucket[b] = after;
        return;
    }
    while (ids->entry[before].next != id) before = ids->entry[before].next;
    ids->entry[before].next = after;
}

void lw_fine_ids_release(struct lw_fine_ids *ids, uint32_t id) {
    LW_INVARIANT(lw_fine_ids_is_claimed(ids, id) && ids->free_count < ids->room);
    leave_bucket(ids, id);
    ids->entry[id] = (struct entry){.next = LW_FINE_IDS_NONE};
    if (ids->free_count++)
        ids->entry[ids->last_free].next = id;
    else
        ids->first_free = id;
    ids->last_free = id;
}

bool lw_fine_ids_is_claimed(const struct lw_fine_ids *ids, uint32_t id) {
    return id < ids->room && ids->entry[id].is_claimed;
}

uint32_t lw_fine_ids_free_count(const struct lw_fine_ids *ids) { return ids->free_count; }
