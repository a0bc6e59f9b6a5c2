/* lights.h: the light sources that the solve and the path tracer sample: emissive triangles, punctual lights,
 * sky.
 * Flow:    scene, pose -> [lights] -> samples towards a point
 * Threads: create and set_pose by one thread; sampling [any] in between.
 * After:   triangles by solid angle, Arvo 1995; multiple importance sampling, Veach and Guibas 1995; units in
 *          docs/architecture.md. */
#ifndef LW_COMMON_LIGHTS_H
#define LW_COMMON_LIGHTS_H

#include "common/light/light_tree.h"
#include "common/scene/environment.h"
#include "common/scene/pose.h"

/* Up to this count of emitters, points and spots, lw_lights_sample() weighs each of them for every point;
 * above, a tree chooses. The solve traces a shadow ray to each of up to this count of points and spots;
 * above, they share this count of rays. */
#define LW_LIGHTS_EXACT_MAX 32u

/** One emissive triangle in world space. */
struct lw_emitter {
    struct lw_vec3 corner, edge_u, edge_v; /* m */
    struct lw_vec3 normal;                 /* unit, the side that shines */
    float area_m2;
    float near_m2; /* square of how far from its middle it is sampled by solid angle, not by area */
    float power;   /* by which it is chosen: luminance x area, W/sr */
    bool both_sides;
    uint32_t object, triangle;
};

/** The lights that take part. All others are dark. Zeroed: all. */
struct lw_lights_part {
    const uint8_t *light, *material; /* an entry for each of the scene's; they outlive the lights */
    uint8_t value;                   /* lights and materials with this entry take part */
    bool sky;                        /* so do sky and environment */
};

struct lw_lights {
    const struct lw_scene *scene;
    struct lw_lights_part part;
    struct lw_emitter *emitter;
    uint32_t emitter_count;
    struct lw_vec3 *radiance;              /* mean of each emitter, W/(m^2 sr) */
    float *luminance;                      /* per emitter, for the choice among them */
    uint32_t shining_count;                /* at this pose: emitters that have power */
    const struct lw_light_state *punctual; /* the pose's; scene->light_count */
    uint32_t *first_emitter; /* per object, and one more: emitters are sorted by object, triangle */
    uint32_t *near, *sun;    /* indices of points and spots; of directional lights */
    uint32_t near_count, sun_count;
    bool few;                  /* emitters, points and spots are LW_LIGHTS_EXACT_MAX at most */
    struct lw_light_tree tree; /* over emitters, then points and spots; count 0: there are none */
    struct lw_light_bounds *bounds;
    struct lw_environment_importance environment;
    float sky_luminance; /* mean of sky and environment over the sphere, W/(m^2 sr) */
    float bright_share;  /* share of the sky's samples towards radiance above the environment's mean */
};

/** All lights of a scene. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lights_init(struct lw_lights *lights, const struct lw_scene *scene,
                                            const struct lw_pose *pose);
/** Some of them. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lights_init_part(struct lw_lights *lights, const struct lw_scene *scene,
                                                 const struct lw_pose *pose,
                                                 const struct lw_lights_part *part);
/** Whether a punctual light takes part. */
static inline bool lw_lights_includes(const struct lw_lights *lights, uint32_t light) {
    return !lights->part.light || lights->part.light[light] == lights->part.value;
}
void lw_lights_finish(struct lw_lights *lights);
/** Reads the scene's changed materials and sky, and the pose. Errors: LW_NO_MEMORY; then there are no lights,
 * and only lw_lights_finish() or lw_lights_init() may follow. */
LW_MUST_CHECK enum lw_status lw_lights_set_materials(struct lw_lights *lights, const struct lw_pose *pose);
/** Moves the lights to a pose; hidden ones emit nothing. The pose must live until the next call. */
void lw_lights_set_pose(struct lw_lights *lights, const struct lw_pose *pose);

/** Whether two poses differ in the light itself or in where it comes from. */
bool lw_lights_differ(const struct lw_lights *lights, const struct lw_pose *was, const struct lw_pose *is);

/** Light from one direction, ready for one shadow ray. */
struct lw_light_sample {
    struct lw_vec3 direction; /* unit, from the point to the light */
    float distance_m;         /* INFINITY for directional lights */
    /* estimate of E on a surface that faces it: E = irradiance_normal x cos, W/m^2 */
    struct lw_vec3 irradiance_normal;
    /* Density of `direction`, 1/sr, the choice of the light included. 0 for points, spots and suns, which no
     * ray hits by chance, and where irradiance_normal is 0. */
    float pdf;
};

/** Samples groups of emitters (light_tree.h) for the points of a region; one sample stands for each group.
 * Points and spots join the groups where there are more than LW_LIGHTS_EXACT_MAX of them.
 * pick         in [0, 1)
 * out_sampled  LW_LIGHTS_EXACT_MAX of them
 * Returns      how many there are */
uint32_t lw_lights_sample_groups(const struct lw_lights *lights, const struct lw_light_region *region,
                                 float pick, struct lw_light_group_sample *out_sampled);

/** A sample of the emitter, point or spot that lw_light_tree_choose() has chosen with a probability; (u, v):
 * the point on it, in [0, 1). irradiance_normal x cos is an estimate of what its group gives. Light from
 * behind the normal's plane is left out. */
struct lw_light_sample lw_lights_sample_near(const struct lw_lights *lights, uint32_t light,
                                             float probability, float u, float v, struct lw_vec3 point_ws,
                                             struct lw_vec3 normal_ws);

/** Emitted radiance of an emitter, W/(m^2 sr), at barycentrics b of its 2nd and 3rd vertex. */
struct lw_vec3 lw_lights_radiance(const struct lw_lights *lights, uint32_t emitter, struct lw_vec2 b);

/** ONE sample of all lights together, for a surface at point_ws with unit normal normal_ws: `pick` chooses
 * the light by its possible contribution, (u, v) the point on it; all in [0, 1). irradiance_normal x cos is
 * an unbiased estimate of the whole direct E before visibility; it includes the probability of the choice.
 * Light from behind the normal's plane is left out. If no light reaches the point, irradiance_normal is 0. */
struct lw_light_sample lw_lights_sample(const struct lw_lights *lights, struct lw_vec3 point_ws,
                                        struct lw_vec3 normal_ws, float pick, float u, float v);

/** The density, 1/sr, with which lw_lights_sample() would have sampled `direction` by choosing the triangle
 * that a ray from the point met: to weigh such a ray against it. (u, v) are the hit's barycentrics,
 * distance_m that to the hit. 0 where the triangle does not shine, or not to this side. The ray then gets
 * the surface's emission, not times alpha: it hits a BLEND emitter with probability alpha. */
float lw_lights_pdf_emitter(const struct lw_lights *lights, struct lw_vec3 point_ws, struct lw_vec3 normal_ws,
                            uint32_t object, uint32_t triangle, float u, float v, struct lw_vec3 direction,
                            float distance_m);
/** The same for a ray that left the scene. Its radiance is lw_scene_sky(). */
float lw_lights_pdf_sky(const struct lw_lights *lights, struct lw_vec3 point_ws, struct lw_vec3 normal_ws,
                        struct lw_vec3 direction);

/** A sample of sky and environment that serves any number of surface points. It either goes to a bright part
 * of the environment, one direction for all points, or is cosine-weighted about each normal. The mixture is
 * weighed by the balance heuristic. */
struct lw_sky_sample {
    bool bright;
    struct lw_vec3 direction; /* bright: in world space; else about +z */
    struct lw_vec3 radiance;  /* bright only */
    float pdf;                /* bright: density among the bright ones */
};
struct lw_sky_sample lw_lights_sample_sky(const struct lw_lights *lights, float u, float v);
/** Applies it to one surface. out_cosine: of its direction with the normal; 0 or less is below the
 * surface, and irradiance_normal is 0. Only where lights->sky_luminance > 0. */
struct lw_light_sample lw_lights_place_sky(const struct lw_lights *lights, const struct lw_sky_sample *sky,
                                           struct lw_vec3 normal_ws, float *out_cosine);

/** A sample of one punctual light; (u, v) choose the point on a sun's disc. */
struct lw_light_sample lw_lights_sample_punctual(const struct lw_lights *lights, uint32_t light, float u,
                                                 float v, struct lw_vec3 point_ws);

#endif
