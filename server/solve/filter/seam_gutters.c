#include "server/solve/filter/seam_gutters.h"

#include <stdlib.h>

/* Texels beyond a seam to the centre of a gutter: two, and what the seam lies off their grid. */
#define REACH 2.5f
#define SLACK 0.5f /* texels that a gutter may lie past a seam's end */
#define LEAST 0.5f /* share of a look-up's weight that covered texels of the other side must have */

struct lw_seam_gutter {
    uint32_t texel;   /* in the global numbering */
    float distance;   /* from the seam, texels */
    uint32_t from[4]; /* covered texels of the other side, in the global numbering */
    float weight[4];
};

struct lw_seam_copy {
    uint32_t texel, from; /* in the global numbering */
};

/* One side of a seam. */
struct bank {
    const struct lw_mesh_texels *mesh;
    const uint8_t *covered;
    uint32_t first;                     /* the object's first texel */
    struct lw_vec2 from, along, inward; /* unit vectors: along the seam; into the chart */
    float length;
};

static struct lw_vec2 mad2(struct lw_vec2 a, struct lw_vec2 b, float s) {
    return (struct lw_vec2){a.x + b.x * s, a.y + b.y * s};
}

static float dot2(struct lw_vec2 a, struct lw_vec2 b) { return a.x * b.x + a.y * b.y; }

static bool make_bank(const struct lw_scene *scene, const struct lw_texels *texels,
                      const struct lw_seam_edge *edge, int side, struct bank *out) {
    const uint32_t object = edge->object[side], m = scene->object[object].mesh;
    const struct lw_mesh *mesh = &scene->mesh[m];
    const struct lw_vec2 from = edge->from[side], way = mad2(edge->to[side], from, -1);
    const float length = hypotf(way.x, way.y);
    if (!(length > 0)) return false;
    struct lw_vec2 middle = {
        0, mesh->back_offset && from.y >= (float)mesh->back_offset ? (float)mesh->back_offset : 0};
    for (int c = 0; c < 3; c++)
        middle = mad2(middle, mesh->lightmap_uv[mesh->triangle[edge->triangle[side]][c]], 1 / 3.0f);
    const struct lw_vec2 along = {way.x / length, way.y / length};
    struct lw_vec2 inward = {-along.y, along.x};
    if (dot2(inward, mad2(middle, from, -1)) < 0) inward = (struct lw_vec2){along.y, -along.x};
    *out = (struct bank){.mesh = &texels->mesh[m],
                         .covered = texels->covered + texels->first[object],
                         .first = texels->first[object],
                         .from = from,
                         .along = along,
                         .inward = inward,
                         .length = length};
    return true;
}

/* A place by how far it is along the seam and into the chart, texels. */
static struct lw_vec2 point_on_bank(const struct bank *bank, float along, float in) {
    return mad2(mad2(bank->from, bank->along, along), bank->inward, in);
}

/* The chart that a bank is of, at a place along it; LW_TEXEL_NONE: none. */
static uint32_t chart_at(const struct bank *bank, float along) {
    const struct lw_vec2 at = point_on_bank(bank, along, 0.5f);
    if (!(at.x >= 0 && at.y >= 0 && at.x < (float)bank->mesh->width && at.y < (float)bank->mesh->height))
        return LW_TEXEL_NONE;
    return bank->mesh->chart[lw_texels_index(bank->mesh, (uint32_t)at.x, (uint32_t)at.y)];
}

/* What a bilinear look-up reads of a bank's chart; false where that has too little. */
static bool look_up(const struct bank *bank, uint32_t chart, struct lw_vec2 at, struct lw_seam_gutter *out) {
    const struct lw_mesh_texels *mesh = bank->mesh;
    const float x = at.x - 0.5f, y = at.y - 0.5f;
    if (!(x >= 0 && y >= 0 && x < (float)mesh->width && y < (float)mesh->height)) return false;
    const uint32_t x0 = (uint32_t)x, y0 = (uint32_t)y;
    float sum = 0;
    for (uint32_t k = 0; k < 4; k++) {
        const uint32_t tx = x0 + (k & 1), ty = y0 + (k >> 1);
        out->from[k] = bank->first, out->weight[k] = 0;
        if (tx >= mesh->width || ty >= mesh->height) continue;
        const uint32_t i = lw_texels_index(mesh, tx, ty);
        if (!bank->covered[i] || mesh->chart[i] != chart) continue;
        const float wx = x - (float)x0, wy = y - (float)y0;
        out->from[k] = bank->first + i;
        sum += out->weight[k] = (k & 1 ? wx : 1 - wx) * (k >> 1 ? wy : 1 - wy);
    }
    if (sum < LEAST) return false;
    for (int k = 0; k < 4; k++) out->weight[k] /= sum;
    return true;
}

static bool push(struct lw_seam_gutters *gutters, struct lw_seam_gutter gutter) {
    if (gutters->count == gutters->capacity) {
        const size_t capacity = gutters->capacity ? 2 * gutters->capacity : 256;
        struct lw_seam_gutter *grown = realloc(gutters->gutter, capacity * sizeof *grown);
        if (!grown) return false;
        gutters->gutter = grown;
        gutters->capacity = capacity;
    }
    gutters->gutter[gutters->count++] = gutter;
    return true;
}

/* Whether a texel is a gutter of a chart that is free to take other light. */
static bool is_free(const struct lw_texels *texels, const struct bank *bank, const uint8_t *welded,
                    uint32_t i, uint32_t chart) {
    const uint32_t source = texels->source[bank->first + i];
    return texels->filled[bank->first + i] && !welded[bank->first + i] && chart != LW_TEXEL_NONE &&
           bank->mesh->chart[source - bank->first] == chart &&
           (bank->mesh->chart[i] == chart || bank->mesh->chart[i] == LW_TEXEL_NONE);
}

/* The columns in which a row has texels near a seam. */
static void columns(const struct bank *bank, float y, uint32_t *out_first, uint32_t *out_last) {
    const float reach = REACH + SLACK, rise = bank->along.y;
    float a = 0, b = bank->length; /* the part of the seam that is near the row */
    if (fabsf(rise) > 1e-3f) {
        const float in = (y - reach - bank->from.y) / rise, out = (y + reach - bank->from.y) / rise;
        a = fmaxf(a, fminf(in, out)), b = fminf(b, fmaxf(in, out));
    }
    const float x_a = bank->from.x + a * bank->along.x, x_b = bank->from.x + b * bank->along.x;
    *out_first = (uint32_t)fmaxf(fminf(x_a, x_b) - reach, 0);
    *out_last = (uint32_t)fminf(fmaxf(fmaxf(x_a, x_b) + reach, 0), (float)(bank->mesh->width - 1));
}

/* Lists the gutters of one bank that lie beyond the seam, with what the other bank has there. */
static bool list(const struct lw_texels *texels, const struct bank *near, const struct bank *far,
                 const uint8_t *welded, struct lw_seam_gutters *out) {
    const struct lw_vec2 a = near->from, b = point_on_bank(near, near->length, 0);
    const float scale = far->length / near->length;
    const uint32_t y_first = (uint32_t)fmaxf(fminf(a.y, b.y) - REACH, 0);
    for (uint32_t y = y_first; y < near->mesh->height && (float)y <= fmaxf(a.y, b.y) + REACH; y++) {
        uint32_t x_first, x_last;
        columns(near, (float)y + 0.5f, &x_first, &x_last);
        for (uint32_t x = x_first; x <= x_last; x++) {
            const uint32_t i = lw_texels_index(near->mesh, x, y);
            const struct lw_vec2 d = mad2((struct lw_vec2){(float)x + 0.5f, (float)y + 0.5f}, a, -1);
            const float along = dot2(d, near->along), away = -dot2(d, near->inward),
                        foot = fminf(fmaxf(along, 0), near->length), past = fabsf(along - foot);
            if (away < 0 || away > REACH || past > SLACK ||
                !is_free(texels, near, welded, i, chart_at(near, foot)))
                continue;
            struct lw_seam_gutter gutter = {.texel = near->first + i, .distance = away + past};
            const uint32_t chart = chart_at(far, scale * foot);
            if (chart != LW_TEXEL_NONE &&
                look_up(far, chart, point_on_bank(far, scale * along, scale * away), &gutter) &&
                !push(out, gutter))
                return false;
        }
    }
    return true;
}

static int by_texel(const void *a, const void *b) {
    const struct lw_seam_gutter *x = a, *y = b;
    if (x->texel != y->texel) return x->texel < y->texel ? -1 : 1;
    if (x->distance != y->distance) return x->distance < y->distance ? -1 : 1;
    return (x->from[0] > y->from[0]) - (x->from[0] < y->from[0]);
}

/* Lists the gutters that take the light of a texel of their own chart, in the order of its block. */
static bool list_copies(const struct lw_texels *texels, const struct lw_tiles *tiles, const uint8_t *taken,
                        struct lw_seam_gutters *out) {
    uint32_t *first = out->first_copy = calloc((size_t)tiles->block_count + 2, sizeof *first);
    if (!first) return false;
    size_t count = 0;
    /* counting sort; while it runs, first[b + 1] is where block b's next goes */
    for (uint32_t t = 0; t < texels->count; t++) {
        if (!texels->filled[t] || taken[t]) continue;
        first[tiles->block_of_texel[texels->source[t]] + 2]++;
        count++;
    }
    for (uint32_t b = 2; b < tiles->block_count + 2; b++) first[b] += first[b - 1];
    out->block_count = tiles->block_count;
    if (!(out->copy = malloc((count + 1) * sizeof *out->copy))) return false;
    for (uint32_t t = 0; t < texels->count; t++)
        if (texels->filled[t] && !taken[t])
            out->copy[first[tiles->block_of_texel[texels->source[t]] + 1]++] =
                (struct lw_seam_copy){.texel = t, .from = texels->source[t]};
    return true;
}

static bool list_gutters(const struct lw_scene *scene, const struct lw_texels *texels,
                         const struct lw_seam_edges *edges, uint8_t *welded,
                         struct lw_seam_gutters *gutters) {
    for (size_t e = 0; e < edges->count; e++) {
        struct bank bank[2];
        if (!make_bank(scene, texels, &edges->edge[e], 0, &bank[0]) ||
            !make_bank(scene, texels, &edges->edge[e], 1, &bank[1]))
            continue;
        if (!list(texels, &bank[0], &bank[1], welded, gutters) ||
            !list(texels, &bank[1], &bank[0], welded, gutters))
            return false;
    }
    /* the nearest of several seams counts */
    if (gutters->count) qsort(gutters->gutter, gutters->count, sizeof *gutters->gutter, by_texel);
    size_t kept = 0;
    for (size_t i = 0; i < gutters->count; i++) {
        if (welded[gutters->gutter[i].texel]) continue;
        welded[gutters->gutter[i].texel] = 1;
        gutters->gutter[kept++] = gutters->gutter[i];
    }
    gutters->count = kept;
    return true;
}

enum lw_status lw_seam_gutters_find(const struct lw_scene *scene, const struct lw_texels *texels,
                                    const struct lw_tiles *tiles, const struct lw_seam_edges *edges,
                                    uint8_t *welded, struct lw_seam_gutters *out_gutters) {
    struct lw_seam_gutters gutters = {0};
    if (!list_gutters(scene, texels, edges, welded, &gutters) ||
        !list_copies(texels, tiles, welded, &gutters)) {
        lw_seam_gutters_finish(&gutters);
        return LW_NO_MEMORY;
    }
    *out_gutters = gutters;
    return LW_OK;
}

void lw_seam_gutters_finish(struct lw_seam_gutters *gutters) {
    free(gutters->gutter);
    free(gutters->copy);
    free(gutters->first_copy);
    *gutters = (struct lw_seam_gutters){0};
}

size_t lw_seam_gutters_memory_bytes(const struct lw_seam_gutters *gutters) {
    if (!gutters->first_copy) return 0;
    return gutters->capacity * sizeof *gutters->gutter +
           gutters->first_copy[gutters->block_count] * sizeof *gutters->copy +
           gutters->block_count * sizeof *gutters->first_copy;
}

static bool is_shown(const struct lw_tiles *tiles, uint32_t texel, uint64_t frame) {
    return tiles->block[tiles->block_of_texel[texel]].shown_frame == frame;
}

static void note_shown(struct lw_tiles *tiles, uint32_t texel, uint64_t frame) {
    const uint32_t id = tiles->block[tiles->block_of_texel[texel]].tile_id;
    __atomic_store_n(&lw_tiles_at(tiles, (lw_tile_id){id})->light.solved_frame, frame, __ATOMIC_RELAXED);
}

static void fill_beyond(const struct lw_seam_gutter *gutter, float *plane) {
    float sum = 0;
    for (int k = 0; k < 4; k++) sum += gutter->weight[k] * plane[gutter->from[k]];
    plane[gutter->texel] = sum;
}

static void fill_copies(const struct lw_seam_copy *first, const struct lw_seam_copy *end, float *plane) {
    for (const struct lw_seam_copy *copy = first; copy < end; copy++) plane[copy->texel] = plane[copy->from];
}

void lw_seam_gutters_fill(const struct lw_seam_gutters *gutters, struct lw_tiles *tiles, uint64_t frame,
                          uint32_t channels, int threads) {
#pragma omp parallel num_threads(threads)
    {
#pragma omp for schedule(static)
        for (size_t g = 0; g < gutters->count; g++) {
            const struct lw_seam_gutter *gutter = &gutters->gutter[g];
            bool shown = false;
            for (int k = 0; k < 4 && !shown; k++) shown = is_shown(tiles, gutter->from[k], frame);
            if (!shown) continue;
            LW_TILE_CHANNELS_EACH (channel, channels)
                for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
                    fill_beyond(gutter, tiles->shown[channel][p]);
            note_shown(tiles, gutter->texel, frame);
        }
#pragma omp for schedule(dynamic, 64)
        for (uint32_t b = 0; b < gutters->block_count; b++) {
            if (tiles->block[b].shown_frame != frame) continue;
            const struct lw_seam_copy *const first = gutters->copy + gutters->first_copy[b],
                                             *const end = gutters->copy + gutters->first_copy[b + 1];
            LW_TILE_CHANNELS_EACH (channel, channels)
                for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
                    fill_copies(first, end, tiles->shown[channel][p]);
            for (const struct lw_seam_copy *copy = first; copy < end; copy++)
                if (tiles->block_of_texel[copy->texel] != b) note_shown(tiles, copy->texel, frame);
        }
    }
}
