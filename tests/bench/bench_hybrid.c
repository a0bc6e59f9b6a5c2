/* bench_hybrid: what a finite tracing range costs in accuracy and saves in time. One table in Markdown per
 * scene.
 *
 *     bench_hybrid [--frames N] [--texels-per-metre D] [--quick] [--range R] [--spacing S] SCENE...
 *
 * Tracing ranges 0.05, 0.1, 0.3 and 1 of the longest side, or R; each with every variant of the probes, or
 * with the default form and projection alone (--quick), that share S of the longest side apart.
 * Everything is compared with the same solver at range = inf, over the indirect light of every covered texel.
 * Each setting is solved twice with seeds of its own, a and b, and so is the reference, t and u: then
 * mean((a-t)(b-u) / (m^2+eps)), m = (t+u)/2, eps = 1 % of the mean of m^2, is relMSE without the noise, which
 * is what probes add for good. "99 %" is the error that one in a hundred blocks of 8 x 8 texels exceeds;
 * noise is in it: the row "inf" says how much. */
#include "common/clock.h"
#include "common/colour.h"
#include "server/solve/solvers.h"
#include "server/solve/transport/probe_form.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define BLOCK 8u

struct settings {
    struct lw_scene_open open;
    int64_t frames;
    bool quick;
    double range, spacing; /* 0: all */
};

struct job {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    float longest_m;
    uint32_t frames;
    size_t texels, blocks;
};

struct setting {
    float range, spacing; /* of the longest side; range 0: inf; spacing 0: the default */
    enum lw_probe_form_kind form;
    enum lw_probe_projection projection;
};

/* Luminance of the indirect light, and its sums over blocks, of one solve. */
struct outcome {
    float *texel, *block;
    double frame_ms, rays; /* median; of the last frame */
};

static const char *const projection_names[] = {"depth", "box", "step"};

static bool outcome_init(struct outcome *o, const struct job *job) {
    o->texel = malloc((job->texels + 1) * sizeof *o->texel);
    o->block = malloc((job->blocks + 1) * sizeof *o->block);
    return o->texel && o->block;
}

static void outcome_finish(struct outcome *o) {
    free(o->texel);
    free(o->block);
}

/* Covered texels in the order of tile ids; blocks likewise, 0 where nothing is covered. */
static void count_or_read(const struct job *job, const struct lw_solver *solver, struct outcome *o,
                          size_t *out_texels, size_t *out_blocks) {
    size_t texels = 0, blocks = 0;
    for (uint32_t id = 0; id < job->map.tile_count; id++) {
        if (job->map.place[id].level) continue;
        struct lw_solver_tile tile;
        solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
        const uint32_t columns = (tile.width + BLOCK - 1) / BLOCK, rows = (tile.height + BLOCK - 1) / BLOCK;
        if (o) memset(o->block + blocks, 0, columns * rows * sizeof *o->block);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i]) continue;
            if (o) {
                o->texel[texels] = lw_colour_luminance(
                    lw_vec3(tile.indirect[0][i], tile.indirect[1][i], tile.indirect[2][i]));
                o->block[blocks + i / tile.width / BLOCK * columns + i % tile.width / BLOCK] +=
                    o->texel[texels];
            }
            texels++;
        }
        blocks += (size_t)columns * rows;
    }
    *out_texels = texels;
    *out_blocks = blocks;
}

/* Processor time, with one worker: what others do on the machine does not count. */
static double cpu_ms(void) { return 1e-6 * (double)lw_clock_process_cpu_ns(); }

static enum lw_status create(const struct job *job, const struct setting *setting, uint32_t seed,
                             struct lw_solver **out_solver, struct lw_error *err) {
    return lw_solvers_create(NULL,
                             &(struct lw_solver_desc){.scene = job->scene,
                                                      .atlas_map = &job->map,
                                                      .bounces = 2,
                                                      .direct_samples = 1,
                                                      .indirect_samples = 2,
                                                      .threads = 1,
                                                      .seed = seed,
                                                      .tracing_range_m = setting->range > 0
                                                                             ? setting->range * job->longest_m
                                                                             : INFINITY,
                                                      .probe_spacing_m = setting->spacing * job->longest_m,
                                                      .probe_form = setting->form,
                                                      .probe_projection = setting->projection},
                             &job->pose, out_solver, err);
}

static enum lw_status solve(const struct job *job, const struct setting *setting, uint32_t seed,
                            uint32_t frames, struct outcome *out, struct lw_error *err) {
    struct lw_solver *solver;
    enum lw_status status = create(job, setting, seed, &solver, err);
    if (status != LW_OK) return status;
    double *ms = malloc(frames * sizeof *ms);
    for (uint32_t f = 1; ms && status == LW_OK && f <= frames; f++) {
        struct lw_solver_stats stats;
        double began = cpu_ms();
        status = solver->ops->frame(solver, &job->pose, f, &stats, err);
        ms[f - 1] = cpu_ms() - began;
        out->rays = (double)(stats.rays_bounce + stats.rays_probe);
    }
    if (ms && status == LW_OK) {
        size_t texels, blocks;
        count_or_read(job, solver, out, &texels, &blocks);
        out->frame_ms = bench_median(ms, frames);
    }
    free(ms);
    solver->ops->destroy(solver);
    return ms ? status : lw_status_fail(err, LW_NO_MEMORY, "frames");
}

static void print_row(const struct job *job, const struct setting *setting, const struct outcome *a,
                      const struct outcome *b, const struct outcome *t, const struct outcome *u) {
    double got = 0, want = 0, square = 0, error = 0;
    for (size_t i = 0; i < job->texels; i++) {
        double m = ((double)t->texel[i] + (double)u->texel[i]) / 2;
        got += ((double)a->texel[i] + (double)b->texel[i]) / 2;
        want += m;
        square += m * m;
    }
    const double eps = 0.01 * square / (double)job->texels;
    for (size_t i = 0; i < job->texels; i++) {
        double m = ((double)t->texel[i] + (double)u->texel[i]) / 2;
        error += ((double)a->texel[i] - (double)t->texel[i]) * ((double)b->texel[i] - (double)u->texel[i]) /
                 (m * m + eps);
    }
    double *off = malloc(job->blocks * sizeof *off), high = (double)NAN;
    size_t count = 0;
    for (size_t i = 0; off && i < job->blocks; i++) {
        double reference = (double)t->block[i] + (double)u->block[i];
        if (reference > 0) off[count++] = fabs(((double)a->block[i] + (double)b->block[i]) / reference - 1);
    }
    if (count) {
        bench_median(off, count); /* sorts */
        high = off[(size_t)(0.99 * (double)(count - 1))];
    }
    free(off);
    char spacing[16] = "default";
    if (setting->spacing > 0) snprintf(spacing, sizeof spacing, "1/%.0f", 1 / (double)setting->spacing);
    if (setting->range > 0)
        printf("| %.2f | %s | %s | %s ", (double)setting->range, spacing, lw_probe_form(setting->form)->name,
               projection_names[setting->projection]);
    else
        printf("| inf | – | – | – ");
    printf("| %.4f | %.5f | %.1f %% | %.1f | %.2f | %.2f |\n", got / want, error / (double)job->texels,
           100 * high, a->frame_ms, a->frame_ms / t->frame_ms, a->rays * 1e-6);
    fflush(stdout);
}

static enum lw_status measure(const struct job *job, const struct settings *s, struct lw_error *err) {
    static const float ranges[] = {0.05f, 0.1f, 0.3f, 1};
    static const struct setting variants[] = {
        {0, 0, LW_PROBE_FORM_OCTAHEDRAL, LW_PROBE_PROJECTION_DEPTH},
        {0, 0, LW_PROBE_FORM_OCTAHEDRAL, LW_PROBE_PROJECTION_BOX},
        {0, 0, LW_PROBE_FORM_OCTAHEDRAL, LW_PROBE_PROJECTION_STEP},
        {0, 0, LW_PROBE_FORM_SH, LW_PROBE_PROJECTION_DEPTH},
        {0, 0, LW_PROBE_FORM_CUBE, LW_PROBE_PROJECTION_DEPTH},
        {0, 1 / 4.0f, LW_PROBE_FORM_OCTAHEDRAL, LW_PROBE_PROJECTION_DEPTH},
        {0, 1 / 16.0f, LW_PROBE_FORM_OCTAHEDRAL, LW_PROBE_PROJECTION_DEPTH}};
    struct outcome a = {0}, b = {0}, t = {0}, u = {0};
    enum lw_status status = LW_OK;
    if (!outcome_init(&a, job) || !outcome_init(&b, job) || !outcome_init(&t, job) || !outcome_init(&u, job))
        status = lw_status_fail(err, LW_NO_MEMORY, "%zu texels", job->texels);
    const struct setting traced = {0};
    if (status == LW_OK) status = solve(job, &traced, 1, 4 * job->frames, &t, err);
    if (status == LW_OK) status = solve(job, &traced, 2, 4 * job->frames, &u, err);
    if (status == LW_OK) status = solve(job, &traced, 3, job->frames, &a, err);
    if (status == LW_OK) status = solve(job, &traced, 4, job->frames, &b, err);
    if (status == LW_OK) print_row(job, &traced, &a, &b, &t, &u);
    const size_t range_count = s->range > 0 ? 1 : sizeof ranges / sizeof ranges[0],
                 variant_count = s->quick || s->spacing > 0 ? 1 : sizeof variants / sizeof variants[0];
    for (size_t r = 0; status == LW_OK && r < range_count; r++)
        for (size_t v = 0; status == LW_OK && v < variant_count; v++) {
            struct setting setting = variants[v];
            setting.range = s->range > 0 ? (float)s->range : ranges[r];
            if (s->spacing > 0) setting.spacing = (float)s->spacing;
            status = solve(job, &setting, 3, job->frames, &a, err);
            if (status == LW_OK) status = solve(job, &setting, 4, job->frames, &b, err);
            if (status == LW_OK) print_row(job, &setting, &a, &b, &t, &u);
        }
    outcome_finish(&a);
    outcome_finish(&b);
    outcome_finish(&t);
    outcome_finish(&u);
    return status;
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    const struct settings *s = context;
    struct job job = {.frames = (uint32_t)s->frames};
    struct lw_solver *solver = NULL;
    char label[64];
    enum lw_status status =
        bench_open(&s->open, path, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) {
        struct lw_vec3 lo, hi;
        lw_pose_bounds(&job.pose, job.scene, &lo, &hi);
        struct lw_vec3 size = lw_vec3_sub(hi, lo);
        job.longest_m = fmaxf(size.x, fmaxf(size.y, size.z));
        status = create(&job, &(struct setting){0}, 1, &solver, err);
    }
    if (status == LW_OK) {
        count_or_read(&job, solver, NULL, &job.texels, &job.blocks);
        solver->ops->destroy(solver);
        printf("\n### %s\n\n%zu texels, longest side %.3g m, 2 bounces, 2 bounce rays per texel and frame, "
               "%u frames.\n\n"
               "| range | spacing | form | projection | mean ratio | relMSE | 99 %% | frame ms | / inf | "
               "Mrays |\n"
               "|---|---|---|---|---|---|---|---|---|---|\n",
               bench_label(path, label, sizeof label), job.texels, (double)job.longest_m, job.frames);
        status = measure(&job, s, err);
    }
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 64};
    const struct lw_option table[] = {
        {"frames", "N", "frames of each solve (default 64)", LW_OPTION_INT, &s.frames, 2, 100000, NULL},
        {"quick", NULL, "the default form, spacing and projection only", LW_OPTION_FLAG, &s.quick, 0, 0,
         NULL},
        {"range", "R", "this tracing range alone, as a share of the longest side", LW_OPTION_REAL, &s.range,
         1e-3, 1, NULL},
        {"spacing", "S", "the default form and projection only, probes so far apart, likewise",
         LW_OPTION_REAL, &s.spacing, 1e-3, 1, NULL}};
    return bench_main(
        &(struct bench_program){.name = "bench_hybrid",
                                .about = "Bias and cost of tracing ranges, as tables in Markdown.",
                                .table = table,
                                .count = sizeof table / sizeof table[0],
                                .open = &s.open,
                                .context = &s,
                                .run = run},
        argc, argv);
}
