#include "relay/relay_fine.h"

#include "common/base/invariant.h"

#include <stdlib.h>

enum lw_status lw_relay_fine_init(struct lw_relay_fine *fine, const struct lw_atlas_map *map) {
    const uint32_t room = lw_atlas_map_room(map);
    *fine = (struct lw_relay_fine){.map = map};
    if (!room) return LW_OK;
    fine->tile = calloc(room, sizeof *fine->tile);
    fine->held = malloc(room * sizeof *fine->held);
    if (fine->tile && fine->held) return LW_OK;
    lw_relay_fine_finish(fine);
    return LW_NO_MEMORY;
}

void lw_relay_fine_finish(struct lw_relay_fine *fine) {
    free(fine->tile);
    free(fine->held);
    *fine = (struct lw_relay_fine){0};
}

static int compare(const void *left, const void *right) {
    const struct lw_relay_fine_name *a = left, *b = right;
    return (a->name > b->name) - (a->name < b->name);
}

static void note_held(struct lw_relay_fine *fine) {
    const struct lw_atlas_map *map = fine->map;
    fine->held_count = 0;
    for (uint32_t id = map->plain_count; id < map->tile_count; id++)
        if (lw_relay_fine_is_held(fine, id))
            fine->held[fine->held_count++] =
                (struct lw_relay_fine_name){lw_relay_fine_tile(fine, id)->name, id};
    qsort(fine->held, fine->held_count, sizeof *fine->held, compare);
}

void lw_relay_fine_list(struct lw_relay_fine *fine, uint64_t number, const uint32_t *tile, uint32_t count) {
    const struct lw_atlas_map *map = fine->map;
    LW_INVARIANT(number > fine->interest);
    fine->interest = number;
    if (!fine->tile) return;
    for (uint32_t i = 0; i < lw_atlas_map_room(map); i++) fine->tile[i].is_listed = false;
    for (uint32_t i = 0; i < count; i++) {
        if (tile[i] < map->plain_count) continue;
        struct lw_relay_fine_tile *listed = lw_relay_fine_tile(fine, tile[i]);
        const uint64_t name = lw_atlas_map_name(map, (lw_tile_id){tile[i]});
        LW_INVARIANT(listed->name == name || !listed->asked); /* ids that are held keep their tile */
        listed->name = name;
        listed->is_listed = true;
    }
    note_held(fine);
}

void lw_relay_fine_ask(struct lw_relay_fine *fine, uint32_t channel, const lw_tile_id *tile, uint32_t count) {
    const struct lw_atlas_map *map = fine->map;
    const uint32_t bit = 1u << channel;
    if (!fine->tile) return;
    for (uint32_t i = 0; i < lw_atlas_map_room(map); i++) fine->tile[i].asked &= ~bit;
    for (uint32_t i = 0; i < count; i++)
        if (tile[i].v >= map->plain_count) lw_relay_fine_tile(fine, tile[i].v)->asked |= bit;
    note_held(fine);
}

uint32_t lw_relay_fine_find(const struct lw_relay_fine *fine, uint64_t name) {
    const struct lw_relay_fine_name key = {.name = name}, *found = NULL;
    if (fine->held_count) found = bsearch(&key, fine->held, fine->held_count, sizeof key, compare);
    return found ? found->id : UINT32_MAX;
}
