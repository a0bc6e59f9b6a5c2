#include "server/solve/denoise.h"

#include "common/colour.h"

#include <stdlib.h>

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

/* 3 x 3 taps of (1/4, 1/2, 1/4) squared, without the middle: they sum to 3/4. */
static const float kernel[3][3] = {
    {0.0625f, 0.125f, 0.0625f}, {0.125f, 0, 0.125f}, {0.0625f, 0.125f, 0.0625f}};

enum lw_status lw_denoise_init(struct lw_denoise *denoise, const struct lw_scene *scene,
                               const struct lw_texels *texels, const struct lw_tiles *tiles) {
    *denoise = (struct lw_denoise){.scene = scene, .texels = texels, .tiles = tiles};
    for (int i = 0; i < 2; i++)
        if (!(denoise->value[i] = calloc((size_t)texels->count + 1, 4 * sizeof *denoise->value[i]))) {
            lw_denoise_finish(denoise);
            return LW_NO_MEMORY;
        }
    return LW_OK;
}

void lw_denoise_finish(struct lw_denoise *denoise) {
    free(denoise->value[0]);
    free(denoise->value[1]);
    *denoise = (struct lw_denoise){0};
}

/* One object at work. */
struct job {
    const struct lw_denoise *denoise;
    const struct lw_mesh_texels *mesh;
    uint32_t first;
    const uint8_t *covered; /* of the object's run */
    float texel_os;         /* side of a texel in object space, m: the mean over the mesh */
};

/* How far two texels may exchange light for their surfaces' sake, in [0, 1]; the same both ways. */
static float surface_weight(const struct job *job, uint32_t a, uint32_t b, float apart_max) {
    const struct lw_mesh_texels *mesh = job->mesh;
    const struct lw_vec3 na = lw_texels_vector(mesh->normal, a), nb = lw_texels_vector(mesh->normal, b);
    float w = fmaxf(0, lw_vec3_dot(na, nb));
    if (w < 0.8f) return 0;
    const struct lw_vec3 d =
        lw_vec3_sub(lw_texels_vector(mesh->position, b), lw_texels_vector(mesh->position, a));
    const float distance = lw_vec3_length(d);
    if (distance > apart_max) return 0;
    if (fabsf(lw_vec3_dot(na, d)) + fabsf(lw_vec3_dot(nb, d)) > 2 * PLANE_MAX * distance) return 0;
    for (int i = 0; i < NORMAL_SQUARINGS; i++) w *= w;
    return w;
}

static float luminance(const float *v) { return lw_colour_luminance(lw_vec3(v[0], v[1], v[2])); }

/* The mean distance of neighbours along rows: what a texel measures. */
static float texel_side(const struct lw_mesh_texels *mesh, const uint8_t *covered) {
    double sum = 0;
    uint32_t count = 0;
    for (uint32_t y = 0; y < mesh->height; y++)
        for (uint32_t x = 0; x + 1 < mesh->width; x++) {
            const uint32_t a = lw_texels_index(mesh, x, y), b = lw_texels_index(mesh, x + 1, y);
            if (!covered[a] || !covered[b] ||
                lw_vec3_dot(lw_texels_vector(mesh->normal, a), lw_texels_vector(mesh->normal, b)) < 0.99f)
                continue;
            sum += (double)lw_vec3_length(
                lw_vec3_sub(lw_texels_vector(mesh->position, a), lw_texels_vector(mesh->position, b)));
            count++;
        }
    return count ? (float)(sum / count) : 0;
}

/* Calls for the neighbours of a texel that are on the same piece of surface. */
#define EACH_NEIGHBOUR(job, x, y, step, i, j, n)                                                             \
    for (int j = -1; j <= 1; j++)                                                                            \
        for (int i = -1; i <= 1; i++)                                                                        \
            for (uint32_t n = neighbour(job, x, y, i * (int)(step), j * (int)(step)); n != LW_TEXEL_NONE;    \
                 n = LW_TEXEL_NONE)

static uint32_t neighbour(const struct job *job, uint32_t x, uint32_t y, int dx, int dy) {
    const int64_t nx = (int64_t)x + dx, ny = (int64_t)y + dy;
    if ((!dx && !dy) || nx < 0 || ny < 0 || nx >= job->mesh->width || ny >= job->mesh->height)
        return LW_TEXEL_NONE;
    const uint32_t n = lw_texels_index(job->mesh, (uint32_t)nx, (uint32_t)ny);
    return job->covered[n] ? n : LW_TEXEL_NONE;
}

/* Colours, and the variance of each texel's mean: its own over the frames, or, where these are few, half the mean
 * square of its differences to its neighbours. */
static void load_row(const struct job *job, const uint32_t *history_of_column, uint32_t y,
                     uint32_t history_max) {
    const struct lw_tiles *tiles = job->denoise->tiles;
    float *out = job->denoise->value[0] + (size_t)job->first * 4;
    for (uint32_t x = 0; x < job->mesh->width; x++) {
        const uint32_t t = lw_texels_index(job->mesh, x, y), texel = job->first + t;
        if (!job->covered[t]) continue;
        float *v = out + (size_t)t * 4;
        for (int c = 0; c < 3; c++) v[c] = tiles->direct[c][texel] + tiles->indirect[c][texel];
        const uint32_t all = history_of_column[x / LW_TILE_SIDE],
                       history = all < history_max ? all : history_max;
        if (history >= HISTORY_MIN) {
            v[3] = tiles->spread[texel] / (float)(history - 1);
            continue;
        }
        float square = 0, weights = 0;
        const float own = lw_colour_luminance(lw_vec3(v[0], v[1], v[2]));
        EACH_NEIGHBOUR(job, x, y, 1, i, j, n) {
            const float w = surface_weight(job, t, n, APART_MAX * job->texel_os);
            const uint32_t m = job->first + n;
            const float off = lw_colour_luminance(lw_vec3(tiles->direct[0][m] + tiles->indirect[0][m],
                                                          tiles->direct[1][m] + tiles->indirect[1][m],
                                                          tiles->direct[2][m] + tiles->indirect[2][m])) -
                              own;
            square += w * off * off;
            weights += w;
        }
        v[3] = weights > 0 ? 0.5f * square / weights : 0;
    }
}

/* The variance that edges are measured by: of a texel and its neighbours together, since one that has met no rare
 * bright sample yet believes itself without noise. */
static void smooth_variance_row(const struct job *job, uint32_t y, float *out) {
    const float *in = job->denoise->value[0] + (size_t)job->first * 4;
    for (uint32_t x = 0; x < job->mesh->width; x++) {
        const uint32_t t = lw_texels_index(job->mesh, x, y);
        if (!job->covered[t]) continue;
        float sum = in[(size_t)t * 4 + 3] * 0.25f, weights = 0.25f;
        EACH_NEIGHBOUR(job, x, y, 1, i, j, n) {
            const float w = kernel[j + 1][i + 1] * surface_weight(job, t, n, APART_MAX * job->texel_os);
            sum += w * in[(size_t)n * 4 + 3];
            weights += w;
        }
        for (int c = 0; c < 3; c++) out[(size_t)t * 4 + (size_t)c] = in[(size_t)t * 4 + (size_t)c];
        out[(size_t)t * 4 + 3] = sum / weights;
    }
}

static void filter_row(const struct job *job, uint32_t y, uint32_t step, const float *in, float *out) {
    for (uint32_t x = 0; x < job->mesh->width; x++) {
        const uint32_t t = lw_texels_index(job->mesh, x, y);
        if (!job->covered[t]) continue;
        const float *v = in + (size_t)t * 4;
        const float own = luminance(v);
        float change[3] = {0}, kept = 1, variance = 0;
        EACH_NEIGHBOUR(job, x, y, step, i, j, n) {
            const float *u = in + (size_t)n * 4;
            const float off = luminance(u) - own, noise = v[3] + u[3];
            const float limit = SIGMAS * SIGMAS * noise;
            if (!(off * off < limit)) continue; /* no noise: no exchange */
            /* Tukey's biweight: an edge far above the noise passes nothing at all. */
            const float tame = 1 - off * off / limit;
            const float w = kernel[j + 1][i + 1] * tame * tame *
                            surface_weight(job, t, n, APART_MAX * (float)step * job->texel_os);
            for (int c = 0; c < 3; c++) change[c] += w * (u[c] - v[c]);
            kept -= w;
            variance += w * w * u[3];
        }
        float *o = out + (size_t)t * 4;
        for (int c = 0; c < 3; c++) o[c] = v[c] + change[c];
        o[3] = variance + kept * kept * v[3];
    }
}

static bool solved(const struct lw_tiles *tiles, uint32_t object, uint64_t frame) {
    for (uint32_t i = 0; i < tiles->count; i++)
        if (tiles->tile[i].object == object && tiles->tile[i].solved_frame == frame) return true;
    return false;
}

/* Histories of the tiles of an object, by their place: rows of `columns`. */
static void list_histories(const struct lw_tiles *tiles, uint32_t object, uint32_t columns, uint32_t *out) {
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->object == object) out[tile->y * columns + tile->x] = tile->history;
    }
}

static void run_object(const struct job *job, const uint32_t *history, uint32_t history_max, int threads) {
    const struct lw_denoise *d = job->denoise;
    const uint32_t rows = job->mesh->height, columns = (job->mesh->width + LW_TILE_SIDE - 1) / LW_TILE_SIDE;
    float *a = d->value[0] + (size_t)job->first * 4, *b = d->value[1] + (size_t)job->first * 4;
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t y = 0; y < rows; y++) load_row(job, history + y / LW_TILE_SIDE * columns, y, history_max);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t y = 0; y < rows; y++) smooth_variance_row(job, y, b);
    for (uint32_t pass = 0; pass < LW_DENOISE_PASSES; pass++) {
        const float *in = pass % 2 ? a : b;
        float *out = pass % 2 ? b : a;
#pragma omp parallel for schedule(static) num_threads(threads)
        for (uint32_t y = 0; y < rows; y++) filter_row(job, y, 1u << pass, in, out);
    }
    const float *result = LW_DENOISE_PASSES % 2 ? a : b;
    for (uint32_t t = 0; t < job->mesh->texel_count; t++)
        for (uint32_t c = 0; c < 3 && job->covered[t]; c++)
            d->tiles->light[c][job->first + t] = result[(size_t)t * 4 + c];
}

void lw_denoise_run(const struct lw_denoise *denoise, uint64_t frame, uint32_t history_max, int threads) {
    const struct lw_scene *scene = denoise->scene;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (!solved(denoise->tiles, o, frame)) continue;
        const struct lw_mesh_texels *mesh = &denoise->texels->mesh[scene->object[o].mesh];
        const uint32_t columns = (mesh->width + LW_TILE_SIDE - 1) / LW_TILE_SIDE,
                       rows = (mesh->height + LW_TILE_SIDE - 1) / LW_TILE_SIDE;
        uint32_t *history = calloc((size_t)columns * rows, sizeof *history);
        if (!history) continue; /* unfiltered light is light */
        struct job job = {.denoise = denoise,
                          .mesh = mesh,
                          .first = denoise->texels->first[o],
                          .covered = denoise->texels->covered + denoise->texels->first[o]};
        job.texel_os = texel_side(mesh, job.covered);
        list_histories(denoise->tiles, o, columns, history);
        run_object(&job, history, history_max, threads);
        free(history);
    }
}
