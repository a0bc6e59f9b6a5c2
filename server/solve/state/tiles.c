#include "server/solve/state/tiles.h"

#include "common/base/box.h"
#include "common/base/colour.h"
#include "common/base/invariant.h"
#include "common/base/random.h"

#include <stdlib.h>
#include <string.h>

/* A plane: where it hangs, a float for each texel unless it is packed light. All that
 * allocates, frees or counts them goes by these lists. */
struct plane {
    float **at;
    uint64_t **packed; /* NULL: at is not */
};
static size_t plane_bytes(const struct plane *plane) {
    return plane->at ? sizeof **plane->at : sizeof **plane->packed;
}
static void *plane_of(const struct plane *plane) {
    return plane->at ? (void *)*plane->at : (void *)*plane->packed;
}
#define CHANNEL_PLANES_MAX (2 * LW_TILE_CHANNELS_MAX * LW_TILE_CHANNEL_PLANES_MAX + 9)
#define PLANES_MAX                                                                                           \
    (3 * (LW_TILES_BOUNCES_MAX + LW_TILES_ESTIMATES + 2) + CHANNEL_PLANES_MAX + LW_TILES_BOUNCES_MAX + 2)

/* Lists the planes of a set of channels: the shown ones, and the sums that no irradiance has. Returns n
 * and their number. */
static uint32_t list_channels(struct lw_tiles *tiles, uint32_t channels, uint32_t n,
                              struct plane out[PLANES_MAX]) {
    LW_TILE_CHANNELS_EACH (channel, channels)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++) {
            out[n++] = (struct plane){.at = &tiles->shown[channel][p]};
            if (channel >= LW_TILE_CHANNEL_IRRADIANCES && !lw_tile_channel_at(channel)->moment)
                out[n++] = (struct plane){.at = &tiles->sum[channel][p]};
        }
    return n;
}

/* Lists the planes of light, of its bounces and of its noise. */
static uint32_t list_planes(struct lw_tiles *tiles, struct plane out[PLANES_MAX]) {
    uint32_t n = 0;
    for (int c = 0; c < 3; c++) {
        out[n++] = (struct plane){.at = &tiles->direct[c]};
        out[n++] = (struct plane){.at = &tiles->indirect[c]};
        for (uint32_t k = 0; k + 1 < tiles->bounces; k++)
            out[n++] = (struct plane){.at = &tiles->order[k][c]};
    }
    for (int k = 0; k < LW_TILES_ESTIMATES; k++) out[n++] = (struct plane){.packed = &tiles->estimate[k]};
    for (uint32_t k = 0; k < tiles->bounces; k++) out[n++] = (struct plane){.packed = &tiles->radiance[k]};
    out[n++] = (struct plane){.at = &tiles->mean};
    out[n++] = (struct plane){.at = &tiles->spread};
    return list_channels(tiles, lw_tile_channels_held(false, false), n, out);
}

/* Lists the planes of the light that client lights give. */
static uint32_t list_drawn(struct lw_tiles *tiles, struct plane out[PLANES_MAX]) {
    uint32_t n = 0;
    for (int c = 0; c < 3; c++) out[n++] = (struct plane){.at = &tiles->drawn[c]};
    out[n++] = (struct plane){.packed = &tiles->drawn_estimate};
    out[n++] = (struct plane){.at = &tiles->split_mean};
    out[n++] = (struct plane){.at = &tiles->split_spread};
    return list_channels(tiles, lw_tile_channels_held(true, false) & ~lw_tile_channels_held(false, false), n,
                         out);
}

/* The planes of cosine moments. */
static uint32_t list_moments(struct lw_tiles *tiles, struct plane out[PLANES_MAX]) {
    uint32_t n = 0;
    const bool parts = tiles->drawn[0] != NULL;
    for (int k = 0; k < 3; k++) {
        for (int part = 0; part < LW_TILES_PARTS; part++)
            out[n++] = (struct plane){.at = &tiles->moment[part][k]};
        if (parts) out[n++] = (struct plane){.at = &tiles->drawn_moment[k]};
    }
    return list_channels(tiles, lw_tile_channels_held(parts, true) & ~lw_tile_channels_held(parts, false), n,
                         out);
}

static bool allocate(const struct lw_tiles *tiles, const struct plane *plane, uint32_t planes) {
    const size_t count = tiles->texel_capacity ? tiles->texel_capacity : 1;
    bool ok = true;
    for (uint32_t i = 0; i < planes; i++) {
        void *fresh = calloc(count, plane_bytes(&plane[i]));
        if (plane[i].at)
            *plane[i].at = fresh;
        else
            *plane[i].packed = fresh;
        ok &= fresh != NULL;
    }
    return ok;
}

static void free_planes(const struct plane *plane, uint32_t planes) {
    for (uint32_t i = 0; i < planes; i++) free(plane_of(&plane[i]));
}

static bool allocate_sums(struct lw_tiles *tiles) {
    struct plane plane[PLANES_MAX];
    bool ok = allocate(tiles, plane, list_planes(tiles, plane));
    for (uint32_t k = 0; k < tiles->bounces; k++)
        ok &= (tiles->radiance_change[k] = calloc((size_t)tiles->block_capacity * LW_REGIONS + 1,
                                                  sizeof *tiles->radiance_change[k])) != NULL;
    tiles->judged_spread = tiles->spread;
    return ok;
}

enum lw_status lw_tiles_part_drawn(struct lw_tiles *tiles) {
    struct plane plane[PLANES_MAX];
    tiles->channels = lw_tile_channels_held(true, false);
    return allocate(tiles, plane, list_drawn(tiles, plane)) ? LW_OK : LW_NO_MEMORY;
}

enum lw_status lw_tiles_hold_moments(struct lw_tiles *tiles, const struct lw_scene *scene,
                                     const bool *directional) {
    struct plane plane[PLANES_MAX];
    tiles->has_moments = malloc((scene->object_count + 1ul) * sizeof *tiles->has_moments);
    if (!tiles->has_moments) return LW_NO_MEMORY;
    for (uint32_t o = 0; o < scene->object_count; o++)
        tiles->has_moments[o] = !directional || directional[o] || lw_scene_object_has_finishes(scene, o);
    tiles->channels = lw_tile_channels_held(tiles->drawn[0] != NULL, true);
    return allocate(tiles, plane, list_moments(tiles, plane)) ? LW_OK : LW_NO_MEMORY;
}

size_t lw_tiles_texel_bytes(uint32_t bounces, bool parts, bool moments) {
    float part;
    struct lw_tiles tiles = {.bounces = bounces, .drawn = {parts ? &part : NULL}};
    struct plane plane[PLANES_MAX];
    size_t bytes = sizeof *tiles.block_of_texel + sizeof *tiles.region_of_texel;
    for (uint32_t i = 0, n = list_planes(&tiles, plane); i < n; i++) bytes += plane_bytes(&plane[i]);
    for (uint32_t i = 0, n = list_drawn(&tiles, plane); parts && i < n; i++) bytes += plane_bytes(&plane[i]);
    for (uint32_t i = 0, n = list_moments(&tiles, plane); moments && i < n; i++)
        bytes += plane_bytes(&plane[i]);
    return bytes;
}

size_t lw_tiles_memory_bytes(const struct lw_tiles *tiles) {
    return tiles->texel_capacity *
               lw_tiles_texel_bytes(tiles->bounces, tiles->drawn[0] != NULL, tiles->moment[0][0] != NULL) +
           tiles->capacity * sizeof *tiles->tile + tiles->id_count * sizeof *tiles->slot_of_id +
           tiles->block_capacity *
               (sizeof *tiles->block + tiles->bounces * LW_REGIONS * sizeof *tiles->radiance_change[0]) +
           tiles->packet_capacity * (sizeof *tiles->packet + sizeof *tiles->change_packet);
}

uint64_t lw_tiles_last_solved(const struct lw_tiles *tiles) {
    uint64_t last = 0;
    for (uint32_t i = 0; i < tiles->count; i++)
        if (tiles->tile[i].light.solved_frame > last) last = tiles->tile[i].light.solved_frame;
    return last;
}

bool lw_tiles_judge_channels(struct lw_tiles *tiles, uint32_t channels, int threads) {
    const float *before = tiles->judged_spread;
    const uint32_t irradiances =
        channels & (lw_tile_channel_bit(LW_TILE_CHANNEL_FULL) | lw_tile_channel_bit(LW_TILE_CHANNEL_SPLIT));
    LW_INVARIANT(channels != 0 && (channels & ~tiles->channels) == 0);
    tiles->judged_spread =
        irradiances == lw_tile_channel_bit(LW_TILE_CHANNEL_SPLIT) ? tiles->split_spread : tiles->spread;
    if (tiles->judged_spread == before) return false;
    lw_tiles_sum_variance(tiles, threads);
    return true;
}

void lw_tiles_sum_variance(struct lw_tiles *tiles, int threads) {
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t t = 0; t < tiles->count; t++) {
        const struct lw_solve_tile *tile = &tiles->tile[t];
        LW_TILES_EACH_BLOCK (tile, block) block->variance = 0;
        for (uint32_t i = 0; i < tile->width * tile->height; i++)
            if (tiles->covered[tile->first + i]) {
                struct lw_solve_block *block = lw_tiles_block(tile, i % tile->width, i / tile->width);
                const double weight = (double)block->weight[tiles->region_of_texel[tile->first + i]];
                block->variance += weight * weight * (double)tiles->judged_spread[tile->first + i];
            }
    }
}

/* What a block covers, and the box of its texels. */
static struct lw_box bound_block(const struct lw_solve_tile *tile, uint32_t column, uint32_t row,
                                 const uint8_t *covered) {
    struct lw_solve_block *block = &tile->block[row * tile->block_columns + column];
    const struct lw_mesh_texels *mesh = tile->mesh;
    struct lw_box box = LW_BOX_EMPTY;
    block->covered_count = 0;
    LW_TILES_EACH_TEXEL (tile, column, row, x, y) {
        const uint32_t i = y * tile->width + x;
        if (!covered[tile->first + i]) continue;
        lw_box_add_point(&box, lw_texels_vector(mesh->position, tile->local + i));
        block->covered_count++;
    }
    return box;
}

static void bound_tile(struct lw_solve_tile *tile, const uint8_t *covered) {
    struct lw_box box = LW_BOX_EMPTY;
    tile->covered_count = 0;
    for (uint32_t row = 0; row < tile->block_rows; row++)
        for (uint32_t column = 0; column < tile->block_columns; column++) {
            const struct lw_box part = bound_block(tile, column, row, covered);
            lw_box_add(&box, &part);
            tile->covered_count += tile->block[row * tile->block_columns + column].covered_count;
        }
    LW_INVARIANT(tile->covered_count <= tile->width * tile->height);
    if (!tile->covered_count) return;
    tile->centre_os = lw_box_middle(&box);
    tile->radius_os = lw_box_radius(&box);
}

static uint32_t side_of(uint32_t block, uint32_t texels) {
    const uint32_t left = texels - block * LW_TILE_BLOCK;
    return left < LW_TILE_BLOCK ? left : LW_TILE_BLOCK;
}

static void deal_blocks(const struct lw_tiles *tiles, struct lw_solve_tile *tile) {
    uint8_t room[LW_TILE_SIDE * LW_TILE_SIDE];
    tile->wide_rooms = (uint8_t)lw_rooms_find(tile->mesh, tile->local, tile->width, tile->height,
                                              tiles->covered + tile->first, tiles->side + tile->first, room);
    for (uint32_t row = 0; row < tile->block_rows; row++)
        for (uint32_t column = 0; column < tile->block_columns; column++) {
            struct lw_solve_block *block = &tile->block[row * tile->block_columns + column];
            const uint32_t corner = row * LW_TILE_BLOCK * tile->width + column * LW_TILE_BLOCK,
                           i = tile->first + corner, width = side_of(column, tile->width),
                           height = side_of(row, tile->height);
            const struct lw_region_parts before = block->parts;
            block->parts = lw_regions_deal(tile->width, width, height, tiles->covered + i, room + corner,
                                           tiles->region_of_texel + i);
            if (memcmp(&before, &block->parts, sizeof before) != 0)
                for (uint32_t r = 0; r < LW_REGIONS; r++) block->weight[r] = 1;
            block->packet_count =
                lw_packets_deal(tile->mesh, tile->local + corner, tile->width, width, height,
                                tiles->covered + i, tiles->region_of_texel + i, block->packet);
        }
}

/* A hash over the sample points of a block's texels, and over the texels that it covers. */
static uint32_t hash_points(const struct lw_tiles *tiles, const struct lw_solve_tile *tile, uint32_t column,
                            uint32_t row) {
    uint32_t hash = 0;
    LW_TILES_EACH_TEXEL (tile, column, row, x, y) {
        const uint32_t i = tile->first + y * tile->width + x;
        hash = lw_random_hash2(hash, tiles->covered[i] ? tiles->usable[i] : 0);
    }
    return hash;
}

static void hash_blocks(const struct lw_tiles *tiles, const struct lw_solve_tile *tile) {
    for (uint32_t row = 0; row < tile->block_rows; row++)
        for (uint32_t column = 0; column < tile->block_columns; column++)
            tile->block[row * tile->block_columns + column].points_hash =
                hash_points(tiles, tile, column, row);
}

/* Every fine tile has room for as many. */
#define FINE_BLOCKS (LW_TILE_BLOCKS * LW_TILE_BLOCKS)

static uint32_t blocks_along(uint32_t texels) { return (texels + LW_TILE_BLOCK - 1) / LW_TILE_BLOCK; }

/* Packets that the texels of a block could fill. */
static uint32_t packets_in(const struct lw_solve_tile *tile, uint32_t block) {
    const uint32_t width = side_of(block % tile->block_columns, tile->width),
                   height = side_of(block / tile->block_columns, tile->height);
    return (width * height + LW_TRACE_WIDTH - 1) / LW_TRACE_WIDTH;
}

/* The same for all blocks of a tile. */
static size_t packets_of(const struct lw_tile_place *place) {
    const struct lw_solve_tile tile = {.width = place->width,
                                       .height = place->height,
                                       .block_columns = blocks_along(place->width),
                                       .block_rows = blocks_along(place->height)};
    size_t packets = 0;
    for (uint32_t b = 0; b < tile.block_columns * tile.block_rows; b++) packets += packets_in(&tile, b);
    return packets;
}

/* Begins the blocks of a tile whose texels are known, without light. packet: the first of its own. Returns
 * the first packet behind them. */
static size_t begin_tile(struct lw_tiles *tiles, struct lw_solve_tile *tile, size_t packet) {
    for (uint32_t i = 0; i < tile->width * tile->height; i++)
        tiles->block_of_texel[tile->first + i] =
            (uint32_t)(lw_tiles_block(tile, i % tile->width, i / tile->width) - tiles->block);
    bound_tile(tile, tiles->covered);
    LW_TILES_EACH_BLOCK (tile, block) {
        block->tile_id = tile->id.v;
        block->packet = tiles->packet + packet;
        block->change.packet = tiles->change_packet + packet;
        packet += packets_in(tile, (uint32_t)(block - tile->block));
        block->error = 1;
        block->noise[LW_TILES_DIRECT] = block->noise[LW_TILES_INDIRECT] = -1;
        block->state = block->covered_count ? LW_BLOCK_SAMPLED : LW_BLOCK_CONVERGED;
    }
    LW_INVARIANT(packet <= tiles->packet_capacity);
    tile->light.state = tile->covered_count ? LW_BLOCK_SAMPLED : LW_BLOCK_CONVERGED;
    return packet;
}

enum lw_status lw_tiles_init(struct lw_tiles *tiles, const struct lw_scene *scene,
                             const struct lw_atlas_map *map, const struct lw_texels *texels, uint32_t bounces,
                             int threads) {
    *tiles = (struct lw_tiles){.id_count = map->tile_count,
                               .channels = lw_tile_channels_held(false, false),
                               .bounces = bounces,
                               .texel_count = texels->count,
                               .texel_capacity = texels->capacity,
                               .covered = texels->covered,
                               .usable = texels->usable,
                               .side = texels->side,
                               .changes = texels->changes};
    for (uint32_t id = 0; id < map->plain_count; id++) {
        if (map->place[id].level != 0) continue;
        tiles->count++;
        tiles->block_count += blocks_along(map->place[id].width) * blocks_along(map->place[id].height);
        tiles->packet_count += packets_of(&map->place[id]);
    }
    tiles->level0_count = tiles->count;
    tiles->capacity = tiles->count + lw_tiles_fine_slots(tiles);
    tiles->block_capacity = tiles->block_count + lw_tiles_fine_slots(tiles) * FINE_BLOCKS;
    tiles->packet_capacity =
        tiles->packet_count + (size_t)lw_tiles_fine_slots(tiles) * FINE_BLOCKS * LW_PACKETS_MAX;
    tiles->tile = calloc((size_t)tiles->capacity + 1, sizeof *tiles->tile);
    tiles->block = calloc((size_t)tiles->block_capacity + 1, sizeof *tiles->block);
    tiles->block_of_texel = malloc(((size_t)tiles->texel_capacity + 1) * sizeof *tiles->block_of_texel);
    tiles->region_of_texel = malloc((size_t)tiles->texel_capacity + 1);
    tiles->slot_of_id = malloc(((size_t)map->tile_count + 1) * sizeof *tiles->slot_of_id);
    tiles->packet = malloc((tiles->packet_capacity + 1) * sizeof *tiles->packet);
    tiles->change_packet = calloc(tiles->packet_capacity + 1, sizeof *tiles->change_packet);
    if (!tiles->tile || !tiles->block || !tiles->packet || !tiles->change_packet || !tiles->block_of_texel ||
        !tiles->region_of_texel || !tiles->slot_of_id || !allocate_sums(tiles)) {
        lw_tiles_finish(tiles);
        return LW_NO_MEMORY;
    }
    uint32_t n = 0, blocks = 0;
    size_t packets = 0;
    for (uint32_t id = 0; id < map->tile_count; id++) tiles->slot_of_id[id] = UINT32_MAX;
    for (uint32_t id = 0; id < map->plain_count; id++) {
        const struct lw_tile_place *place = &map->place[id];
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
                                       .block = tiles->block + blocks,
                                       .block_columns = blocks_along(place->width),
                                       .block_rows = blocks_along(place->height),
                                       .light = {.error = 1}};
        tile->first = texels->first[place->object] + tile->local;
        tile->changes = texels->changes[place->object];
        blocks += tile->block_columns * tile->block_rows;
        packets = begin_tile(tiles, tile, packets);
    }
    LW_INVARIANT(n == tiles->count && blocks == tiles->block_count && packets == tiles->packet_count);
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        deal_blocks(tiles, tile);
        hash_blocks(tiles, tile);
    }
    return LW_OK;
}

void lw_tiles_add_fine(struct lw_tiles *tiles, lw_tile_id id, const struct lw_tile_place *place,
                       uint32_t slot, const struct lw_mesh_texels *mesh, const uint8_t *pair) {
    LW_INVARIANT(slot < lw_tiles_fine_slots(tiles) && !lw_tiles_have(tiles, id) && pair &&
                 tiles->count < tiles->capacity && lw_atlas_finer(place->level));
    struct lw_solve_block *block = tiles->block + tiles->block_count + slot * FINE_BLOCKS;
    struct lw_solve_tile *tile = &tiles->tile[tiles->count];
    const size_t first_packet = tiles->packet_count + (size_t)slot * FINE_BLOCKS * LW_PACKETS_MAX;
    memset(block, 0, FINE_BLOCKS * sizeof *block);
    memset(tiles->change_packet + first_packet, 0,
           FINE_BLOCKS * LW_PACKETS_MAX * sizeof *tiles->change_packet);
    *tile = (struct lw_solve_tile){.id = id,
                                   .object = place->object,
                                   .x = place->x,
                                   .y = place->y,
                                   .width = place->width,
                                   .height = place->height,
                                   .mesh = mesh,
                                   .first = lw_tiles_fine_first(tiles, slot),
                                   .block = block,
                                   .block_columns = blocks_along(place->width),
                                   .block_rows = blocks_along(place->height),
                                   .fine_pair = pair,
                                   .fine_slot = slot,
                                   .light = {.error = 1},
                                   .changes = tiles->changes[place->object]};
    (void)begin_tile(tiles, tile, first_packet);
    deal_blocks(tiles, tile);
    hash_blocks(tiles, tile);
    tiles->slot_of_id[id.v] = tiles->count++;
}

void lw_tiles_remove_fine(struct lw_tiles *tiles, lw_tile_id id) {
    struct lw_solve_tile *tile = lw_tiles_at(tiles, id), *last = &tiles->tile[tiles->count - 1];
    LW_INVARIANT(lw_tiles_have(tiles, id) && tile->fine_pair);
    *tile = *last;
    tiles->slot_of_id[tile->id.v] = (uint32_t)(tile - tiles->tile);
    tiles->slot_of_id[id.v] = UINT32_MAX;
    tiles->count--;
}

static void begin_block(struct lw_solve_block *block) {
    struct lw_change_packet *packet = block->change.packet;
    block->unseen = false;
    block->sample_count = 0;
    block->direct = block->indirect = (struct lw_history){0};
    memset(packet, 0, block->packet_count * sizeof *packet);
    block->change = (struct lw_change_block){.packet = packet};
    block->variance = block->luminance = 0;
    block->noise[LW_TILES_DIRECT] = block->noise[LW_TILES_INDIRECT] = -1;
    block->error = 1;
    block->state = block->covered_count ? LW_BLOCK_SAMPLED : LW_BLOCK_CONVERGED;
}

/* Whether the texels of a block are in the regions of before. */
static bool has_regions(const struct lw_tiles *tiles, const struct lw_solve_tile *tile, uint32_t column,
                        uint32_t row, const uint8_t *before) {
    LW_TILES_EACH_TEXEL (tile, column, row, x, y)
        if (tiles->region_of_texel[tile->first + y * tile->width + x] != before[y * tile->width + x])
            return false;
    return true;
}

static void recount_tile(const struct lw_tiles *tiles, struct lw_solve_tile *tile) {
    uint8_t region[LW_TILE_SIDE * LW_TILE_SIDE];
    uint32_t hash[LW_TILE_BLOCKS * LW_TILE_BLOCKS];
    if (tile->changes == tiles->changes[tile->object] || tile->fine_pair) return;
    tile->changes = tiles->changes[tile->object];
    memcpy(region, tiles->region_of_texel + tile->first, tile->width * tile->height);
    LW_TILES_EACH_BLOCK (tile, block) hash[block - tile->block] = block->points_hash;
    bound_tile(tile, tiles->covered);
    if (tile->change.invalidated_count > tile->covered_count)
        tile->change.invalidated_count = tile->covered_count;
    deal_blocks(tiles, tile);
    hash_blocks(tiles, tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        const uint32_t b = (uint32_t)(block - tile->block);
        if (hash[b] == block->points_hash &&
            has_regions(tiles, tile, b % tile->block_columns, b / tile->block_columns, region))
            continue;
        begin_block(block);
        if (tile->hidden) block->state = LW_BLOCK_CONVERGED;
    }
    lw_tiles_sum_up(tile);
}

void lw_tiles_recount(struct lw_tiles *tiles, int threads) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
    for (uint32_t i = 0; i < tiles->count; i++) recount_tile(tiles, &tiles->tile[i]);
}

void lw_tiles_finish(struct lw_tiles *tiles) {
    struct plane plane[PLANES_MAX];
    free_planes(plane, list_moments(tiles, plane)); /* reads drawn[0] */
    free_planes(plane, list_planes(tiles, plane));
    free_planes(plane, list_drawn(tiles, plane));
    for (uint32_t k = 0; k < tiles->bounces; k++) free(tiles->radiance_change[k]);
    free(tiles->has_moments);
    free(tiles->slot_of_id);
    free(tiles->block_of_texel);
    free(tiles->region_of_texel);
    free(tiles->change_packet);
    free(tiles->packet);
    free(tiles->block);
    free(tiles->tile);
    *tiles = (struct lw_tiles){0};
}

void lw_tiles_take_radiance(struct lw_tiles *tiles, const struct lw_tiles *from, lw_tile_id id,
                            uint32_t bounce) {
    const struct lw_solve_tile *tile = lw_tiles_at(tiles, id);
    LW_INVARIANT(bounce < tiles->bounces && from->texel_count == tiles->texel_count);
    const size_t first = tile->first, change = LW_REGIONS * (size_t)(tile->block - tiles->block);
    memcpy(tiles->radiance[bounce] + first, from->radiance[bounce] + first,
           sizeof *tiles->radiance[bounce] * tile->width * tile->height);
    memcpy(tiles->radiance_change[bounce] + change, from->radiance_change[bounce] + change,
           LW_REGIONS * sizeof(struct lw_vec3) * tile->block_columns * tile->block_rows);
}

static void take_block(struct lw_solve_block *block, const struct lw_solve_block *from) {
    struct lw_packet *packet = block->packet; /* packets are equal, and lie elsewhere */
    struct lw_change_packet *change = block->change.packet;
    *block = *from;
    block->packet = packet;
    block->change.packet = change;
    memcpy(change, from->change.packet, from->packet_count * sizeof *change);
}

static void take_planes(const struct plane *to, const struct plane *from, uint32_t planes,
                        const struct lw_solve_tile *tile) {
    for (uint32_t i = 0; i < planes; i++) {
        const size_t bytes = plane_bytes(&from[i]), first = tile->first * bytes;
        memcpy((char *)plane_of(&to[i]) + first, (const char *)plane_of(&from[i]) + first,
               bytes * tile->width * tile->height);
    }
}

void lw_tiles_take(struct lw_tiles *tiles, const struct lw_tiles *from, lw_tile_id id) {
    struct lw_solve_tile *tile = lw_tiles_at(tiles, id);
    const struct lw_solve_tile *other = lw_tiles_at(from, id);
    struct lw_tiles source = *from; /* the lists hold places to write to */
    LW_INVARIANT(tile->first == other->first && tile->covered_count == other->covered_count);
    struct plane to[PLANES_MAX], of[PLANES_MAX];
    take_planes(to, of, (list_planes(&source, of), list_planes(tiles, to)), tile);
    if (tiles->drawn[0]) take_planes(to, of, (list_drawn(&source, of), list_drawn(tiles, to)), tile);
    if (tiles->moment[0][0]) take_planes(to, of, (list_moments(&source, of), list_moments(tiles, to)), tile);
    for (uint32_t b = 0; b < tile->block_columns * tile->block_rows; b++)
        take_block(&tile->block[b], &other->block[b]);
    tile->light = other->light;
    tile->change = other->change;
}

void lw_tiles_sum_up(struct lw_solve_tile *tile) {
    tile->light.state = LW_BLOCK_CONVERGED;
    tile->light.sample_count = tile->covered_count ? UINT32_MAX : 0;
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->covered_count) continue;
        if (block->state < tile->light.state) tile->light.state = block->state;
        if (block->sample_count < tile->light.sample_count) tile->light.sample_count = block->sample_count;
    }
    LW_INVARIANT(tile->light.sample_count < UINT32_MAX); /* what covers texels has a block that does */
}

static void show_plane(const struct lw_tiles *tiles, const struct lw_solve_tile *tile, uint64_t frame,
                       uint32_t channel, uint32_t plane) {
    for (uint32_t i = tile->first; i < tile->first + tile->width * tile->height; i++)
        if (tiles->covered[i] && tiles->block[tiles->block_of_texel[i]].shown_frame == frame)
            tiles->shown[channel][plane][i] = lw_tiles_sum(tiles, channel, plane, i);
}

void lw_tiles_show(struct lw_tiles *tiles, uint64_t frame, uint32_t channels, int threads) {
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (uint32_t t = 0; t < tiles->count; t++) {
        const struct lw_solve_tile *tile = &tiles->tile[t];
        if (tile->light.solved_frame != frame) continue;
        LW_TILE_CHANNELS_EACH (channel, lw_tiles_channels_of(tiles, tile, channels))
            for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
                show_plane(tiles, tile, frame, channel, p);
    }
}

static int by_cell(const void *a, const void *b) {
    const struct lw_solve_tile *x = a, *y = b;
    if (x->cell != y->cell) return x->cell < y->cell ? -1 : 1;
    return x->id.v < y->id.v ? -1 : x->id.v > y->id.v;
}

static void set_hidden(struct lw_solve_tile *tile, bool hidden) {
    LW_INVARIANT(tile->hidden != hidden);
    tile->hidden = hidden;
    tile->change.invalidated = !hidden; /* first among what waits for a frame */
    tile->change.priority = 1;
    tile->change.invalidated_count = tile->covered_count;
    tile->light.begins = !hidden;
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!hidden)
            begin_block(block);
        else
            block->state = LW_BLOCK_CONVERGED;
    }
    lw_tiles_sum_up(tile);
}

/* Every tile has an id of its own, and a slot. */
static bool is_permutation(const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < tiles->count; i++)
        if (tiles->tile[i].id.v >= tiles->id_count || tiles->slot_of_id[tiles->tile[i].id.v] != i)
            return false;
    return true;
}

void lw_tiles_set_pose(struct lw_tiles *tiles, const struct lw_cells *cells, const struct lw_pose *pose) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const struct lw_affine *t = &pose->object_to_world[tile->object];
        if (tile->hidden != pose->object_hidden[tile->object]) set_hidden(tile, !tile->hidden);
        float longest = 0; /* no direction is stretched more than by the Frobenius norm */
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) longest += t->m[r][c] * t->m[r][c];
        tile->centre_ws = lw_affine_point(t, tile->centre_os);
        tile->radius_m = tile->radius_os * sqrtf(longest);
        tile->cell = lw_cells_at(cells, tile->centre_ws);
    }
    qsort(tiles->tile, tiles->count, sizeof *tiles->tile, by_cell);
    for (uint32_t i = 0; i < tiles->count; i++) tiles->slot_of_id[tiles->tile[i].id.v] = i;
    LW_INVARIANT_DEAR(is_permutation(tiles));
}
