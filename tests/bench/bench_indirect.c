/* bench_indirect: what bounce rays at a lower resolution save, and what they cost in error.
 *
 *     bench_indirect [--frames N] [--truth N] [--texels-per-metre D] SCENE...
 *
 * A still scene is lit with bounce rays from every texel, from one in 4, 16 and 64 (packets.h), and as the solver chooses. One row in
 * Markdown each after 4, 16, 64, ... N frames: bounce rays of a texel and frame; CPU time of a frame with one worker; relMSE over all texels, of
 * indirect light alone, of all light, and of all light filtered (denoise.h), against a solve of every texel with another seed. */
#include "common/clock.h"
#include "server/solve/cell_solver.h"
#include "tests/bench/bench_light.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

struct settings {
    struct lw_scene_open open;
    int64_t frames, truth_frames, direct_samples, indirect_samples;
};

struct job {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    const char *label;
    float *truth[BENCH_LIGHT_KINDS];
};

static enum lw_status create(const struct job *job, uint32_t level, uint32_t seed, bool denoise,
                             struct lw_solver **out_solver, struct lw_error *err) {
    return lw_cell_solver_create(
        &(struct lw_solver_desc){.scene = job->scene,
                                 .atlas_map = &job->map,
                                 .bounces = 2,
                                 .direct_samples = (uint32_t)job->settings->direct_samples,
                                 .indirect_samples = (uint32_t)job->settings->indirect_samples,
                                 .indirect_level = level,
                                 .target_error = -1,
                                 .denoise = denoise,
                                 .threads = 1,
                                 .seed = seed},
        &job->pose, out_solver, err);
}

static enum lw_status print_row(const struct job *job, const struct lw_solver *solver, const char *name,
                                int64_t frames, uint64_t rays, uint64_t cpu_ns, struct lw_error *err) {
    double relmse[BENCH_LIGHT_KINDS];
    size_t count = 0;
    for (int kind = 0; kind < BENCH_LIGHT_KINDS; kind++) {
        float *light = bench_read_light(solver, &job->map, (enum bench_light)kind, &count);
        if (!light) return lw_status_fail(err, LW_NO_MEMORY, "texels");
        relmse[kind] = bench_light_relmse(light, job->truth[kind], count);
        free(light);
    }
    printf("| %s | %s | %lld | %.3f | %.1f | %.5f | %.5f | %.5f |\n", job->label, name, (long long)frames,
           (double)rays / (double)frames / ((double)count / 3), 1e-6 * (double)cpu_ns / (double)frames,
           relmse[BENCH_LIGHT_INDIRECT], relmse[BENCH_LIGHT_ALL], relmse[BENCH_LIGHT_SHOWN]);
    fflush(stdout);
    return LW_OK;
}

static enum lw_status run_level(const struct job *job, uint32_t level, struct lw_error *err) {
    static const char *const names[] = {"1", "1/4", "1/16", "1/64", "chosen"};
    struct lw_solver *solver = NULL;
    struct lw_solver_stats stats;
    uint64_t rays = 0, cpu_ns = 0;
    int64_t print = 4;
    enum lw_status status = create(job, level, 1, true, &solver, err);
    for (int64_t f = 1; f <= job->settings->frames && status == LW_OK; f++) {
        const uint64_t t0 = lw_clock_process_cpu_ns();
        status = solver->ops->frame(solver, &job->pose, (uint64_t)f, &stats, err);
        cpu_ns += lw_clock_process_cpu_ns() - t0;
        rays += stats.rays_bounce;
        if (status != LW_OK || (f != print && f != job->settings->frames)) continue;
        status = print_row(job, solver, names[level], f, rays, cpu_ns, err);
        print *= 4;
    }
    if (solver) solver->ops->destroy(solver);
    return status;
}

static enum lw_status measure(struct job *job, struct lw_error *err) {
    struct lw_solver *solver = NULL;
    struct lw_solver_stats stats;
    size_t count;
    enum lw_status status = create(job, 0, 2, false, &solver, err);
    for (int64_t f = 1; f <= job->settings->truth_frames && status == LW_OK; f++)
        status = solver->ops->frame(solver, &job->pose, (uint64_t)f, &stats, err);
    for (int kind = 0; kind < BENCH_LIGHT_KINDS && status == LW_OK; kind++)
        if (!(job->truth[kind] = bench_read_light(solver, &job->map, (enum bench_light)kind, &count)))
            status = lw_status_fail(err, LW_NO_MEMORY, "texels");
    if (solver) solver->ops->destroy(solver);
    for (uint32_t level = 0; level <= 3 && status == LW_OK; level++) status = run_level(job, level, err);
    for (int kind = 0; kind < BENCH_LIGHT_KINDS; kind++) free(job->truth[kind]);
    return status;
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    struct job job = {.settings = context};
    char label[64];
    job.label = bench_label(path, label, sizeof label);
    enum lw_status status =
        bench_open(&job.settings->open, path, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = measure(&job, err);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 64, .truth_frames = 400, .direct_samples = 1, .indirect_samples = 2};
    const struct lw_option table[] = {
        {"frames", "N", "that are solved (default 64)", LW_OPTION_INT, &s.frames, 4, 100000, NULL},
        {"truth", "N", "frames of the solve that errors are measured against (default 400)", LW_OPTION_INT,
         &s.truth_frames, 4, 1000000, NULL},
        {"direct-samples", "N", "per texel and frame (default 1)", LW_OPTION_INT, &s.direct_samples, 1, 1024,
         NULL},
        {"indirect-samples", "N", "per texel and frame (default 2)", LW_OPTION_INT, &s.indirect_samples, 1,
         1024, NULL}};
    return bench_main(
        &(struct bench_program){.name = "bench_indirect",
                                .about = "Indirect light at lower resolutions: rays, time, error.",
                                .table = table,
                                .count = sizeof table / sizeof table[0],
                                .open = &s.open,
                                .heading = "| scene | bounce rays from | frames | bounce rays a texel | "
                                           "frame, CPU ms | relMSE: indirect | all | "
                                           "filtered |\n"
                                           "|---|---|---|---|---|---|---|---|",
                                .context = &s,
                                .run = run},
        argc, argv);
}
