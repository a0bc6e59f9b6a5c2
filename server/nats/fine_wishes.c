#include "server/nats/fine_wishes.h"

#include "common/base/invariant.h"

#include <stdlib.h>

enum lw_status lw_fine_wishes_add(struct lw_fine_wishes *wishes, const uint64_t *name, size_t count) {
    if (wishes->count + count > wishes->capacity) {
        const size_t capacity = 2 * (wishes->count + count);
        struct lw_fine_wish *grown = realloc(wishes->wish, capacity * sizeof *grown);
        if (!grown) return LW_NO_MEMORY;
        wishes->wish = grown;
        wishes->capacity = capacity;
    }
    for (size_t i = 0; i < count; i++)
        wishes->wish[wishes->count++] = (struct lw_fine_wish){.name = name[i], .turn = i};
    return LW_OK;
}

static int compare_names(const void *left, const void *right) {
    const struct lw_fine_wish *a = left, *b = right;
    if (a->name != b->name) return a->name < b->name ? -1 : 1;
    return (a->turn > b->turn) - (a->turn < b->turn);
}

static int compare_turns(const void *left, const void *right) {
    const struct lw_fine_wish *a = left, *b = right;
    return a->turn != b->turn ? (a->turn > b->turn) - (a->turn < b->turn) : compare_names(left, right);
}

size_t lw_fine_wishes_take(struct lw_fine_wishes *wishes, uint64_t *name, size_t most) {
    struct lw_fine_wish *wish = wishes->wish;
    size_t once = 0, taken = 0;
    if (wishes->count) qsort(wish, wishes->count, sizeof *wish, compare_names);
    for (size_t i = 0; i < wishes->count; i++)
        if (!once || wish[once - 1].name != wish[i].name) wish[once++] = wish[i];
    LW_INVARIANT(once <= wishes->count);
    if (once) qsort(wish, once, sizeof *wish, compare_turns);
    while (taken < once && taken < most) {
        name[taken] = wish[taken].name;
        taken++;
    }
    wishes->count = 0;
    return taken;
}

void lw_fine_wishes_finish(struct lw_fine_wishes *wishes) {
    free(wishes->wish);
    *wishes = (struct lw_fine_wishes){0};
}
