/* correction.h: light that has changed is corrected by how much it has, before it is solved again.
 * Flow:    what packets have found (passes.c) -> [correction] -> sums, estimates and running means of a tile's texels
 * Threads: a tile is corrected by the one worker that has it; what it sends out stays until lw_bounces_radiate().
 *
 * Samples that are taken again with the same random numbers (change.h) differ by what has changed, and not by their noise. So the mean
 * of many solves plus that difference is an estimate of the light of now with hardly more noise than the mean had: the old light is
 * a control variate for the new one. Nothing has to be forgotten but what the difference itself is in doubt by.
 *   direct    texel by texel, where all packets of a block were asked; in doubt is what a plane through a packet's differences
 *             leaves: edges of shadows; and what packets that lie among each other differ by: where one of many lights stands for all, the
 *             samples of before and of now need not be of the same one
 *   indirect  surface by surface of a block, and by quarters of it as far as these differ by more than chance. A texel has few rays,
 *             and packets share theirs: what a surface has found is believed as far as its tile's surfaces have changed by more than
 *             their standard errors (empirical Bayes, Efron and Morris 1975)
 * Estimates are corrected with the means that they entered, so that what was taken over is not found again. */
#ifndef LW_ADAPT_CONTROL_VARIATE_H
#define LW_ADAPT_CONTROL_VARIATE_H

#include "server/solve/transport/ray_launch.h"

/** Adds to the direct light of the texels of packet `set` what it was found to differ by, W/m^2, a lane
 * each; off_drawn: of that, what client lights give; NULL: there are none. What the packet has found is
 * then what stays in doubt. */
void lw_control_variate_direct(struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                               struct lw_solve_block *block, uint32_t set, const struct lw_ray_launch *launch,
                               const struct lw_vec3 off[LW_TRACE_WIDTH], const struct lw_vec3 *off_drawn);

/** After that, of all packets of a tile that were asked about it: adds what is in doubt because packets of a surface differ. */
void lw_control_variate_doubt_direct(struct lw_solve_tile *tile);

/** Adds to the indirect light of a tile what its packets were told since they were last asked here (change.told), and takes it from what
 * they have found, but what is too little to matter where errors of target_error may stay. estimates: those of the last solve stay in use, and are corrected as well. Returns whether there was anything. */
bool lw_control_variate_indirect(struct lw_tiles *tiles, struct lw_solve_tile *tile, float target_error,
                                 bool estimates);

#endif
