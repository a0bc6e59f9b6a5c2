/* bench_slices: what the end of a frame costs against how much the frame has solved. One table in Markdown
 * per scene.
 *
 *     bench_slices [--rounds N] [--texels-per-metre D] SCENE...
 *
 * The whole scene is lit as lightwelld does by default, denoised and published, with direct light alone; then
 * frames solve every 4th, 16th and 64th tile, spread over all objects, or as many in a row, as the parts of a
 * round do that has a budget. CPU milliseconds with one worker, medians over the rounds: of the solve (direct
 * light and its sums), of each step of a frame's end, of them together, and how much that is of a whole
 * frame's. */
#include "tests/bench/bench_runner.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define ROUNDS_MAX 99
#define WARM_UP    5 /* frames: until every texel knows its own variance */

static const struct {
    uint32_t part;
    bool spread;
} parts[] = {{1, true}, {4, true}, {16, true}, {64, true}, {4, false}, {16, false}, {64, false}};
#define PARTS (sizeof parts / sizeof *parts)

struct settings {
    struct lw_scene_open open;
    int64_t rounds;
};

struct job {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct bench_runner runner;
    uint8_t *wanted;
    uint32_t tiles; /* of level 0 */
    struct bench_meter_frame cost[PARTS][ROUNDS_MAX];
    struct lw_solver_stats solved[PARTS]; /* in the last round */
};

static enum lw_status set_up(struct job *job, struct lw_error *err) {
    for (uint32_t id = 0; id < job->map.tile_count; id++) job->tiles += job->map.place[id].level == 0;
    job->wanted = malloc((size_t)job->map.tile_count + 1);
    if (!job->wanted) return lw_status_fail(err, LW_NO_MEMORY, "%u tiles", job->map.tile_count);
    return bench_runner_init(&job->runner,
                             &(struct lw_solver_desc){.scene = job->scene,
                                                      .atlas_map = &job->map,
                                                      .direct_samples = 1,
                                                      .indirect_samples = 1,
                                                      .target_error = -1,
                                                      .threads = 1,
                                                      .denoise = true},
                             &job->pose, err);
}

/* Solves and publishes every part-th tile, or a part of them in a row. */
static enum lw_status slice(struct job *job, uint32_t part, bool spread, struct bench_meter_frame *out_cost,
                            struct lw_solver_stats *out_solved, struct lw_error *err) {
    const uint32_t turn = (uint32_t)job->runner.frames % part;
    for (uint32_t id = 0, n = 0; id < job->map.tile_count; id++) {
        job->wanted[id] = 0;
        if (job->map.place[id].level) continue;
        job->wanted[id] = (spread ? n % part : n * part / job->tiles) == turn;
        n++;
    }
    enum lw_status status = job->runner.solver->ops->set_interest(job->runner.solver, job->wanted, err);
    if (status == LW_OK)
        status = bench_runner_frame(&job->runner, &job->pose,
                                    &(struct bench_meter_desc){.stride = UINT32_MAX}, out_cost, err);
    *out_solved = job->runner.solved;
    return status;
}

/* Milliseconds of the kernels from `first` to `last`. */
static double median_ms(const struct job *job, size_t part, int first, int last) {
    double value[ROUNDS_MAX];
    for (int64_t i = 0; i < job->settings->rounds; i++) {
        value[i] = 0;
        for (int k = first; k <= last; k++) value[i] += 1e3 * job->cost[part][i].kernel[k].cpu;
    }
    return bench_median(value, (size_t)job->settings->rounds);
}

static void print_table(const struct job *job, const char *name) {
    printf("\n| scene | tiles | | texels | solve ms |");
    for (int k = BENCH_DENOISE; k < BENCH_KERNELS; k++) printf(" %s |", bench_kernel_name[k]);
    printf(" end of frame | of a whole |\n|---|---|---|---|---|");
    for (int k = BENCH_DENOISE; k < BENCH_KERNELS; k++) printf("---|");
    printf("---|---|\n");
    for (size_t p = 0; p < PARTS; p++) {
        const double end = median_ms(job, p, BENCH_DENOISE, BENCH_KERNELS - 1);
        printf("| %s | %u | %s | %llu | %.2f |", name, job->solved[p].tiles_solved,
               p == 0            ? ""
               : parts[p].spread ? "spread"
                                 : "in a row",
               (unsigned long long)job->solved[p].texels_solved,
               median_ms(job, p, BENCH_DIRECT, BENCH_FINISH));
        for (int k = BENCH_DENOISE; k < BENCH_KERNELS; k++) printf(" %.2f |", median_ms(job, p, k, k));
        printf(" %.2f | %.1f %% |\n", end, 100 * end / median_ms(job, 0, BENCH_DENOISE, BENCH_KERNELS - 1));
    }
    fflush(stdout);
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    const struct settings *s = context;
    static struct job job;
    job = (struct job){.settings = s};
    enum lw_status status =
        bench_open(&s->open, path, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = set_up(&job, err);
    for (int i = 0; i < WARM_UP && status == LW_OK; i++)
        status = slice(&job, 1, true, &job.cost[0][0], &job.solved[0], err);
    for (int64_t i = 0; i < s->rounds && status == LW_OK; i++)
        for (size_t p = 0; p < PARTS && status == LW_OK; p++)
            status = slice(&job, parts[p].part, parts[p].spread, &job.cost[p][i], &job.solved[p], err);
    char label[64];
    if (status == LW_OK) print_table(&job, bench_label(path, label, sizeof label));
    free(job.wanted);
    bench_runner_finish(&job.runner);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.rounds = 9};
    const struct lw_option table[] = {
        {"rounds", "N", "frames of each part (default 9)", LW_OPTION_INT, &s.rounds, 1, ROUNDS_MAX, NULL}};
    return bench_main(
        &(struct bench_program){.name = "bench_slices",
                                .about = "What the end of a frame costs by what it has solved, as tables.",
                                .table = table,
                                .count = sizeof table / sizeof table[0],
                                .open = &s.open,
                                .context = &s,
                                .run = run},
        argc, argv);
}
