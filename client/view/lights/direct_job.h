/* direct_job.h: one light at a screen tile: E without shadows, shadow rays, their mean.
 * Flow:    light, tile -> [direct_job: unshadowed, rays, resolve, weak] -> e and mirrored of its blocks
 * Threads: any worker. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_JOB_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_JOB_H

#include "client/view/lights/direct_choice.h"

/** Adds a light to the blocks of a tile. outlook: NULL for suns */
void lw_direct_job_add_light(const struct lw_direct_pixels *direct, struct lw_direct_tile *tile,
                             const struct lw_direct_region *region, uint32_t candidate,
                             const struct lw_direct_outlook *outlook);

/** Adds the lights beyond the limit: each block takes one of them at random, by its bound. */
void lw_direct_job_add_rest(const struct lw_direct_pixels *direct, struct lw_direct_tile *tile,
                            const struct lw_direct_choice *choice);

#endif
