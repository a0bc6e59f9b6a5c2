/* gltf_mesh.h: one glTF mesh, with all its primitives, becomes one mesh with a material per triangle.
 * Only vertices that triangles use are kept, so that primitives may share one large buffer.
 * Threads: a builder belongs to one thread; it keeps its memory from mesh to mesh. */
#ifndef LW_IMPORT_GLTF_GLTF_MESH_H
#define LW_IMPORT_GLTF_GLTF_MESH_H

#include "server/import/gltf/gltf_material.h"
#include "server/import/gltf/gltf_shape.h"
#include "server/import/mesh/mesh_builder.h"

struct lw_gltf_meshes {
    struct lw_gltf_materials *materials;
    struct lw_mesh_builder builder;
    struct lw_gltf_kept {
        uint32_t stamp, vertex;
    } * kept; /* per vertex of an accessor: where it went, valid if stamp is that of the current primitive */
    size_t kept_capacity;
    uint32_t stamp;
    uint64_t triangle_total; /* of all meshes */
    bool is_bright;          /* the mesh being built has vertex colours above 1 */
    struct lw_tally bright;  /* meshes that have */
};

void lw_gltf_meshes_init(struct lw_gltf_meshes *meshes, struct lw_gltf_materials *materials);
void lw_gltf_meshes_finish(struct lw_gltf_meshes *meshes);

/** Converts glTF mesh `index` into *out, whose triangle_count may be 0, as a node shows it.
 * Errors: LW_BAD_DATA that starts with "meshes[N]"; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_meshes_convert(struct lw_gltf_meshes *meshes, uint32_t index,
                                                    const struct lw_gltf_look *look, struct lw_mesh *out,
                                                    struct lw_error *err);

#endif
