/* bench_runner.h: a solver and its publisher, as lightwelld has them, frame by frame under the meter.
 * Threads: main() only. */
#ifndef LW_TESTS_BENCH_RUNNER_H
#define LW_TESTS_BENCH_RUNNER_H

#include "server/publish/publisher.h"
#include "tests/bench/bench_meter.h"

struct bench_runner {
    struct lw_solver *solver;
    struct lw_publisher *publisher;
    struct lw_solver_stats solved; /* in its last frame */
    uint64_t frames;
};

/** Where it fails, bench_runner_finish() finishes what is there; give it a zeroed structure. */
LW_MUST_CHECK enum lw_status bench_runner_init(struct bench_runner *runner, const struct lw_solver_desc *desc,
                                               const struct lw_pose *pose, struct lw_error *err);
void bench_runner_finish(struct bench_runner *runner);

/** Solves a frame and publishes it. */
LW_MUST_CHECK enum lw_status bench_runner_frame(struct bench_runner *runner, const struct lw_pose *pose,
                                                const struct bench_meter_desc *meter,
                                                struct bench_meter_frame *out_cost, struct lw_error *err);

#endif
