/* hit_sun.h: which texel a ray reads on the edge of the sun's light.
 * Flow:    ray hits, radiance of their texels -> [hit_sun] -> the texels whose light they read
 * Threads: [any worker]; radiance stays as it is meanwhile.
 *
 * A texel that such an edge cuts holds the mean of both sides. From behind a curtain that hangs over a sunlit
 * floor a ray meets the dark side alone. So it looks for the sun, and reads the nearest texel around that is
 * as its end: in the sun, or in the shade. In the mean over a texel that is the texel's own light. */
#ifndef LW_TRANSPORT_HIT_SUN_H
#define LW_TRANSPORT_HIT_SUN_H

#include "server/solve/transport/transport.h"

/** Puts the texels to read in the place of those that a packet's rays read.
 * active  lanes that have ended on a texel of level 0, hit[lane]
 * from    the texel that a lane's ray is of
 * salt    of the rays that have ended there
 * Adds its shadow rays to the count: none where a texel and those around it are all in the sun or all in the
 * shade, or where light is weak. */
void lw_hit_sun_read16(const struct lw_transport *transport, uint16_t active,
                       const uint32_t from[LW_TRACE_WIDTH], uint32_t salt, const struct lw_hit16 *hits,
                       uint32_t hit[LW_TRACE_WIDTH], struct lw_ray_count *count);

#endif
