/* bench_change: what it costs to follow an object that moves once, against a new solve of everything.
 *
 *     bench_change [--object NAME] [--shift WIDTHS] [--error E] [--frames N] [--reference N]
 *     [--texels-per-metre D] SCENE...
 *
 * The scene is solved until all of it has converged, without its own animation; an object moves by a part
 * of its width; it is solved until it has converged again. Another solver begins with the object where it
 * then stands. One row in Markdown per scene: rays of both until they converge, their quotient, rays of
 * the first frame after the movement and texels that it solves, frames of both. With --reference also the
 * errors, against a solve of N frames that never converges: over all texels, and over those alone whose
 * light the movement changed by over a tenth. relMSE as in docs/lab/crossover.md, over texels, but
 * none counts for more than 1. */
#include "common/clock.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_light.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_shift.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define CHANGED 0.1f /* of a texel's light */
#define IDLE    20 /* frames without a solve after which all has been asked (server/solve/adapt/gradient.h) */

struct settings {
    struct lw_scene_open open;
    const char *object;
    double shift, error;
    int64_t frames, reference_frames;
};

struct job {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
};

struct solution {
    struct lw_solver *solver;
    uint64_t frame, rays, first_rays, first_texels;
    int64_t count; /* frames of the last call of go_on() */
    double cpu_s;  /* of those, all threads */
};

/* ---- solving ---- */

/* Solves `frames` more frames, or fewer if all converges before; what is counted is counted from here on. */
static enum lw_status go_on(const struct job *job, struct solution *s, int64_t frames, struct lw_error *err) {
    s->rays = 0;
    s->count = 0;
    s->cpu_s = 0;
    for (int64_t i = 0, idle = 0; i < frames && idle < IDLE; i++, idle++) {
        struct lw_solver_stats stats;
        const uint64_t began_ns = lw_clock_process_cpu_ns();
        enum lw_status status = s->solver->ops->frame(s->solver, &job->pose, ++s->frame, &stats, err);
        if (status != LW_OK) return status;
        s->cpu_s += 1e-9 * (double)(lw_clock_process_cpu_ns() - began_ns);
        s->rays += stats.rays_shadow + stats.rays_bounce;
        if (i == 0) s->first_rays = s->rays, s->first_texels = stats.texels_solved;
        if (!stats.tiles_solved) continue;
        s->count = i + 1;
        idle = 0;
    }
    return LW_OK;
}

/* ---- errors ---- */

struct errors {
    double all, changed;
    size_t texels; /* that changed */
};

/* before: the light before the movement, as exact as the reference. */
static struct errors compare(const float *x, const float *reference, const float *before, size_t count) {
    struct errors e = {0};
    const double epsilon = bench_light_epsilon(reference, count);
    for (size_t i = 0; i < count; i += 3) {
        float most = 0;
        const double error = bench_light_error(x + i, reference + i, epsilon);
        for (size_t c = i; c < i + 3; c++)
            most = fmaxf(most, fabsf(reference[c] - before[c]) / (reference[c] + 1e-6f));
        e.all += error;
        if (most < CHANGED) continue;
        e.changed += error;
        e.texels++;
    }
    e.all /= (double)count / 3;
    e.changed /= e.texels ? (double)e.texels : 1;
    return e;
}

/* ---- a scene ---- */

/* Solves the scene as it is now. The caller destroys out->solver. */
static enum lw_status solve_again(const struct job *job, double error, uint32_t seed, int64_t frames,
                                  struct solution *out, struct lw_error *err) {
    *out = (struct solution){0};
    const struct lw_solver_desc desc = bench_light_desc(job->scene, &job->map, error, seed);
    enum lw_status status = lw_solvers_create(NULL, &desc, &job->pose, &out->solver, err);
    return status == LW_OK ? go_on(job, out, frames, err) : status;
}

static void destroy(struct solution *s) {
    if (s->solver) s->solver->ops->destroy(s->solver);
}

/* The light of the scene as it is now, as exact as what it is compared with. */
static enum lw_status find_reference(const struct job *job, uint32_t seed, float **out_light,
                                     struct lw_error *err) {
    struct solution s;
    size_t count;
    enum lw_status status = solve_again(job, -1, seed, job->settings->reference_frames, &s, err);
    if (status == LW_OK && !(*out_light = bench_read_light(s.solver, &job->map, &count)))
        status = lw_status_fail(err, LW_NO_MEMORY, "texels");
    destroy(&s);
    return status;
}

static enum lw_status print_errors(const struct job *job, const struct solution *s,
                                   const struct solution *again, const float *before, struct lw_error *err) {
    float *reference = NULL;
    size_t count = 0;
    float *light = bench_read_light(s->solver, &job->map, &count),
          *light_again = bench_read_light(again->solver, &job->map, &count);
    enum lw_status status = light && light_again ? find_reference(job, 8, &reference, err)
                                                 : lw_status_fail(err, LW_NO_MEMORY, "texels");
    if (status == LW_OK) {
        const struct errors e = compare(light, reference, before, count),
                            e_again = compare(light_again, reference, before, count);
        printf(" %.5f, %.5f | %.5f, %.5f | %.1f %% |", e.all, e_again.all, e.changed, e_again.changed,
               100 * (double)e.texels / ((double)count / 3));
    }
    free(reference);
    free(light_again);
    free(light);
    return status;
}

static enum lw_status measure(struct job *job, struct lw_error *err) {
    const struct settings *set = job->settings;
    struct solution s, again = {0};
    float *before = NULL;
    lw_pose_evaluate(&job->pose, job->scene, 0);
    enum lw_status status = solve_again(job, set->error, 1, set->frames, &s, err);
    if (status == LW_OK && s.count == set->frames)
        fprintf(stderr, "bench_change: not all has converged after %lld frames\n", (long long)s.count);
    if (status == LW_OK && set->reference_frames) status = find_reference(job, 7, &before, err);
    lw_pose_evaluate(&job->pose, job->scene, 1);
    if (status == LW_OK) status = go_on(job, &s, set->frames, err);
    if (status == LW_OK) status = solve_again(job, set->error, 2, set->frames, &again, err);
    if (status == LW_OK)
        printf("%.3f M | %.2f M | %.1f | %.2f | %.2f | %.1f | %.3f M | %llu | %lld, %lld |",
               1e-6 * (double)s.rays, 1e-6 * (double)again.rays, (double)again.rays / (double)s.rays, s.cpu_s,
               again.cpu_s, again.cpu_s / s.cpu_s, 1e-6 * (double)s.first_rays,
               (unsigned long long)s.first_texels, (long long)s.count, (long long)again.count);
    if (status == LW_OK && set->reference_frames) status = print_errors(job, &s, &again, before, err);
    printf("\n");
    destroy(&again);
    destroy(&s);
    free(before);
    return status;
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    struct job job = {.settings = context};
    char label[64];
    enum lw_status status =
        bench_open(&job.settings->open, path, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK)
        status = bench_shift(job.scene, job.settings->object, (float)job.settings->shift, NULL, err);
    if (status == LW_OK) {
        lw_pose_finish(&job.pose);
        status = lw_pose_init(&job.pose, job.scene);
    }
    printf("| %s, %s | ", bench_label(path, label, sizeof label), job.settings->object);
    fflush(stdout);
    if (status == LW_OK) status = measure(&job, err);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.object = "amphora", .shift = 1, .error = 0.1, .frames = 4096};
    const struct lw_option table[] = {
        {"object", "NAME", "what moves (default amphora)", LW_OPTION_STRING, &s.object, 0, 0, NULL},
        {"shift", "WIDTHS", "by so much along its own x (default 1)", LW_OPTION_REAL, &s.shift, -1000, 1000,
         NULL},
        {"error", "E", "relative error at which a tile converges (default 0.1)", LW_OPTION_REAL, &s.error,
         1e-4, 1, NULL},
        {"frames", "N", "at most, of each solve (default 4096)", LW_OPTION_INT, &s.frames, 8, 1000000, NULL},
        {"reference", "N", "frames of the reference that errors are measured against (default 0: no errors)",
         LW_OPTION_INT, &s.reference_frames, 0, 1000000, NULL}};
    return bench_main(
        &(struct bench_program){
            .name = "bench_change",
            .about = "What it costs to follow an object that moves once.",
            .table = table,
            .count = sizeof table / sizeof table[0],
            .open = &s.open,
            .heading =
                "| scene, object | rays | rays of a fresh solve | quotient | CPU s | of a fresh solve | "
                "quotient | of the first frame | texels that it "
                "solves | frames: followed, fresh | relMSE: followed, fresh | of changed texels | "
                "changed |\n"
                "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
            .context = &s,
            .run = run},
        argc, argv);
}
