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
    free(want->told.tile);
    want->told = (struct lw_want_list){.everything = true};
    want->told_ns = 0;
}

static int by_id(const void *a, const void *b) {
    const lw_tile_id *x = a, *y = b;
    return (x->v > y->v) - (x->v < y->v);
}

enum lw_status lw_want_set(struct lw_want *want, const lw_tile_id *tile, size_t count, uint32_t most) {
    lw_tile_id *sorted = malloc((count + 1) * sizeof *sorted);
    if (!sorted) return LW_NO_MEMORY;
    uint32_t different = 0;
    if (count) {
        memcpy(sorted, tile, count * sizeof *sorted);
        qsort(sorted, count, sizeof *sorted, by_id);
        for (size_t i = 0; i < count; i++)
            if (different == 0 || sorted[i].v != sorted[different - 1].v) sorted[different++] = sorted[i];
    }
    free(want->now.tile);
    want->now = (struct lw_want_list){.count = different, .tile = sorted};
    if (different > most) lw_want_set_everything(want);
    return LW_OK;
}

void lw_want_set_everything(struct lw_want *want) {
    free(want->now.tile);
    want->now = (struct lw_want_list){.everything = true};
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
    lw_tile_id *copy = malloc(((size_t)want->now.count + 1) * sizeof *copy);
    if (!copy) return LW_NO_MEMORY;
    if (want->now.count) memcpy(copy, want->now.tile, want->now.count * sizeof *copy);
    free(want->told.tile);
    want->told = want->now;
    want->told.tile = copy;
    want->told_ns = now_ns;
    return LW_OK;
}
