#include "server/solve/denoise.h"

#include "common/colour.h"

#include <stdlib.h>
#include <string.h>

/* Luminance may differ by so many standard deviations of the difference before texels stop to exchange. */
#define SIGMAS 4.0f
/* Normals: cos^NORMAL_POWER, as in Schied et al. 2017. */
#define NORMAL_SQUARINGS 6 /* 2^6 = 64 */
/* Two texels a step apart lie that many of their steps' lengths apart in the world at most: the diagonal, and half. */
#define APART_MAX 2.2f
/* How far from each other's plane, in shares of their distance. */
#define PLANE_MAX 0.1f
/* Estimates fewer than this know too little of their own variance: the neighbours' differences stand in. */
#define HISTORY_MIN 4u
/* The variance of texels that exchange nothing: that of a pair stays negative. */
#define NO_PART (-1e30f)
/* Keeps a division by no noise at all finite. */
#define LIMIT_MIN 1e-30f
/* Rows and columns around an object's texels, so that the longest step stays inside the planes. */
#define MARGIN (1u << (LW_DENOISE_PASSES - 1))
/* Texels of a row whose sums are kept at a time: they stay in the nearest cache. */
#define RUN 256u

/* Texels of an object for whose sake workers are made to wait for each other. */
#define PARALLEL_MIN 32768u

/* Half of a texel's neighbours; the other half sees it as one of these. Taps of (1/4, 1/2, 1/4) squared. */
#define DIRECTIONS 4
static const struct direction {
    int dx, dy;
    float kernel;
} direction[DIRECTIONS] = {{1, 0, 0.125f}, {0, 1, 0.125f}, {1, 1, 0.0625f}, {-1, 1, 0.0625f}};

enum { R, G, B, Y, VARIANCE };
enum { SOLVED = 1, BESIDE = 2 };

static size_t stride_of(const struct lw_mesh_texels *mesh) { return (size_t)mesh->width + 2 * MARGIN; }
static size_t area_of(const struct lw_mesh_texels *mesh) {
    return stride_of(mesh) * ((size_t)mesh->height + 2 * MARGIN);
}
static uint32_t columns_of(const struct lw_mesh_texels *mesh) {
    return (mesh->width + LW_TILE_SIDE - 1) / LW_TILE_SIDE;
}
static uint32_t rows_of(const struct lw_mesh_texels *mesh) {
    return (mesh->height + LW_TILE_SIDE - 1) / LW_TILE_SIDE;
}

/* ---- geometry, once ------------------------------------------------------------------------------------------- */

/* How far two texels may exchange light for their surfaces' sake, in [0, 1]; the same both ways. */
static float surface_weight(const struct lw_mesh_texels *mesh, uint32_t a, uint32_t b, float apart_max) {
    const struct lw_vec3 na = lw_texels_vector(mesh->normal, a), nb = lw_texels_vector(mesh->normal, b);
    float w = fminf(1, lw_vec3_dot(na, nb));
    if (!(w >= 0.8f)) return 0;
    const struct lw_vec3 d =
        lw_vec3_sub(lw_texels_vector(mesh->position, b), lw_texels_vector(mesh->position, a));
    const float distance = lw_vec3_length(d);
    if (!(distance <= apart_max)) return 0;
    if (fabsf(lw_vec3_dot(na, d)) + fabsf(lw_vec3_dot(nb, d)) > 2 * PLANE_MAX * distance) return 0;
    for (int i = 0; i < NORMAL_SQUARINGS; i++) w *= w;
    return w;
}

/* The mean distance of neighbours along rows: what a texel measures in object space, m. */
static float texel_side(const struct lw_mesh_texels *mesh) {
    double sum = 0;
    uint32_t count = 0;
    for (uint32_t y = 0; y < mesh->height; y++)
        for (uint32_t x = 0; x + 1 < mesh->width; x++) {
            const uint32_t a = lw_texels_index(mesh, x, y), b = lw_texels_index(mesh, x + 1, y);
            if (!mesh->covered[a] || !mesh->covered[b] ||
                lw_vec3_dot(lw_texels_vector(mesh->normal, a), lw_texels_vector(mesh->normal, b)) < 0.99f)
                continue;
            sum += (double)lw_vec3_length(
                lw_vec3_sub(lw_texels_vector(mesh->position, a), lw_texels_vector(mesh->position, b)));
            count++;
        }
    return count ? (float)(sum / count) : 0;
}

static void weigh_row(const struct lw_mesh_texels *mesh, uint32_t y, uint32_t step, const struct direction *d,
                      float apart_max, uint8_t *out) {
    const int64_t ny = (int64_t)y + d->dy * (int64_t)step;
    for (uint32_t x = 0; x < mesh->width && ny < mesh->height; x++) {
        const int64_t nx = (int64_t)x + d->dx * (int64_t)step;
        if (nx < 0 || nx >= mesh->width) continue;
        const uint32_t a = lw_texels_index(mesh, x, y), b = lw_texels_index(mesh, (uint32_t)nx, (uint32_t)ny);
        if (mesh->covered[a] && mesh->covered[b])
            out[x] = (uint8_t)(surface_weight(mesh, a, b, apart_max) * 255 + 0.5f);
    }
}

static uint8_t *weigh_mesh(const struct lw_mesh_texels *mesh, int threads) {
    const size_t area = area_of(mesh);
    uint8_t *pair = calloc(LW_DENOISE_PASSES * DIRECTIONS, area);
    if (!pair) return NULL;
    const float side = texel_side(mesh);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t y = 0; y < mesh->height; y++)
        for (uint32_t k = 0; k < LW_DENOISE_PASSES * DIRECTIONS; k++) {
            const uint32_t step = 1u << k / DIRECTIONS;
            weigh_row(mesh, y, step, &direction[k % DIRECTIONS], APART_MAX * (float)step * side,
                      pair + k * area + (y + MARGIN) * stride_of(mesh) + MARGIN);
        }
    return pair;
}

static enum lw_status allocate(struct lw_denoise *d) {
    const struct lw_scene *scene = d->scene;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh_texels *mesh = &d->texels->mesh[scene->object[o].mesh];
        const size_t area = area_of(mesh), slots = (size_t)columns_of(mesh) * rows_of(mesh);
        if (area > d->plane_texels) d->plane_texels = area;
        if (slots > d->slots_max) d->slots_max = slots;
    }
    bool ok = (d->pair = calloc((size_t)scene->mesh_count + 1, sizeof *d->pair)) != NULL;
    ok &= (d->slot = calloc(d->slots_max + 1, sizeof *d->slot)) != NULL;
    ok &= (d->part = calloc(d->slots_max + 1, sizeof *d->part)) != NULL;
    ok &= (d->object_slot = calloc((size_t)d->tiles->count + 1, sizeof *d->object_slot)) != NULL;
    ok &= (d->object_first = calloc((size_t)scene->object_count + 2, sizeof *d->object_first)) != NULL;
    for (int i = 0; i < 2; i++)
        for (int p = 0; p < LW_DENOISE_PLANES; p++)
            ok &= (d->plane[i][p] = calloc(d->plane_texels + 1, sizeof *d->plane[i][p])) != NULL;
    return ok ? LW_OK : LW_NO_MEMORY;
}

enum lw_status lw_denoise_init(struct lw_denoise *denoise, const struct lw_scene *scene,
                               const struct lw_texels *texels, const struct lw_tiles *tiles, int threads) {
    *denoise = (struct lw_denoise){.scene = scene, .texels = texels, .tiles = tiles};
    enum lw_status status = allocate(denoise);
    for (uint32_t o = 0; status == LW_OK && o < scene->object_count; o++) {
        const uint32_t m = scene->object[o].mesh;
        if (denoise->pair[m] || !texels->mesh[m].texel_count) continue;
        if (!(denoise->pair[m] = weigh_mesh(&texels->mesh[m], threads))) status = LW_NO_MEMORY;
        denoise->pair_bytes += LW_DENOISE_PASSES * DIRECTIONS * area_of(&texels->mesh[m]);
    }
    if (status != LW_OK) lw_denoise_finish(denoise);
    return status;
}

void lw_denoise_finish(struct lw_denoise *denoise) {
    for (uint32_t m = 0; denoise->pair && m < denoise->scene->mesh_count; m++) free(denoise->pair[m]);
    free(denoise->pair);
    free(denoise->slot);
    free(denoise->part);
    free(denoise->object_slot);
    free(denoise->object_first);
    for (int i = 0; i < 2; i++)
        for (int p = 0; p < LW_DENOISE_PLANES; p++) free(denoise->plane[i][p]);
    *denoise = (struct lw_denoise){0};
}

size_t lw_denoise_memory_bytes(const struct lw_denoise *denoise) {
    return denoise->pair_bytes + 2 * LW_DENOISE_PLANES * sizeof(float) * denoise->plane_texels;
}

/* ---- one object ----------------------------------------------------------------------------------------------- */

struct planes {
    float *p[LW_DENOISE_PLANES];
};

struct job {
    const struct lw_denoise *denoise;
    const struct lw_mesh_texels *mesh;
    const uint8_t *pair;
    uint32_t first, columns; /* global index of its first texel; tiles in a row */
    size_t stride, area;
};

/* One of a texel's eight neighbours in a pass: how far away in the planes, and where the pair's weight is found. */
struct tap {
    ptrdiff_t offset, weight; /* weight: relative to the texel, in job->pair */
    float kernel;             /* of a weight of 1/255 */
};

static void list_taps(const struct job *job, uint32_t pass, struct tap out_tap[2 * DIRECTIONS]) {
    for (int k = 0; k < DIRECTIONS; k++) {
        const ptrdiff_t offset =
            ((ptrdiff_t)direction[k].dy * (ptrdiff_t)job->stride + direction[k].dx) * ((ptrdiff_t)1 << pass);
        const ptrdiff_t weight = (ptrdiff_t)((pass * DIRECTIONS + (uint32_t)k) * job->area);
        const float kernel = direction[k].kernel / 255;
        out_tap[2 * k] = (struct tap){offset, weight, kernel};
        out_tap[2 * k + 1] = (struct tap){-offset, weight - offset, kernel};
    }
}

/* The runs of a row that lie in one block each are runs of memory. */
#define EACH_RUN(job, y, x, n, t)                                                                            \
    for (uint32_t x = 0, n, t;                                                                               \
         x < (job)->mesh->width &&                                                                           \
         (n = (job)->mesh->width - x < LW_TILE_BLOCK ? (job)->mesh->width - x : LW_TILE_BLOCK,               \
         t = lw_texels_index((job)->mesh, x, y), true);                                                      \
         x += LW_TILE_BLOCK)

static const struct lw_solve_tile *tile_at(const struct job *job, uint32_t x, uint32_t y) {
    const struct lw_denoise *d = job->denoise;
    return &d->tiles->tile[d->slot[y / LW_TILE_SIDE * job->columns + x / LW_TILE_SIDE]];
}

/* Frames that the sums of a texel's block stand for. */
static float remembered_at(const struct job *job, uint32_t x, uint32_t y) {
    return lw_tiles_block(tile_at(job, x, y), x % LW_TILE_SIDE, y % LW_TILE_SIDE)->indirect.frames;
}

static size_t place(const struct job *job, uint32_t x, uint32_t y) {
    return (y + MARGIN) * job->stride + x + MARGIN;
}

/* Colours, and the variance of each texel's mean over the frames. */
static void load_row(const struct job *job, const struct planes *out, uint32_t y) {
    const struct lw_tiles *tiles = job->denoise->tiles;
    EACH_RUN(job, y, x, n, t) {
        const bool quiet = tile_at(job, x, y)->error <= LW_DENOISE_QUIET;
        const float remembered = remembered_at(job, x, y);
        const float per_frame = remembered >= HISTORY_MIN ? 1 / (remembered - 1) : 0;
        const size_t from = job->first + t, to = place(job, x, y);
        const uint8_t *covered = tiles->covered + from;
        for (uint32_t i = 0; i < n; i++) {
            float v[3];
            for (int c = 0; c < 3; c++)
                out->p[c][to + i] = v[c] = tiles->direct[c][from + i] + tiles->indirect[c][from + i];
            const float own = lw_colour_luminance(lw_vec3(v[0], v[1], v[2]));
            out->p[Y][to + i] = covered[i] ? own : -1;
            out->p[VARIANCE][to + i] = quiet || !covered[i] ? NO_PART : tiles->spread[from + i] * per_frame;
        }
    }
}

/* Where frames are few: half the mean square of the differences to the neighbours. */
static void guess_row(const struct job *job, const struct planes *v, const struct tap *tap, uint32_t y) {
    EACH_RUN(job, y, x, n, t) {
        (void)t;
        if (remembered_at(job, x, y) >= HISTORY_MIN) continue;
        for (size_t i = place(job, x, y), end = i + n; i < end; i++) {
            if (v->p[VARIANCE][i] < 0) continue;
            const float *y_of = v->p[Y] + i;
            float square = 0, weights = 0;
            for (int k = 0; k < 2 * DIRECTIONS; k++) {
                const float there = y_of[tap[k].offset], off = there - y_of[0];
                const float w = there < 0 ? 0 : (float)*(job->pair + (ptrdiff_t)i + tap[k].weight);
                square += w * off * off;
                weights += w;
            }
            v->p[VARIANCE][i] = weights > 0 ? 0.5f * square / weights : 0;
        }
    }
}

/* The variance that edges are measured by: of a texel and its neighbours together, since one that has met no rare
 * bright sample yet believes itself without noise. */
static void smooth_row(const struct job *job, const float *in, float *out, const struct tap *tap,
                       uint32_t y) {
    float sum[RUN], weights[RUN];
    for (uint32_t x = 0; x < job->mesh->width; x += RUN) {
        const uint32_t n = job->mesh->width - x < RUN ? job->mesh->width - x : RUN;
        const size_t at = place(job, x, y);
        for (uint32_t i = 0; i < n; i++) {
            sum[i] = 0.25f * in[at + i];
            weights[i] = 0.25f;
        }
        for (int k = 0; k < 2 * DIRECTIONS; k++) {
            const float *there = in + at + tap[k].offset, kernel = tap[k].kernel;
            const uint8_t *pair = job->pair + (ptrdiff_t)at + tap[k].weight;
#pragma omp simd
            for (uint32_t i = 0; i < n; i++) {
                const float w = there[i] < 0 ? 0 : kernel * (float)pair[i];
                sum[i] += w * there[i];
                weights[i] += w;
            }
        }
#pragma omp simd
        for (uint32_t i = 0; i < n; i++) out[at + i] = in[at + i] < 0 ? NO_PART : sum[i] / weights[i];
    }
}

/* What a run of texels gets from its neighbours in one direction. (Inlined, gcc 12 makes no vectors of it.) */
static void exchange(const struct planes *in, size_t at, const struct tap *tap, const uint8_t *pair,
                     uint32_t n, float sum[LW_DENOISE_PLANES][RUN]) __attribute__((noinline));
static void exchange(const struct planes *in, size_t at, const struct tap *tap, const uint8_t *pair,
                     uint32_t n, float sum[LW_DENOISE_PLANES][RUN]) {
    const float *r = in->p[R] + at, *g = in->p[G] + at, *b = in->p[B] + at, *own = in->p[Y] + at,
                *variance = in->p[VARIANCE] + at;
    const ptrdiff_t o = tap->offset;
    const float *r_of = r + o, *g_of = g + o, *b_of = b + o, *y_of = own + o, *variance_of = variance + o;
    float *restrict sr = sum[R], *restrict sg = sum[G], *restrict sb = sum[B], *restrict sw = sum[Y],
                    *restrict sv = sum[VARIANCE];
    const float kernel = tap->kernel;
#pragma omp simd
    for (uint32_t i = 0; i < n; i++) {
        const float off = y_of[i] - own[i], square = off * off;
        const float limit = SIGMAS * SIGMAS * (variance[i] + variance_of[i]);
        /* Tukey's biweight: an edge far above the noise passes nothing at all, and without noise there is no exchange.
         * (A division under a condition would keep the loop from being made of vectors.) */
        const float divisor = limit > LIMIT_MIN ? limit : LIMIT_MIN;
        const float tame = 1 - (square < limit ? square : divisor) / divisor;
        const float w = kernel * (float)pair[i] * (tame * tame);
        sr[i] += w * (r_of[i] - r[i]);
        sg[i] += w * (g_of[i] - g[i]);
        sb[i] += w * (b_of[i] - b[i]);
        sw[i] += w;
        sv[i] += w * w * variance_of[i];
    }
}

static void filter_row(const struct job *job, const struct planes *in, const struct planes *out,
                       const struct tap *tap, uint32_t y) {
    float sum[LW_DENOISE_PLANES][RUN];
    for (uint32_t x = 0; x < job->mesh->width; x += RUN) {
        const uint32_t n = job->mesh->width - x < RUN ? job->mesh->width - x : RUN;
        const size_t at = place(job, x, y);
        memset(sum, 0, sizeof sum);
        for (int k = 0; k < 2 * DIRECTIONS; k++)
            exchange(in, at, &tap[k], job->pair + (ptrdiff_t)at + tap[k].weight, n, sum);
        for (uint32_t i = 0; i < n; i++) {
            const float variance = in->p[VARIANCE][at + i], kept = 1 - sum[Y][i];
            float v[3];
            for (int c = 0; c < 3; c++) out->p[c][at + i] = v[c] = in->p[c][at + i] + sum[c][i];
            out->p[Y][at + i] = lw_colour_luminance(lw_vec3(v[0], v[1], v[2]));
            out->p[VARIANCE][at + i] = variance < 0 ? NO_PART : sum[VARIANCE][i] + kept * kept * variance;
        }
    }
}

static void store_row(const struct job *job, const struct planes *in, uint32_t y) {
    const struct lw_tiles *tiles = job->denoise->tiles;
    EACH_RUN(job, y, x, n, t) {
        if (!job->denoise->part[y / LW_TILE_SIDE * job->columns + x / LW_TILE_SIDE]) continue;
        const size_t to = job->first + t, from = place(job, x, y);
        for (uint32_t i = 0; i < n; i++)
            for (int c = 0; c < 3 && tiles->covered[to + i]; c++)
                tiles->light[c][to + i] = in->p[c][from + i];
    }
}

static void run_object(const struct job *job, int threads) {
    const struct lw_denoise *d = job->denoise;
    const uint32_t rows = job->mesh->height;
    struct planes a, b;
    memcpy(a.p, d->plane[0], sizeof a.p);
    memcpy(b.p, d->plane[1], sizeof b.p);
    struct tap tap[LW_DENOISE_PASSES][2 * DIRECTIONS];
    for (uint32_t pass = 0; pass < LW_DENOISE_PASSES; pass++) list_taps(job, pass, tap[pass]);
    if ((size_t)job->mesh->width * rows < PARALLEL_MIN) threads = 1;
#pragma omp parallel num_threads(threads)
    {
#pragma omp for schedule(static)
        for (uint32_t y = 0; y < rows; y++) load_row(job, &a, y);
#pragma omp for schedule(static)
        for (uint32_t y = 0; y < rows; y++) guess_row(job, &a, tap[0], y);
#pragma omp for schedule(static)
        for (uint32_t y = 0; y < rows; y++) smooth_row(job, a.p[VARIANCE], b.p[VARIANCE], tap[0], y);
        /* The smoothed variance goes with the colours that it was made from. */
        struct planes in = a, out = b;
        in.p[VARIANCE] = b.p[VARIANCE];
        out.p[VARIANCE] = a.p[VARIANCE];
        for (uint32_t pass = 0; pass < LW_DENOISE_PASSES; pass++) {
#pragma omp for schedule(static)
            for (uint32_t y = 0; y < rows; y++) filter_row(job, &in, &out, tap[pass], y);
            const struct planes swap = in;
            in = out;
            out = swap;
        }
#pragma omp for schedule(static)
        for (uint32_t y = 0; y < rows; y++) store_row(job, &in, y);
    }
}

/* ---- which objects and tiles ---------------------------------------------------------------------------------- */

/* Tiles are sorted anew whenever something moves. */
static void sort_by_object(struct lw_denoise *d) {
    const struct lw_tiles *tiles = d->tiles;
    uint32_t *first = d->object_first;
    memset(first, 0, ((size_t)d->scene->object_count + 2) * sizeof *first);
    for (uint32_t i = 0; i < tiles->count; i++) first[tiles->tile[i].object + 2]++;
    for (uint32_t o = 0; o < d->scene->object_count; o++) first[o + 2] += first[o + 1];
    for (uint32_t i = 0; i < tiles->count; i++) d->object_slot[first[tiles->tile[i].object + 1]++] = i;
}

/* Finds what each tile of an object does. The filter reaches 7 texels far, its variance two more: a tile is changed by
 * those beside it. False: nothing is to be done. */
static bool find_parts(struct lw_denoise *d, uint32_t object, uint32_t columns, uint32_t rows,
                       uint64_t frame) {
    bool solved = false, noisy = false;
    memset(d->part, 0, (size_t)columns * rows);
    for (uint32_t k = d->object_first[object]; k < d->object_first[object + 1]; k++) {
        const uint32_t i = d->object_slot[k];
        const struct lw_solve_tile *tile = &d->tiles->tile[i];
        d->slot[tile->y * columns + tile->x] = i;
        noisy |= tile->covered_count && tile->error > LW_DENOISE_QUIET;
        if (frame != LW_DENOISE_ALL && tile->solved_frame != frame) continue;
        d->part[tile->y * columns + tile->x] = SOLVED;
        solved = true;
    }
    if (!solved || !noisy) return false;
    for (uint32_t y = 0; y < rows; y++)
        for (uint32_t x = 0; x < columns; x++) {
            if (d->part[y * columns + x] != SOLVED) continue;
            for (uint32_t v = y ? y - 1 : 0; v <= y + 1 && v < rows; v++)
                for (uint32_t u = x ? x - 1 : 0; u <= x + 1 && u < columns; u++)
                    d->part[v * columns + u] |= d->part[v * columns + u] ? 0 : BESIDE;
        }
    return true;
}

void lw_denoise_run(struct lw_denoise *denoise, uint64_t frame, int threads) {
    const struct lw_scene *scene = denoise->scene;
    sort_by_object(denoise);
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const uint32_t m = scene->object[o].mesh;
        const struct lw_mesh_texels *mesh = &denoise->texels->mesh[m];
        const uint32_t columns = columns_of(mesh), rows = rows_of(mesh);
        if (!denoise->pair[m] || !find_parts(denoise, o, columns, rows, frame)) continue;
        run_object(&(struct job){.denoise = denoise,
                                 .mesh = mesh,
                                 .pair = denoise->pair[m],
                                 .first = denoise->texels->first[o],
                                 .columns = columns,
                                 .stride = stride_of(mesh),
                                 .area = area_of(mesh)},
                   threads);
        for (uint32_t i = 0; frame != LW_DENOISE_ALL && i < columns * rows; i++)
            if (denoise->part[i] == BESIDE && denoise->tiles->tile[denoise->slot[i]].covered_count)
                denoise->tiles->tile[denoise->slot[i]].solved_frame = frame;
    }
}
