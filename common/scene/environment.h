/* environment.h: radiance of a scene's environment by direction, and importance sampling of bright
 * directions.
 * Flow:    scene -> radiance along a ray that leaves. scene -> [importance] -> bright directions
 * Threads: importance is built by one thread; everything else [any].
 * After: Karlik et al., MIS Compensation, 2019: the density leaves out what the other technique samples
 * well. */
#ifndef LW_COMMON_ENVIRONMENT_H
#define LW_COMMON_ENVIRONMENT_H

#include "common/scene/scene.h"

/** Radiance from a direction (unit, world space), W/(m^2 sr): bilinear between texel centres, around the
 * picture's sides, level above the first and below the last row of centres. 0 if there is no environment. */
struct lw_vec3 lw_environment_radiance(const struct lw_environment *environment, struct lw_vec3 direction_ws);

/** A density of directions, to be combined with a cosine-weighted one, which samples the average well. The
 * weight of a texel is its luminance above the mean of the whole sphere, times its solid angle. The density
 * is bilinear between texels, like the look-up, so that it is proportional to a sun of a few texels. A
 * uniform environment has excess 0. */
struct lw_environment_importance {
    uint32_t width, height;
    float *row, *column; /* cumulative: height; width for each row */
    float mean, excess;  /* mean luminance over the sphere; the part of it above the mean */
};

/** Errors: LW_NO_MEMORY. With no environment nothing is allocated and excess is 0. */
LW_MUST_CHECK enum lw_status lw_environment_importance_init(struct lw_environment_importance *importance,
                                                            const struct lw_environment *environment);
void lw_environment_importance_finish(struct lw_environment_importance *importance);

/** A direction for (u, v) in [0, 1)^2, with its density, 1/sr. Only where excess > 0. */
struct lw_vec3 lw_environment_importance_sample(const struct lw_environment_importance *importance, float u,
                                                float v, float *out_pdf);
/** Density of a direction; 0 where there is no excess. */
float lw_environment_importance_pdf(const struct lw_environment_importance *importance,
                                    struct lw_vec3 direction_ws);

#endif
