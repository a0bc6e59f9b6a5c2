/* reflectors.h: small objects that shine by what they reflect, such as the housing of a lamp. Packets send
 * rays to them.
 * Flow:    radiance, pose -> [reflectors: update, once a frame] -> list -> points on it for the rays of
 *          packets (bounces.c)
 * Threads: update by one thread while nobody reads; the others are pure, [any worker].
 *
 * A lantern is a hand wide, and lit a thousand times as brightly as the wall behind it. One bounce ray in
 * hundreds meets it, and then the texel that the ray came from shines for as long as its mean remembers. So
 * what bounce rays meet of a reflector counts nothing. Its light comes along rays of its own, as that of
 * emissive triangles does:
 *
 *   E_k += V L_{k-1}(y) cos cos' / (d^2 p(y))      y: a point on it; p: density over the area of them all
 *
 * Where a ray starts and what it meets says which of the two counts, so that no path does twice. Bounce rays
 * count for close hits, since 1 / d^2 has no bound, for places beyond the tracing range, which probes know,
 * and for triangles that are not opaque. */
#ifndef LW_TRANSPORT_REFLECTORS_H
#define LW_TRANSPORT_REFLECTORS_H

#include "server/solve/state/tiles.h"

#define LW_REFLECTORS_MAX 32u

struct lw_reflector {
    uint32_t object, count;
    uint32_t *triangle; /* opaque triangles of its mesh */
    float *upto;        /* running sums of their area times radiance, W/sr: by what they are picked */
    float *radiance;    /* radiance that each is picked by, W/(m^2 sr) */
    uint32_t capacity;  /* entries of these three */
    struct lw_vec3 centre_ws;
    float radius_m;
};

struct lw_reflectors {
    const struct lw_scene *scene;                    /* outlives it */
    const struct lw_texels *texels;                  /* outlives it */
    float radius_max_m;                              /* largest radius of an object that may be one */
    bool *is_bright;                                 /* per object: it has a texel that may be worth it */
    uint8_t *of_object;                              /* index into list, or LW_REFLECTORS_MAX */
    struct lw_reflector list[LW_REFLECTORS_MAX + 1]; /* the last: not listed yet */
    uint32_t count;
};

/** pose: any. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_reflectors_init(struct lw_reflectors *reflectors,
                                                const struct lw_scene *scene, const struct lw_texels *texels,
                                                const struct lw_pose *pose);
void lw_reflectors_finish(struct lw_reflectors *reflectors);

/** Bytes held. */
size_t lw_reflectors_memory_bytes(const struct lw_reflectors *reflectors);

/** Lists what shines now; if there are more than LW_REFLECTORS_MAX, those that shine most. pose: that rays
 * are traced in. The list is a function of light and pose alone. Errors: LW_NO_MEMORY; then it is empty. */
LW_MUST_CHECK enum lw_status lw_reflectors_update(struct lw_reflectors *reflectors,
                                                  const struct lw_tiles *tiles, const struct lw_pose *pose);

/** Takes over where the listed objects are now. tiles: placed there (lw_tiles_set_pose()). */
void lw_reflectors_place(struct lw_reflectors *reflectors, const struct lw_tiles *tiles);

/** Whether light from a triangle to a point within the tracing range comes along rays to reflectors, and not
 * along bounce rays. */
bool lw_reflectors_have(const struct lw_reflectors *reflectors, struct lw_vec3 from_ws, uint32_t object,
                        uint32_t triangle);

/** E that all together would give at a place, unshadowed and face to face, W/m^2 of luminance. */
float lw_reflectors_most(const struct lw_reflectors *reflectors, struct lw_vec3 place_ws);

/** Picks one, as lw_reflectors_most() has them, by a random number in [0, 1). *out_probability: that it had.
 * There must be one. */
const struct lw_reflector *lw_reflectors_pick(const struct lw_reflectors *reflectors, struct lw_vec3 place_ws,
                                              float random, float *out_probability);

struct lw_reflector_point {
    struct lw_vec3 position_ws, normal_ws; /* unit, by winding */
    uint32_t triangle;                     /* within the mesh; u, v: weights of its 2nd and 3rd vertex */
    float u, v;
    float area_m2; /* 1 / density over the reflector's area */
};

/** Picks a point on a listed reflector by three random numbers in [0, 1). */
void lw_reflectors_point(const struct lw_reflectors *reflectors, const struct lw_reflector *reflector,
                         const struct lw_pose *pose, const float random[3], struct lw_reflector_point *out);

#endif
