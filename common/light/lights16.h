/* lights16.h: samples of lights for sixteen points at once, the same numbers as lights.h gives for one.
 * Flow:    sixteen points of surfaces -> [lights16] -> what arrives there if nothing is in the way, ready for
 *          shadow rays
 * Threads: [any], as lights.h. */
#ifndef LW_COMMON_LIGHTS16_H
#define LW_COMMON_LIGHTS16_H

#include "common/base/points16.h"
#include "common/light/lights.h"

/** A sample of light for each of sixteen points, world space. */
struct lw_light_sample16 {
    _Alignas(64) float dir_x[16]; /* unit, from the point to the light */
    float dir_y[16], dir_z[16];
    float distance_m[16]; /* INFINITY for suns and the sky */
    /* estimate of E on the point's surface, W/m^2; 0: nothing arrives, the other fields are undefined */
    float e[3][16];
};

/** Bit i set: something may arrive at point i. */
uint16_t lw_light_sample16_lit(const struct lw_light_sample16 *sample);

/** lw_light_tree_choose() for each point by itself, all with the same `pick`.
 * active           points that are asked about; the others get UINT32_MAX
 * out_probability  0 where there is no light */
void lw_light_tree_choose16(const struct lw_light_tree *tree, uint32_t group,
                            const struct lw_points16 *points, float pick, uint16_t active,
                            uint32_t out_light[16], float out_probability[16]);

/** lw_light_tree_choose() for one region in several groups, by a pick for each. light: UINT32_MAX where there
 * is none. */
struct lw_light_choice {
    uint32_t group;
    float pick;
    uint32_t light;
    float probability;
};
void lw_light_tree_choose_each(const struct lw_light_tree *tree, const struct lw_light_region *region,
                               struct lw_light_choice *choice, uint32_t count);

/** lw_lights_sample_near(), times the cosine, of ONE light for the points that have chosen it.
 * probability  of each point's choice
 * chosen       those points; samples of the others stay as they are */
void lw_lights_sample_near16(const struct lw_lights *lights, uint32_t light, const float probability[16],
                             float u, float v, const struct lw_points16 *points, uint16_t chosen,
                             struct lw_light_sample16 *out);

/** lw_lights_sample_punctual(), times the cosine. */
void lw_lights_sample_punctual16(const struct lw_lights *lights, uint32_t light, float u, float v,
                                 const struct lw_points16 *points, struct lw_light_sample16 *out);

/** lw_lights_place_sky(), times the cosine. sky: one for each point. */
void lw_lights_place_sky16(const struct lw_lights *lights, const struct lw_sky_sample sky[16],
                           const struct lw_points16 *points, struct lw_light_sample16 *out);

#endif
