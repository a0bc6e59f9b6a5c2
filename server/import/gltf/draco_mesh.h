/* draco_mesh.h: a mesh of triangles from a Draco stream. The one place that sees C++.
 * Flow:    stream -> [libdraco] -> indices and attributes -> accessors of a primitive
 * Threads: [any].
 * The stream's header has the counts of its contents. They are compared with the caller's bounds before
 * libdraco allocates by them, since it trusts them. */
#ifndef LW_IMPORT_GLTF_DRACO_MESH_H
#define LW_IMPORT_GLTF_DRACO_MESH_H

#include "common/base/status.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Triangles that one byte may hold: a plane grid, all of one symbol, comes near to a thousand. */
#define LW_DRACO_MESH_RATIO_MAX 4096u

enum lw_draco_mesh_type {
    LW_DRACO_INT8,
    LW_DRACO_UINT8,
    LW_DRACO_INT16,
    LW_DRACO_UINT16,
    LW_DRACO_UINT32,
    LW_DRACO_FLOAT
};

struct lw_draco_mesh;

/** Decodes a stream of bitstream version 2.2, as KHR_draco_mesh_compression asks.
 * Errors: LW_BAD_DATA (no such stream, corrupt, more triangles or vertices than the bounds); LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_draco_mesh_create(const uint8_t *bytes, size_t size, uint32_t triangles_max,
                                                  uint32_t vertices_max, struct lw_draco_mesh **out,
                                                  struct lw_error *err);
void lw_draco_mesh_destroy(struct lw_draco_mesh *mesh);

uint32_t lw_draco_mesh_triangle_count(const struct lw_draco_mesh *mesh);
uint32_t lw_draco_mesh_vertex_count(const struct lw_draco_mesh *mesh);

/** Three vertices a triangle, which may be past vertex_count; lives as long as the mesh. */
const uint32_t *lw_draco_mesh_indices(const struct lw_draco_mesh *mesh);

/** The attribute of unique id `id` as vertex_count elements, tightly packed; lives as long as the mesh.
 * Errors: LW_BAD_DATA (no such attribute, another number of components); LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_draco_mesh_attribute(struct lw_draco_mesh *mesh, uint32_t id,
                                                     enum lw_draco_mesh_type type, unsigned components,
                                                     const uint8_t **out, struct lw_error *err);

#ifdef __cplusplus
}
#endif

#endif
