/* bench_meter.h: where the time of a frame goes, kernel by kernel, in the code that ships: a solver and its
 * publisher, as lightwelld has them, under a clock.
 * Threads: main() only.
 *
 * The linker puts it around the calls of the kernels and around OpenMP's parallel regions (ld --wrap; for
 * GCC's OpenMP). A region counts for the kernel that runs in it; time in no region is serial. */
#ifndef LW_TESTS_BENCH_METER_H
#define LW_TESTS_BENCH_METER_H

#include "common/trace/trace_replay.h"
#include "server/publish/publisher.h"

enum bench_kernel {
    BENCH_DIRECT,
    BENCH_TRACE_BOUNCES,
    BENCH_GATHER,
    BENCH_RADIATE,
    BENCH_FINISH,
    BENCH_DENOISE,
    BENCH_WELD,
    BENCH_GUTTERS,
    BENCH_LEVELS,
    BENCH_ENCODE,
    BENCH_KERNELS
};

extern const char *const bench_kernel_name[BENCH_KERNELS];

/** Time of a frame, in seconds. CPU time is the calling thread's: with one worker, all of it. */
struct bench_meter_cost {
    struct {
        double wall, cpu;
    } kernel[BENCH_KERNELS];
    double wall, cpu; /* the whole frame */
    double serial,
        serial_longest; /* part of cpu outside of parallel regions, in all and the longest stretch */
    double sampled[2];  /* part of cpu: BENCH_DIRECT and BENCH_TRACE_BOUNCES of every `stride`th tile */
    uint64_t rays[2];   /* the whole frame's rays, of the same two */
};

/** Every stride-th tile's calls of the two passes are timed apart or, with replays, recorded.
 * replay   [0]: direct, [1]: trace bounces. Each is an array, one for each thread; or {NULL, NULL} */
struct bench_meter_desc {
    uint32_t stride;
    struct lw_trace_replay **replay[2];
};

struct bench_meter {
    struct lw_solver *solver;
    struct lw_publisher *publisher;
    struct lw_solver_stats solved; /* in its last frame */
    uint64_t frames;
};

/** Where it fails, bench_meter_finish() frees the rest; give it a zeroed structure. */
LW_MUST_CHECK enum lw_status bench_meter_init(struct bench_meter *meter, const struct lw_solver_desc *desc,
                                              const struct lw_pose *pose, struct lw_error *err);
void bench_meter_finish(struct bench_meter *meter);

/** Solves a frame and publishes it. */
LW_MUST_CHECK enum lw_status bench_meter_frame(struct bench_meter *meter, const struct lw_pose *pose,
                                               const struct bench_meter_desc *desc,
                                               struct bench_meter_cost *out_cost, struct lw_error *err);

#endif
