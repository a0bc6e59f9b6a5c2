#include "server/solve/adapt/work.h"

#include "common/base/invariant.h"

#include <stdlib.h>

enum lw_status lw_work_init(struct lw_work *work, uint32_t items, int threads, const _Atomic bool *cancel) {
    *work = (struct lw_work){.threads = threads,
                             .cancel = cancel,
                             .items = items,
                             .reports = calloc(items + 1ul, sizeof *work->reports)};
    return work->reports ? LW_OK : LW_NO_MEMORY;
}

void lw_work_finish(struct lw_work *work) {
    free(work->reports);
    work->reports = NULL;
}

static void do_item(const struct lw_work *work, uint32_t item, struct lw_progress *progress, lw_work_fn *fn,
                    void *user) {
    work->reports[item] = (struct lw_work_report){0};
    fn(user, item, &work->reports[item]);
    if (progress) lw_progress_step(progress, 1);
}

static void add(struct lw_work_report *sum, const struct lw_work_report *report) {
    sum->rays.shadow += report->rays.shadow;
    sum->rays.bounce += report->rays.bounce;
    sum->texels += report->texels;
    sum->texels_left += report->texels_left;
    sum->tiles += report->tiles;
    sum->direct |= report->direct;
    sum->invalidated |= report->invalidated;
}

struct lw_work_report lw_work_run(const struct lw_work *work, uint32_t count, enum lw_work_kind kind,
                                  struct lw_progress *progress, lw_work_fn *fn, void *user) {
    struct lw_work_report sum = {0};
    LW_INVARIANT(count <= work->items && work->threads > 0);
    if (kind == LW_WORK_TILES) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(work->threads)
        for (uint32_t i = 0; i < count; i++)
            if (!work->cancel || !*work->cancel) do_item(work, i, progress, fn, user);
    } else {
#pragma omp parallel for schedule(static) num_threads(work->threads)
        for (uint32_t i = 0; i < count; i++) do_item(work, i, progress, fn, user);
    }
    for (uint32_t i = 0; i < count; i++) add(&sum, &work->reports[i]);
    return sum;
}
