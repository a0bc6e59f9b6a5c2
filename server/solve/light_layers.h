/* light_layers.h: the light of a scene as a sum of layers, one for each group of lights; implements solver.h.
 * Flow:    pose -> [light_layers: each layer's own pose -> cell_layer] -> weighted sum -> publish
 *
 * Light is linear: what a lamp gives is in proportion to its intensity, channel by channel. Each group of
 * lights has a cell solver of its own, over one geometry, in which its lights shine as they once did. The
 * layers are summed with the weights that make the lights as solved the lights as they are.
 *
 * To dim, to recolour or to switch a group is another weight: no ray. Only light that is no multiple of the
 * solved light is solved again (one lamp of several in a group; a channel that was dark). A group that
 * is switched off costs nothing. Light that moves does not disturb light that stands: that stays
 * converged while the other is solved.
 *
 * While something moves, errors of a layer are measured against the light of all of them. Once nothing does,
 * they are measured against its own, so that each may be seen alone.
 * Cost: per layer a texel's sums (lw_tiles), and rays of its own. */
#ifndef LW_SOLVE_LIGHT_LAYERS_H
#define LW_SOLVE_LIGHT_LAYERS_H

#include "server/solve/solver.h"

/** Builds a solver whose layers are desc->light_groups. desc->scene may change its materials and sky between
 * two frames, and has then those of the pose. Errors: as lw_solvers_entry.create(). */
LW_MUST_CHECK enum lw_status lw_light_layers_create(const struct lw_solver_desc *desc,
                                                    const struct lw_pose *pose, struct lw_solver **out_solver,
                                                    struct lw_error *err);

#endif
