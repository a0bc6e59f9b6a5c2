/* seam_edges.h: finds where a surface goes on but its lightmap does not: edges with two places in atlases.
 * Flow:    scene, pose -> [seam_edges] -> seams (which weld them), tests (which walk them)
 * Threads: one call; no state.
 *
 * Within a mesh: an edge whose triangles have it at different places of the lightmap (chart borders). Between objects that
 * never move: open edges that coincide in world space, to 64 units in the last place of the scene's largest coordinate.
 * Either is a seam only if the surface goes on smoothly: the shading normals of both sides agree to 5 degrees at both
 * ends. Edges that touch along part of their length only (T-junctions) are not found. */
#ifndef LW_SOLVE_SEAM_EDGES_H
#define LW_SOLVE_SEAM_EDGES_H

#include "common/scene/pose.h"

#define LW_SEAM_EDGES_COSINE 0.9962f /* 5 degrees: what importers' rounded normals stay under */

/** One seam; side 0 and side 1 run in the same direction. */
struct lw_seam_edge {
    uint32_t object[2];
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
