/* probe_form.h: how a probe keeps the radiance that arrives at it: the forms behind one interface.
 * Flow:    rays of a frame -> [add] -> running mean of sums (probes.c) -> [make map] -> map -> [read]
 * Threads: pure functions on the caller's memory, [any].
 *
 *   octahedral  means over the cells of a 16 x 16 octahedral map, read bilinearly: sharp to some 11 degrees
 *   sh          nine spherical-harmonic coefficients per channel (Ramamoorthi and Hanrahan 2001), windowed
 *               until nothing is negative (Sloan 2008): a fortieth of the memory, but a lamp or a window
 *               smears over a hemisphere
 *   cube        means over the cells of a cube's faces, 7 x 7 each, read bilinearly: as sharp, half as much
 *               memory again for its borders */
#ifndef LW_TRANSPORT_PROBE_FORM_H
#define LW_TRANSPORT_PROBE_FORM_H

#include "common/base/vec.h"
#include "server/solve/state/solver_terms.h"

#include <stdint.h>

struct lw_probe_form_ops {
    const char *name;
    uint32_t sum_floats, map_floats;
    /** Adds one ray of a set that is uniform over the sphere. sum: sum_floats, 0 to
     * begin with. radiance: 3 floats. */
    void (*add)(float *sum, struct lw_vec3 direction, const float *radiance);
    /** Makes the map that read() reads. mean: of the sums of add(), over all rays */
    void (*to_map)(const float *mean, float *map);
    /** Radiance from a direction of unit length; finite and never negative. */
    struct lw_vec3 (*read)(const float *map, struct lw_vec3 direction);
};

#define LW_PROBE_FORM_FLOATS_MAX 1944u /* the largest sum_floats */

const struct lw_probe_form_ops *lw_probe_form(enum lw_probe_form_kind kind);

#endif
