/* plan_log.h: plans of a solver as text, with all that they were made of, so that they can be made again.
 * Flow:    inputs and plans of frames -> [write] -> file -> [read] -> the same inputs -> plan.h
 * Threads: a log belongs to one thread.
 *
 * A line is an event. Facts are written when they differ from those written last; floats as hexadecimal.
 *
 *   lightwell plan log 1 TILES IDS
 *   frame NUMBER
 *   move | resume | review          (lw_plan_note_move(), lw_plan_resume(), lw_plan_review())
 *   fact SLOT ...                   a tile, as struct lw_plan_fact has it
 *   verify|light|show ...           the input of a stage; behind it the plan:
 *   plan REASON ID[/]...            entries of a list that follow each other for one reason; /: in part
 *   found DIRECT INVALIDATED COUNT  what verification has found
 */
#ifndef LW_ADAPT_PLAN_LOG_H
#define LW_ADAPT_PLAN_LOG_H

#include "server/solve/adapt/plan.h"

#include <stdio.h>

struct lw_plan_log;

enum lw_plan_stage { LW_PLAN_STAGE_VERIFY, LW_PLAN_STAGE_LIGHT, LW_PLAN_STAGE_SHOW };

/** Begins a file. Errors: LW_CANNOT_CREATE, naming it; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_plan_log_create(const char *path, uint32_t tiles, uint32_t ids,
                                                struct lw_plan_log **out_log, struct lw_error *err);
/** NULL is fine, here and below: nothing is written. */
void lw_plan_log_destroy(struct lw_plan_log *log);

void lw_plan_log_frame(struct lw_plan_log *log, uint64_t number);
/** name: "move", "resume" or "review". */
void lw_plan_log_event(struct lw_plan_log *log, const char *name);
/** After a stage was planned. A file that cannot be written to any more is left as it is, with one warning.
 * */
void lw_plan_log_stage(struct lw_plan_log *log, enum lw_plan_stage stage, const struct lw_plan_input *in,
                       const struct lw_plan *plan);
void lw_plan_log_found(struct lw_plan_log *log, const struct lw_plan_found *found);

/** Reads a log, makes each plan again, and compares. `report`, unless NULL, gets each frame's plan, a line
 * a list; frame `only` alone with all entries, if it is not 0.
 * Errors: LW_NO_INPUT; LW_BAD_DATA, naming file and line: no log, or a plan that is another. */
LW_MUST_CHECK enum lw_status lw_plan_log_replay(const char *path, FILE *report, uint64_t only,
                                                uint64_t *out_plans, struct lw_error *err);

#endif
