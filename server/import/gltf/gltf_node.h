/* gltf_node.h: the hierarchy of the file's default scene, parents first, with its objects, lights and
 * cameras.
 * Threads: one conversion per document. No recursion: depth costs nothing. */
#ifndef LW_IMPORT_GLTF_GLTF_NODE_H
#define LW_IMPORT_GLTF_GLTF_NODE_H

#include "server/import/gltf/gltf_mesh.h"

/** Fills the scene's nodes, meshes, objects, lights and cameras.
 * out_node_of  one entry per glTF node: the scene's node, or LW_SCENE_NONE
 * Errors: LW_BAD_DATA naming the node; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_node_convert(struct lw_gltf_document *document,
                                                  struct lw_gltf_meshes *meshes, struct lw_scene *scene,
                                                  uint32_t *out_node_of, struct lw_error *err);

#endif
