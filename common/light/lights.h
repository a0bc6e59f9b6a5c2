/* lights.h: what shines, as the solve and the path tracer sample it: emissive triangles and punctual lights.
 * Flow:    scene, pose -> [lights] -> samples towards a point
 * Threads: create and set_pose by one thread; sampling [any] in between.
 * After:   area sampling of triangles, p. 815 of Pharr, Jakob and Humphreys 2016; units in docs/architecture.md. */
#ifndef LW_COMMON_LIGHTS_H
#define LW_COMMON_LIGHTS_H

#include "common/scene/pose.h"

#define LW_LIGHTS_LOCAL_MAX                                                                                  \
    4096u /* emitters up to which a choice is made for each place; above, by power alone */

/** One emissive triangle in world space. */
struct lw_emitter {
    struct lw_vec3 corner, edge_u, edge_v; /* m */
    struct lw_vec3 normal;                 /* unit, the side that shines */
    float area_m2;
    float power; /* by which it is chosen: luminance x area, W/sr */
    bool both_sides;
    uint32_t object, triangle;
};

struct lw_lights {
    const struct lw_scene *scene;
    struct lw_emitter *emitter;
    uint32_t emitter_count;
    float *power_cdf;                      /* emitter_count entries, last one 1 */
    struct lw_vec3 *radiance;              /* mean of each emitter, W/(m^2 sr) */
    float *luminance;                      /* of each emitter, for the choice among them */
    bool emitters_shine;                   /* at this pose: some emitter has power, and power_cdf is one */
    const struct lw_light_state *punctual; /* the pose's; scene->light_count */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lights_init(struct lw_lights *lights, const struct lw_scene *scene,
                                            const struct lw_pose *pose);
void lw_lights_finish(struct lw_lights *lights);
/** Moves what moves. The pose must outlive the next call. */
void lw_lights_set_pose(struct lw_lights *lights, const struct lw_pose *pose);

/** Light from one direction, ready for one shadow ray. */
struct lw_light_sample {
    struct lw_vec3 direction; /* unit, from the point to the light */
    float distance_m;         /* INFINITY for directional lights */
    struct lw_vec3
        irradiance_normal; /* estimate of E on a surface that faces it: E = irradiance_normal x cos, W/m^2 */
};

/** Weights of choosing each emitter from within a sphere, as a cumulative distribution: bigger where power, nearness
 * and facing promise more; zero only for emitters that turn their backs on the whole sphere.
 * out_cdf  emitter_count floats; only for emitter_count in 1..LW_LIGHTS_LOCAL_MAX
 * Returns  false if no emitter can light the sphere */
bool lw_lights_local_cdf(const struct lw_lights *lights, struct lw_vec3 centre_ws, float radius_m,
                         float *out_cdf);

/** A sample of the emissive triangles: `pick` chooses one from the cdf, (u, v) the point on it; all in [0, 1).
 * irradiance_normal is 0 where the point sees the emitter's back. */
struct lw_light_sample lw_lights_sample_area(const struct lw_lights *lights, const float *cdf, float pick,
                                             float u, float v, struct lw_vec3 point_ws);

/** A sample of one punctual light; (u, v) choose the point on a sun's disc. */
struct lw_light_sample lw_lights_sample_punctual(const struct lw_lights *lights, uint32_t light, float u,
                                                 float v, struct lw_vec3 point_ws);

#endif
