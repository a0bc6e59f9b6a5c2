/* hit_gloss.h: which way a glossy surface sends on the direct light that it gets.
 * Flow:    ray hit, finish, cosine moment of direct light there -> [hit_gloss] -> a factor for the ray
 * Threads: pure functions, [any worker].
 *
 * Texels send light on evenly, L = albedo/pi E. Where E is the sun's, a glossy wall sends most of it to one
 * side, and a floor beside the wall is lit by that. The moment V of direct light (direction_form.h) says
 * where the light comes from, l = V/|V|, and how much of it, c = |V|/E. So the first bounce reads
 *
 *   L = albedo/pi E ((1 - c) + c pi f(l, o) / albedo)      f: lobes.h; o: towards the ray's origin
 *
 * and later ones read even light. Sharp lobes count as those of roughness HIT_GLOSS_ROUGHNESS: one ray in
 * thousands would find them (path space regularization: Kaplanyan and Dachsbacher 2013). */
#ifndef LW_TRANSPORT_HIT_GLOSS_H
#define LW_TRANSPORT_HIT_GLOSS_H

#include "server/solve/transport/transport.h"

#define LW_HIT_GLOSS_ONE 1024u /* a factor of 1 */

/** The factor of what lane `lane` of a packet meets at a texel of level 0, times LW_HIT_GLOSS_ONE. Weak light
 * is not looked at, and has a factor of 1. from: the texel that the ray is of */
uint16_t lw_hit_gloss(const struct lw_transport *transport, const struct lw_ray16 *rays,
                      const struct lw_hit16 *hits, uint32_t lane, uint32_t from, uint32_t texel);

#endif
