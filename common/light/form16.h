/* form16.h: what sixteen points of surfaces get from one small piece of another: form factors, and rays
 * towards it.
 * Flow:    points, a piece of surface that sends light -> [form16] -> weights of its flux, rays
 * Threads: pure functions, [any].
 *
 *     weight = cos cos' / (pi max(r^2, near^2) + A)
 *
 * E of a point is the weight times the flux that the piece sends into its hemisphere. */
#ifndef LW_COMMON_FORM16_H
#define LW_COMMON_FORM16_H

#include "common/base/points16.h"
#include "common/trace/trace.h"

/** Weights of the flux of a disc of area_m2, 0 for a point. near_m2: r^2 counts as this at least; 0: as it
 * is. 0 where the disc is behind the point, or the point behind the disc. */
void lw_form16_weigh(const struct lw_points16 *points, const float position[3], const float normal[3],
                     float area_m2, float near_m2, float out[LW_TRACE_WIDTH]);

/** Bit i set: weight i is above 0. */
uint16_t lw_form16_lit(const float weight[LW_TRACE_WIDTH]);

/** Rays that start at the points; their ends are to be aimed. */
void lw_form16_start(const struct lw_points16 *points, struct lw_ray16 *rays);
/** Aims them at a place, and ends them just before it. */
void lw_form16_aim(const struct lw_points16 *points, const float position[3], struct lw_ray16 *rays);

/** Adds weights times a flux: E, W/m^2. */
void lw_form16_add(const float weight[LW_TRACE_WIDTH], const float flux_w[3], float sum[3][LW_TRACE_WIDTH]);

#endif
