/* gltf_instances.h: EXT_mesh_gpu_instancing: a node's mesh many times, each at a place of its own below the
 * node.
 * Threads: [any]. */
#ifndef LW_IMPORT_GLTF_GLTF_INSTANCES_H
#define LW_IMPORT_GLTF_GLTF_INSTANCES_H

#include "common/scene/scene.h"
#include "server/import/gltf/gltf_accessor.h"

struct lw_gltf_instances {
    uint32_t count;                                       /* 0: the node has no such extension */
    struct lw_gltf_accessor translation, rotation, scale; /* count 0: absent */
};

/** Errors: LW_BAD_DATA that starts with the extension's name. */
LW_MUST_CHECK enum lw_status lw_gltf_instances_open(const struct lw_gltf_document *document,
                                                    const json_t *node, struct lw_gltf_instances *out,
                                                    struct lw_error *err);

/** The place of instance i < count into a node that has none yet. Errors: LW_BAD_DATA. */
LW_MUST_CHECK enum lw_status lw_gltf_instances_read(const struct lw_gltf_instances *instances, uint32_t i,
                                                    struct lw_node *node, struct lw_error *err);

#endif
