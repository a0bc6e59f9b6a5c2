/* shot_lights.h: virtual point lights that a user shoots from lamps: points that stand for reflected light.
 * Flow:    lamps, pose, rays -> [shot_lights] -> lights of a set -> instant_radiosity
 * Threads: one thread.
 * After:   Keller 1997 (instant radiosity); Tonna 2019 (virtual_paths.h).
 *
 * The first light of a path lies where a ray from a lamp ends (lamp_rays.h). Its power is that of the ray
 * times the albedo there. The next lies where a cosine-weighted ray from there ends. Draws are stratified
 * over the lamps, by number; each set has every sets-th. When something has moved, a shadow ray to the parent
 * decides whether a light stays, and at most a set's worth is shot again. A first light that stays stands for
 * the same area, and follows its lamp: flux = albedo x E x area. */
#ifndef LW_CLIENT_PATHS_SHOT_LIGHTS_H
#define LW_CLIENT_PATHS_SHOT_LIGHTS_H

#include "client/camera/place.h"
#include "common/light/lamp_rays.h"
#include "common/light/virtual_paths.h"

struct lw_shot_light {
    float position[3], normal[3], flux_w[3]; /* world space; radiant power into its hemisphere */
    uint32_t object, shots;                  /* times that it was shot: where its random numbers go on */
    float share[3]; /* share of the arriving flux: albedo, and how its normals slant */
    /* first of a path */
    struct lw_lamp_place lamp;
    float area_m2; /* area that it stands for */
    float bright;  /* luminance of E when it was shot */
    float e[3];    /* W/m^2 */
};

struct lw_shot_lights_desc {
    const struct lw_scene *scene;
    const struct lw_trace *trace;   /* the same scene's, at the pose of each step */
    const struct lw_lights *lights; /* the same scene's, at that pose */
    uint32_t lights_max, bounces, sets;
};

struct lw_shot_lights {
    struct lw_shot_lights_desc desc;
    struct lw_virtual_paths paths;
    struct lw_shot_light *light; /* by lw_virtual_paths_light() */
    struct lw_lamp_rays lamps;
    struct lw_place *place; /* per object */
    struct lw_pose pose;    /* the last step's */
    float largest_m;        /* largest coordinate of the scene */
    uint32_t seed, salt;    /* the step's */
};

/** The objects that desc points to outlive it. Errors: LW_NO_MEMORY; finish it then. */
LW_MUST_CHECK enum lw_status lw_shot_lights_init(struct lw_shot_lights *lights,
                                                 const struct lw_shot_lights_desc *desc);
/** A zeroed one is fine. */
void lw_shot_lights_finish(struct lw_shot_lights *lights);

/** Goes on to a pose: the first time all lights are shot; later, where something has changed, they are
 * checked and shot again. Returns rays. */
uint64_t lw_shot_lights_step(struct lw_shot_lights *lights, const struct lw_pose *pose, uint32_t seed);

/** The area of all surfaces, m^2. */
double lw_shot_lights_area_m2(const struct lw_scene *scene, const struct lw_pose *pose);

#endif
