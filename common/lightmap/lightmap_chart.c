#include "common/lightmap/lightmap_chart.h"

#include "common/lightmap/lightmap_apart.h"
#include "common/lightmap/lightmap_bevel.h"
#include "common/lightmap/lightmap_heap.h"
#include "common/lightmap/lightmap_merge.h"
#include "common/lightmap/lightmap_plane.h"
#include "common/lightmap/lightmap_split.h"

#include <stdlib.h>
#include <string.h>

/* Singular values of the map from surface to atlas stay in these bounds while a chart grows. */
#define STRETCH_MIN 0.70f
#define STRETCH_MAX 1.45f

/* A triangle lower than a texel shows no stretch, but cut off it is all border: for it the bounds are this
 * many times as wide. Rings of mouldings then share charts: 17,600 seam edges in builtin:atrium instead of
 * 35,100; twice as wide, 22,100. */
#define FINE_STRETCH 4.0f

/* A corner that is in the chart already, but this many edge lengths away from where it is wanted, has been
 * reached around a column: the chart is cut open there. Nearer, the surface is curved both ways, and a cut
 * would fray it. */
#define CUT_DISTANCE 3.0f

/* At most this many points of one position are looked at: a hub that is cut for every triangle must not cost
 * their square. */
#define CUTS_MAX 256

struct grower {
    const struct lw_lightmap_topology *topology;
    struct lw_lightmap_charts *charts;
    struct lw_lightmap_plane *plane;
    struct lw_lightmap_apart *apart;
    enum lw_status status;
    uint32_t *head, *head_chart;  /* per welded position: its first point, if head_chart is the chart */
    uint32_t *next;               /* per point: the same position, cut */
    struct lw_lightmap_heap heap; /* edges of the chart, to be unfolded over */
};

static uint32_t weld_of(const struct grower *g, uint32_t t, uint32_t corner) {
    return g->topology->weld[g->topology->mesh->triangle[t][corner]];
}

static uint32_t add_point(struct grower *g, uint32_t chart, uint32_t weld, struct lw_vec2 at) {
    uint32_t p = g->charts->point_count++;
    g->charts->point[p] = at;
    g->next[p] = g->head_chart[weld] == chart ? g->head[weld] : LW_SCENE_NONE;
    g->head[weld] = p;
    g->head_chart[weld] = chart;
    return p;
}

/* The third corner of a triangle, over edge e: fraction along the edge, and height above it. */
static void apex(const struct lw_lightmap_topology *topology, uint32_t t, uint32_t e, float *out_along,
                 float *out_height) {
    double l = (double)topology->side[t][e], b = (double)topology->side[t][(e + 1) % 3],
           a = (double)topology->side[t][(e + 2) % 3];
    *out_along = (float)((a * a + l * l - b * b) / (2 * l * l));
    *out_height = (float)(2 * (double)topology->area[t] / l);
}

/* Whether triangle t may have these corners a, b (over edge e) and c. */
static bool fits(const struct lw_lightmap_topology *topology, uint32_t t, uint32_t e, struct lw_vec2 a,
                 struct lw_vec2 b, struct lw_vec2 c) {
    float along, height, length = topology->side[t][e];
    apex(topology, t, e, &along, &height);
    float ux = (b.x - a.x) / length, uy = (b.y - a.y) / length;
    float vx = (c.x - a.x - along * (b.x - a.x)) / height, vy = (c.y - a.y - along * (b.y - a.y)) / height;
    float half = (ux * ux + uy * uy + vx * vx + vy * vy) / 2, det = ux * vy - uy * vx;
    if (!(det > 0)) return false;
    float root = sqrtf(fmaxf(half * half - det * det, 0)); /* eigenvalues of J^T J */
    const float leeway = lw_lightmap_topology_is_fine(topology, t) ? FINE_STRETCH : 1;
    const float most = leeway * STRETCH_MAX, least = STRETCH_MIN / leeway;
    return half + root <= most * most && half - root >= least * least;
}

static void push_edges(struct grower *g, uint32_t t) {
    for (uint32_t e = 3 * t; e < 3 * t + 3; e++) {
        uint32_t over = g->topology->neighbour[e];
        if (over == LW_SCENE_NONE || g->topology->hard[e] || g->charts->chart[over / 3] != LW_SCENE_NONE)
            continue;
        lw_lightmap_heap_push(&g->heap, g->topology->bend[e], e);
    }
}

static void add_triangle(struct grower *g, uint32_t t, uint32_t chart, const struct lw_vec2 corner[3]) {
    g->charts->chart[t] = chart;
    lw_lightmap_plane_add(g->plane, corner);
    struct lw_vec3 place[3];
    lw_lightmap_topology_places(g->topology, t, place);
    if (g->status == LW_OK) g->status = lw_lightmap_apart_add(g->apart, corner, place);
    push_edges(g, t);
}

static void plant(struct grower *g, uint32_t t, uint32_t chart) {
    float along, height, length = g->topology->side[t][0];
    apex(g->topology, t, 0, &along, &height);
    struct lw_vec2 corner[3] = {{0, 0}, {length, 0}, {along * length, height}};
    for (uint32_t k = 0; k < 3; k++)
        g->charts->corner[t][k] = add_point(g, chart, weld_of(g, t, k), corner[k]);
    add_triangle(g, t, chart, corner);
}

/* Finds a place for the third corner: a point that is there, if it fits, else a new one. */
static bool place_corner(struct grower *g, uint32_t chart, uint32_t t, uint32_t e, struct lw_vec2 a,
                         struct lw_vec2 b, uint32_t *out_point, struct lw_vec2 *out_at) {
    float along, height;
    apex(g->topology, t, e, &along, &height);
    float dx = b.x - a.x, dy = b.y - a.y, length = sqrtf(dx * dx + dy * dy);
    struct lw_vec2 wanted = {a.x + along * dx - height * dy / length,
                             a.y + along * dy + height * dx / length};
    const float *side = g->topology->side[t];
    float reach = CUT_DISTANCE * fmaxf(side[0], fmaxf(side[1], side[2]));
    uint32_t weld = weld_of(g, t, (e + 2) % 3), best = LW_SCENE_NONE;
    float best_distance = INFINITY, nearest = INFINITY;
    int cuts = 0;
    for (uint32_t p = g->head_chart[weld] == chart ? g->head[weld] : LW_SCENE_NONE;
         p != LW_SCENE_NONE && cuts < CUTS_MAX; p = g->next[p], cuts++) {
        struct lw_vec2 at = g->charts->point[p];
        float distance = hypotf(at.x - wanted.x, at.y - wanted.y);
        nearest = fminf(nearest, distance);
        if (distance < best_distance && fits(g->topology, t, e, a, b, at)) best = p, best_distance = distance;
    }
    if (best == LW_SCENE_NONE && (nearest < reach || !fits(g->topology, t, e, a, b, wanted))) return false;
    *out_point = best;
    *out_at = best == LW_SCENE_NONE ? wanted : g->charts->point[best];
    return true;
}

static void unfold(struct grower *g, uint32_t from, uint32_t chart) {
    uint32_t over = g->topology->neighbour[from], t = over / 3, e = over % 3;
    if (g->charts->chart[t] != LW_SCENE_NONE) return;
    /* the neighbour's edge runs the other way */
    uint32_t pa = g->charts->corner[from / 3][(from % 3 + 1) % 3], pb = g->charts->corner[from / 3][from % 3],
             pc;
    struct lw_vec2 corner[3], c;
    if (!place_corner(g, chart, t, e, g->charts->point[pa], g->charts->point[pb], &pc, &c)) return;
    corner[e] = g->charts->point[pa];
    corner[(e + 1) % 3] = g->charts->point[pb];
    corner[(e + 2) % 3] = c;
    if (lw_lightmap_plane_overlaps(g->plane, corner)) return;
    struct lw_vec3 in_space[3];
    lw_lightmap_topology_places(g->topology, t, in_space);
    if (lw_lightmap_apart_mixes(g->apart, corner, in_space)) return;
    if (pc == LW_SCENE_NONE) pc = add_point(g, chart, weld_of(g, t, (e + 2) % 3), c);
    g->charts->corner[t][e] = pa;
    g->charts->corner[t][(e + 1) % 3] = pb;
    g->charts->corner[t][(e + 2) % 3] = pc;
    add_triangle(g, t, chart, corner);
}

struct seed {
    float area;
    uint32_t triangle;
};

static int compare_seeds(const void *left, const void *right) {
    const struct seed *a = left, *b = right;
    if (a->area != b->area) return a->area > b->area ? -1 : 1;
    return a->triangle < b->triangle ? -1 : a->triangle > b->triangle;
}

static void grow_all(struct grower *g, const struct seed *seed, uint32_t seed_count) {
    for (uint32_t i = 0; i < seed_count && g->status == LW_OK; i++) {
        if (g->charts->chart[seed[i].triangle] != LW_SCENE_NONE) continue;
        uint32_t chart = g->charts->chart_count++;
        lw_lightmap_plane_clear(g->plane);
        lw_lightmap_apart_clear(g->apart);
        g->heap.count = 0;
        plant(g, seed[i].triangle, chart);
        while (g->heap.count && g->status == LW_OK) unfold(g, lw_lightmap_heap_pop(&g->heap), chart);
    }
}

static enum lw_status grow_charts(const struct lw_lightmap_topology *topology,
                                  struct lw_lightmap_charts *charts, struct lw_lightmap_plane *plane,
                                  struct lw_lightmap_apart *apart) {
    size_t triangles = topology->triangle_count, welds = topology->weld_count;
    struct grower g = {.topology = topology, .charts = charts, .plane = plane, .apart = apart};
    struct seed *seed = malloc((triangles + 1) * sizeof *seed);
    g.head = malloc((welds + 1) * sizeof *g.head);
    g.head_chart = malloc((welds + 1) * sizeof *g.head_chart);
    g.next = malloc((triangles * 3 + 1) * sizeof *g.next);
    g.heap.step = malloc((triangles * 3 + 1) * sizeof *g.heap.step);
    bool ready = seed && g.head && g.head_chart && g.next && g.heap.step;
    if (ready) {
        memset(g.head_chart, 0xff, welds * sizeof *g.head_chart);
        uint32_t count = 0;
        for (uint32_t t = 0; t < triangles; t++)
            if (topology->area[t] > 0) seed[count++] = (struct seed){topology->area[t], t};
        qsort(seed, count, sizeof *seed, compare_seeds);
        grow_all(&g, seed, count);
    }
    free(g.heap.step);
    free(g.next);
    free(g.head_chart);
    free(g.head);
    free(seed);
    return ready ? g.status : LW_NO_MEMORY;
}

/* Triangles without area still need a place: all three corners go to one point, that of a neighbour where
 * there is one, so that they cover nothing. */
static enum lw_status collapse(const struct lw_lightmap_topology *topology,
                               struct lw_lightmap_charts *charts) {
    if (!charts->point_count) {
        charts->point[charts->point_count++] = (struct lw_vec2){0, 0};
        memset(charts->corner, 0, charts->triangle_count * sizeof *charts->corner);
        return LW_OK;
    }
    const struct lw_mesh *mesh = topology->mesh;
    uint32_t *host = malloc(((size_t)topology->weld_count + 1) * sizeof *host);
    if (!host) return LW_NO_MEMORY;
    memset(host, 0xff, topology->weld_count * sizeof *host);
    uint32_t last = 3 * charts->triangle_count, any = LW_SCENE_NONE;
    for (uint32_t c = last; c-- > 0;)
        if (topology->area[c / 3] > 0) any = host[topology->weld[mesh->triangle[c / 3][c % 3]]] = c;
    for (uint32_t t = 0; t < charts->triangle_count; t++) {
        if (topology->area[t] > 0) continue;
        uint32_t c = LW_SCENE_NONE;
        for (int k = 0; k < 3 && c == LW_SCENE_NONE; k++) c = host[topology->weld[mesh->triangle[t][k]]];
        if (c == LW_SCENE_NONE) c = any;
        for (int k = 0; k < 3; k++) charts->corner[t][k] = charts->corner[c / 3][c % 3];
        charts->chart[t] = charts->chart[c / 3];
    }
    free(host);
    return LW_OK;
}

/* Edges at which the surface is only approximately round, not those where it has an edge and is cut. */
static enum lw_status find_bends(const struct lw_lightmap_topology *topology,
                                 struct lw_lightmap_charts *charts) {
    charts->bend = calloc((size_t)charts->chart_count + 1, sizeof *charts->bend);
    if (!charts->bend) return LW_NO_MEMORY;
    for (uint32_t n = 0; n < 3 * charts->triangle_count; n++) {
        const uint32_t t = n / 3, other = topology->neighbour[n];
        if (other == LW_SCENE_NONE || !(topology->area[t] > 0)) continue;
        if (topology->hard[n] && charts->chart[other / 3] != charts->chart[t]) continue;
        const struct lw_vec2 a = charts->point[charts->corner[t][n % 3]],
                             b = charts->point[charts->corner[t][(n % 3 + 1) % 3]];
        const float x = b.y - a.y, y = a.x - b.x, length = sqrtf(x * x + y * y);
        if (!(length > 0)) continue;
        struct lw_lightmap_bend *bend = &charts->bend[charts->chart[t]];
        const float weight = 0.5f * topology->bend[n] / length; /* the other half is the neighbour's */
        bend->xx += weight * x * x;
        bend->xy += weight * x * y;
        bend->yy += weight * y * y;
    }
    return LW_OK;
}

enum lw_status lw_lightmap_chart_build(struct lw_lightmap_charts *charts, const struct lw_mesh *mesh,
                                       double scale) {
    struct lw_lightmap_topology topology;
    struct lw_lightmap_plane *plane = NULL;
    struct lw_lightmap_apart *apart = NULL;
    enum lw_status status = lw_lightmap_topology_init(&topology, mesh, scale);
    if (status != LW_OK) return status;
    size_t triangles = mesh->triangle_count;
    *charts = (struct lw_lightmap_charts){
        .triangle_count = mesh->triangle_count,
        .corner = malloc((triangles + 1) * sizeof *charts->corner),
        .point = malloc((triangles * 3 + 1) * sizeof *charts->point),
        .chart = malloc((triangles + 1) * sizeof *charts->chart),
    };
    if (!charts->corner || !charts->point || !charts->chart)
        status = LW_NO_MEMORY;
    else
        status = lw_lightmap_plane_create(mesh->triangle_count, &plane);
    if (status == LW_OK) status = lw_lightmap_apart_create(&apart);
    if (status == LW_OK) status = lw_lightmap_bevel_cut(&topology);
    if (status == LW_OK) {
        memset(charts->corner, 0xff, triangles * sizeof *charts->corner);
        memset(charts->chart, 0xff, triangles * sizeof *charts->chart);
        status = grow_charts(&topology, charts, plane, apart);
    }
    if (status == LW_OK) status = lw_lightmap_split(charts, &topology);
    if (status == LW_OK) status = lw_lightmap_merge(charts, &topology, plane, apart);
    if (status == LW_OK) status = collapse(&topology, charts);
    if (status == LW_OK) status = find_bends(&topology, charts);
    lw_lightmap_apart_destroy(apart);
    lw_lightmap_plane_destroy(plane);
    lw_lightmap_topology_finish(&topology);
    if (status != LW_OK) lw_lightmap_chart_finish(charts);
    return status;
}

void lw_lightmap_chart_finish(struct lw_lightmap_charts *charts) {
    free(charts->corner);
    free(charts->point);
    free(charts->chart);
    free(charts->bend);
    *charts = (struct lw_lightmap_charts){0};
}
