#include "server/solve/filter/denoise.h"

#include "common/base/colour.h"
#include "common/base/invariant.h"
#include "common/base/wide.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* Luminance may differ by this many standard deviations of the difference before texels stop to exchange. */
#define SIGMAS 4.0f
/* SPLIT has no edges of client-drawn light: few frames measure its noise badly, and may find too little of
 * it. By 1 + this / frames more, most of its error after one to four frames goes
 * (docs/lab/denoise.md). */
#define SPLIT_WIDER 2.0f
/* Normals: cos^NORMAL_POWER, as in Schied et al. 2017. */
#define NORMAL_SQUARINGS 6 /* 2^6 = 64 */
/* Two texels a step apart lie that many of their steps' lengths apart in the world at
 * most: the diagonal, and half. */
#define APART_MAX 2.2f
/* How far from each other's plane, in shares of their distance. */
#define PLANE_MAX 0.1f
/* Fewer estimates than this know nothing of their own variance: the neighbours' differences stand in. */
#define HISTORY_MIN 2u
/* There, direct light counts for at most this many times what indirect light does, if there is any: where it
 * differs by more, that is the edge of a shadow. */
#define DIRECT_MAX 10.0f
/* The variance of texels that exchange nothing: that of a pair stays negative. */
#define NO_PART (-1e30f)
/* Until it is guessed. */
#define UNKNOWN 1e30f
/* Rows and columns around a mesh's weights, so that the longest step stays inside them. */
#define MARGIN (1u << (LW_DENOISE_PASSES - 1))

/* Planes hold a tile and what the filter reads around it. Rows are worked on by whole vectors: what lies
 * beyond the wanted texels is of no use, but finite. */
#define LANES  16u
#define STRIDE (LW_TILE_SIDE + 2 * LANES)
#define ROWS   (LW_TILE_SIDE + 2 * LW_DENOISE_REACH)
#define SPARE  64u /* bytes that the last row of weights may be read beyond its end */
_Static_assert(LW_DENOISE_REACH + LANES <= 2 * LANES, "a row's last vector stays in it");

/* Half of a texel's neighbours; the other half sees it as one of these. Taps of (1/4, 1/2, 1/4) squared. */
#define DIRECTIONS 4
static const struct direction {
    int dx, dy;
    float kernel;
} direction[DIRECTIONS] = {{1, 0, 0.125f}, {0, 1, 0.125f}, {1, 1, 0.0625f}, {-1, 1, 0.0625f}};

enum { R, G, B, Y, VARIANCE };

static size_t stride_of(const struct lw_mesh_texels *mesh) { return (size_t)mesh->width + 2 * MARGIN; }
static size_t area_of(const struct lw_mesh_texels *mesh) {
    return stride_of(mesh) * ((size_t)mesh->height + 2 * MARGIN);
}

/* ---- geometry, once
 * ------------------------------------------------------------------------------------------- */

/* How far two texels may exchange light for their surfaces' sake, in [0, 1]; the same both ways. */
static float surface_weight(const struct lw_mesh_texels *mesh, uint32_t a, uint32_t b, float apart_max) {
    const struct lw_vec3 na = lw_packed_normal_unpack(mesh->normal[a]),
                         nb = lw_packed_normal_unpack(mesh->normal[b]);
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
                lw_vec3_dot(lw_packed_normal_unpack(mesh->normal[a]),
                            lw_packed_normal_unpack(mesh->normal[b])) < 0.99f)
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

/* The pairs of a mesh. */
static size_t mesh_bytes(const struct lw_mesh_texels *mesh) {
    return LW_DENOISE_PASSES * DIRECTIONS * area_of(mesh) + SPARE;
}

static uint8_t *weigh_mesh(const struct lw_mesh_texels *mesh, int threads) {
    const size_t area = area_of(mesh);
    uint8_t *pair = calloc(mesh_bytes(mesh), 1);
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

/* ---- walls, of each object ---- */

static bool has_walls(const struct lw_texels *texels, uint32_t object) {
    const uint32_t count = texels->mesh[texels->scene->object[object].mesh].texel_count;
    for (uint32_t i = 0; i < count; i++)
        if (texels->walls[texels->first[object] + i]) return true;
    return false;
}

/* Whether a wall stands between two texels beside or above each other, or on one of them. */
static bool is_parted(const struct lw_mesh_texels *mesh, const uint8_t *walls, int64_t x, int64_t y,
                      int64_t u, int64_t v) {
    const uint32_t a = lw_texels_index(mesh, (uint32_t)x, (uint32_t)y),
                   b = lw_texels_index(mesh, (uint32_t)u, (uint32_t)v), first = x < u || y < v ? a : b;
    return (walls[a] | walls[b]) & LW_TEXELS_WALL_ON ||
           walls[first] & (x != u ? LW_TEXELS_WALL_RIGHT : LW_TEXELS_WALL_BELOW);
}

/* One texel along a direction; a diagonal goes by way of either corner. */
static bool is_step_parted(const struct lw_mesh_texels *mesh, const uint8_t *walls, int64_t x, int64_t y,
                           const struct direction *d) {
    const int64_t u = x + d->dx, v = y + d->dy;
    if (!d->dx || !d->dy) return is_parted(mesh, walls, x, y, u, v);
    return (is_parted(mesh, walls, x, y, u, y) || is_parted(mesh, walls, u, y, u, v)) &&
           (is_parted(mesh, walls, x, y, x, v) || is_parted(mesh, walls, x, v, u, v));
}

/* Takes the weight of those pairs of a row that a wall parts on the straight way between them. */
static void part_row(const struct lw_mesh_texels *mesh, const uint8_t *walls, uint32_t y, uint32_t step,
                     const struct direction *d, uint8_t *pair) {
    for (uint32_t x = 0; x < mesh->width; x++) {
        int64_t u = x, v = y;
        for (uint32_t k = 0; k < step && pair[x]; k++, u += d->dx, v += d->dy)
            if (is_step_parted(mesh, walls, u, v, d)) pair[x] = 0;
    }
}

/* Takes the weight of all pairs of a mesh that walls part. */
static void part_pairs(const struct lw_mesh_texels *mesh, const uint8_t *walls, int threads, uint8_t *own) {
    const size_t area = area_of(mesh);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t y = 0; y < mesh->height; y++)
        for (uint32_t k = 0; k < LW_DENOISE_PASSES * DIRECTIONS; k++)
            part_row(mesh, walls, y, 1u << k / DIRECTIONS, &direction[k % DIRECTIONS],
                     own + k * area + (y + MARGIN) * stride_of(mesh) + MARGIN);
}

/* Takes the pairs of an object's mesh, but for those that walls part. */
static bool take_pairs(struct lw_denoise_pairs *pairs, uint32_t object, int threads) {
    const uint32_t m = pairs->scene->object[object].mesh;
    const struct lw_mesh_texels *mesh = &pairs->texels->mesh[m];
    const bool walls = has_walls(pairs->texels, object);
    uint8_t *const shared = pairs->shared[m], **pair = &pairs->pair[object], *taken = shared;
    if (!shared)
        taken = weigh_mesh(mesh, threads);
    else if (walls && (taken = malloc(mesh_bytes(mesh))))
        memcpy(taken, shared, mesh_bytes(mesh));
    if (!taken) return false;
    if (walls) part_pairs(mesh, pairs->texels->walls + pairs->texels->first[object], threads, taken);
    if (*pair != shared) free(*pair);
    *pair = taken;
    pairs->changes[object] = pairs->texels->changes[object];
    return true;
}

uint8_t *lw_denoise_pairs_of_fine(const struct lw_mesh_texels *mesh, const uint8_t *walls) {
    uint8_t *pair = weigh_mesh(mesh, 1);
    if (pair) part_pairs(mesh, walls, 1, pair);
    return pair;
}

/* Weighs the meshes that several objects have. Returns false without memory. */
static bool weigh_shared(struct lw_denoise_pairs *pairs, int threads) {
    const struct lw_scene *scene = pairs->scene;
    bool *used = calloc((size_t)scene->mesh_count + 1, sizeof *used), ok = used != NULL;
    for (uint32_t o = 0; ok && o < scene->object_count; o++) {
        const uint32_t m = scene->object[o].mesh;
        if (used[m] && !pairs->shared[m] && pairs->texels->mesh[m].texel_count)
            ok = (pairs->shared[m] = weigh_mesh(&pairs->texels->mesh[m], threads)) != NULL;
        used[m] = true;
    }
    free(used);
    return ok;
}

enum lw_status lw_denoise_pairs_init(struct lw_denoise_pairs *pairs, const struct lw_scene *scene,
                                     const struct lw_texels *texels, int threads) {
    *pairs = (struct lw_denoise_pairs){.scene = scene, .texels = texels};
    pairs->shared = calloc((size_t)scene->mesh_count + 1, sizeof *pairs->shared);
    pairs->pair = calloc((size_t)scene->object_count + 1, sizeof *pairs->pair);
    pairs->changes = calloc((size_t)scene->object_count + 1, sizeof *pairs->changes);
    bool ok = pairs->shared && pairs->pair && pairs->changes && weigh_shared(pairs, threads);
    for (uint32_t o = 0; ok && o < scene->object_count; o++)
        if (texels->mesh[scene->object[o].mesh].texel_count) ok = take_pairs(pairs, o, threads);
    if (ok) return LW_OK;
    lw_denoise_pairs_finish(pairs);
    return LW_NO_MEMORY;
}

enum lw_status lw_denoise_pairs_review(struct lw_denoise_pairs *pairs, int threads) {
    for (uint32_t o = 0; o < pairs->scene->object_count; o++) {
        if (!pairs->pair[o] || pairs->changes[o] == pairs->texels->changes[o]) continue;
        if (!take_pairs(pairs, o, threads)) return LW_NO_MEMORY;
    }
    return LW_OK;
}

size_t lw_denoise_pairs_memory_bytes(const struct lw_denoise_pairs *pairs) {
    if (!pairs->pair) return 0;
    const struct lw_scene *scene = pairs->scene;
    size_t bytes = scene->mesh_count * sizeof *pairs->shared +
                   scene->object_count * (sizeof *pairs->pair + sizeof *pairs->changes);
    for (uint32_t m = 0; m < scene->mesh_count; m++)
        if (pairs->shared[m]) bytes += mesh_bytes(&pairs->texels->mesh[m]);
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (pairs->pair[o] && pairs->pair[o] != pairs->shared[scene->object[o].mesh])
            bytes += mesh_bytes(&pairs->texels->mesh[scene->object[o].mesh]);
    return bytes;
}

void lw_denoise_pairs_finish(struct lw_denoise_pairs *pairs) {
    for (uint32_t o = 0; pairs->pair && pairs->shared && o < pairs->scene->object_count; o++)
        if (pairs->pair[o] != pairs->shared[pairs->scene->object[o].mesh]) free(pairs->pair[o]);
    for (uint32_t m = 0; pairs->shared && m < pairs->scene->mesh_count; m++) free(pairs->shared[m]);
    free(pairs->shared);
    free(pairs->pair);
    free(pairs->changes);
    *pairs = (struct lw_denoise_pairs){0};
}

/* ---- one tile
 * ------------------------------------------------------------------------------------------------- */

struct lw_denoise_planes {
    float at[2][LW_DENOISE_PLANES][ROWS * STRIDE];
    float weight[DIRECTIONS][ROWS * STRIDE]; /* in a pass: what a texel exchanges with its neighbour */
    float (*more[2])[ROWS * STRIDE];         /* planes that follow */
};

/* Where a pass reads or writes. */
struct planes {
    float *p[LW_DENOISE_PLANES];
};

/* The rectangle of a tile's texels that is filtered. */
struct job {
    uint32_t irradiance;
    const struct lw_denoise *denoise;
    const struct lw_solve_tile *tile;
    const struct lw_mesh_texels *mesh;
    const uint8_t *pair;
    size_t pair_stride, pair_area;
    uint32_t x, y, width, height; /* in the object's atlas */
};

/* One half of a texel's neighbours in a pass: how far away in the planes, and where
 * the pair's weight is found. */
struct tap {
    ptrdiff_t offset;
    ptrdiff_t pair,
        /* Weight of the texel and the neighbour, relative to the texel's in job->pair; as far away there. */
        pair_offset;
    float kernel; /* per 1/255 of a weight */
};

static void list_taps(const struct job *job, uint32_t pass, struct tap out_tap[DIRECTIONS]) {
    for (int k = 0; k < DIRECTIONS; k++) {
        const ptrdiff_t step = (ptrdiff_t)1 << pass, dx = direction[k].dx * step, dy = direction[k].dy * step;
        out_tap[k] = (struct tap){.offset = dy * (ptrdiff_t)STRIDE + dx,
                                  .pair = (ptrdiff_t)((pass * DIRECTIONS + (uint32_t)k) * job->pair_area),
                                  .pair_offset = dy * (ptrdiff_t)job->pair_stride + dx,
                                  .kernel = direction[k].kernel / 255};
    }
}

/* Texels from `around` columns before the rectangle to as many behind it, or to the end of a vector. */
struct row {
    size_t plane;        /* its first texel there */
    const uint8_t *pair; /* its first texel's weight of the first direction and pass */
    uint32_t count;      /* whole vectors */
};

static struct row row_at(const struct job *job, uint32_t y, uint32_t around) {
    const uint32_t count = job->width + 2 * around;
    return (struct row){
        .plane = (y + LW_DENOISE_REACH - job->y) * STRIDE + LW_DENOISE_REACH - around,
        .pair = job->pair + (size_t)(y + MARGIN) * job->pair_stride + MARGIN + job->x - around,
        .count = (count + LANES - 1) / LANES * LANES,
    };
}

/* Rows of the atlas from `around` above the rectangle to as many below it. */
#define EACH_ROW(job, around, y)                                                                             \
    for (uint32_t y = (job)->y > (around) ? (job)->y - (around) : 0,                                         \
                  end_ = (job)->y + (job)->height + (around) < (job)->mesh->height                           \
                             ? (job)->y + (job)->height + (around)                                           \
                             : (job)->mesh->height;                                                          \
         y < end_; y++)

/* Sixteen numbers at a time. */
typedef float lanes __attribute__((vector_size(LANES * sizeof(float))));
typedef int32_t whole_lanes __attribute__((vector_size(LANES * sizeof(int32_t))));
typedef uint8_t byte_lanes __attribute__((vector_size(LANES)));

LW_WIDE_INLINE lanes load(const float *from) {
    lanes v;
    memcpy(&v, from, sizeof v);
    return v;
}

LW_WIDE_INLINE void store(float *to, lanes v) { memcpy(to, &v, sizeof v); }

LW_WIDE_INLINE lanes every(float x) { return (lanes){x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x}; }

/* Where yes is -1, and where it is 0. */
LW_WIDE_INLINE lanes choose(whole_lanes yes, lanes a, lanes b) {
    return (lanes)(((whole_lanes)a & yes) | ((whole_lanes)b & ~yes));
}

/* Weights of pairs; false if all are 0. */
LW_WIDE_INLINE bool load_pair(const uint8_t *from, lanes *out) {
    uint64_t half[2];
    memcpy(half, from, sizeof half);
    if (!(half[0] | half[1])) return false;
    byte_lanes bytes;
    memcpy(&bytes, from, sizeof bytes);
    *out = __builtin_convertvector(bytes, lanes);
    return true;
}

/* Colours, and the variance of each texel's mean over the frames: of a row's texels in one block. And the
 * luminance of indirect light alone. */
LW_WIDE_INLINE void load_run(const struct lw_tiles *tiles, uint32_t irradiance, size_t from, uint32_t n,
                             float per_frame, float unknown, const struct planes *out, float *out_indirect,
                             size_t to) {
    const bool split = irradiance == LW_TILE_CHANNEL_SPLIT;
    const float *const restrict spread = (split ? tiles->split_spread : tiles->spread) + from;
    const uint8_t *const restrict covered = tiles->covered + from;
    float *const restrict y = out->p[Y] + to, *const restrict variance = out->p[VARIANCE] + to,
                          *const restrict y_indirect = out_indirect + to;
    for (int c = 0; c < 3; c++) {
        const float *const restrict direct = tiles->direct[c] + from, *const restrict indirect =
                                                                          tiles->indirect[c] + from;
        float *const restrict v = out->p[c] + to;
        if (split) {
            const float *const restrict drawn = tiles->drawn[c] + from;
#pragma omp simd
            for (uint32_t i = 0; i < n; i++) {
                const float served = direct[i] - drawn[i];
                v[i] = (served > 0 ? served : 0) + indirect[i];
            }
        } else {
#pragma omp simd
            for (uint32_t i = 0; i < n; i++) v[i] = direct[i] + indirect[i];
        }
    }
    const float *const restrict r = out->p[R] + to, *const restrict g = out->p[G] + to,
                                *const restrict b = out->p[B] + to,
                                *const restrict ri = tiles->indirect[R] + from,
                                *const restrict gi = tiles->indirect[G] + from,
                                *const restrict bi = tiles->indirect[B] + from;
#pragma omp simd
    for (uint32_t i = 0; i < n; i++) {
        const float own = lw_colour_luminance(lw_vec3(r[i], g[i], b[i])), v = spread[i] * per_frame + unknown;
        y[i] = covered[i] ? own : -1;
        y_indirect[i] = lw_colour_luminance(lw_vec3(ri[i], gi[i], bi[i]));
        variance[i] = covered[i] ? v : NO_PART;
    }
}

LW_WIDE static void load_block_row(const struct lw_tiles *tiles, uint32_t irradiance, size_t from, uint32_t n,
                                   float per_frame, float unknown, const struct planes *out,
                                   float *out_indirect, size_t to) {
    if (n == LW_TILE_BLOCK)
        load_run(tiles, irradiance, from, LW_TILE_BLOCK, per_frame, unknown, out, out_indirect,
                 to); /* one vector, as most are */
    else
        load_run(tiles, irradiance, from, n, per_frame, unknown, out, out_indirect, to);
}

/* By how much the variance of a texel after `frames` frames is taken to be more than it is estimated. */
static float widening_of(uint32_t irradiance, float frames) {
    const float wider = irradiance == LW_TILE_CHANNEL_SPLIT ? 1 + SPLIT_WIDER / frames : 1;
    return wider * wider;
}

/* False: no texel's variance is to be guessed. out_indirect: a plane. */
static bool load_rows(const struct job *job, const struct planes *out, float *out_indirect) {
    const struct lw_tiles *tiles = job->denoise->tiles;
    const uint32_t first = job->x > LW_DENOISE_REACH ? job->x - LW_DENOISE_REACH : 0,
                   right = job->x + job->width + LW_DENOISE_REACH,
                   end = right < job->mesh->width ? right : job->mesh->width;
    bool guess = false;
    EACH_ROW (job, LW_DENOISE_REACH, y) {
        const size_t row = row_at(job, y, 0).plane;
        for (uint32_t x = first, next; x < end; x = next) {
            next = (x / LW_TILE_BLOCK + 1) * LW_TILE_BLOCK;
            if (next > end) next = end;
            const uint32_t texel = job->tile->first - job->tile->local + lw_texels_index(job->mesh, x, y);
            const struct lw_solve_block *block = &tiles->block[tiles->block_of_texel[texel]];
            const size_t to = row + x - job->x;
            if (!block->covered_count) {
                for (uint32_t u = 0; u < next - x; u++)
                    out->p[Y][to + u] = -1, out->p[VARIANCE][to + u] = NO_PART;
                continue;
            }
            const float remembered = block->indirect.sample_count;
            const bool few = remembered < HISTORY_MIN;
            load_block_row(tiles, job->irradiance, texel, next - x,
                           few ? 0 : widening_of(job->irradiance, remembered) / (remembered - 1),
                           few ? UNKNOWN : 0, out, out_indirect, to);
            guess |= few;
        }
    }
    return guess;
}

/* After a first frame: half the mean squares of the differences to the neighbours, times `widening`. */
LW_WIDE static void guess_row(struct row row, const struct planes *v, const float *indirect, float widening,
                              const struct tap tap[DIRECTIONS]) {
    for (uint32_t i = 0; i < row.count; i += LANES) {
        const float *y = v->p[Y] + row.plane + i, *yi = indirect + row.plane + i;
        float *variance = v->p[VARIANCE] + row.plane + i;
        const lanes own = load(y), own_indirect = load(yi), given = load(variance);
        lanes by_direct = {0}, by_indirect = {0}, weights = {0}, w;
        for (int k = 0; k < DIRECTIONS; k++)
            for (int back = 0; back < 2; back++) {
                if (!load_pair(row.pair + i + tap[k].pair - (back ? tap[k].pair_offset : 0), &w)) continue;
                const ptrdiff_t offset = back ? -tap[k].offset : tap[k].offset;
                const lanes there = load(y + offset), off_indirect = load(yi + offset) - own_indirect,
                            off_direct = there - own - off_indirect;
                w = choose(there < 0, every(0), w);
                by_direct += w * off_direct * off_direct;
                by_indirect += w * off_indirect * off_indirect;
                weights += w;
            }
        const lanes most = choose(by_indirect > 0, DIRECT_MAX * by_indirect, by_direct),
                    guess = 0.5f * widening * (by_indirect + choose(by_direct < most, by_direct, most)) /
                            choose(weights > 0, weights, every(1));
        store(variance, choose(given >= UNKNOWN, guess, given));
    }
}

/* The variance that edges are measured by: of a texel and its neighbours together, since one that has met no
 * rare bright sample yet believes itself without noise. */
LW_WIDE static void smooth_row(struct row row, const float *in, float *out,
                               const struct tap tap[DIRECTIONS]) {
    for (uint32_t i = 0; i < row.count; i += LANES) {
        const float *from = in + row.plane + i;
        const lanes own = load(from);
        lanes sum = 0.25f * own, weights = every(0.25f), w;
        for (int k = 0; k < DIRECTIONS; k++)
            for (int back = 0; back < 2; back++) {
                if (!load_pair(row.pair + i + tap[k].pair - (back ? tap[k].pair_offset : 0), &w)) continue;
                const lanes there = load(from + (back ? -tap[k].offset : tap[k].offset));
                w = choose(there < 0, every(0), tap[k].kernel * w);
                sum += w * there;
                weights += w;
            }
        store(out + row.plane + i, choose(own < 0, every(NO_PART), sum / weights));
    }
}

/* How much of the light between the texels of a row and their neighbours in four directions is exchanged. */
LW_WIDE static void weigh_pairs(struct row row, const struct planes *in, const struct tap tap[DIRECTIONS],
                                float weight[DIRECTIONS][ROWS * STRIDE]) {
    for (uint32_t i = 0; i < row.count; i += LANES) {
        const float *y = in->p[Y] + row.plane + i, *variance = in->p[VARIANCE] + row.plane + i;
        const lanes own = load(y), own_variance = load(variance);
        for (int k = 0; k < DIRECTIONS; k++) {
            lanes w;
            if (!load_pair(row.pair + i + tap[k].pair, &w)) {
                store(weight[k] + row.plane + i, every(0));
                continue;
            }
            const lanes off = load(y + tap[k].offset) - own, square = off * off,
                        limit = SIGMAS * SIGMAS * (own_variance + load(variance + tap[k].offset));
            /* Tukey's biweight: an edge far above the noise passes nothing at all, and without
             * noise there is no exchange. */
            const lanes share =
                choose(square < limit, square, every(1)) / choose(square < limit, limit, every(1));
            const lanes tame = 1 - share;
            store(weight[k] + row.plane + i, tap[k].kernel * w * tame * tame);
        }
    }
}

LW_WIDE static void exchange(struct row row, const struct planes *in, const struct planes *out,
                             const struct tap tap[DIRECTIONS], float weight[DIRECTIONS][ROWS * STRIDE]) {
    for (uint32_t i = 0; i < row.count; i += LANES) {
        const size_t at = row.plane + i;
        const lanes r = load(in->p[R] + at), g = load(in->p[G] + at), b = load(in->p[B] + at),
                    variance = load(in->p[VARIANCE] + at);
        lanes r_sum = r, g_sum = g, b_sum = b, given = {0}, v_sum = {0}, ignored;
        for (int k = 0; k < DIRECTIONS; k++)
            for (int back = 0; back < 2; back++) {
                if (!load_pair(row.pair + i + tap[k].pair - (back ? tap[k].pair_offset : 0), &ignored))
                    continue;
                const size_t there = back ? at - (size_t)tap[k].offset : at + (size_t)tap[k].offset;
                const lanes w = load(weight[k] + (back ? there : at));
                r_sum += w * (load(in->p[R] + there) - r);
                g_sum += w * (load(in->p[G] + there) - g);
                b_sum += w * (load(in->p[B] + there) - b);
                v_sum += w * w * load(in->p[VARIANCE] + there);
                given += w;
            }
        const lanes kept = 1 - given;
        store(out->p[R] + at, r_sum);
        store(out->p[G] + at, g_sum);
        store(out->p[B] + at, b_sum);
        store(out->p[Y] + at, 0.2126f * r_sum + 0.7152f * g_sum + 0.0722f * b_sum);
        store(out->p[VARIANCE] + at, choose(variance < 0, every(NO_PART), v_sum + kept * kept * variance));
    }
}

/* The same of a plane that follows. */
LW_WIDE static void exchange_plane(struct row row, const float *in, float *out,
                                   const struct tap tap[DIRECTIONS],
                                   float weight[DIRECTIONS][ROWS * STRIDE]) {
    for (uint32_t i = 0; i < row.count; i += LANES) {
        const size_t at = row.plane + i;
        const lanes own = load(in + at);
        lanes sum = own, ignored;
        for (int k = 0; k < DIRECTIONS; k++)
            for (int back = 0; back < 2; back++) {
                if (!load_pair(row.pair + i + tap[k].pair - (back ? tap[k].pair_offset : 0), &ignored))
                    continue;
                const size_t there = back ? at - (size_t)tap[k].offset : at + (size_t)tap[k].offset;
                sum += load(weight[k] + (back ? there : at)) * (load(in + there) - own);
            }
        store(out + at, sum);
    }
}

/* Where a tile begins in the atlas that is filtered: a tile of a finer level is one by itself. */
static uint32_t left_of(const struct lw_solve_tile *tile) {
    return tile->fine_pair ? 0 : tile->x * LW_TILE_SIDE;
}
static uint32_t top_of(const struct lw_solve_tile *tile) {
    return tile->fine_pair ? 0 : tile->y * LW_TILE_SIDE;
}

static void store_plane(const struct job *job, const float *from, float *to) {
    const struct lw_tiles *tiles = job->denoise->tiles;
    const struct lw_solve_tile *tile = job->tile;
    const uint32_t left = left_of(tile), top = top_of(tile);
    EACH_ROW (job, 0, y) {
        const size_t row = row_at(job, y, 0).plane;
        for (uint32_t x = job->x; x < job->x + job->width; x++) {
            const uint32_t texel = tile->first + (y - top) * tile->width + x - left;
            if (tiles->covered[texel] && job->denoise->marked[tiles->block_of_texel[texel]])
                to[texel] = from[row + x - job->x];
        }
    }
}

/* A plane of a channel that follows an irradiance. */
struct follower {
    uint32_t channel, plane;
};
#define FOLLOWERS_MAX (LW_TILE_CHANNELS_MAX * LW_TILE_CHANNEL_PLANES_MAX)

static uint32_t list_followers(uint32_t irradiance, uint32_t channels, struct follower out[FOLLOWERS_MAX]) {
    uint32_t n = 0;
    LW_TILE_CHANNELS_EACH (channel, channels & ~lw_tile_channel_bit(irradiance))
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
            if (lw_tile_channel_at(channel)->follows == irradiance) out[n++] = (struct follower){channel, p};
    return n;
}

static void load_plane(const struct job *job, const struct follower *of, float *to) {
    const struct lw_tiles *tiles = job->denoise->tiles;
    const uint32_t origin = job->tile->first - job->tile->local;
    const uint32_t first = job->x > LW_DENOISE_REACH ? job->x - LW_DENOISE_REACH : 0,
                   right = job->x + job->width + LW_DENOISE_REACH,
                   end = right < job->mesh->width ? right : job->mesh->width;
    EACH_ROW (job, LW_DENOISE_REACH, y) {
        float *row = to + row_at(job, y, 0).plane;
        for (uint32_t x = first; x < end; x++)
            row[(ptrdiff_t)x - (ptrdiff_t)job->x] =
                lw_tiles_sum(tiles, of->channel, of->plane, origin + lw_texels_index(job->mesh, x, y));
    }
}

/* Nothing is exchanged above the mesh: no pair is weighed there. But a vector of pairs may reach beyond the
 * end of its row, so that the weights are read. */
static void forget_weights_above(const struct job *job, struct lw_denoise_planes *planes) {
    const uint32_t rows = job->y < LW_DENOISE_REACH ? LW_DENOISE_REACH - job->y : 0;
    for (int k = 0; k < DIRECTIONS; k++)
        memset(planes->weight[k], 0, rows * STRIDE * sizeof *planes->weight[k]);
}

static void filter(const struct job *job, uint32_t channels, struct lw_denoise_planes *planes) {
    const struct lw_tiles *tiles = job->denoise->tiles;
    struct planes in, out;
    for (uint32_t p = 0; p < LW_DENOISE_PLANES; p++) in.p[p] = planes->at[0][p], out.p[p] = planes->at[1][p];
    struct follower follower[FOLLOWERS_MAX];
    const uint32_t followers = list_followers(job->irradiance, channels, follower);
    uint32_t from = 0; /* index into planes->more */
    struct tap tap[DIRECTIONS];
    list_taps(job, 0, tap);
    uint32_t around = LW_DENOISE_REACH - 1;
    float *const indirect = out.p[Y]; /* until the first pass */
    forget_weights_above(job, planes);
    if (load_rows(job, &in, indirect)) {
        EACH_ROW (job, around, y)
            guess_row(row_at(job, y, around), &in, indirect, widening_of(job->irradiance, 1), tap);
    }
    for (uint32_t i = 0; i < followers; i++) load_plane(job, &follower[i], planes->more[0][i]);
    around--;
    EACH_ROW (job, around, y) smooth_row(row_at(job, y, around), in.p[VARIANCE], out.p[VARIANCE], tap);
    /* The smoothed variance goes with the colours that it was made from. */
    float *const smooth = out.p[VARIANCE];
    out.p[VARIANCE] = in.p[VARIANCE];
    in.p[VARIANCE] = smooth;
    for (uint32_t pass = 0; pass < LW_DENOISE_PASSES; pass++) {
        list_taps(job, pass, tap);
        EACH_ROW (job, around, y) weigh_pairs(row_at(job, y, around), &in, tap, planes->weight);
        around -= 1u << pass;
        EACH_ROW (job, around, y) exchange(row_at(job, y, around), &in, &out, tap, planes->weight);
        for (uint32_t i = 0; i < followers; i++)
            EACH_ROW (job, around, y)
                exchange_plane(row_at(job, y, around), planes->more[from][i], planes->more[!from][i], tap,
                               planes->weight);
        const struct planes swap = in;
        in = out;
        out = swap;
        from = !from;
    }
    if (channels & lw_tile_channel_bit(job->irradiance))
        for (int c = 0; c < 3; c++) store_plane(job, in.p[c], tiles->shown[job->irradiance][c]);
    for (uint32_t i = 0; i < followers; i++)
        store_plane(job, planes->more[from][i], tiles->shown[follower[i].channel][follower[i].plane]);
}

/* The channels of irradiance that a set of channels is or follows. */
static uint32_t irradiances_of(uint32_t channels) {
    uint32_t irradiances = 0;
    LW_TILE_CHANNELS_EACH (channel, channels)
        irradiances |= lw_tile_channel_bit(lw_tile_channel_at(channel)->follows);
    return irradiances;
}

/* ---- which blocks
 * --------------------------------------------------------------------------------------------- */

/* Planes at most that follow one irradiance. */
static uint32_t count_followers(const struct lw_tiles *tiles) {
    struct follower follower[FOLLOWERS_MAX];
    uint32_t most = 0;
    LW_TILE_CHANNELS_EACH (irradiance, irradiances_of(tiles->channels)) {
        const uint32_t count = list_followers(irradiance, tiles->channels, follower);
        if (count > most) most = count;
    }
    return most;
}

enum lw_status lw_denoise_init(struct lw_denoise *denoise, const struct lw_denoise_pairs *pairs,
                               const struct lw_atlas_map *map, struct lw_tiles *tiles, int threads) {
    *denoise = (struct lw_denoise){
        .pairs = pairs, .map = map, .tiles = tiles, .followers = count_followers(tiles), .threads = threads};
    denoise->marked = calloc((size_t)tiles->block_capacity + 1, sizeof *denoise->marked);
    denoise->planes = calloc((size_t)threads, sizeof *denoise->planes);
    bool ok = denoise->marked && denoise->planes;
    for (int i = 0; i < 2 * threads && denoise->followers && ok; i++) {
        struct lw_denoise_planes *planes = &denoise->planes[i / 2];
        ok = (planes->more[i % 2] = calloc(denoise->followers, sizeof *planes->more[0])) != NULL;
    }
    if (ok) return LW_OK;
    lw_denoise_finish(denoise);
    return LW_NO_MEMORY;
}

void lw_denoise_finish(struct lw_denoise *denoise) {
    for (int i = 0; i < 2 * denoise->threads && denoise->planes; i++)
        free(denoise->planes[i / 2].more[i % 2]);
    free(denoise->planes);
    free(denoise->marked);
    *denoise = (struct lw_denoise){0};
}

size_t lw_denoise_memory_bytes(const struct lw_denoise *denoise) {
    if (!denoise->pairs) return 0;
    return denoise->tiles->block_capacity * sizeof *denoise->marked +
           (size_t)denoise->threads *
               (sizeof *denoise->planes + 2 * denoise->followers * sizeof *denoise->planes->more[0]);
}

/* Marks the block of a tile at a column and row of its object's blocks, if there is one. */
static void mark(struct lw_denoise *d, uint32_t object, int64_t column, int64_t row) {
    const struct lw_atlas_level *level = &d->map->atlas[object]->level[0];
    const uint32_t x = (uint32_t)column * LW_TILE_BLOCK, y = (uint32_t)row * LW_TILE_BLOCK;
    if (column < 0 || row < 0 || x >= level->width || y >= level->height) return;
    const lw_tile_id id = lw_atlas_map_find(d->map, object, 0, x / LW_TILE_SIDE, y / LW_TILE_SIDE);
    const struct lw_solve_tile *tile = lw_tiles_at(d->tiles, id);
    const struct lw_solve_block *block = lw_tiles_block(tile, x % LW_TILE_SIDE, y % LW_TILE_SIDE);
    d->marked[block - d->tiles->block] = block->covered_count > 0;
}

/* Marks the blocks of a tile of a finer level around one of them. */
static void mark_fine(struct lw_denoise *d, const struct lw_solve_tile *tile, uint32_t block) {
    const int64_t column = block % tile->block_columns, row = block / tile->block_columns;
    for (int64_t v = row - 1; v <= row + 1; v++)
        for (int64_t u = column - 1; u <= column + 1; u++) {
            if (u < 0 || v < 0 || u >= tile->block_columns || v >= tile->block_rows) continue;
            const struct lw_solve_block *at = &tile->block[v * tile->block_columns + u];
            d->marked[at - d->tiles->block] = at->covered_count > 0;
        }
}

_Static_assert(LW_DENOISE_REACH <= LW_TILE_BLOCK, "blocks change those beside them alone");
static void mark_around(struct lw_denoise *d, const struct lw_solve_tile *tile, uint32_t block) {
    if (tile->fine_pair) return mark_fine(d, tile, block);
    const int64_t column = tile->x * LW_TILE_BLOCKS + block % tile->block_columns,
                  row = tile->y * LW_TILE_BLOCKS + block / tile->block_columns;
    for (int64_t v = row - 1; v <= row + 1; v++)
        for (int64_t u = column - 1; u <= column + 1; u++) mark(d, tile->object, u, v);
}

static void mark_all(struct lw_denoise *d, uint64_t frame) {
    memset(d->marked, 0, d->tiles->block_capacity);
    for (uint32_t i = 0; i < d->tiles->count; i++) {
        const struct lw_solve_tile *tile = &d->tiles->tile[i];
        if (tile->light.solved_frame != frame) continue;
        LW_TILES_EACH_BLOCK (tile, block) {
            if (block->covered_count && block->shown_frame == frame)
                mark_around(d, tile, (uint32_t)(block - tile->block));
        }
    }
}

/* The rectangle of a tile that holds its marked blocks; false: there are none. */
static bool find_job(const struct lw_denoise *d, const struct lw_solve_tile *tile, struct job *out) {
    uint32_t x[2] = {UINT32_MAX, 0}, y[2] = {UINT32_MAX, 0};
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!d->marked[block - d->tiles->block]) continue;
        const uint32_t b = (uint32_t)(block - tile->block), column = b % tile->block_columns,
                       row = b / tile->block_columns;
        x[0] = column < x[0] ? column : x[0], x[1] = column + 1 > x[1] ? column + 1 : x[1];
        y[0] = row < y[0] ? row : y[0], y[1] = row + 1 > y[1] ? row + 1 : y[1];
    }
    if (!x[1]) return false;
    const uint32_t right = x[1] * LW_TILE_BLOCK < tile->width ? x[1] * LW_TILE_BLOCK : tile->width,
                   below = y[1] * LW_TILE_BLOCK < tile->height ? y[1] * LW_TILE_BLOCK : tile->height;
    *out = (struct job){.denoise = d,
                        .tile = tile,
                        .mesh = tile->mesh,
                        .pair = tile->fine_pair ? tile->fine_pair : d->pairs->pair[tile->object],
                        .pair_stride = stride_of(tile->mesh),
                        .pair_area = area_of(tile->mesh),
                        .x = left_of(tile) + x[0] * LW_TILE_BLOCK,
                        .y = top_of(tile) + y[0] * LW_TILE_BLOCK,
                        .width = right - x[0] * LW_TILE_BLOCK,
                        .height = below - y[0] * LW_TILE_BLOCK};
    return true;
}

void lw_denoise_run(struct lw_denoise *denoise, uint64_t frame, uint32_t channels, int threads) {
    const uint32_t irradiances = irradiances_of(channels);
    LW_INVARIANT(threads <= denoise->threads && (channels & ~denoise->tiles->channels) == 0 && channels != 0);
    mark_all(denoise, frame);
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
    for (uint32_t i = 0; i < denoise->tiles->count; i++) {
        struct lw_solve_tile *tile = &denoise->tiles->tile[i];
        struct job job;
        if (!find_job(denoise, tile, &job)) continue;
        for (job.irradiance = 0; job.irradiance < LW_TILE_CHANNEL_IRRADIANCES; job.irradiance++)
            if (irradiances & lw_tile_channel_bit(job.irradiance))
                filter(&job, lw_tiles_channels_of(denoise->tiles, tile, channels),
                       &denoise->planes[omp_get_thread_num()]);
        tile->light.solved_frame = frame;
        LW_TILES_EACH_BLOCK (tile, block)
            if (denoise->marked[block - denoise->tiles->block]) block->shown_frame = frame;
    }
}
