/* mesh_sides.h: which triangles of a mesh belong to closed surfaces, whose backs nobody can see.
 * Threads: [any]. */
#ifndef LW_IMPORT_MESH_MESH_SIDES_H
#define LW_IMPORT_MESH_MESH_SIDES_H

#include "server/import/mesh/mesh_builder.h"

/** A connected piece of surface is closed if every edge is passed equally often in both directions.
 * Vertices at the same place are one.
 * out_closed  one byte per triangle of the builder: 0 or 1
 * Errors: LW_NO_MEMORY. Cost: sorts the edges. */
LW_MUST_CHECK enum lw_status lw_mesh_sides_find(const struct lw_mesh_builder *builder, uint8_t *out_closed,
                                                struct lw_error *err);

#endif
