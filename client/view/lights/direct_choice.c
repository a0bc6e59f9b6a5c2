#include "client/view/lights/direct_choice.h"

#include "common/base/wide.h"

#include <stdlib.h>

#define LANES  LW_DIRECT_LANES
#define BLOCKS LW_DIRECT_BLOCKS

/* Lights that may give less than this share of the tile's light together have no shadow ray. */
#define TAIL_MIN 1e-3f

bool lw_direct_choice_region(const struct lw_direct_tile *tile, struct lw_direct_region *out) {
    struct lw_vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    bool any = false;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const struct lw_direct_block *block = &tile->block[b];
        for (uint32_t i = 0; block->active && i < LANES; i++) {
            if (!(block->active >> i & 1u)) continue;
            const float x = block->points.x[i], y = block->points.y[i], z = block->points.z[i];
            low = lw_vec3(x < low.x ? x : low.x, y < low.y ? y : low.y, z < low.z ? z : low.z);
            high = lw_vec3(x > high.x ? x : high.x, y > high.y ? y : high.y, z > high.z ? z : high.z);
            any = true;
        }
    }
    out->low = low, out->high = high;
    out->middle = lw_vec3_scale(lw_vec3_add(low, high), 0.5f);
    out->radius_m = 0.5f * lw_vec3_length(lw_vec3_sub(high, low));
    return any;
}

/* bound    upper bound of each candidate's E within a region
 * typical  about its E there */
LW_WIDE static void bound_all(const struct lw_direct_candidates *restrict c, uint32_t first, uint32_t count,
                              struct lw_direct_region at, float *restrict bound, float *restrict typical) {
    for (uint32_t i = first; i < count; i++) {
        const float dx = c->x[i] - at.middle.x, dy = c->y[i] - at.middle.y, dz = c->z[i] - at.middle.z;
        const float bx = fmaxf(0, fmaxf(at.low.x - c->x[i], c->x[i] - at.high.x)),
                    by = fmaxf(0, fmaxf(at.low.y - c->y[i], c->y[i] - at.high.y)),
                    bz = fmaxf(0, fmaxf(at.low.z - c->z[i], c->z[i] - at.high.z));
        const float d2 = dx * dx + dy * dy + dz * dz, apart = sqrtf(bx * bx + by * by + bz * bz);
        const float beyond = apart - c->radius_m[i],
                    nearest = beyond > c->radius_m[i] ? beyond : c->radius_m[i];
        const float near2 = nearest * nearest > 1e-4f ? nearest * nearest : 1e-4f;
        /* a spot: whether the region's ball lies off its cone. Along the axis and aside: */
        const float along = -(dx * c->axis_x[i] + dy * c->axis_y[i] + dz * c->axis_z[i]),
                    aside2 = d2 - along * along, aside = sqrtf(aside2 > 0 ? aside2 : 0);
        const bool outside = aside * c->cos_reach[i] - along * c->sin_reach[i] > at.radius_m;
        const bool none = outside & (c->cos_reach[i] > -1);
        bound[i] = none ? 0 : c->intensity[i] / near2;
        typical[i] = none ? 0 : c->intensity[i] / (d2 + at.radius_m * at.radius_m + near2);
    }
}

static int by_bound(const void *left, const void *right) {
    const struct lw_direct_chosen *a = left, *b = right;
    if (a->bound != b->bound) return a->bound > b->bound ? -1 : 1;
    return a->candidate < b->candidate ? -1 : a->candidate > b->candidate;
}

struct lw_direct_choice lw_direct_choice_make(const struct lw_direct_pixels *d, struct lw_direct_work *w,
                                              const struct lw_direct_region *region) {
    const struct lw_direct_candidates *c = &d->candidates;
    struct lw_direct_choice choice = {0};
    if (w->bound_capacity < c->count) {
        free(w->bound), free(w->order);
        w->bound = malloc(2ul * c->count * sizeof *w->bound);
        w->order = malloc(c->count * sizeof *w->order);
        w->bound_capacity = w->bound && w->order ? c->count : 0;
        if (!w->bound_capacity) return choice;
    }
    float *typical = w->bound + c->count, white = d->white, tail = 0;
    uint32_t suns = 0;
    while (suns < c->count && c->kind[suns] == LW_DIRECT_SUN) w->bound[suns] = c->intensity[suns], suns++;
    bound_all(c, suns, c->count, *region, w->bound, typical);
    for (uint32_t i = suns; i < c->count; i++) white += typical[i];
    for (uint32_t i = 0; i < c->count; i++)
        if (w->bound[i] > 0) w->order[choice.count++] = (struct lw_direct_chosen){i, w->bound[i]};
    qsort(w->order, choice.count, sizeof *w->order, by_bound);
    while (choice.count > 0 && tail + w->order[choice.count - 1].bound <= TAIL_MIN * white)
        tail += w->order[--choice.count].bound;
    choice.kept = choice.count < LW_DIRECT_TILE_LIGHTS_MAX ? choice.count : LW_DIRECT_TILE_LIGHTS_MAX;
    for (uint32_t i = choice.kept; i < choice.count; i++) choice.rest += w->order[i].bound;
    return choice;
}

bool lw_direct_choice_has_extent(const struct lw_direct_pixels *d, uint32_t candidate) {
    switch ((enum lw_direct_kind)d->candidates.kind[candidate]) {
    case LW_DIRECT_SUN:
        return d->desc.scene->light[d->candidates.index[candidate]].angular_diameter > 0;
    case LW_DIRECT_NEAR:
        return false;
    case LW_DIRECT_CLUSTER:
        break;
    }
    return true;
}

bool lw_direct_choice_is_far(const struct lw_direct_candidates *c, uint32_t i,
                             const struct lw_direct_region *region) {
    const struct lw_vec3 way = lw_vec3_sub(lw_vec3(c->x[i], c->y[i], c->z[i]), region->middle);
    return lw_vec3_length(way) > 6 * region->radius_m;
}
