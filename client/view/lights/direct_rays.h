/* direct_rays.h: shadow rays of one light at a screen tile: few at first, more where these disagree.
 * Flow:    points that face a light -> [direct_rays] -> per pixel: rays taken, rays that found light
 * Threads: any worker. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_RAYS_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_RAYS_H

#include "client/view/lights/direct_private.h"

static inline int lw_direct_rays_column(uint32_t pixel) {
    return (int)(pixel / LW_DIRECT_LANES % LW_DIRECT_TILE_SIDE * 4 + pixel % 4);
}
static inline int lw_direct_rays_row(uint32_t pixel) {
    return (int)(pixel / LW_DIRECT_LANES / LW_DIRECT_TILE_SIDE * 4 + pixel % LW_DIRECT_LANES / 4);
}

static inline uint32_t lw_direct_rays_pixel_at(int x, int y) {
    const uint32_t u = (uint32_t)x, v = (uint32_t)y;
    return ((v / 4 * LW_DIRECT_TILE_SIDE + u / 4) * 16) + v % 4 * 4 + u % 4;
}

/* A row of pixels, and the pixels up to r columns beside them. */
static inline uint32_t lw_direct_rays_widen(uint32_t row, int r) {
    for (int k = 0; k < r; k++) row |= row << 1 | row >> 1;
    return row;
}

/* Whether a neighbourhood lies within a penumbra: enough of its pixels have found both light and shadow. A
 * wide window needs more of them, since the mean over a bend is no pixel's own. r: half the window's side */
static inline bool lw_direct_rays_is_wide(uint32_t partial, uint32_t all, uint32_t r) {
    return 100 * partial >= (30 + 15 * r) * all;
}

/** Bits of the pixels whose quad, 2 x 2 pixels, lies on one flat piece of surface. */
uint16_t lw_direct_rays_find_flat(const struct lw_direct_block *block);

/** Whether a block whose quads are flat is flat as a whole. */
bool lw_direct_rays_is_flat(const struct lw_direct_block *block);

/** Puts a pixel's shadow ray number k into the packet, which is traced once it is full. */
void lw_direct_rays_shoot(struct lw_direct_job *job, uint32_t pixel, uint32_t k);

/** Traces the rays in the packet. */
void lw_direct_rays_flush(struct lw_direct_job *job);

/** Takes all shadow rays of a light at the points of work->facing. */
void lw_direct_rays_trace(struct lw_direct_job *job);

/** Whether some rays of the tile have found light, and others shadow. */
bool lw_direct_rays_is_mixed(const struct lw_direct_work *work);

#endif
