/* combinations.h: which choices work together: solvers, channels, groups of lights, codecs, clocks,
 * budgets, and what belongs to one solver alone.
 * Flow:    options, struct lw_solver_desc -> a set of choices -> [combinations] -> a start, or one line
 * Threads: pure functions, [any].
 *
 * The table in combinations.c lists the pairs that do not work together. Every other pair does; the test
 * starts them. */
#ifndef LW_SOLVE_COMBINATIONS_H
#define LW_SOLVE_COMBINATIONS_H

#include "server/solve/solver.h"

/* Each with what people call it. */
#define LW_CHOICES(X)                                                                                        \
    X(CELLS, "--solver cells")                                                                               \
    X(RADIOSITY, "--solver radiosity")                                                                       \
    X(VPL, "--solver vpl")                                                                                   \
    X(SERVED, "lightwelld")                                                                                  \
    X(SPLIT, "--client-lights")                                                                              \
    X(DRAWN_SURFACES, "emissive surfaces in --client-lights")                                                \
    X(GROUPS, "--light-groups")                                                                              \
    X(DIRECTIONAL, "--directional")                                                                          \
    X(TRACING_RANGE, "--tracing-range")                                                                      \
    X(UNDERSAMPLE, "--undersample")                                                                          \
    X(WINDOW, "--window")                                                                                    \
    X(SUBDIVIDE, "--subdivide")                                                                              \
    X(DIRECTIONS, "--directions")                                                                            \
    X(VISIBILITY, "--keep-visibility")                                                                       \
    X(VPL_TERMS, "--vpl-...")                                                                                \
    X(HALF, "--codec half")                                                                                  \
    X(DCT, "--codec dct")                                                                                    \
    X(STEP_WIDEST, "--tile-step")                                                                            \
    X(REAL, "--clock real")                                                                                  \
    X(STEP, "--clock step")                                                                                  \
    X(MANUAL, "--clock manual")                                                                              \
    X(BUDGET, "--frame-budget-ms")                                                                           \
    X(UNITS, "--frame-budget-units")                                                                         \
    X(RANKS, "ranks")                                                                                        \
    X(ANIMATE, "--animate")                                                                                  \
    X(FREEZE, "--freeze")

#define LW_CHOICE_BIT_INDEX(name, text) LW_CHOICE_INDEX_##name,
enum lw_choice_index { LW_CHOICES(LW_CHOICE_BIT_INDEX) LW_CHOICE_COUNT };
#define LW_CHOICE_BIT(name, text) LW_CHOICE_##name = 1u << LW_CHOICE_INDEX_##name,
enum lw_choice { LW_CHOICES(LW_CHOICE_BIT) };

/** What a desc chooses, but for the solver. */
uint32_t lw_combinations_of(const struct lw_solver_desc *desc);

/** Errors: LW_USAGE: one line that names two of the choices that do not work together, and says why. */
LW_MUST_CHECK enum lw_status lw_combinations_check(uint32_t choices, struct lw_error *err);

/** What people call a choice. */
const char *lw_combinations_name(enum lw_choice_index choice);

#endif
