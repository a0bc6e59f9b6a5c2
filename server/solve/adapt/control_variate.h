/* control_variate.h: light that has changed is corrected by its change, before it is solved again.
 * Flow:    differences that packets found (verify.c) -> [control_variate] ->
 *          sums, estimates and means of texels
 * Threads: a tile is corrected by the one worker that has it; what it sends out stays until
 *          lw_bounces_radiate().
 *
 * Samples that are taken again with the same random numbers (gradient.h) differ by the change of light, and
 * not by their noise. So the mean of many solves plus that difference estimates the current light, with
 * hardly more noise than the mean had: the old light is a control variate for the current light. The mean
 * forgets only what the standard error of the difference asks for.
 *
 *   direct    texel by texel, where all packets of a block were verified. Standard error: what a plane
 *             through a packet's differences leaves (edges of shadows), and what packets that lie among each
 *             other differ by: where one light stands for many, the two samples may be of different lights
 *   indirect  surface by surface of a block, side by side where walls stand on it (regions.h), and by its
 *             regions as far as these differ by more than chance.
 *             A texel has few rays, and packets share theirs. So a surface's difference is taken over as far
 *             as the surfaces of its tile changed by more than their standard errors (empirical Bayes, Efron
 *             and Morris 1975)
 *
 * Estimates are corrected with the means that they entered, so that a correction
 * is not found again. */
#ifndef LW_ADAPT_CONTROL_VARIATE_H
#define LW_ADAPT_CONTROL_VARIATE_H

#include "server/solve/transport/ray_launch.h"

/** Adds to the direct light of the texels of packet `set` the difference that was found, W/m^2, a lane each.
 * off_drawn: the part of it that client lights give; NULL: there are none. The packet's finding is then the
 * square of its standard error. */
void lw_control_variate_direct(struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                               struct lw_solve_block *block, uint32_t set, const struct lw_ray_launch *launch,
                               const struct lw_vec3 off[LW_TRACE_WIDTH], const struct lw_vec3 *off_drawn);

/** After that, of all packets of a tile that were verified about it: adds the standard error that differences
 * between packets of a surface show. */
void lw_control_variate_note_error(struct lw_solve_tile *tile);

/** Adds to the indirect light of a tile the differences that its packets found since the last
 * call, and takes them off the packets' sums. A difference too small to matter at target_error
 * stays. estimates: the estimates of the last solve stay in use, and are corrected as well. Returns
 * whether there was anything. */
bool lw_control_variate_indirect(struct lw_tiles *tiles, struct lw_solve_tile *tile, float target_error,
                                 bool estimates);

#endif
