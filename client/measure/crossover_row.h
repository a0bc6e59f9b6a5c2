/* crossover_row.h: a row of the crossover: its scene, views, references and what the store notes of them.
 * Flow:    options -> [crossover_row: scene, references] -> crossover_plan, crossover_unit
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_ROW_H
#define LW_CLIENT_MEASURE_CROSSOVER_ROW_H

#include "client/measure/crossover_options.h"
#include "client/measure/crossover_references.h"
#include "client/measure/measure_row.h"
#include "client/measure/sides/fixed_views.h"

struct lw_crossover_row {
    struct lw_measure_row base;
    const struct lw_crossover_options *options;
    struct lw_fixed_views views;
    struct lw_crossover_references references;
    uint32_t judged[LW_CROSSOVER_JUDGED_MAX], judged_count;
    uint32_t window; /* the first frame whose cost counts */
};

/** Opens the scene and what an earlier run has left, and traces missing references. Finish it in any case.
 * command: noted in the row.
 * Errors: LW_USAGE where the folder holds another row, naming what differs: an option, the scene's content,
 * the version; LW_CLOSED if cancelled; those of opening and of disks. */
LW_MUST_CHECK enum lw_status lw_crossover_row_open(struct lw_crossover_row *row,
                                                   const struct lw_crossover_options *options,
                                                   const char *command, const _Atomic bool *cancel,
                                                   struct lw_error *err);
/** A row that failed to open is fine. */
void lw_crossover_row_finish(struct lw_crossover_row *row);

/** Camera of a view. context: the row's views. */
struct lw_camera_view lw_crossover_row_camera(const void *context, uint32_t user, uint64_t frame);

/** Describes both sides, with a user for each view. */
struct lw_renderer_desc lw_crossover_row_side(struct lw_crossover_row *row);

#endif
