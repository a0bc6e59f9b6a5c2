/* mesh_weld.h: vertices of a mesh that lie at one position, since files split them at seams of normals and
 * texture coordinates.
 * Threads: pure function, [any]. */
#ifndef LW_COMMON_MESH_WELD_H
#define LW_COMMON_MESH_WELD_H

#include "common/scene/scene.h"

/** Numbers the distinct positions of a mesh, by their bits, in order of first use. out_weld: vertex_count
 * entries. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_mesh_weld(const struct lw_mesh *mesh, uint32_t *out_weld,
                                          uint32_t *out_weld_count);

#endif
