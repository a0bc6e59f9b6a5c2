/* bench_layers: what layers of light save while the scene's animation moves lights.
 *
 *     bench_layers [--frames N] [--reference N] [--texels-per-metre D] SCENE...
 *
 * The scene is solved for N frames of its animation, 1/30 s each, in one layer and in layers for what moves
 * (light_groups.h), with blocks that converge at errors of 0.02 and of 0.2. One row in Markdown each: texels
 * solved and rays of a frame, in the mean of the second half; relMSE over all texels of the last frame,
 * unfiltered, against a solve of that moment that never converges; memory. */
#include "common/clock.h"
#include "common/scene/scene_motion.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_light.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FRAME_S (1.0 / 30)

struct settings {
    struct lw_scene_open open;
    int64_t frames, reference_frames;
};

struct job {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    const char *label;
};

struct row {
    uint64_t texels, rays; /* of a frame */
    double relmse, mb;
};

static enum lw_status create(const struct job *job, const char *group_names, double error, uint32_t seed,
                             struct lw_solver **out_solver, struct lw_error *err) {
    struct lw_light_groups groups;
    enum lw_status status = lw_light_groups_init(&groups, job->scene, &job->pose, group_names, err);
    if (status != LW_OK) return status;
    struct lw_solver_desc desc = bench_light_desc(job->scene, &job->map, error, seed);
    desc.light_groups = &groups;
    status = lw_solvers_create(NULL, &desc, &job->pose, out_solver, err);
    lw_light_groups_finish(&groups);
    return status;
}

/* One frame, whose rays and texels count for the row. */
static enum lw_status step(const struct job *job, struct lw_solver *solver, uint64_t frame, struct row *row,
                           struct lw_error *err) {
    struct lw_solver_stats stats;
    enum lw_status status = solver->ops->frame(solver, &job->pose, frame, &stats, err);
    if (status != LW_OK) return status;
    row->texels += stats.texels_solved;
    row->rays += stats.rays_shadow + stats.rays_bounce;
    return LW_OK;
}

/* The animation up to the last frame. reference: of that moment; NULL: the solve is the reference, and stands
 * still. */
static enum lw_status solve(struct job *job, const char *group_names, double error, const float *reference,
                            struct row *row, float **out_light, struct lw_error *err) {
    const int64_t frames = reference ? job->settings->frames : job->settings->reference_frames;
    struct lw_solver *solver = NULL;
    *row = (struct row){0};
    lw_pose_evaluate(&job->pose, job->scene, reference ? 0 : (double)(job->settings->frames - 1) * FRAME_S);
    enum lw_status status = create(job, group_names, error, reference ? 1 : 2, &solver, err);
    for (int64_t f = 0; f < frames && status == LW_OK; f++) {
        if (reference) lw_pose_evaluate(&job->pose, job->scene, (double)f * FRAME_S);
        if (f == frames / 2) *row = (struct row){0};
        status = step(job, solver, (uint64_t)f + 1, row, err);
    }
    size_t count;
    if (status == LW_OK && !(*out_light = bench_read_light(solver, &job->map, &count)))
        status = lw_status_fail(err, LW_NO_MEMORY, "texels");
    if (status == LW_OK && reference) {
        const uint64_t half = (uint64_t)(frames - frames / 2);
        row->relmse = bench_light_relmse(*out_light, reference, count);
        row->texels /= half;
        row->rays /= half;
        row->mb = (double)solver->ops->memory_bytes(solver) * 1e-6;
    }
    if (solver) solver->ops->destroy(solver);
    return status;
}

static enum lw_status measure(struct job *job, struct lw_error *err) {
    static const double errors[] = {0.02, 0.2};
    float *reference = NULL;
    struct row row;
    enum lw_status status = solve(job, "none", -1, NULL, &row, &reference, err);
    for (int i = 0; i < 4 && status == LW_OK; i++) {
        float *light = NULL;
        status = solve(job, i % 2 ? NULL : "none", errors[i / 2], reference, &row, &light, err);
        free(light);
        if (status != LW_OK) break;
        printf("| %s | %s | %g | %llu k | %llu k | %.5f | %.0f MB |\n", job->label,
               i % 2 ? "what moves apart" : "one", errors[i / 2], (unsigned long long)row.texels / 1000,
               (unsigned long long)row.rays / 1000, row.relmse, row.mb);
        fflush(stdout);
    }
    free(reference);
    return status;
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    struct job job = {.settings = context};
    char label[64];
    job.label = bench_label(path, label, sizeof label);
    enum lw_status status =
        bench_open(&job.settings->open, path, LW_SCENE_MOTION_LIGHT, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = measure(&job, err);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 120, .reference_frames = 400};
    const struct lw_option table[] = {
        {"frames", "N", "of the animation (default 120)", LW_OPTION_INT, &s.frames, 4, 100000, NULL},
        {"reference", "N", "frames of the solve that errors are measured against (default 400)",
         LW_OPTION_INT, &s.reference_frames, 4, 1000000, NULL}};
    return bench_main(
        &(struct bench_program){
            .name = "bench_layers",
            .about = "What layers of light save while lights move.",
            .table = table,
            .count = sizeof table / sizeof table[0],
            .open = &s.open,
            .heading = "| scene | layers | target error | texels a frame | rays a frame | relMSE | memory |\n"
                       "|---|---|---|---|---|---|---|",
            .context = &s,
            .run = run},
        argc, argv);
}
