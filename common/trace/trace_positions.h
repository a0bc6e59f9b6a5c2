/* trace_positions.h: the distinct positions of meshes, for the rays' structure.
 * Flow:    meshes -> [trace_positions] -> trace
 * The structure holds the vertices of each static object in world space. A box has 24 vertices in a file, for
 * its normals, at eight positions. Triangles that count positions are a copy. So a mesh has such a list only
 * where its objects save more by it.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_TRACE_POSITIONS_H
#define LW_COMMON_TRACE_POSITIONS_H

#include "common/scene/scene.h"

struct lw_trace_positions {
    uint32_t count;          /* 0: the vertices of the mesh, and its triangles */
    uint32_t *vertex;        /* per position: a vertex that lies there */
    uint32_t (*triangle)[3]; /* as those of the mesh, by positions */
};

/** Lists them, one for each mesh. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_trace_positions_list(const struct lw_scene *scene,
                                                     struct lw_trace_positions **out_positions);
void lw_trace_positions_free(struct lw_trace_positions *positions, const struct lw_scene *scene);

#endif
