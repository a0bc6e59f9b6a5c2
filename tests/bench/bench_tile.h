/* bench_tile.h: errors of light that a bench has estimated for a tile's texels, with a solver's own rays.
 * Flow:    sums over a tile's texels, two independent references -> [bench_tile] -> squared relative errors
 * Threads: pure functions, [any]. */
#ifndef LW_BENCH_TILE_H
#define LW_BENCH_TILE_H

#include "server/solve/transport/transport.h"

/* Light that arrives at each texel of a tile, summed over samples of weight pi. */
typedef float bench_plane[LW_TILE_SIDE * LW_TILE_SIDE];

/** Sides of the squares, in texels, over which light is averaged before it is compared. */
struct bench_scales {
    uint32_t count;
    const uint32_t *side;
};

/** Luminance of the radiance that a texel sends out, all orders; 0 for LW_TEXEL_NONE. */
float bench_radiance_of(const struct lw_transport *p, uint32_t texel);

/** Adds the squares of the tile to means, by scale: those that hold a covered texel. */
void bench_count_means(const struct lw_transport *p, const struct lw_solve_tile *tile,
                       const struct bench_scales *scales, uint64_t *means);

/** Adds (E - t0) (E - t1) / (t^2 + eps) of each square to error, by scale: t0 and t1 are of the references,
 * whose noises are independent, so that neither counts; t is their mean.
 * samples of sum, reference_samples of each reference */
void bench_add_errors(const struct lw_transport *p, const struct lw_solve_tile *tile,
                      const struct bench_scales *scales, const bench_plane sum, uint32_t samples,
                      bench_plane reference[2], uint32_t reference_samples, double eps, double *error);

#endif
