/* scaling_measure.h: the measurement behind lightwell-load scaling.
 * Flow:    options -> scene, views, references -> [both sides: try settings, choose the cheapest, add
 *          users] -> figures
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_SCALING_MEASURE_H
#define LW_CLIENT_MEASURE_SCALING_MEASURE_H

#include "client/measure/scaling.h"

/** Measures, or goes on with the folder's tables. After an interruption or an error, earlier figures stay
 * readable. Progress goes to stderr.
 * command  noted for the report
 * cancel   becomes true when a signal asks to stop
 * Errors   those of the row, of its scene and of both sides; LW_BAD_DATA for a motion that the scene does not
 *          allow. Interruption is no error */
LW_MUST_CHECK enum lw_status lw_scaling_measure(const struct lw_scaling_options *options, const char *command,
                                                const _Atomic bool *cancel, struct lw_scaling *out_scaling,
                                                struct lw_error *err);
void lw_scaling_finish(struct lw_scaling *scaling);

#endif
