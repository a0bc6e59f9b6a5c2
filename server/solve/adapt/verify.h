/* verify.h: samples of the last solve taken again, and how far they differ now.
 * Flow:    packets that the gradient has chosen -> [verify] -> gradient, control variate
 * Threads: each call works on one tile. [any worker] */
#ifndef LW_ADAPT_VERIFY_H
#define LW_ADAPT_VERIFY_H

#include "server/solve/transport/transport.h"

/** Takes samples of the last solve of a tile's blocks again, with the same random numbers, in the packets
 * that their change says (gradient.h), and notes there how far the estimates differ. Rays that are traced
 * again replace the ray hits of those packets. Where all packets are verified about direct light, that is
 * corrected (control_variate.h). Returns whether any was. */
bool lw_verify_compare(const struct lw_transport *transport, struct lw_solve_tile *tile,
                       struct lw_ray_count *count);

/** Before the bounce rays of a tile's due blocks are traced: corrects indirect light by what now arrives
 * along those of the last solve. */
void lw_verify_reread(const struct lw_transport *transport, struct lw_solve_tile *tile);

/** After the last bounce: corrects indirect light of due blocks, as far as it is that of
 * earlier frames, by what the radiance of bounces differs by from the frame before, from the
 * first on, along the new ray hits. */
void lw_verify_add_indirect_change(const struct lw_transport *transport, struct lw_solve_tile *tile);

/** Sets tiles->estimate to what the last solve of a tile's blocks had, if nothing has changed since. */
void lw_verify_restore_estimates(const struct lw_transport *transport, const struct lw_solve_tile *tile,
                                 struct lw_ray_count *count);

#endif
