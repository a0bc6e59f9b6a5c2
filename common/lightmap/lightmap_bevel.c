#include "common/lightmap/lightmap_bevel.h"

#include "common/lightmap/lightmap_heap.h"

#include <stdlib.h>

#define REACH 0.5f  /* texels: a wider bevel has texels of its own */
#define FLAT  0.02f /* radians */

struct bevels {
    struct lw_lightmap_topology *topology;
    struct lw_vec3 *normal; /* per triangle: of the wide one that it belongs to */
    float *distance;        /* per triangle: from that, texels that bend; INFINITY: it belongs to none */
    struct lw_lightmap_heap heap;
};

static bool is_wide(const struct lw_lightmap_topology *topology, uint32_t t) {
    return topology->area[t] > 0 && !lw_lightmap_topology_is_fine(topology, t);
}

/* How far it is over an edge to the far side of the triangle behind it. What is flat, such as the second half
 * of a strip, has been counted. */
static float step_over(const struct lw_lightmap_topology *topology, uint32_t edge) {
    const uint32_t over = topology->neighbour[edge];
    if (topology->bend[edge] <= FLAT) return 0;
    return 2 * topology->area[over / 3] / topology->side[over / 3][over % 3];
}

static void belong(struct bevels *b, uint32_t t, struct lw_vec3 normal, float distance) {
    b->normal[t] = normal;
    b->distance[t] = distance;
    for (uint32_t e = 3 * t; e < 3 * t + 3; e++) {
        if (b->topology->neighbour[e] == LW_SCENE_NONE || b->topology->hard[e]) continue;
        const float next = distance + step_over(b->topology, e);
        if (next <= REACH) lw_lightmap_heap_push(&b->heap, next, e);
    }
}

/* Nearest first: a triangle belongs to what reaches it first. */
static void spread(struct bevels *b) {
    for (uint32_t t = 0; t < b->topology->triangle_count; t++) b->distance[t] = INFINITY;
    for (uint32_t t = 0; t < b->topology->triangle_count; t++)
        if (is_wide(b->topology, t)) belong(b, t, lw_lightmap_topology_normal(b->topology->mesh, t), 0);
    while (b->heap.count) {
        const float distance = b->heap.step[0].cost;
        const uint32_t edge = lw_lightmap_heap_pop(&b->heap), t = b->topology->neighbour[edge] / 3;
        if (b->distance[t] == INFINITY) belong(b, t, b->normal[edge / 3], distance);
    }
}

static void cut(struct bevels *b) {
    for (uint32_t e = 0; e < 3 * b->topology->triangle_count; e++) {
        const uint32_t over = b->topology->neighbour[e];
        if (over == LW_SCENE_NONE || b->distance[e / 3] + b->distance[over / 3] > 2 * REACH) continue;
        b->topology->hard[e] |= lw_vec3_dot(b->normal[e / 3], b->normal[over / 3]) < LW_LIGHTMAP_CORNER_COS;
    }
}

enum lw_status lw_lightmap_bevel_cut(struct lw_lightmap_topology *topology) {
    const size_t triangles = topology->triangle_count;
    struct bevels b = {.topology = topology,
                       .normal = malloc((triangles + 1) * sizeof *b.normal),
                       .distance = malloc((triangles + 1) * sizeof *b.distance)};
    b.heap.step = malloc((3 * triangles + 1) * sizeof *b.heap.step);
    const bool ready = b.normal && b.distance && b.heap.step;
    if (ready) {
        spread(&b);
        cut(&b);
    }
    free(b.heap.step);
    free(b.distance);
    free(b.normal);
    return ready ? LW_OK : LW_NO_MEMORY;
}
