#include "server/import/mesh/mesh_sides.h"

#include "common/base/union_find.h"

#include <stdlib.h>
#include <string.h>

struct place {
    float x, y, z;
    uint32_t vertex;
};

struct edge {
    uint32_t low, high;
    int32_t direction; /* +1: from low to high */
};

struct surfaces {
    struct place *place;
    struct edge *edge;
    uint32_t *point;  /* per vertex: the first vertex at its place */
    uint32_t *parent; /* per vertex that is a point: forest of connected pieces */
    uint8_t *open;    /* per vertex that is a root */
};

static int compare_places(const void *a, const void *b) {
    const struct place *p = a, *q = b;
    if (p->x != q->x) return p->x < q->x ? -1 : 1;
    if (p->y != q->y) return p->y < q->y ? -1 : 1;
    if (p->z != q->z) return p->z < q->z ? -1 : 1;
    return p->vertex < q->vertex ? -1 : p->vertex > q->vertex;
}

static int compare_edges(const void *a, const void *b) {
    const struct edge *p = a, *q = b;
    if (p->low != q->low) return p->low < q->low ? -1 : 1;
    return p->high < q->high ? -1 : p->high > q->high;
}

static void weld(struct surfaces *s, const struct lw_mesh_builder *builder) {
    uint32_t count = builder->vertex_count;
    for (uint32_t i = 0; i < count; i++) {
        struct lw_vec3 p = builder->vertex[i].position;
        s->place[i] = (struct place){p.x, p.y, p.z, i};
    }
    qsort(s->place, count, sizeof *s->place, compare_places);
    for (uint32_t i = 0, first = 0; i < count; i++) {
        const struct place *p = &s->place[i], *f = &s->place[first];
        if (p->x != f->x || p->y != f->y || p->z != f->z) first = i;
        s->point[p->vertex] = s->place[first].vertex;
    }
}

static size_t collect_edges(struct surfaces *s, const struct lw_mesh_builder *builder) {
    size_t count = 0;
    for (uint32_t t = 0; t < builder->triangle_count; t++)
        for (int k = 0; k < 3; k++) {
            uint32_t a = s->point[builder->triangle[t][k]], b = s->point[builder->triangle[t][(k + 1) % 3]];
            lw_union_find_join(s->parent, a, b);
            s->edge[count++] = (struct edge){a < b ? a : b, a < b ? b : a, a < b ? 1 : -1};
        }
    return count;
}

static void mark_open(struct surfaces *s, size_t edge_count) {
    qsort(s->edge, edge_count, sizeof *s->edge, compare_edges);
    for (size_t i = 0; i < edge_count;) {
        size_t first = i;
        int64_t sum = 0;
        for (; i < edge_count && compare_edges(&s->edge[i], &s->edge[first]) == 0; i++)
            sum += s->edge[i].direction;
        if (sum != 0) s->open[lw_union_find_root(s->parent, s->edge[first].low)] = 1;
    }
}

static void find(struct surfaces *s, const struct lw_mesh_builder *builder, uint8_t *out_closed) {
    weld(s, builder);
    for (uint32_t i = 0; i < builder->vertex_count; i++) s->parent[i] = i;
    mark_open(s, collect_edges(s, builder));
    for (uint32_t t = 0; t < builder->triangle_count; t++)
        out_closed[t] = !s->open[lw_union_find_root(s->parent, s->point[builder->triangle[t][0]])];
}

enum lw_status lw_mesh_sides_find(const struct lw_mesh_builder *builder, uint8_t *out_closed,
                                  struct lw_error *err) {
    size_t vertices = builder->vertex_count + 1ul, triangles = builder->triangle_count + 1ul;
    struct surfaces s = {.place = malloc(vertices * sizeof *s.place),
                         .edge = malloc(3 * triangles * sizeof *s.edge),
                         .point = malloc(vertices * sizeof *s.point),
                         .parent = malloc(vertices * sizeof *s.parent),
                         .open = calloc(vertices, 1)};
    bool good = s.place && s.edge && s.point && s.parent && s.open;
    if (good) find(&s, builder, out_closed);
    free(s.open);
    free(s.parent);
    free(s.point);
    free(s.edge);
    free(s.place);
    return good ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "out of memory for %zu triangles", triangles - 1);
}
