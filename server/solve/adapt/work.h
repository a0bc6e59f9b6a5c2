/* work.h: runs a function over a list of items in parallel, and sums what it reports.
 * Flow:    list of a plan -> [work: a function for each tile] -> counts and costs -> next plan
 * Threads: [solver] calls; the function is called by [any worker], once for each item.
 *
 * Reports are summed in the order of the list: the same sums at any thread count. */
#ifndef LW_ADAPT_WORK_H
#define LW_ADAPT_WORK_H

#include "common/base/progress.h"
#include "server/solve/transport/transport.h"

/* What work on an item reports. */
struct lw_work_report {
    struct lw_ray_count rays;
    uint64_t texels;
    double texels_left;
    uint32_t tiles;
    bool direct, invalidated;
};

typedef void lw_work_fn(void *user, uint32_t item, struct lw_work_report *report);

struct lw_work {
    int threads;
    const _Atomic bool *cancel; /* may be NULL; once true, tiles are left out */
    struct lw_work_report *reports;
    uint32_t items; /* a list's, at most */
};

enum lw_work_kind {
    LW_WORK_TILES, /* items differ in cost: a worker takes one at a time */
    LW_WORK_CHEAP, /* they hardly do, and cost little: each worker takes its share of the list */
};

/** Errors: LW_NO_MEMORY; finish it then. items: in a list at most. */
LW_MUST_CHECK enum lw_status lw_work_init(struct lw_work *work, uint32_t items, int threads,
                                          const _Atomic bool *cancel);
/** A zeroed one is fine. */
void lw_work_finish(struct lw_work *work);

/** Calls fn for the items from 0 to before count. progress: NULL, or steps once for each. */
struct lw_work_report lw_work_run(const struct lw_work *work, uint32_t count, enum lw_work_kind kind,
                                  struct lw_progress *progress, lw_work_fn *fn, void *user);

#endif
