/* gltf_draco.h: KHR_draco_mesh_compression: accessors of a primitive whose bytes are in a Draco stream.
 * Flow:    buffer view -> [gltf_draco] -> open accessors of a primitive
 * Threads: [any]. */
#ifndef LW_IMPORT_GLTF_GLTF_DRACO_H
#define LW_IMPORT_GLTF_GLTF_DRACO_H

#include "server/import/gltf/draco_mesh.h"
#include "server/import/gltf/gltf_accessor.h"

/** Decodes the stream of an extension object and gives its triangles to `indices`.
 * position, indices  open accessors; their counts bound the stream's
 * out_mesh           NULL after failure; must outlive the accessors
 * Errors: LW_BAD_DATA; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_draco_open(const struct lw_gltf_document *document,
                                                const json_t *extension,
                                                const struct lw_gltf_accessor *position,
                                                struct lw_gltf_accessor *indices,
                                                struct lw_draco_mesh **out_mesh, struct lw_error *err);

/** Gives an open accessor its elements from the stream; leaves it alone if the stream has no attribute of
 * that name. Errors: LW_BAD_DATA that starts with the name; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_draco_attribute(const json_t *extension, struct lw_draco_mesh *mesh,
                                                     const char *name, struct lw_gltf_accessor *accessor,
                                                     struct lw_error *err);

#endif
