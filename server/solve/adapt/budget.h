/* budget.h: how much work fits into a frame.
 * Flow:    wall time or a number of units, what work took so far -> [budget] -> plan of the frame
 * Threads: pure functions, [any].
 *
 * A plan counts work and reads no clock, so that the same inputs give the same plan. Under a budget of wall
 * time the measured rates say how much work that is; a budget of units needs none. Work is an integer:
 * workers add theirs in any order. */
#ifndef LW_ADAPT_BUDGET_H
#define LW_ADAPT_BUDGET_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* Work on a texel. One that is solved is a unit; the others are shares of it, from what they took in the
 * atrium (docs/lab/dynamic.md). */
enum {
    LW_BUDGET_UNIT = 10,
    LW_BUDGET_SOLVE = LW_BUDGET_UNIT,
    LW_BUDGET_SHADOW = 5, /* direct light verified by new shadow rays */
    LW_BUDGET_TRACE = 10, /* bounce rays traced again */
    LW_BUDGET_READ = 1,   /* light read along the ray hits that there are */
};

/** Wall time that work takes, a running mean of each kind, ns; 0: not known yet. */
struct lw_budget_rates {
    double solve_ns, verify_ns;
};

/** The budget of a frame. Zeroed, it has no limit: the frame does all due work. */
struct lw_budget {
    /* Few packets must then do where all would be surer. */
    bool limited;
    /* Limited, and something has just begun to move: what follows comes before all else. */
    bool onset;
    /* An onset, and another layer has changed more: the frame verifies, and solves nothing. */
    bool yields;
    /* Work that fits, if a frame did nothing else. */
    uint64_t solve, verify;
};

/** Whether what follows from a movement comes at once, and not in turn. */
static inline bool lw_budget_is_at_once(const struct lw_budget *budget) {
    return !budget->limited || budget->onset;
}

static inline uint64_t lw_budget_whole(double work) {
    return work < 1 ? 1 : work < 1e18 ? (uint64_t)work : (uint64_t)1e18;
}

/** A budget of `units` units. units > 0 */
static inline struct lw_budget lw_budget_of_units(double units) {
    const uint64_t work = lw_budget_whole(units * LW_BUDGET_UNIT);
    return (struct lw_budget){.limited = true, .solve = work, .verify = work};
}

/** What a wall time gives by the rates so far. budget_s > 0 */
static inline struct lw_budget lw_budget_of_time(double budget_s, const struct lw_budget_rates *rates) {
    const double solve_ns = fmax(rates->solve_ns, 1.0 / LW_BUDGET_UNIT),
                 verify_ns = rates->verify_ns > 0 ? rates->verify_ns : solve_ns;
    return (struct lw_budget){.limited = true,
                              .solve = lw_budget_whole(budget_s * 1e9 / solve_ns),
                              .verify = lw_budget_whole(budget_s * 1e9 / verify_ns)};
}

/** Takes what some work took into a rate: a running mean over some 1/weight frames. */
static inline void lw_budget_note(double *rate_ns, uint64_t work, uint64_t took_ns, double weight) {
    if (!work) return;
    const double ns = (double)took_ns / (double)work;
    *rate_ns = *rate_ns > 0 ? *rate_ns + (ns - *rate_ns) * weight : ns;
}

#endif
