/* place.h: an object's transform, ready for the points that rays have hit and for the rays that start there.
 * Flow:    pose -> [place] -> path_trace, gbuffer
 * Threads: values, [any]. */
#ifndef LW_CLIENT_CAMERA_PLACE_H
#define LW_CLIENT_CAMERA_PLACE_H

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

/** Lobes of the surface at such a point, seen along a ray. */
struct lw_place_gloss {
    struct lw_vec3 plain;         /* the point's normal. Light from below it gives nothing */
    struct lw_vec3 normal;        /* with its bumps, bent towards the eye (shading_bend.h): the lobes' */
    struct lw_vec3 across, along; /* complete it to their frame */
    struct lw_lobes_seen seen;
};

/** False: it is matt and even, and *out stays.
 * to_eye  against the ray, unit
 * point   lw_place_point() of the hit */
bool lw_place_gloss(const struct lw_place *place, const struct lw_scene *scene, const struct lw_mesh *mesh,
                    const struct lw_hit16 *hits, unsigned i, const struct lw_surface *surface,
                    const struct lw_place_point *point, struct lw_vec3 to_eye, struct lw_place_gloss *out);

static inline struct lw_vec3 lw_place_gloss_to_local(const struct lw_place_gloss *gloss, struct lw_vec3 d) {
    return lw_vec3(lw_vec3_dot(gloss->across, d), lw_vec3_dot(gloss->along, d),
                   lw_vec3_dot(gloss->normal, d));
}

static inline struct lw_vec3 lw_place_gloss_to_world(const struct lw_place_gloss *gloss, struct lw_vec3 d) {
    return lw_vec3_mad(lw_vec3_mad(lw_vec3_scale(gloss->across, d.x), gloss->along, d.y), gloss->normal, d.z);
}

/** f times the light's cosine: lw_lobes_reflect() of a direction in world space, unit. */
static inline struct lw_vec3 lw_place_gloss_reflect(const struct lw_place_gloss *gloss, struct lw_vec3 d) {
    if (!(lw_vec3_dot(gloss->plain, d) > 0)) return lw_vec3(0, 0, 0);
    return lw_lobes_reflect(&gloss->seen, lw_place_gloss_to_local(gloss, d));
}

#endif
