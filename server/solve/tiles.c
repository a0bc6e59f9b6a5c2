#include "server/solve/tiles.h"

#include <stdlib.h>

static bool allocate_sums(struct lw_tiles *tiles) {
    const size_t count = tiles->texel_count ? tiles->texel_count : 1;
    bool ok = true;
    for (int c = 0; c < 3; c++) {
        ok &= (tiles->direct[c] = calloc(count, sizeof(float))) != NULL;
        ok &= (tiles->indirect[c] = calloc(count, sizeof(float))) != NULL;
        ok &= (tiles->light[c] = calloc(count, sizeof(float))) != NULL;
        for (uint32_t k = 0; k < tiles->bounces; k++)
            ok &= (tiles->order[k][c] = calloc(count, sizeof(float))) != NULL;
    }
    for (uint32_t k = 0; k < tiles->bounces; k++)
        ok &= (tiles->radiance[k] = calloc(count, 4 * sizeof(float))) != NULL;
    ok &= (tiles->estimate = calloc(count, sizeof(float))) != NULL;
    ok &= (tiles->mean = calloc(count, sizeof(float))) != NULL;
    ok &= (tiles->spread = calloc(count, sizeof(float))) != NULL;
    return ok;
}

/* The sphere around the box of a tile's texels. */
static void bound_tile(struct lw_solve_tile *tile, const uint8_t *covered) {
    const struct lw_mesh_texels *mesh = tile->mesh;
    struct lw_vec3 lo = lw_vec3(INFINITY, INFINITY, INFINITY), hi = lw_vec3(-INFINITY, -INFINITY, -INFINITY);
    tile->covered_count = 0;
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        if (!covered[tile->first + i]) continue;
        struct lw_vec3 p = lw_texels_vector(mesh->position, tile->local + i);
        lo = lw_vec3(fminf(lo.x, p.x), fminf(lo.y, p.y), fminf(lo.z, p.z));
        hi = lw_vec3(fmaxf(hi.x, p.x), fmaxf(hi.y, p.y), fmaxf(hi.z, p.z));
        tile->covered_count++;
    }
    if (!tile->covered_count) return;
    tile->centre_os = lw_vec3_scale(lw_vec3_add(lo, hi), 0.5f);
    tile->radius_os = 0.5f * lw_vec3_length(lw_vec3_sub(hi, lo));
}

static uint32_t blocks_along(uint32_t texels) { return (texels + LW_TILE_BLOCK - 1) / LW_TILE_BLOCK; }

static uint32_t side_of(uint32_t block, uint32_t texels) {
    const uint32_t left = texels - block * LW_TILE_BLOCK;
    return left < LW_TILE_BLOCK ? left : LW_TILE_BLOCK;
}

/* In a tile that is covered all over. */
static uint32_t packets_at_most(uint32_t width, uint32_t height) {
    return blocks_along(width) * blocks_along(height) * LW_PACKETS_MAX;
}

static void deal_packets(struct lw_tiles *tiles, int threads) {
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (uint32_t t = 0; t < tiles->count; t++) {
        struct lw_solve_tile *tile = &tiles->tile[t];
        uint32_t block = 0, packets = 0;
        for (uint32_t row = 0; row < blocks_along(tile->height); row++)
            for (uint32_t column = 0; column < blocks_along(tile->width); column++) {
                const uint32_t i = row * LW_TILE_BLOCK * tile->width + column * LW_TILE_BLOCK;
                tile->packet_of_block[block++] = (uint16_t)packets;
                packets += lw_packets_deal(tile->mesh, tile->local + i, tile->width,
                                           side_of(column, tile->width), side_of(row, tile->height),
                                           tiles->covered + tile->first + i, tile->packet + packets);
            }
        tile->packet_of_block[block] = (uint16_t)packets;
        tile->block_count = block;
    }
}

enum lw_status lw_tiles_init(struct lw_tiles *tiles, const struct lw_scene *scene,
                             const struct lw_atlas_map *map, const struct lw_texels *texels, uint32_t bounces,
                             int threads) {
    *tiles = (struct lw_tiles){.bounces = bounces, .texel_count = texels->count, .covered = texels->covered};
    size_t packets = 0;
    for (uint32_t id = 0; id < map->tile_count; id++) {
        if (map->place[id].level != 0) continue;
        tiles->count++;
        packets += packets_at_most(map->place[id].width, map->place[id].height);
    }
    tiles->tile = calloc((size_t)tiles->count + 1, sizeof *tiles->tile);
    tiles->slot_of_id = malloc(((size_t)map->tile_count + 1) * sizeof *tiles->slot_of_id);
    tiles->packet = malloc((packets + 1) * sizeof *tiles->packet);
    if (!tiles->tile || !tiles->packet || !tiles->slot_of_id || !allocate_sums(tiles)) {
        lw_tiles_finish(tiles);
        return LW_NO_MEMORY;
    }
    uint32_t n = 0;
    packets = 0;
    for (uint32_t id = 0; id < map->tile_count; id++) {
        const struct lw_tile_place *place = &map->place[id];
        tiles->slot_of_id[id] = UINT32_MAX;
        if (place->level != 0) continue;
        const struct lw_mesh_texels *mesh = &texels->mesh[scene->object[place->object].mesh];
        struct lw_solve_tile *tile = &tiles->tile[n++];
        *tile = (struct lw_solve_tile){.id = {id},
                                       .object = place->object,
                                       .x = place->x,
                                       .y = place->y,
                                       .width = place->width,
                                       .height = place->height,
                                       .mesh = mesh,
                                       .local = lw_texels_tile_start(mesh, place->x, place->y),
                                       .packet = tiles->packet + packets,
                                       .error = 1};
        packets += packets_at_most(place->width, place->height);
        tile->first = texels->first[place->object] + tile->local;
        bound_tile(tile, texels->covered);
        tile->resting = tile->covered_count == 0;
    }
    deal_packets(tiles, threads);
    return LW_OK;
}

void lw_tiles_recount(struct lw_tiles *tiles, int threads) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t before = tile->covered_count;
        bound_tile(tile, tiles->covered);
        if (tile->covered_count == before) continue;
        tile->history = 0;
        tile->resting = tile->covered_count == 0;
    }
    deal_packets(tiles, threads);
}

void lw_tiles_finish(struct lw_tiles *tiles) {
    for (int c = 0; c < 3; c++) {
        free(tiles->direct[c]);
        free(tiles->indirect[c]);
        free(tiles->light[c]);
        for (uint32_t k = 0; k < LW_SOLVER_BOUNCES_MAX; k++) free(tiles->order[k][c]);
    }
    for (uint32_t k = 0; k < LW_SOLVER_BOUNCES_MAX; k++) free(tiles->radiance[k]);
    free(tiles->estimate);
    free(tiles->mean);
    free(tiles->spread);
    free(tiles->slot_of_id);
    free(tiles->packet);
    free(tiles->tile);
    *tiles = (struct lw_tiles){0};
}

void lw_tiles_fill_gutters(struct lw_tiles *tiles, const struct lw_texels *texels, const uint8_t *welded,
                           int threads) {
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t t = 0; t < texels->count; t++) {
        const uint32_t source = texels->source[t];
        if (source == t || source == LW_TEXEL_NONE || welded[t]) continue;
        for (int c = 0; c < 3; c++) tiles->light[c][t] = tiles->light[c][source];
    }
}

static int by_cell(const void *a, const void *b) {
    const struct lw_solve_tile *x = a, *y = b;
    if (x->cell != y->cell) return x->cell < y->cell ? -1 : 1;
    return x->id.v < y->id.v ? -1 : x->id.v > y->id.v;
}

void lw_tiles_set_pose(struct lw_tiles *tiles, const struct lw_cells *cells, const struct lw_pose *pose) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const struct lw_affine *t = &pose->object_to_world[tile->object];
        float longest = 0; /* no direction is stretched more than by the Frobenius norm */
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) longest += t->m[r][c] * t->m[r][c];
        tile->centre_ws = lw_affine_point(t, tile->centre_os);
        tile->radius_m = tile->radius_os * sqrtf(longest);
        tile->cell = lw_cells_at(cells, tile->centre_ws);
    }
    qsort(tiles->tile, tiles->count, sizeof *tiles->tile, by_cell);
    for (uint32_t i = 0; i < tiles->count; i++) tiles->slot_of_id[tiles->tile[i].id.v] = i;
}
