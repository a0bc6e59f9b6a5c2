#include "common/tile/atlas.h"

#include "common/invariant.h"

#include <stddef.h>
#include <stdlib.h>

static uint32_t tiles_across(uint32_t texels) { return (texels + LW_TILE_SIDE - 1) / LW_TILE_SIDE; }

void lw_atlas_init(struct lw_atlas *atlas, uint32_t width, uint32_t height) {
    *atlas = (struct lw_atlas){0};
    LW_INVARIANT(width > 0 && height > 0);
    for (uint32_t w = width, h = height;;) {
        struct lw_atlas_level *level = &atlas->level[atlas->level_count++];
        *level = (struct lw_atlas_level){.width = w,
                                         .height = h,
                                         .tiles_x = tiles_across(w),
                                         .tiles_y = tiles_across(h),
                                         .first_tile = atlas->tile_count};
        atlas->tile_count += level->tiles_x * level->tiles_y;
        if ((w <= LW_ATLAS_COARSEST && h <= LW_ATLAS_COARSEST) || atlas->level_count == LW_ATLAS_LEVELS_MAX)
            return;
        w = (w + 1) / 2;
        h = (h + 1) / 2;
    }
}

static void place_tiles(struct lw_tile_place *place, const struct lw_atlas *atlas, uint32_t object) {
    const struct lw_tile_place *const first = place;
    for (uint32_t l = 0; l < atlas->level_count; l++) {
        const struct lw_atlas_level *level = &atlas->level[l];
        for (uint32_t y = 0; y < level->tiles_y; y++)
            for (uint32_t x = 0; x < level->tiles_x; x++) {
                uint32_t width = level->width - x * LW_TILE_SIDE, height = level->height - y * LW_TILE_SIDE;
                *place++ = (struct lw_tile_place){.object = object,
                                                  .level = l,
                                                  .x = x,
                                                  .y = y,
                                                  .width = width < LW_TILE_SIDE ? width : LW_TILE_SIDE,
                                                  .height = height < LW_TILE_SIDE ? height : LW_TILE_SIDE};
            }
    }
    LW_INVARIANT(place - first == (ptrdiff_t)atlas->tile_count);
}

enum lw_status lw_atlas_map_init(struct lw_atlas_map *map, const struct lw_scene *scene) {
    const size_t count = scene->object_count ? scene->object_count : 1;
    *map = (struct lw_atlas_map){.object_count = scene->object_count};
    map->atlas = calloc(count, sizeof *map->atlas);
    map->first_tile = calloc(count, sizeof *map->first_tile);
    if (!map->atlas || !map->first_tile) goto fail;
    uint64_t tiles = 0;
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[i].mesh];
        if (mesh->atlas_width && mesh->atlas_height)
            lw_atlas_init(&map->atlas[i], mesh->atlas_width, mesh->atlas_height);
        map->first_tile[i] = (uint32_t)tiles;
        tiles += map->atlas[i].tile_count;
        if (tiles >= UINT32_MAX) goto fail;
    }
    map->tile_count = (uint32_t)tiles;
    map->place = calloc(tiles ? tiles : 1, sizeof *map->place);
    if (!map->place) goto fail;
    for (uint32_t i = 0; i < map->object_count; i++)
        place_tiles(map->place + map->first_tile[i], &map->atlas[i], i);
    return LW_OK;
fail:
    lw_atlas_map_finish(map);
    return LW_NO_MEMORY;
}

void lw_atlas_map_finish(struct lw_atlas_map *map) {
    free(map->place);
    free(map->first_tile);
    free(map->atlas);
    *map = (struct lw_atlas_map){0};
}

lw_tile_id lw_atlas_map_find(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t x,
                             uint32_t y) {
    if (object >= map->object_count || level >= map->atlas[object].level_count)
        return (lw_tile_id){UINT32_MAX};
    const struct lw_atlas_level *l = &map->atlas[object].level[level];
    if (x >= l->tiles_x || y >= l->tiles_y) return (lw_tile_id){UINT32_MAX};
    const lw_tile_id id = {map->first_tile[object] + l->first_tile + y * l->tiles_x + x};
    LW_INVARIANT(id.v < map->tile_count);
    return id;
}

lw_tile_id lw_atlas_map_find_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                  uint32_t tile) {
    if (object >= map->object_count || level >= map->atlas[object].level_count)
        return (lw_tile_id){UINT32_MAX};
    uint32_t tiles_x = map->atlas[object].level[level].tiles_x;
    return lw_atlas_map_find(map, object, level, tile % tiles_x, tile / tiles_x);
}

uint32_t lw_atlas_map_number(const struct lw_atlas_map *map, lw_tile_id id) {
    LW_INVARIANT(id.v < map->tile_count);
    const struct lw_tile_place *place = &map->place[id.v];
    return place->y * map->atlas[place->object].level[place->level].tiles_x + place->x;
}
