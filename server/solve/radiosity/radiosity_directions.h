/* radiosity_directions.h: one bounce of radiosity along a fixed set of directions about each normal.
 * Flow:    patches, radiance of texels -> [radiosity_directions] -> E per texel
 * Threads: as radiosity_pass.h.
 * After:   Kahl 2023 (directions by largest empty circles).
 *
 *   E_i = (pi / N) sum over the N directions of L at the first surface there
 *
 * The directions are cosine-weighted: points on the unit disc, raised to the hemisphere. Each point lies in
 * the middle of the largest circle that those before it leave empty; then all are moved to the middle of
 * the places nearest to them. All texels share them: there is no noise, but some texels meet a small bright
 * surface and others miss it. Rays are traced again for each bounce. */
#ifndef LW_RADIOSITY_RADIOSITY_DIRECTIONS_H
#define LW_RADIOSITY_RADIOSITY_DIRECTIONS_H

#include "common/base/progress.h"
#include "server/solve/radiosity/patches.h"
#include "server/solve/surface/wall_sides.h"

struct lw_radiosity_directions {
    uint32_t count;
    float (*point)[2]; /* on the unit disc */
};

/** count: 0: an empty set. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_radiosity_directions_init(struct lw_radiosity_directions *directions,
                                                          uint32_t count);
/** A zeroed one is fine. */
void lw_radiosity_directions_finish(struct lw_radiosity_directions *directions);

struct lw_radiosity_gather {
    const struct lw_patches *patches;
    const struct lw_radiosity_directions *directions;
    const struct lw_wall_sides *sides;
    const float *radiance; /* per texel of the global numbering, W/(m^2 sr) */
    uint32_t stride;       /* floats from one to the next */
    float turn;            /* of all directions about the normals, radians */
    uint32_t salt;
    const _Atomic bool *cancel;   /* may be NULL */
    struct lw_progress *progress; /* a step is a packet */
    int threads;
};

/** Writes E, W/m^2, of every patch; other texels stay as they are. Returns rays traced. */
uint64_t lw_radiosity_directions_run(const struct lw_radiosity_gather *gather, float *const out_e[3]);

#endif
