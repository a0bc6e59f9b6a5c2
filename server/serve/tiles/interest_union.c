#include "server/serve/tiles/interest_union.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

enum lw_status lw_interest_union_init(struct lw_interest_union *interest_union,
                                      const struct lw_atlas_map *atlas_map) {
    *interest_union = (struct lw_interest_union){.atlas_map = atlas_map};
    interest_union->count = calloc((size_t)atlas_map->tile_count + 1, sizeof *interest_union->count);
    return interest_union->count ? LW_OK : LW_NO_MEMORY;
}

void lw_interest_union_finish(struct lw_interest_union *interest_union) {
    free(interest_union->count);
    *interest_union = (struct lw_interest_union){0};
}

void lw_interest_union_add_everything(struct lw_interest_union *interest_union) {
    interest_union->changed |= interest_union->everything++ == 0;
}

void lw_interest_union_remove_everything(struct lw_interest_union *interest_union) {
    LW_INVARIANT(interest_union->everything > 0);
    interest_union->changed |= --interest_union->everything == 0;
}

void lw_interest_union_add(struct lw_interest_union *interest_union, const uint32_t *tile, size_t count) {
    for (size_t i = 0; i < count; i++) {
        LW_INVARIANT(tile[i] < interest_union->atlas_map->tile_count);
        interest_union->changed |= interest_union->count[tile[i]]++ == 0;
    }
}

void lw_interest_union_remove(struct lw_interest_union *interest_union, const uint32_t *tile, size_t count) {
    for (size_t i = 0; i < count; i++) {
        LW_INVARIANT(tile[i] < interest_union->atlas_map->tile_count);
        LW_INVARIANT(interest_union->count[tile[i]] > 0);
        interest_union->changed |= --interest_union->count[tile[i]] == 0;
    }
}

/* Interest in a tile of a finer level is interest in the tile of level 0 below it, which is shown until the
 * finer tile has light. */
static void cover_finer(const struct lw_atlas_map *map, uint32_t tile, uint8_t *out_levels) {
    out_levels[tile] = 1;
    out_levels[lw_atlas_map_below(map, (lw_tile_id){tile}).v] = 1;
}

static void cover(const struct lw_atlas_map *map, uint32_t tile, uint8_t *out_levels) {
    const struct lw_tile_place *place = &map->place[tile];
    const struct lw_atlas_level *fine = &map->atlas[place->object]->level[0];
    const uint32_t side = 1u << place->level, x0 = place->x * side, y0 = place->y * side;
    LW_INVARIANT(x0 < fine->tiles_x && y0 < fine->tiles_y); /* a tile covers something */
    for (uint32_t y = y0; y < y0 + side && y < fine->tiles_y; y++)
        for (uint32_t x = x0; x < x0 + side && x < fine->tiles_x; x++) {
            uint8_t *level =
                &out_levels[map->first_tile[place->object] + fine->first_tile + y * fine->tiles_x + x];
            if (!*level || *level > place->level + 1) *level = (uint8_t)(place->level + 1);
        }
}

void lw_interest_union_levels(const struct lw_interest_union *interest_union, uint8_t *out_levels) {
    const struct lw_atlas_map *map = interest_union->atlas_map;
    memset(out_levels, 0, map->tile_count);
    for (uint32_t tile = 0; tile < map->tile_count; tile++)
        if (interest_union->count[tile])
            (lw_atlas_finer(map->place[tile].level) ? cover_finer : cover)(map, tile, out_levels);
}
