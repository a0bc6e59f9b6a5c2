/* probes.h: incoming radiance at points, gathered from the last bounce; one probe at each cell's centre.
 * Flow:    texels (bounce k-1) -> [probes] -> cell scattering (bounce k), for rays longer than the tracing range
 * Threads: gather and project [solver], parallel inside; lookups [any] in between.
 * After:   Vandersanden 2023, 3.4 and 3.6; nine spherical-harmonic coefficients after Ramamoorthi and Hanrahan 2001.
 *
 * The form behind this interface is SH-9; callers know only lookups of radiance. */
#ifndef LW_SOLVE_PROBES_H
#define LW_SOLVE_PROBES_H

#include "common/trace/trace.h"
#include "server/solve/cells.h"
#include "server/solve/texels.h"

#define LW_PROBES_RAYS 128u /* per probe and frame, a multiple of 16 */
#define LW_PROBES_MAX  (1u << 15)

struct lw_probes {
    const struct lw_cells *cells;
    uint32_t count, bounces;
    uint32_t *end; /* count * LW_PROBES_RAYS: the texel that each ray of this frame hit, or LW_END_NOTHING */
    float *coefficient; /* [bounce][probe][9][3]: what bounce order `bounce` looks like from the probe */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_probes_init(struct lw_probes *probes, const struct lw_cells *cells,
                                            uint32_t bounces);
void lw_probes_finish(struct lw_probes *probes);

/** Traces this frame's rays of every probe. sample: frames gathered since the sequence began. Returns rays traced. */
uint64_t lw_probes_gather(struct lw_probes *probes, const struct lw_trace *trace,
                          const struct lw_texels *texels, uint32_t seed, uint32_t sample, int threads);

/** Turns the radiance of bounce order `bounce` at the rays' ends into coefficients, blended into the history by
 * `weight` (1: replace). radiance: 4 floats per texel of the global numbering, W/(m^2 sr). */
void lw_probes_project(struct lw_probes *probes, uint32_t bounce, const float *radiance, uint32_t seed,
                       uint32_t sample, float weight, int threads);

/** Radiance of bounce order `bounce` that reaches a probe from a direction; never negative. W/(m^2 sr) */
struct lw_vec3 lw_probes_radiance(const struct lw_probes *probes, uint32_t bounce, uint32_t probe,
                                  struct lw_vec3 direction);

#endif
