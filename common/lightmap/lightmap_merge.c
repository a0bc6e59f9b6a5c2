#include "common/lightmap/lightmap_merge.h"

#include "common/lightmap/lightmap_heap.h"
#include "common/lightmap/lightmap_shape.h"

#include <stdlib.h>
#include <string.h>

/* A chart longer than about the side of the atlas decides its shape alone, and the rest stays empty. */
#define LENGTH_SHARE 0.8f

/* Two charts may share many edges; laid over its longest ones, one either fits or it does not. */
#define TRIES 3

/* A chart may change its size by this share to make its edge as long as its neighbour's. */
#define RESIZE 0.1f

/* A chart with a long outline and many neighbours is not worth the product of the two: when that many points
 * have been looked at per triangle, charts stay as they are. */
#define LOOKS_EACH 32768u
#define LOOKS_MORE (1u << 28)

struct hull {
    uint32_t start, count; /* in the arena */
};

struct merger {
    struct lw_lightmap_charts *charts;
    const struct lw_lightmap_topology *topology;
    struct lw_lightmap_plane *plane;
    struct lw_lightmap_apart *apart;
    enum lw_status status;
    struct lw_lightmap_heap heap;  /* border edges of the chart that takes others in */
    struct hull *hull;             /* per chart */
    struct lw_vec2 *arena;         /* all hulls */
    float length_most;             /* a merged chart's */
    float *cost, *length, *area;   /* per chart */
    uint32_t *first, *last, *next; /* triangles of a chart, as a list: per chart, per chart, per triangle */
    uint32_t *tried_by;            /* per chart: the chart that tried it last */
    uint8_t *tries, *done;
    uint32_t *moved;                   /* per point: the chart that moved it here, lest it move twice */
    struct lw_vec2 *outline, *scratch; /* hull of the taker; room to work */
    uint32_t outline_count;
    uint64_t looks; /* how many are left */
};

/* Turn, shift and slight change of size that lay one chart beside another. */
struct motion {
    float cosine, sine, x, y;
};

static struct lw_vec2 moved(const struct motion *m, struct lw_vec2 p) {
    return (struct lw_vec2){m->cosine * p.x - m->sine * p.y + m->x, m->sine * p.x + m->cosine * p.y + m->y};
}

static void corners_of(const struct merger *m, uint32_t t, struct lw_vec2 out[3]) {
    for (int k = 0; k < 3; k++) out[k] = m->charts->point[m->charts->corner[t][k]];
}

static void push_border(struct merger *m, uint32_t t) {
    for (uint32_t e = 3 * t; e < 3 * t + 3; e++) {
        uint32_t over = m->topology->neighbour[e];
        /* Light changes at a hard edge, and a bilinear lookup next to it sees a texel of the other side: the
         * bars of a lantern are a texel wide and a thousand times brighter inside than outside. */
        if (over == LW_SCENE_NONE || m->topology->hard[e]) continue;
        if (m->charts->chart[over / 3] == m->charts->chart[t]) continue;
        lw_lightmap_heap_push(&m->heap, -m->topology->side[t][e % 3], e);
    }
}

static void add_triangle(struct merger *m, uint32_t t) {
    struct lw_vec2 corner[3];
    struct lw_vec3 place[3];
    corners_of(m, t, corner);
    lw_lightmap_topology_places(m->topology, t, place);
    lw_lightmap_plane_add(m->plane, corner);
    if (m->status == LW_OK) m->status = lw_lightmap_apart_add(m->apart, corner, place);
}

static void open_chart(struct merger *m, uint32_t chart) {
    lw_lightmap_plane_clear(m->plane);
    lw_lightmap_apart_clear(m->apart);
    m->heap.count = 0;
    for (uint32_t t = m->first[chart]; t != LW_SCENE_NONE; t = m->next[t]) {
        add_triangle(m, t);
        push_border(m, t);
    }
    m->outline_count = m->hull[chart].count;
    memcpy(m->outline, m->arena + m->hull[chart].start, m->outline_count * sizeof *m->outline);
}

/* The motion that lays the neighbour's edge on ours. */
static bool find_motion(const struct merger *m, uint32_t edge, struct motion *out) {
    uint32_t over = m->topology->neighbour[edge];
    const uint32_t *ours = m->charts->corner[edge / 3], *theirs = m->charts->corner[over / 3];
    struct lw_vec2 p = m->charts->point[ours[edge % 3]], q = m->charts->point[ours[(edge % 3 + 1) % 3]];
    struct lw_vec2 r = m->charts->point[theirs[(over % 3 + 1) % 3]], s = m->charts->point[theirs[over % 3]];
    float ax = q.x - p.x, ay = q.y - p.y, bx = s.x - r.x, by = s.y - r.y;
    float cosine = ax * bx + ay * by, sine = ay * bx - ax * by, length = sqrtf(cosine * cosine + sine * sine);
    if (!(length > 1e-20f)) return false;
    float ratio = sqrtf((ax * ax + ay * ay) / (bx * bx + by * by));
    if (!(fabsf(ratio - 1) <= RESIZE)) return false;
    *out = (struct motion){ratio * cosine / length, ratio * sine / length, 0, 0};
    struct lw_vec2 middle = moved(out, (struct lw_vec2){(r.x + s.x) / 2, (r.y + s.y) / 2});
    out->x = (p.x + q.x) / 2 - middle.x;
    out->y = (p.y + q.y) / 2 - middle.y;
    return true;
}

/* Hull of the taker and a moved chart; in scratch, with the hull's corners after its points. */
static struct lw_vec2 *joint_hull(struct merger *m, uint32_t chart, const struct motion *motion,
                                  uint32_t *out_count) {
    uint32_t n = m->outline_count;
    memcpy(m->scratch, m->outline, n * sizeof *m->scratch);
    for (uint32_t i = 0; i < m->hull[chart].count; i++)
        m->scratch[n++] = moved(motion, m->arena[m->hull[chart].start + i]);
    *out_count = lw_lightmap_shape_hull(m->scratch, n, m->scratch + n);
    return m->scratch + n;
}

static bool lands_free(const struct merger *m, uint32_t chart, const struct motion *motion) {
    for (uint32_t t = m->first[chart]; t != LW_SCENE_NONE; t = m->next[t]) {
        struct lw_vec2 corner[3];
        corners_of(m, t, corner);
        for (int k = 0; k < 3; k++) corner[k] = moved(motion, corner[k]);
        if (lw_lightmap_plane_overlaps(m->plane, corner)) return false;
        struct lw_vec3 place[3];
        lw_lightmap_topology_places(m->topology, t, place);
        if (lw_lightmap_apart_mixes(m->apart, corner, place)) return false;
    }
    return true;
}

static void take_in(struct merger *m, uint32_t taker, uint32_t chart, const struct motion *motion) {
    for (uint32_t t = m->first[chart]; t != LW_SCENE_NONE; t = m->next[t]) {
        m->charts->chart[t] = taker;
        for (int k = 0; k < 3; k++) {
            uint32_t p = m->charts->corner[t][k];
            if (m->moved[p] == taker) continue;
            m->moved[p] = taker;
            m->charts->point[p] = moved(motion, m->charts->point[p]);
        }
        add_triangle(m, t);
    }
    for (uint32_t t = m->first[chart]; t != LW_SCENE_NONE; t = m->next[t]) push_border(m, t);
    m->next[m->last[taker]] = m->first[chart];
    m->last[taker] = m->last[chart];
    m->done[chart] = 1;
    m->first[chart] = LW_SCENE_NONE;
}

static void try_edge(struct merger *m, uint32_t taker, uint32_t edge) {
    uint32_t chart = m->charts->chart[m->topology->neighbour[edge] / 3];
    if (chart == taker || m->done[chart]) return;
    if (m->tried_by[chart] != taker) m->tried_by[chart] = taker, m->tries[chart] = 0;
    struct motion motion;
    if (m->tries[chart]++ >= TRIES || !find_motion(m, edge, &motion)) return;
    uint32_t count;
    const uint64_t points = m->outline_count + m->hull[chart].count;
    const uint64_t looks = points * (points < 256 ? points : 256);
    if (looks > m->looks) return;
    m->looks -= looks;
    struct lw_vec2 *hull = joint_hull(m, chart, &motion, &count);
    struct lw_lightmap_box box = lw_lightmap_shape_box(hull, count, LW_LIGHTMAP_SHAPE_MARGIN);
    float cost = lw_lightmap_shape_cost(box);
    if (box.size.x > m->length_most && box.size.x > m->length[taker] * 1.05f) return;
    if (cost > m->cost[taker] + m->cost[chart] || !lands_free(m, chart, &motion)) return;
    take_in(m, taker, chart, &motion);
    memcpy(m->outline, hull, count * sizeof *hull);
    m->outline_count = count;
    m->cost[taker] = cost;
    m->length[taker] = box.size.x;
}

struct rank {
    float area;
    uint32_t chart;
};

static int compare_ranks(const void *left, const void *right) {
    const struct rank *a = left, *b = right;
    if (a->area != b->area) return a->area > b->area ? -1 : 1;
    return a->chart < b->chart ? -1 : a->chart > b->chart;
}

/* The largest first: everything smaller may still join it. */
static void merge_all(struct merger *m, struct rank *rank) {
    uint32_t count = m->charts->chart_count;
    for (uint32_t c = 0; c < count; c++) rank[c] = (struct rank){m->area[c], c};
    qsort(rank, count, sizeof *rank, compare_ranks);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t taker = rank[i].chart;
        if (m->done[taker]) continue;
        m->done[taker] = 1;
        open_chart(m, taker);
        while (m->heap.count && m->status == LW_OK) try_edge(m, taker, lw_lightmap_heap_pop(&m->heap));
    }
}

static void list_triangles(struct merger *m) {
    for (uint32_t t = 0; t < m->charts->triangle_count; t++) {
        uint32_t c = m->charts->chart[t];
        if (c == LW_SCENE_NONE) continue;
        m->next[t] = LW_SCENE_NONE;
        if (m->first[c] == LW_SCENE_NONE)
            m->first[c] = t;
        else
            m->next[m->last[c]] = t;
        m->last[c] = t;
        m->area[c] += m->topology->area[t];
    }
}

static void find_hulls(struct merger *m) {
    uint32_t used = 0;
    float total = 0;
    for (uint32_t c = 0; c < m->charts->chart_count; c++) {
        uint32_t n = 0;
        for (uint32_t t = m->first[c]; t != LW_SCENE_NONE; t = m->next[t], n += 3)
            corners_of(m, t, m->scratch + n);
        uint32_t count = lw_lightmap_shape_hull(m->scratch, n, m->arena + used);
        struct lw_lightmap_box box = lw_lightmap_shape_box(m->arena + used, count, LW_LIGHTMAP_SHAPE_MARGIN);
        m->hull[c] = (struct hull){used, count};
        m->cost[c] = lw_lightmap_shape_cost(box);
        m->length[c] = box.size.x;
        total += m->cost[c];
        used += count;
    }
    m->length_most = LENGTH_SHARE * sqrtf(total);
}

static void renumber(struct merger *m) {
    uint32_t count = 0, *number = m->tried_by;
    for (uint32_t c = 0; c < m->charts->chart_count; c++)
        if (m->first[c] != LW_SCENE_NONE) number[c] = count++;
    for (uint32_t t = 0; t < m->charts->triangle_count; t++)
        if (m->charts->chart[t] != LW_SCENE_NONE) m->charts->chart[t] = number[m->charts->chart[t]];
    m->charts->chart_count = count;
}

enum lw_status lw_lightmap_merge(struct lw_lightmap_charts *charts,
                                 const struct lw_lightmap_topology *topology, struct lw_lightmap_plane *plane,
                                 struct lw_lightmap_apart *apart) {
    size_t triangles = charts->triangle_count, count = charts->chart_count, corners = triangles * 3;
    struct merger m = {.charts = charts,
                       .topology = topology,
                       .plane = plane,
                       .apart = apart,
                       .looks = LOOKS_EACH * triangles + LOOKS_MORE};
    struct rank *rank = malloc((count + 1) * sizeof *rank);
    m.heap.step = malloc((corners + 1) * sizeof *m.heap.step);
    m.hull = malloc((count + 1) * sizeof *m.hull);
    m.arena = malloc((corners + count + 1) * sizeof *m.arena);
    m.cost = malloc((count + 1) * sizeof *m.cost);
    m.length = malloc((count + 1) * sizeof *m.length);
    m.area = calloc(count + 1, sizeof *m.area);
    m.first = malloc((count + 1) * sizeof *m.first);
    m.last = malloc((count + 1) * sizeof *m.last);
    m.next = malloc((triangles + 1) * sizeof *m.next);
    m.tried_by = malloc((count + 1) * sizeof *m.tried_by);
    m.tries = calloc(count + 1, 1);
    m.done = calloc(count + 1, 1);
    m.moved = malloc((corners + 1) * sizeof *m.moved);
    m.outline = malloc((corners + 2) * sizeof *m.outline);
    m.scratch = malloc((corners * 2 + 4) * sizeof *m.scratch);
    bool ready = rank && m.heap.step && m.hull && m.arena && m.cost && m.length && m.area && m.first &&
                 m.last && m.next && m.tried_by && m.tries && m.done && m.moved && m.outline && m.scratch;
    if (ready) {
        memset(m.first, 0xff, (count + 1) * sizeof *m.first);
        memset(m.tried_by, 0xff, (count + 1) * sizeof *m.tried_by);
        memset(m.moved, 0xff, (corners + 1) * sizeof *m.moved);
        list_triangles(&m);
        find_hulls(&m);
        merge_all(&m, rank);
        renumber(&m);
    }
    free(m.scratch), free(m.outline), free(m.moved), free(m.done), free(m.tries), free(m.tried_by),
        free(m.next);
    free(m.last), free(m.first), free(m.area), free(m.length), free(m.cost), free(m.arena), free(m.hull);
    free(m.heap.step), free(rank);
    return ready ? m.status : LW_NO_MEMORY;
}
