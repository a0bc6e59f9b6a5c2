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

enum lw_status lw_tiles_init(struct lw_tiles *tiles, const struct lw_scene *scene,
                             const struct lw_atlas_map *map, const struct lw_texels *texels,
                             uint32_t bounces) {
    *tiles = (struct lw_tiles){.bounces = bounces, .texel_count = texels->count, .covered = texels->covered};
    for (uint32_t id = 0; id < map->tile_count; id++) tiles->count += map->place[id].level == 0;
    tiles->tile = calloc((size_t)tiles->count + 1, sizeof *tiles->tile);
    tiles->slot_of_id = malloc(((size_t)map->tile_count + 1) * sizeof *tiles->slot_of_id);
    if (!tiles->tile || !tiles->slot_of_id || !allocate_sums(tiles)) {
        lw_tiles_finish(tiles);
        return LW_NO_MEMORY;
    }
    uint32_t n = 0;
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
                                       .error = 1};
        tile->first = texels->first[place->object] + tile->local;
        bound_tile(tile, texels->covered);
        tile->resting = tile->covered_count == 0;
    }
    return LW_OK;
}

void lw_tiles_recount(struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t before = tile->covered_count;
        bound_tile(tile, tiles->covered);
        if (tile->covered_count == before) continue;
        tile->history = 0;
        tile->resting = tile->covered_count == 0;
    }
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
