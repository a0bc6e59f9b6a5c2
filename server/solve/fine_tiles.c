#include "server/solve/fine_tiles.h"

#include "common/base/invariant.h"
#include "common/base/log.h"
#include "server/solve/filter/denoise.h"
#include "server/solve/surface/invalid_texels.h"

#include <stdlib.h>
#include <string.h>

/* Tiles that are made at the beginning of a frame, at most. */
#define MAKE_MAX 2u
/* Frames that the tile of level 0 below has in its mean before, and its error: the coarse picture comes
 * first, and is smooth before rays go to finer tiles, which are many. */
#define FRAMES_BELOW 8u
#define ERROR_BELOW  0.05f

enum lw_status lw_fine_tiles_init(struct lw_fine_tiles *fine, struct lw_texels *texels,
                                  const struct lw_atlas_map *map, enum lw_fine_when when, int threads) {
    *fine = (struct lw_fine_tiles){.texels = texels,
                                   .map = map,
                                   .slots = (texels->capacity - texels->count) / LW_TILE_TEXELS_MAX,
                                   .when = when,
                                   .threads = threads};
    if (!fine->slots || !map->finer_count) return LW_OK;
    fine->tile = calloc(fine->slots, sizeof *fine->tile);
    fine->shown = malloc(fine->slots * sizeof *fine->shown);
    fine->fresh = malloc(fine->slots * sizeof(struct lw_fine_tile *));
    if (!fine->tile || !fine->shown || !fine->fresh) return LW_NO_MEMORY;
    return lw_fine_texels_maker_create(texels, when == LW_FINE_AT_ONCE_FOR_MAPS, &fine->maker);
}

void lw_fine_tiles_add_layer(struct lw_fine_tiles *fine, const struct lw_fine_tiles_layer *layer) {
    LW_INVARIANT(fine->layers < LW_LIGHT_GROUPS_MAX && !fine->used);
    fine->layer[fine->layers++] = *layer;
}

void lw_fine_tiles_finish(struct lw_fine_tiles *fine) {
    for (uint32_t k = 0; fine->tile && k < fine->slots; k++) {
        lw_fine_texels_finish(&fine->tile[k].texels);
        free(fine->tile[k].pair);
    }
    lw_fine_texels_maker_destroy(fine->maker);
    free(fine->tile);
    free(fine->shown);
    free(fine->fresh);
    free(fine->wanted);
    *fine = (struct lw_fine_tiles){0};
}

size_t lw_fine_tiles_memory_bytes(const struct lw_fine_tiles *fine) {
    if (!fine->maker) return 0;
    size_t bytes = fine->slots * (sizeof *fine->tile + sizeof *fine->shown) +
                   fine->wanted_count * sizeof *fine->wanted + lw_fine_texels_maker_memory_bytes(fine->maker);
    for (uint32_t k = 0; k < fine->slots; k++) {
        const struct lw_mesh_texels *mesh = &fine->tile[k].texels.mesh;
        if (!fine->tile[k].used) continue;
        bytes += mesh->texel_count *
                     (3 * sizeof *mesh->position[0] + sizeof *mesh->normal + sizeof *mesh->geometric +
                      (mesh->albedo ? sizeof *mesh->albedo : 0) + sizeof *mesh->chart) +
                 lw_sample_points_memory_bytes(&mesh->sample_points, mesh->texel_count);
    }
    return bytes;
}

static int compare_keys(const void *left, const void *right) {
    const uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return (a > b) - (a < b);
}

enum lw_status lw_fine_tiles_want(struct lw_fine_tiles *fine, const uint8_t *interest) {
    if (!fine->maker) return LW_OK;
    uint32_t count = 0;
    for (uint32_t id = fine->map->plain_count; interest && id < fine->map->tile_count; id++)
        count += interest[id] != 0;
    lw_tile_id *wanted = malloc((count + 1ul) * sizeof *wanted);
    uint64_t *key = malloc((count + 1ul) * sizeof *key);
    if (!wanted || !key) {
        free(wanted);
        free(key);
        return LW_NO_MEMORY;
    }
    count = 0;
    for (uint32_t id = fine->map->plain_count; interest && id < fine->map->tile_count; id++)
        if (interest[id])
            key[count++] =
                ((uint64_t)interest[id] << 8 | lw_atlas_finer(fine->map->place[id].level)) << 32 | id;
    qsort(key, count, sizeof *key, compare_keys);
    for (uint32_t i = 0; i < count; i++) wanted[i].v = (uint32_t)key[i];
    free(key);
    free(fine->wanted);
    fine->wanted = wanted;
    fine->wanted_count = count;
    fine->granted_count = count < fine->slots ? count : fine->slots;
    return LW_OK;
}

static void empty(struct lw_fine_tiles *fine, struct lw_fine_tile *tile) {
    lw_fine_texels_finish(&tile->texels);
    free(tile->pair);
    *tile = (struct lw_fine_tile){.used = false};
    fine->used--;
}

#define EACH_LAYER(fine, at)                                                                                 \
    for (const struct lw_fine_tiles_layer *at = (fine)->layer, *end_ = at + (fine)->layers; at < end_; at++)

/* The first of the texels of a slot. */
static uint32_t first_of(const struct lw_fine_tiles *fine, const struct lw_fine_tile *tile) {
    return fine->texels->count + (uint32_t)(tile - fine->tile) * LW_TILE_TEXELS_MAX;
}

static void drop(struct lw_fine_tiles *fine, struct lw_fine_tile *tile) {
    LW_INVARIANT(tile->used && fine->used > 0);
    EACH_LAYER(fine, layer) {
        layer->note(layer->user, tile->id);
        lw_tiles_remove_fine(layer->tiles, tile->id);
    }
    memset(fine->texels->covered + first_of(fine, tile), 0, LW_TILE_TEXELS_MAX);
    empty(fine, tile);
}

/* Texels of level 0 are others than those that a tile was made from. */
static bool is_outdated(const struct lw_fine_tiles *fine, const struct lw_fine_tile *tile) {
    const struct lw_solve_tile *solved = lw_tiles_at(fine->layer[0].tiles, tile->id);
    return solved->changes != fine->texels->changes[solved->object];
}

/* A slot for a tile: an empty one, or that of the tile that has been granted to nobody for the longest. */
static struct lw_fine_tile *find_slot(const struct lw_fine_tiles *fine, uint64_t frame) {
    struct lw_fine_tile *best = NULL;
    for (uint32_t k = 0; k < fine->slots; k++) {
        struct lw_fine_tile *tile = &fine->tile[k];
        if (!tile->used) return tile;
        if (tile->looked_at < frame && (!best || tile->looked_at < best->looked_at)) best = tile;
    }
    LW_INVARIANT(best); /* no more tiles are granted than there are slots */
    return best;
}

/* What stands for a gutter whose chart lies beyond the tile: the texel of level 0 that does so there. */
static uint32_t source_below(const struct lw_fine_tiles *fine, const struct lw_fine_tile *tile, uint32_t i) {
    const struct lw_texels *texels = fine->texels;
    const struct lw_tile_place *place = &fine->map->place[tile->id.v];
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[place->object].mesh];
    const uint32_t finer = lw_atlas_finer(place->level),
                   x = (place->x * LW_TILE_SIDE + i % place->width) >> finer,
                   y = (place->y * LW_TILE_SIDE + i / place->width) >> finer;
    return texels->source[texels->first[place->object] + lw_texels_index(mesh, x, y)];
}

/* Gives the scene's texels those of a tile, and the tiles the tile. */
static void add(struct lw_fine_tiles *fine, struct lw_fine_tile *tile) {
    struct lw_texels *texels = fine->texels;
    const uint32_t slot = (uint32_t)(tile - fine->tile), first = first_of(fine, tile),
                   count = tile->texels.mesh.texel_count;
    memcpy(texels->covered + first, tile->texels.covered, count);
    memcpy(texels->usable + first, tile->texels.usable, count);
    memcpy(texels->walls + first, tile->texels.walls, count);
    memcpy(texels->side + first, tile->texels.side, count * sizeof *texels->side);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t source = tile->texels.source[i];
        texels->source[first + i] = source == LW_TEXEL_NONE ? source_below(fine, tile, i) : first + source;
        texels->filled[first + i] = !tile->texels.covered[i] && texels->source[first + i] != LW_TEXEL_NONE;
    }
    lw_fine_texels_remember(fine->maker, &fine->map->place[tile->id.v], &tile->texels);
    EACH_LAYER(fine, layer) {
        lw_tiles_add_fine(layer->tiles, tile->id, &fine->map->place[tile->id.v], slot, &tile->texels.mesh,
                          tile->pair);
        layer->note(layer->user, tile->id);
    }
}

static enum lw_status make(const struct lw_fine_tiles *fine, const struct lw_hidden_points_search *points,
                           struct lw_fine_tile *tile) {
    enum lw_status status =
        lw_fine_texels_make(fine->maker, points, &fine->map->place[tile->id.v], &tile->texels);
    if (status != LW_OK) return status;
    tile->pair = lw_denoise_pairs_of_fine(&tile->texels.mesh, tile->texels.walls);
    return tile->pair ? LW_OK : LW_NO_MEMORY;
}

static bool is_there(const struct lw_fine_tiles *fine, lw_tile_id id) {
    return lw_tiles_have(fine->layer[0].tiles, id);
}

/* Drops tiles that are out of date, and notes which ones are granted. Returns whether any was dropped. */
static bool review(struct lw_fine_tiles *fine, uint64_t frame) {
    bool changed = false;
    for (uint32_t k = 0; k < fine->slots && fine->used; k++) {
        struct lw_fine_tile *tile = &fine->tile[k];
        if (!tile->used || !is_outdated(fine, tile)) continue;
        drop(fine, tile);
        changed = true;
    }
    for (uint32_t i = 0; i < fine->granted_count; i++)
        if (is_there(fine, fine->wanted[i]))
            fine->tile[lw_tiles_at(fine->layer[0].tiles, fine->wanted[i])->fine_slot].looked_at = frame;
    return changed;
}

/* Whether the light of level 0 below a tile is good enough to go on with detail, in any layer. That of hidden
 * objects, spares among them, never is. */
static bool is_due(const struct lw_fine_tiles *fine, lw_tile_id id) {
    const lw_tile_id below = lw_atlas_map_below(fine->map, id);
    if (fine->when == LW_FINE_AT_ONCE_FOR_MAPS) return true;
    if (lw_tiles_at(fine->layer[0].tiles, below)->hidden) return false;
    EACH_LAYER(fine, layer) {
        const struct lw_solve_tile *tile = lw_tiles_at(layer->tiles, below);
        if (!tile->covered_count) return true;
        const bool is_smooth = fine->when == LW_FINE_AFTER_FRAMES || tile->light.error <= ERROR_BELOW;
        if (tile->light.sample_count >= FRAMES_BELOW && is_smooth) return true;
    }
    return false;
}

/* Finds slots for the next tiles that are granted. Returns how many. */
static uint32_t choose(struct lw_fine_tiles *fine, uint64_t frame) {
    const uint32_t most = fine->when == LW_FINE_AT_ONCE_FOR_MAPS ? fine->slots : MAKE_MAX;
    uint32_t count = 0;
    for (uint32_t i = 0; i < fine->granted_count && count < most; i++) {
        const lw_tile_id id = fine->wanted[i];
        if (is_there(fine, id) || !is_due(fine, id)) continue;
        struct lw_fine_tile *tile = find_slot(fine, frame);
        if (tile->used) drop(fine, tile);
        *tile = (struct lw_fine_tile){.used = true, .id = id, .made = frame, .looked_at = frame};
        fine->fresh[count++] = tile;
        fine->used++;
    }
    return count;
}

static void tell_if_full(struct lw_fine_tiles *fine) {
    if (fine->granted_count == fine->wanted_count || fine->warned) return;
    fine->warned = true;
    lw_log(LW_LOG_WARNING,
           "there is no room for all detail that is asked for: for %u of %u tiles, coarser levels of each "
           "client first (--memory)",
           fine->granted_count, fine->wanted_count);
}

enum lw_status lw_fine_tiles_update(struct lw_fine_tiles *fine, const struct lw_pose *pose,
                                    const struct lw_trace *trace, uint64_t frame) {
    if (!fine->maker || fine->frame == frame) return LW_OK;
    fine->frame = frame;
    bool changed = review(fine, frame);
    const uint32_t count = choose(fine, frame);
    struct lw_fine_tile *const *fresh = fine->fresh;
    struct lw_hidden_points_search points = {.texels = NULL};
    int failures = 0;
    if (count) points = lw_invalid_texels_points(fine->texels, pose, trace);
    for (uint32_t i = 0; i < count; i++)
        failures += lw_fine_texels_prepare(fine->maker, fine->map->place[fresh[i]->id.v].object) != LW_OK;
#pragma omp parallel for schedule(dynamic, 1) num_threads(fine->threads) reduction(+ : failures)
    for (uint32_t i = 0; i < count; i++)
        if (!failures) failures += make(fine, &points, fresh[i]) != LW_OK;
    for (uint32_t i = 0; i < count; i++) failures ? empty(fine, fresh[i]) : add(fine, fresh[i]);
    changed |= count > 0;
    tell_if_full(fine);
    EACH_LAYER(fine, layer)
    if (changed) layer->place(layer->user);
    return failures ? LW_NO_MEMORY : LW_OK;
}

static void fill_plane(const struct lw_texels *texels, const struct lw_solve_tile *tile, float *plane) {
    for (uint32_t i = tile->first; i < tile->first + tile->width * tile->height; i++)
        if (texels->filled[i]) plane[i] = plane[texels->source[i]];
}

void lw_fine_tiles_fill(const struct lw_fine_tiles *fine, struct lw_tiles *tiles, uint64_t frame, bool any,
                        uint32_t channels) {
    for (uint32_t k = 0; k < fine->slots && fine->used; k++) {
        if (!fine->tile[k].used) continue;
        struct lw_solve_tile *tile = lw_tiles_at(tiles, fine->tile[k].id);
        /* a tile of gutters alone is never solved: their sources may be newly solved */
        if (!tile->covered_count && (any || !tile->light.solved_frame)) tile->light.solved_frame = frame;
        if (tile->light.solved_frame != frame) continue;
        LW_TILE_CHANNELS_EACH (channel, channels)
            for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
                fill_plane(fine->texels, tile, tiles->shown[channel][p]);
    }
}

uint32_t lw_fine_tiles_list(const struct lw_fine_tiles *fine,
                            bool (*has_light)(const void *user, lw_tile_id id), const void *user,
                            const lw_tile_id **out_tile) {
    uint32_t count = 0;
    for (uint32_t k = 0; k < fine->slots && fine->used; k++)
        if (fine->tile[k].used && has_light(user, fine->tile[k].id)) fine->shown[count++] = fine->tile[k].id;
    if (count) qsort(fine->shown, count, sizeof *fine->shown, lw_tile_id_compare);
    *out_tile = fine->shown;
    return count;
}
