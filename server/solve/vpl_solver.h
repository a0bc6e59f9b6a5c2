/* vpl_solver.h: virtual point lights; implements solver.h.
 * Flow:    direct light -> [virtual lights -> E of a set of them] -> tiles -> publish
 * Threads: those of solver.h.
 * After:   Tonna 2019 (instant radiosity, Keller 1997, with temporal sets).
 *
 *   E_i = sum over lights j of flux_j V_ij cos_i cos_j / (pi max(r^2, d0^2))
 *
 * Lamps, emissive surfaces and sky enter by the direct pass. Some hundred points on surfaces stand for what
 * those reflect (virtual_lights.h). A frame shades one of T sets of them, times T. The mean of T frames is
 * the sum over all sets. From the second round on each frame shoots its set again, so that the mean over
 * rounds has no error by the number of lights; d0 remains.
 */
#ifndef LW_SOLVE_VPL_SOLVER_H
#define LW_SOLVE_VPL_SOLVER_H

#include "server/solve/solver.h"

/** As lw_solvers_entry.check(). */
LW_MUST_CHECK enum lw_status lw_vpl_solver_check(const struct lw_solver_desc *desc, struct lw_error *err);
/** As lw_solvers_entry.create(). */
LW_MUST_CHECK enum lw_status lw_vpl_solver_create(const struct lw_solver_desc *desc,
                                                  const struct lw_pose *pose, struct lw_solver **out_solver,
                                                  struct lw_error *err);

#endif
