#include "common/lightmap/lightmap_apart.h"

#include <stdlib.h>

/* Two points share a texel if they are less than two texels apart on both axes. Charts are turned before they
 * are packed, hence the diagonal; they may shrink by a few percent, and points are taken from a line at
 * steps. */
#define REACH 3.1f

/* Places nearer than this may share a texel: that is what a texel is, and a surface shrinks to 0.7 at
 * most. */
#define FAR    3.5f
#define SHRINK 1.5f

/* Triangles that do not overlap come nearest at their sides, so points along the sides stand for them. */
#define STEP 0.75f

/* Longer than any atlas: such a side will be shortened before it is packed. */
#define STEPS_MAX 16384

#define CAPACITY_FIRST 1024u

/* One texel of the chart's plane; what came first stands for all that is in it, for all that is in it is
 * near. */
struct cell {
    int32_t x, y;
    uint32_t round; /* taken if it is the current one */
    struct lw_vec2 at;
    struct lw_vec3 place;
};

struct lw_lightmap_apart {
    uint32_t round, count;
    uint32_t capacity; /* a power of two */
    struct cell *cell;
};

enum lw_status lw_lightmap_apart_create(struct lw_lightmap_apart **out_apart) {
    struct lw_lightmap_apart *apart = calloc(1, sizeof *apart);
    if (!apart) return LW_NO_MEMORY;
    apart->capacity = CAPACITY_FIRST;
    apart->cell = calloc(apart->capacity, sizeof *apart->cell);
    if (!apart->cell) {
        free(apart);
        return LW_NO_MEMORY;
    }
    apart->round = 1;
    *out_apart = apart;
    return LW_OK;
}

void lw_lightmap_apart_destroy(struct lw_lightmap_apart *apart) {
    if (!apart) return;
    free(apart->cell);
    free(apart);
}

void lw_lightmap_apart_clear(struct lw_lightmap_apart *apart) {
    apart->round++;
    apart->count = 0;
}

/* The cell at x, y, or the free one where it would be. */
static struct cell *find(const struct lw_lightmap_apart *apart, int32_t x, int32_t y) {
    uint64_t h = (uint64_t)(uint32_t)x * 0x9e3779b97f4a7c15u + (uint64_t)(uint32_t)y * 0xc2b2ae3d27d4eb4fu;
    h = (h ^ (h >> 29)) * 0xbf58476d1ce4e5b9u;
    uint32_t at = (uint32_t)(h >> 32) & (apart->capacity - 1);
    while (apart->cell[at].round == apart->round && (apart->cell[at].x != x || apart->cell[at].y != y))
        at = (at + 1) & (apart->capacity - 1);
    return &apart->cell[at];
}

static enum lw_status enlarge(struct lw_lightmap_apart *apart) {
    if (apart->capacity > UINT32_MAX / 2) return LW_NO_MEMORY;
    struct lw_lightmap_apart larger = {apart->round, apart->count, apart->capacity * 2, NULL};
    larger.cell = calloc(larger.capacity, sizeof *larger.cell);
    if (!larger.cell) return LW_NO_MEMORY;
    for (uint32_t i = 0; i < apart->capacity; i++)
        if (apart->cell[i].round == apart->round)
            *find(&larger, apart->cell[i].x, apart->cell[i].y) = apart->cell[i];
    free(apart->cell);
    *apart = larger;
    return LW_OK;
}

/* Points along a side: their number, and each. */
static uint32_t steps_of(const struct lw_vec2 corner[3], int side) {
    struct lw_vec2 p = corner[side], q = corner[(side + 1) % 3];
    float steps = ceilf(hypotf(q.x - p.x, q.y - p.y) / STEP);
    return steps < 1 ? 1 : steps > STEPS_MAX ? STEPS_MAX : (uint32_t)steps;
}

static void point_of(const struct lw_vec2 corner[3], const struct lw_vec3 place[3], int side, float s,
                     struct lw_vec2 *out_at, struct lw_vec3 *out_place) {
    int next = (side + 1) % 3;
    struct lw_vec2 p = corner[side], q = corner[next];
    *out_at = (struct lw_vec2){p.x + s * (q.x - p.x), p.y + s * (q.y - p.y)};
    *out_place = lw_vec3_add(place[side], lw_vec3_scale(lw_vec3_sub(place[next], place[side]), s));
}

enum lw_status lw_lightmap_apart_add(struct lw_lightmap_apart *apart, const struct lw_vec2 corner[3],
                                     const struct lw_vec3 place[3]) {
    for (int side = 0; side < 3; side++) {
        uint32_t steps = steps_of(corner, side);
        for (uint32_t i = 0; i < steps; i++) {
            struct cell new = {.round = apart->round};
            point_of(corner, place, side, (float)i / (float)steps, &new.at, &new.place);
            new.x = (int32_t)floorf(new.at.x), new.y = (int32_t)floorf(new.at.y);
            struct cell *cell = find(apart, new.x, new.y);
            if (cell->round == apart->round) continue;
            *cell = new;
            if (++apart->count <= apart->capacity / 2) continue;
            enum lw_status status = enlarge(apart);
            if (status != LW_OK) return status;
        }
    }
    return LW_OK;
}

static bool is_mixed(const struct cell *cell, struct lw_vec2 at, struct lw_vec3 place) {
    float x = cell->at.x - at.x, y = cell->at.y - at.y, flat = x * x + y * y;
    if (flat > REACH * REACH) return false;
    struct lw_vec3 way = lw_vec3_sub(cell->place, place);
    float through = lw_vec3_dot(way, way);
    return through > FAR * FAR && through > SHRINK * SHRINK * flat;
}

bool lw_lightmap_apart_mixes(const struct lw_lightmap_apart *apart, const struct lw_vec2 corner[3],
                             const struct lw_vec3 place[3]) {
    for (int side = 0; side < 3; side++) {
        uint32_t steps = steps_of(corner, side);
        for (uint32_t i = 0; i < steps; i++) {
            struct lw_vec2 at;
            struct lw_vec3 here;
            point_of(corner, place, side, (float)i / (float)steps, &at, &here);
            int32_t right = (int32_t)floorf(at.x + REACH), top = (int32_t)floorf(at.y + REACH);
            for (int32_t y = (int32_t)floorf(at.y - REACH); y <= top; y++)
                for (int32_t x = (int32_t)floorf(at.x - REACH); x <= right; x++) {
                    const struct cell *cell = find(apart, x, y);
                    if (cell->round == apart->round && is_mixed(cell, at, here)) return true;
                }
        }
    }
    return false;
}
