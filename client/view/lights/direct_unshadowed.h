/* direct_unshadowed.h: E of a light without shadows, and what a finish mirrors of it.
 * Flow:    points, light -> [direct_unshadowed] -> E over the light's colour, points that it reaches
 * Threads: pure functions, any worker. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_UNSHADOWED_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_UNSHADOWED_H

#include "client/view/lights/direct_private.h"

/** E of a light at points, over its colour. Returns the bits of the points that it reaches. */
uint16_t lw_direct_unshadowed_points(const struct lw_direct_pixels *direct, uint32_t candidate,
                                     const struct lw_points16 *points, float e[LW_DIRECT_LANES]);

/** The same of a block, into work->e. With a finish it goes by bumped normals, and fills
 * work->gloss. */
uint16_t lw_direct_unshadowed_block(const struct lw_direct_pixels *direct, uint32_t candidate,
                                    struct lw_direct_work *work, const struct lw_direct_block *block,
                                    uint32_t b);

/** Colour of a light: linear RGB. E is a multiple of it. */
struct lw_vec3 lw_direct_unshadowed_colour(const struct lw_direct_pixels *direct, uint32_t candidate);

/** Points of a block with their bumped normals. */
void lw_direct_unshadowed_bump(const struct lw_direct_block *restrict block,
                               struct lw_points16 *restrict out);

/** Adds e to a block with finishes: light that arrives at diffuse lobes, and mirrored light.
 * colour: of e */
void lw_direct_unshadowed_add(const float *restrict e, const struct lw_gloss_lit16 *restrict lit,
                              struct lw_vec3 colour, struct lw_direct_block *restrict block);

/** Weight of a light at each pixel, over its e: radiance that the pixel reflects of the light, over radiance
 * that it reflects of even light. A pixel without a finish has 1. */
void lw_direct_unshadowed_weigh_mirrored(const struct lw_direct_block *restrict block,
                                         const struct lw_gloss_lit16 *restrict lit, float *restrict out);

#endif
