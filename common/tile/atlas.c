#include "common/tile/atlas.h"

#include "common/invariant.h"

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

void lw_atlas_refine(struct lw_atlas *atlas, uint32_t count) {
    LW_INVARIANT(atlas->level_count > 0 && count <= LW_ATLAS_FINER_MAX);
    while (atlas->finer_count < count) {
        struct lw_atlas_level *level = &atlas->finer[atlas->finer_count++];
        const uint32_t w = atlas->level[0].width << atlas->finer_count,
                       h = atlas->level[0].height << atlas->finer_count;
        *level = (struct lw_atlas_level){.width = w,
                                         .height = h,
                                         .tiles_x = tiles_across(w),
                                         .tiles_y = tiles_across(h),
                                         .first_tile = atlas->finer_tile_count};
        atlas->finer_tile_count += level->tiles_x * level->tiles_y;
    }
}

const struct lw_atlas_level *lw_atlas_level(const struct lw_atlas *atlas, uint32_t level) {
    if (level < atlas->level_count) return &atlas->level[level];
    const uint32_t finer = lw_atlas_finer(level);
    return finer && finer <= atlas->finer_count ? &atlas->finer[finer - 1] : NULL;
}

static struct lw_tile_place *place_level(struct lw_tile_place *place, const struct lw_atlas_level *level,
                                         uint32_t object, uint32_t number) {
    for (uint32_t y = 0; y < level->tiles_y; y++)
        for (uint32_t x = 0; x < level->tiles_x; x++) {
            uint32_t width = level->width - x * LW_TILE_SIDE, height = level->height - y * LW_TILE_SIDE;
            *place++ = (struct lw_tile_place){.object = object,
                                              .level = number,
                                              .x = x,
                                              .y = y,
                                              .width = width < LW_TILE_SIDE ? width : LW_TILE_SIDE,
                                              .height = height < LW_TILE_SIDE ? height : LW_TILE_SIDE};
        }
    return place;
}

static void place_tiles(const struct lw_atlas_map *map, uint32_t object) {
    const struct lw_atlas *atlas = &map->atlas[object];
    struct lw_tile_place *place = map->place + map->first_tile[object];
    for (uint32_t l = 0; l < atlas->level_count; l++) place = place_level(place, &atlas->level[l], object, l);
    LW_INVARIANT(place == map->place + map->first_tile[object] + atlas->tile_count);
    place = map->place + map->first_finer[object];
    for (uint32_t k = 1; k <= atlas->finer_count; k++)
        place = place_level(place, &atlas->finer[k - 1], object, LW_ATLAS_FINER + k);
    LW_INVARIANT(place == map->place + map->first_finer[object] + atlas->finer_tile_count);
}

/* Tiles of the finer levels of an atlas, before they have numbers of 32 bits. */
static uint64_t count_finer(const struct lw_atlas *atlas, uint32_t finer) {
    uint64_t tiles = 0;
    for (uint32_t k = 1; k <= finer; k++)
        tiles +=
            (uint64_t)tiles_across(atlas->level[0].width << k) * tiles_across(atlas->level[0].height << k);
    return tiles;
}

enum lw_status lw_atlas_map_init(struct lw_atlas_map *map, const struct lw_scene *scene) {
    return lw_atlas_map_init_finer(map, scene, 0);
}

enum lw_status lw_atlas_map_init_finer(struct lw_atlas_map *map, const struct lw_scene *scene,
                                       uint32_t finer) {
    const size_t count = scene->object_count ? scene->object_count : 1;
    LW_INVARIANT(finer <= LW_ATLAS_FINER_MAX);
    *map = (struct lw_atlas_map){.object_count = scene->object_count, .finer_count = finer};
    map->atlas = calloc(count, sizeof *map->atlas);
    map->first_tile = calloc(count, sizeof *map->first_tile);
    map->first_finer = calloc(count, sizeof *map->first_finer);
    if (!map->atlas || !map->first_tile || !map->first_finer) goto fail;
    uint64_t tiles = 0;
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[i].mesh];
        struct lw_atlas *atlas = &map->atlas[i];
        map->first_tile[i] = (uint32_t)tiles;
        if (!mesh->atlas_width || !mesh->atlas_height) continue;
        lw_atlas_init(atlas, mesh->atlas_width, mesh->atlas_height);
        tiles += atlas->tile_count;
        if (tiles >= UINT32_MAX) goto fail;
    }
    map->plain_count = (uint32_t)tiles;
    for (uint32_t i = 0; i < scene->object_count; i++) {
        struct lw_atlas *atlas = &map->atlas[i];
        map->first_finer[i] = (uint32_t)tiles;
        if (atlas->level_count) tiles += count_finer(atlas, finer);
        if (tiles >= UINT32_MAX) goto fail;
        if (atlas->level_count) lw_atlas_refine(atlas, finer);
    }
    map->tile_count = (uint32_t)tiles;
    map->place = calloc(tiles ? tiles : 1, sizeof *map->place);
    if (!map->place) goto fail;
    for (uint32_t i = 0; i < map->object_count; i++) place_tiles(map, i);
    return LW_OK;
fail:
    lw_atlas_map_finish(map);
    return LW_NO_MEMORY;
}

void lw_atlas_map_finish(struct lw_atlas_map *map) {
    free(map->place);
    free(map->first_tile);
    free(map->first_finer);
    free(map->atlas);
    *map = (struct lw_atlas_map){0};
}

uint32_t lw_atlas_map_first(const struct lw_atlas_map *map, uint32_t object, uint32_t level) {
    const struct lw_atlas_level *l = lw_atlas_level(&map->atlas[object], level);
    LW_INVARIANT(l);
    return (lw_atlas_finer(level) ? map->first_finer : map->first_tile)[object] + l->first_tile;
}

lw_tile_id lw_atlas_map_find(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t x,
                             uint32_t y) {
    const struct lw_atlas_level *l =
        object < map->object_count ? lw_atlas_level(&map->atlas[object], level) : NULL;
    if (!l || x >= l->tiles_x || y >= l->tiles_y) return (lw_tile_id){UINT32_MAX};
    const lw_tile_id id = {lw_atlas_map_first(map, object, level) + y * l->tiles_x + x};
    LW_INVARIANT(id.v < map->tile_count);
    return id;
}

lw_tile_id lw_atlas_map_find_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                  uint32_t tile) {
    const struct lw_atlas_level *l =
        object < map->object_count ? lw_atlas_level(&map->atlas[object], level) : NULL;
    if (!l) return (lw_tile_id){UINT32_MAX};
    return lw_atlas_map_find(map, object, level, tile % l->tiles_x, tile / l->tiles_x);
}

lw_tile_id lw_atlas_map_below(const struct lw_atlas_map *map, lw_tile_id id) {
    const struct lw_tile_place *place = &map->place[id.v];
    const uint32_t up = lw_atlas_finer(place->level);
    LW_INVARIANT(up > 0);
    return lw_atlas_map_find(map, place->object, 0, place->x >> up, place->y >> up);
}

uint32_t lw_atlas_map_number(const struct lw_atlas_map *map, lw_tile_id id) {
    LW_INVARIANT(id.v < map->tile_count);
    const struct lw_tile_place *place = &map->place[id.v];
    return place->y * lw_atlas_level(&map->atlas[place->object], place->level)->tiles_x + place->x;
}
