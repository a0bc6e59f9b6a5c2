#include "common/lightmap/lightmap_plane.h"

#include <stdlib.h>

/* Deeper than the rounding of single precision on an atlas of 16384 texels, shallower than anything one can
 * see. */
#define TOLERANCE 0.002f

/* A triangle sits in the grid whose cells are just larger than itself, so it is in four cells at most. */
#define LEVELS    32
#define LEVEL_MIN (-8) /* cells of 1/256 texel */
#define NOWHERE   UINT32_MAX

/* Triangles of a fan all meet where its hub is, and giants meet all dwarfs: to compare each with each would
 * take the square of their number. After this many comparisons in all, a triangle is compared
 * with a few; where more are near, it counts as overlapping, and starts a chart of its own. Meshes that
 * people make need a tenth of this. */
#define COMPARISONS_EACH 512u
#define COMPARISONS_MORE (1u << 20)
#define COMPARISONS_FEW  64u

struct bounds {
    float low[2], high[2];
};

struct placed {
    struct lw_vec2 corner[3];
    struct bounds bounds;
};

struct bucket {
    uint32_t round, first; /* first entry, if round is the plane's */
};

struct entry {
    uint32_t placed, next;
};

struct lw_lightmap_plane {
    uint32_t round, count, entry_count, levels, bucket_mask;
    uint64_t comparisons; /* how many are left */
    struct placed *placed;
    struct entry *entry;
    struct bucket *bucket;
};

enum lw_status lw_lightmap_plane_create(uint32_t triangle_capacity, struct lw_lightmap_plane **out_plane) {
    struct lw_lightmap_plane *plane = calloc(1, sizeof *plane);
    if (!plane) return LW_NO_MEMORY;
    size_t buckets = 64, capacity = (size_t)triangle_capacity + 1;
    while (buckets < capacity * 2) buckets *= 2;
    plane->bucket_mask = (uint32_t)(buckets - 1);
    plane->placed = malloc(capacity * sizeof *plane->placed);
    plane->entry = malloc(capacity * 4 * sizeof *plane->entry);
    plane->bucket = calloc(buckets, sizeof *plane->bucket);
    if (!plane->placed || !plane->entry || !plane->bucket) {
        lw_lightmap_plane_destroy(plane);
        return LW_NO_MEMORY;
    }
    plane->comparisons = (uint64_t)COMPARISONS_EACH * triangle_capacity + COMPARISONS_MORE;
    plane->round = 1;
    *out_plane = plane;
    return LW_OK;
}

void lw_lightmap_plane_destroy(struct lw_lightmap_plane *plane) {
    if (!plane) return;
    free(plane->placed);
    free(plane->entry);
    free(plane->bucket);
    free(plane);
}

void lw_lightmap_plane_clear(struct lw_lightmap_plane *plane) {
    plane->round++;
    plane->count = plane->entry_count = plane->levels = 0;
}

static struct bounds bounds_of(const struct lw_vec2 c[3]) {
    return (struct bounds){{fminf(c[0].x, fminf(c[1].x, c[2].x)), fminf(c[0].y, fminf(c[1].y, c[2].y))},
                           {fmaxf(c[0].x, fmaxf(c[1].x, c[2].x)), fmaxf(c[0].y, fmaxf(c[1].y, c[2].y))}};
}

static int level_of(const struct bounds *b) {
    int exponent;
    frexpf(fmaxf(b->high[0] - b->low[0], b->high[1] - b->low[1]), &exponent);
    exponent -= LEVEL_MIN;
    return exponent < 0 ? 0 : exponent >= LEVELS ? LEVELS - 1 : exponent;
}

static uint32_t bucket_of(const struct lw_lightmap_plane *plane, int level, int64_t x, int64_t y) {
    uint64_t h = (uint64_t)x * 0x9e3779b97f4a7c15u + (uint64_t)y * 0xc2b2ae3d27d4eb4fu + (uint64_t)level;
    h = (h ^ (h >> 29)) * 0xbf58476d1ce4e5b9u;
    return (uint32_t)(h >> 32) & plane->bucket_mask;
}

struct cells {
    int64_t low[2], high[2];
};

static struct cells cells_of(const struct bounds *b, int level) {
    struct cells cells;
    float per_texel = ldexpf(1.0f, -(level + LEVEL_MIN));
    for (int axis = 0; axis < 2; axis++) {
        cells.low[axis] = (int64_t)floorf(b->low[axis] * per_texel);
        cells.high[axis] = (int64_t)floorf(b->high[axis] * per_texel);
    }
    return cells;
}

void lw_lightmap_plane_add(struct lw_lightmap_plane *plane, const struct lw_vec2 corner[3]) {
    struct bounds bounds = bounds_of(corner);
    uint32_t number = plane->count++;
    plane->placed[number] = (struct placed){{corner[0], corner[1], corner[2]}, bounds};
    int level = level_of(&bounds);
    plane->levels |= 1u << level;
    struct cells cells = cells_of(&bounds, level);
    for (int64_t y = cells.low[1]; y <= cells.high[1] && y <= cells.low[1] + 1; y++)
        for (int64_t x = cells.low[0]; x <= cells.high[0] && x <= cells.low[0] + 1; x++) {
            struct bucket *bucket = &plane->bucket[bucket_of(plane, level, x, y)];
            plane->entry[plane->entry_count] =
                (struct entry){number, bucket->round == plane->round ? bucket->first : NOWHERE};
            *bucket = (struct bucket){plane->round, plane->entry_count++};
        }
}

/* Whether all of b lies outside one of a's sides (separating axis). */
static bool separated(const struct lw_vec2 a[3], const struct lw_vec2 b[3]) {
    for (int e = 0; e < 3; e++) {
        struct lw_vec2 p = a[e], q = a[(e + 1) % 3];
        float nx = p.y - q.y, ny = q.x - p.x, limit = TOLERANCE * sqrtf(nx * nx + ny * ny);
        bool outside = true;
        for (int k = 0; k < 3 && outside; k++) outside = nx * (b[k].x - p.x) + ny * (b[k].y - p.y) <= limit;
        if (outside) return true;
    }
    return false;
}

static bool hits_bounded(const struct placed *placed, const struct lw_vec2 corner[3],
                         const struct bounds *bounds) {
    for (int axis = 0; axis < 2; axis++)
        if (placed->bounds.low[axis] >= bounds->high[axis] - TOLERANCE ||
            placed->bounds.high[axis] <= bounds->low[axis] + TOLERANCE)
            return false;
    return !separated(placed->corner, corner) && !separated(corner, placed->corner);
}

/* One triangle that is compared with those that lie near. */
struct query {
    const struct lw_vec2 *corner;
    struct bounds bounds;
    uint64_t left; /* comparisons */
};

static bool hits(const struct placed *placed, struct query *query) {
    if (!query->left) return true;
    query->left--;
    return hits_bounded(placed, query->corner, &query->bounds);
}

static bool overlaps(const struct lw_lightmap_plane *plane, struct query *query) {
    const struct bounds bounds = query->bounds;
    for (int level = 0; level < LEVELS; level++) {
        if (!(plane->levels >> level & 1)) continue;
        struct cells cells = cells_of(&bounds, level);
        double wide = (double)(cells.high[0] - cells.low[0]) + 1,
               high = (double)(cells.high[1] - cells.low[1]) + 1;
        if (wide * high > (double)plane->count) { /* a giant among dwarfs: look at each of them once */
            for (uint32_t i = 0; i < plane->count; i++)
                if (hits(&plane->placed[i], query)) return true;
            return false;
        }
        for (int64_t y = cells.low[1]; y <= cells.high[1]; y++)
            for (int64_t x = cells.low[0]; x <= cells.high[0]; x++) {
                const struct bucket *bucket = &plane->bucket[bucket_of(plane, level, x, y)];
                if (bucket->round != plane->round) continue;
                for (uint32_t i = bucket->first; i != NOWHERE; i = plane->entry[i].next)
                    if (hits(&plane->placed[plane->entry[i].placed], query)) return true;
            }
    }
    return false;
}

bool lw_lightmap_plane_overlaps(struct lw_lightmap_plane *plane, const struct lw_vec2 corner[3]) {
    const uint64_t allowed = plane->comparisons > COMPARISONS_FEW ? plane->comparisons : COMPARISONS_FEW;
    struct query query = {.corner = corner, .bounds = bounds_of(corner), .left = allowed};
    const bool found = overlaps(plane, &query);
    const uint64_t used = allowed - query.left;
    plane->comparisons -= used < plane->comparisons ? used : plane->comparisons;
    return found;
}
