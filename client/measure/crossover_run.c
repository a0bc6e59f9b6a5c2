#include "client/measure/crossover_run.h"

#include "client/measure/crossover_clock.h"
#include "client/measure/crossover_unit.h"
#include "common/base/clock.h"
#include "common/base/log.h"

#include <math.h>

struct run {
    struct lw_crossover_row *row;
    uint64_t end_ns; /* by lw_clock_ns(): no unit begins later; UINT64_MAX: no limit */
    uint32_t units_missing;
};

/* A disk that takes no more and a user who asks to stop end the run; a renderer that fails does not. */
static bool ends_run(const struct lw_crossover_row *row, enum lw_status status) {
    return *row->base.cancel || status == LW_IO || status == LW_CANNOT_CREATE;
}

static enum lw_status measure_unit(struct run *run, const struct lw_crossover_plan *plan,
                                   struct lw_error *first_failure, struct lw_error *err) {
    struct lw_crossover_row *row = run->row;
    struct lw_error own = {0};
    if (lw_measure_store_has(&row->base.store, &plan->unit)) return LW_OK;
    if (lw_clock_ns() >= run->end_ns) {
        run->units_missing++;
        return LW_OK;
    }
    enum lw_status status = lw_crossover_unit_measure(row, plan, &own);
    if (status == LW_OK) return lw_measure_store_fail(&row->base.store, &plan->unit, NULL, err);
    run->units_missing++;
    if (ends_run(row, status)) {
        *err = own;
        return status;
    }
    lw_log(LW_LOG_WARNING, "repeat %u, %s, %s: not measured: %s", plan->unit.repeat + 1, plan->unit.renderer,
           plan->unit.setting, own.text);
    status = lw_measure_store_fail(&row->base.store, &plan->unit, own.text, err);
    if (first_failure->status == LW_OK) *first_failure = own;
    return status;
}

/* Once for all repeats. */
static enum lw_status leave_out(struct lw_crossover_row *row, const struct lw_crossover_plan *plan,
                                struct lw_error *err) {
    const char *before = lw_measure_store_get(&row->base.store, "samples left out");
    if (before && lw_measure_store_lists(before, plan->unit.setting)) return LW_OK;
    lw_log(LW_LOG_INFO, "cache, %s: left out: such samples gained under %.0f %% at a lower density",
           plan->unit.setting, 100 * (1 - LW_CROSSOVER_GAIN_MIN));
    return lw_measure_row_note(&row->base, err, "samples left out", "%s%s%s", before ? before : "",
                               before && *before ? "; " : "", plan->unit.setting);
}

static enum lw_status measure_units(struct run *run, struct lw_error *err) {
    struct lw_crossover_row *row = run->row;
    struct lw_crossover_plan plan[LW_CROSSOVER_PLANS_MAX];
    struct lw_error first_failure = {0};
    uint32_t count;
    enum lw_status status = lw_crossover_plan_all(row, plan, &count, err);
    if (status != LW_OK) return status;
    for (uint32_t repeat = 0; status == LW_OK && repeat < row->options->base.repeats; repeat++)
        for (uint32_t i = 0; status == LW_OK && i < count; i++) {
            /* to and fro, so that no renderer comes always first after a pause */
            struct lw_crossover_plan next = plan[repeat % 2 ? count - 1 - i : i];
            if (lw_crossover_plan_is_idle(row, plan, count, &next)) {
                status = leave_out(row, &next, err);
                continue;
            }
            next.unit.repeat = repeat;
            status = measure_unit(run, &next, &first_failure, err);
        }
    if (status != LW_OK) return status;
    if (first_failure.status != LW_OK) {
        *err = first_failure;
        return first_failure.status;
    }
    if (run->units_missing)
        return lw_status_fail(err, LW_TIMED_OUT,
                              "time is up: %u measurements are missing; the same command goes on with them",
                              run->units_missing);
    return LW_OK;
}

enum lw_status lw_crossover_run(struct lw_crossover_row *row, struct lw_error *err) {
    struct run run = {.row = row, .end_ns = UINT64_MAX};
    const double minutes_max = row->options->minutes_max;
    if (isfinite(minutes_max)) run.end_ns = row->base.began_ns + (uint64_t)(60e9 * minutes_max);
    const enum lw_status status = measure_units(&run, err);
    return status == LW_OK && row->options->real_clock ? lw_crossover_clock_measure(row, err) : status;
}
