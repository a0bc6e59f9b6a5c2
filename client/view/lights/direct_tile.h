/* direct_tile.h: the direct light of a picture's client-drawn lights at the points of a screen tile, with the
 * fewest shadow rays that show no noise.
 * Flow:    points of a screen tile, direct_pixels -> [direct_tile] -> E of each point -> compose
 * Threads: [any], with a tile for each worker. Same inputs, same bytes.
 *
 * E = E without shadows, computed (lights16.h, emitter_clusters.h), x the share that shadow rays see. Shadow
 * rays of one light at a tile:
 *
 *   4 x 4 pixels on one flat piece of surface    one ray
 *   it and the rays around it disagree           one ray for 2 x 2 pixels
 *   within three pixels of where these disagree  one ray a pixel
 *   neighbours disagree, the light has a size    up to eight a pixel, stratified over the light for the pixel
 *                                                and for 4 x 4 pixels
 *   a penumbra of several pixels                 a pixel is the mean of its neighbours in it
 *   weak beside the pixel's other light          fewer rays, since the noise is not seen
 *   under half a per cent of it                  E for 4 x 4 pixels, one ray for 8 x 8 pixels or for a random
 *                                                part of these: hundreds of lamps cost little more than the
 *                                                few that count */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_TILE_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_TILE_H

#include "client/view/shading/gloss.h"
#include "common/base/points16.h"
#include "common/trace/trace.h"

#define LW_DIRECT_TILE_SIDE   8u /* blocks of 4 x 4 pixels along a screen tile's side */
#define LW_DIRECT_TILE_BLOCKS (LW_DIRECT_TILE_SIDE * LW_DIRECT_TILE_SIDE)
/* Lights of a tile that are added one by one. Each block takes a random one of the others. */
#define LW_DIRECT_TILE_LIGHTS_MAX 128u

struct lw_direct_pixels;

/** Sixteen pixels, 4 x 4, row by row. */
struct lw_direct_block {
    struct lw_points16 points; /* world space, lifted off their surfaces; any finite ones where not active */
    /* E of other light there, luminance, W/m^2: beside it, weak light may be noisy */
    float base[LW_TRACE_WIDTH];
    float e[3][LW_TRACE_WIDTH]; /* W/m^2; written where active, else 0 */
    uint16_t active;
    /* Points with a finish: e is by their bumped normals, mirrored is added to the radiance that they send to
     * the eye. Shadow rays go by the plain normals. */
    uint16_t finished;
    struct lw_gloss_seen16 seen;       /* the points of `finished` */
    float mirrored[3][LW_TRACE_WIDTH]; /* W/(m^2 sr); like e */
};

/** A screen tile of up to 8 x 8 blocks, row by row, and a worker's scratch memory. */
struct lw_direct_tile {
    struct lw_direct_block block[LW_DIRECT_TILE_BLOCKS];
    uint32_t x, y; /* its first pixel's, for the random numbers */
    bool listed;   /* its pixels are from anywhere: none has neighbours */
    uint64_t rays; /* shadow rays: added to */
    struct lw_direct_work *work;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_direct_tile_create(struct lw_direct_tile **out_tile);
void lw_direct_tile_destroy(struct lw_direct_tile *tile);

/** Fills e of all blocks. Finite, not negative. */
void lw_direct_tile_light(const struct lw_direct_pixels *direct, struct lw_direct_tile *tile);

#endif
