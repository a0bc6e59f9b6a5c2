/* lamp_rays.h: rays that leave lamps, as their light does.
 * Flow:    lights, pose -> [lamp_rays] -> rays with their share of the light, and a point's light from the
 *          place on the lamp where a ray began
 * Threads: init and set_pose by one thread; the others [any] in between.
 *
 *   point, spot       even over the directions of the sphere or cone; flux I / p
 *   sun               even over what a box around the scene shows to it; flux E A / p
 *   emitter           even over its area, cosine-weighted; flux L pi A / p
 *   sky, environment  a direction as lights.h draws bright ones or any; then as a sun; flux L A / p
 *
 * A lamp is chosen by its whole flux, luminance. */
#ifndef LW_COMMON_LAMP_RAYS_H
#define LW_COMMON_LAMP_RAYS_H

#include "common/light/lights.h"

struct lw_lamp_rays {
    const struct lw_lights *lights;
    struct lw_vec3 low, high; /* box around the scene, m */
    double *sum;              /* fluxes up to each lamp: emitters, points and spots, suns, the sky; W */
    uint32_t count;
};

/** The lights outlive it. No lamp is lit until set_pose(). Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lamp_rays_init(struct lw_lamp_rays *lamps, const struct lw_lights *lights);
/** A zeroed one is fine. */
void lw_lamp_rays_finish(struct lw_lamp_rays *lamps);
/** Takes over lights and objects; the lights are at that pose. */
void lw_lamp_rays_set_pose(struct lw_lamp_rays *lamps, const struct lw_pose *pose);

/** A place on a lamp. */
struct lw_lamp_place {
    uint32_t lamp;
    float u, v;               /* emitter: barycentrics of its 2nd and 3rd corner; sun: of its disc */
    struct lw_vec3 direction; /* sky: towards it, unit */
};

struct lw_lamp_ray {
    struct lw_lamp_place place;
    struct lw_vec3 origin, direction; /* m; unit */
    struct lw_vec3 face;              /* unit normal of the surface where it starts; 0: there is none */
    struct lw_vec3 flux_w;            /* of all light: the mean over rays is the flux of all lamps */
};

/** A ray of one of the lamps. pick chooses the lamp, `place` where on it, `way` where it goes; all in [0, 1).
 * False: none shines. */
bool lw_lamp_rays_sample(const struct lw_lamp_rays *lamps, float pick, const float place[2],
                         const float way[2], struct lw_lamp_ray *out_ray);

/** Unshadowed irradiance of a point from a place on a lamp. irradiance_normal is that times a
 * factor of the place's own, the same for all points and poses; 0 where no light goes. */
struct lw_light_sample lw_lamp_rays_sight(const struct lw_lamp_rays *lamps, const struct lw_lamp_place *place,
                                          struct lw_vec3 point_ws);

#endif
