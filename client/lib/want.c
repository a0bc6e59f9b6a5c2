#include "client/lib/want.h"

#include <stdlib.h>
#include <string.h>

void lw_want_init(struct lw_want *want) {
    *want = (struct lw_want){.now.everything = true, .told.everything = true};
}

void lw_want_finish(struct lw_want *want) {
    free(want->now.tile);
    free(want->told.tile);
    *want = (struct lw_want){0};
}

void lw_want_forget(struct lw_want *want) {
    want->told.everything = true;
    want->told.count = 0;
    want->told_ns = 0;
}

#define ROOM_MIN                                                                                             \
    4096u /* tiles: as many as a list that is told has at most, so that it never grows while a view moves */

static bool make_room(struct lw_want_list *list, size_t count) {
    if (count <= list->capacity) return true;
    if (count < ROOM_MIN) count = ROOM_MIN;
    lw_tile_id *grown = realloc(list->tile, count * sizeof *grown);
    if (!grown) return false;
    list->tile = grown;
    list->capacity = count;
    return true;
}

/* Shell's sort, by Ciura's gaps: qsort() may allocate. A list that is sorted already costs one look at each tile and gap. */
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

enum lw_status lw_want_set(struct lw_want *want, const lw_tile_id *tile, size_t count, uint32_t most) {
    struct lw_want_list *now = &want->now;
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
    return LW_OK;
}

void lw_want_set_everything(struct lw_want *want) {
    want->now.everything = true;
    want->now.count = 0;
}

/* How many of a's tiles b lacks. */
static uint32_t count_lacking(const struct lw_want_list *a, const struct lw_want_list *b) {
    uint32_t lacking = 0;
    for (uint32_t i = 0, j = 0; i < a->count; i++) {
        while (j < b->count && b->tile[j].v < a->tile[i].v) j++;
        lacking += j == b->count || b->tile[j].v != a->tile[i].v;
    }
    return lacking;
}

bool lw_want_is_due(const struct lw_want *want, uint64_t now_ns) {
    const struct lw_want_list *now = &want->now, *told = &want->told;
    const uint64_t since_ns = now_ns - want->told_ns;
    if (since_ns < LW_WANT_TELL_NS) return false;
    if (now->everything || told->everything) return now->everything != told->everything;
    if (count_lacking(now, told)) return true;
    const uint32_t shed = told->count - now->count; /* now has nothing that told lacks */
    return shed &&
           (shed >= (told->count + LW_WANT_SHED_ONE - 1) / LW_WANT_SHED_ONE || since_ns >= LW_WANT_SHED_NS);
}

enum lw_status lw_want_tell(struct lw_want *want, uint64_t now_ns) {
    struct lw_want_list *now = &want->now, *told = &want->told;
    if (!make_room(told, now->count)) return LW_NO_MEMORY;
    if (now->count) memcpy(told->tile, now->tile, now->count * sizeof *now->tile);
    told->everything = now->everything;
    told->count = now->count;
    want->told_ns = now_ns;
    return LW_OK;
}
