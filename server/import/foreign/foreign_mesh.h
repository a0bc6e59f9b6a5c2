/* foreign_mesh.h: the meshes that hang on one node of Assimp's become one mesh with a material per triangle.
 * Equal vertices are shared again: Assimp gives every corner a vertex of its own.
 * Threads: a builder belongs to one thread; it keeps its memory from mesh to mesh. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_MESH_H
#define LW_IMPORT_FOREIGN_FOREIGN_MESH_H

#include "server/import/foreign/foreign_material.h"
#include "server/import/mesh/mesh_builder.h"

struct lw_foreign_meshes {
    struct lw_foreign_materials *materials;
    struct lw_mesh_builder builder;
    uint32_t *table; /* vertices by hash, open addressing; LW_SCENE_NONE: free */
    size_t table_size;
    uint8_t *coloured; /* per triangle: its mesh has vertex colours */
    size_t coloured_capacity;
    uint64_t triangle_total;
    uint64_t turned_count; /* triangles whose winding was against their normals */
    bool is_bright;
    struct lw_tally bright; /* meshes with vertex colours above 1 */
};

void lw_foreign_meshes_init(struct lw_foreign_meshes *meshes, struct lw_foreign_materials *materials);
void lw_foreign_meshes_finish(struct lw_foreign_meshes *meshes);

/** Checks what the triangulation of Assimp relies on: a face, indices, finite numbers.
 * Errors: LW_BAD_DATA naming the mesh. */
LW_MUST_CHECK enum lw_status lw_foreign_meshes_check(struct lw_foreign_import *import, struct lw_error *err);

/** Converts `count` of the file's meshes into *out, whose triangle_count may be 0.
 * Errors: LW_BAD_DATA naming mesh and field; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_foreign_meshes_convert(struct lw_foreign_meshes *meshes,
                                                       const unsigned *index, unsigned count,
                                                       struct lw_mesh *out, struct lw_error *err);

#endif
