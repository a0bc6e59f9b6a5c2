#include "common/scene/lightmap_check.h"

#include "common/scene/lightmap.h"
#include "common/scene/lightmap_topology.h"

#include <stdlib.h>
#include <string.h>

/* A share of a texel that rounding alone can give. */
#define AREA_NOISE 1e-3f

/* Two pieces are one where they meet in space and lie this close in the atlas: a cut that was closed again. */
#define SEAM_TEXELS 0.25f

/* So many distinct places of one position are looked at: a mesh whose triangles all meet in a point must not cost
 * their square. Pieces that go unjoined by it count as overlapping, which errs on the safe side. */
#define SHEETS_MAX 64

#define CORNERS_MAX 8 /* a triangle clipped by four lines has at most seven */

struct polygon {
    struct lw_vec2 corner[CORNERS_MAX];
    int count;
};

/* Keeps the part where sign * (coordinate - at) >= 0 (Sutherland and Hodgman 1974). */
static void clip(const struct polygon *in, bool along_y, float at, float sign, struct polygon *out) {
    out->count = 0;
    for (int i = 0; i < in->count; i++) {
        struct lw_vec2 p = in->corner[i], q = in->corner[(i + 1) % in->count];
        float dp = sign * ((along_y ? p.y : p.x) - at), dq = sign * ((along_y ? q.y : q.x) - at);
        if (dp >= 0) out->corner[out->count++] = p;
        if ((dp >= 0) != (dq >= 0)) {
            float s = dp / (dp - dq);
            out->corner[out->count++] = (struct lw_vec2){p.x + s * (q.x - p.x), p.y + s * (q.y - p.y)};
        }
    }
}

static float area_of(const struct polygon *p) {
    float twice = 0;
    for (int i = 1; i + 1 < p->count; i++) {
        struct lw_vec2 a = p->corner[0], b = p->corner[i], c = p->corner[i + 1];
        twice += (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    }
    return fabsf(twice) / 2;
}

typedef void visit(void *context, uint32_t triangle, size_t texel, float area);

static uint32_t first_texel(float low) { return low > 0 ? (uint32_t)low : 0; }
static uint32_t last_texel(float high, uint32_t count) {
    return high <= 0 ? 0 : high >= (float)count ? count : (uint32_t)ceilf(high);
}

static void visit_row(const struct lw_lightmap_map *map, uint32_t t, const struct polygon *row, uint32_t y,
                      visit *each, void *context) {
    float low = INFINITY, high = -INFINITY;
    for (int i = 0; i < row->count; i++) {
        low = fminf(low, row->corner[i].x);
        high = fmaxf(high, row->corner[i].x);
    }
    uint32_t end = last_texel(high, map->width);
    struct polygon rest = *row, right, cell;
    for (uint32_t x = first_texel(low); x < end && rest.count > 2; x++) {
        clip(&rest, false, (float)(x + 1), -1, &cell);
        if (x == 0) { /* what lies outside the atlas is not in its first texel */
            right = cell;
            clip(&right, false, 0, 1, &cell);
        }
        clip(&rest, false, (float)(x + 1), 1, &right);
        rest = right;
        float area = area_of(&cell);
        if (area > 0) each(context, t, (size_t)y * map->width + x, area);
    }
}

static void visit_triangle(const struct lw_lightmap_map *map, uint32_t t, visit *each, void *context) {
    struct polygon whole = {.count = 3}, above, row;
    float low = INFINITY, high = -INFINITY;
    for (int k = 0; k < 3; k++) {
        whole.corner[k] = map->uv[map->triangle[t][k]];
        low = fminf(low, whole.corner[k].y);
        high = fmaxf(high, whole.corner[k].y);
    }
    uint32_t end = last_texel(high, map->height);
    for (uint32_t y = first_texel(low); y < end; y++) {
        clip(&whole, true, (float)y, 1, &above);
        clip(&above, true, (float)(y + 1), -1, &row);
        if (row.count > 2) visit_row(map, t, &row, y, each, context);
    }
}

struct coverage {
    const uint8_t *back;
    uint8_t *seen; /* bit 0: front, bit 1: back */
};

static void cover(void *context, uint32_t triangle, size_t texel, float area) {
    struct coverage *c = context;
    (void)area;
    c->seen[texel] |= c->back && c->back[triangle] ? 3 : 1;
}

enum lw_status lw_lightmap_check_coverage(const struct lw_lightmap_map *map, const uint8_t *back,
                                          uint64_t *out_covered) {
    size_t texels = (size_t)map->width * map->height;
    struct coverage coverage = {back, calloc(texels + 1, 1)};
    if (!coverage.seen) return LW_NO_MEMORY;
    for (uint32_t t = 0; t < map->mesh->triangle_count; t++) visit_triangle(map, t, cover, &coverage);
    uint64_t covered = 0;
    for (size_t i = 0; i < texels; i++) covered += (uint64_t)(coverage.seen[i] & 1) + (coverage.seen[i] >> 1);
    free(coverage.seen);
    *out_covered = covered;
    return LW_OK;
}

static struct lw_vec3 difference(struct lw_vec3 a, struct lw_vec3 b, float s, struct lw_vec3 c,
                                 struct lw_vec3 d, float t) {
    return lw_vec3_sub(lw_vec3_scale(lw_vec3_sub(a, b), s), lw_vec3_scale(lw_vec3_sub(c, d), t));
}

void lw_lightmap_check_stretch(const struct lw_lightmap_map *map, float *out_rms, float *out_max) {
    double area_uv = 0, area_os = 0, weighted = 0, largest = 0;
    for (uint32_t t = 0; t < map->mesh->triangle_count; t++) {
        const uint32_t *v = map->mesh->triangle[t];
        struct lw_vec3 q0 = map->mesh->position[v[0]], q1 = map->mesh->position[v[1]],
                       q2 = map->mesh->position[v[2]];
        struct lw_vec2 a = map->uv[map->triangle[t][0]], b = map->uv[map->triangle[t][1]],
                       c = map->uv[map->triangle[t][2]];
        float s1 = b.x - a.x, s2 = c.x - a.x, t1 = b.y - a.y, t2 = c.y - a.y, twice = s1 * t2 - s2 * t1;
        double surface = (double)lw_vec3_length(lw_vec3_cross(lw_vec3_sub(q1, q0), lw_vec3_sub(q2, q0)));
        /* under a hundredth of a texel the quotients are those of rounding errors */
        if (fabsf(twice) < 0.01f || !(surface > 0)) continue;
        struct lw_vec3 ss = lw_vec3_scale(difference(q1, q0, t2, q2, q0, t1), 1 / twice);
        struct lw_vec3 st = lw_vec3_scale(difference(q2, q0, s1, q1, q0, s2), 1 / twice);
        double p = (double)lw_vec3_dot(ss, ss), q = (double)lw_vec3_dot(ss, st),
               r = (double)lw_vec3_dot(st, st);
        double greater = (p + r + sqrt((p - r) * (p - r) + 4 * q * q)) / 2; /* Gamma^2; the mean is L2^2 */
        area_uv += fabs((double)twice);
        area_os += surface;
        weighted += (p + r) / 2 * surface;
        if (greater > largest) largest = greater;
    }
    if (!(area_uv > 0 && area_os > 0)) {
        *out_rms = *out_max = 1;
        return;
    }
    double texel = area_os / area_uv; /* area of one, were they all alike */
    *out_rms = (float)sqrt(weighted / area_os / texel);
    *out_max = (float)sqrt(largest / texel);
}

struct overlap {
    const uint32_t *piece; /* per triangle */
    uint32_t *owner;       /* per texel */
    float *sum;            /* per texel: area of all triangles in it */
    uint8_t *twice;
};

static void claim(void *context, uint32_t triangle, size_t texel, float area) {
    struct overlap *o = context;
    o->sum[texel] += area;
    if (area > AREA_NOISE) {
        if (o->owner[texel] == LW_SCENE_NONE) o->owner[texel] = o->piece[triangle];
        if (o->owner[texel] != o->piece[triangle]) o->twice[texel] = 1;
    }
    if (o->sum[texel] > 1 + 10 * AREA_NOISE) o->twice[texel] = 1;
}

static uint32_t find(uint32_t *parent, uint32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

static void unite(uint32_t *parent, uint32_t a, uint32_t b) {
    a = find(parent, a), b = find(parent, b);
    if (a < b)
        parent[b] = a;
    else
        parent[a] = b;
}

/* Pieces: triangles that share corners in the atlas, or meet in space and nearly in the atlas. Works on the corners,
 * three per triangle. */
static enum lw_status find_pieces(const struct lw_lightmap_map *map, uint32_t *out_piece) {
    const struct lw_mesh *mesh = map->mesh;
    size_t corners = (size_t)mesh->triangle_count * 3;
    uint32_t *weld = malloc(((size_t)mesh->vertex_count + 1) * sizeof *weld);
    uint32_t *parent = malloc((corners + 1) * sizeof *parent), *next = malloc((corners + 1) * sizeof *next);
    uint32_t *head = malloc(((size_t)mesh->vertex_count + 1) * sizeof *head), weld_count;
    enum lw_status status = weld && parent && next && head ? LW_OK : LW_NO_MEMORY;
    if (status == LW_OK) status = lw_lightmap_topology_weld(mesh, weld, &weld_count);
    if (status == LW_OK) {
        memset(head, 0xff, (size_t)mesh->vertex_count * sizeof *head);
        for (uint32_t c = 0; c < corners; c++) {
            parent[c] = c;
            unite(parent, c, c / 3 * 3);
            /* the list holds one corner per distinct place in the atlas, so it stays short */
            uint32_t at = weld[mesh->triangle[c / 3][c % 3]], other = head[at];
            struct lw_vec2 a = map->uv[map->triangle[c / 3][c % 3]];
            bool known = false;
            for (int step = 0; other != LW_SCENE_NONE && step < SHEETS_MAX; other = next[other], step++) {
                struct lw_vec2 b = map->uv[map->triangle[other / 3][other % 3]];
                if (fabsf(a.x - b.x) > SEAM_TEXELS || fabsf(a.y - b.y) > SEAM_TEXELS) continue;
                unite(parent, c, other);
                if (a.x == b.x && a.y == b.y) known = true;
            }
            if (known) continue;
            next[c] = head[at];
            head[at] = c;
        }
        for (uint32_t t = 0; t < mesh->triangle_count; t++) out_piece[t] = find(parent, t * 3);
    }
    free(head);
    free(next);
    free(parent);
    free(weld);
    return status;
}

enum lw_status lw_lightmap_check_overlaps(const struct lw_lightmap_map *map, uint64_t *out_texels) {
    size_t texels = (size_t)map->width * map->height, triangles = map->mesh->triangle_count;
    uint32_t *piece = malloc((triangles + 1) * sizeof *piece);
    struct overlap overlap = {.piece = piece,
                              .owner = malloc((texels + 1) * sizeof *overlap.owner),
                              .sum = calloc(texels + 1, sizeof *overlap.sum),
                              .twice = calloc(texels + 1, 1)};
    enum lw_status status = LW_NO_MEMORY;
    if (piece && overlap.owner && overlap.sum && overlap.twice) status = find_pieces(map, piece);
    if (status == LW_OK) {
        memset(overlap.owner, 0xff, texels * sizeof *overlap.owner);
        for (uint32_t t = 0; t < triangles; t++) visit_triangle(map, t, claim, &overlap);
        uint64_t count = 0;
        for (size_t i = 0; i < texels; i++) count += overlap.twice[i];
        *out_texels = count;
    }
    free(overlap.twice);
    free(overlap.sum);
    free(overlap.owner);
    free(piece);
    return status;
}
