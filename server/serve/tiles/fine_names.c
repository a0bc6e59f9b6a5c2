#include "server/serve/tiles/fine_names.h"

#include "common/base/invariant.h"

#include <stdlib.h>

enum lw_status lw_fine_names_init(struct lw_fine_names *names, const struct lw_atlas_map *atlas_map) {
    *names = (struct lw_fine_names){.map = atlas_map};
    if (!atlas_map->fine) return LW_OK;
    names->name = calloc(lw_atlas_map_room(atlas_map), sizeof *names->name);
    return names->name ? LW_OK : LW_NO_MEMORY;
}

void lw_fine_names_finish(struct lw_fine_names *names) {
    free(names->name);
    *names = (struct lw_fine_names){0};
}

void lw_fine_names_add(struct lw_fine_names *names, const uint32_t *tile, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (tile[i] < names->map->plain_count) continue;
        LW_INVARIANT(lw_atlas_map_is_used(names->map, (lw_tile_id){tile[i]}));
        names->name[tile[i] - names->map->plain_count].lists++;
    }
}

bool lw_fine_names_remove(struct lw_fine_names *names, const uint32_t *tile, uint32_t count) {
    bool any = false;
    for (uint32_t i = 0; i < count; i++) {
        if (tile[i] < names->map->plain_count) continue;
        struct lw_fine_name *name = &names->name[tile[i] - names->map->plain_count];
        LW_INVARIANT(name->lists > 0);
        if (--name->lists) continue;
        name->idle_since = names->interest;
        any = true;
    }
    return any;
}

void lw_fine_names_review(struct lw_fine_names *names, const struct lw_snapshot *snapshot) {
    const struct lw_atlas_map *map = names->map;
    for (uint32_t i = 0; names->name && i < lw_atlas_map_room(map); i++) {
        const struct lw_fine_name *name = &names->name[i];
        const lw_tile_id id = {map->plain_count + i};
        if (name->lists || !lw_atlas_map_is_used(map, id)) continue;
        if (snapshot->interest > name->idle_since && !lw_snapshot_holds_fine(snapshot, i))
            lw_atlas_map_release(map, id);
    }
}
