/* ray_launch.h: the packets of a block, ready to shoot: from which sample points, where in
 * the world, about which normals.
 * Flow:    tile, block, number of the sample -> [ray_launch] -> direct_light.c, bounces.c
 * Threads: a launch belongs to one worker; what it reads, [any]. */
#ifndef LW_TRANSPORT_RAY_LAUNCH_H
#define LW_TRANSPORT_RAY_LAUNCH_H

#include "server/solve/state/tiles.h"

#include <string.h>

/** A packet (packets.h) and the numbers that it draws (sampling.h). */
struct lw_ray_launch {
    uint32_t texel[LW_TRACE_WIDTH]; /* within the tile; lanes that are not active repeat the first */
    uint32_t point[LW_TRACE_WIDTH]; /* sample points of the mesh: where their rays start */
    uint16_t active;
    uint32_t block, set;
    uint32_t frames; /* frames that the block has seen */
};

/** Where the rays of a packet start. */
struct lw_ray_launch_site {
    struct lw_sample_points_frame frame; /* the frame of the tile's object */
    struct lw_sample_points_lanes lanes; /* in world space; lanes that are not active repeat one that is */
    bool coherent;                       /* normals agree so far that rays about them run parallel enough */
};

/** Takes up packet `set` of a block. Where it starts is not chosen yet. */
void lw_ray_launch_init(struct lw_ray_launch *launch, const struct lw_solve_tile *tile,
                        const struct lw_solve_block *block, uint32_t set);

/** Chooses the sample points that sample number `sample` starts from.
 * usable  of all texels (texels.h) */
void lw_ray_launch_choose(struct lw_ray_launch *launch, const struct lw_solve_tile *tile,
                          const uint8_t *usable, uint32_t seed, uint32_t sample);

/** All packets of a block, with chosen sample points, which are prefetched: a
 * line each, and no two together. */
void lw_ray_launch_block(const struct lw_solve_tile *tile, const struct lw_solve_block *block,
                         const uint8_t *usable, uint32_t seed, uint32_t sample,
                         struct lw_ray_launch out[LW_PACKETS_MAX]);

/** Rays start there. Sets where, not whither. */
static inline void lw_ray_launch_start(const struct lw_ray_launch_site *site, struct lw_ray16 *rays) {
    memcpy(rays->org_x, site->lanes.at.x, sizeof rays->org_x);
    memcpy(rays->org_y, site->lanes.at.y, sizeof rays->org_y);
    memcpy(rays->org_z, site->lanes.at.z, sizeof rays->org_z);
    memset(rays->t_near, 0, sizeof rays->t_near);
}

/** Brings the chosen sample points to the world. Needs the site's frame. */
void lw_ray_launch_place(const struct lw_ray_launch *launch, const struct lw_solve_tile *tile,
                         struct lw_ray_launch_site *site);

#endif
