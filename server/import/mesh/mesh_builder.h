/* mesh_builder.h: collects the vertices and triangles of one mesh, for all formats.
 * Flow:    reader of a format -> [mesh_builder] -> struct lw_mesh of a scene
 * Threads: a builder belongs to one thread; it keeps its memory from mesh to mesh. */
#ifndef LW_IMPORT_MESH_MESH_BUILDER_H
#define LW_IMPORT_MESH_MESH_BUILDER_H

#include "common/scene/scene.h"

struct lw_mesh_builder_vertex {
    struct lw_vec3 position; /* m, finite */
    /* unit, or (0, 0, 0): then it gets the normal of the first triangle that uses it */
    struct lw_vec3 normal;
    struct lw_vec2 uv[2];
    struct lw_vec4 colour;
    struct lw_vec4 tangent; /* as the file has it; w 0: it has none */
};

struct lw_mesh_builder {
    struct lw_mesh_builder_vertex *vertex; /* the current mesh's */
    uint32_t (*triangle)[3];
    uint32_t *material; /* per triangle */
    uint32_t vertex_count, triangle_count;
    bool has_uv[2], has_colour; /* set by the reader: whether the mesh keeps them */
    bool has_tangent;           /* the same: some vertices have one */
    size_t vertex_capacity, triangle_capacity, material_capacity;
    uint64_t degenerate_count;  /* triangles of all meshes that were left out because they have no area */
    uint64_t bad_tangent_count; /* vertices of all meshes whose tangent was none */
};

void lw_mesh_builder_init(struct lw_mesh_builder *builder);
void lw_mesh_builder_finish(struct lw_mesh_builder *builder);

/** Forgets the mesh before. */
void lw_mesh_builder_begin(struct lw_mesh_builder *builder);

/** Makes room for `count` elements of `size` bytes, keeping the present ones; false when out of memory. */
LW_MUST_CHECK bool lw_mesh_builder_reserve(void **array, size_t *capacity, size_t count, size_t size);

/** Unit normal of a triangle by its winding. False if it has no area: its height is below 1e-7 of its longest
 * edge, which is the rounding of its corners. */
LW_MUST_CHECK bool lw_mesh_builder_normal(const struct lw_vec3 corner[3], struct lw_vec3 *out);

/** Errors of both: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_mesh_builder_vertex(struct lw_mesh_builder *builder,
                                                    const struct lw_mesh_builder_vertex *vertex,
                                                    uint32_t *out_index, struct lw_error *err);
/** normal  of the triangle, for vertices that have none */
LW_MUST_CHECK enum lw_status lw_mesh_builder_triangle(struct lw_mesh_builder *builder,
                                                      const uint32_t vertex[3], uint32_t material,
                                                      struct lw_vec3 normal, struct lw_error *err);

/** Copies the mesh into memory of the scene, with tangents where materials have normal maps. It has at least
 * one triangle, and its materials are the scene's. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_mesh_builder_end(struct lw_mesh_builder *builder, struct lw_scene *scene,
                                                 const char *name, struct lw_mesh *out, struct lw_error *err);

#endif
