#include "server/serve/wanted.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

enum lw_status lw_wanted_init(struct lw_wanted *wanted, const struct lw_atlas_map *atlas_map) {
    *wanted = (struct lw_wanted){.atlas_map = atlas_map};
    wanted->count = calloc((size_t)atlas_map->tile_count + 1, sizeof *wanted->count);
    return wanted->count ? LW_OK : LW_NO_MEMORY;
}

void lw_wanted_finish(struct lw_wanted *wanted) {
    free(wanted->count);
    *wanted = (struct lw_wanted){0};
}

void lw_wanted_add_everything(struct lw_wanted *wanted) { wanted->changed |= wanted->everything++ == 0; }

void lw_wanted_remove_everything(struct lw_wanted *wanted) {
    assert(wanted->everything > 0);
    wanted->changed |= --wanted->everything == 0;
}

void lw_wanted_add(struct lw_wanted *wanted, const uint32_t *tile, size_t count) {
    for (size_t i = 0; i < count; i++) wanted->changed |= wanted->count[tile[i]]++ == 0;
}

void lw_wanted_remove(struct lw_wanted *wanted, const uint32_t *tile, size_t count) {
    for (size_t i = 0; i < count; i++) {
        assert(wanted->count[tile[i]] > 0);
        wanted->changed |= --wanted->count[tile[i]] == 0;
    }
}

static void cover(const struct lw_atlas_map *map, uint32_t tile, uint8_t *out_levels) {
    const struct lw_tile_place *place = &map->place[tile];
    const struct lw_atlas_level *fine = &map->atlas[place->object].level[0];
    const uint32_t side = 1u << place->level, x0 = place->x * side, y0 = place->y * side;
    for (uint32_t y = y0; y < y0 + side && y < fine->tiles_y; y++)
        for (uint32_t x = x0; x < x0 + side && x < fine->tiles_x; x++) {
            uint8_t *level =
                &out_levels[map->first_tile[place->object] + fine->first_tile + y * fine->tiles_x + x];
            if (!*level || *level > place->level + 1) *level = (uint8_t)(place->level + 1);
        }
}

void lw_wanted_levels(const struct lw_wanted *wanted, uint8_t *out_levels) {
    const struct lw_atlas_map *map = wanted->atlas_map;
    memset(out_levels, 0, map->tile_count);
    for (uint32_t tile = 0; tile < map->tile_count; tile++)
        if (wanted->count[tile]) cover(map, tile, out_levels);
}
