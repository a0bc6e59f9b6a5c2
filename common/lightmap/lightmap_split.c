#include "common/lightmap/lightmap_split.h"

#include "common/lightmap/lightmap_shape.h"

#include <stdlib.h>
#include <string.h>

/* Charts that fill more of their rectangle than this, or have no side this long, are left alone: a cut is a
 * seam. */
#define FILL_ENOUGH 0.5f
#define SIDE_LEAST  24.0f /* texels */

/* A row of arches gains nothing from one cut, and much from several: a chart as hollow as this is cut in any
 * case. Where that was of no use, merging puts the pieces together again. */
#define FILL_POOR 0.4f

/* The pieces together must cost less than this share of the whole. */
#define GAIN 0.7f

struct segment {
    uint32_t start, end; /* indices into order */
};

struct splitter {
    struct lw_lightmap_charts *charts;
    const struct lw_lightmap_topology *topology;
    uint32_t *order;        /* triangles, segment by segment */
    uint32_t *flood[2];     /* the same segment cut along either axis: triangles piece by piece */
    uint32_t *piece_end[2]; /* where pieces end in flood */
    uint32_t piece_count[2];
    uint32_t *round; /* per triangle: the round that still waits for it */
    uint8_t *half;   /* per triangle */
    uint32_t next_round;
    struct segment *work;
    size_t work_count;
    struct lw_vec2 *point, *hull; /* room to work */
};

static struct lw_lightmap_box box_of(struct splitter *s, const uint32_t *triangle, uint32_t count) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) s->point[n++] = s->charts->point[s->charts->corner[triangle[i]][k]];
    n = lw_lightmap_shape_hull(s->point, n, s->hull);
    return lw_lightmap_shape_box(s->hull, n, LW_LIGHTMAP_SHAPE_MARGIN);
}

/* Whether two triangles hang together in the chart, not only in space. */
static bool is_sewn(const struct splitter *s, uint32_t edge, uint32_t over) {
    const uint32_t *a = s->charts->corner[edge / 3], *b = s->charts->corner[over / 3];
    return a[edge % 3] == b[(over % 3 + 1) % 3] && a[(edge % 3 + 1) % 3] == b[over % 3];
}

/* Pieces of a segment on either side of the middle of its box; returns what their rectangles cost. */
static float cut(struct splitter *s, struct segment segment, const struct lw_lightmap_box *box, int axis) {
    uint32_t round = s->next_round++, count = 0, *out = s->flood[axis];
    for (uint32_t i = segment.start; i < segment.end; i++) {
        uint32_t t = s->order[i];
        struct lw_vec2 middle = {0, 0};
        for (int k = 0; k < 3; k++) {
            struct lw_vec2 p = lw_lightmap_shape_local(box, s->charts->point[s->charts->corner[t][k]]);
            middle.x += p.x / 3, middle.y += p.y / 3;
        }
        s->half[t] = axis ? middle.y > box->size.y / 2 : middle.x > box->size.x / 2;
        s->round[t] = round;
    }
    float cost = 0;
    s->piece_count[axis] = 0;
    for (uint32_t i = segment.start; i < segment.end; i++) {
        if (s->round[s->order[i]] != round) continue;
        uint32_t first = count;
        out[count++] = s->order[i];
        s->round[s->order[i]] = 0;
        for (uint32_t next = first; next < count; next++)
            for (uint32_t e = 3 * out[next]; e < 3 * out[next] + 3; e++) {
                uint32_t over = s->topology->neighbour[e];
                if (over == LW_SCENE_NONE || s->round[over / 3] != round ||
                    s->half[over / 3] != s->half[e / 3] || !is_sewn(s, e, over))
                    continue;
                s->round[over / 3] = 0;
                out[count++] = over / 3;
            }
        s->piece_end[axis][s->piece_count[axis]++] = count;
        cost += lw_lightmap_shape_cost(box_of(s, out + first, count - first));
    }
    return cost;
}

static float fill_of(const struct splitter *s, struct segment segment, const struct lw_lightmap_box *box) {
    float area = 0;
    for (uint32_t i = segment.start; i < segment.end; i++) area += s->topology->area[s->order[i]];
    return area / (box->size.x * box->size.y);
}

static void treat(struct splitter *s, struct segment segment) {
    uint32_t count = segment.end - segment.start;
    struct lw_lightmap_box box = box_of(s, s->order + segment.start, count);
    float fill = fill_of(s, segment, &box);
    if (count > 1 && box.size.x > SIDE_LEAST && fill < FILL_ENOUGH) {
        float cost[2] = {cut(s, segment, &box, 0), cut(s, segment, &box, 1)};
        int axis = cost[1] < cost[0];
        if ((fill < FILL_POOR && s->piece_count[axis] > 1) ||
            cost[axis] < GAIN * lw_lightmap_shape_cost(box)) {
            memcpy(s->order + segment.start, s->flood[axis], count * sizeof *s->order);
            for (uint32_t i = 0, from = segment.start; i < s->piece_count[axis]; i++) {
                s->work[s->work_count++] = (struct segment){from, segment.start + s->piece_end[axis][i]};
                from = segment.start + s->piece_end[axis][i];
            }
            return;
        }
    }
    for (uint32_t i = segment.start; i < segment.end; i++)
        s->charts->chart[s->order[i]] = s->charts->chart_count;
    s->charts->chart_count++;
}

/* Segments of the charts as they are; a count of triangles that are in charts. */
static uint32_t sort_by_chart(struct splitter *s, uint32_t *start) {
    const struct lw_lightmap_charts *charts = s->charts;
    for (uint32_t t = 0; t < charts->triangle_count; t++)
        if (charts->chart[t] != LW_SCENE_NONE) start[charts->chart[t] + 1]++;
    for (uint32_t c = 0; c < charts->chart_count; c++) start[c + 1] += start[c];
    for (uint32_t c = charts->chart_count; c-- > 0;)
        if (start[c] < start[c + 1]) s->work[s->work_count++] = (struct segment){start[c], start[c + 1]};
    uint32_t count = start[charts->chart_count];
    for (uint32_t t = 0; t < charts->triangle_count; t++)
        if (charts->chart[t] != LW_SCENE_NONE) s->order[start[charts->chart[t]]++] = t;
    return count;
}

/* Points on a cut belong to charts on both sides, and each gets its own. order: triangles chart by chart. */
static void part_points(struct splitter *s, uint32_t count, uint32_t *copy, uint32_t *copied_for) {
    uint32_t points = 0;
    struct lw_vec2 *point = s->point;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t t = s->order[i], chart = s->charts->chart[t];
        for (int k = 0; k < 3; k++) {
            uint32_t old = s->charts->corner[t][k];
            if (copied_for[old] != chart) {
                copied_for[old] = chart;
                copy[old] = points;
                point[points++] = s->charts->point[old];
            }
            s->charts->corner[t][k] = copy[old];
        }
    }
    memcpy(s->charts->point, point, points * sizeof *point);
    s->charts->point_count = points;
}

enum lw_status lw_lightmap_split(struct lw_lightmap_charts *charts,
                                 const struct lw_lightmap_topology *topology) {
    size_t triangles = charts->triangle_count, corners = triangles * 3;
    struct splitter s = {.charts = charts, .topology = topology, .next_round = 1};
    uint32_t *start = calloc((size_t)charts->chart_count + 2, sizeof *start);
    uint32_t *copy = malloc((corners + 1) * sizeof *copy),
             *copied_for = malloc((corners + 1) * sizeof *copied_for);
    s.order = malloc((triangles + 1) * sizeof *s.order);
    s.round = calloc(triangles + 1, sizeof *s.round);
    s.half = malloc(triangles + 1);
    s.work = malloc((triangles + 1) * sizeof *s.work);
    s.point = malloc((corners + 1) * sizeof *s.point);
    s.hull = malloc((corners + 2) * sizeof *s.hull);
    bool ready = start && copy && copied_for && s.order && s.round && s.half && s.work && s.point && s.hull;
    for (int axis = 0; axis < 2; axis++) {
        s.flood[axis] = malloc((triangles + 1) * sizeof *s.flood[axis]);
        s.piece_end[axis] = malloc((triangles + 1) * sizeof *s.piece_end[axis]);
        ready = ready && s.flood[axis] && s.piece_end[axis];
    }
    if (ready) {
        memset(copied_for, 0xff, (corners + 1) * sizeof *copied_for);
        uint32_t count = sort_by_chart(&s, start);
        charts->chart_count = 0;
        while (s.work_count) treat(&s, s.work[--s.work_count]);
        part_points(&s, count, copy, copied_for);
    }
    for (int axis = 0; axis < 2; axis++) free(s.flood[axis]), free(s.piece_end[axis]);
    free(s.hull), free(s.point), free(s.work), free(s.half), free(s.round), free(s.order);
    free(copied_for), free(copy), free(start);
    return ready ? LW_OK : LW_NO_MEMORY;
}
