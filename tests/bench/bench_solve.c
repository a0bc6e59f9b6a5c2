/* bench_solve: what the kernels of a frame cost, and how far the ray passes are from the bare tracer. Two
 * tables in Markdown.
 *
 *     bench_solve [--rounds N] [--texels-per-metre D] SCENE...
 *
 * Two solvers light the same frames as lightwelld does by default, denoised and published: one with one
 * worker, one with all (--threads). They draw the same rays. A round is two frames:
 *   first   all workers note their packets (common/trace/trace_replay.h), untimed. One worker solves the
 *           frame, timed. The packets go through bare rtcIntersect16 and rtcOccluded16, with the same
 *           filters, timed
 *   second  both solve a frame, timed: the speed-up
 * Where packets are too many, those of every n-th tile stand for all; their time is then that of the same
 * tiles. Rates and shares are CPU time with one worker; speed-ups are wall time and want an idle machine.
 * Medians over the rounds, ratios within a round. What the columns mean: CONTRIBUTING.md, "Measuring". */
#include "tests/bench/bench_meter.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>

#define ROUNDS_MAX  99
#define WARM_UP     2u     /* frames: the first one is lit everywhere, and allocates */
#define PACKETS_MAX 40000u /* packets of each pass, noted per round: 60 MB */
#define THREADS_MAX 64u

struct settings {
    struct lw_scene_open open;
    int64_t rounds, bounces, direct_samples, indirect_samples;
};

struct round {
    struct bench_meter_cost one, all; /* the second frame's */
    double raw_s[2], sampled_s[2];    /* the first frame's: bare rays, and the pass that shot them */
    double pass_s[2], scatter_s;      /* the whole first frame's */
    double lanes[2], raw_rate[2];     /* lanes in 16; rays per second */
    uint64_t rays[2];
};

struct job {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct bench_meter one, all;
    unsigned threads;
    uint32_t stride;
    struct lw_trace_replay *replay[2][THREADS_MAX];
    struct round round[ROUNDS_MAX];
};

static enum lw_status start(const struct job *job, unsigned threads, struct bench_meter *out,
                            struct lw_error *err) {
    const struct settings *s = job->settings;
    return bench_meter_init(out,
                            &(struct lw_solver_desc){.scene = job->scene,
                                                     .atlas_map = &job->map,
                                                     .bounces = (uint32_t)s->bounces,
                                                     .direct_samples = (uint32_t)s->direct_samples,
                                                     .indirect_samples = (uint32_t)s->indirect_samples,
                                                     .target_error = -1,
                                                     .threads = threads,
                                                     .denoise = true},
                            &job->pose, err);
}

static enum lw_status first_frame(struct job *job, struct round *round, struct lw_error *err) {
    struct bench_meter_desc timed = {.stride = job->stride}, noted = timed;
    struct bench_meter_cost ignored, one;
    for (int k = 0; k < 2; k++) {
        noted.replay[k] = job->replay[k];
        for (unsigned t = 0; t < job->threads; t++) lw_trace_replay_clear(job->replay[k][t]);
    }
    enum lw_status status = bench_meter_frame(&job->all, &job->pose, &noted, &ignored, err);
    if (status == LW_OK) status = bench_meter_frame(&job->one, &job->pose, &timed, &one, err);
    if (status != LW_OK) return status;
    for (int k = 0; k < 2; k++) {
        struct lw_trace_replay_cost cost = {0};
        for (unsigned t = 0; t < job->threads; t++) lw_trace_replay_run(job->replay[k][t], &cost);
        round->raw_s[k] = 1e-9 * (double)cost.cpu_ns;
        round->sampled_s[k] = one.sampled[k];
        round->pass_s[k] = one.kernel[k].cpu;
        round->lanes[k] = (double)cost.rays / (double)cost.packets;
        round->raw_rate[k] = (double)cost.rays / round->raw_s[k];
    }
    round->scatter_s =
        one.kernel[BENCH_TRACE_BOUNCES].cpu + one.kernel[BENCH_GATHER].cpu + one.kernel[BENCH_RADIATE].cpu;
    return LW_OK;
}

static enum lw_status second_frame(struct job *job, struct round *round, struct lw_error *err) {
    const struct bench_meter_desc plain = {.stride = UINT32_MAX};
    enum lw_status status = bench_meter_frame(&job->all, &job->pose, &plain, &round->all, err);
    if (status == LW_OK) status = bench_meter_frame(&job->one, &job->pose, &plain, &round->one, err);
    for (int k = 0; k < 2; k++) round->rays[k] = round->one.rays[k];
    return status;
}

/* ---- what a row shows of a round ---- */

static double direct_over_raw(const struct round *r) { return r->raw_s[0] / r->sampled_s[0]; }
static double ends_over_raw(const struct round *r) { return r->raw_s[1] / r->sampled_s[1]; }
static double scatter_over_raw(const struct round *r) {
    return ends_over_raw(r) * r->pass_s[1] / r->scatter_s;
}
static double direct_lanes(const struct round *r) { return r->lanes[0]; }
static double scatter_lanes(const struct round *r) { return r->lanes[1]; }
static double direct_raw_rate(const struct round *r) { return 1e-6 * r->raw_rate[0]; }
static double scatter_raw_rate(const struct round *r) { return 1e-6 * r->raw_rate[1]; }
static double one_ms(const struct round *r) { return 1e3 * r->one.cpu; }
static double all_ms(const struct round *r) { return 1e3 * r->all.wall; }
static double speed_up(const struct round *r) { return r->one.wall / r->all.wall; }
static double serial(const struct round *r) { return 100 * r->all.serial / r->all.cpu; }
static double serial_longest(const struct round *r) { return 100 * r->all.serial_longest / r->all.cpu; }

static double median_of(const struct job *job, double (*value)(const struct round *)) {
    double values[ROUNDS_MAX];
    for (int64_t i = 0; i < job->settings->rounds; i++) values[i] = value(&job->round[i]);
    return bench_median(values, (size_t)job->settings->rounds);
}

static double median_of_kernel(const struct job *job, int kernel,
                               double (*value)(const struct round *, int kernel)) {
    double values[ROUNDS_MAX];
    for (int64_t i = 0; i < job->settings->rounds; i++) values[i] = value(&job->round[i], kernel);
    return bench_median(values, (size_t)job->settings->rounds);
}

static double kernel_s(const struct round *r, int kernel) { return r->one.kernel[kernel].cpu; }
static double kernel_share(const struct round *r, int kernel) {
    return 100 * r->one.kernel[kernel].cpu / r->one.cpu;
}
static double kernel_speed_up(const struct round *r, int kernel) {
    return r->one.kernel[kernel].wall / r->all.kernel[kernel].wall;
}

/* What a kernel works on in one frame. */
static double units(const struct job *job, int kernel, const char **out_name) {
    const struct round *last = &job->round[job->settings->rounds - 1];
    *out_name = "rays";
    if (kernel == BENCH_DIRECT || kernel == BENCH_TRACE_BOUNCES) return (double)last->rays[kernel];
    *out_name = "ends";
    if (kernel == BENCH_GATHER) return (double)last->rays[1] * (double)job->settings->bounces;
    *out_name = "texels";
    return (double)job->one.solved.texels_solved;
}

static void print_kernels(const struct job *job, const char *name) {
    double rest = 100;
    for (int k = 0; k < BENCH_KERNELS; k++) {
        const char *unit;
        const double count = units(job, k, &unit), share = median_of_kernel(job, k, kernel_share);
        char ratio[16] = "";
        if (share < 0.05) continue;
        if (k < 2) snprintf(ratio, sizeof ratio, "%.2f", median_of(job, k ? ends_over_raw : direct_over_raw));
        printf("| %s | %s | %s | %.2f | %.1f | %s | %.2f |\n", name, bench_kernel_name[k], unit,
               1e-6 * count / median_of_kernel(job, k, kernel_s), share, ratio,
               median_of_kernel(job, k, kernel_speed_up));
        rest -= share;
    }
    printf("| %s | other | | | %.1f | | |\n", name, rest);
}

static void print_scene(const struct job *job, const char *name) {
    uint64_t triangles = 0;
    for (uint32_t o = 0; o < job->scene->object_count; o++)
        triangles += job->scene->mesh[job->scene->object[o].mesh].triangle_count;
    printf("| %s | %llu | %llu | %.1f | %.1f | %.2f | %.2f | %.2f | %.2f | %.1f | %.1f | %u | %.2f | %.2f | "
           "%.2f |\n",
           name, (unsigned long long)triangles, (unsigned long long)job->one.solved.texels_solved,
           median_of(job, direct_lanes), median_of(job, scatter_lanes), median_of(job, direct_raw_rate),
           median_of(job, scatter_raw_rate), median_of(job, direct_over_raw),
           median_of(job, scatter_over_raw), median_of(job, one_ms), median_of(job, all_ms), job->threads,
           median_of(job, speed_up), median_of(job, serial), median_of(job, serial_longest));
}

static const char kernel_head[] = "| scene | kernel | unit | M/s | share % | over_raw | speed-up |\n"
                                  "|---|---|---|---|---|---|---|\n";
static const char scene_head[] = "| scene | triangles | texels | direct lanes | scatter lanes | direct raw "
                                 "Mrays/s | scatter raw Mrays/s | "
                                 "direct_over_raw | scatter_over_raw | frame CPU ms | frame ms | threads | "
                                 "speed-up | serial % | longest % |\n"
                                 "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";

/* Room for packets, and how many tiles share it: by what one frame shoots. */
static enum lw_status make_room(struct job *job, struct lw_error *err) {
    const struct lw_solver_stats *s = &job->all.solved;
    const uint64_t rays = s->rays_shadow > s->rays_bounce ? s->rays_shadow : s->rays_bounce;
    const uint64_t packets = rays / 4; /* with a quarter of the lanes active: there were never less */
    job->stride = (uint32_t)(1 + packets / PACKETS_MAX);
    for (int k = 0; k < 2; k++)
        for (unsigned t = 0; t < job->threads; t++) {
            enum lw_status status = lw_trace_replay_create(PACKETS_MAX, &job->replay[k][t]);
            if (status != LW_OK) return lw_status_fail(err, status, "packets");
        }
    return LW_OK;
}

static enum lw_status measure(struct job *job, struct lw_error *err) {
    const struct bench_meter_desc plain = {.stride = UINT32_MAX};
    struct bench_meter_cost ignored;
    enum lw_status status = start(job, 1, &job->one, err);
    if (status == LW_OK) status = start(job, job->threads, &job->all, err);
    for (uint32_t i = 0; status == LW_OK && i < WARM_UP; i++) {
        status = bench_meter_frame(&job->one, &job->pose, &plain, &ignored, err);
        if (status == LW_OK) status = bench_meter_frame(&job->all, &job->pose, &plain, &ignored, err);
    }
    if (status == LW_OK) status = make_room(job, err);
    for (int64_t i = 0; status == LW_OK && i < job->settings->rounds; i++) {
        status = first_frame(job, &job->round[i], err);
        if (status == LW_OK) status = second_frame(job, &job->round[i], err);
    }
    return status;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *s = context;
    char label[64];
    struct job *job = calloc(1, sizeof *job);
    if (!job) return lw_status_fail(err, LW_NO_MEMORY, "rounds");
    job->settings = s;
    job->threads = s->open.threads ? (unsigned)s->open.threads : (unsigned)omp_get_max_threads();
    if (job->threads > THREADS_MAX) job->threads = THREADS_MAX;
    enum lw_status status =
        bench_open(&s->open, name, BENCH_MOTION_OWN, 0, &job->scene, &job->pose, &job->map, err);
    if (status == LW_OK) status = measure(job, err);
    if (status == LW_OK) {
        bench_label(name, label, sizeof label);
        printf("\n%s", kernel_head);
        print_kernels(job, label);
        printf("\n%s", scene_head);
        print_scene(job, label);
        fflush(stdout);
    }
    for (int k = 0; k < 2; k++)
        for (unsigned t = 0; t < job->threads; t++) lw_trace_replay_destroy(job->replay[k][t]);
    bench_meter_finish(&job->one);
    bench_meter_finish(&job->all);
    bench_close(job->scene, &job->pose, &job->map);
    free(job);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.rounds = 7, .bounces = 2, .direct_samples = 1, .indirect_samples = 2};
    const struct lw_option table[] = {
        BENCH_INT("rounds", "of two frames of each solver; medians are printed (default 7)", &s.rounds, 1,
                  ROUNDS_MAX),
        BENCH_INT("bounces", "indirect bounces (default 2)", &s.bounces, 1, LW_SOLVER_BOUNCES_MAX),
        BENCH_INT("direct-samples", "per texel and frame (default 1)", &s.direct_samples, 1, 1024),
        BENCH_INT("indirect-samples", "per texel and frame (default 2)", &s.indirect_samples, 1, 1024)};
    return BENCH_MAIN(argc, argv, table, .name = "bench_solve",
                      .about = "The kernels of a frame: rates, shares, and their distance to "
                               "bare rays, as tables in Markdown.",
                      .open = &s.open, .context = &s);
}
