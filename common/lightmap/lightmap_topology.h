/* lightmap_topology.h: which triangles of a mesh touch, and how sharply.
 * Flow:    mesh -> [topology] -> charts
 * Threads: pure functions of a mesh; [any].
 * Positions are welded by their bits, because files split vertices at seams of texture coordinates and
 * normals. */
#ifndef LW_COMMON_LIGHTMAP_TOPOLOGY_H
#define LW_COMMON_LIGHTMAP_TOPOLOGY_H

#include "common/scene/scene.h"

/** Edge e of triangle t runs from corner e to corner (e + 1) % 3; its number is 3t + e. */
struct lw_lightmap_topology {
    const struct lw_mesh *mesh;
    double scale; /* texels per unit */
    uint32_t triangle_count, weld_count;
    uint32_t *weld; /* per vertex: number of its position */
    /* per edge: the edge on the other side; LW_SCENE_NONE at borders and non-manifold edges */
    uint32_t *neighbour;
    float *bend;      /* per edge: angle between the two planes, radians */
    uint8_t *hard;    /* per edge: the shading breaks here */
    float (*side)[3]; /* per triangle: lengths of its edges, in texels */
    float *area;      /* per triangle, texels; 0 if it is too thin to have a plane */
};

/** scale  texels per unit of object space.  Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_topology_init(struct lw_lightmap_topology *topology,
                                                       const struct lw_mesh *mesh, double scale);
/** Corners of a triangle, in texels. */
void lw_lightmap_topology_places(const struct lw_lightmap_topology *topology, uint32_t triangle,
                                 struct lw_vec3 out_place[3]);
void lw_lightmap_topology_finish(struct lw_lightmap_topology *topology);

/** Normal of a triangle with area, unit. */
struct lw_vec3 lw_lightmap_topology_normal(const struct lw_mesh *mesh, uint32_t triangle);

/** Whether a triangle is lower than a texel, over its longest side. */
static inline bool lw_lightmap_topology_is_fine(const struct lw_lightmap_topology *topology,
                                                uint32_t triangle) {
    const float *side = topology->side[triangle];
    return 2 * topology->area[triangle] < fmaxf(side[0], fmaxf(side[1], side[2]));
}

#endif
