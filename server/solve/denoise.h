/* denoise.h: an edge-aware filter over what is shown: noise goes, light stays.
 * Flow:    tiles (light, variance) of the objects that were solved -> [denoise] -> tiles->light
 * Threads: [solver], parallel inside; the same bytes at any thread count.
 * After:   Dammertz et al. 2010 (a-trous wavelets), Schied et al. 2017 (edges of luminance in units of the noise).
 *
 * Each pass lets texels exchange light in pairs: v_i += sum_j h_ij w_ij (v_j - v_i), with h_ij w_ij = h_ji w_ji and all h of
 * a texel summing to at most 1. What one gives the other takes, so the sum over an object stays what it was, whatever
 * the weights are. The weights fall with the angle between normals, with the distance from each other's plane, with
 * the distance along it (charts that only lie beside each other in the atlas are far apart), and with the difference
 * of luminance against its own standard deviation: as noise falls, the filter fades out. */
#ifndef LW_SOLVE_DENOISE_H
#define LW_SOLVE_DENOISE_H

#include "server/solve/tiles.h"

#define LW_DENOISE_PASSES 3u /* steps of 1, 2 and 4 texels: 15 x 15 texels in all */

/** What the filter needs beside the tiles; buffers are its own. */
struct lw_denoise {
    const struct lw_scene *scene;   /* outlives it */
    const struct lw_texels *texels; /* likewise */
    const struct lw_tiles *tiles;   /* likewise */
    float *value[2]; /* per texel of the global numbering: rgb and variance of luminance, 4 floats */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_denoise_init(struct lw_denoise *denoise, const struct lw_scene *scene,
                                             const struct lw_texels *texels, const struct lw_tiles *tiles);
void lw_denoise_finish(struct lw_denoise *denoise);

/** Filters tiles->light of every object that has a tile solved in frame `frame`; call after the last tile is finished.
 * history_max: frames that the sums remember at most. Tiles that rest are filtered along, from their sums. */
void lw_denoise_run(const struct lw_denoise *denoise, uint64_t frame, uint32_t history_max, int threads);

#endif
