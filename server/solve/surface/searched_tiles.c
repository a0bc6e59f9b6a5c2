#include "server/solve/surface/searched_tiles.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#define COMPRESSION_LEVEL 1

struct result {
    uint32_t object, level, x, y, changes;
    uint32_t size; /* bytes, compressed */
    uint64_t used;
    uint8_t *bytes;
};

struct lw_searched_tiles {
    struct result *result;
    uint32_t count, tiles_max;
    size_t bytes, bytes_max; /* compressed */
    uint64_t clock;          /* calls of keep */
};

/* The arrays of a tile, as they are compressed: differences, most of which are 0. Those of points and of
 * coverage are from a tile without hidden points. */
struct plain {
    uint32_t side[LW_TILE_TEXELS_MAX];  /* less the side of the texel before */
    int16_t source[LW_TILE_TEXELS_MAX]; /* less the texel's own index, or SOURCE_NONE */
    uint8_t covered[LW_TILE_TEXELS_MAX], usable[LW_TILE_TEXELS_MAX], walls[LW_TILE_TEXELS_MAX];
};
#define SOURCE_NONE INT16_MIN
_Static_assert(LW_TILE_TEXELS_MAX < -INT16_MIN, "differences of indices fit");

enum lw_status lw_searched_tiles_create(uint32_t tiles_max, size_t bytes_max,
                                        struct lw_searched_tiles **out_tiles) {
    struct lw_searched_tiles *tiles = calloc(1, sizeof *tiles);
    if (!tiles) return LW_NO_MEMORY;
    *tiles = (struct lw_searched_tiles){.tiles_max = tiles_max, .bytes_max = bytes_max};
    if (!(tiles->result = calloc(tiles_max + 1ul, sizeof *tiles->result))) {
        free(tiles);
        return LW_NO_MEMORY;
    }
    *out_tiles = tiles;
    return LW_OK;
}

void lw_searched_tiles_destroy(struct lw_searched_tiles *tiles) {
    if (!tiles) return;
    for (uint32_t i = 0; i < tiles->count; i++) free(tiles->result[i].bytes);
    free(tiles->result);
    free(tiles);
}

size_t lw_searched_tiles_memory_bytes(const struct lw_searched_tiles *tiles) {
    return tiles ? tiles->bytes + tiles->tiles_max * sizeof *tiles->result : 0;
}

static struct result *find(const struct lw_searched_tiles *tiles, const struct lw_tile_place *place) {
    for (uint32_t i = 0; tiles && i < tiles->count; i++) {
        struct result *r = &tiles->result[i];
        if (r->object == place->object && r->level == place->level && r->x == place->x && r->y == place->y)
            return r;
    }
    return NULL;
}

bool lw_searched_tiles_find(const struct lw_searched_tiles *tiles, const struct lw_tile_place *place,
                            uint32_t changes) {
    const struct result *r = find(tiles, place);
    return r && r->changes == changes;
}

enum lw_status lw_searched_tiles_restore(const struct lw_searched_tiles *tiles,
                                         const struct lw_tile_place *place,
                                         const struct lw_searched_texels *texels) {
    const struct result *r = find(tiles, place);
    struct plain *plain = malloc(sizeof *plain);
    LW_INVARIANT(r && texels->mesh->texel_count <= LW_TILE_TEXELS_MAX);
    if (!plain || ZSTD_decompress(plain, sizeof *plain, r->bytes, r->size) != sizeof *plain) {
        free(plain);
        return LW_NO_MEMORY;
    }
    const uint32_t count = texels->mesh->texel_count;
    const struct lw_mesh_texels *mesh = texels->mesh;
    memcpy(texels->walls, plain->walls, count);
    for (uint32_t i = 0; i < count; i++) {
        texels->covered[i] = plain->covered[i] ^ mesh->covered[i];
        texels->usable[i] = plain->usable[i] ^ lw_sample_points_all(&mesh->sample_points, i);
        texels->side[i] = plain->side[i] + (i ? texels->side[i - 1] : 0);
        texels->source[i] =
            plain->source[i] == SOURCE_NONE ? LW_TEXEL_NONE : (uint32_t)(plain->source[i] + (int)i);
        texels->filled[i] = !texels->covered[i] && texels->source[i] != LW_TEXEL_NONE;
    }
    free(plain);
    return LW_OK;
}

static void fill(struct plain *plain, const struct lw_searched_texels *texels) {
    const struct lw_mesh_texels *mesh = texels->mesh;
    memcpy(plain->walls, texels->walls, mesh->texel_count);
    for (uint32_t i = 0; i < mesh->texel_count; i++) {
        plain->covered[i] = texels->covered[i] ^ mesh->covered[i];
        plain->usable[i] = texels->usable[i] ^ lw_sample_points_all(&mesh->sample_points, i);
        plain->side[i] = texels->side[i] - (i ? texels->side[i - 1] : 0);
        plain->source[i] =
            texels->source[i] == LW_TEXEL_NONE ? SOURCE_NONE : (int16_t)((int)texels->source[i] - (int)i);
    }
}

/* Compresses a tile's arrays. malloc'ed; NULL: no memory. */
static uint8_t *compress(const struct lw_searched_texels *texels, uint32_t *out_size) {
    struct plain *plain = calloc(1, sizeof *plain);
    const size_t bound = ZSTD_compressBound(sizeof *plain);
    uint8_t *bytes = malloc(bound), *fitting = NULL;
    if (plain && bytes) {
        fill(plain, texels);
        const size_t size = ZSTD_compress(bytes, bound, plain, sizeof *plain, COMPRESSION_LEVEL);
        if (!ZSTD_isError(size) && (fitting = realloc(bytes, size))) {
            bytes = NULL;
            *out_size = (uint32_t)size;
        }
    }
    free(plain);
    free(bytes);
    return fitting;
}

static void forget(struct lw_searched_tiles *tiles, struct result *r) {
    tiles->bytes -= r->size;
    free(r->bytes);
    *r = tiles->result[--tiles->count];
}

static struct result *oldest(const struct lw_searched_tiles *tiles) {
    struct result *best = NULL;
    for (uint32_t i = 0; i < tiles->count; i++)
        if (!best || tiles->result[i].used < best->used) best = &tiles->result[i];
    return best;
}

void lw_searched_tiles_keep(struct lw_searched_tiles *tiles, const struct lw_tile_place *place,
                            uint32_t changes, const struct lw_searched_texels *texels) {
    struct result *r = find(tiles, place);
    const uint64_t used = ++tiles->clock;
    uint32_t size = 0;
    if (r && r->changes == changes) {
        r->used = used;
        return;
    }
    if (r) forget(tiles, r);
    uint8_t *bytes = compress(texels, &size);
    if (!bytes || !tiles->tiles_max || size > tiles->bytes_max) {
        free(bytes);
        return;
    }
    while (tiles->count == tiles->tiles_max || tiles->bytes + size > tiles->bytes_max)
        forget(tiles, oldest(tiles));
    tiles->result[tiles->count++] = (struct result){.object = place->object,
                                                    .level = place->level,
                                                    .x = place->x,
                                                    .y = place->y,
                                                    .changes = changes,
                                                    .size = size,
                                                    .used = used,
                                                    .bytes = bytes};
    tiles->bytes += size;
    LW_INVARIANT(tiles->count <= tiles->tiles_max && tiles->bytes <= tiles->bytes_max);
}
