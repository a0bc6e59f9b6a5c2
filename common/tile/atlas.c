#include "common/tile/atlas.h"

#include "common/base/invariant.h"

#include <stdlib.h>

int lw_tile_id_compare(const void *left, const void *right) {
    const lw_tile_id *a = left, *b = right;
    return a->v < b->v ? -1 : a->v > b->v;
}

bool lw_tile_id_is_in(const lw_tile_id *list, size_t count, lw_tile_id id) {
    return count && bsearch(&id, list, count, sizeof *list, lw_tile_id_compare);
}

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
    LW_INVARIANT(atlas->level_count > 0 && count <= LW_ATLAS_FINER_ALL);
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

static struct lw_tile_place place_of(const struct lw_atlas_level *level, uint32_t object, uint32_t number,
                                     uint32_t x, uint32_t y) {
    const uint32_t width = level->width - x * LW_TILE_SIDE, height = level->height - y * LW_TILE_SIDE;
    LW_INVARIANT(x < level->tiles_x && y < level->tiles_y);
    return (struct lw_tile_place){.object = object,
                                  .level = number,
                                  .x = x,
                                  .y = y,
                                  .width = width < LW_TILE_SIDE ? width : LW_TILE_SIDE,
                                  .height = height < LW_TILE_SIDE ? height : LW_TILE_SIDE};
}

/* The place of a free id: in no object's level 0. */
static const struct lw_tile_place nowhere = {.level = LW_ATLAS_FINER + 1};

static void place_tiles(const struct lw_atlas_map *map, uint32_t object) {
    const struct lw_atlas *atlas = map->atlas[object];
    struct lw_tile_place *place = map->place + map->first_tile[object];
    for (uint32_t l = 0; l < atlas->level_count; l++)
        for (uint32_t y = 0; y < atlas->level[l].tiles_y; y++)
            for (uint32_t x = 0; x < atlas->level[l].tiles_x; x++)
                *place++ = place_of(&atlas->level[l], object, l, x, y);
    LW_INVARIANT(place == map->place + map->first_tile[object] + atlas->tile_count);
}

enum lw_status lw_atlas_map_init(struct lw_atlas_map *map, const struct lw_scene *scene) {
    return lw_atlas_map_init_finer(map, scene, 0, 0);
}

/* Names of finer levels: each side of theirs has at most 2^4 times the texels, and an object's number is
 * below 2^32. */
static void name_finer(struct lw_atlas_map *map) {
    uint64_t name = 0;
    for (uint32_t i = 0; i < map->object_count; i++) {
        map->first_finer[i] = name;
        name += map->atlas[i]->finer_tile_count;
    }
    map->fine_names = name;
}

/* A mesh without an atlas has no level. */
static void shape_mesh(struct lw_atlas *shape, const struct lw_mesh *mesh, uint32_t finer) {
    if (!mesh->atlas_width || !mesh->atlas_height) return;
    lw_atlas_init(shape, mesh->atlas_width, mesh->atlas_height);
    lw_atlas_refine(shape, finer);
}

enum lw_status lw_atlas_map_init_finer(struct lw_atlas_map *map, const struct lw_scene *scene, uint32_t finer,
                                       uint32_t room) {
    const size_t count = scene->object_count ? scene->object_count : 1;
    LW_INVARIANT(finer <= LW_ATLAS_FINER_ALL && !finer == !room);
    *map = (struct lw_atlas_map){.object_count = scene->object_count, .finer_count = finer};
    map->shape = calloc(scene->mesh_count + 1ul, sizeof *map->shape);
    map->atlas = calloc(count, sizeof *map->atlas);
    map->first_tile = calloc(count, sizeof *map->first_tile);
    map->first_finer = calloc(count, sizeof *map->first_finer);
    if (!map->shape || !map->atlas || !map->first_tile || !map->first_finer) goto fail;
    for (uint32_t m = 0; m < scene->mesh_count; m++) shape_mesh(&map->shape[m], &scene->mesh[m], finer);
    uint64_t tiles = 0;
    for (uint32_t i = 0; i < scene->object_count; i++) {
        map->atlas[i] = &map->shape[scene->object[i].mesh];
        map->first_tile[i] = (uint32_t)tiles;
        tiles += map->atlas[i]->tile_count;
        if (tiles + room >= UINT32_MAX) goto fail;
    }
    name_finer(map);
    map->plain_count = (uint32_t)tiles;
    map->tile_count = (uint32_t)tiles + room;
    map->place = calloc(map->tile_count + 1ul, sizeof *map->place);
    if (!map->place) goto fail;
    for (uint32_t i = 0; i < map->object_count; i++) place_tiles(map, i);
    for (uint32_t id = map->plain_count; id < map->tile_count; id++) map->place[id] = nowhere;
    if (room && lw_fine_ids_create(room, map->place + map->plain_count, &map->fine) != LW_OK) goto fail;
    return LW_OK;
fail:
    lw_atlas_map_finish(map);
    return LW_NO_MEMORY;
}

void lw_atlas_map_finish(struct lw_atlas_map *map) {
    lw_fine_ids_destroy(map->fine);
    free(map->place);
    free(map->first_tile);
    free(map->first_finer);
    free(map->atlas);
    free(map->shape);
    *map = (struct lw_atlas_map){0};
}

/* The level of a place; NULL: there is no such place. */
static const struct lw_atlas_level *level_at(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                             uint32_t x, uint32_t y) {
    const struct lw_atlas_level *l =
        object < map->object_count ? lw_atlas_level(map->atlas[object], level) : NULL;
    return l && x < l->tiles_x && y < l->tiles_y ? l : NULL;
}

bool lw_atlas_map_has_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t tile) {
    const struct lw_atlas_level *l = level_at(map, object, level, 0, 0);
    return l && level_at(map, object, level, tile % l->tiles_x, tile / l->tiles_x);
}

uint32_t lw_atlas_map_first(const struct lw_atlas_map *map, uint32_t object, uint32_t level) {
    LW_INVARIANT(level < map->atlas[object]->level_count);
    return map->first_tile[object] + map->atlas[object]->level[level].first_tile;
}

static uint64_t name_of(const struct lw_atlas_map *map, uint32_t object, const struct lw_atlas_level *l,
                        uint32_t x, uint32_t y) {
    return map->first_finer[object] + l->first_tile + y * l->tiles_x + x;
}

/* fine: of the ids of finer levels, or NONE */
static lw_tile_id id_of(const struct lw_atlas_map *map, uint32_t fine) {
    return (lw_tile_id){fine == LW_FINE_IDS_NONE ? UINT32_MAX : map->plain_count + fine};
}

lw_tile_id lw_atlas_map_find(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t x,
                             uint32_t y) {
    const struct lw_atlas_level *l = level_at(map, object, level, x, y);
    if (!l) return (lw_tile_id){UINT32_MAX};
    if (lw_atlas_finer(level)) return id_of(map, lw_fine_ids_find(map->fine, name_of(map, object, l, x, y)));
    return (lw_tile_id){map->first_tile[object] + l->first_tile + y * l->tiles_x + x};
}

lw_tile_id lw_atlas_map_find_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                  uint32_t tile) {
    const struct lw_atlas_level *l = level_at(map, object, level, 0, 0);
    if (!l) return (lw_tile_id){UINT32_MAX};
    return lw_atlas_map_find(map, object, level, tile % l->tiles_x, tile / l->tiles_x);
}

lw_tile_id lw_atlas_map_claim(const struct lw_atlas_map *map, uint32_t object, uint32_t level, uint32_t x,
                              uint32_t y) {
    const struct lw_atlas_level *l = level_at(map, object, level, x, y);
    if (!l || !lw_atlas_finer(level)) return lw_atlas_map_find(map, object, level, x, y);
    const struct lw_tile_place place = place_of(l, object, level, x, y);
    return id_of(map, lw_fine_ids_claim(map->fine, name_of(map, object, l, x, y), &place));
}

lw_tile_id lw_atlas_map_claim_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                   uint32_t tile) {
    const struct lw_atlas_level *l = level_at(map, object, level, 0, 0);
    if (!l) return (lw_tile_id){UINT32_MAX};
    return lw_atlas_map_claim(map, object, level, tile % l->tiles_x, tile / l->tiles_x);
}

lw_tile_id lw_atlas_map_claim_name(const struct lw_atlas_map *map, uint64_t name) {
    uint32_t low = 0, high = map->object_count; /* objects [low, high) have it */
    LW_INVARIANT(name < map->fine_names);
    while (high - low > 1) {
        const uint32_t middle = low + (high - low) / 2;
        if (map->first_finer[middle] <= name)
            low = middle;
        else
            high = middle;
    }
    /* objects without tiles have the first name of the next object: the last of all these has it */
    const struct lw_atlas *atlas = map->atlas[low];
    const uint32_t tile = (uint32_t)(name - map->first_finer[low]);
    uint32_t k = atlas->finer_count;
    while (atlas->finer[k - 1].first_tile > tile) k--;
    return lw_atlas_map_claim_tile(map, low, LW_ATLAS_FINER + k, tile - atlas->finer[k - 1].first_tile);
}

uint64_t lw_atlas_map_name_tile(const struct lw_atlas_map *map, uint32_t object, uint32_t level,
                                uint32_t tile) {
    if (!lw_atlas_finer(level) || !lw_atlas_map_has_tile(map, object, level, tile)) return UINT64_MAX;
    return map->first_finer[object] + lw_atlas_level(map->atlas[object], level)->first_tile + tile;
}

uint64_t lw_atlas_map_name(const struct lw_atlas_map *map, lw_tile_id id) {
    const struct lw_tile_place *p = &map->place[id.v];
    LW_INVARIANT(id.v >= map->plain_count && lw_atlas_map_is_used(map, id));
    return name_of(map, p->object, lw_atlas_level(map->atlas[p->object], p->level), p->x, p->y);
}

bool lw_atlas_map_is_used(const struct lw_atlas_map *map, lw_tile_id id) {
    if (id.v < map->plain_count) return true;
    return map->fine && lw_fine_ids_is_claimed(map->fine, id.v - map->plain_count);
}

void lw_atlas_map_release(const struct lw_atlas_map *map, lw_tile_id id) {
    LW_INVARIANT(id.v >= map->plain_count && lw_atlas_map_is_used(map, id));
    lw_fine_ids_release(map->fine, id.v - map->plain_count);
    map->place[id.v] = nowhere;
}

lw_tile_id lw_atlas_map_below(const struct lw_atlas_map *map, lw_tile_id id) {
    const struct lw_tile_place *place = &map->place[id.v];
    const uint32_t up = lw_atlas_finer(place->level);
    LW_INVARIANT(up > 0);
    return lw_atlas_map_find(map, place->object, 0, place->x >> up, place->y >> up);
}

uint32_t lw_atlas_map_number(const struct lw_atlas_map *map, lw_tile_id id) {
    LW_INVARIANT(id.v < map->tile_count && lw_atlas_map_is_used(map, id));
    const struct lw_tile_place *place = &map->place[id.v];
    return place->y * lw_atlas_level(map->atlas[place->object], place->level)->tiles_x + place->x;
}
