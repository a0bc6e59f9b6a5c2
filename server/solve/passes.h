/* passes.h: the work of one frame on one tile: direct light, bounce rays, and the sums that follow from them.
 * Flow:    texels, lights -> [direct] -> radiance -> [trace ends] -> [gather] x bounces -> [finish] -> tiles
 * Threads: each call works on one tile; tiles are independent within a pass, passes are barriers apart. [any worker]
 *
 * Estimators (E: irradiance, N: samples; all means are unbiased):
 *   punctual light    E += V E_normal cos                 one shadow ray each; where points and spots are many, they are
 *                                                         split with the emitters into groups, of which one light each
 *                                                         stands for all of its group, over its probability
 *   emissive triangle E += (1/N) sum V L cos / p          split into groups likewise; p: probability of the triangle in
 *                                                         its group times 1 / its solid angle; where it is far, times
 *                                                         d^2 / (its area cos')
 *   sky, environment  E += (1/N) sum V L cos / p          p = (1 - a) cos/pi + a p_bright: cosine-weighted, and where the
 *                                                         environment stands out; a constant sky has a = 0
 *   bounce k          E_k += (pi/N) sum L_{k-1}(end)      cosine-weighted directions
 * (Uniform directions would need (2 pi/N) sum L cos; the 1/(N pi) of Vandersanden 2023, algorithm 3, is neither.) */
#ifndef LW_SOLVE_PASSES_H
#define LW_SOLVE_PASSES_H

#include "common/light/lights.h"
#include "common/trace/trace.h"
#include "server/solve/probes.h"
#include "server/solve/tiles.h"

/** What all passes of a frame read. */
struct lw_passes {
    const struct lw_scene *scene;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
    const struct lw_lights *lights; /* without the client lights */
    const struct lw_lights *drawn;  /* those; NULL: there are none, and lights are all */
    const struct lw_texels *texels;
    const struct lw_cells *cells;
    const struct lw_probes *probes; /* NULL: the tracing range is infinite */
    struct lw_tiles *tiles;
    uint32_t *end; /* indirect_samples words per texel of the global numbering (transport.h) */
    uint32_t direct_samples, indirect_samples, seed;
    float tracing_range_m;
    float target_error; /* of what rests */
};

/** Rays shot for a tile. */
struct lw_passes_count {
    uint64_t shadow, bounce;
};

/** Direct light of the covered texels of a tile's due blocks, blended into tiles->direct. */
void lw_passes_direct(const struct lw_passes *passes, struct lw_solve_tile *tile,
                      struct lw_passes_count *count);

/** Traces the bounce rays of a tile's due blocks and notes where they ended. */
void lw_passes_trace_ends(const struct lw_passes *passes, const struct lw_solve_tile *tile,
                          struct lw_passes_count *count);

/** Bounce order `bounce` (from 1) from tiles->radiance[bounce - 1] of the whole scene. */
void lw_passes_gather(const struct lw_passes *passes, const struct lw_solve_tile *tile, uint32_t bounce);

/** Takes samples of the last solve of a tile's blocks again, with the same random numbers, in the packets that their change says
 * (change.h), and notes there how far the estimates differ. Rays that are traced anew replace the ends of those packets. Where all packets
 * are asked about direct light, that is corrected (correction.h). Returns whether any was. */
bool lw_passes_compare(const struct lw_passes *passes, struct lw_solve_tile *tile,
                       struct lw_passes_count *count);

/** Before the bounce rays of a tile's due blocks are traced: corrects indirect light by what now arrives along those of the last solve. */
void lw_passes_reread(const struct lw_passes *passes, struct lw_solve_tile *tile);

/** After the last bounce: corrects indirect light of due blocks, as far as it is that of earlier frames, by what the radiance of bounces
 * differs by from the frame before, from the first on, along the rays of now. */
void lw_passes_arrive(const struct lw_passes *passes, struct lw_solve_tile *tile);

/** Sets tiles->estimate to what the last solve of a tile's blocks had, if nothing has changed since. */
void lw_passes_recall(const struct lw_passes *passes, const struct lw_solve_tile *tile,
                      struct lw_passes_count *count);

/** Sets tiles->radiance[bounce] of a tile to what it sends out of bounce order `bounce` (0: direct): albedo / pi x E; adds the
 * difference to its blocks' radiance_change. */
void lw_passes_radiate(const struct lw_passes *passes, const struct lw_solve_tile *tile, uint32_t bounce);

/** Sets the errors of a tile and its blocks. A block's noise is measured against its own light or the tile's, whichever is more, so
 * that a dark corner of a lit tile need not be known better than the rest; and what comes from elsewhere. */
void lw_passes_judge(const struct lw_passes *passes, struct lw_solve_tile *tile);

/** After the last bounce: sums the orders, updates the noise estimates, judges. */
void lw_passes_finish_tile(const struct lw_passes *passes, struct lw_solve_tile *tile);

#endif
