/* ambient.h: the environment as rough mirrors and matt surfaces see it, in small maps.
 * Flow:    environment -> [ambient] -> gloss (composer), gl_renderer
 * Threads: init and finish by one thread; the rest [any] in between.
 * After:   Karis 2013 (the split sum: light along the mirrored direction, apart from its mirrored share).
 *
 * A map holds the octahedron: values at the steps, edges included. One for each of LW_AMBIENT_LEVELS
 * roughnesses 0 to 1, and a last one of what arrives at a matt surface, E/pi by its normal. They are means of
 * what the environment has, so they are never negative. */
#ifndef LW_CLIENT_VIEW_SHADING_AMBIENT_H
#define LW_CLIENT_VIEW_SHADING_AMBIENT_H

#include "common/scene/scene.h"

#define LW_AMBIENT_STEPS  32u /* along a map's side */
#define LW_AMBIENT_SIDE   (LW_AMBIENT_STEPS + 1)
#define LW_AMBIENT_LEVELS 6u /* roughnesses */
#define LW_AMBIENT_MAPS   (LW_AMBIENT_LEVELS + 1)

struct lw_ambient {
    /* LW_AMBIENT_MAPS x LW_AMBIENT_SIDE x LW_AMBIENT_SIDE x 3, W/(m^2 sr); NULL: there is no environment */
    float *rgb;
    const float *of; /* the environment's picture that they are made from */
};

/** Takes some 0.1 s. A zeroed one is fine to begin with; an environment that it has already costs nothing.
 * Errors: LW_NO_MEMORY; then there is none. */
LW_MUST_CHECK enum lw_status lw_ambient_take(struct lw_ambient *ambient, const struct lw_environment *from);
void lw_ambient_finish(struct lw_ambient *ambient);

/** Radiance that a mirror of a roughness in [0, 1] reflects from a unit direction, W/(m^2 sr). 0 without
 * environment. */
struct lw_vec3 lw_ambient_mirrored(const struct lw_ambient *ambient, struct lw_vec3 direction,
                                   float roughness);
/** E/pi of what arrives about a unit normal, W/(m^2 sr). */
struct lw_vec3 lw_ambient_matt(const struct lw_ambient *ambient, struct lw_vec3 normal);

#endif
