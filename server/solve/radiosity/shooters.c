#include "server/solve/radiosity/shooters.h"

#include "common/base/invariant.h"
#include "common/base/random.h"

#include <math.h>
#include <stdlib.h>

#define LANES LW_TRACE_WIDTH
/* The work's window: this part of a lightmap's side. */
#define SIDE_SHARE 128.0

/* Texels that are covered where nothing hides them. */
static uint32_t most_covered(const struct lw_texels *texels) {
    uint32_t count = 0;
    for (uint32_t o = 0; o < texels->scene->object_count; o++) {
        const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[o].mesh];
        for (uint32_t i = 0; i < mesh->texel_count; i++) count += mesh->covered[i];
    }
    return count;
}

enum lw_status lw_shooters_init(struct lw_shooters *shooters, const struct lw_patches *patches,
                                enum lw_undersample undersample, uint32_t side) {
    const uint32_t texels = patches->texels->count;
    uint32_t covered = 0;
    for (uint32_t i = 0; i < texels; i++) covered += patches->texels->covered[i];
    const uint32_t capacity = most_covered(patches->texels);
    if (!side) side = (uint32_t)fmax(1, sqrt((double)covered) / SIDE_SHARE + 0.5);
    if (undersample == LW_UNDERSAMPLE_NONE) side = 1;
    *shooters = (struct lw_shooters){
        .patches = patches, .undersample = undersample, .side = side, .capacity = capacity};
    shooters->shooter = aligned_alloc(64, (capacity + 1ul) * sizeof *shooters->shooter);
    shooters->member = malloc((capacity + 1ul) * sizeof *shooters->member);
    return shooters->shooter && shooters->member ? LW_OK : LW_NO_MEMORY;
}

void lw_shooters_finish(struct lw_shooters *shooters) {
    free(shooters->shooter);
    free(shooters->member);
    *shooters = (struct lw_shooters){0};
}

size_t lw_shooters_memory_bytes(const struct lw_shooters *shooters) {
    return shooters->capacity * (sizeof *shooters->shooter + sizeof *shooters->member);
}

/* One of a window's texels, with the probability of its area. */
static uint32_t choose_texel(const struct lw_shooters *shooters, const struct lw_shooter *s,
                             uint32_t random) {
    const float *area = shooters->patches->area_m2;
    float left = lw_random_unit(random) * s->area_m2;
    for (uint32_t i = s->first; i + 1 < s->first + s->count; i++)
        if ((left -= area[shooters->member[i]]) < 0) return shooters->member[i];
    return shooters->member[s->first + s->count - 1];
}

/* The mean place, raised along the mean normal until it is under none of its members: as far off the surface
 * as they are, or it would be in its own shadow. */
static void place_mean(const struct lw_shooters *shooters, struct lw_shooter *s) {
    const struct lw_patches *patches = shooters->patches;
    const uint32_t *member = shooters->member + s->first;
    struct lw_vec3 position = {0}, normal = {0}, n;
    float under = 0;
    for (uint32_t i = 0; i < s->count; i++) {
        const float share = s->area_m2 > 0 ? patches->area_m2[member[i]] / s->area_m2 : 1 / (float)s->count;
        position = lw_vec3_mad(position, lw_patches_place_of(patches, member[i], &n), share);
        normal = lw_vec3_mad(normal, n, share);
    }
    normal = lw_vec3_normalize(normal);
    for (uint32_t i = 0; i < s->count; i++)
        under = fmaxf(
            under, lw_vec3_dot(lw_vec3_sub(lw_patches_place_of(patches, member[i], &n), position), normal));
    lw_shooter_set_place(s, lw_vec3_mad(position, normal, under), normal);
}

static void place_shooter(struct lw_shooters *shooters, struct lw_shooter *s, uint32_t seed, uint32_t turn) {
    const struct lw_patches *patches = shooters->patches;
    const uint32_t *member = shooters->member + s->first;
    struct lw_vec3 normal;
    LW_INVARIANT(s->count > 0);
    s->area_m2 = 0;
    for (uint32_t i = 0; i < s->count; i++) s->area_m2 += patches->area_m2[member[i]];
    s->texel = shooters->undersample == LW_UNDERSAMPLE_RANDOM
                   ? choose_texel(shooters, s, lw_random_hash3(seed, member[0], turn))
                   : member[0];
    if (shooters->undersample == LW_UNDERSAMPLE_MIP) {
        place_mean(shooters, s);
        return;
    }
    const struct lw_vec3 position = lw_patches_place_of(patches, s->texel, &normal);
    lw_shooter_set_place(s, position, normal);
}

/* The covered texels of a window, chart by chart. */
static void add_window(struct lw_shooters *shooters, const struct lw_solve_tile *tile, uint32_t x0,
                       uint32_t y0, uint32_t *members) {
    const struct lw_patches *patches = shooters->patches;
    const uint32_t x1 = x0 + shooters->side < tile->width ? x0 + shooters->side : tile->width,
                   y1 = y0 + shooters->side < tile->height ? y0 + shooters->side : tile->height;
    const uint32_t before = shooters->count;
    for (uint32_t y = y0; y < y1; y++)
        for (uint32_t x = x0; x < x1; x++) {
            const uint32_t i = y * tile->width + x, chart = tile->mesh->chart[tile->local + i];
            if (patches->place[tile->first + i] == LW_TEXEL_NONE) continue;
            bool known = false;
            for (uint32_t k = before; k < shooters->count && !known; k++)
                known = shooters->shooter[k].texel == chart;
            LW_INVARIANT_DEAR(known || shooters->count < shooters->capacity);
            if (!known) shooters->shooter[shooters->count++] = (struct lw_shooter){.texel = chart};
        }
    for (uint32_t k = before; k < shooters->count; k++) {
        struct lw_shooter *s = &shooters->shooter[k];
        s->first = *members;
        for (uint32_t y = y0; y < y1; y++)
            for (uint32_t x = x0; x < x1; x++) {
                const uint32_t i = y * tile->width + x;
                if (patches->place[tile->first + i] == LW_TEXEL_NONE ||
                    tile->mesh->chart[tile->local + i] != s->texel)
                    continue;
                LW_INVARIANT_DEAR(*members < shooters->capacity);
                shooters->member[(*members)++] = tile->first + i;
                s->count++;
            }
    }
}

void lw_shooters_place(struct lw_shooters *shooters, uint32_t seed, uint32_t turn) {
    const struct lw_tiles *tiles = shooters->patches->tiles;
    uint32_t members = 0;
    shooters->count = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->hidden) continue;
        for (uint32_t y = 0; y < tile->height; y += shooters->side)
            for (uint32_t x = 0; x < tile->width; x += shooters->side)
                add_window(shooters, tile, x, y, &members);
    }
    LW_INVARIANT(members == shooters->patches->count); /* each patch has one shooter */
    for (uint32_t k = 0; k < shooters->count; k++) place_shooter(shooters, &shooters->shooter[k], seed, turn);
}

/* ---- the quad-tree ---- */

/* A square of texels, or nothing: chart NONE. */
struct square {
    bool whole; /* one shooter can stand for it */
    uint32_t chart;
    float area_m2;
    struct lw_vec3 radiance, normal; /* sums over the area */
};

struct tree {
    struct lw_shooters *shooters;
    const struct lw_solve_tile *tile;
    const float *radiance;
    uint32_t stride, members;
    float threshold, mean; /* mean: of |L| */
};

static struct lw_vec3 radiance_of(const struct tree *t, uint32_t texel) {
    const float *l = t->radiance + (size_t)texel * t->stride;
    return lw_vec3(l[0], l[1], l[2]);
}

static struct square texel_square(const struct tree *t, uint32_t x, uint32_t y) {
    const struct lw_patches *patches = t->shooters->patches;
    const uint32_t i = y * t->tile->width + x, texel = t->tile->first + i;
    struct square q = {.whole = true, .chart = LW_TEXEL_NONE};
    if (x >= t->tile->width || y >= t->tile->height || patches->place[texel] == LW_TEXEL_NONE) return q;
    struct lw_vec3 normal;
    lw_patches_place_of(patches, texel, &normal);
    q.chart = t->tile->mesh->chart[t->tile->local + i];
    q.area_m2 = fmaxf(patches->area_m2[texel], 1e-30f);
    q.radiance = lw_vec3_scale(radiance_of(t, texel), q.area_m2);
    q.normal = lw_vec3_scale(normal, q.area_m2);
    return q;
}

static bool are_alike(const struct tree *t, const struct square *a, const struct square *b) {
    if (a->chart == LW_TEXEL_NONE || b->chart == LW_TEXEL_NONE) return true;
    if (a->chart != b->chart) return false;
    const float light = lw_vec3_length(lw_vec3_sub(lw_vec3_scale(a->radiance, 1 / a->area_m2),
                                                   lw_vec3_scale(b->radiance, 1 / b->area_m2))),
                turn =
                    lw_vec3_length(lw_vec3_sub(lw_vec3_normalize(a->normal), lw_vec3_normalize(b->normal)));
    return 0.5f * light / t->mean + 0.5f * turn < t->threshold;
}

static void add_square(struct tree *t, uint32_t x0, uint32_t y0, uint32_t side) {
    struct lw_shooters *shooters = t->shooters;
    struct lw_shooter *s = &shooters->shooter[shooters->count];
    *s = (struct lw_shooter){.first = t->members};
    for (uint32_t y = y0; y < y0 + side && y < t->tile->height; y++)
        for (uint32_t x = x0; x < x0 + side && x < t->tile->width; x++) {
            const uint32_t texel = t->tile->first + y * t->tile->width + x;
            if (shooters->patches->place[texel] == LW_TEXEL_NONE) continue;
            LW_INVARIANT_DEAR(t->members < shooters->capacity && shooters->count < shooters->capacity);
            shooters->member[t->members++] = texel;
            s->count++;
        }
    if (s->count) shooters->count++;
}

/* The square at a place; where it is not whole, its quarters have become shooters. */
static struct square split(struct tree *t, uint32_t x, uint32_t y, uint32_t side) {
    struct square quarter[4], all = {.whole = true, .chart = LW_TEXEL_NONE};
    const uint32_t half = side / 2;
    if (side == 1) return texel_square(t, x, y);
    for (uint32_t k = 0; k < 4; k++) {
        quarter[k] = split(t, x + (k & 1) * half, y + (k >> 1) * half, half);
        all.whole &= quarter[k].whole;
    }
    for (uint32_t k = 0; k < 4 && all.whole; k++) {
        for (uint32_t j = 0; j < k; j++) all.whole &= are_alike(t, &quarter[j], &quarter[k]);
        if (quarter[k].chart == LW_TEXEL_NONE) continue;
        all.chart = quarter[k].chart;
        all.area_m2 += quarter[k].area_m2;
        all.radiance = lw_vec3_add(all.radiance, quarter[k].radiance);
        all.normal = lw_vec3_add(all.normal, quarter[k].normal);
    }
    for (uint32_t k = 0; k < 4 && !all.whole; k++)
        if (quarter[k].whole) add_square(t, x + (k & 1) * half, y + (k >> 1) * half, half);
    return all;
}

void lw_shooters_subdivide(struct lw_shooters *shooters, float threshold, const float *radiance,
                           uint32_t stride) {
    const struct lw_patches *patches = shooters->patches;
    const struct lw_tiles *tiles = patches->tiles;
    struct tree t = {.shooters = shooters, .radiance = radiance, .stride = stride, .threshold = threshold};
    double light = 0, area = 0;
    for (uint32_t p = 0; p < patches->packet_count; p++)
        for (int i = 0; i < LANES && patches->packet[p].active >> i & 1; i++) {
            const uint32_t texel = patches->packet[p].texel[i];
            const float l = lw_vec3_length(radiance_of(&t, texel));
            light += (double)l * (double)patches->area_m2[texel];
            area += l > 0 ? (double)patches->area_m2[texel] : 0;
        }
    t.mean = light > 0 ? (float)(light / area) : 1;
    shooters->count = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        t.tile = &tiles->tile[i];
        for (uint32_t y = 0; y < t.tile->height && !t.tile->hidden; y += LW_TILE_BLOCK)
            for (uint32_t x = 0; x < t.tile->width; x += LW_TILE_BLOCK)
                if (split(&t, x, y, LW_TILE_BLOCK).whole) add_square(&t, x, y, LW_TILE_BLOCK);
    }
    LW_INVARIANT(t.members == patches->count); /* each patch has one shooter */
    shooters->undersample = LW_UNDERSAMPLE_MIP;
    for (uint32_t k = 0; k < shooters->count; k++) place_shooter(shooters, &shooters->shooter[k], 0, 0);
    lw_shooters_charge(shooters, radiance, stride, 1);
}

/* ---- what they send ---- */

void lw_shooters_charge(struct lw_shooters *shooters, const float *radiance, uint32_t stride, int threads) {
    const bool of_all = shooters->undersample == LW_UNDERSAMPLE_MIP;
    const float *area = shooters->patches->area_m2;
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t k = 0; k < shooters->count; k++) {
        struct lw_shooter *s = &shooters->shooter[k];
        for (int c = 0; c < 3; c++) {
            float sum = 0;
            for (uint32_t i = s->first; of_all && i < s->first + s->count; i++)
                sum += radiance[(size_t)shooters->member[i] * stride + (size_t)c] * area[shooters->member[i]];
            s->flux_w[c] =
                LW_PI * (of_all ? sum : radiance[(size_t)s->texel * stride + (size_t)c] * s->area_m2);
        }
    }
}
