#include "client/lib/interest.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

void lw_interest_init(struct lw_interest *interest) {
    *interest = (struct lw_interest){.now.everything = true, .sent.everything = true};
}

void lw_interest_finish(struct lw_interest *interest) {
    free(interest->now.tile);
    free(interest->sent.tile);
    *interest = (struct lw_interest){0};
}

void lw_interest_forget(struct lw_interest *interest) {
    interest->sent.everything = true;
    interest->sent.count = 0;
    interest->sent_ns = 0;
}

/* Tiles: as many as a list that is sent has at most, so that it never grows while a view moves. */
#define ROOM_MIN 4096u

static bool make_room(struct lw_interest_list *list, size_t count) {
    if (count <= list->capacity) return true;
    if (count < ROOM_MIN) count = ROOM_MIN;
    lw_tile_id *grown = realloc(list->tile, count * sizeof *grown);
    if (!grown) return false;
    list->tile = grown;
    list->capacity = count;
    return true;
}

/* Shell's sort, by Ciura's gaps: qsort() may allocate. A list that is sorted already costs one look at each
 * tile and gap. */
static void sort(lw_tile_id *tile, size_t count) {
    static const uint16_t gaps[] = {1750, 701, 301, 132, 57, 23, 10, 4, 1};
    for (size_t g = 0; g < sizeof gaps / sizeof *gaps; g++)
        for (size_t i = gaps[g]; i < count; i++) {
            const lw_tile_id moved = tile[i];
            size_t to = i;
            for (; to >= gaps[g] && tile[to - gaps[g]].v > moved.v; to -= gaps[g])
                tile[to] = tile[to - gaps[g]];
            tile[to] = moved;
        }
}

/* Ascending, each tile once. */
static bool is_in_order(const struct lw_interest_list *list) {
    for (uint32_t i = 1; i < list->count; i++)
        if (list->tile[i - 1].v >= list->tile[i].v) return false;
    return list->count <= list->capacity && !(list->everything && list->count);
}

enum lw_status lw_interest_set(struct lw_interest *interest, const lw_tile_id *tile, size_t count,
                               uint32_t most) {
    struct lw_interest_list *now = &interest->now;
    if (!make_room(now, count)) return LW_NO_MEMORY;
    uint32_t different = 0;
    if (count) {
        memcpy(now->tile, tile, count * sizeof *tile);
        sort(now->tile, count);
        for (size_t i = 0; i < count; i++)
            if (different == 0 || now->tile[i].v != now->tile[different - 1].v)
                now->tile[different++] = now->tile[i];
    }
    now->everything = different > most;
    now->count = now->everything ? 0 : different;
    LW_INVARIANT_DEAR(is_in_order(now));
    return LW_OK;
}

void lw_interest_set_everything(struct lw_interest *interest) {
    interest->now.everything = true;
    interest->now.count = 0;
}

/* How many of a's tiles b lacks. */
static uint32_t count_lacking(const struct lw_interest_list *a, const struct lw_interest_list *b) {
    uint32_t lacking = 0;
    for (uint32_t i = 0, j = 0; i < a->count; i++) {
        while (j < b->count && b->tile[j].v < a->tile[i].v) j++;
        lacking += j == b->count || b->tile[j].v != a->tile[i].v;
    }
    return lacking;
}

bool lw_interest_lists(const struct lw_interest *interest, lw_tile_id tile) {
    const struct lw_interest_list *now = &interest->now, *sent = &interest->sent;
    return lw_tile_id_is_in(now->tile, now->count, tile) || lw_tile_id_is_in(sent->tile, sent->count, tile);
}

bool lw_interest_is_due(const struct lw_interest *interest, uint64_t now_ns) {
    const struct lw_interest_list *now = &interest->now, *sent = &interest->sent;
    const uint64_t since_ns = now_ns - interest->sent_ns;
    LW_INVARIANT(now_ns >= interest->sent_ns);
    LW_INVARIANT_DEAR(is_in_order(now) && is_in_order(sent));
    if (since_ns < LW_INTEREST_TELL_NS) return false;
    if (now->everything || sent->everything) return now->everything != sent->everything;
    if (count_lacking(now, sent)) return true;
    LW_INVARIANT(sent->count >= now->count);
    const uint32_t shed = sent->count - now->count; /* the server knows all tiles of the set */
    return shed && (shed >= (sent->count + LW_INTEREST_SHED_ONE - 1) / LW_INTEREST_SHED_ONE ||
                    since_ns >= LW_INTEREST_SHED_NS);
}

enum lw_status lw_interest_tell(struct lw_interest *interest, uint64_t now_ns) {
    struct lw_interest_list *now = &interest->now, *sent = &interest->sent;
    if (!make_room(sent, now->count)) return LW_NO_MEMORY;
    if (now->count) memcpy(sent->tile, now->tile, now->count * sizeof *now->tile);
    sent->everything = now->everything;
    sent->count = now->count;
    LW_INVARIANT_DEAR(is_in_order(sent));
    LW_INVARIANT(now_ns >= interest->sent_ns);
    interest->sent_ns = now_ns;
    return LW_OK;
}
