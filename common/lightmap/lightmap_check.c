#include "common/lightmap/lightmap_check.h"

#include "common/base/union_find.h"
#include "common/lightmap/lightmap.h"
#include "common/lightmap/lightmap_topology.h"
#include "common/scene/mesh_weld.h"

#include <stdlib.h>
#include <string.h>

/* A share of a texel that rounding alone can give. */
#define AREA_NOISE 1e-3f

/* Two pieces are one where they meet in space and lie this close in the atlas: a cut that was closed
 * again. */
#define SEAM_TEXELS 0.25f

/* At most this many distinct places of one position are compared: a mesh whose triangles all meet in one
 * point must not cost their square. Pieces that stay unjoined count as overlapping, which is the safe
 * side. */
#define SHEETS_MAX 64

/* Places this far apart do not see the same light. Two points that read one texel are two texels apart on
 * both axes at most, and the surface between them is shrunk to 0.7 at most. */
#define FAR_TEXELS 4.0f

/* One texel, less a margin for rounding: from one texel on a bilinear weight is zero. */
#define READ_REACH 0.998f

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
        twice += lw_vec2_twice_area(a, b, c);
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

/* Pieces: triangles that share corners in the atlas, or meet in space and nearly in the atlas. Works on the
 * corners, three per triangle. */
static enum lw_status find_pieces(const struct lw_lightmap_map *map, uint32_t *out_piece) {
    const struct lw_mesh *mesh = map->mesh;
    size_t corners = (size_t)mesh->triangle_count * 3;
    uint32_t *weld = malloc(((size_t)mesh->vertex_count + 1) * sizeof *weld);
    uint32_t *parent = malloc((corners + 1) * sizeof *parent), *next = malloc((corners + 1) * sizeof *next);
    uint32_t *head = malloc(((size_t)mesh->vertex_count + 1) * sizeof *head), weld_count;
    enum lw_status status = weld && parent && next && head ? LW_OK : LW_NO_MEMORY;
    if (status == LW_OK) status = lw_mesh_weld(mesh, weld, &weld_count);
    if (status == LW_OK) {
        memset(head, 0xff, (size_t)mesh->vertex_count * sizeof *head);
        for (uint32_t c = 0; c < corners; c++) {
            parent[c] = c;
            lw_union_find_join(parent, c, c / 3 * 3);
            /* the list holds one corner per distinct place in the atlas, so it stays short */
            uint32_t at = weld[mesh->triangle[c / 3][c % 3]], other = head[at];
            struct lw_vec2 a = map->uv[map->triangle[c / 3][c % 3]];
            bool known = false;
            for (int step = 0; other != LW_SCENE_NONE && step < SHEETS_MAX; other = next[other], step++) {
                struct lw_vec2 b = map->uv[map->triangle[other / 3][other % 3]];
                if (fabsf(a.x - b.x) > SEAM_TEXELS || fabsf(a.y - b.y) > SEAM_TEXELS) continue;
                lw_union_find_join(parent, c, other);
                if (a.x == b.x && a.y == b.y) known = true;
            }
            if (known) continue;
            next[c] = head[at];
            head[at] = c;
        }
        for (uint32_t t = 0; t < mesh->triangle_count; t++) out_piece[t] = lw_union_find_root(parent, t * 3);
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

/* Places that read one texel: how far they reach along some directions. Width along any of them is at most
 * the distance of the farthest two, so nothing is counted that should not be; along the best it is 0.9 of it
 * at least. */
#define DIRECTIONS 7
static const float DIRECTION[DIRECTIONS][3] = {
    {1, 0, 0},
    {0, 1, 0},
    {0, 0, 1},
    {0.57735027f, 0.57735027f, 0.57735027f},
    {-0.57735027f, 0.57735027f, 0.57735027f},
    {0.57735027f, -0.57735027f, 0.57735027f},
    {0.57735027f, 0.57735027f, -0.57735027f},
};

struct extents {
    float low[DIRECTIONS], high[DIRECTIONS];
};

static void include(struct extents *extents, struct lw_vec3 p) {
    for (int i = 0; i < DIRECTIONS; i++) {
        const float *d = DIRECTION[i];
        float along = d[0] * p.x + d[1] * p.y + d[2] * p.z;
        extents->low[i] = fminf(extents->low[i], along);
        extents->high[i] = fmaxf(extents->high[i], along);
    }
}

/* The polygon's point that is nearest to p, which may lie inside. */
static struct lw_vec2 nearest_point(const struct polygon *polygon, struct lw_vec2 p) {
    struct lw_vec2 best = p;
    float least = INFINITY;
    bool left = true, right = true;
    for (int i = 0; i < polygon->count; i++) {
        struct lw_vec2 a = polygon->corner[i], b = polygon->corner[(i + 1) % polygon->count];
        float dx = b.x - a.x, dy = b.y - a.y, squared = dx * dx + dy * dy;
        float side = dx * (p.y - a.y) - dy * (p.x - a.x);
        left = left && side >= 0, right = right && side <= 0;
        float s = squared > 0 ? ((p.x - a.x) * dx + (p.y - a.y) * dy) / squared : 0;
        s = fminf(fmaxf(s, 0), 1);
        struct lw_vec2 q = {a.x + s * dx, a.y + s * dy};
        float distance = hypotf(q.x - p.x, q.y - p.y);
        if (distance < least) least = distance, best = q;
    }
    return left || right ? p : best;
}

/* The part of a polygon, which lies between low and high on an axis, that is within READ_REACH of a texel's
 * centre. */
static struct polygon part_within(const struct polygon *whole, bool along_y, float centre, float low,
                                  float high) {
    if (low >= centre - READ_REACH && high <= centre + READ_REACH) return *whole;
    struct polygon above, part;
    clip(whole, along_y, centre - READ_REACH, 1, &above);
    clip(&above, along_y, centre + READ_REACH, -1, &part);
    return part;
}

typedef void visit_read(void *context, uint32_t triangle, size_t texel, const struct polygon *part);

/* Visits every texel whose centre a triangle comes nearer to than a texel, both axes alike, with the part of
 * it that does. Bilinear lookups of its points read these texels. */
static void visit_reads(const struct lw_lightmap_map *map, uint32_t t, visit_read *each, void *context) {
    struct polygon whole = {.count = 3};
    struct lw_vec2 low = {INFINITY, INFINITY}, high = {-INFINITY, -INFINITY};
    for (int k = 0; k < 3; k++) {
        struct lw_vec2 c = whole.corner[k] = map->uv[map->triangle[t][k]];
        low = (struct lw_vec2){fminf(low.x, c.x), fminf(low.y, c.y)};
        high = (struct lw_vec2){fmaxf(high.x, c.x), fmaxf(high.y, c.y)};
    }
    for (uint32_t y = first_texel(low.y - 0.5f), y_end = last_texel(high.y + 0.5f, map->height); y < y_end;
         y++) {
        const struct polygon row = part_within(&whole, true, (float)y + 0.5f, low.y, high.y);
        for (uint32_t x = first_texel(low.x - 0.5f), x_end = last_texel(high.x + 0.5f, map->width); x < x_end;
             x++) {
            const struct polygon cell = part_within(&row, false, (float)x + 0.5f, low.x, high.x);
            if (cell.count > 2 && area_of(&cell) > 0) each(context, t, (size_t)y * map->width + x, &cell);
        }
    }
}

struct places {
    const struct lw_lightmap_map *map;
    struct extents *extents; /* per texel */
};

/* Notes for a texel where that point of a triangle lies which is nearest to its centre. */
static void note_place(void *context, uint32_t t, size_t texel, const struct polygon *part) {
    const struct places *places = context;
    const struct lw_lightmap_map *map = places->map;
    const struct lw_vec2 o = map->uv[map->triangle[t][0]], b = map->uv[map->triangle[t][1]],
                         c = map->uv[map->triangle[t][2]];
    const float ux = b.x - o.x, uy = b.y - o.y, vx = c.x - o.x, vy = c.y - o.y, det = ux * vy - uy * vx;
    if (!(fabsf(det) > 1e-12f)) return;
    const struct lw_vec2 centre = {(float)(texel % map->width) + 0.5f, (float)(texel / map->width) + 0.5f},
                         at = nearest_point(part, centre);
    const float u = ((at.x - o.x) * vy - (at.y - o.y) * vx) / det,
                v = (ux * (at.y - o.y) - uy * (at.x - o.x)) / det;
    const uint32_t *corner = map->mesh->triangle[t];
    const struct lw_vec3 *p = map->mesh->position;
    struct lw_vec3 along = lw_vec3_mad(p[corner[0]], lw_vec3_sub(p[corner[1]], p[corner[0]]), u);
    include(&places->extents[texel], lw_vec3_mad(along, lw_vec3_sub(p[corner[2]], p[corner[0]]), v));
}

/* Side of a texel, in the mesh's units: one for all. */
static double texel_side(const struct lw_lightmap_map *map) {
    double area_uv = 0, area_os = 0;
    for (uint32_t t = 0; t < map->mesh->triangle_count; t++) {
        const uint32_t *v = map->mesh->triangle[t], *w = map->triangle[t];
        struct lw_vec3 p = map->mesh->position[v[0]];
        struct lw_vec2 a = map->uv[w[0]], b = map->uv[w[1]], c = map->uv[w[2]];
        area_os += (double)lw_vec3_length(lw_vec3_cross(lw_vec3_sub(map->mesh->position[v[1]], p),
                                                        lw_vec3_sub(map->mesh->position[v[2]], p)));
        area_uv += (double)fabsf(lw_vec2_twice_area(a, b, c));
    }
    return area_uv > 0 ? sqrt(area_os / area_uv) : 0;
}

enum lw_status lw_lightmap_check_mixed(const struct lw_lightmap_map *map, uint64_t *out_texels) {
    size_t texels = (size_t)map->width * map->height;
    struct extents *extents = malloc((texels + 1) * sizeof *extents);
    if (!extents) return LW_NO_MEMORY;
    for (size_t i = 0; i < texels; i++)
        for (int k = 0; k < DIRECTIONS; k++) extents[i].low[k] = INFINITY, extents[i].high[k] = -INFINITY;
    struct places places = {map, extents};
    for (uint32_t t = 0; t < map->mesh->triangle_count; t++) visit_reads(map, t, note_place, &places);
    float limit = FAR_TEXELS * (float)texel_side(map);
    uint64_t count = 0;
    for (size_t i = 0; i < texels; i++) {
        bool far = false;
        for (int k = 0; k < DIRECTIONS; k++) far = far || extents[i].high[k] - extents[i].low[k] > limit;
        count += far;
    }
    free(extents);
    *out_texels = count;
    return LW_OK;
}

/* ---- levels ---- */

/* The pieces whose light the texels of a level have. */
struct mixture {
    const uint32_t *piece; /* per triangle */
    uint32_t *owner;       /* per texel: its piece; LW_SCENE_NONE: nobody's; MIXED: of several */
    uint8_t level;
    uint8_t *coarsest; /* per triangle */
};

#define MIXED (LW_SCENE_NONE - 1)

static void join_owners(uint32_t *owner, uint32_t other) {
    if (other == LW_SCENE_NONE || other == *owner) return;
    *owner = *owner == LW_SCENE_NONE ? other : MIXED;
}

/* Coarser levels are means of all texels that look-ups of level 0 read, gutters included. */
static void own(void *context, uint32_t triangle, size_t texel, const struct polygon *part) {
    struct mixture *m = context;
    (void)part;
    join_owners(&m->owner[texel], m->piece[triangle]);
}

/* Takes the owners a level up, in place. */
static void halve_owners(uint32_t *owner, uint32_t width, uint32_t height) {
    const uint32_t half = (width + 1) / 2;
    for (uint32_t y = 0; y < height; y += 2)
        for (uint32_t x = 0; x < width; x += 2) {
            uint32_t of_four = LW_SCENE_NONE;
            for (uint32_t v = y; v < y + 2 && v < height; v++)
                for (uint32_t u = x; u < x + 2 && u < width; u++)
                    join_owners(&of_four, owner[(size_t)v * width + u]);
            owner[(size_t)(y / 2) * half + x / 2] = of_four;
        }
}

static void find_mixed(void *context, uint32_t triangle, size_t texel, const struct polygon *part) {
    struct mixture *m = context;
    (void)part;
    if (m->owner[texel] != LW_SCENE_NONE && m->owner[texel] != m->piece[triangle])
        m->coarsest[triangle] = m->level - 1;
}

enum lw_status lw_lightmap_check_coarsest(const struct lw_lightmap_map *map, uint8_t *out_level) {
    const uint32_t triangles = map->mesh->triangle_count;
    const size_t texels = (size_t)map->width * map->height;
    struct lw_vec2 *uv = malloc(((size_t)map->uv_count + 1) * sizeof *uv);
    uint32_t *piece = malloc(((size_t)triangles + 1) * sizeof *piece);
    struct mixture m = {piece, malloc((texels + 1) * sizeof *m.owner), 0, out_level};
    enum lw_status status = uv && piece && m.owner ? find_pieces(map, piece) : LW_NO_MEMORY;
    if (status == LW_OK) {
        memset(m.owner, 0xff, texels * sizeof *m.owner);
        for (uint32_t t = 0; t < triangles; t++) visit_reads(map, t, own, &m);
        memset(out_level, LW_LIGHTMAP_LEVEL_MAX, triangles);
    }
    struct lw_lightmap_map coarse = *map; /* the same, whose texels are the level's */
    coarse.uv = uv;
    for (m.level = 1; m.level <= LW_LIGHTMAP_LEVEL_MAX && status == LW_OK; m.level++) {
        halve_owners(m.owner, coarse.width, coarse.height);
        coarse.width = (coarse.width + 1) / 2, coarse.height = (coarse.height + 1) / 2;
        const float scale = 1.0f / (float)(1u << m.level);
        for (uint32_t v = 0; v < map->uv_count; v++)
            uv[v] = (struct lw_vec2){map->uv[v].x * scale, map->uv[v].y * scale};
        for (uint32_t t = 0; t < triangles; t++)
            if (out_level[t] >= m.level) visit_reads(&coarse, t, find_mixed, &m);
    }
    free(m.owner);
    free(piece);
    free(uv);
    return status;
}
