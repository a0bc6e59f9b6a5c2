/* transport.h: what direct light and bounces of a frame read.
 * Flow:    texels, lights -> [direct_light] -> radiance ->
 *          [bounces: trace] -> [bounces: gather] x bounces -> estimates
 * Threads: each call works on one tile. Tiles are independent within a pass, passes
 *          are barriers apart. [any worker]
 *
 * Estimators (E: irradiance, N: samples, p: probability density). All means are unbiased:
 *   punctual light     E += V E_normal cos              one shadow ray each (many of them: see below)
 *   emissive triangle  E += (1/N) sum V L cos / p       p: probability of the triangle in its group, over its
 *                                                       solid angle; far: times d^2 / (its area cos')
 *   sky, environment   E += (1/N) sum V L cos / p       p = (1 - a) cos/pi + a p_bright: cosine-weighted, and
 *                                                       where it stands out. A constant sky has a = 0
 *   bounce k           E_k += (pi/N) sum L_{k-1}(hit)   cosine-weighted directions, and for reflectors
 *                      E_k += V L_{k-1}(y) cos cos' / (d^2 p(y))   (reflectors.h)
 *
 * Many points and spots are split with the emitters into groups. One light of each group stands for all of
 * it, over its probability. (Uniform directions would need (2 pi/N) sum L cos; the 1/(N pi) of Vandersanden
 * 2023, algorithm 3, is neither.) */
#ifndef LW_TRANSPORT_TRANSPORT_H
#define LW_TRANSPORT_TRANSPORT_H

#include "common/light/lights.h"
#include "common/trace/trace.h"
#include "server/solve/state/tiles.h"
#include "server/solve/transport/probes.h"
#include "server/solve/transport/reflectors.h"

/** What a texel's ray to a reflector has found. */
struct lw_reflected {
    uint32_t texel; /* on it; global numbering */
    float weight;   /* E = weight * what that texel sends out; 0: there is no such light */
};

/** What the transport of a frame reads. */
struct lw_transport {
    const struct lw_scene *scene;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
    const struct lw_lights *lights; /* without the client lights */
    const struct lw_lights *drawn;  /* client lights; NULL: there are none, and lights are all */
    const struct lw_texels *texels;
    const struct lw_probes *probes; /* NULL: the tracing range is infinite */
    struct lw_tiles *tiles;
    uint32_t *ray_hit; /* indirect_samples words per texel of the global numbering (ray_hit.h) */
    /* The same, their directions (ray_hit.h). Tiles without moments have none. NULL: no tile has any. */
    uint16_t *ray_direction;
    uint16_t *ray_gloss; /* the same, their factors (hit_gloss.h); NULL: light is sent on evenly */
    const struct lw_reflectors *reflectors; /* NULL where no bounce ray is traced or read */
    struct lw_reflected *reflected;         /* one per texel of the global numbering */
    uint16_t *reflected_direction;          /* the same, as ray_direction */
    uint32_t direct_samples, indirect_samples, seed;
    float tracing_range_m;
    /* The largest error of converged blocks. */
    float target_error;
};

/** Rays shot for a tile. */
struct lw_ray_count {
    uint64_t shadow, bounce;
};

#endif
