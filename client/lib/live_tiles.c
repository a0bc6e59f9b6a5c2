#include "client/lib/live.h"

#include "common/tile/texel_format.h"

#include <stdlib.h>
#include <string.h>

enum { DIRTY = 1, QUEUED = 2 };

enum lw_status lw_live_tiles_init(struct lw_live_tiles *tiles, const struct lw_client *client,
                                  bool as_it_is) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client);
    *tiles = (struct lw_live_tiles){.client = client, .map = map, .as_it_is = as_it_is};
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
static lw_tile_id cover(const struct lw_live_tiles *tiles, const struct lw_tile_place *p, uint32_t level) {
    const unsigned up = level - p->level;
    return lw_atlas_map_find(tiles->map, p->object, level, p->x >> up, p->y >> up);
}

uint32_t lw_live_tiles_source(const struct lw_live_tiles *tiles, lw_tile_id tile) {
    const struct lw_tile_place *p = &tiles->map->place[tile.v];
    const struct lw_client_tile known = lw_client_get_tile(tiles->client, tile);
    if (tiles->as_it_is) return p->level;
    uint32_t level = p->level;
    if (known.version) {
        struct lw_client_stats stats;
        lw_client_get_stats(tiles->client, &stats);
        const unsigned noise_level = lw_atlas_noise_level_min(known.error, stats.noise_shown);
        if (noise_level > level) level = noise_level;
    }
    for (const uint32_t end = tiles->map->atlas[p->object].level_count; level < end; level++)
        if (lw_client_get_tile(tiles->client, cover(tiles, p, level)).version) return level;
    return known.version ? p->level : UINT32_MAX;
}

/* ---- dirty tiles ---- */

static void mark_one(struct lw_live_tiles *tiles, lw_tile_id tile) {
    uint8_t *state = &tiles->state[tile.v];
    tiles->dirty_count += !(*state & DIRTY);
    if (!(*state & QUEUED))
        tiles->ring[(tiles->ring_first + tiles->ring_count++) % tiles->map->tile_count] = tile;
    *state = DIRTY | QUEUED;
}

/* Of what lies below a tile, what is read from the level that has changed. */
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
static struct lw_live_rect grow(struct lw_live_tiles *tiles, const struct lw_tile_place *p,
                                uint64_t texels_max) {
    const struct lw_atlas_level *level = &tiles->map->atlas[p->object].level[p->level];
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
static bool take(struct lw_live_tiles *tiles, struct taking *t, lw_tile_id tile) {
    const struct lw_tile_place *p = &tiles->map->place[tile.v];
    const uint64_t texels = (uint64_t)p->width * p->height;
    if (t->count == t->capacity || (t->count && t->texels + texels > t->texels_max)) return false;
    const struct lw_live_rect rect = grow(tiles, p, t->texels_max - t->texels);
    t->texels += (uint64_t)rect.width * rect.height;
    t->rect[t->count++] = rect;
    return true;
}

static void take_of(struct lw_live_tiles *tiles, struct taking *t, uint32_t object, uint32_t level) {
    const struct lw_atlas *atlas = &tiles->map->atlas[object];
    for (uint32_t l = 0; l < atlas->level_count; l++) {
        const struct lw_atlas_level *at = &atlas->level[l];
        if (level != LW_LIVE_NONE && l != level) continue;
        for (uint32_t i = 0; i < at->tiles_x * at->tiles_y; i++) {
            const lw_tile_id tile = {tiles->map->first_tile[object] + at->first_tile + i};
            if (tiles->state[tile.v] & DIRTY && !take(tiles, t, tile)) return;
        }
    }
}

/* In the order in which they became dirty; those of other levels keep their place. */
static void take_oldest(struct lw_live_tiles *tiles, struct taking *t, uint32_t level) {
    for (uint32_t left = tiles->ring_count; left; left--) {
        const lw_tile_id tile = tiles->ring[tiles->ring_first];
        const bool is_wanted = level == LW_LIVE_NONE || tiles->map->place[tile.v].level == level;
        if (is_wanted && tiles->state[tile.v] & DIRTY && !take(tiles, t, tile)) return;
        tiles->ring_first = (tiles->ring_first + 1) % tiles->map->tile_count;
        if (!is_wanted && tiles->state[tile.v] & DIRTY) {
            tiles->ring[(tiles->ring_first + tiles->ring_count - 1) % tiles->map->tile_count] = tile;
        } else {
            tiles->state[tile.v] &= (uint8_t)~QUEUED;
            tiles->ring_count--;
        }
    }
}

size_t lw_live_take_dirty(struct lw_live *live, uint32_t object, uint32_t level, uint64_t texels_max,
                          struct lw_live_rect *out_rect, size_t capacity) {
    if (!live || !out_rect) return 0;
    struct taking t = {
        .rect = out_rect, .capacity = capacity, .texels_max = texels_max ? texels_max : UINT64_MAX};
    lw_live_lock(live);
    struct lw_live_tiles *tiles = &live->tiles;
    if (live->scene && object == LW_LIVE_NONE)
        take_oldest(tiles, &t, level);
    else if (live->scene && object < tiles->map->object_count)
        take_of(tiles, &t, object, level);
    lw_live_unlock(live);
    return t.count;
}

/* ---- texels ---- */

enum lw_live_status lw_live_tiles_check(const struct lw_live_tiles *tiles, const struct lw_live_rect *rect,
                                        struct lw_live_error *err) {
    const struct lw_atlas_map *map = tiles->map;
    if (rect->object >= map->object_count)
        return lw_live_fail(err, LW_LIVE_USAGE, "object %u of %u", rect->object, map->object_count);
    const struct lw_atlas *atlas = &map->atlas[rect->object];
    if (rect->level >= atlas->level_count)
        return lw_live_fail(err, LW_LIVE_USAGE, "object %u: level %u of %u", rect->object, rect->level,
                            atlas->level_count);
    const struct lw_atlas_level *at = &atlas->level[rect->level];
    if (rect->x > at->width || rect->width > at->width - rect->x || rect->y > at->height ||
        rect->height > at->height - rect->y)
        return lw_live_fail(
            err, LW_LIVE_USAGE, "object %u, level %u: %u x %u texels at (%u, %u) do not lie within %u x %u",
            rect->object, rect->level, rect->width, rect->height, rect->x, rect->y, at->width, at->height);
    return LW_LIVE_OK;
}

/* Where the texels of a tile come from. */
struct source {
    struct lw_client_level level;
    unsigned up;                              /* levels above the tile's own */
    float min_x, max_x, min_y, max_y;         /* centres that may be read: where something has arrived */
    uint32_t first_x, first_y, width, height; /* of the tile, texels of its own level */
};

/* Whether a tile beside another has arrived. */
static bool has_beside(const struct lw_live_tiles *tiles, const struct lw_tile_place *p, int x, int y) {
    const lw_tile_id tile =
        lw_atlas_map_find(tiles->map, p->object, p->level, p->x + (uint32_t)x, p->y + (uint32_t)y);
    return tile.v != UINT32_MAX && lw_client_get_tile(tiles->client, tile).version;
}

/* false: nothing has arrived. */
static bool find_source(const struct lw_live_tiles *tiles, lw_tile_id tile, struct source *out) {
    const struct lw_tile_place *p = &tiles->map->place[tile.v];
    const uint32_t level = lw_live_tiles_source(tiles, tile);
    out->first_x = p->x * LW_TILE_SIDE;
    out->first_y = p->y * LW_TILE_SIDE;
    out->width = p->width;
    out->height = p->height;
    if (level == UINT32_MAX) return false;
    out->level = lw_client_get_level(tiles->client, p->object, level);
    out->up = level - p->level;
    const struct lw_tile_place *c = &tiles->map->place[cover(tiles, p, level).v];
    out->min_x = (float)(c->x * LW_TILE_SIDE) - (float)has_beside(tiles, c, -1, 0);
    out->min_y = (float)(c->y * LW_TILE_SIDE) - (float)has_beside(tiles, c, 0, -1);
    out->max_x = (float)(c->x * LW_TILE_SIDE + c->width - 1) + (float)has_beside(tiles, c, 1, 0);
    out->max_y = (float)(c->y * LW_TILE_SIDE + c->height - 1) + (float)has_beside(tiles, c, 0, 1);
    return true;
}

static float clamp(float f, float low, float high) { return f < low ? low : f > high ? high : f; }

/* The texel (x, y) of the tile's level out of its source. */
static void interpolate(const struct source *s, uint32_t x, uint32_t y, float rgb[3]) {
    const float scale = 1.0f / (float)(1u << s->up);
    const float u = clamp(((float)x + 0.5f) * scale - 0.5f, s->min_x, s->max_x),
                v = clamp(((float)y + 0.5f) * scale - 0.5f, s->min_y, s->max_y);
    const uint32_t i = (uint32_t)u, j = (uint32_t)v;
    const float a = u - (float)i, b = v - (float)j;
    const float *low = s->level.rgb + 3 * ((size_t)j * s->level.width + i);
    const size_t right = a > 0 ? 3 : 0, down = b > 0 ? 3 * (size_t)s->level.width : 0;
    for (int k = 0; k < 3; k++)
        rgb[k] = (1 - b) * ((1 - a) * low[k] + a * low[right + k]) +
                 b * ((1 - a) * low[down + k] + a * low[down + right + k]);
}

/* Texels [x, x + width) of row y of the tile's level. row: of LW_TILE_SIDE texels, may be used. */
static const float *read_row(const struct source *s, uint32_t x, uint32_t y, uint32_t width, float *row) {
    if (s->up == 0) return s->level.rgb + 3 * ((size_t)y * s->level.width + x);
    for (uint32_t i = 0; i < width; i++) interpolate(s, x + i, y, row + 3 * i);
    return row;
}

struct target {
    enum lw_texel_format format;
    float scale;
    uint8_t *dst;
    size_t texel_size, row_size;
};

static void read_tile(const struct lw_live_tiles *tiles, const struct lw_live_rect *rect, uint32_t tile_x,
                      uint32_t tile_y, const struct target *to) {
    const lw_tile_id tile = lw_atlas_map_find(tiles->map, rect->object, rect->level, tile_x, tile_y);
    struct source s = {0};
    const bool any = find_source(tiles, tile, &s);
    const uint32_t x = s.first_x > rect->x ? s.first_x : rect->x,
                   y = s.first_y > rect->y ? s.first_y : rect->y;
    const uint32_t tile_end_x = s.first_x + s.width, rect_end_x = rect->x + rect->width,
                   tile_end_y = s.first_y + s.height, rect_end_y = rect->y + rect->height;
    const uint32_t end_x = tile_end_x < rect_end_x ? tile_end_x : rect_end_x,
                   end_y = tile_end_y < rect_end_y ? tile_end_y : rect_end_y;
    float row[3 * LW_TILE_SIDE] = {0};
    for (uint32_t j = y; j < end_y; j++)
        lw_texel_format_write(to->format, to->scale, any ? read_row(&s, x, j, end_x - x, row) : row,
                              end_x - x,
                              to->dst + (j - rect->y) * to->row_size + (x - rect->x) * to->texel_size);
}

_Static_assert((int)LW_LIVE_RGB9E5 == LW_TEXEL_FORMAT_RGB9E5 &&
                   (int)LW_LIVE_RGBA16F == LW_TEXEL_FORMAT_RGBA16F &&
                   (int)LW_LIVE_RGB32F == LW_TEXEL_FORMAT_RGB32F &&
                   (int)LW_LIVE_RGBA32F == LW_TEXEL_FORMAT_RGBA32F && LW_LIVE_TILE_SIDE == LW_TILE_SIDE &&
                   LW_LIVE_WANT_MAX == LW_CLIENT_INTEREST_MAX,
               "ours and the public ones are the same numbers");

static enum lw_live_status check_target(const struct lw_live_rect *rect, const struct lw_live_texels *t,
                                        struct target *out, struct lw_live_error *err) {
    const size_t texel = lw_texel_format_size((enum lw_texel_format)t->format);
    if (!texel) return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: format %d", (int)t->format);
    if (t->quantity != LW_LIVE_IRRADIANCE && t->quantity != LW_LIVE_IRRADIANCE_OVER_PI)
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: quantity %d", (int)t->quantity);
    if (!(t->scale >= 0) || !isfinite(t->scale))
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: scale is not a finite number >= 0");
    const size_t least = rect->width * texel, row = t->row_size ? t->row_size : least;
    if (row < least)
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: row_size %zu, rows of %zu bytes", row,
                            least);
    /* the last row needs no gap */
    const size_t rows_before = rect->height ? rect->height - 1 : 0;
    if (t->dst_size < least || (rows_before && (t->dst_size - least) / rows_before < row) || !t->dst)
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: dst of %zu bytes for %u rows of %zu",
                            t->dst_size, rect->height, row);
    *out = (struct target){.format = (enum lw_texel_format)t->format,
                           .scale = (t->scale > 0 ? t->scale : 1) *
                                    (t->quantity == LW_LIVE_IRRADIANCE_OVER_PI ? 1 / LW_PI : 1),
                           .dst = t->dst,
                           .texel_size = texel,
                           .row_size = row};
    return LW_LIVE_OK;
}

static enum lw_live_status check_rect(const struct lw_live *live, const struct lw_live_rect *rect,
                                      struct lw_live_error *err) {
    if (!live->scene) return lw_live_fail(err, LW_LIVE_NOT_READY, "the scene has not arrived yet");
    return lw_live_tiles_check(&live->tiles, rect, err);
}

enum lw_live_status lw_live_read(const struct lw_live *live, const struct lw_live_rect *rect,
                                 const struct lw_live_texels *texels, struct lw_live_error *err) {
    struct lw_live_texels t;
    struct target to;
    if (!live || !rect) return lw_live_fail(err, LW_LIVE_USAGE, "live or rect is NULL");
    if (!lw_live_read_struct(&t, sizeof t, texels))
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: struct_size is not sizeof *texels");
    lw_live_lock(live);
    enum lw_live_status result = check_rect(live, rect, err);
    if (result == LW_LIVE_OK) result = check_target(rect, &t, &to, err);
    if (result == LW_LIVE_OK && rect->width && rect->height)
        for (uint32_t y = rect->y / LW_TILE_SIDE; y <= (rect->y + rect->height - 1) / LW_TILE_SIDE; y++)
            for (uint32_t x = rect->x / LW_TILE_SIDE; x <= (rect->x + rect->width - 1) / LW_TILE_SIDE; x++)
                read_tile(&live->tiles, rect, x, y, &to);
    lw_live_unlock(live);
    return result;
}

enum lw_live_status lw_live_get_level(const struct lw_live *live, uint32_t object, uint32_t level,
                                      struct lw_live_rect *out_rect, struct lw_live_error *err) {
    if (!live || !out_rect) return lw_live_fail(err, LW_LIVE_USAGE, "live or out_rect is NULL");
    struct lw_live_rect rect = {.object = object, .level = level};
    lw_live_lock(live);
    enum lw_live_status result = check_rect(live, &rect, err);
    if (result == LW_LIVE_OK) {
        const struct lw_atlas_level *at = &live->tiles.map->atlas[object].level[level];
        rect.width = at->width;
        rect.height = at->height;
        *out_rect = rect;
    }
    lw_live_unlock(live);
    return result;
}

static void sample(const struct lw_live_tiles *tiles, const struct lw_live_rect *level, const float uv[2],
                   float out[3]) {
    const float u = clamp(uv[0] - 0.5f, 0, (float)(level->width - 1)),
                v = clamp(uv[1] - 0.5f, 0, (float)(level->height - 1));
    const uint32_t i = (uint32_t)u, j = (uint32_t)v;
    const float a = u - (float)i, b = v - (float)j;
    float sum[3] = {0};
    for (uint32_t k = 0; k < 4; k++) {
        const uint32_t x = i + (k & 1), y = j + (k >> 1);
        const float weight = (k & 1 ? a : 1 - a) * (k >> 1 ? b : 1 - b);
        struct source s;
        if (weight == 0 ||
            !find_source(tiles,
                         lw_atlas_map_find(tiles->map, level->object, 0, x / LW_TILE_SIDE, y / LW_TILE_SIDE),
                         &s))
            continue;
        float row[3];
        const float *rgb = read_row(&s, x, y, 1, row);
        for (int c = 0; c < 3; c++) sum[c] += weight * rgb[c];
    }
    memcpy(out, sum, sizeof sum);
}

enum lw_live_status lw_live_sample(const struct lw_live *live, uint32_t object, const float *lightmap_uv,
                                   float *out_rgb, struct lw_live_error *err) {
    if (!live || !lightmap_uv || !out_rgb)
        return lw_live_fail(err, LW_LIVE_USAGE, "live, lightmap_uv or out_rgb is NULL");
    if (!isfinite(lightmap_uv[0]) || !isfinite(lightmap_uv[1]))
        return lw_live_fail(err, LW_LIVE_USAGE, "lightmap_uv is not finite");
    struct lw_live_rect level;
    enum lw_live_status result = lw_live_get_level(live, object, 0, &level, err);
    if (result != LW_LIVE_OK) return result;
    lw_live_lock(live);
    sample(&live->tiles, &level, lightmap_uv, out_rgb);
    lw_live_unlock(live);
    return LW_LIVE_OK;
}
