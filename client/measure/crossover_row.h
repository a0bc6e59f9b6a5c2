/* crossover_row.h: a row of the crossover: its scene, views, references and what the store notes of them.
 * Flow:    options -> [crossover_row: scene, references] -> crossover_plan, crossover_unit
 * Threads: main() only.
 *
 * Frames last 1/30 s of scene time on both sides, however fast the machine is. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_ROW_H
#define LW_CLIENT_MEASURE_CROSSOVER_ROW_H

#include "client/measure/crossover_options.h"
#include "client/measure/crossover_references.h"
#include "client/measure/sides/fixed_views.h"
#include "client/measure/sides/scene_densities.h"

struct lw_crossover_row {
    const struct lw_crossover_options *options;
    const _Atomic bool *cancel;
    uint64_t began_ns; /* of lw_clock_ns() */
    struct lw_crossover_store store;
    struct lw_scene_densities densities;
    char content[33]; /* the hash of its first package, in hexadecimal digits */
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

/** Notes a value in the store. Errors: lw_crossover_store_set()'s. */
LW_MUST_CHECK enum lw_status lw_crossover_row_note(struct lw_crossover_row *row, struct lw_error *err,
                                                   const char *key, const char *format, ...) LW_PRINTF(4, 5);

/** Where a view's camera is. context: the row's views. */
struct lw_camera_view lw_crossover_row_camera(const void *context, uint32_t user, uint64_t frame);

/** What both sides are made of, pictures whole. */
struct lw_renderer_desc lw_crossover_row_side(struct lw_crossover_row *row);

#endif
