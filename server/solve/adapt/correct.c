#include "server/solve/adapt/correct.h"

#include "common/base/invariant.h"
#include "server/solve/adapt/control_variate.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/adapt/verify.h"

#include <math.h>

/* A converged block whose light has been corrected stays converged up to this many times its target error:
 * less of the light, and it is noisier. */
#define CONVERGED_FACTOR 1.5f

void lw_correct_sum(struct lw_solve_tile *tile) {
    double square = 0;
    tile->change.invalidated_count = 0;
    tile->change.invalidated = false;
    LW_TILES_EACH_BLOCK (tile, block) {
        const double share = fmin(1, (double)block->change.strength);
        tile->change.invalidated |= lw_gradient_is_invalidated(&block->change);
        if (!lw_gradient_is_strong(&block->change)) continue;
        square += share * share * block->covered_count;
        tile->change.invalidated_count += block->covered_count;
    }
    tile->change.priority =
        tile->change.invalidated_count ? (float)(square / tile->change.invalidated_count) : 0;
    LW_INVARIANT(tile->change.invalidated_count <= tile->covered_count);
    LW_INVARIANT_DEAR(tile->change.priority >= 0 && tile->change.priority <= 1);
}

/* Corrects indirect light after a comparison, and judges a corrected tile again. */
static void take_over(const struct lw_correct *correct, struct lw_solve_tile *tile,
                      struct lw_correct_found *found) {
    found->corrected |=
        lw_control_variate_indirect(correct->passes->tiles, tile, correct->converged.target_error, true);
    if (found->corrected) lw_estimates_judge(correct->passes, tile);
}

static void sum_up(struct lw_solve_tile *tile, struct lw_correct_found *found) {
    lw_correct_sum(tile);
    lw_tiles_sum_up(tile);
    found->invalidated = tile->change.invalidated;
}

struct lw_correct_found lw_correct_round(const struct lw_correct *correct,
                                         const struct lw_gradient_round *round, struct lw_solve_tile *tile) {
    const float target_error = correct->converged.target_error;
    struct lw_correct_found found = {.invalidated = tile->change.invalidated};
    bool any = false, more = false;
    LW_TILES_EACH_BLOCK (tile, block) any |= lw_gradient_choose(block, round);
    if (!any) return found;
    found.direct = found.corrected = lw_verify_compare(correct->passes, tile, &found.rays);
    LW_TILES_EACH_BLOCK (tile, block) more |= lw_gradient_choose_more(block, target_error, &correct->budget);
    if (more) found.corrected |= lw_verify_compare(correct->passes, tile, &found.rays);
    take_over(correct, tile, &found);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->covered_count) continue;
        lw_gradient_invalidate(block, target_error, &correct->budget);
        if (found.corrected && block->error > CONVERGED_FACTOR * target_error &&
            block->state == LW_BLOCK_CONVERGED && !lw_converged_may(&correct->converged, tile, block))
            block->state = LW_BLOCK_SAMPLED;
    }
    sum_up(tile, &found);
    return found;
}

struct lw_correct_found lw_correct_all(const struct lw_correct *correct, uint32_t moves,
                                       struct lw_solve_tile *tile) {
    struct lw_correct_found found = {.invalidated = tile->change.invalidated};
    bool any = false;
    LW_TILES_EACH_BLOCK (tile, block) any |= lw_gradient_choose_all(block, moves);
    if (!any) return found;
    found.direct = found.corrected = lw_verify_compare(correct->passes, tile, &found.rays);
    take_over(correct, tile, &found);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (block->state == LW_BLOCK_CONVERGED && block->covered_count)
            lw_gradient_invalidate(block, correct->converged.target_error, &correct->budget);
        LW_INVARIANT(!block->change.uncorrected); /* what packets have found is taken over */
        block->change.compare = block->change.direct = 0;
    }
    sum_up(tile, &found);
    return found;
}

struct lw_correct_found lw_correct_due(const struct lw_correct *correct, uint32_t moves,
                                       struct lw_solve_tile *tile) {
    struct lw_correct_found found = {.invalidated = tile->change.invalidated};
    bool any = false;
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->due && moves) any |= lw_gradient_choose_due(block, moves);
    if (any) {
        (void)lw_verify_compare(correct->passes, tile, &found.rays);
        (void)lw_control_variate_indirect(correct->passes->tiles, tile, correct->converged.target_error,
                                          true);
    }
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->due) lw_gradient_weigh_direct(block, moves, correct->filtered, &correct->budget);
    return found;
}
