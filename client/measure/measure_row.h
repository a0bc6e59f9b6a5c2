/* measure_row.h: the options of a run, its folder of tables, its scene.
 * Flow:    options -> [measure_row: store, scene] -> crossover_row, scaling_measure
 * Threads: main() only.
 *
 * Frames last 1/30 s of scene time on both sides, however fast the machine is. The folder notes all that
 * figures depend on. A later run that differs in one of these is refused. The same run goes on. */
#ifndef LW_CLIENT_MEASURE_MEASURE_ROW_H
#define LW_CLIENT_MEASURE_MEASURE_ROW_H

#include "client/measure/measure_options.h"
#include "client/measure/measure_store.h"
#include "client/measure/sides/scene_densities.h"

struct lw_measure_row {
    const struct lw_measure_options *options;
    const _Atomic bool *cancel;
    uint64_t began_ns; /* by lw_clock_ns() */
    struct lw_measure_store store;
    struct lw_scene_densities densities;
    char content[33]; /* the hash of its first package, in hexadecimal digits */
};

/** Makes the folder or goes on in it, and binds the options. Finish the row in any case. All arguments
 * outlive it.
 * Errors: as lw_measure_row_bind(); the store's. */
LW_MUST_CHECK enum lw_status lw_measure_row_open(struct lw_measure_row *row,
                                                 const struct lw_measure_options *options,
                                                 const _Atomic bool *cancel, struct lw_error *err);
/** Opens the scene, sets it moving, binds its content, and notes what it is and where this runs.
 * command: noted, too. Errors: those of lw_scene_densities_init() and lw_measure_row_bind(). */
LW_MUST_CHECK enum lw_status lw_measure_row_open_scene(struct lw_measure_row *row, const char *command,
                                                       struct lw_error *err);
/** A row that failed to open is fine. */
void lw_measure_row_finish(struct lw_measure_row *row);

/** Notes a property that all runs in this folder share.
 * Errors: LW_USAGE where the folder has another row, or figures without a row; those of
 * lw_measure_store_set(). */
LW_MUST_CHECK enum lw_status lw_measure_row_bind(struct lw_measure_row *row, struct lw_error *err,
                                                 const char *key, const char *format, ...) LW_PRINTF(4, 5);
/** Notes a value. Errors: lw_measure_store_set()'s. */
LW_MUST_CHECK enum lw_status lw_measure_row_note(struct lw_measure_row *row, struct lw_error *err,
                                                 const char *key, const char *format, ...) LW_PRINTF(4, 5);

/** Describes both sides, with filtered lightmaps and a lattice of all pixels. */
struct lw_renderer_desc lw_measure_row_side(struct lw_measure_row *row,
                                            const struct lw_renderer_cameras *cameras);

/** LW_CLOSED once the run is cancelled. */
LW_MUST_CHECK enum lw_status lw_measure_row_check(const struct lw_measure_row *row, struct lw_error *err);

#endif
