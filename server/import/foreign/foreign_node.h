/* foreign_node.h: the nodes of Assimp's scene, with the objects, lights and cameras that hang on them. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_NODE_H
#define LW_IMPORT_FOREIGN_FOREIGN_NODE_H

#include "server/import/foreign/foreign_mesh.h"

/** Finds nodes by name; the first one counts where several share a name. */
struct lw_foreign_nodes {
    const struct aiNode **queue; /* breadth first, so that parents come before their children */
    uint32_t count;
    uint32_t *by_name; /* indices of the queue, sorted by name, then by place in the queue */
};

/** Fills the nodes, objects, lights and cameras of the scene; finish() also after failure.
 * Errors: LW_BAD_DATA naming the element; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_foreign_nodes_convert(struct lw_foreign_nodes *nodes,
                                                      struct lw_foreign_import *import,
                                                      struct lw_foreign_meshes *meshes, struct lw_error *err);
void lw_foreign_nodes_finish(struct lw_foreign_nodes *nodes);

/** Index of a node of the scene by its name in the file, or LW_SCENE_NONE. */
uint32_t lw_foreign_nodes_find(const struct lw_foreign_nodes *nodes, const struct aiString *name);

#endif
