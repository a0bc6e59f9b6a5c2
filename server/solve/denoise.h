/* denoise.h: an edge-aware filter over what is shown: noise goes, light stays.
 * Flow:    tiles (light, variance) of the objects that were solved -> [denoise] -> tiles->light
 * Threads: [solver], parallel inside; the same bytes at any thread count.
 * After:   Dammertz et al. 2010 (a-trous wavelets), Schied et al. 2017 (edges of luminance in units of the noise).
 *
 * Each pass lets texels exchange light in pairs: v_i += sum_j h_ij w_ij (v_j - v_i), with h_ij w_ij = h_ji w_ji and all h of
 * a texel summing to at most 1. What one gives the other takes, so the sum over an object stays what it was, whatever
 * the weights are. The weights fall with the angle between normals, with the distance from each other's plane, with
 * the distance along it (charts that only lie beside each other in the atlas are far apart), and with the difference
 * of luminance against its own standard deviation: as noise falls, the filter fades out. What of this is geometry is
 * found once, per mesh. A tile without visible noise takes no part. */
#ifndef LW_SOLVE_DENOISE_H
#define LW_SOLVE_DENOISE_H

#include "server/solve/tiles.h"

#define LW_DENOISE_PASSES 3u /* steps of 1, 2 and 4 texels: 15 x 15 texels in all */
#define LW_DENOISE_QUIET                                                                                     \
    0.004f /* relative error of a tile whose noise is not seen: what is worth publishing */
#define LW_DENOISE_ALL    UINT64_MAX /* no frame in particular: every tile */
#define LW_DENOISE_PLANES 5          /* r, g, b, luminance, its variance */

/** What the filter needs beside the tiles; buffers are its own. */
struct lw_denoise {
    const struct lw_scene *scene;   /* outlives it */
    const struct lw_texels *texels; /* likewise */
    const struct lw_tiles *tiles;   /* likewise */
    uint8_t *
        *pair; /* per mesh: weights of the pairs of all passes and directions, or NULL: nothing to filter */
    uint32_t *slot;                     /* per place of a tile in the largest object: which tile it is */
    uint8_t *part;                      /* likewise: what it does in this frame */
    uint32_t *object_slot;              /* tiles' slots, object by object */
    uint32_t *object_first;             /* per object, and one more: its first entry there */
    float *plane[2][LW_DENOISE_PLANES]; /* of the largest object, row by row with a margin */
    size_t pair_bytes, plane_texels, slots_max; /* what is held */
};

/** Takes over from `tiles`, which must be in place. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_denoise_init(struct lw_denoise *denoise, const struct lw_scene *scene,
                                             const struct lw_texels *texels, const struct lw_tiles *tiles,
                                             int threads);
void lw_denoise_finish(struct lw_denoise *denoise);

/** Filters tiles->light of every tile solved in frame `frame` and of the tiles beside those, whose solved_frame becomes
 * `frame` too. Call after the last tile is finished. LW_DENOISE_ALL: of every tile; solved_frame stays. */
void lw_denoise_run(struct lw_denoise *denoise, uint64_t frame, int threads);

size_t lw_denoise_memory_bytes(const struct lw_denoise *denoise);

#endif
