/* bench_seams: how far the two sides of lightmap seams differ where the viewer reads them, after more and
 * more frames.
 *
 *     bench_seams [--frames N] [--denoise] [--objects] [--codec|--bare] [--texels-per-metre D] SCENE...
 *
 * One table in Markdown per scene: after 16, 64, 256 ... frames, up to N, and for levels 0 to 2: mean and
 * median of the relative differences along all seams (tests/support/seam_walk.h), the shares of points within
 * 1 and 5 % and of those so dark that their differences are relative to a floor; with --objects also of each
 * object. Sewn: the sums before the weld, with what lies around a chart the mean of its neighbours there
 * (one texel, as Kahl 2023 sews them). In their place: with --codec the welded light as the lossy tile codec
 * leaves it; with --bare the sums in charts that black surrounds, and level 0 alone. "Light": mean of what is
 * read there, over the welded one's. On stderr: how far welding moves the mean light of an object. */
#include "common/tile/tile_codec.h"
#include "server/publish/publisher.h"
#include "server/solve/filter/denoise.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_setup.h"
#include "tests/support/seam_walk.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LEVELS 3u

struct settings {
    struct lw_scene_open open;
    int64_t frames;
    bool denoise, objects, codec, bare;
};

struct coded_solver;

struct job {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_seam_edges edges;
    struct lw_solver *solver;
    struct coded_solver *coded; /* NULL without --codec */
    enum seam_walk_light other; /* beside the welded one */
};

/* ---- a solver whose tiles went through the codec ---- */

struct coded_solver {
    struct lw_solver solver; /* first */
    struct lw_solver_ops ops;
    const struct lw_solver *inner;
    struct lw_tile_codec *codec;
    uint8_t *payload;
    float noise_shown;
    uint8_t covered[LW_TILE_TEXELS_MAX];
    float rgb[LW_TILE_TEXELS_MAX * 3], light[3][LW_TILE_TEXELS_MAX];
};

static void read_coded(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *tile) {
    struct coded_solver *coded = (struct coded_solver *)(uintptr_t)solver;
    coded->inner->ops->read_tile(coded->inner, id, tile);
    const uint32_t texels = tile->width * tile->height;
    for (uint32_t i = 0; i < texels; i++) {
        coded->covered[i] = tile->covered[i] || (tile->filled && tile->filled[i]);
        for (uint32_t c = 0; c < 3; c++) coded->rgb[i * 3 + c] = tile->shown[LW_LIGHT_FORM_FULL][c][i];
    }
    struct lw_tile_dct_coded result;
    enum lw_status status = lw_tile_codec_encode_dct(
        coded->codec,
        &(struct lw_tile_dct_source){
            .rgb = coded->rgb,
            .covered = coded->covered,
            .width = tile->width,
            .height = tile->height,
            .step = lw_publisher_step(tile->error, coded->noise_shown, 0, LW_PUBLISHER_STEP_WIDEST)},
        NULL, coded->payload, NULL, lw_tile_codec_bound(), &result);
    if (status == LW_OK)
        status = lw_tile_codec_decode(coded->codec, NULL, LW_TILE_CODEC_DCT, coded->payload, result.size,
                                      result.scale, tile->width, tile->height, NULL, coded->rgb);
    if (status != LW_OK) abort();
    for (uint32_t c = 0; c < 3; c++) {
        for (uint32_t i = 0; i < texels; i++) coded->light[c][i] = coded->rgb[i * 3 + c];
        tile->shown[LW_LIGHT_FORM_FULL][c] = coded->light[c];
    }
}

static enum lw_status coded_create(const struct lw_solver *inner, bool denoise,
                                   struct coded_solver **out_coded) {
    struct coded_solver *coded = calloc(1, sizeof *coded);
    if (!coded) return LW_NO_MEMORY;
    coded->inner = inner;
    coded->noise_shown = denoise ? LW_SOLVER_NOISE_SHOWN : 1;
    coded->ops = *inner->ops;
    coded->ops.read_tile = read_coded;
    coded->solver.ops = &coded->ops;
    coded->payload = malloc(lw_tile_codec_bound());
    enum lw_status status = coded->payload ? lw_tile_codec_create(&coded->codec) : LW_NO_MEMORY;
    if (status == LW_OK) {
        *out_coded = coded;
    } else {
        free(coded->payload);
        free(coded);
    }
    return status;
}

static void coded_destroy(struct coded_solver *coded) {
    if (!coded) return;
    lw_tile_codec_destroy(coded->codec);
    free(coded->payload);
    free(coded);
}

/* One row; without points, none. */
static enum lw_status report_row(const struct job *job, const char *name, unsigned level, uint32_t object) {
    struct seam_spread spread[2]; /* the other, welded */
    for (int welded = 0; welded < 2; welded++) {
        struct seam_walk walk;
        const bool coded = job->coded && !welded;
        enum lw_status status =
            seam_walk_init(&walk, job->scene, &job->map, coded ? &job->coded->solver : job->solver,
                           welded ? SEAM_WALK_WELDED : job->other);
        if (status != LW_OK) return status;
        status = seam_walk_measure(&walk, &job->edges, level, object, &spread[welded]);
        seam_walk_finish(&walk);
        if (status != LW_OK) return status;
    }
    if (spread[1].points)
        printf("| %s | %u | %zu | %.4f / %.4f | %.3f | %.4f / %.4f | %.1f %% | %.1f %% | %.1f %% |\n", name,
               level, spread[1].points, spread[0].mean, spread[0].p50, spread[0].light / spread[1].light,
               spread[1].mean, spread[1].p50, 100 * (1 - spread[1].over), 100 * (1 - spread[1].far_over),
               100 * spread[1].dark);
    fflush(stdout);
    return LW_OK;
}

static enum lw_status report(const struct job *job, uint32_t frames, bool objects) {
    char name[64];
    double scene_change, object_change;
    snprintf(name, sizeof name, "%u frames", frames);
    enum lw_status status = LW_OK;
    const unsigned levels = job->other == SEAM_WALK_BARE ? 1 : LEVELS;
    for (unsigned level = 0; status == LW_OK && level < levels; level++)
        status = report_row(job, name, level, LW_SCENE_NONE);
    for (uint32_t o = 0; objects && status == LW_OK && o < job->scene->object_count; o++)
        status = report_row(job, job->scene->object[o].name, 0, o);
    seam_walk_mean_change(&job->map, job->solver, &scene_change, &object_change);
    fprintf(stderr, "the mean of an object moves by up to %.2g %%\n", 100 * object_change);
    return status;
}

static enum lw_status solve(struct job *job, uint32_t frames, bool objects, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (uint32_t frame = 1, next = frames < 16 ? frames : 16; status == LW_OK && frame <= frames; frame++) {
        struct lw_solver_stats stats;
        status = job->solver->ops->frame(job->solver, &job->pose, frame, &stats, err);
        if (status != LW_OK || frame < next) continue;
        if ((status = report(job, frame, frame == frames && objects)) != LW_OK)
            return lw_status_fail(err, status, "walking the seams");
        next = 4 * next < frames ? 4 * next : frames;
    }
    return status;
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    const struct settings *s = context;
    struct job job = {.other = s->codec ? SEAM_WALK_WELDED : s->bare ? SEAM_WALK_BARE : SEAM_WALK_SEWN};
    char label[64];
    enum lw_status status =
        bench_open(&s->open, path, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = lw_seam_edges_find(job.scene, &job.pose, &job.edges);
    if (status == LW_OK)
        status = lw_solvers_create(NULL,
                                   &(struct lw_solver_desc){.scene = job.scene,
                                                            .atlas_map = &job.map,
                                                            .bounces = 2,
                                                            .tracing_range_m = INFINITY,
                                                            .direct_samples = 1,
                                                            .indirect_samples = 2,
                                                            .target_error = 1e-9f,
                                                            .denoise = s->denoise,
                                                            .seed = 1},
                                   &job.pose, &job.solver, err);
    if (status == LW_OK && s->codec) status = coded_create(job.solver, s->denoise, &job.coded);
    printf("\n### %s%s\n\n"
           "| after | level | points | %s mean / median | light | welded mean / median | within 1 %% | "
           "within 5 %% | dark |\n"
           "|---|---|---|---|---|---|---|---|---|\n",
           bench_label(path, label, sizeof label), s->denoise ? ", denoised" : "",
           s->codec  ? "coded"
           : s->bare ? "bare"
                     : "sewn");
    if (status == LW_OK) status = solve(&job, (uint32_t)s->frames, s->objects, err);
    coded_destroy(job.coded);
    if (job.solver) job.solver->ops->destroy(job.solver);
    lw_seam_edges_finish(&job.edges);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

static enum lw_status begin(void *context, struct lw_error *err) {
    const struct settings *s = context;
    return s->codec && s->bare ? lw_status_fail(err, LW_USAGE, "--bare excludes --codec") : LW_OK;
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 64};
    const struct lw_option table[] = {
        {"frames", "N", "of the solve, of 1 + 2 rays a texel (default 64)", LW_OPTION_INT, &s.frames, 1,
         100000, NULL},
        {"denoise", NULL, "filter what is shown, as lightwelld does", LW_OPTION_FLAG, &s.denoise, 0, 0, NULL},
        {"codec", NULL, "compare with what the lossy tile codec leaves, instead of with charts that are sewn",
         LW_OPTION_FLAG, &s.codec, 0, 0, NULL},
        {"bare", NULL, "compare with charts that black surrounds, instead", LW_OPTION_FLAG, &s.bare, 0, 0,
         NULL},
        {"objects", NULL, "a row for each object after the last frame", LW_OPTION_FLAG, &s.objects, 0, 0,
         NULL}};
    return bench_main(&(struct bench_program){.name = "bench_seams",
                                              .about = "How far the two sides of seams differ, as tables.",
                                              .table = table,
                                              .count = sizeof table / sizeof table[0],
                                              .open = &s.open,
                                              .begin = begin,
                                              .context = &s,
                                              .run = run},
                      argc, argv);
}
