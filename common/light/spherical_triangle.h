/* spherical_triangle.h: the solid angle of a triangle, and directions that are even over it.
 * Threads: pure functions, [any].
 * After:   Van Oosterom and Strackee, The Solid Angle of a Plane Triangle, 1983; Arvo, Stratified Sampling of
 *          Spherical Triangles, 1995. */
#ifndef LW_COMMON_SPHERICAL_TRIANGLE_H
#define LW_COMMON_SPHERICAL_TRIANGLE_H

#include "common/base/vec.h"

/** A triangle as the origin sees it. */
struct lw_spherical_triangle {
    struct lw_vec3 a, b, c; /* unit */
    float sr;               /* solid angle, in [0, 2 pi]; 0: a corner is the origin, or it is seen edge on */
};

struct lw_spherical_triangle lw_spherical_triangle(struct lw_vec3 a, struct lw_vec3 b, struct lw_vec3 c);

/** A direction, unit, towards a triangle with sr > 0: even over its solid angle, as (u, v) are over [0, 1)^2.
 * Floats are exact enough from 3e-4 sr on; directions to smaller triangles hit them, but not evenly. */
struct lw_vec3 lw_spherical_triangle_sample(const struct lw_spherical_triangle *triangle, float u, float v);

#endif
