#include "server/solve/transport/ray_launch.h"

#include "common/base/invariant.h"
#include "common/base/sampling.h"
#include "common/base/wide.h"

#define LANES LW_TRACE_WIDTH
/* Packets whose normals agree to this cosine run parallel enough for Embree's coherent traversal. */
#define COHERENT_COSINE 0.95f

void lw_ray_launch_init(struct lw_ray_launch *launch, const struct lw_solve_tile *tile,
                        const struct lw_solve_block *block, uint32_t set) {
    const struct lw_packet *from = &block->packet[set];
    const uint32_t index = (uint32_t)(block - tile->block), x = index % tile->block_columns,
                   y = index / tile->block_columns;
    const uint32_t corner = y * LW_TILE_BLOCK * tile->width + x * LW_TILE_BLOCK;
    LW_INVARIANT(set < block->packet_count && y < tile->block_rows);
    LW_INVARIANT(from->count > 0 && from->count <= LANES);
    launch->set = set;
    /* Numbered over the whole atlas, so that no two blocks of an object share a sequence. */
    launch->block = (tile->y * LW_TILE_BLOCKS + y) << 16 | (tile->x * LW_TILE_BLOCKS + x);
    launch->frames = block->sample_count;
    launch->active = (uint16_t)((1u << from->count) - 1);
    for (uint32_t lane = 0; lane < LANES; lane++)
        launch->texel[lane] = lw_packet_texel(from, lane < from->count ? lane : 0, corner, tile->width);
}

void lw_ray_launch_choose(struct lw_ray_launch *launch, const struct lw_solve_tile *tile,
                          const uint8_t *usable, uint32_t seed, uint32_t sample) {
    const uint32_t turn = lw_random_hash4(seed ^ tile->object, launch->block, sample / LW_SAMPLE_POINTS_MAX,
                                          LW_SAMPLING_FOOTPRINT << 8 | launch->set);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const uint32_t texel = launch->texel[lane];
        LW_INVARIANT_DEAR(usable[tile->first + texel]); /* a covered texel has a point that light can reach */
        launch->point[lane] = tile->mesh->sample_points.first[tile->local + texel] +
                              lw_sample_points_choose(usable[tile->first + texel], sample, turn);
        LW_INVARIANT_DEAR(launch->point[lane] < tile->mesh->sample_points.first[tile->local + texel + 1]);
    }
}

void lw_ray_launch_block(const struct lw_solve_tile *tile, const struct lw_solve_block *block,
                         const uint8_t *usable, uint32_t seed, uint32_t sample,
                         struct lw_ray_launch out[LW_PACKETS_MAX]) {
    for (uint32_t set = 0; set < block->packet_count; set++) {
        lw_ray_launch_init(&out[set], tile, block, set);
        lw_ray_launch_choose(&out[set], tile, usable, seed, sample);
        for (uint32_t lane = 0; lane < LANES; lane++)
            lw_sample_points_prefetch(&tile->mesh->sample_points, tile->local + out[set].texel[lane],
                                      out[set].point[lane]);
    }
}

/* Whether normals agree so far that rays about them run parallel enough. */
LW_WIDE static bool agree(const struct lw_points16 *at) {
    int32_t apart = 0;
    for (uint32_t lane = 0; lane < LANES; lane++)
        apart |=
            at->nx[0] * at->nx[lane] + at->ny[0] * at->ny[lane] + at->nz[0] * at->nz[lane] > COHERENT_COSINE
                ? 0
                : -1;
    return apart == 0;
}

void lw_ray_launch_place(const struct lw_ray_launch *launch, const struct lw_solve_tile *tile,
                         struct lw_ray_launch_site *site) {
    uint32_t texel[LANES];
    for (uint32_t lane = 0; lane < LANES; lane++) texel[lane] = tile->local + launch->texel[lane];
    lw_sample_points_load(&tile->mesh->sample_points, tile->mesh->position, texel, launch->point,
                          &site->lanes);
    lw_sample_points_to_world(&site->frame, &site->lanes);
    site->coherent = agree(&site->lanes.at);
}
