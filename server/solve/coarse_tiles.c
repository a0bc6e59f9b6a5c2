#include "server/solve/coarse_tiles.h"

#include "common/base/invariant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SIDE       LW_COARSE_SCENE_SIDE
#define ALL_LIGHT  3u /* planes of all light, before those of channels */
#define PLANES_MAX LW_SOLVER_PLANES_MAX
/* The coarse texels below a tile, and one around them. */
#define PATCH_SIDE   (LW_TILE_SIDE / SIDE + 2)
#define PATCH_TEXELS (PATCH_SIDE * PATCH_SIDE)

static const float black[LW_TILE_TEXELS_MAX];

struct lw_coarse_tiles_tile {
    uint8_t *covered, *filled; /* NULL: they are not held */
    float *plane;              /* all planes, one after another; NULL: they are not held */
    uint32_t sample_count, bounces;
    uint64_t solved_frame;
    bool is_known, has_surface; /* is_known: it was updated */
};

struct patch {
    float plane[PLANES_MAX][PATCH_TEXELS];
    uint32_t chart[PATCH_TEXELS];
    uint8_t covered[PATCH_TEXELS], lit[PATCH_TEXELS]; /* has surface; has light: that, or a gutter */
};

static uint32_t count_planes(uint32_t channels) {
    uint32_t count = ALL_LIGHT;
    LW_TILE_CHANNELS_EACH (channel, channels) count += lw_tile_channel_at(channel)->planes;
    return count;
}

static bool is_used(const struct lw_coarse_tiles *tiles, uint32_t id) {
    return tiles->map->place[id].level == 0;
}

enum lw_status lw_coarse_tiles_init(struct lw_coarse_tiles *tiles, const struct lw_atlas_map *map,
                                    const struct lw_atlas_map *coarse_map, bool holds_planes, int threads) {
    LW_INVARIANT(map->object_count == coarse_map->object_count && threads > 0);
    *tiles = (struct lw_coarse_tiles){
        .map = map, .coarse_map = coarse_map, .holds_planes = holds_planes, .threads = threads};
    tiles->tile = calloc(map->plain_count + 1ul, sizeof *tiles->tile);
    return tiles->tile ? LW_OK : LW_NO_MEMORY;
}

static void forget(struct lw_coarse_tiles_tile *tile) {
    free(tile->plane);
    free(tile->covered);
    *tile = (struct lw_coarse_tiles_tile){.plane = NULL};
}

void lw_coarse_tiles_finish(struct lw_coarse_tiles *tiles) {
    for (uint32_t id = 0; tiles->tile && id < tiles->map->plain_count; id++) forget(&tiles->tile[id]);
    free(tiles->tile);
    *tiles = (struct lw_coarse_tiles){.tile = NULL};
}

void lw_coarse_tiles_forget(struct lw_coarse_tiles *tiles, lw_tile_id id) { forget(&tiles->tile[id.v]); }

size_t lw_coarse_tiles_memory_bytes(const struct lw_coarse_tiles *tiles) {
    if (!tiles->tile) return 0;
    size_t bytes = tiles->map->plain_count * sizeof *tiles->tile;
    for (uint32_t id = 0; id < tiles->map->plain_count; id++) {
        const struct lw_tile_place *place = &tiles->map->place[id];
        const size_t planes = tiles->tile[id].plane ? count_planes(tiles->channels) : 0;
        if (tiles->tile[id].covered)
            bytes += (size_t)place->width * place->height * (planes * sizeof(float) + 2 * sizeof(uint8_t));
    }
    return bytes;
}

/* ---- a patch: the coarse texels around a tile ---- */

static void copy_texel(struct patch *patch, uint32_t to, const struct lw_solver_tile *tile, uint32_t from,
                       bool with_planes, uint32_t channels) {
    uint32_t plane = 0;
    patch->covered[to] = tile->covered[from];
    patch->lit[to] = tile->covered[from] || (tile->filled && tile->filled[from]);
    patch->chart[to] = tile->chart ? tile->chart[from] : 0;
    if (!with_planes) return;
    for (int c = 0; c < 3; c++) patch->plane[plane++][to] = tile->direct[c][from] + tile->indirect[c][from];
    LW_TILE_CHANNELS_EACH (channel, channels)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
            patch->plane[plane++][to] = tile->shown[channel][p][from];
}

/* Copies the part of a coarse tile that lies in a patch whose first texel is (x0, y0). */
static void copy_part(struct patch *patch, int64_t x0, int64_t y0, const struct lw_solver_tile *tile,
                      const struct lw_tile_place *place, bool with_planes, uint32_t channels) {
    for (uint32_t y = 0; y < tile->height; y++) {
        const int64_t row = (int64_t)place->y * LW_TILE_SIDE + y - y0;
        if (row < 0 || row >= PATCH_SIDE) continue;
        for (uint32_t x = 0; x < tile->width; x++) {
            const int64_t column = (int64_t)place->x * LW_TILE_SIDE + x - x0;
            if (column < 0 || column >= PATCH_SIDE) continue;
            copy_texel(patch, (uint32_t)(row * PATCH_SIDE + column), tile, y * tile->width + x, with_planes,
                       channels);
        }
    }
}

/* The coarse tiles that a patch may touch: that below the tile, and those beside it. */
struct below {
    uint32_t count;
    lw_tile_id id[4];
};

static struct below list_below(const struct lw_atlas_map *coarse_map, uint32_t object, int64_t x0,
                               int64_t y0) {
    const struct lw_atlas_level *level = &coarse_map->atlas[object]->level[0];
    struct below below = {.count = 0};
    for (int corner = 0; corner < 4; corner++) {
        const int64_t x = corner % 2 ? x0 + PATCH_SIDE - 1 : x0, y = corner / 2 ? y0 + PATCH_SIDE - 1 : y0,
                      inside_x = x < 0               ? 0
                                 : x >= level->width ? level->width - 1
                                                     : x,
                      inside_y = y < 0                ? 0
                                 : y >= level->height ? level->height - 1
                                                      : y;
        const lw_tile_id id = lw_atlas_map_find(coarse_map, object, 0, (uint32_t)(inside_x / LW_TILE_SIDE),
                                                (uint32_t)(inside_y / LW_TILE_SIDE));
        bool listed = false;
        for (uint32_t i = 0; i < below.count; i++) listed |= below.id[i].v == id.v;
        if (!listed) below.id[below.count++] = id;
    }
    return below;
}

/* ---- interpolation ---- */

struct weights {
    float weight[4]; /* weights of `at`, the texel to its right, and the two below */
    uint32_t at;
};

/* Bilinear, over the texels of one chart. x, y: within the patch, in coarse texels */
static struct weights weigh(const struct patch *patch, uint32_t chart, float x, float y) {
    const float left = floorf(x - 0.5f), top = floorf(y - 0.5f), fx = x - 0.5f - left, fy = y - 0.5f - top;
    struct weights w = {.at = (uint32_t)top * PATCH_SIDE + (uint32_t)left};
    float sum = 0;
    for (uint32_t k = 0; k < 4; k++) {
        const uint32_t at = w.at + k / 2 * PATCH_SIDE + k % 2;
        const bool counts = patch->lit[at] && patch->chart[at] == chart;
        w.weight[k] = counts ? (k % 2 ? fx : 1 - fx) * (k / 2 ? fy : 1 - fy) : 0;
        sum += w.weight[k];
    }
    for (int k = 0; k < 4; k++) w.weight[k] /= sum; /* the block's own texel counts by a quarter and more */
    return w;
}

/* A coarse texel, and what of the tile lies in it. */
struct block {
    uint32_t own;           /* the coarse texel, within the patch */
    uint32_t x, y;          /* its first texel, of the tile */
    uint32_t width, height; /* in texels of the tile */
    struct weights weights[SIDE * SIDE];
};

static void weigh_block(struct block *block, const struct patch *patch) {
    for (uint32_t y = 0; y < block->height; y++)
        for (uint32_t x = 0; x < block->width; x++) /* the patch begins a coarse texel before the tile */
            block->weights[y * SIDE + x] =
                weigh(patch, patch->chart[block->own], 1 + ((float)(block->x + x) + 0.5f) / SIDE,
                      1 + ((float)(block->y + y) + 0.5f) / SIDE);
}

/* Texels are interpolated, and moved by what it takes for their mean to be that of the coarse texel. Where
 * light is so uneven that this would change a sign, all are as that texel: bilinear light does not go through
 * walls then. */
static void interpolate_block(const struct block *block, const float *from, float *to, uint32_t stride) {
    float value[SIDE * SIDE], sum = 0;
    const float own = from[block->own];
    for (uint32_t y = 0; y < block->height; y++)
        for (uint32_t x = 0; x < block->width; x++) {
            const struct weights *w = &block->weights[y * SIDE + x];
            const float *at = from + w->at;
            value[y * SIDE + x] = w->weight[0] * at[0] + w->weight[1] * at[1] +
                                  w->weight[2] * at[PATCH_SIDE] + w->weight[3] * at[PATCH_SIDE + 1];
            sum += value[y * SIDE + x];
        }
    const float shift = own - sum / (float)(block->width * block->height);
    bool even = own != 0;
    for (uint32_t y = 0; y < block->height; y++)
        for (uint32_t x = 0; x < block->width; x++) {
            const float moved = value[y * SIDE + x] + shift;
            even &= own > 0 ? moved >= 0 : moved <= 0;
        }
    for (uint32_t y = 0; y < block->height; y++)
        for (uint32_t x = 0; x < block->width; x++)
            to[y * stride + x] = even ? value[y * SIDE + x] + shift : own;
}

/* The block at (x, y) of a tile, and the coarse texel that it lies in. */
static struct block block_at(const struct lw_tile_place *place, uint32_t x, uint32_t y) {
    return (struct block){.own = (y / SIDE + 1) * PATCH_SIDE + x / SIDE + 1,
                          .x = x,
                          .y = y,
                          .width = place->width - x < SIDE ? place->width - x : SIDE,
                          .height = place->height - y < SIDE ? place->height - y : SIDE};
}

static void mark(uint8_t *covered_texels, uint8_t *filled_texels, const struct lw_tile_place *place,
                 const struct patch *patch) {
    for (uint32_t by = 0; by < place->height; by += SIDE)
        for (uint32_t bx = 0; bx < place->width; bx += SIDE) {
            const struct block block = block_at(place, bx, by);
            const bool covered = patch->covered[block.own], lit = patch->lit[block.own];
            for (uint32_t y = by; y < by + block.height; y++) {
                memset(covered_texels + y * place->width + bx, covered, block.width);
                memset(filled_texels + y * place->width + bx, lit && !covered, block.width);
            }
        }
}

static bool has_surface(const struct lw_tile_place *place, const struct patch *patch) {
    for (uint32_t y = 0; y < place->height; y += SIDE)
        for (uint32_t x = 0; x < place->width; x += SIDE)
            if (patch->covered[block_at(place, x, y).own]) return true;
    return false;
}

static void interpolate(float *plane, const struct lw_tile_place *place, const struct patch *patch,
                        uint32_t planes) {
    const uint32_t count = (uint32_t)place->width * place->height;
    memset(plane, 0, planes * count * sizeof *plane);
    for (uint32_t y = 0; y < place->height; y += SIDE)
        for (uint32_t x = 0; x < place->width; x += SIDE) {
            struct block block = block_at(place, x, y);
            if (!patch->lit[block.own]) continue;
            weigh_block(&block, patch);
            for (uint32_t p = 0; p < planes; p++)
                interpolate_block(&block, patch->plane[p], plane + p * count + y * place->width + x,
                                  place->width);
        }
}

/* Coarse tiles around a tile, as they are now. */
struct around {
    int64_t x0, y0; /* the patch's first texel */
    struct below below;
    struct lw_solver_tile tile[4];
    uint64_t solved_frame; /* the last of theirs */
};

static void read_around(const struct lw_coarse_tiles *tiles, const struct lw_solver *solver, uint32_t id,
                        struct around *out) {
    const struct lw_tile_place *place = &tiles->map->place[id];
    out->x0 = (int64_t)place->x * LW_TILE_SIDE / SIDE - 1;
    out->y0 = (int64_t)place->y * LW_TILE_SIDE / SIDE - 1;
    out->below = list_below(tiles->coarse_map, place->object, out->x0, out->y0);
    out->solved_frame = 0;
    for (uint32_t i = 0; i < out->below.count; i++) {
        solver->ops->read_tile(solver, out->below.id[i], &out->tile[i]);
        if (out->tile[i].solved_frame > out->solved_frame) out->solved_frame = out->tile[i].solved_frame;
    }
}

/* with_planes: of light, too, which mark() and has_surface() do not read. */
static void make_patch(const struct lw_coarse_tiles *tiles, const struct around *around, bool with_planes,
                       struct patch *out) {
    if (with_planes) /* weights of 0 read it */
        memset(out->plane, 0, count_planes(tiles->channels) * sizeof *out->plane);
    memset(out->covered, 0, sizeof out->covered);
    memset(out->lit, 0, sizeof out->lit);
    for (uint32_t i = 0; i < around->below.count; i++)
        copy_part(out, around->x0, around->y0, &around->tile[i],
                  &tiles->coarse_map->place[around->below.id[i].v], with_planes, tiles->channels);
}

static bool hold_planes(const struct lw_coarse_tiles *tiles, struct lw_coarse_tiles_tile *tile,
                        const struct lw_tile_place *place) {
    const size_t count = (size_t)place->width * place->height;
    if (tile->plane) return true;
    tile->covered = calloc(2 * count, 1);
    tile->filled = tile->covered ? tile->covered + count : NULL;
    tile->plane = malloc(count * count_planes(tiles->channels) * sizeof *tile->plane);
    if (tile->covered && tile->plane) return true;
    forget(tile);
    return false;
}

static bool update_tile(struct lw_coarse_tiles *tiles, const struct lw_solver *solver, uint32_t id,
                        struct patch *patch) {
    const struct lw_tile_place *place = &tiles->map->place[id];
    struct lw_coarse_tiles_tile *tile = &tiles->tile[id];
    struct around around;
    read_around(tiles, solver, id, &around);
    if (tile->is_known && around.solved_frame <= tile->solved_frame) return true;
    if (tiles->holds_planes && !hold_planes(tiles, tile, place)) return false;
    make_patch(tiles, &around, tiles->holds_planes, patch);
    tile->sample_count = UINT32_MAX;
    for (uint32_t i = 0; i < around.below.count; i++)
        if (around.tile[i].sample_count < tile->sample_count)
            tile->sample_count = around.tile[i].sample_count;
    tile->bounces = around.tile[0].bounces;
    tile->solved_frame = around.solved_frame;
    tile->is_known = true;
    tile->has_surface = has_surface(place, patch);
    if (!tile->plane) return true;
    mark(tile->covered, tile->filled, place, patch);
    interpolate(tile->plane, place, patch, count_planes(tiles->channels));
    return true;
}

static void set_channels(struct lw_coarse_tiles *tiles, uint32_t channels) {
    if (channels != tiles->channels)
        for (uint32_t id = 0; id < tiles->map->plain_count; id++) forget(&tiles->tile[id]);
    tiles->channels = channels;
}

enum lw_status lw_coarse_tiles_update(struct lw_coarse_tiles *tiles, const struct lw_solver *solver,
                                      uint32_t channels, const uint8_t *skipped) {
    int failures = 0;
    set_channels(tiles, channels);
#pragma omp parallel num_threads(tiles->threads) reduction(+ : failures)
    {
        struct patch *patch = malloc(sizeof *patch);
#pragma omp for schedule(dynamic, 4)
        for (uint32_t id = 0; id < tiles->map->plain_count; id++)
            if (is_used(tiles, id) && !(skipped && skipped[id]))
                failures += !patch || !update_tile(tiles, solver, id, patch);
        free(patch);
    }
    return failures ? LW_NO_MEMORY : LW_OK;
}

enum lw_status lw_coarse_tiles_update_one(struct lw_coarse_tiles *tiles, const struct lw_solver *solver,
                                          uint32_t channels, lw_tile_id id) {
    struct patch *patch = malloc(sizeof *patch);
    LW_INVARIANT(is_used(tiles, id.v));
    set_channels(tiles, channels);
    const bool done = patch && update_tile(tiles, solver, id.v, patch);
    free(patch);
    return done ? LW_OK : LW_NO_MEMORY;
}

static void set_planes(const struct lw_coarse_tiles *tiles, const float *plane, size_t count,
                       struct lw_solver_tile *out_tile) {
    for (int c = 0; c < 3; c++, plane += count) {
        out_tile->direct[c] = plane;
        out_tile->indirect[c] = black;
    }
    LW_TILE_CHANNELS_EACH (channel, tiles->channels)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++, plane += count)
            out_tile->shown[channel][p] = plane;
}

void lw_coarse_tiles_read(const struct lw_coarse_tiles *tiles, lw_tile_id id,
                          struct lw_solver_tile *out_tile) {
    const struct lw_tile_place *place = &tiles->map->place[id.v];
    const struct lw_coarse_tiles_tile *tile = &tiles->tile[id.v];
    LW_INVARIANT(id.v < tiles->map->plain_count && is_used(tiles, id.v) && tile->is_known);
    *out_tile = (struct lw_solver_tile){.covered = tile->covered,
                                        .filled = tile->filled,
                                        .width = place->width,
                                        .height = place->height,
                                        .bounces = tile->bounces,
                                        .sample_count = tile->sample_count,
                                        .error = tile->has_surface ? LW_ATLAS_COARSE_ERROR : 0,
                                        .solved_frame = tile->solved_frame,
                                        .has_surface = tile->has_surface};
    if (tile->plane) set_planes(tiles, tile->plane, (size_t)place->width * place->height, out_tile);
}

void lw_coarse_tiles_read_planes(const struct lw_coarse_tiles *tiles, const struct lw_solver *solver,
                                 lw_tile_id id, struct lw_solver_room *room,
                                 struct lw_solver_tile *read_tile) {
    const struct lw_tile_place *place = &tiles->map->place[id.v];
    struct around around;
    struct patch patch;
    read_around(tiles, solver, id.v, &around);
    make_patch(tiles, &around, true, &patch);
    mark(room->covered, room->filled, place, &patch);
    read_tile->covered = room->covered;
    read_tile->filled = room->filled;
    interpolate(room->plane[0], place, &patch, count_planes(tiles->channels));
    set_planes(tiles, room->plane[0], (size_t)place->width * place->height, read_tile);
}
