#include "server/solve/surface/texels.h"

#include "common/base/invariant.h"
#include "common/base/progress.h"
#include "common/base/union_find.h"
#include "common/base/wide.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define TEXELS_MAX  (1u << 30)
#define GRAZED_AREA 0.125f /* texels^2 */
#define ALBEDO_SIDE 4      /* a texel has the mean albedo of those of 4 x 4 points that lie on its chart */

/* While a mesh is rasterised: which triangle a texel takes, and where on it. */
struct claim {
    uint32_t triangle; /* LW_TEXEL_NONE: nobody */
    float u, v;        /* barycentrics of the sample */
    float area;        /* the claiming triangle's inside the texel, texels^2; 2 if it holds the centre */
    float area_sum;    /* of all triangles inside the texel */
    /* The claiming triangle's; else the chart whose look-ups read the texel; LW_TEXEL_NONE: nobody's. */
    uint32_t chart;
    float read_area; /* the reading triangle's within a texel of the centre, texels^2 */
    bool back;
    /* The first spots that lie on the chart, ascending, and the triangle that
     * holds each; SPOT_BACK: its back */
    uint32_t spot[LW_SAMPLE_POINTS_MAX];
    uint8_t number[LW_SAMPLE_POINTS_MAX];
    /* Sums over points on the chart: of albedo times how much surface is there, of that, of albedo alone. */
    struct lw_vec3 albedo, plain_albedo;
    float surface;
    uint32_t albedo_points;
};
#define SPOT_BACK 0x80000000u
_Static_assert(LW_SAMPLE_POINTS_SPOTS <= UINT8_MAX + 1, "a spot's number");
_Static_assert(LW_SCENE_TRIANGLES_MAX <= SPOT_BACK, "a spot's word holds triangle and side");

/* Points of a texel's square that are looked at together. */
#define POINTS_MOST LW_SAMPLE_POINTS_SPOTS
struct points {
    float x[POINTS_MOST], y[POINTS_MOST];
};
_Static_assert(POINTS_MOST >= ALBEDO_SIDE * ALBEDO_SIDE && POINTS_MOST <= 64, "a bit for each");

/* One mesh under way. */
struct raster {
    const struct lw_scene *scene;
    const struct lw_mesh *mesh;
    struct lw_mesh_texels *texels;
    struct claim *claim; /* per texel */
    uint32_t *parent;    /* joins charts: twice as many as vertices */
    struct points spots, albedo_points;
    bool has_albedo; /* it is asked for */
};

static struct lw_vec2 minus(struct lw_vec2 a, struct lw_vec2 b) {
    return (struct lw_vec2){a.x - b.x, a.y - b.y};
}
static float cross2(struct lw_vec2 a, struct lw_vec2 b) { return a.x * b.y - a.y * b.x; }

/* Barycentrics (of corners 1 and 2) of a point in the plane; false for a triangle without area. */
static bool barycentrics(const struct lw_vec2 corner[3], struct lw_vec2 p, float *out_u, float *out_v) {
    struct lw_vec2 e1 = minus(corner[1], corner[0]), e2 = minus(corner[2], corner[0]),
                   d = minus(p, corner[0]);
    float area = cross2(e1, e2);
    if (area == 0) return false;
    *out_u = cross2(d, e2) / area;
    *out_v = cross2(e1, d) / area;
    return true;
}

/* The same of all points in the square at (x, y): which lie on the triangle. A multiple of 16 of them. */
LW_WIDE static void find_inside(const struct lw_vec2 corner[3], float x, float y,
                                const struct points *restrict points, uint32_t count,
                                uint8_t *restrict out_inside) {
    const struct lw_vec2 e1 = minus(corner[1], corner[0]), e2 = minus(corner[2], corner[0]);
    const float area = cross2(e1, e2), left = corner[0].x, top = corner[0].y;
    for (uint32_t k = 0; k < count; k++) {
        const float dx = x + points->x[k] - left, dy = y + points->y[k] - top;
        const float u = (dx * e2.y - dy * e2.x) / area, v = (e1.x * dy - e1.y * dx) / area;
        out_inside[k] = (u >= 0) & (v >= 0) & (u + v <= 1);
    }
}

/* A bit for each point that a triangle holds: none for one without area. */
static uint64_t inside_of(const struct lw_vec2 corner[3], uint32_t x, uint32_t y, const struct points *points,
                          uint32_t count) {
    uint8_t inside[POINTS_MOST];
    uint64_t bits = 0;
    if (cross2(minus(corner[1], corner[0]), minus(corner[2], corner[0])) == 0) return 0;
    find_inside(corner, (float)x, (float)y, points, count, inside);
    for (uint32_t k = 0; k < count; k++) bits |= (uint64_t)inside[k] << k;
    return bits;
}

/* Moves barycentrics that rounding has put outside back onto the triangle. */
static void clamp_barycentrics(float *u, float *v) {
    *u = fmaxf(0, *u);
    *v = fmaxf(0, *v);
    float sum = *u + *v;
    if (sum <= 1) return;
    *u /= sum;
    *v /= sum;
}

/* The part of a polygon with sign * (coordinate - limit) <= 0 (Sutherland and Hodgman 1974). */
static int clip(const struct lw_vec2 *in, int count, bool along_y, float limit, float sign,
                struct lw_vec2 *out) {
    int n = 0;
    for (int i = 0; i < count; i++) {
        struct lw_vec2 a = in[i], b = in[(i + 1) % count];
        float da = sign * ((along_y ? a.y : a.x) - limit), db = sign * ((along_y ? b.y : b.x) - limit);
        if (da <= 0) out[n++] = a;
        if ((da < 0 && db > 0) || (da > 0 && db < 0)) {
            float t = da / (da - db);
            out[n++] = (struct lw_vec2){a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
        }
    }
    return n;
}

/* Area and centroid of a triangle inside the square at (x, y). */
static float clip_to_square(const struct lw_vec2 corner[3], float x, float y, float side,
                            struct lw_vec2 *out_centroid) {
    struct lw_vec2 a[8], b[8];
    int n = clip(corner, 3, false, x, -1, a);
    n = clip(a, n, false, x + side, 1, b);
    n = clip(b, n, true, y, -1, a);
    n = clip(a, n, true, y + side, 1, b);
    float doubled = 0, cx = 0, cy = 0;
    for (int i = 2; i < n; i++) {
        float part = fabsf(cross2(minus(b[i - 1], b[0]), minus(b[i], b[0])));
        doubled += part;
        cx += part * (b[0].x + b[i - 1].x + b[i].x);
        cy += part * (b[0].y + b[i - 1].y + b[i].y);
    }
    if (!(doubled > 0)) return 0;
    *out_centroid = (struct lw_vec2){cx / (3 * doubled), cy / (3 * doubled)};
    return 0.5f * doubled;
}

static void lightmap_corners(const struct lw_mesh *mesh, uint32_t triangle, bool back,
                             struct lw_vec2 out_corner[3]) {
    for (int i = 0; i < 3; i++) {
        out_corner[i] = mesh->lightmap_uv[mesh->triangle[triangle][i]];
        if (back) out_corner[i].y += (float)mesh->back_offset;
    }
}

static uint32_t floor_clamped(float x, uint32_t limit) {
    return x <= 0 ? 0 : x >= (float)limit ? limit : (uint32_t)x;
}

/* Lets a triangle claim the spots of a texel that it holds; on the edge of two, the first has it. */
static void claim_spots(const struct raster *r, struct claim *c, const struct lw_vec2 corner[3], uint32_t x,
                        uint32_t y, uint32_t triangle, bool back) {
    const uint32_t last = LW_SAMPLE_POINTS_MAX - 1;
    uint32_t k = 0; /* held spots that come before */
    uint64_t inside = inside_of(corner, x, y, &r->spots, LW_SAMPLE_POINTS_SPOTS);
    for (; inside; inside &= inside - 1) {
        const uint32_t number = (uint32_t)__builtin_ctzll(inside);
        while (k <= last && c->spot[k] != LW_TEXEL_NONE && c->number[k] < number) k++;
        if (k > last) break;
        if (c->spot[k] != LW_TEXEL_NONE && c->number[k] == number) continue;
        memmove(&c->spot[k + 1], &c->spot[k], (last - k) * sizeof c->spot[0]);
        memmove(&c->number[k + 1], &c->number[k], (last - k) * sizeof c->number[0]);
        c->spot[k] = triangle | (back ? SPOT_BACK : 0);
        c->number[k] = (uint8_t)number;
    }
}

/* Cut-out parts reflect nothing. */
static void add_albedo_at(const struct raster *r, struct claim *c, uint32_t triangle, float u, float v) {
    float alpha;
    const struct lw_vec3 albedo = lw_scene_albedo(r->scene, r->mesh, triangle, u, v, &alpha);
    c->albedo = lw_vec3_mad(c->albedo, albedo, alpha);
    c->plain_albedo = lw_vec3_add(c->plain_albedo, albedo);
    c->surface += alpha;
    c->albedo_points++;
}

/* Adds the albedo of the points of a texel that a triangle holds; on the edge of two, each has it. Points
 * beyond the chart do not count: a picture's next band may begin there. */
static void add_albedo(const struct raster *r, struct claim *c, const struct lw_vec2 corner[3], uint32_t x,
                       uint32_t y, uint32_t triangle) {
    const struct points *points = &r->albedo_points;
    uint64_t inside = inside_of(corner, x, y, points, ALBEDO_SIDE * ALBEDO_SIDE);
    for (; inside; inside &= inside - 1) {
        const int k = __builtin_ctzll(inside);
        float u = 0, v = 0;
        barycentrics(corner, (struct lw_vec2){(float)x + points->x[k], (float)y + points->y[k]}, &u, &v);
        add_albedo_at(r, c, triangle, u, v);
    }
}

/* No surface sends back more light than it gets. */
static bool is_albedo(struct lw_vec3 a) {
    return a.x >= 0 && a.y >= 0 && a.z >= 0 && lw_vec3_max_abs(a) < 1.001f;
}

/* A texel too narrow to hold one of those points has the albedo of its own sample. */
static struct lw_vec3 mean_albedo(const struct raster *r, struct claim *c) {
    if (!c->albedo_points) add_albedo_at(r, c, c->triangle, c->u, c->v);
    LW_INVARIANT_DEAR(c->albedo_points > 0 && c->surface >= 0 &&
                      c->surface < 1.001f * (float)c->albedo_points);
    const struct lw_vec3 mean = c->surface > 0 ? lw_vec3_scale(c->albedo, 1 / c->surface)
                                               : lw_vec3_scale(c->plain_albedo, 1 / (float)c->albedo_points);
    LW_INVARIANT_DEAR(is_albedo(mean));
    return mean;
}

/* The number of a triangle's chart until charts are joined. */
static uint32_t chart_of(const struct lw_mesh *mesh, uint32_t triangle, bool back) {
    return mesh->triangle[triangle][0] + (back ? mesh->vertex_count : 0);
}

/* Lets a triangle claim the texels that it overlaps. Who holds a texel's centre gets it and is sampled there;
 * where nobody does, the largest part gets it and is sampled at the part's middle: never on the chart's very
 * edge, which may lie in the plane of the next wall. */
static void claim_texels(const struct raster *r, uint32_t triangle, bool back) {
    const struct lw_mesh_texels *texels = r->texels;
    const uint32_t chart = chart_of(r->mesh, triangle, back);
    struct lw_vec2 corner[3];
    lightmap_corners(r->mesh, triangle, back, corner);
    float x_min = fminf(corner[0].x, fminf(corner[1].x, corner[2].x)),
          x_max = fmaxf(corner[0].x, fmaxf(corner[1].x, corner[2].x)),
          y_min = fminf(corner[0].y, fminf(corner[1].y, corner[2].y)),
          y_max = fmaxf(corner[0].y, fmaxf(corner[1].y, corner[2].y));
    uint32_t x0 = floor_clamped(x_min, texels->width - 1), x1 = floor_clamped(x_max, texels->width - 1);
    uint32_t y0 = floor_clamped(y_min, texels->height - 1), y1 = floor_clamped(y_max, texels->height - 1);
    for (uint32_t y = y0; y <= y1; y++)
        for (uint32_t x = x0; x <= x1; x++) {
            struct lw_vec2 sample;
            float u, v, area = clip_to_square(corner, (float)x, (float)y, 1, &sample);
            if (!(area > 0)) continue;
            struct claim *c = &r->claim[lw_texels_index(texels, x, y)];
            c->area_sum += area;
            if (c->chart != LW_TEXEL_NONE) lw_union_find_join(r->parent, c->chart, chart);
            c->chart = chart;
            claim_spots(r, c, corner, x, y, triangle, back);
            if (r->has_albedo) add_albedo(r, c, corner, x, y, triangle);
            struct lw_vec2 centre = {(float)x + 0.5f, (float)y + 0.5f};
            if (!barycentrics(corner, centre, &u, &v)) continue;
            if (u >= 0 && v >= 0 && u + v <= 1)
                area = 2;
            else
                barycentrics(corner, sample, &u, &v);
            if (c->triangle != LW_TEXEL_NONE && c->area >= area) continue;
            clamp_barycentrics(&u, &v);
            c->triangle = triangle;
            c->u = u;
            c->v = v;
            c->area = area;
            c->back = back;
        }
}

/* Gives the texels that a triangle does not cover, but bilinear look-ups on it read, to its chart: those
 * whose centre it comes nearer to than a texel. Slivers lie so close together that a gutter touches two
 * of them; one alone reads it. */
static void claim_gutters(const struct raster *r, uint32_t triangle, bool back) {
    const uint32_t last_x = r->texels->width - 1, last_y = r->texels->height - 1;
    struct lw_vec2 corner[3], unused;
    lightmap_corners(r->mesh, triangle, back, corner);
    uint32_t x0 = floor_clamped(fminf(corner[0].x, fminf(corner[1].x, corner[2].x)) - 0.5f, last_x),
             x1 = floor_clamped(fmaxf(corner[0].x, fmaxf(corner[1].x, corner[2].x)) + 0.5f, last_x),
             y0 = floor_clamped(fminf(corner[0].y, fminf(corner[1].y, corner[2].y)) - 0.5f, last_y),
             y1 = floor_clamped(fmaxf(corner[0].y, fmaxf(corner[1].y, corner[2].y)) + 0.5f, last_y);
    for (uint32_t y = y0; y <= y1; y++)
        for (uint32_t x = x0; x <= x1; x++) {
            struct claim *c = &r->claim[lw_texels_index(r->texels, x, y)];
            if (c->triangle != LW_TEXEL_NONE) continue;
            const float area = clip_to_square(corner, (float)x - 0.5f, (float)y - 0.5f, 2, &unused);
            if (!(area > c->read_area)) continue;
            c->read_area = area;
            c->chart = chart_of(r->mesh, triangle, back);
        }
}

/* Drops texels that a chart only grazes where a neighbour has more of it: their light is
 * the neighbour's, continued. */
static void drop_grazed(struct claim *claim, const struct lw_mesh_texels *texels) {
    for (uint32_t y = 0; y < texels->height; y++)
        for (uint32_t x = 0; x < texels->width; x++) {
            struct claim *c = &claim[lw_texels_index(texels, x, y)];
            if (c->triangle == LW_TEXEL_NONE || c->area > 1 || c->area_sum >= GRAZED_AREA) continue;
            for (uint32_t j = y ? y - 1 : 0; j <= y + 1 && j < texels->height; j++)
                for (uint32_t i = x ? x - 1 : 0; i <= x + 1 && i < texels->width; i++)
                    if (claim[lw_texels_index(texels, i, j)].area_sum >= GRAZED_AREA &&
                        claim[lw_texels_index(texels, i, j)].chart == c->chart)
                        c->triangle = LW_TEXEL_NONE;
        }
}

static void store(float *const dst[3], uint32_t i, struct lw_vec3 v) {
    dst[0][i] = v.x;
    dst[1][i] = v.y;
    dst[2][i] = v.z;
}

/* A point of a triangle as a sample point from which rays start. */
static struct lw_sample_points_point point_at(const struct lw_mesh *mesh, uint32_t triangle, float u, float v,
                                              bool back) {
    struct lw_vec3 face, normal = lw_scene_normal(mesh, triangle, u, v, &face);
    normal = lw_scene_light_normal(normal, face);
    float side = back ? -1.0f : 1.0f;
    return (struct lw_sample_points_point){.origin = lw_scene_shadow_origin(mesh, triangle, u, v, back),
                                           .normal = lw_vec3_scale(normal, side),
                                           .geometric = lw_vec3_scale(face, side)};
}

static float largest_coordinate(const struct lw_mesh *mesh, uint32_t triangle) {
    float largest = 0;
    for (int i = 0; i < 3; i++) {
        struct lw_vec3 p = mesh->position[mesh->triangle[triangle][i]];
        largest = fmaxf(largest, fmaxf(fabsf(p.x), fmaxf(fabsf(p.y), fabsf(p.z))));
    }
    return largest;
}

static uint32_t point_count(const struct claim *c) {
    if (c->triangle == LW_TEXEL_NONE) return 0;
    uint32_t count = 0;
    for (uint32_t k = 0; k < LW_SAMPLE_POINTS_MAX; k++) count += c->spot[k] != LW_TEXEL_NONE;
    return count ? count : 1; /* too narrow to hold a spot: the texel's own sample */
}

/* How a texel's square lies in space, if the plane of a triangle holds all of it. */
static void place_square(const struct lw_mesh *mesh, uint32_t triangle, bool back,
                         struct lw_sample_points_texel *out) {
    const uint32_t *vertex = mesh->triangle[triangle];
    const struct lw_vec3 a = mesh->position[vertex[0]], p1 = lw_vec3_sub(mesh->position[vertex[1]], a),
                         p2 = lw_vec3_sub(mesh->position[vertex[2]], a);
    struct lw_vec2 corner[3];
    lightmap_corners(mesh, triangle, back, corner);
    const struct lw_vec2 e1 = minus(corner[1], corner[0]), e2 = minus(corner[2], corner[0]);
    const float inverse = 1 / cross2(e1, e2);
    out->right = lw_vec3_scale(lw_vec3_mad(lw_vec3_scale(p1, e2.y), p2, -e1.y), inverse);
    out->down = lw_vec3_scale(lw_vec3_mad(lw_vec3_scale(p2, e1.x), p1, -e2.x), inverse);
}

/* Returns false without memory. */
static bool set_sample_points(struct lw_mesh_texels *texels, const struct lw_mesh *mesh,
                              const struct claim *c, uint32_t x, uint32_t y) {
    const uint32_t i = lw_texels_index(texels, x, y);
    struct lw_sample_points_texel texel = {
        .position = lw_texels_vector(texels->position, i),
        .largest = largest_coordinate(mesh, c->triangle),
        .near = {x ? lw_texels_index(texels, x - 1, y) : i, y ? lw_texels_index(texels, x, y - 1) : i}};
    for (uint32_t k = 0; k < LW_SAMPLE_POINTS_MAX; k++) {
        if (c->spot[k] == LW_TEXEL_NONE) continue;
        const uint32_t triangle = c->spot[k] & ~SPOT_BACK;
        const bool back = c->spot[k] & SPOT_BACK;
        struct lw_vec2 corner[3], spot = lw_sample_points_spot(c->number[k]);
        float u = 0, v = 0;
        lightmap_corners(mesh, triangle, back, corner);
        barycentrics(corner, (struct lw_vec2){(float)x + spot.x, (float)y + spot.y}, &u, &v);
        clamp_barycentrics(&u, &v);
        texel.point[texel.count] = point_at(mesh, triangle, u, v, back);
        texel.point[texel.count++].spot = c->number[k];
        texel.largest = fmaxf(texel.largest, largest_coordinate(mesh, triangle));
    }
    texel.has_spots = texel.count > 0;
    if (!texel.has_spots) texel.point[texel.count++] = point_at(mesh, c->triangle, c->u, c->v, c->back);
    place_square(mesh, c->triangle, c->back, &texel);
    return lw_sample_points_pack(&texels->sample_points, i, &texel);
}

/* Covered texels within two texels: of a chart, or of any for LW_TEXEL_NONE. */
static uint32_t list_covered(const struct lw_mesh_texels *mesh, const uint8_t *covered, uint32_t chart,
                             uint32_t x, uint32_t y,
                             struct lw_texels_neighbour out[LW_TEXELS_NEIGHBOURS_MAX]) {
    uint32_t count = 0;
    for (int dy = -2; dy <= 2; dy++)
        for (int dx = -2; dx <= 2; dx++) {
            const int64_t nx = (int64_t)x + dx, ny = (int64_t)y + dy;
            if ((!dx && !dy) || nx < 0 || ny < 0 || nx >= mesh->width || ny >= mesh->height) continue;
            const uint32_t neighbour = lw_texels_index(mesh, (uint32_t)nx, (uint32_t)ny);
            if (!covered[neighbour] || (chart != LW_TEXEL_NONE && mesh->chart[neighbour] != chart)) continue;
            out[count++] =
                (struct lw_texels_neighbour){.x = (uint32_t)nx,
                                             .y = (uint32_t)ny,
                                             .reach = (uint32_t)(abs(dx) > abs(dy) ? abs(dx) : abs(dy)),
                                             .distance2 = (uint32_t)(dx * dx + dy * dy)};
        }
    return count;
}

uint32_t lw_texels_neighbours(const struct lw_mesh_texels *mesh, const uint8_t *covered, uint32_t x,
                              uint32_t y, struct lw_texels_neighbour out[LW_TEXELS_NEIGHBOURS_MAX]) {
    const uint32_t chart = mesh->chart[lw_texels_index(mesh, x, y)],
                   own = list_covered(mesh, covered, chart, x, y, out);
    return own ? own : list_covered(mesh, covered, LW_TEXEL_NONE, x, y, out);
}

/* What a look-up that touches a texel without surface reads there: the nearest one, of several the first. */
static uint32_t source_of(const struct lw_mesh_texels *mesh, const uint8_t *covered, uint32_t x, uint32_t y) {
    struct lw_texels_neighbour near[LW_TEXELS_NEIGHBOURS_MAX];
    const uint32_t count = lw_texels_neighbours(mesh, covered, x, y, near);
    const struct lw_texels_neighbour *best = near;
    for (uint32_t i = 1; i < count; i++)
        if (near[i].distance2 < best->distance2) best = &near[i];
    return count ? lw_texels_index(mesh, best->x, best->y) : LW_TEXEL_NONE;
}

static bool evaluate(const struct raster *r) {
    const struct lw_mesh *mesh = r->mesh;
    struct lw_mesh_texels *texels = r->texels;
    struct lw_sample_points *points = &texels->sample_points;
    for (uint32_t i = 0; i < texels->texel_count; i++)
        points->first[i + 1] = points->first[i] + point_count(&r->claim[i]);
    const size_t count = points->first[texels->texel_count];
    LW_INVARIANT(count <= (size_t)LW_SAMPLE_POINTS_MAX * texels->texel_count);
    if (!lw_sample_points_reserve(points, texels->texel_count)) return false;
    for (uint32_t i = 0; i < texels->texel_count; i++) {
        struct claim *c = &r->claim[i];
        uint32_t x, y;
        lw_texels_coordinates(texels, i, &x, &y);
        texels->chart[i] = c->chart;
        if (c->triangle == LW_TEXEL_NONE) continue;
        struct lw_surface surface;
        lw_scene_surface(r->scene, mesh, c->triangle, c->u, c->v, &surface);
        struct lw_sample_points_point point = point_at(mesh, c->triangle, c->u, c->v, c->back);
        texels->covered[i] = 1;
        store(texels->position, i, surface.position);
        texels->normal[i] = lw_packed_normal(point.normal);
        texels->geometric[i] = lw_packed_normal(point.geometric);
        if (r->has_albedo) texels->albedo[i] = lw_packed_albedo(mean_albedo(r, c));
        if (!set_sample_points(texels, mesh, c, x, y)) return false;
    }
    lw_sample_points_trim(points);
    for (uint32_t y = 0; r->has_albedo && y < texels->height; y++)
        for (uint32_t x = 0; x < texels->width; x++) {
            const uint32_t i = lw_texels_index(texels, x, y);
            const uint32_t source = texels->covered[i] ? i : source_of(texels, texels->covered, x, y);
            if (source != LW_TEXEL_NONE) texels->albedo[i] = texels->albedo[source];
        }
    return true;
}

static uint16_t quarter_texels(float x) {
    float q = x * 4.0f + 0.5f;
    return q <= 0 ? 0 : q >= 65535.0f ? 65535 : (uint16_t)q;
}

static void list_triangles(struct lw_mesh_texels *texels, const struct lw_scene *scene,
                           const struct lw_mesh *mesh) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct lw_triangle_uv *record = &texels->triangle[t];
        for (int i = 0; i < 3; i++) {
            struct lw_vec2 uv = mesh->lightmap_uv[mesh->triangle[t][i]];
            record->u[i] = quarter_texels(uv.x);
            record->v[i] = quarter_texels(uv.y);
        }
        record->double_sided = mesh->back_offset && scene->material[mesh->material[t]].double_sided;
    }
}

static bool allocate(struct lw_mesh_texels *texels, bool has_albedo) {
    const size_t count = texels->texel_count;
    bool ok = true;
    for (int c = 0; c < 3; c++) {
        ok &= (texels->position[c] = calloc(count, sizeof(float))) != NULL;
    }
    ok &= (texels->normal = calloc(count, sizeof *texels->normal)) != NULL;
    ok &= (texels->geometric = calloc(count, sizeof *texels->geometric)) != NULL;
    if (has_albedo) ok &= (texels->albedo = calloc(count, sizeof *texels->albedo)) != NULL;
    ok &= (texels->covered = calloc(count, 1)) != NULL;
    ok &= (texels->chart = calloc(count, sizeof *texels->chart)) != NULL;
    ok &= lw_sample_points_init(&texels->sample_points, texels->texel_count);
    return ok;
}

/* Names charts, fronts and backs apart, by one of their vertices: what shares a vertex is one chart; and so,
 * when texels have been claimed, is what shares a texel, for charts that were merged share no vertex. */
static void find_charts(const struct lw_mesh *mesh, uint32_t *parent) {
    for (uint32_t v = 0; v < 2 * mesh->vertex_count; v++) parent[v] = v;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (uint32_t side = 0; side < 2 * mesh->vertex_count; side += mesh->vertex_count)
            for (int k = 1; k < 3; k++)
                lw_union_find_join(parent, side + mesh->triangle[t][0], side + mesh->triangle[t][k]);
}

/* What rasterises a triangle. */
typedef void claim_triangle(const struct raster *r, uint32_t triangle, bool back);

static void claim_all(const struct raster *r, claim_triangle *each) {
    const struct lw_mesh *mesh = r->mesh;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        each(r, t, false);
        if (mesh->back_offset && r->scene->material[mesh->material[t]].double_sided) each(r, t, true);
    }
    for (uint32_t i = 0; i < r->texels->texel_count; i++)
        if (r->claim[i].chart != LW_TEXEL_NONE)
            r->claim[i].chart = lw_union_find_root(r->parent, r->claim[i].chart);
}

/* The side of a texel in space: by the areas of all triangles there and in the lightmap. */
static float texel_side(const struct lw_mesh *mesh) {
    double surface = 0, lightmap = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *i = mesh->triangle[t];
        const struct lw_vec3 a = mesh->position[i[0]];
        struct lw_vec2 uv[3];
        lightmap_corners(mesh, t, false, uv);
        surface += (double)lw_vec3_length(
            lw_vec3_cross(lw_vec3_sub(mesh->position[i[1]], a), lw_vec3_sub(mesh->position[i[2]], a)));
        lightmap += (double)fabsf(cross2(minus(uv[1], uv[0]), minus(uv[2], uv[0])));
    }
    return lightmap > 0 ? (float)sqrt(surface / lightmap) : 0;
}

static void list_points(struct raster *r) {
    for (uint32_t k = 0; k < LW_SAMPLE_POINTS_SPOTS; k++) {
        const struct lw_vec2 spot = lw_sample_points_spot(k);
        r->spots.x[k] = spot.x;
        r->spots.y[k] = spot.y;
    }
    for (uint32_t k = 0; k < ALBEDO_SIDE * ALBEDO_SIDE; k++) {
        r->albedo_points.x[k] = ((float)(k % ALBEDO_SIDE) + 0.5f) / ALBEDO_SIDE;
        r->albedo_points.y[k] = ((float)(k / ALBEDO_SIDE) + 0.5f) / ALBEDO_SIDE;
    }
}

bool lw_texels_rasterise(struct lw_mesh_texels *texels, const struct lw_scene *scene,
                         const struct lw_mesh *mesh, bool has_albedo) {
    struct claim *claim = malloc((size_t)texels->texel_count * sizeof *claim);
    uint32_t *parent = malloc((2 * (size_t)mesh->vertex_count + 1) * sizeof *parent);
    if (!claim || !parent || !allocate(texels, has_albedo)) {
        free(claim);
        free(parent);
        return false;
    }
    find_charts(mesh, parent);
    for (uint32_t i = 0; i < texels->texel_count; i++) {
        claim[i] = (struct claim){.triangle = LW_TEXEL_NONE, .chart = LW_TEXEL_NONE};
        memset(claim[i].spot, 0xff, sizeof claim[i].spot); /* LW_TEXEL_NONE */
    }
    struct raster raster = {.scene = scene,
                            .mesh = mesh,
                            .texels = texels,
                            .claim = claim,
                            .parent = parent,
                            .has_albedo = has_albedo};
    list_points(&raster);
    claim_all(&raster, claim_texels);
    claim_all(&raster, claim_gutters);
    drop_grazed(claim, texels);
    const bool ok = evaluate(&raster);
    free(claim);
    free(parent);
    texels->texel_m = texel_side(mesh);
    return ok;
}

static bool build_mesh(struct lw_mesh_texels *texels, const struct lw_scene *scene,
                       const struct lw_mesh *mesh) {
    texels->triangle = calloc(mesh->triangle_count + 1ul, sizeof *texels->triangle);
    if (!texels->triangle || !lw_texels_rasterise(texels, scene, mesh, true)) return false;
    list_triangles(texels, scene, mesh);
    return true;
}

/* Whether a material that the mesh uses is another than when its albedo was taken. */
static bool is_recoloured(const struct lw_texels *texels, const struct lw_mesh *mesh) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t m = mesh->material[t];
        if (memcmp(texels->base_colour[m], texels->scene->material[m].base_colour,
                   sizeof texels->base_colour[m]))
            return true;
    }
    return false;
}

static void note_colours(struct lw_texels *texels) {
    for (uint32_t m = 0; m < texels->scene->material_count; m++)
        memcpy(texels->base_colour[m], texels->scene->material[m].base_colour, sizeof texels->base_colour[m]);
}

/* Something to do, and how large it is. */
struct piece {
    uint32_t texels, number;
};

static int compare_pieces(const void *left, const void *right) {
    const struct piece *a = left, *b = right;
    if (a->texels != b->texels) return a->texels > b->texels ? -1 : 1;
    return a->number < b->number ? -1 : a->number > b->number;
}

/* The meshes, the largest first: else all wait for one that comes last. malloc'ed; NULL: no memory. */
static struct piece *order_meshes(const struct lw_texels *texels) {
    const uint32_t count = texels->scene->mesh_count;
    struct piece *piece = malloc((count + 1ul) * sizeof *piece);
    for (uint32_t m = 0; m < count && piece; m++) piece[m] = (struct piece){texels->mesh[m].texel_count, m};
    if (piece) qsort(piece, count, sizeof *piece, compare_pieces);
    return piece;
}

enum lw_status lw_texels_init(struct lw_texels *texels, const struct lw_scene *scene, unsigned threads,
                              const _Atomic bool *cancel, struct lw_waiting *waiting, struct lw_error *err) {
    *texels = (struct lw_texels){.scene = scene};
    texels->mesh = calloc(scene->mesh_count + 1, sizeof *texels->mesh);
    texels->first = calloc(scene->object_count + 1, sizeof *texels->first);
    texels->base_colour = calloc(scene->material_count + 1ul, sizeof *texels->base_colour);
    if (!texels->mesh || !texels->first || !texels->base_colour) {
        lw_texels_finish(texels);
        return lw_status_fail(err, LW_NO_MEMORY, "%u meshes, %u objects", scene->mesh_count,
                              scene->object_count);
    }
    uint64_t count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        if (!mesh->lightmap_uv) {
            lw_texels_finish(texels);
            return lw_status_fail(err, LW_BAD_DATA,
                                  "object %u \"%s\" has no lightmap: import the scene again", o,
                                  scene->object[o].name);
        }
        texels->mesh[scene->object[o].mesh] =
            (struct lw_mesh_texels){.width = mesh->atlas_width,
                                    .height = mesh->atlas_height,
                                    .texel_count = mesh->atlas_width * mesh->atlas_height,
                                    .back_offset = mesh->back_offset};
        texels->first[o] = (uint32_t)count;
        count += (uint64_t)mesh->atlas_width * mesh->atlas_height;
        if (count > TEXELS_MAX) {
            lw_texels_finish(texels);
            return lw_status_fail(err, LW_BAD_DATA, "the scene has over %u texels: lower --texels-per-metre",
                                  TEXELS_MAX);
        }
    }
    texels->count = texels->capacity = (uint32_t)count;
    LW_INVARIANT(count <= TEXELS_MAX);

    struct piece *order = order_meshes(texels);
    if (!order) {
        lw_texels_finish(texels);
        return lw_status_fail(err, LW_NO_MEMORY, "%u meshes", scene->mesh_count);
    }
    int failures = 0;
    struct lw_progress progress;
    lw_progress_init_waiting(&progress, "placing texels", count, waiting, LW_WAITING_PLACING_TEXELS);
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads ? (int)threads : omp_get_max_threads())  \
    reduction(+ : failures)
    for (uint32_t i = 0; i < scene->mesh_count; i++) {
        const uint32_t m = order[i].number;
        if (cancel && *cancel) continue;
        if (texels->mesh[m].texel_count && !build_mesh(&texels->mesh[m], scene, &scene->mesh[m])) failures++;
        lw_progress_step(&progress, texels->mesh[m].texel_count);
    }
    free(order);
    if (cancel && *cancel) {
        lw_progress_stop(&progress);
        lw_texels_finish(texels);
        return LW_CLOSED;
    }
    lw_progress_finish(&progress);
    texels->covered = malloc(count + 1);
    texels->usable = malloc(count + 1);
    texels->filled = malloc(count + 1);
    texels->source = malloc((count + 1) * sizeof *texels->source);
    texels->side = malloc((count + 1) * sizeof *texels->side);
    texels->walls = malloc(count + 1);
    texels->changes = calloc(scene->object_count + 1ul, sizeof *texels->changes);
    if (failures || !texels->covered || !texels->usable || !texels->filled || !texels->source ||
        !texels->side || !texels->walls || !texels->changes) {
        lw_texels_finish(texels);
        return lw_status_fail(err, LW_NO_MEMORY, "%u texels", (unsigned)count);
    }
    note_colours(texels);
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh_texels *mesh = &texels->mesh[scene->object[o].mesh];
        memcpy(texels->covered + texels->first[o], mesh->covered, mesh->texel_count);
        for (uint32_t i = 0; i < mesh->texel_count; i++)
            texels->usable[texels->first[o] + i] = lw_sample_points_all(&mesh->sample_points, i);
        lw_texels_forget_walls(texels, o);
    }
    lw_texels_link(texels, threads ? (int)threads : omp_get_max_threads());
    return LW_OK;
}

/* Returns false without memory: the array is then as it was. calloc: what nobody writes takes no memory. */
static bool grow(void *array, size_t from, size_t to, size_t size) {
    void *grown = calloc(to + 1, size), *old = *(void **)array;
    if (!grown) return false;
    memcpy(grown, old, from * size);
    free(old);
    *(void **)array = grown;
    return true;
}

enum lw_status lw_texels_reserve(struct lw_texels *texels, uint32_t more) {
    const size_t from = texels->capacity, to = from + more;
    LW_INVARIANT(to < LW_TEXEL_NONE);
    if (!grow(&texels->covered, from, to, sizeof *texels->covered) ||
        !grow(&texels->usable, from, to, sizeof *texels->usable) ||
        !grow(&texels->filled, from, to, sizeof *texels->filled) ||
        !grow(&texels->walls, from, to, sizeof *texels->walls) ||
        !grow(&texels->side, from, to, sizeof *texels->side) ||
        !grow(&texels->source, from, to, sizeof *texels->source))
        return LW_NO_MEMORY;
    texels->capacity = (uint32_t)to;
    return LW_OK;
}

static size_t mesh_bytes(const struct lw_mesh_texels *t, const struct lw_mesh *mesh) {
    return t->texel_count * (3 * sizeof *t->position[0] + sizeof *t->normal + sizeof *t->geometric +
                             sizeof *t->albedo + sizeof *t->covered + sizeof *t->chart) +
           lw_sample_points_memory_bytes(&t->sample_points, t->texel_count) +
           mesh->triangle_count * sizeof *t->triangle;
}

size_t lw_texels_memory_bytes(const struct lw_texels *texels) {
    const struct lw_scene *scene = texels->scene;
    size_t bytes =
        texels->capacity * (sizeof *texels->covered + sizeof *texels->usable + sizeof *texels->filled +
                            sizeof *texels->source + sizeof *texels->side + sizeof *texels->walls) +
        scene->mesh_count * sizeof *texels->mesh +
        scene->object_count * (sizeof *texels->first + sizeof *texels->changes) +
        scene->material_count * sizeof *texels->base_colour;
    for (uint32_t m = 0; m < scene->mesh_count; m++)
        if (texels->mesh[m].texel_count) bytes += mesh_bytes(&texels->mesh[m], &scene->mesh[m]);
    return bytes;
}

void lw_texels_finish_mesh(struct lw_mesh_texels *mesh) {
    for (int c = 0; c < 3; c++) {
        free(mesh->position[c]);
    }
    free(mesh->albedo);
    free(mesh->normal);
    free(mesh->geometric);
    free(mesh->covered);
    free(mesh->chart);
    lw_sample_points_finish(&mesh->sample_points);
    free(mesh->triangle);
}

enum lw_status lw_texels_set_albedo(struct lw_texels *texels, int threads) {
    const struct lw_scene *scene = texels->scene;
    int failures = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads) reduction(+ : failures)
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        struct lw_mesh_texels *mesh = &texels->mesh[m];
        if (!mesh->texel_count || !is_recoloured(texels, &scene->mesh[m])) continue;
        struct lw_mesh_texels fresh = {.width = mesh->width,
                                       .height = mesh->height,
                                       .texel_count = mesh->texel_count,
                                       .back_offset = mesh->back_offset};
        if (build_mesh(&fresh, scene, &scene->mesh[m]))
            memcpy(mesh->albedo, fresh.albedo, mesh->texel_count * sizeof *mesh->albedo);
        else
            failures++;
        lw_texels_finish_mesh(&fresh);
    }
    if (failures) return LW_NO_MEMORY;
    note_colours(texels);
    return LW_OK;
}

void lw_texels_forget_walls(struct lw_texels *texels, uint32_t object) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    memcpy(texels->side + texels->first[object], mesh->chart, mesh->texel_count * sizeof *texels->side);
    memset(texels->walls + texels->first[object], 0, mesh->texel_count);
}

struct lw_vec3 lw_texels_place(const struct lw_texels *texels, uint32_t object, uint32_t i) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    const struct lw_sample_points *points = &mesh->sample_points;
    const uint8_t usable = texels->usable[texels->first[object] + i];
    const uint32_t first = points->first[i], count = points->first[i + 1] - first;
    if (usable == lw_sample_points_all(points, i)) return lw_texels_vector(mesh->position, i);
    uint32_t texel[LW_TRACE_WIDTH], point[LW_TRACE_WIDTH];
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        texel[lane] = i;
        point[lane] = first + (lane < count ? lane : 0);
    }
    struct lw_sample_points_lanes lanes;
    lw_sample_points_load(points, mesh->position, texel, point, &lanes);
    struct lw_vec3 sum = {0};
    LW_INVARIANT_DEAR(usable && count <= LW_SAMPLE_POINTS_MAX &&
                      !(usable & ~lw_sample_points_all(points, i)));
    for (uint32_t k = 0; k < count; k++)
        if (usable >> k & 1) sum = lw_vec3_add(sum, lw_vec3(lanes.at.x[k], lanes.at.y[k], lanes.at.z[k]));
    return lw_vec3_scale(sum, 1 / (float)__builtin_popcount(usable));
}

static uint32_t smaller(uint32_t a, uint32_t b) { return a < b ? a : b; }

void lw_texels_link_block(struct lw_texels *texels, uint32_t object, uint32_t left, uint32_t top) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    const uint32_t first = texels->first[object], right = smaller(left + LW_TILE_BLOCK, mesh->width),
                   bottom = smaller(top + LW_TILE_BLOCK, mesh->height);
    const uint8_t *covered = texels->covered + first;
    for (uint32_t y = top; y < bottom; y++)
        for (uint32_t x = left; x < right; x++) {
            uint32_t i = lw_texels_index(mesh, x, y),
                     source = covered[i] ? i : source_of(mesh, covered, x, y);
            LW_INVARIANT_DEAR(source == LW_TEXEL_NONE || covered[source]);
            texels->source[first + i] = source == LW_TEXEL_NONE ? LW_TEXEL_NONE : first + source;
            texels->filled[first + i] = !covered[i] && source != LW_TEXEL_NONE;
        }
}

void lw_texels_link_object(struct lw_texels *texels, uint32_t object) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    for (uint32_t y = 0; y < mesh->height; y += LW_TILE_BLOCK)
        for (uint32_t x = 0; x < mesh->width; x += LW_TILE_BLOCK) lw_texels_link_block(texels, object, x, y);
}

void lw_texels_link(struct lw_texels *texels, int threads) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
    for (uint32_t o = 0; o < texels->scene->object_count; o++) lw_texels_link_object(texels, o);
}

void lw_texels_finish(struct lw_texels *texels) {
    for (uint32_t m = 0; texels->mesh && m < texels->scene->mesh_count; m++)
        lw_texels_finish_mesh(&texels->mesh[m]);
    free(texels->source);
    free(texels->side);
    free(texels->walls);
    free(texels->changes);
    free(texels->covered);
    free(texels->usable);
    free(texels->filled);
    free(texels->first);
    free(texels->base_colour);
    free(texels->mesh);
    *texels = (struct lw_texels){0};
}
