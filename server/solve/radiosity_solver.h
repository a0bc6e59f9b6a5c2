/* radiosity_solver.h: progressive radiosity on texels; implements solver.h.
 * Flow:    direct light, emission shot -> [radiosity passes, one a bounce] -> tiles -> publish
 * Threads: those of solver.h.
 * After:   Kahl 2023.
 *
 * A frame is a whole solution. Points, spots, suns and sky enter by the direct pass. Emissive texels shoot.
 * Each bounce is a pass of all patches over all shooters (radiosity_pass.h). Frames are averaged: each has
 * another place on every texel and other random numbers. It knows no interest, no light groups and no
 * tracing range. It leaves out client lights that are not surfaces. */
#ifndef LW_SOLVE_RADIOSITY_SOLVER_H
#define LW_SOLVE_RADIOSITY_SOLVER_H

#include "server/solve/solver.h"

/* Frames before an error counts as known. Fewer than of other solvers: each is a whole solution. */
#define LW_RADIOSITY_SOLVER_FRAMES_MIN 4u
/* Samples of the direct pass in a frame. */
#define LW_RADIOSITY_SOLVER_DIRECT 16u

/** As lw_solvers_entry.check(). */
LW_MUST_CHECK enum lw_status lw_radiosity_solver_check(const struct lw_solver_desc *desc,
                                                       struct lw_error *err);
/** As lw_solvers_entry.create(). */
LW_MUST_CHECK enum lw_status lw_radiosity_solver_create(const struct lw_solver_desc *desc,
                                                        const struct lw_pose *pose,
                                                        struct lw_solver **out_solver, struct lw_error *err);

#endif
