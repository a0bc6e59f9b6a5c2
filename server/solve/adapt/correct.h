/* correct.h: compares the stored light of a tile with its current light, and corrects it.
 * Flow:    lists of the plan -> [correct] -> blocks corrected and invalidated; findings -> next plan
 * Threads: each call works on one tile. [any worker] */
#ifndef LW_ADAPT_CORRECT_H
#define LW_ADAPT_CORRECT_H

#include "server/solve/adapt/converged.h"
#include "server/solve/transport/transport.h"

/* What corrections of a frame go by. */
struct lw_correct {
    const struct lw_transport *passes;
    struct lw_converged converged;
    struct lw_budget budget;
    bool filtered; /* shown light is filtered (denoise.h) */
};

/* One tile's findings. */
struct lw_correct_found {
    struct lw_ray_count rays;
    bool direct;      /* its direct light was corrected */
    bool corrected;   /* some of its light was */
    bool invalidated; /* a block is */
};

/** Verifies the packets of a tile's blocks that the round asks for; corrects and invalidates the blocks by
 * the findings. */
struct lw_correct_found lw_correct_round(const struct lw_correct *correct,
                                         const struct lw_gradient_round *round, struct lw_solve_tile *tile);

/** Corrects all light of a tile while lights keep moving: direct light by new shadow rays, indirect light
 * along the ray hits that there are. moves: of the scene, so far. */
struct lw_correct_found lw_correct_all(const struct lw_correct *correct, uint32_t moves,
                                       struct lw_solve_tile *tile);

/** Begins the solve of a tile's due blocks: their means forget stale light. */
struct lw_correct_found lw_correct_due(const struct lw_correct *correct, uint32_t moves,
                                       struct lw_solve_tile *tile);

/** Sums the invalidated blocks of a tile: their texels, their priority. */
void lw_correct_sum(struct lw_solve_tile *tile);

#endif
