/* crossover_run.h: measures all units of a row that are missing.
 * Flow:    crossover_row, crossover_plan -> [crossover_run: unit by unit, renderers interleaved] ->
 *          measure_store
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_RUN_H
#define LW_CLIENT_MEASURE_CROSSOVER_RUN_H

#include "client/measure/crossover_row.h"

/** Measures the missing units of an open row. A unit that fails is noted as such, and the next one begins.
 * Errors: LW_CLOSED if cancelled; LW_TIMED_OUT if time was up before all was measured; LW_IO and
 * LW_CANNOT_CREATE of disks; the first failure of a unit, after all others were measured. */
LW_MUST_CHECK enum lw_status lw_crossover_run(struct lw_crossover_row *row, struct lw_error *err);

#endif
