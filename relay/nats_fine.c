#include "relay/nats_fine.h"

#include "common/base/invariant.h"

#include <stdlib.h>

static int compare(const void *left, const void *right) {
    const struct lw_nats_fine_tile *a = left, *b = right;
    return (a->name > b->name) - (a->name < b->name);
}

void lw_nats_fine_list(struct lw_nats_fine *fine, const struct lw_atlas_map *map,
                       const struct lw_message_interest *interest) {
    uint32_t listed = 0, once = 0;
    for (size_t i = 0; interest && i < interest->tile_count && listed < LW_NATS_WIRE_FINE_MAX; i++) {
        const struct lw_message_interest_tile *t = &interest->tile[i];
        const uint64_t name = lw_atlas_map_name_tile(map, t->object, t->level, t->tile);
        if (name != UINT64_MAX)
            fine->tile[listed++] = (struct lw_nats_fine_tile){name, t->object, t->level, t->tile};
    }
    qsort(fine->tile, listed, sizeof *fine->tile, compare);
    for (uint32_t i = 0; i < listed; i++)
        if (!once || fine->tile[once - 1].name != fine->tile[i].name) fine->tile[once++] = fine->tile[i];
    LW_INVARIANT(once <= listed);
    fine->count = once;
}

uint32_t lw_nats_fine_find(const struct lw_nats_fine *fine, uint64_t name) {
    const struct lw_nats_fine_tile key = {.name = name},
                                   *found = bsearch(&key, fine->tile, fine->count, sizeof key, compare);
    return found ? (uint32_t)(found - fine->tile) : LW_NATS_FINE_NONE;
}
