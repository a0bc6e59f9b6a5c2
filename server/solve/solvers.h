/* solvers.h: the solvers that there are, by name.
 * Flow:    --solver NAME -> [solvers] -> solver.h
 * Threads: [any]; the table never changes.
 *
 * To add a solver: implement solver.h in a file of its own, and give it a line in the table of solvers.c. */
#ifndef LW_SOLVE_SOLVERS_H
#define LW_SOLVE_SOLVERS_H

#include "server/solve/combinations.h"

struct lw_solvers_entry {
    const char *name;
    /* One line for people. */
    const char *about;
    uint32_t choice;   /* LW_CHOICE_* (combinations.h) */
    uint32_t channels; /* channels that it shows: bit for each (tile_channels.h) */
    /** Whether it can do what a desc asks for, as far as that is set; scene and atlas_map may be NULL yet.
     * Errors: LW_USAGE naming what it cannot. */
    enum lw_status (*check)(const struct lw_solver_desc *desc, struct lw_error *err);
    /** Builds a solver of a scene at a pose. What desc points to outlives it. It checks first.
     * Errors: as check(); LW_NO_MEMORY, LW_INTERNAL; LW_BAD_DATA for more texels than fit. */
    enum lw_status (*create)(const struct lw_solver_desc *desc, const struct lw_pose *pose,
                             struct lw_solver **out_solver, struct lw_error *err);
};

/** The solver at a place in the table, 0 the default; NULL after the last one. */
const struct lw_solvers_entry *lw_solvers_at(unsigned index);

/** Finds a solver. name: NULL is the default. Errors: LW_USAGE, naming those there are. */
LW_MUST_CHECK enum lw_status lw_solvers_find(const char *name, const struct lw_solvers_entry **out_entry,
                                             struct lw_error *err);

/** Finds a solver and builds it. Errors: as those two. */
LW_MUST_CHECK enum lw_status lw_solvers_create(const char *name, const struct lw_solver_desc *desc,
                                               const struct lw_pose *pose, struct lw_solver **out_solver,
                                               struct lw_error *err);

/** Writes the names into a text of that size: "cells (default), other". Cut off if they do not fit. */
void lw_solvers_list(char *out_text, size_t size);

#endif
