/* bounces.h: bounce rays, and the light that arrives along them.
 * Flow:    radiance of the bounce before -> [trace: once a frame] -> ray hits (ray_hit.h) ->
 *          [gather: once a bounce] -> tiles
 * Threads: each call works on one tile. [any worker] */
#ifndef LW_TRANSPORT_BOUNCES_H
#define LW_TRANSPORT_BOUNCES_H

#include "server/solve/transport/ray_launch.h"
#include "server/solve/transport/transport.h"

/** Traces the bounce rays of a tile's due blocks, and those to reflectors, and notes where they ended. */
void lw_bounces_trace(const struct lw_transport *transport, const struct lw_solve_tile *tile,
                      struct lw_ray_count *count);

/** Traces the same of one packet's last solve again; their hits replace those of that
 * solve. Needs the site's frame. */
void lw_bounces_repeat(const struct lw_transport *transport, const struct lw_solve_tile *tile,
                       struct lw_ray_launch *launch, struct lw_ray_launch_site *site,
                       struct lw_ray_count *count);

/** One frame's estimate of E of bounce order `bounce` (from 1) at a texel, W/m^2, along its rays. */
struct lw_vec3 lw_bounces_at(const struct lw_transport *transport, uint32_t texel, uint32_t bounce);

/** Bounce order `bounce` (from 1) from tiles->radiance[bounce - 1] of the whole scene. */
void lw_bounces_gather(const struct lw_transport *transport, const struct lw_solve_tile *tile,
                       uint32_t bounce);

/** Sets tiles->radiance[bounce] of a tile to what it sends out of bounce order `bounce` (0: direct): albedo /
 * pi x E; adds the difference to its blocks' radiance_change. */
void lw_bounces_radiate(const struct lw_transport *transport, const struct lw_solve_tile *tile,
                        uint32_t bounce);

#endif
