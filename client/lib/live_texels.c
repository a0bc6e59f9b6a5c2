#include "client/lib/live_error.h"
#include "client/lib/live_state.h"
#include "common/base/invariant.h"
#include "common/tile/texel_format.h"

#include <math.h>
#include <string.h>

/* What an engine reads of tiles: lw_live_take_dirty(), lw_live_read(), lw_live_sample(). */

/* Where the texels of a tile come from. */
struct source {
    struct lw_client_level level;             /* rgb: of the quantity that is read */
    uint32_t left, top;                       /* first texel of level.rgb */
    unsigned up;                              /* levels above the tile's own */
    float min_x, max_x, min_y, max_y;         /* centres that may be read: where something has arrived */
    uint32_t first_x, first_y, width, height; /* the tile's, in texels of its own level */
};

/* Whether a tile beside another has arrived. */
static bool has_beside(const struct lw_live_tiles *tiles, const struct lw_tile_place *p, int x, int y) {
    const lw_tile_id tile =
        lw_atlas_map_find(tiles->map, p->object, p->level, p->x + (uint32_t)x, p->y + (uint32_t)y);
    return tile.v != UINT32_MAX && lw_client_get_tile(tiles->client, tile).version;
}

/* Texels of a level in a column or row of tiles. */
static uint32_t texels_in_tile(uint32_t texels, uint32_t tile) {
    const uint32_t left = texels - tile * LW_TILE_SIDE;
    return left < LW_TILE_SIDE ? left : LW_TILE_SIDE;
}

/* false: nothing has arrived. */
static bool find_source(const struct lw_live_tiles *tiles, lw_tile_id tile, struct source *out) {
    const struct lw_tile_place *p = &tiles->map->place[tile.v];
    const uint32_t level = lw_live_tiles_source(tiles, tile);
    out->left = out->top = 0;
    out->first_x = p->x * LW_TILE_SIDE;
    out->first_y = p->y * LW_TILE_SIDE;
    out->width = p->width;
    out->height = p->height;
    if (level == UINT32_MAX) return false;
    out->level = lw_client_get_level(tiles->client, p->object, level);
    out->up = level - p->level;
    const struct lw_tile_place *c = &tiles->map->place[lw_live_tiles_cover(tiles, p, level).v];
    out->min_x = (float)(c->x * LW_TILE_SIDE) - (float)has_beside(tiles, c, -1, 0);
    out->min_y = (float)(c->y * LW_TILE_SIDE) - (float)has_beside(tiles, c, 0, -1);
    out->max_x = (float)(c->x * LW_TILE_SIDE + c->width - 1) + (float)has_beside(tiles, c, 1, 0);
    out->max_y = (float)(c->y * LW_TILE_SIDE + c->height - 1) + (float)has_beside(tiles, c, 0, 1);
    LW_INVARIANT(out->min_x >= 0 && out->max_x < (float)out->level.width && out->min_y >= 0 &&
                 out->max_y < (float)out->level.height);
    return true;
}

/* The same of a tile of a finer level, which has an id where it is there; else level 0 below it is read. */
static bool find_fine_source(const struct lw_live_tiles *tiles, const struct lw_live_rect *rect,
                             uint32_t tile_x, uint32_t tile_y, struct source *out) {
    const uint32_t k = lw_atlas_finer(rect->level);
    const struct lw_atlas_level *at = lw_atlas_level(tiles->map->atlas[rect->object], rect->level);
    const lw_tile_id tile = lw_atlas_map_find(tiles->map, rect->object, rect->level, tile_x, tile_y);
    const struct source own = {.first_x = tile_x * LW_TILE_SIDE,
                               .first_y = tile_y * LW_TILE_SIDE,
                               .width = texels_in_tile(at->width, tile_x),
                               .height = texels_in_tile(at->height, tile_y)};
    *out = own;
    if (tile.v != UINT32_MAX && lw_live_tiles_reads_fine(tiles, tile)) {
        out->level =
            (struct lw_client_level){own.width, own.height, lw_client_get_tile(tiles->client, tile).rgb,
                                     lw_client_get_tile(tiles->client, tile).direction};
        out->left = own.first_x;
        out->top = own.first_y;
        return true;
    }
    const lw_tile_id below = lw_atlas_map_find(tiles->map, rect->object, 0, tile_x >> k, tile_y >> k);
    const bool any = find_source(tiles, below, out);
    out->first_x = own.first_x;
    out->first_y = own.first_y;
    out->width = own.width;
    out->height = own.height;
    out->up += k;
    return any;
}

/* The source of the texels of a rectangle that lie in a tile. false: nothing has arrived. */
static bool find(const struct lw_live_tiles *tiles, const struct lw_live_rect *rect, uint32_t tile_x,
                 uint32_t tile_y, bool directions, struct source *out) {
    const bool any =
        lw_atlas_finer(rect->level)
            ? find_fine_source(tiles, rect, tile_x, tile_y, out)
            : find_source(tiles, lw_atlas_map_find(tiles->map, rect->object, rect->level, tile_x, tile_y),
                          out);
    if (directions) out->level.rgb = out->level.direction;
    return any && out->level.rgb;
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
    if (s->up == 0) return s->level.rgb + 3 * ((size_t)(y - s->top) * s->level.width + x - s->left);
    for (uint32_t i = 0; i < width; i++) interpolate(s, x + i, y, row + 3 * i);
    return row;
}

struct target {
    enum lw_texel_format format;
    bool directions;
    float scale;
    uint8_t *dst;
    size_t texel_size, row_size;
};

static void read_tile(const struct lw_live_tiles *tiles, const struct lw_live_rect *rect, uint32_t tile_x,
                      uint32_t tile_y, const struct target *to) {
    struct source s = {0};
    const bool any = find(tiles, rect, tile_x, tile_y, to->directions, &s);
    const uint32_t x = s.first_x > rect->x ? s.first_x : rect->x,
                   y = s.first_y > rect->y ? s.first_y : rect->y;
    const uint32_t tile_end_x = s.first_x + s.width, rect_end_x = rect->x + rect->width,
                   tile_end_y = s.first_y + s.height, rect_end_y = rect->y + rect->height;
    const uint32_t end_x = tile_end_x < rect_end_x ? tile_end_x : rect_end_x,
                   end_y = tile_end_y < rect_end_y ? tile_end_y : rect_end_y;
    float row[3 * LW_TILE_SIDE] = {0};
    LW_INVARIANT(x < end_x && end_x - x <= LW_TILE_SIDE && y < end_y); /* the rectangle meets the tile */
    for (uint32_t j = y; j < end_y; j++) {
        const float *texels = any ? read_row(&s, x, j, end_x - x, row) : row;
        uint8_t *dst = to->dst + (j - rect->y) * to->row_size + (x - rect->x) * to->texel_size;
        if (to->directions)
            lw_texel_format_write_vectors(to->format, texels, end_x - x, dst);
        else
            lw_texel_format_write(to->format, to->scale, texels, end_x - x, dst);
    }
}

_Static_assert((int)LW_LIVE_RGB9E5 == LW_TEXEL_FORMAT_RGB9E5 &&
                   (int)LW_LIVE_RGBA16F == LW_TEXEL_FORMAT_RGBA16F &&
                   (int)LW_LIVE_RGB32F == LW_TEXEL_FORMAT_RGB32F &&
                   (int)LW_LIVE_RGBA32F == LW_TEXEL_FORMAT_RGBA32F && LW_LIVE_TILE_SIDE == LW_TILE_SIDE &&
                   LW_LIVE_WANT_MAX == LW_CLIENT_INTEREST_MAX && LW_LIVE_FINER == LW_ATLAS_FINER,
               "ours and the public ones are the same numbers");

static enum lw_live_status check_quantity(const struct lw_live *live, const struct lw_live_texels *t,
                                          struct lw_live_error *err) {
    if (t->quantity == LW_LIVE_IRRADIANCE || t->quantity == LW_LIVE_IRRADIANCE_OVER_PI) return LW_LIVE_OK;
    if (t->quantity != LW_LIVE_DIRECTION)
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: quantity %d", (int)t->quantity);
    if (!(live->flags & LW_LIVE_DIRECTIONS))
        return lw_live_fail(err, LW_LIVE_USAGE,
                            "lw_live_texels: LW_LIVE_DIRECTION goes with LW_LIVE_DIRECTIONS alone");
    if (t->format == LW_LIVE_RGB9E5)
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: LW_LIVE_RGB9E5 has no sign for directions");
    return LW_LIVE_OK;
}

static enum lw_live_status check_target(const struct lw_live *live, const struct lw_live_rect *rect,
                                        const struct lw_live_texels *t, struct target *out,
                                        struct lw_live_error *err) {
    const size_t texel = lw_texel_format_size((enum lw_texel_format)t->format);
    if (!texel) return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: format %d", (int)t->format);
    const enum lw_live_status quantity = check_quantity(live, t, err);
    if (quantity != LW_LIVE_OK) return quantity;
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
                           .directions = t->quantity == LW_LIVE_DIRECTION,
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
    struct target to = {0};
    if (!live || !rect) return lw_live_fail(err, LW_LIVE_USAGE, "live or rect is NULL");
    if (!lw_live_read_struct(&t, sizeof t, texels))
        return lw_live_fail(err, LW_LIVE_USAGE, "lw_live_texels: struct_size is not sizeof *texels");
    lw_live_lock(live);
    enum lw_live_status result = check_rect(live, rect, err);
    if (result == LW_LIVE_OK) result = check_target(live, rect, &t, &to, err);
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
        const struct lw_atlas_level *at = lw_atlas_level(live->tiles.map->atlas[object], level);
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

size_t lw_live_take_dirty(struct lw_live *live, uint32_t object, uint32_t level, uint64_t texels_max,
                          struct lw_live_rect *out_rect, size_t capacity) {
    if (!live || !out_rect) return 0;
    lw_live_lock(live);
    const size_t count =
        live->scene ? lw_live_tiles_take(&live->tiles, object, level, texels_max, out_rect, capacity) : 0;
    lw_live_unlock(live);
    return count;
}
