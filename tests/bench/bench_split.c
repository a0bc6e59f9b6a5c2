/* bench_split: what tiles cost with and without the direct light that clients draw, by the codec's step.
 *
 *     bench_split [--frames N] [--at SECONDS] SCENE...
 *
 * Each scene is solved as lightwelld does by default, at one moment; its tiles of levels 0 to 2 are taken
 * in both forms.
 *   bits      per texel that a look-up may read
 *   log-PSNR  of log2(1 + E/y0)/log2(101) over those texels, y0 = 1 % of white. E is all light in either
 *             form: what a client draws is added to both sides, without an error of its own */
#include "common/light/client_lights.h"
#include "common/tile/tile_codec.h"
#include "server/publish/levels.h"
#include "server/publish/publisher.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const float steps[] = {0.05f, 0.07f, 0.1f, 0.125f, 0.14f, 0.16f, 0.2f};

struct job {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_client_lights client_lights;
    struct lw_solver *solver;
    struct lw_levels *levels[LW_LIGHT_FORM_COUNT]; /* per object */
    struct lw_tile_codec *codec;
    float white;
};

static enum lw_status build_levels(struct job *job, enum lw_light_form form) {
    const struct lw_atlas_map *map = &job->map;
    struct lw_levels *levels = job->levels[form] = calloc((size_t)map->object_count + 1, sizeof *levels);
    enum lw_status status = levels ? LW_OK : LW_NO_MEMORY;
    for (uint32_t o = 0; status == LW_OK && o < map->object_count; o++)
        status = lw_levels_init(&levels[o], form, &map->atlas[o]);
    for (uint32_t id = 0; status == LW_OK && id < map->tile_count; id++) {
        struct lw_solver_tile tile;
        if (map->place[id].level) continue;
        job->solver->ops->read_tile(job->solver, (lw_tile_id){id}, &tile);
        lw_levels_load_tile(&levels[map->place[id].object], &map->place[id], &tile);
    }
    for (uint32_t o = 0; status == LW_OK && o < map->object_count; o++)
        if (map->atlas[o].level_count) lw_levels_build(&levels[o]);
    return status;
}

static void find_white(struct job *job) {
    uint64_t bin[LW_LEVELS_BINS] = {0};
    for (uint32_t o = 0; o < job->map.object_count; o++)
        if (!job->pose.object_hidden[o]) lw_levels_count_values(&job->levels[LW_LIGHT_FORM_FULL][o], bin);
    job->white = lw_levels_quantile(bin, LW_PUBLISHER_WHITE_QUANTILE);
}

struct figures {
    double bits, square;
    size_t texels;
};

static enum lw_status measure_tile(const struct job *job, uint32_t id, enum lw_light_form form, float step,
                                   struct figures *f) {
    static float all[LW_TILE_TEXELS_MAX * 3], of[LW_TILE_TEXELS_MAX * 3], decoded[LW_TILE_TEXELS_MAX * 3];
    static uint8_t covered[LW_TILE_TEXELS_MAX], payload[LW_TILE_DCT_BOUND];
    const struct lw_tile_place *place = &job->map.place[id];
    const float y0 = 0.01f * job->white;
    struct lw_tile_dct_coded coded;
    lw_levels_store_tile(&job->levels[LW_LIGHT_FORM_FULL][place->object], place, all, covered);
    lw_levels_store_tile(&job->levels[form][place->object], place, of, covered);
    enum lw_status status =
        lw_tile_codec_encode_dct(job->codec,
                                 &(struct lw_tile_dct_source){of, covered, place->width, place->height, step,
                                                              LW_PUBLISHER_DARK_SHARE * job->white, NULL},
                                 NULL, payload, NULL, sizeof payload, &coded);
    if (status == LW_OK)
        status = lw_tile_codec_decode(job->codec, NULL, LW_TILE_CODEC_DCT, payload, coded.size, coded.scale,
                                      place->width, place->height, NULL, decoded);
    f->bits += 8 * (double)coded.size;
    for (uint32_t i = 0; status == LW_OK && i < place->width * place->height; i++) {
        if (!covered[i]) continue;
        f->texels++;
        for (uint32_t c = 3 * i; c < 3 * i + 3; c++) {
            const float is = fmaxf(all[c] + decoded[c] - of[c], 0);
            const double off = (double)(log2f(1 + is / y0) - log2f(1 + all[c] / y0)) / log2(101);
            f->square += off * off;
        }
    }
    return status;
}

static enum lw_status report(const struct job *job, const char *path) {
    char label[64];
    printf("\n### %s\n\n| step | bits, all light | dB | bits, without what clients draw | dB "
           "|\n|---|---|---|---|---|\n",
           bench_label(path, label, sizeof label));
    enum lw_status status = LW_OK;
    for (size_t s = 0; status == LW_OK && s < sizeof steps / sizeof *steps; s++) {
        printf("| %.3g ", (double)steps[s]);
        for (unsigned form = 0; status == LW_OK && form < LW_LIGHT_FORM_COUNT; form++) {
            struct figures f = {0};
            for (uint32_t id = 0; status == LW_OK && id < job->map.tile_count; id++)
                if (job->map.place[id].level <= LW_ATLAS_READ_MAX)
                    status = measure_tile(job, id, (enum lw_light_form)form, steps[s], &f);
            printf("| %.2f | %.1f ", f.bits / (double)f.texels,
                   -10 * log10(f.square / (3 * (double)f.texels)));
        }
        printf("|\n");
    }
    return status;
}

struct settings {
    struct lw_scene_open open;
    int64_t frames;
    double at_s;
};

static enum lw_status solve(struct job *job, int64_t frames, struct lw_error *err) {
    enum lw_status status = lw_client_lights_init(&job->client_lights, job->scene, &job->pose, "auto", err);
    if (status == LW_OK)
        status = lw_solvers_create(NULL,
                                   &(struct lw_solver_desc){.scene = job->scene,
                                                            .atlas_map = &job->map,
                                                            .client_lights = &job->client_lights,
                                                            .bounces = 2,
                                                            .tracing_range_m = INFINITY,
                                                            .direct_samples = 1,
                                                            .indirect_samples = 2,
                                                            .target_error = -1,
                                                            .denoise = true,
                                                            .seed = 1},
                                   &job->pose, &job->solver, err);
    if (status != LW_OK) return status;
    if (!lw_client_lights_any(&job->client_lights))
        return lw_status_fail(err, LW_USAGE, "clients draw no light of it");
    job->solver->ops->show(job->solver, 1u << LW_LIGHT_FORM_FULL | 1u << LW_LIGHT_FORM_SPLIT);
    for (int64_t frame = 1; status == LW_OK && frame <= frames; frame++) {
        struct lw_solver_stats stats;
        status = job->solver->ops->frame(job->solver, &job->pose, (uint64_t)frame, &stats, err);
    }
    return status;
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    const struct settings *s = context;
    struct job job = {0};
    enum lw_status status =
        bench_open(&s->open, path, BENCH_MOTION_OWN, s->at_s, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = solve(&job, s->frames, err);
    for (unsigned f = 0; status == LW_OK && f < LW_LIGHT_FORM_COUNT; f++)
        status = build_levels(&job, (enum lw_light_form)f);
    if (status == LW_OK) status = lw_tile_codec_create(&job.codec);
    if (status == LW_OK) {
        find_white(&job);
        status = report(&job, path);
    }
    lw_tile_codec_destroy(job.codec);
    for (unsigned f = 0; f < LW_LIGHT_FORM_COUNT; f++) {
        for (uint32_t o = 0; job.levels[f] && o < job.map.object_count; o++)
            lw_levels_finish(&job.levels[f][o]);
        free(job.levels[f]);
    }
    if (job.solver) job.solver->ops->destroy(job.solver);
    lw_client_lights_finish(&job.client_lights);
    bench_close(job.scene, &job.pose, &job.map);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "%s", path);
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 64, .at_s = 3};
    const struct lw_option table[] = {{"frames", "N", "of the solve, of 1 + 2 rays a texel (default 64)",
                                       LW_OPTION_INT, &s.frames, 1, 100000, NULL},
                                      {"at", "SECONDS", "moment of the scene's animation (default 3)",
                                       LW_OPTION_REAL, &s.at_s, 0, 1e9, NULL}};
    return bench_main(
        &(struct bench_program){
            .name = "bench_split",
            .about = "What tiles cost with and without the direct light that clients draw, as tables.",
            .table = table,
            .count = sizeof table / sizeof table[0],
            .open = &s.open,
            .context = &s,
            .run = run},
        argc, argv);
}
