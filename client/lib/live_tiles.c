#include "client/lib/live_tiles.h"

#include "client/lib/live_error.h"
#include "common/base/invariant.h"

#include <stdlib.h>

enum { DIRTY = 1, QUEUED = 2 };

enum lw_status lw_live_tiles_init(struct lw_live_tiles *tiles, const struct lw_client *client, bool as_it_is,
                                  bool reads_finer) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client);
    *tiles = (struct lw_live_tiles){
        .client = client, .map = map, .as_it_is = as_it_is, .reads_finer = reads_finer};
    tiles->state = calloc((size_t)map->tile_count + 1, sizeof *tiles->state);
    tiles->ring = calloc((size_t)map->tile_count + 1, sizeof *tiles->ring);
    return tiles->state && tiles->ring ? LW_OK : LW_NO_MEMORY;
}

void lw_live_tiles_finish(struct lw_live_tiles *tiles) {
    free(tiles->state);
    free(tiles->ring);
    *tiles = (struct lw_live_tiles){0};
}

/* ---- which tile is read from which ---- */

/* The tile of a coarser level that covers a tile: sides are powers of two, so there is one. */
lw_tile_id lw_live_tiles_cover(const struct lw_live_tiles *tiles, const struct lw_tile_place *p,
                               uint32_t level) {
    const unsigned up = level - p->level;
    LW_INVARIANT(level >= p->level && level < tiles->map->atlas[p->object]->level_count);
    return lw_atlas_map_find(tiles->map, p->object, level, p->x >> up, p->y >> up);
}

static unsigned noise_level_of(const struct lw_live_tiles *tiles, float error) {
    struct lw_client_stats stats;
    lw_client_get_stats(tiles->client, &stats);
    return lw_atlas_noise_level_min(error, stats.noise_shown);
}

bool lw_live_tiles_reads_fine(const struct lw_live_tiles *tiles, lw_tile_id tile) {
    LW_INVARIANT(tile.v >= tiles->map->plain_count && tile.v < tiles->map->tile_count);
    const struct lw_client_tile known = lw_client_get_tile(tiles->client, tile);
    return known.version && known.rgb && (tiles->as_it_is || noise_level_of(tiles, known.error) == 0);
}

uint32_t lw_live_tiles_source(const struct lw_live_tiles *tiles, lw_tile_id tile) {
    const struct lw_tile_place *p = &tiles->map->place[tile.v];
    const struct lw_client_tile known = lw_client_get_tile(tiles->client, tile);
    if (tiles->as_it_is) return p->level;
    uint32_t level = p->level;
    if (known.version) {
        const unsigned noise_level = noise_level_of(tiles, known.error);
        if (noise_level > level) level = noise_level;
    }
    for (const uint32_t end = tiles->map->atlas[p->object]->level_count; level < end; level++)
        if (lw_client_get_tile(tiles->client, lw_live_tiles_cover(tiles, p, level)).version) return level;
    return known.version ? p->level : UINT32_MAX;
}

/* ---- dirty tiles ---- */

static void mark_one(struct lw_live_tiles *tiles, lw_tile_id tile) {
    uint8_t *state = &tiles->state[tile.v];
    tiles->dirty_count += !(*state & DIRTY);
    if (!(*state & QUEUED))
        tiles->ring[(tiles->ring_first + tiles->ring_count++) % tiles->map->tile_count] = tile;
    *state = DIRTY | QUEUED;
    LW_INVARIANT(tiles->ring_count <= tiles->map->tile_count && tiles->dirty_count <= tiles->ring_count);
}

/* Marks the tiles below a tile that are read from the level that has changed. */
static void mark_finer(struct lw_live_tiles *tiles, const struct lw_tile_place *p, uint32_t changed) {
    if (p->level == 0) return;
    for (uint32_t i = 0; i < 4; i++) {
        const lw_tile_id finer =
            lw_atlas_map_find(tiles->map, p->object, p->level - 1, 2 * p->x + (i & 1), 2 * p->y + (i >> 1));
        if (finer.v == UINT32_MAX) continue;
        if (lw_live_tiles_source(tiles, finer) == changed) mark_one(tiles, finer);
        const struct lw_tile_place *place = &tiles->map->place[finer.v];
        /* a tile that is there, and as coarse as noise ever asks for, is the coarsest source of all finer
         * ones */
        if (place->level < LW_ATLAS_READ_MAX || !lw_client_get_tile(tiles->client, finer).version)
            mark_finer(tiles, place, changed);
    }
}

void lw_live_tiles_mark(struct lw_live_tiles *tiles, lw_tile_id tile) {
    if (tile.v >= tiles->map->plain_count) return;
    mark_one(tiles, tile);
    const struct lw_tile_place *p = &tiles->map->place[tile.v];
    if (!tiles->as_it_is) mark_finer(tiles, p, p->level);
}

static bool is_dirty(const struct lw_live_tiles *tiles, uint32_t object, uint32_t level, uint32_t x,
                     uint32_t y) {
    const lw_tile_id tile = lw_atlas_map_find(tiles->map, object, level, x, y);
    return tile.v != UINT32_MAX && tiles->state[tile.v] & DIRTY;
}

static bool is_dirty_row(const struct lw_live_tiles *tiles, const struct lw_tile_place *p, uint32_t width,
                         uint32_t y) {
    for (uint32_t x = 0; x < width; x++)
        if (!is_dirty(tiles, p->object, p->level, p->x + x, y)) return false;
    return true;
}

/* The largest rectangle of dirty tiles that begins with this one, first to the right, then down, within a
 * number of texels. */
static struct lw_live_rect dirty_rectangle(struct lw_live_tiles *tiles, const struct lw_tile_place *p,
                                           uint64_t texels_max) {
    const struct lw_atlas_level *level = &tiles->map->atlas[p->object]->level[p->level];
    const uint64_t tile_texels = LW_TILE_SIDE * LW_TILE_SIDE;
    uint32_t width = 1, height = 1;
    while ((width + 1) * tile_texels <= texels_max &&
           is_dirty(tiles, p->object, p->level, p->x + width, p->y))
        width++;
    while ((uint64_t)width * (height + 1) * tile_texels <= texels_max &&
           is_dirty_row(tiles, p, width, p->y + height))
        height++;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            tiles->state[lw_atlas_map_find(tiles->map, p->object, p->level, p->x + x, p->y + y).v] &=
                (uint8_t)~DIRTY;
    LW_INVARIANT(width * height <= tiles->dirty_count);
    tiles->dirty_count -= width * height;
    struct lw_live_rect rect = {.object = p->object,
                                .level = p->level,
                                .x = p->x * LW_TILE_SIDE,
                                .y = p->y * LW_TILE_SIDE,
                                .width = width * LW_TILE_SIDE,
                                .height = height * LW_TILE_SIDE};
    if (rect.x + rect.width > level->width) rect.width = level->width - rect.x;
    if (rect.y + rect.height > level->height) rect.height = level->height - rect.y;
    return rect;
}

/* What one call of lw_live_take_dirty() has taken, and may take. */
struct taking {
    struct lw_live_rect *rect;
    size_t count, capacity;
    uint64_t texels, texels_max;
};

/* false: there is no more room. */
static bool add_rectangle(struct lw_live_tiles *tiles, struct taking *t, lw_tile_id tile) {
    const struct lw_tile_place *p = &tiles->map->place[tile.v];
    const uint64_t texels = (uint64_t)p->width * p->height;
    if (t->count == t->capacity || (t->count && t->texels + texels > t->texels_max)) return false;
    const struct lw_live_rect rect = dirty_rectangle(tiles, p, t->texels_max - t->texels);
    t->texels += (uint64_t)rect.width * rect.height;
    t->rect[t->count++] = rect;
    return true;
}

static void take_of(struct lw_live_tiles *tiles, struct taking *t, uint32_t object, uint32_t level) {
    const struct lw_atlas *atlas = tiles->map->atlas[object];
    for (uint32_t l = 0; l < atlas->level_count; l++) {
        const struct lw_atlas_level *at = &atlas->level[l];
        if (level != LW_LIVE_NONE && l != level) continue;
        for (uint32_t i = 0; i < at->tiles_x * at->tiles_y; i++) {
            const lw_tile_id tile = {tiles->map->first_tile[object] + at->first_tile + i};
            if (tiles->state[tile.v] & DIRTY && !add_rectangle(tiles, t, tile)) return;
        }
    }
}

/* In the order in which they became dirty; those of other levels keep their place. */
static void take_oldest(struct lw_live_tiles *tiles, struct taking *t, uint32_t level) {
    for (uint32_t left = tiles->ring_count; left; left--) {
        const lw_tile_id tile = tiles->ring[tiles->ring_first];
        const bool is_wanted = level == LW_LIVE_NONE || tiles->map->place[tile.v].level == level;
        if (is_wanted && tiles->state[tile.v] & DIRTY && !add_rectangle(tiles, t, tile)) return;
        tiles->ring_first = (tiles->ring_first + 1) % tiles->map->tile_count;
        if (!is_wanted && tiles->state[tile.v] & DIRTY) {
            tiles->ring[(tiles->ring_first + tiles->ring_count - 1) % tiles->map->tile_count] = tile;
        } else {
            LW_INVARIANT(tiles->ring_count > 0 && !(tiles->state[tile.v] & DIRTY));
            tiles->state[tile.v] &= (uint8_t)~QUEUED;
            tiles->ring_count--;
        }
    }
}

size_t lw_live_tiles_take(struct lw_live_tiles *tiles, uint32_t object, uint32_t level, uint64_t texels_max,
                          struct lw_live_rect *out_rect, size_t capacity) {
    struct taking t = {
        .rect = out_rect, .capacity = capacity, .texels_max = texels_max ? texels_max : UINT64_MAX};
    if (object == LW_LIVE_NONE)
        take_oldest(tiles, &t, level);
    else if (object < tiles->map->object_count)
        take_of(tiles, &t, object, level);
    return t.count;
}

enum lw_live_status lw_live_tiles_check(const struct lw_live_tiles *tiles, const struct lw_live_rect *rect,
                                        struct lw_live_error *err) {
    const struct lw_atlas_map *map = tiles->map;
    if (rect->object >= map->object_count)
        return lw_live_fail(err, LW_LIVE_USAGE, "object %u of %u", rect->object, map->object_count);
    const struct lw_atlas *atlas = map->atlas[rect->object];
    const struct lw_atlas_level *at = lw_atlas_level(atlas, rect->level);
    if (!at && atlas->level_count && lw_atlas_finer(rect->level)) {
        if (!tiles->reads_finer)
            return lw_live_fail(err, LW_LIVE_USAGE, "object %u: level %u, and lw_live_desc.finer_slots is 0",
                                rect->object, rect->level);
        return lw_live_fail(err, LW_LIVE_UNAVAILABLE, "object %u: level %u: the server has %u finer levels",
                            rect->object, rect->level, atlas->finer_count);
    }
    if (!at)
        return lw_live_fail(err, LW_LIVE_USAGE, "object %u: level %u of %u", rect->object, rect->level,
                            atlas->level_count);
    if (rect->x > at->width || rect->width > at->width - rect->x || rect->y > at->height ||
        rect->height > at->height - rect->y)
        return lw_live_fail(
            err, LW_LIVE_USAGE, "object %u, level %u: %u x %u texels at (%u, %u) do not lie within %u x %u",
            rect->object, rect->level, rect->width, rect->height, rect->x, rect->y, at->width, at->height);
    return LW_LIVE_OK;
}
