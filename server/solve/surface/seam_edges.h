/* seam_edges.h: finds where a surface goes on but its lightmap does not: edges with two places in atlases.
 * Flow:    scene, pose -> [seam_edges] -> seams (which weld them), tests (which walk them)
 * Threads: one call; no state.
 *
 * Within a mesh: an edge whose triangles have it at different places of the lightmap (chart borders), and
 * open edges, those of one triangle alone, that run along one another for a part of their length
 * (T-junctions). Between objects that never
 * move: open edges that run along one another in the world, for all of their length or a part. Along:
 * to 64 units in the last place of the largest coordinate. Either is a seam only where the surface
 * goes on smoothly: on the other side of the edge, with shading normals that agree to 5 degrees at
 * both ends of the common part. */
#ifndef LW_SURFACE_SEAM_EDGES_H
#define LW_SURFACE_SEAM_EDGES_H

#include "common/scene/pose.h"

#define LW_SEAM_EDGES_COSINE 0.9962f /* 5 degrees: what importers' rounded normals stay under */

/** One seam; side 0 and side 1 run in the same direction. */
struct lw_seam_edge {
    uint32_t object[2], triangle[2];
    struct lw_vec2 from[2], to[2]; /* lightmap texels of the object, backs included */
};

struct lw_seam_edges {
    struct lw_seam_edge *edge;
    size_t count, capacity;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_seam_edges_find(const struct lw_scene *scene, const struct lw_pose *pose,
                                                struct lw_seam_edges *out_edges);
void lw_seam_edges_finish(struct lw_seam_edges *edges);

#endif
