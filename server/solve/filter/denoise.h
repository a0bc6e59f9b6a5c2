/* denoise.h: an edge-aware filter over shown light: noise goes, light stays.
 * Flow:    texels -> [pairs]
 *          each frame: tiles (light, variance) that it shows -> [denoise] ->
 *          tiles->shown, channel by channel
 * Threads: [solver], parallel inside; the same bytes at any thread count.
 * After:   Dammertz et al. 2010 (a-trous wavelets), Schied et al. 2017 (edges of
 *          luminance in units of the noise).
 *
 * In each pass texels exchange light in pairs:
 *
 *   v_i += sum_j h_ij w_ij (v_j - v_i)       h_ij w_ij = h_ji w_ji;  sum_j h_ij <= 1
 *
 * What one texel gives the other takes, so the sum over an object stays, for any weights. Weights fall with
 * the angle between normals, with the distance from each other's plane, with the distance along it (charts
 * that lie beside each other in the atlas alone are far apart), and with the difference of luminance against
 * its own standard deviation. So the filter fades out as noise falls. A channel that is no irradiance
 * exchanges in the pairs of the irradiance that it follows (tile_channels.h).
 *
 * No pair exchanges across a wall (texels.h).
 *
 * The part that is geometry is found once per mesh, that of walls once per object. The pairs of a mesh that
 * one object has are kept once, and weighed again when its walls change. Pairs serve any number of solves
 * over the same texels. A tile of a finer level is filtered by itself. A block's shown light is a function of
 * its sums and of the sums LW_DENOISE_REACH around it. So a frame filters the blocks that it shows and those
 * beside them. The picture does not depend on the frames in which the sums came about. */
#ifndef LW_FILTER_DENOISE_H
#define LW_FILTER_DENOISE_H

#include "server/solve/state/tiles.h"

#define LW_DENOISE_PASSES 3u /* steps of 1, 2 and 4 texels: 15 x 15 texels in all */
/* texels: those seven, and two more whose light the variance is taken from */
#define LW_DENOISE_REACH  9u
#define LW_DENOISE_PLANES 5u /* planes of an irradiance: r, g, b, luminance, its variance */

/** How far texels may exchange light, for their surfaces' sake and for the walls that stand between them. */
struct lw_denoise_pairs {
    const struct lw_scene *scene;   /* outlives it */
    const struct lw_texels *texels; /* outlives it */
    /* Weights of the pairs of all passes and directions. shared: per mesh that several objects have, all
     * pairs; else NULL. pair: per object, without those that walls part; NULL: no texels. Objects without
     * walls have the shared ones, if there are any. */
    uint8_t **shared, **pair;
    uint32_t *changes; /* per object: those of the texels that pair knows */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_denoise_pairs_init(struct lw_denoise_pairs *pairs,
                                                   const struct lw_scene *scene,
                                                   const struct lw_texels *texels, int threads);
/** After texels have changed: parts the pairs of those objects again of which they have (texels->changes).
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_denoise_pairs_review(struct lw_denoise_pairs *pairs, int threads);
/** The weights of the pairs within one tile of a finer level. mesh: an atlas of the tile's size; walls: of
 * its texels.
 * malloc'ed; NULL: no memory. */
uint8_t *lw_denoise_pairs_of_fine(const struct lw_mesh_texels *mesh, const uint8_t *walls);
void lw_denoise_pairs_finish(struct lw_denoise_pairs *pairs);

/** Bytes held. */
size_t lw_denoise_pairs_memory_bytes(const struct lw_denoise_pairs *pairs);

/** What the filter of one solve needs beside its tiles. */
struct lw_denoise {
    const struct lw_denoise_pairs *pairs; /* outlives it */
    const struct lw_atlas_map *map;       /* outlives it */
    struct lw_tiles *tiles;               /* outlives it; over the texels of the pairs */
    uint8_t *marked;                      /* per block: this frame filters it */
    struct lw_denoise_planes *planes;     /* per worker */
    uint32_t followers;                   /* planes at most that follow one irradiance */
    int threads;
};

/** threads: workers at most. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_denoise_init(struct lw_denoise *denoise, const struct lw_denoise_pairs *pairs,
                                             const struct lw_atlas_map *map, struct lw_tiles *tiles,
                                             int threads);
void lw_denoise_finish(struct lw_denoise *denoise);

/** Writes tiles->shown, in the given channels, of every block shown in frame `frame` and of those beside
 * them, whose shown_frame becomes `frame` too, as does their tiles' solved_frame: the sums, filtered. Call
 * after the last tile is finished. */
void lw_denoise_run(struct lw_denoise *denoise, uint64_t frame, uint32_t channels, int threads);

/** Bytes held, but for the pairs. */
size_t lw_denoise_memory_bytes(const struct lw_denoise *denoise);

#endif
