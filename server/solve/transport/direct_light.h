/* direct_light.h: the direct light of a packet's texels. The estimators are in transport.h.
 * Flow:    launch, lights -> [direct light] -> tiles
 * Threads: [any worker] */
#ifndef LW_TRANSPORT_DIRECT_LIGHT_H
#define LW_TRANSPORT_DIRECT_LIGHT_H

#include "server/solve/transport/ray_launch.h"
#include "server/solve/transport/transport.h"

/** Parts of the E of each lane, W/m^2. */
struct lw_direct_light {
    float all[3][LW_TRACE_WIDTH], drawn[3][LW_TRACE_WIDTH]; /* drawn: what client lights give of it */
    /* Cosine moments of all other light and of that of client lights; 0 where tiles hold none. */
    float moment[3][LW_TRACE_WIDTH], drawn_moment[3][LW_TRACE_WIDTH];
};

/** One frame's estimate, of each lane by itself. Needs the launch's sample points for the
 * frame's first sample and the site's frame; further samples choose sample points of their own.
 * Adds the shadow rays to the count. */
void lw_direct_light_estimate(const struct lw_transport *transport, const struct lw_solve_tile *tile,
                              struct lw_ray_launch *launch, struct lw_ray_launch_site *site,
                              struct lw_direct_light *out_estimate, struct lw_ray_count *count);

/** The estimate of the packet's last solve, with the same random numbers. Needs the site's frame. */
void lw_direct_light_repeat(const struct lw_transport *transport, const struct lw_solve_tile *tile,
                            struct lw_ray_launch *launch, struct lw_ray_launch_site *site,
                            struct lw_direct_light *out_estimate, struct lw_ray_count *count);

/** Keeps a lane's estimate as the last one of a texel (tiles->estimate). */
void lw_direct_light_keep(const struct lw_transport *transport, uint32_t texel,
                          const struct lw_direct_light *estimate, uint32_t lane);

/** Direct light of the covered texels of a tile's due blocks, blended into tiles->direct. */
void lw_direct_light_solve(const struct lw_transport *transport, struct lw_solve_tile *tile,
                           struct lw_ray_count *count);

static inline struct lw_vec3 lw_direct_light_lane(const float e[3][LW_TRACE_WIDTH], uint32_t lane) {
    return lw_vec3(e[0][lane], e[1][lane], e[2][lane]);
}

#endif
