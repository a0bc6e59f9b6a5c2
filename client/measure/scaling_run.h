/* scaling_run.h: one sequence of frames of a side: its cost and its error.
 * Threads: main() only. For scaling_*.c alone. */
#ifndef LW_CLIENT_MEASURE_SCALING_RUN_H
#define LW_CLIENT_MEASURE_SCALING_RUN_H

#include "client/measure/scaling_measure.h"
#include "common/progress.h"

struct lw_scaling_run {
    struct lw_scaling *x;
    const _Atomic bool *cancel;
};

/** Whether a signal asked to stop. Loops then end early with LW_OK, and their results are not there. */
bool lw_scaling_run_stopped(const struct lw_scaling_run *run);

/** Ends the progress of a part that is done, was stopped or failed. */
void lw_scaling_run_end(const struct lw_scaling_run *run, enum lw_status status,
                        struct lw_progress *progress);

/** Index of the picture that is compared with the reference in this frame; -1: none is. */
int lw_scaling_run_picture(const struct lw_scaling *x, uint64_t frame);

/** Judges the pictures of `shown` in a picture's frame. Users that are no eyes have no reference and are
 * left out; so are dark views.
 * *errors: written where they are judged. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scaling_run_judge(const struct lw_scaling *x,
                                                  const struct lw_renderer *renderer, uint32_t picture,
                                                  const uint32_t *shown, uint32_t shown_count,
                                                  struct lw_scaling_errors *errors, struct lw_error *err);

/** The share that one of `users` users pays. */
struct lw_cost lw_scaling_run_of_one(const struct lw_cost *cost, double users);

/** Steps through the frames once with all eyes.
 * out_cost  per frame, for one user. NULL: pictures only, as cheaply as the side can
 * Errors    the side's */
LW_MUST_CHECK enum lw_status lw_scaling_run_sequence(struct lw_scaling_run *run, struct lw_renderer *renderer,
                                                     const struct lw_setting *setting, uint32_t seed,
                                                     struct lw_cost *out_cost,
                                                     struct lw_scaling_errors *out_errors,
                                                     struct lw_error *err);

/** CPU seconds of each eye's path tracer for a frame.
 * picture   the index of the picture whose frame is traced; where pictures build on each other all are
 *           traced
 * Errors    the side's */
LW_MUST_CHECK enum lw_status lw_scaling_run_trace(struct lw_scaling_run *run, struct lw_renderer *renderer,
                                                  const struct lw_setting *setting, uint32_t picture,
                                                  uint32_t seed, double out_per_eye_s[LW_SCALING_EYES],
                                                  struct lw_error *err);

#endif
