/* bench_voxels.h: a grid of bits over a scene: which cells hold surface, and what sees what through it.
 * Flow:    scene, pose -> [bench_voxels] -> visibility of pairs
 * Threads: built by one thread; then [any].
 * After:   Akenine-Moller 2001 (which cells a triangle overlaps); Amanatides and Woo 1987 (the march).
 *
 * All triangles of objects that are not hidden are solid, whatever their alpha, from both sides. */
#ifndef LW_BENCH_VOXELS_H
#define LW_BENCH_VOXELS_H

#include "common/points16.h"
#include "common/scene/pose.h"

#define BENCH_VOXELS_SIDE_MAX 1024 /* cells of a cube are counted in 32 bits */

struct bench_voxels_desc {
    int32_t side; /* cells along the scene's longest side */
    int32_t skip; /* cells that do not count: of an end of a segment, and within this of it by every axis */
    float lift;   /* by as many cells ends of segments are raised along their normals */
};

struct bench_voxels {
    struct bench_voxels_desc desc;
    struct lw_vec3 low;
    float per_m; /* cells */
    int32_t side[3], stride[3];
    size_t words;
    uint32_t *solid; /* a bit a cell, x first */
};

/** Marks the cells that triangles overlap or touch. Errors: LW_NO_MEMORY; LW_BAD_DATA without a triangle. */
LW_MUST_CHECK enum lw_status bench_voxels_init(struct bench_voxels *voxels,
                                               const struct bench_voxels_desc *desc,
                                               const struct lw_scene *scene, const struct lw_pose *pose,
                                               struct lw_error *err);
/** A zeroed one is fine. */
void bench_voxels_finish(struct bench_voxels *voxels);

/** Which of the active points see a place: no solid cell on the way counts. */
uint16_t bench_voxels_see(const struct bench_voxels *voxels, const struct lw_points16 *points,
                          const float position[3], const float normal[3], uint16_t active);

#endif
