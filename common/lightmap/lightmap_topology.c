#include "common/lightmap/lightmap_topology.h"

#include "common/scene/mesh_weld.h"

#include <stdlib.h>
#include <string.h>

/* A triangle lower than this times its longest side has no usable plane in single precision. */
#define THINNEST 1e-6

/* Where shading normals part by more than 35 degrees, light does too: such an edge must not be interpolated
 * across. Facets of a flat-shaded cylinder of a dozen sides still pass. */
#define HARD_NORMAL_COS 0.82f
/* A smooth-shaded edge bent more sharply than this is a corner all the same. */
#define HARD_BEND (75.0f * LW_PI / 180.0f)

struct edge {
    uint32_t low, high; /* welded ends */
    uint32_t number;
};

static int compare_edges(const void *left, const void *right) {
    const struct edge *a = left, *b = right;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    if (a->high != b->high) return a->high < b->high ? -1 : 1;
    return a->number < b->number ? -1 : a->number > b->number;
}

/* In double, because scenes may be as small as a millimetre or as large as a country. */
static void measure(struct lw_lightmap_topology *topology, double scale) {
    const struct lw_mesh *mesh = topology->mesh;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        double d[3][3], length[3], longest = 0;
        for (int e = 0; e < 3; e++) {
            struct lw_vec3 a = mesh->position[mesh->triangle[t][e]];
            struct lw_vec3 b = mesh->position[mesh->triangle[t][(e + 1) % 3]];
            d[e][0] = ((double)b.x - (double)a.x) * scale;
            d[e][1] = ((double)b.y - (double)a.y) * scale;
            d[e][2] = ((double)b.z - (double)a.z) * scale;
            length[e] = sqrt(d[e][0] * d[e][0] + d[e][1] * d[e][1] + d[e][2] * d[e][2]);
            if (length[e] > longest) longest = length[e];
            topology->side[t][e] = (float)length[e];
        }
        double x = d[0][1] * d[1][2] - d[0][2] * d[1][1], y = d[0][2] * d[1][0] - d[0][0] * d[1][2],
               z = d[0][0] * d[1][1] - d[0][1] * d[1][0];
        double twice = sqrt(x * x + y * y + z * z);
        topology->area[t] = twice > THINNEST * longest * longest && twice > 1e-30 ? (float)(twice / 2) : 0.0f;
    }
}

struct lw_vec3 lw_lightmap_topology_normal(const struct lw_mesh *mesh, uint32_t t) {
    const uint32_t *v = mesh->triangle[t];
    struct lw_vec3 a = lw_vec3_sub(mesh->position[v[1]], mesh->position[v[0]]);
    struct lw_vec3 b = lw_vec3_sub(mesh->position[v[2]], mesh->position[v[0]]);
    /* unit sides first: the product of two millimetres must not underflow */
    return lw_vec3_normalize(lw_vec3_cross(lw_vec3_normalize(a), lw_vec3_normalize(b)));
}

static void join(struct lw_lightmap_topology *topology, uint32_t a, uint32_t b) {
    const struct lw_mesh *mesh = topology->mesh;
    uint32_t ta = a / 3, tb = b / 3;
    struct lw_vec3 na = lw_lightmap_topology_normal(mesh, ta), nb = lw_lightmap_topology_normal(mesh, tb);
    float bend = atan2f(lw_vec3_length(lw_vec3_cross(na, nb)), lw_vec3_dot(na, nb));
    /* the edges run against each other: the start of one is the end of the other */
    struct lw_vec3 a0 = mesh->normal[mesh->triangle[ta][a % 3]],
                   a1 = mesh->normal[mesh->triangle[ta][(a % 3 + 1) % 3]],
                   b0 = mesh->normal[mesh->triangle[tb][b % 3]],
                   b1 = mesh->normal[mesh->triangle[tb][(b % 3 + 1) % 3]];
    bool hard =
        lw_vec3_dot(a0, b1) < HARD_NORMAL_COS || lw_vec3_dot(a1, b0) < HARD_NORMAL_COS || bend > HARD_BEND;
    topology->neighbour[a] = b;
    topology->neighbour[b] = a;
    topology->bend[a] = topology->bend[b] = bend;
    topology->hard[a] = topology->hard[b] = hard;
}

/* Edges that exactly two triangles share, in opposite directions, are joined; all others stay borders. */
static void join_pairs(struct lw_lightmap_topology *topology, struct edge *edge, size_t count) {
    const struct lw_mesh *mesh = topology->mesh;
    qsort(edge, count, sizeof *edge, compare_edges);
    for (size_t first = 0, last; first < count; first = last) {
        last = first + 1;
        while (last < count && edge[last].low == edge[first].low && edge[last].high == edge[first].high)
            last++;
        if (last - first != 2) continue;
        uint32_t a = edge[first].number, b = edge[first + 1].number;
        if (topology->weld[mesh->triangle[a / 3][a % 3]] != topology->weld[mesh->triangle[b / 3][b % 3]])
            join(topology, a, b);
    }
}

enum lw_status lw_lightmap_topology_init(struct lw_lightmap_topology *topology, const struct lw_mesh *mesh,
                                         double scale) {
    size_t triangles = mesh->triangle_count, edges = triangles * 3;
    struct edge *edge = malloc((edges + 1) * sizeof *edge);
    *topology = (struct lw_lightmap_topology){
        .mesh = mesh,
        .scale = scale,
        .triangle_count = mesh->triangle_count,
        .weld = malloc(((size_t)mesh->vertex_count + 1) * sizeof *topology->weld),
        .neighbour = malloc((edges + 1) * sizeof *topology->neighbour),
        .bend = calloc(edges + 1, sizeof *topology->bend),
        .hard = calloc(edges + 1, sizeof *topology->hard),
        .side = malloc((triangles + 1) * sizeof *topology->side),
        .area = malloc((triangles + 1) * sizeof *topology->area),
    };
    if (!edge || !topology->weld || !topology->neighbour || !topology->bend || !topology->hard ||
        !topology->side || !topology->area ||
        lw_mesh_weld(mesh, topology->weld, &topology->weld_count) != LW_OK)
        goto fail;
    memset(topology->neighbour, 0xff, edges * sizeof *topology->neighbour);
    measure(topology, scale);
    size_t count = 0;
    for (uint32_t n = 0; n < edges; n++) {
        if (topology->area[n / 3] == 0) continue;
        uint32_t a = topology->weld[mesh->triangle[n / 3][n % 3]];
        uint32_t b = topology->weld[mesh->triangle[n / 3][(n % 3 + 1) % 3]];
        edge[count++] = (struct edge){a < b ? a : b, a < b ? b : a, n};
    }
    join_pairs(topology, edge, count);
    free(edge);
    return LW_OK;
fail:
    free(edge);
    lw_lightmap_topology_finish(topology);
    return LW_NO_MEMORY;
}

void lw_lightmap_topology_places(const struct lw_lightmap_topology *topology, uint32_t triangle,
                                 struct lw_vec3 out_place[3]) {
    for (int k = 0; k < 3; k++) {
        struct lw_vec3 p = topology->mesh->position[topology->mesh->triangle[triangle][k]];
        out_place[k] = lw_vec3((float)((double)p.x * topology->scale), (float)((double)p.y * topology->scale),
                               (float)((double)p.z * topology->scale));
    }
}

void lw_lightmap_topology_finish(struct lw_lightmap_topology *topology) {
    free(topology->weld);
    free(topology->neighbour);
    free(topology->bend);
    free(topology->hard);
    free(topology->side);
    free(topology->area);
    *topology = (struct lw_lightmap_topology){0};
}
