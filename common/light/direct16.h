/* direct16.h: the direct light of sixteen points, with a sample and a shadow ray for each light or group of
 * lights.
 * Flow:    points, lights -> [direct16] -> E of each point: texels of the solve, first hits of the path
 *          tracer
 * Threads: a lw_direct16 belongs to one worker; what it reads, [any].
 *
 * Estimators; V: visibility, 0 or 1; cos: of the direction with the normal; p: probability or density.
 *     points, spots, suns   E += V E_normal cos     each; more than LW_LIGHTS_EXACT_MAX points and spots are
 *                                                   in groups instead
 *     groups of emitters    E += V L cos / p        one emitter of each group that is sampled, and a
 *                                                   point on it (lights.h)
 *     sky, environment      E += V L cos / p        one direction
 * Random numbers are those of sampling.h: of (seed, object, block, use) and (sample, set). */
#ifndef LW_COMMON_DIRECT16_H
#define LW_COMMON_DIRECT16_H

#include "common/base/points16.h"
#include "common/light/lights.h"
#include "common/trace/trace.h"

struct lw_direct16 {
    const struct lw_lights *lights;
    const struct lw_trace *trace;
    /* world space, lifted off their surfaces; those not active repeat one that is */
    const struct lw_points16 *points;
    uint16_t active;
    bool coherent;                     /* rays from neighbours to one light run (nearly) parallel */
    uint32_t seed, object, block, set; /* for the random numbers; set: 0 to 15 */
    uint32_t salt;                     /* for the shadow rays (trace.h) */
    float (*e)[LW_TRACE_WIDTH];        /* three rows, W/m^2: added to */
    /* Its cosine moment, the integral of L cos w by luminance: three rows, added to. NULL: not wanted. */
    float (*moment)[LW_TRACE_WIDTH];
    uint64_t rays; /* shadow rays: added to */
};

/** A sample of each sun, and of each point and spot unless they are many. */
void lw_direct16_punctual(struct lw_direct16 *direct, uint32_t sample, float weight);

/** A sample of each group of emitters that is sampled, and of points and spots where they are many. */
void lw_direct16_groups(struct lw_direct16 *direct, uint32_t sample, float weight);

/** A sample of sky and environment. */
void lw_direct16_sky(struct lw_direct16 *direct, uint32_t sample, float weight);

#endif
