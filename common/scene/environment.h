/* environment.h: the light of a scene's environment by direction, and directions by their light.
 * Flow:    scene -> radiance along a ray that leaves; scene -> [importance] -> directions worth a ray
 * Threads: importance is built by one thread; everything else [any].
 * After: Karlik et al., MIS Compensation, 2019: what another technique samples well enough is left to it. */
#ifndef LW_COMMON_ENVIRONMENT_H
#define LW_COMMON_ENVIRONMENT_H

#include "common/scene/scene.h"

/** Radiance from a direction (unit, world space), W/(m^2 sr): bilinear between texel centres, around the
 * picture's sides, level above the first and below the last row of centres. 0 if there is no environment. */
struct lw_vec3 lw_environment_radiance(const struct lw_environment *environment, struct lw_vec3 direction_ws);

/** How much of an environment stands out of its average, by direction: a density to draw directions from that
 * is to be combined with a cosine-weighted one, which finds the average well. A texel weighs as much as its
 * luminance exceeds the mean of the whole sphere, times its solid angle; the density in the picture is
 * bilinear between texels as the look-up is, so that a sun of a few texels is met in proportion to what is
 * read of it. An even environment has none. */
struct lw_environment_importance {
    uint32_t width, height;
    float *row, *column; /* cumulative: height; width for each row */
    float mean, excess;  /* luminance over the sphere; how much of that is above the mean */
};

/** Errors: LW_NO_MEMORY. With no environment nothing is allocated and excess is 0. */
LW_MUST_CHECK enum lw_status lw_environment_importance_init(struct lw_environment_importance *importance,
                                                            const struct lw_environment *environment);
void lw_environment_importance_finish(struct lw_environment_importance *importance);

/** A direction for (u, v) in [0, 1)^2, with its density, 1/sr. Only where excess > 0. */
struct lw_vec3 lw_environment_importance_draw(const struct lw_environment_importance *importance, float u,
                                              float v, float *out_pdf);
/** Density of a direction; 0 where there is no excess. */
float lw_environment_importance_pdf(const struct lw_environment_importance *importance,
                                    struct lw_vec3 direction_ws);

#endif
