/* place.h: an object's transform, ready for the points that rays have hit and for the rays that start there.
 * Flow:    pose -> [place] -> path_trace, gbuffer
 * Threads: values, [any]. */
#ifndef LW_CLIENT_VIEW_PLACE_H
#define LW_CLIENT_VIEW_PLACE_H

#include "common/scene/scene.h"
#include "common/trace/trace.h"

struct lw_place {
    struct lw_affine to_world;
    struct lw_affine to_normal; /* normals alone, of any length */
    float growth, shift_m;      /* |world coordinate| <= growth |object coordinate| + shift_m */
};

struct lw_place lw_place_of(const struct lw_affine *to_world);

/** A point of a surface in world space, from which rays of light start. */
struct lw_place_point {
    struct lw_vec3 origin; /* lifted off the surface, m */
    struct lw_vec3 normal; /* shading normal, unit, on the side that was met */
    struct lw_vec3 face;   /* geometric normal, likewise */
};

/** The point that lane `i` of a packet has hit.
 * mesh, surface  of that hit */
struct lw_place_point lw_place_point(const struct lw_place *place, const struct lw_mesh *mesh,
                                     const struct lw_hit16 *hits, unsigned i,
                                     const struct lw_surface *surface);

#endif
