/* bench_codec: what tiles cost in each codec and what they lose, on light as the solver makes it.
 *
 *     bench_codec [--frames N] [--at SECONDS] SCENE...
 *
 * Each scene is solved as lightwelld does by default, at one moment; its tiles of all levels are taken after
 * 1, 16 and N frames, after eight further frames of movement, and after one more. One table
 * in Markdown per scene.
 *   bits      per texel that a look-up may read (the others cost what they cost, but nobody wants them)
 *   log-PSNR  of log2(1 + E/y0)/log2(101) over those texels, y0 = 1 % of white; white: the E that 99 % of
 *             values are under
 *   noise     the same between the tiles as they are, uncoded, and those of N frames: what the light itself
 *             is off
 *   largest   |dE| / (E + y0)
 *   mean      root mean square, and worst, over the tiles: relative change of the mean of E
 *   Mtexel/s  of CPU time of one thread, of all texels of the tiles
 * "step for 45 dB": of the tiles of N frames, the widest of the codec's steps, one for all tiles, with that
 * log-PSNR. "what changed": for a client that has the tile as it was a frame before, coded in the same way;
 * encoding makes both forms. */
#include "common/base/clock.h"
#include "common/tile/tile_codec.h"
#include "common/tile/tile_dct.h"
#include "server/publish/levels.h"
#include "server/publish/publisher.h"
#include "server/solve/filter/denoise.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#define MOVED_FRAMES 8u
#define MOVED_STEP_S (1.0 / 30)
#define SETS         5u
#define ROUND_NS     200000000u /* least time measured */
#define SOUGHT_DB    45.0

static const char *const set_name[SETS] = {"1 frame", "16 frames", "at rest", "moving", "a frame on"};

struct tile {
    uint32_t width, height, level;
    float error;
    float *rgb;
    uint8_t *covered;
    struct lw_tile_dct_history *before; /* a client's, after the set before; in the last set alone */
};

struct job {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_solver *solver;
    struct tile *set[SETS]; /* map.tile_count each; NULL: there is no such set */
    float y0;
};

/* ---- light ---- */

static void *copy(const void *from, size_t size) {
    void *to = malloc(size);
    return to ? memcpy(to, from, size) : NULL;
}

static enum lw_status take_object(struct job *job, uint32_t object, struct tile *set) {
    const struct lw_atlas *atlas = job->map.atlas[object];
    const uint32_t first = job->map.first_tile[object];
    float rgb[LW_TILE_TEXELS_MAX * 3];
    uint8_t covered[LW_TILE_TEXELS_MAX];
    struct lw_levels levels;
    enum lw_status status = lw_levels_init(&levels, LW_TILE_CHANNEL_FULL, atlas);
    if (status != LW_OK) return status;
    for (uint32_t i = first; i < first + atlas->tile_count && !job->map.place[i].level; i++) {
        struct lw_solver_tile tile;
        job->solver->ops->read_tile(job->solver, (lw_tile_id){i}, &tile);
        lw_levels_load_tile(&levels, &job->map.place[i], &tile);
    }
    if (atlas->tile_count) lw_levels_build(&levels);
    for (uint32_t i = first; status == LW_OK && i < first + atlas->tile_count; i++) {
        const struct lw_tile_place *place = &job->map.place[i];
        const size_t texels = (size_t)place->width * place->height;
        lw_levels_store_tile(&levels, place, rgb, covered);
        set[i] = (struct tile){place->width,
                               place->height,
                               place->level,
                               lw_publisher_error(&job->map, job->solver, (lw_tile_id){i}, NULL),
                               copy(rgb, texels * 3 * sizeof *rgb),
                               copy(covered, texels),
                               NULL};
        if (!set[i].rgb || !set[i].covered) status = LW_NO_MEMORY;
    }
    lw_levels_finish(&levels);
    return status;
}

static enum lw_status take_set(struct job *job, unsigned set) {
    job->set[set] = calloc((size_t)job->map.tile_count + 1, sizeof *job->set[set]);
    enum lw_status status = job->set[set] ? LW_OK : LW_NO_MEMORY;
    for (uint32_t o = 0; status == LW_OK && o < job->map.object_count; o++)
        status = take_object(job, o, job->set[set]);
    return status;
}

static enum lw_status solve(struct job *job, uint32_t frames, double at_s, struct lw_error *err) {
    enum lw_status status = LW_OK;
    struct lw_solver_stats stats;
    for (uint32_t frame = 1; status == LW_OK && frame <= frames + MOVED_FRAMES + 1; frame++) {
        if (frame > frames) lw_pose_evaluate(&job->pose, job->scene, at_s + (frame - frames) * MOVED_STEP_S);
        status = job->solver->ops->frame(job->solver, &job->pose, frame, &stats, err);
        if (frame > frames && !stats.moved) break;
        if (status == LW_OK && frame == 1) status = take_set(job, 0);
        if (status == LW_OK && frame == 16) status = take_set(job, 1);
        if (status == LW_OK && frame == frames) status = take_set(job, 2);
        if (status == LW_OK && frame == frames + MOVED_FRAMES) status = take_set(job, 3);
        if (status == LW_OK && frame == frames + MOVED_FRAMES + 1) status = take_set(job, 4);
    }
    return status;
}

static void drop_sets(struct job *job) {
    for (unsigned s = 0; s < SETS; s++) {
        for (uint32_t i = 0; job->set[s] && i < job->map.tile_count; i++) {
            free(job->set[s][i].rgb);
            free(job->set[s][i].covered);
            free(job->set[s][i].before);
        }
        free(job->set[s]);
    }
}

static int by_value(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static enum lw_status find_y0(struct job *job, const struct tile *set) {
    size_t count = 0, n = 0;
    for (uint32_t i = 0; i < job->map.tile_count; i++) count += (size_t)set[i].width * set[i].height * 3;
    float *value = malloc((count + 1) * sizeof *value);
    if (!value) return LW_NO_MEMORY;
    for (uint32_t i = 0; i < job->map.tile_count; i++)
        for (uint32_t t = 0; t < set[i].width * set[i].height; t++)
            for (uint32_t c = 0; set[i].covered[t] && c < 3; c++) value[n++] = set[i].rgb[t * 3 + c];
    qsort(value, n, sizeof *value, by_value);
    job->y0 = n ? 0.01f * value[(size_t)(0.99 * (double)n)] : 1;
    free(value);
    return LW_OK;
}

/* As the publisher has it. */
static float dark_of(const struct job *job) { return 100 * job->y0 * LW_PUBLISHER_DARK_SHARE; }

/* ---- the codecs, each as a pair of functions over one tile ---- */

struct coded {
    uint8_t bytes[LW_TILE_DCT_BOUND]; /* the largest of them all */
    size_t size;
    float scale;
    bool is_delta;
};

struct coder {
    struct lw_tile_codec *tile;
    struct lw_tile_dct_history history;
    struct lw_tile_dct_coefficients coefficients;
    uint8_t delta[LW_TILE_DCT_BOUND];
    ZSTD_CCtx *compress;
    ZSTD_DCtx *decompress;
    float dark;
    float y0;
    float step; /* sought_encode()'s */
    uint8_t planes[LW_TILE_TEXELS_MAX * 4];
};

static enum lw_status half_encode(struct coder *coder, const struct tile *tile, struct coded *out) {
    uint32_t saturated;
    return lw_tile_codec_encode_half(coder->tile, NULL, tile->rgb, tile->width, tile->height, out->bytes,
                                     sizeof out->bytes, &out->size, &out->scale, &saturated);
}

static enum lw_status half_decode(struct coder *coder, const struct coded *coded, const struct tile *tile,
                                  float *rgb) {
    return lw_tile_codec_decode(coder->tile, NULL, LW_TILE_CODEC_HALF_ZSTD, coded->bytes, coded->size,
                                coded->scale, tile->width, tile->height, NULL, rgb);
}

static enum lw_status dct_encode(struct coder *coder, const struct tile *tile, float step,
                                 struct coded *out) {
    struct lw_tile_dct_coded result;
    enum lw_status status =
        lw_tile_codec_encode_dct(coder->tile,
                                 &(struct lw_tile_dct_source){tile->rgb, tile->covered, tile->width,
                                                              tile->height, step, coder->dark, NULL},
                                 NULL, out->bytes, NULL, sizeof out->bytes, &result);
    out->size = result.size;
    out->scale = result.scale;
    return status;
}

/* As the publisher does. */
static enum lw_status noise_encode(struct coder *coder, const struct tile *tile, struct coded *out) {
    return dct_encode(
        coder, tile,
        lw_publisher_step(tile->error, LW_SOLVER_NOISE_SHOWN, tile->level, LW_PUBLISHER_STEP_WIDEST), out);
}

static enum lw_status change_encode(struct coder *coder, const struct tile *tile, struct coded *out) {
    struct lw_tile_dct_coded result;
    coder->history = *tile->before;
    enum lw_status status = lw_tile_codec_encode_dct(
        coder->tile,
        &(struct lw_tile_dct_source){
            tile->rgb, tile->covered, tile->width, tile->height,
            lw_publisher_step(tile->error, LW_SOLVER_NOISE_SHOWN, tile->level, LW_PUBLISHER_STEP_WIDEST),
            coder->dark, NULL},
        &coder->history, out->bytes, coder->delta, sizeof out->bytes, &result);
    out->is_delta = result.delta_size && result.delta_size < result.size;
    out->size = out->is_delta ? result.delta_size : result.size;
    out->scale = result.scale;
    if (out->is_delta) memcpy(out->bytes, coder->delta, out->size);
    return status;
}

static enum lw_status change_decode(struct coder *coder, const struct coded *coded, const struct tile *tile,
                                    float *rgb) {
    coder->coefficients = tile->before->coefficients;
    return (coded->is_delta ? lw_tile_codec_decode_delta : lw_tile_codec_decode)(
        coder->tile, NULL, LW_TILE_CODEC_DCT, coded->bytes, coded->size, coded->scale, tile->width,
        tile->height, &coder->coefficients, rgb);
}

/* What a client that was sent the set before has of it. */
static enum lw_status keep_history(struct coder *coder, struct coded *scratch, const struct tile *before,
                                   struct tile *tile) {
    struct lw_tile_dct_coded result;
    tile->before = aligned_alloc(_Alignof(struct lw_tile_dct_history), sizeof *tile->before);
    if (!tile->before) return LW_NO_MEMORY;
    memset(tile->before, 0, sizeof *tile->before);
    return lw_tile_codec_encode_dct(
        coder->tile,
        &(struct lw_tile_dct_source){
            before->rgb, before->covered, tile->width, tile->height,
            lw_publisher_step(before->error, LW_SOLVER_NOISE_SHOWN, tile->level, LW_PUBLISHER_STEP_WIDEST),
            coder->dark, NULL},
        tile->before, scratch->bytes, coder->delta, sizeof scratch->bytes, &result);
}

static enum lw_status coarse_encode(struct coder *coder, const struct tile *tile, struct coded *out) {
    return dct_encode(coder, tile, 0.5f, out);
}

static enum lw_status fine_encode(struct coder *coder, const struct tile *tile, struct coded *out) {
    return dct_encode(coder, tile, 0.125f, out);
}

static enum lw_status sought_encode(struct coder *coder, const struct tile *tile, struct coded *out) {
    return dct_encode(coder, tile, coder->step, out);
}

static enum lw_status dct_decode(struct coder *coder, const struct coded *coded, const struct tile *tile,
                                 float *rgb) {
    return lw_tile_codec_decode(coder->tile, NULL, LW_TILE_CODEC_DCT, coded->bytes, coded->size, coded->scale,
                                tile->width, tile->height, NULL, rgb);
}

/* Nine bits each over a shared exponent, as graphics processors read it, over a power of two; four byte
 * planes, zstd. */
static enum lw_status rgb9e5_encode(struct coder *coder, const struct tile *tile, struct coded *out) {
    const size_t texels = (size_t)tile->width * tile->height;
    float all = 0x1p-60f;
    int exponent;
    for (size_t i = 0; i < texels * 3; i++) all = fmaxf(all, tile->rgb[i]);
    frexpf(all, &exponent);
    out->scale = ldexpf(1, exponent - 15);
    for (size_t i = 0; i < texels; i++) {
        float p[3];
        for (unsigned c = 0; c < 3; c++) p[c] = tile->rgb[i * 3 + c] / out->scale;
        const float largest = fmaxf(fmaxf(p[0], p[1]), fmaxf(p[2], 0x1p-24f));
        frexpf(largest * (1 + 0x1p-10f), &exponent);
        exponent = exponent < -15 ? -15 : exponent > 16 ? 16 : exponent;
        uint32_t word = (uint32_t)(exponent + 15) << 27;
        for (unsigned c = 0; c < 3; c++) {
            const float mantissa = rintf(ldexpf(p[c], 9 - exponent));
            word |= (uint32_t)fminf(mantissa, 511) << 9 * c;
        }
        for (unsigned b = 0; b < 4; b++) coder->planes[b * texels + i] = (uint8_t)(word >> 8 * b);
    }
    out->size =
        ZSTD_compressCCtx(coder->compress, out->bytes, sizeof out->bytes, coder->planes, texels * 4, 1);
    return ZSTD_isError(out->size) ? LW_INTERNAL : LW_OK;
}

static enum lw_status rgb9e5_decode(struct coder *coder, const struct coded *coded, const struct tile *tile,
                                    float *rgb) {
    const size_t texels = (size_t)tile->width * tile->height;
    if (ZSTD_decompressDCtx(coder->decompress, coder->planes, sizeof coder->planes, coded->bytes,
                            coded->size) != texels * 4)
        return LW_BAD_DATA;
    for (size_t i = 0; i < texels; i++) {
        uint32_t word = 0;
        for (unsigned b = 0; b < 4; b++) word |= (uint32_t)coder->planes[b * texels + i] << 8 * b;
        const float unit = ldexpf(coded->scale, (int)(word >> 27) - 15 - 9);
        for (unsigned c = 0; c < 3; c++) rgb[i * 3 + c] = (float)(word >> 9 * c & 511) * unit;
    }
    return LW_OK;
}

static const struct codec {
    const char *name;
    enum lw_status (*encode)(struct coder *coder, const struct tile *tile, struct coded *out);
    enum lw_status (*decode)(struct coder *coder, const struct coded *coded, const struct tile *tile,
                             float *rgb);
} codecs[] = {
    {"half + zstd", half_encode, half_decode},        {"RGB9E5 + zstd", rgb9e5_encode, rgb9e5_decode},
    {"dct, step by noise", noise_encode, dct_decode}, {"dct, what changed", change_encode, change_decode},
    {"dct, step 1/2", coarse_encode, dct_decode},     {"dct, step 1/8", fine_encode, dct_decode}};

/* ---- what they cost and lose ---- */

struct loss {
    double square, largest, mean_square, mean_worst;
    size_t values, tiles;
};

static void add_loss(struct loss *loss, const struct tile *tile, const float *rgb, float y0) {
    double before = 0, after = 0;
    for (uint32_t t = 0; t < tile->width * tile->height; t++) {
        if (!tile->covered[t]) continue;
        for (uint32_t c = 0; c < 3; c++) {
            const float was = tile->rgb[t * 3 + c], is = rgb[t * 3 + c];
            const double off = (double)(log2f(1 + is / y0) - log2f(1 + was / y0)) / log2(101);
            loss->square += off * off;
            loss->largest = fmax(loss->largest, (double)(fabsf(is - was) / (was + y0)));
            loss->values++;
            before += (double)was;
            after += (double)is;
        }
    }
    if (before <= 0) return;
    const double mean = fabs(after / before - 1);
    loss->mean_square += mean * mean;
    loss->mean_worst = fmax(loss->mean_worst, mean);
    loss->tiles++;
}

static double decibel(const struct loss *loss) {
    return -10 * log10(loss->square / (double)(loss->values ? loss->values : 1));
}

struct figures {
    struct loss loss;
    size_t bytes, texels, covered;
    uint64_t encode_ns, decode_ns, rounds;
};

static enum lw_status measure(const struct job *job, const struct tile *set, const struct codec *codec,
                              struct coder *coder, struct coded *coded, struct figures *f) {
    float rgb[LW_TILE_TEXELS_MAX * 3];
    enum lw_status status = LW_OK;
    while (status == LW_OK && (f->encode_ns < ROUND_NS || f->decode_ns < ROUND_NS)) {
        uint64_t began = lw_clock_thread_cpu_ns();
        for (uint32_t i = 0; status == LW_OK && i < job->map.tile_count; i++)
            status = codec->encode(coder, &set[i], &coded[i]);
        const uint64_t encoded = lw_clock_thread_cpu_ns();
        for (uint32_t i = 0; status == LW_OK && i < job->map.tile_count; i++)
            status = codec->decode(coder, &coded[i], &set[i], rgb);
        f->encode_ns += encoded - began;
        f->decode_ns += lw_clock_thread_cpu_ns() - encoded;
        f->rounds++;
    }
    for (uint32_t i = 0; status == LW_OK && i < job->map.tile_count; i++) {
        const uint32_t texels = set[i].width * set[i].height;
        status = codec->decode(coder, &coded[i], &set[i], rgb);
        add_loss(&f->loss, &set[i], rgb, job->y0);
        f->bytes += coded[i].size;
        f->texels += texels;
        for (uint32_t t = 0; t < texels; t++) f->covered += set[i].covered[t] != 0;
    }
    return status;
}

static void print_row(const char *set, const char *noise, const char *codec, const struct figures *f) {
    const double moved = (double)(f->texels * f->rounds) * 1e3;
    printf("| %s | %s | %s | %.2f | %.1f | %.2g | %.2g / %.2g | %.0f / %.0f |\n", set, noise, codec,
           8 * (double)f->bytes / (double)f->covered, decibel(&f->loss), f->loss.largest,
           sqrt(f->loss.mean_square / (double)(f->loss.tiles ? f->loss.tiles : 1)), f->loss.mean_worst,
           moved / (double)f->encode_ns, moved / (double)f->decode_ns);
    fflush(stdout);
}

/* A little wider: the codec rounds steps down. */
static float step_of(uint32_t q) { return 1.0001f * exp2f(1 - (float)q / 8); }

/* The widest step of the codec that keeps SOUGHT_DB, and what it costs. */
static enum lw_status report_sought(const struct job *job, const struct tile *set, struct coder *coder,
                                    struct coded *coded) {
    const struct codec codec = {NULL, sought_encode, dct_decode};
    uint32_t coarse = 0, fine = LW_TILE_DCT_STEP_Q_MAX;
    while (coarse < fine) {
        const uint32_t q = (coarse + fine) / 2;
        struct figures f = {.encode_ns = ROUND_NS, .decode_ns = ROUND_NS};
        coder->step = step_of(q);
        for (uint32_t i = 0; i < job->map.tile_count; i++) {
            enum lw_status status = sought_encode(coder, &set[i], &coded[i]);
            if (status != LW_OK) return status;
        }
        enum lw_status status = measure(job, set, &codec, coder, coded, &f);
        if (status != LW_OK) return status;
        if (decibel(&f.loss) >= SOUGHT_DB)
            fine = q;
        else
            coarse = q + 1;
    }
    struct figures f = {0};
    coder->step = step_of(fine);
    enum lw_status status = measure(job, set, &codec, coder, coded, &f);
    char name[64];
    snprintf(name, sizeof name, "dct, step for %g dB: %.3f", SOUGHT_DB, (double)coder->step);
    if (status == LW_OK) print_row(set_name[2], "–", name, &f);
    return status;
}

static enum lw_status report(const struct job *job, struct coder *coder, struct coded *coded) {
    for (unsigned s = 0; s < SETS; s++) {
        char noise[32] = "–";
        if (!job->set[s]) continue;
        if (s < 2) {
            struct loss loss = {0};
            for (uint32_t i = 0; i < job->map.tile_count; i++)
                add_loss(&loss, &job->set[2][i], job->set[s][i].rgb, job->y0);
            snprintf(noise, sizeof noise, "%.1f", decibel(&loss));
        }
        enum lw_status status = LW_OK;
        for (uint32_t i = 0; status == LW_OK && s == SETS - 1 && i < job->map.tile_count; i++)
            status = keep_history(coder, coded, &job->set[s - 1][i], &job->set[s][i]);
        if (status != LW_OK) return status;
        for (size_t c = 0; c < sizeof codecs / sizeof *codecs; c++) {
            struct figures f = {0};
            if (s != SETS - 1 && codecs[c].encode == change_encode) continue;
            status = measure(job, job->set[s], &codecs[c], coder, coded, &f);
            if (status != LW_OK) return status;
            print_row(set_name[s], noise, codecs[c].name, &f);
        }
        if (s == 2 && (status = report_sought(job, job->set[s], coder, coded)) != LW_OK) return status;
    }
    return LW_OK;
}

static enum lw_status compare(const struct job *job, const char *path) {
    static struct coder coder;
    coder = (struct coder){
        .compress = ZSTD_createCCtx(), .decompress = ZSTD_createDCtx(), .dark = dark_of(job), .y0 = job->y0};
    struct coded *coded = malloc(((size_t)job->map.tile_count + 1) * sizeof *coded);
    char label[64];
    enum lw_status status = lw_tile_codec_create(&coder.tile);
    if (status == LW_OK && (!coder.compress || !coder.decompress || !coded)) status = LW_NO_MEMORY;
    if (status == LW_OK) {
        printf("\n### %s\n\n%u tiles; white %.3g W/m².\n\n"
               "| light | noise, dB | codec | bits | log-PSNR, dB | largest | mean, rms / worst | encode / "
               "decode, "
               "Mtexel/s |\n|---|---|---|---|---|---|---|---|\n",
               bench_label(path, label, sizeof label), job->map.tile_count, 100 * (double)job->y0);
        status = report(job, &coder, coded);
    }
    free(coded);
    lw_tile_codec_destroy(coder.tile);
    ZSTD_freeDCtx(coder.decompress);
    ZSTD_freeCCtx(coder.compress);
    return status;
}

struct settings {
    struct lw_scene_open open;
    int64_t frames;
    double at_s;
};

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    const struct settings *s = context;
    struct job job = {0};
    enum lw_status status =
        bench_open(&s->open, path, BENCH_MOTION_OWN, s->at_s, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK)
        status = lw_solvers_create(NULL,
                                   &(struct lw_solver_desc){.scene = job.scene,
                                                            .atlas_map = &job.map,
                                                            .bounces = 2,
                                                            .tracing_range_m = INFINITY,
                                                            .direct_samples = 1,
                                                            .indirect_samples = 2,
                                                            .target_error = -1,
                                                            .denoise = true,
                                                            .seed = 1},
                                   &job.pose, &job.solver, err);
    if (status == LW_OK) status = solve(&job, (uint32_t)s->frames, s->at_s, err);
    if (status == LW_OK) status = find_y0(&job, job.set[2]);
    if (status == LW_OK) status = compare(&job, path);
    drop_sets(&job);
    if (job.solver) job.solver->ops->destroy(job.solver);
    bench_close(job.scene, &job.pose, &job.map);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "%s", path);
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 256, .at_s = 3};
    const struct lw_option table[] = {
        BENCH_INT("frames", "of the solve, of 1 + 2 rays a texel, until light counts as clean (default 256)",
                  &s.frames, 17, 100000),
        {"at", "SECONDS", "moment of the scene's animation (default 3)", LW_OPTION_REAL, &s.at_s, 0, 1e9,
         NULL}};
    return BENCH_MAIN(argc, argv, table, .name = "bench_codec",
                      .about = "What tiles cost and lose in each codec, as tables.", .open = &s.open,
                      .context = &s);
}
