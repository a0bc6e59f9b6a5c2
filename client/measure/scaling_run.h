/* scaling_run.h: one sequence of frames of a side: its cost and its error.
 * Flow:    setting, repeat -> [scaling_run: the tables, or frames] -> cost, errors; into the tables
 * Threads: main() only. For scaling_*.c alone.
 *
 * A sequence is a unit of measure_store.h. Units in the tables are read, not measured again. Random numbers
 * follow from the repeat: 0 is the search's, the repeats of costs begin with 1. */
#ifndef LW_CLIENT_MEASURE_SCALING_RUN_H
#define LW_CLIENT_MEASURE_SCALING_RUN_H

#include "client/measure/report.h"
#include "client/measure/scaling.h"

/** Contents of a unit. */
struct lw_scaling_record {
    struct lw_scaling_errors errors;
    struct lw_measure_expense line[LW_SCALING_COUNTS_MAX]; /* the last one ends the unit */
    uint32_t line_count;
};

struct lw_measure_unit lw_scaling_run_unit(const struct lw_scaling *x, const struct lw_scaling_side *side,
                                           const struct lw_setting *setting, uint32_t repeat);

/** Reads a unit from the tables; false: it is not there. */
bool lw_scaling_run_load(const struct lw_scaling *x, const struct lw_measure_unit *unit,
                         struct lw_scaling_record *out_record);

/** Adds a line: the cost of a frame with these users. view: as in struct lw_measure_expense. */
struct lw_measure_expense *lw_scaling_run_enter(struct lw_scaling_record *record,
                                                const struct lw_measure_unit *unit, uint32_t users,
                                                uint32_t view, const struct lw_cost *cost);

/** Writes a unit to the tables. Errors: lw_measure_store_append()'s. */
LW_MUST_CHECK enum lw_status lw_scaling_run_save(struct lw_scaling *x, struct lw_scaling_record *record,
                                                 struct lw_error *err);

/** Describes a setting of a side for people: "2 paths per pixel". */
struct lw_report_words lw_scaling_run_describe(const struct lw_scaling_side *side,
                                               const struct lw_setting *setting);

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
 * Errors    the side's; LW_CLOSED if cancelled */
LW_MUST_CHECK enum lw_status lw_scaling_run_sequence(struct lw_scaling *x, const struct lw_scaling_side *side,
                                                     const struct lw_setting *setting, uint32_t repeat,
                                                     struct lw_cost *out_cost,
                                                     struct lw_scaling_errors *out_errors,
                                                     struct lw_error *err);

/** CPU seconds of each eye's path tracer for the frame of a picture. Repeats take the pictures in turn. Where
 * pictures build on each other, all frames are traced.
 * Errors  as lw_scaling_run_sequence() */
LW_MUST_CHECK enum lw_status lw_scaling_run_trace(struct lw_scaling *x, const struct lw_scaling_side *side,
                                                  const struct lw_setting *setting, uint32_t repeat,
                                                  double out_per_eye_s[LW_SCALING_EYES],
                                                  struct lw_error *err);

#endif
