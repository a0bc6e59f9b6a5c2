/* bench_denoise: the error of what is shown after equal times, with and without the filter. One table in
 * Markdown per scene.
 *
 *     bench_denoise [--reference N] [--texels-per-metre D] SCENE...
 *
 * relMSE = mean((x-t)^2 / (t^2 + eps)) of luminance over all covered texels, eps = 1 % of the mean of t^2, t
 * from a solve of N frames with another seed and no filter. Times are of the processor, with one worker,
 * filter included: what others do on the machine does not count. "mean" is the largest change of an object's
 * mean light by the filter.
 * --form split: of light without the direct light of client lights ("auto"); besides, the same error
 * against all light of the place, which is what a picture shows: mean((x-t)^2 / (T^2 + eps)), T and eps of
 * all light. */
#include "common/clock.h"
#include "common/colour.h"
#include "common/light/client_lights.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static const double moments_s[] = {0.25, 1, 4};
static const uint32_t moments_frames[] = {1, 4, 16};
#define MOMENTS (sizeof moments_s / sizeof *moments_s)
_Static_assert(sizeof moments_frames / sizeof *moments_frames == MOMENTS, "either");

struct settings {
    struct lw_scene_open open;
    int64_t reference;
    int form;
    bool by_frames;
};

struct job {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_client_lights client;
    enum lw_light_form form;
    bool by_frames;
    float *reference,
        *whole; /* luminance of the covered texels, in the order of tile ids; whole: of all light */
    size_t texels;
    double eps, whole_eps;
};

struct moment {
    double seconds, filter_ms, error, whole_error, mean_change;
    uint32_t frames;
};

static double cpu_s(void) { return 1e-9 * (double)lw_clock_process_cpu_ns(); }

static enum lw_status create(const struct job *job, uint32_t seed, bool denoise,
                             struct lw_solver **out_solver, struct lw_error *err) {
    enum lw_status status = lw_solvers_create(NULL,
                                              &(struct lw_solver_desc){.scene = job->scene,
                                                                       .atlas_map = &job->map,
                                                                       .client_lights = &job->client,
                                                                       .bounces = 2,
                                                                       .direct_samples = 1,
                                                                       .indirect_samples = 1,
                                                                       .target_error = -1,
                                                                       .threads = 1,
                                                                       .seed = seed,
                                                                       .denoise = denoise},
                                              &job->pose, out_solver, err);
    if (status == LW_OK) (*out_solver)->ops->show(*out_solver, (1u << LW_LIGHT_FORM_COUNT) - 1);
    return status;
}

static float luminance(const float *const plane[3], uint32_t i) {
    return lw_colour_luminance(lw_vec3(plane[0][i], plane[1][i], plane[2][i]));
}

/* Without `out`, only counts. */
static size_t read_light(const struct job *job, const struct lw_solver *solver, enum lw_light_form form,
                         float *out) {
    size_t n = 0;
    for (uint32_t id = 0; id < job->map.tile_count; id++) {
        if (job->map.place[id].level) continue;
        struct lw_solver_tile tile;
        solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i]) continue;
            if (out) out[n] = luminance(tile.shown[form], i);
            n++;
        }
    }
    return n;
}

/* NAN of the split form, whose sums nobody reads. */
static double mean_change(const struct job *job, const struct lw_solver *solver) {
    double worst = 0;
    if (job->form == LW_LIGHT_FORM_SPLIT) return (double)NAN;
    for (uint32_t o = 0; o < job->map.object_count; o++) {
        double shown = 0, solved = 0;
        for (uint32_t id = 0; id < job->map.tile_count; id++) {
            if (job->map.place[id].level || job->map.place[id].object != o) continue;
            struct lw_solver_tile tile;
            solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
            for (uint32_t i = 0; i < tile.width * tile.height; i++)
                if (tile.covered[i]) {
                    shown += (double)luminance(tile.shown[LW_LIGHT_FORM_FULL], i);
                    solved += (double)luminance(tile.direct, i) + (double)luminance(tile.indirect, i);
                }
        }
        if (solved > 0) worst = fmax(worst, fabs(shown / solved - 1));
    }
    return worst;
}

static double eps_of(const float *reference, size_t texels) {
    double square = 0;
    for (size_t i = 0; i < texels; i++) square += (double)reference[i] * (double)reference[i];
    return 0.01 * square / (double)texels;
}

static enum lw_status solve_reference(struct job *job, uint32_t frames, struct lw_error *err) {
    struct lw_solver *solver;
    struct lw_solver_stats stats;
    enum lw_status status = create(job, 7, false, &solver, err);
    if (status != LW_OK) return status;
    job->texels = read_light(job, solver, job->form, NULL);
    for (uint32_t f = 1; status == LW_OK && f <= frames; f++)
        status = solver->ops->frame(solver, &job->pose, f, &stats, err);
    job->reference = malloc((job->texels + 1) * sizeof *job->reference);
    job->whole = malloc((job->texels + 1) * sizeof *job->whole);
    if (status == LW_OK && !(job->reference && job->whole))
        status = lw_status_fail(err, LW_NO_MEMORY, "reference");
    if (status == LW_OK) {
        read_light(job, solver, job->form, job->reference);
        read_light(job, solver, LW_LIGHT_FORM_FULL, job->whole);
        job->eps = eps_of(job->reference, job->texels);
        job->whole_eps = eps_of(job->whole, job->texels);
    }
    solver->ops->destroy(solver);
    return status;
}

static enum lw_status measure(const struct job *job, bool denoise, struct moment out_moment[MOMENTS],
                              struct lw_error *err) {
    struct lw_solver *solver;
    float *light = malloc((job->texels + 1) * sizeof *light);
    if (!light) return lw_status_fail(err, LW_NO_MEMORY, "%zu texels", job->texels);
    enum lw_status status = create(job, 1, denoise, &solver, err);
    if (status != LW_OK) {
        free(light);
        return status;
    }
    double seconds = 0, filter_ms = 0;
    uint32_t frames = 0;
    for (size_t m = 0; m < MOMENTS && status == LW_OK; m++) {
        while (status == LW_OK && (job->by_frames ? frames < moments_frames[m] : seconds < moments_s[m])) {
            struct lw_solver_stats stats;
            const double began = cpu_s();
            status = solver->ops->frame(solver, &job->pose, ++frames, &stats, err);
            seconds += cpu_s() - began;
            filter_ms += (double)stats.denoise_ns * 1e-6;
        }
        double error = 0, whole_error = 0;
        read_light(job, solver, job->form, light);
        for (size_t i = 0; i < job->texels; i++) {
            const double t = (double)job->reference[i], whole = (double)job->whole[i],
                         off = (double)light[i] - t;
            error += off * off / (t * t + job->eps);
            whole_error += off * off / (whole * whole + job->whole_eps);
        }
        out_moment[m] = (struct moment){.seconds = seconds,
                                        .filter_ms = filter_ms / frames,
                                        .error = error / (double)job->texels,
                                        .whole_error = whole_error / (double)job->texels,
                                        .mean_change = mean_change(job, solver),
                                        .frames = frames};
    }
    solver->ops->destroy(solver);
    free(light);
    return status;
}

static void print_table(const struct job *job, const char *path, uint32_t reference,
                        const struct moment *plain, const struct moment *filtered) {
    char label[64];
    printf(
        "\n### %s\n\n%zu texels; reference: %u frames.\n\n"
        "| seconds | frames | relMSE | against all light | frames, filtered | relMSE, filtered | against all "
        "light | ratio | filter ms (wall) | frame ms | mean, filtered | mean, welded alone |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|\n",
        bench_label(path, label, sizeof label), job->texels, reference);
    for (size_t m = 0; m < MOMENTS; m++) {
        printf("| %.2f | %u | %.4f | %.4f | %u | %.4f | %.4f | %.2f | %.1f | %.1f |", plain[m].seconds,
               plain[m].frames, plain[m].error, plain[m].whole_error, filtered[m].frames, filtered[m].error,
               filtered[m].whole_error, plain[m].error / filtered[m].error, filtered[m].filter_ms,
               filtered[m].seconds * 1e3 / filtered[m].frames);
        if (job->form == LW_LIGHT_FORM_SPLIT)
            puts(" | |");
        else
            printf(" %.2g %% | %.2g %% |\n", 100 * filtered[m].mean_change, 100 * plain[m].mean_change);
    }
    fflush(stdout);
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    const struct settings *s = context;
    struct job job = {.form = (enum lw_light_form)s->form, .by_frames = s->by_frames};
    struct moment plain[MOMENTS], filtered[MOMENTS];
    enum lw_status status =
        bench_open(&s->open, path, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK)
        status = lw_client_lights_init(&job.client, job.scene, &job.pose, job.form ? "auto" : "none", err);
    if (status == LW_OK) status = solve_reference(&job, (uint32_t)s->reference, err);
    if (status == LW_OK) status = measure(&job, false, plain, err);
    if (status == LW_OK) status = measure(&job, true, filtered, err);
    if (status == LW_OK) print_table(&job, path, (uint32_t)s->reference, plain, filtered);
    lw_client_lights_finish(&job.client);
    free(job.reference);
    free(job.whole);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.reference = 256};
    const struct lw_option table[] = {{"reference", "N",
                                       "frames of the solve that errors are measured against (default 256)",
                                       LW_OPTION_INT, &s.reference, 2, 100000, NULL},
                                      {"form", "full|split", "light that is measured (default full)",
                                       LW_OPTION_CHOICE, &s.form, 0, 0, NULL},
                                      {"by-frames", NULL, "after 1, 4 and 16 frames, not after equal times",
                                       LW_OPTION_FLAG, &s.by_frames, 0, 0, NULL}};
    return bench_main(
        &(struct bench_program){.name = "bench_denoise",
                                .about = "Error at equal times with and without the filter, as tables.",
                                .table = table,
                                .count = sizeof table / sizeof table[0],
                                .open = &s.open,
                                .context = &s,
                                .run = run},
        argc, argv);
}
