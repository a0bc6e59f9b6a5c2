#include "tests/bench/bench_meter.h"

#include "common/base/clock.h"
#include "common/tile/tile_codec.h"
#include "server/publish/levels.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/filter/denoise.h"
#include "server/solve/filter/seams.h"
#include "server/solve/solvers.h"
#include "server/solve/transport/bounces.h"
#include "server/solve/transport/direct_light.h"

#include <math.h>
#include <omp.h>
#include <stdatomic.h>

const char *const bench_kernel_name[BENCH_KERNELS] = {"direct", "trace bounces", "gather", "radiate",
                                                      "finish", "denoise",       "weld",   "gutters",
                                                      "levels", "encode"};

#define NONE BENCH_KERNELS

struct moment {
    uint64_t wall_ns, cpu_ns;
};

/* One frame is under way at a time. */
static struct {
    struct bench_meter_desc desc;
    struct bench_meter_cost frame;
    struct moment began;
    uint64_t serial_since_ns; /* CPU time at which the last region ended */
    int outer;                /* the kernel whose call holds regions of its own */
    _Atomic int inner;        /* the one that runs in the region under way */
    _Atomic uint64_t sampled_ns[2], rays[2];
} clocks;

static struct moment now(void) { return (struct moment){lw_clock_ns(), lw_clock_thread_cpu_ns()}; }

static void add(int kernel, struct moment began, struct moment ended) {
    if (kernel == NONE) return;
    clocks.frame.kernel[kernel].wall += 1e-9 * (double)(ended.wall_ns - began.wall_ns);
    clocks.frame.kernel[kernel].cpu += 1e-9 * (double)(ended.cpu_ns - began.cpu_ns);
}

static void end_serial(uint64_t cpu_ns) {
    const double stretch = 1e-9 * (double)(cpu_ns - clocks.serial_since_ns);
    clocks.frame.serial += stretch;
    clocks.frame.serial_longest = fmax(clocks.frame.serial_longest, stretch);
}

static void begin(const struct bench_meter_desc *desc) {
    clocks.desc = *desc;
    clocks.frame = (struct bench_meter_cost){0};
    clocks.outer = NONE;
    for (int k = 0; k < 2; k++) clocks.sampled_ns[k] = clocks.rays[k] = 0;
    clocks.began = now();
    clocks.serial_since_ns = clocks.began.cpu_ns;
}

static void end(struct bench_meter_cost *out_frame) {
    const struct moment ended = now();
    end_serial(ended.cpu_ns);
    clocks.frame.wall = 1e-9 * (double)(ended.wall_ns - clocks.began.wall_ns);
    clocks.frame.cpu = 1e-9 * (double)(ended.cpu_ns - clocks.began.cpu_ns);
    for (int k = 0; k < 2; k++) {
        clocks.frame.sampled[k] = 1e-9 * (double)clocks.sampled_ns[k];
        clocks.frame.rays[k] = clocks.rays[k];
    }
    *out_frame = clocks.frame;
}

/* ---- OpenMP ---- */

void __real_GOMP_parallel(void (*body)(void *), void *data, unsigned threads, unsigned flags);
void __wrap_GOMP_parallel(void (*body)(void *), void *data, unsigned threads, unsigned flags);

void __wrap_GOMP_parallel(void (*body)(void *), void *data, unsigned threads, unsigned flags) {
    const struct moment began = now();
    end_serial(began.cpu_ns);
    clocks.inner = NONE;
    __real_GOMP_parallel(body, data, threads, flags);
    const struct moment ended = now();
    if (clocks.outer == NONE) add(clocks.inner, began, ended);
    clocks.serial_since_ns = ended.cpu_ns;
}

/* ---- kernels that run on one tile or object, inside a region ---- */

static bool sampled(const struct lw_solve_tile *tile) { return tile->id.v % clocks.desc.stride == 0; }

static void begin_tile(int pass, const struct lw_solve_tile *tile, uint64_t *began_ns) {
    clocks.inner = pass;
    if (!sampled(tile)) return;
    if (clocks.desc.replay[pass]) lw_trace_replay_record(clocks.desc.replay[pass][omp_get_thread_num()]);
    *began_ns = lw_clock_thread_cpu_ns();
}

static void end_tile(int pass, const struct lw_solve_tile *tile, uint64_t began_ns, uint64_t rays) {
    clocks.rays[pass] += rays;
    if (!sampled(tile)) return;
    clocks.sampled_ns[pass] += lw_clock_thread_cpu_ns() - began_ns;
    lw_trace_replay_record(NULL);
}

/* The linker turns calls from other files into __wrap_, and __real_ into the function itself. */
#define WRAP(type, name, parameters)                                                                         \
    type __real_##name parameters;                                                                           \
    type __wrap_##name parameters;                                                                           \
    _Static_assert(__builtin_types_compatible_p(__typeof__(name), __typeof__(__wrap_##name)),                \
                   "the parameters of " #name " have changed");
#define NOTE(kernel, type, name, parameters, arguments)                                                      \
    WRAP(type, name, parameters)                                                                             \
    type __wrap_##name parameters {                                                                          \
        clocks.inner = kernel;                                                                               \
        __real_##name arguments;                                                                             \
    }

WRAP(void, lw_direct_light_solve,
     (const struct lw_transport *p, struct lw_solve_tile *tile, struct lw_ray_count *count))
void __wrap_lw_direct_light_solve(const struct lw_transport *p, struct lw_solve_tile *tile,
                                  struct lw_ray_count *count) {
    uint64_t began_ns = 0;
    begin_tile(BENCH_DIRECT, tile, &began_ns);
    __real_lw_direct_light_solve(p, tile, count);
    end_tile(BENCH_DIRECT, tile, began_ns, count->shadow);
}

WRAP(void, lw_bounces_trace,
     (const struct lw_transport *p, const struct lw_solve_tile *tile, struct lw_ray_count *count))
void __wrap_lw_bounces_trace(const struct lw_transport *p, const struct lw_solve_tile *tile,
                             struct lw_ray_count *count) {
    uint64_t began_ns = 0;
    begin_tile(BENCH_TRACE_BOUNCES, tile, &began_ns);
    __real_lw_bounces_trace(p, tile, count);
    end_tile(BENCH_TRACE_BOUNCES, tile, began_ns, count->bounce);
}

NOTE(BENCH_GATHER, void, lw_bounces_gather,
     (const struct lw_transport *p, const struct lw_solve_tile *tile, uint32_t bounce), (p, tile, bounce))
NOTE(BENCH_RADIATE, void, lw_bounces_radiate,
     (const struct lw_transport *p, const struct lw_solve_tile *tile, uint32_t bounce), (p, tile, bounce))
NOTE(BENCH_FINISH, void, lw_estimates_finish_tile, (const struct lw_transport *p, struct lw_solve_tile *tile),
     (p, tile))
NOTE(BENCH_LEVELS, void, lw_levels_build, (struct lw_levels * levels), (levels))
NOTE(BENCH_ENCODE, void, lw_levels_store_tile,
     (const struct lw_levels *levels, const struct lw_tile_place *place, float *rgb, uint8_t *covered),
     (levels, place, rgb, covered))

/* ---- kernels that hold regions ---- */

#define HOLD(kernel, name, parameters, arguments)                                                            \
    WRAP(void, name, parameters)                                                                             \
    void __wrap_##name parameters {                                                                          \
        const struct moment began = now();                                                                   \
        clocks.outer = kernel;                                                                               \
        __real_##name arguments;                                                                             \
        clocks.outer = NONE;                                                                                 \
        add(kernel, began, now());                                                                           \
    }

HOLD(BENCH_DENOISE, lw_denoise_run,
     (struct lw_denoise * denoise, uint64_t frame, uint32_t channels, int threads),
     (denoise, frame, channels, threads))
HOLD(BENCH_WELD, lw_seams_weld,
     (const struct lw_seams *seams, struct lw_seams_welds *welds, uint32_t channels, struct lw_tiles *tiles,
      uint64_t frame, int threads),
     (seams, welds, channels, tiles, frame, threads))
HOLD(BENCH_GUTTERS, lw_seam_gutters_fill,
     (const struct lw_seam_gutters *gutters, struct lw_tiles *tiles, uint64_t frame, uint32_t channels,
      int threads),
     (gutters, tiles, frame, channels, threads))

/* ---- a solver and its publisher ---- */

enum lw_status bench_meter_init(struct bench_meter *meter, const struct lw_solver_desc *desc,
                                const struct lw_pose *pose, struct lw_error *err) {
    enum lw_status status = lw_solvers_create(NULL, desc, pose, &meter->solver, err);
    if (status != LW_OK) return status;
    status = lw_publisher_create(&(struct lw_publisher_desc){.scene = desc->scene,
                                                             .atlas_map = desc->atlas_map,
                                                             .solver = meter->solver,
                                                             .target_error = 0.02f,
                                                             .noise_shown = LW_SOLVER_NOISE_SHOWN,
                                                             .codec = LW_TILE_CODEC_DCT,
                                                             .threads = desc->threads},
                                 &meter->publisher);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "publisher");
}

void bench_meter_finish(struct bench_meter *meter) {
    lw_publisher_destroy(meter->publisher);
    if (meter->solver) meter->solver->ops->destroy(meter->solver);
}

enum lw_status bench_meter_frame(struct bench_meter *meter, const struct lw_pose *pose,
                                 const struct bench_meter_desc *desc, struct bench_meter_cost *out_cost,
                                 struct lw_error *err) {
    struct lw_publisher_stats published;
    struct lw_snapshot *snapshot = NULL;
    begin(desc);
    enum lw_status status =
        meter->solver->ops->frame(meter->solver, pose, ++meter->frames, &meter->solved, err);
    if (status == LW_OK)
        status = lw_publisher_publish(meter->publisher, pose, meter->frames, 0, 0, meter->solved.tiles_solved,
                                      &snapshot, &published);
    end(out_cost);
    lw_snapshot_unref(snapshot);
    return status;
}
