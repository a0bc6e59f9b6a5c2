/* mesh_tangents.h: tangents of the corners that have a normal map.
 * Flow:    mesh with its final materials -> [mesh_tangents] -> lw_mesh.tangent
 * Threads: [any].
 * After:   Mikkelsen, Simulation of Wrinkled Surfaces Revisited, 2008: the MikkTSpace rule, of which glTF and
 *          the programs that make normal maps are.
 *
 * Corners with the same place, normal, texture coordinates and material whose triangles touch along edges,
 * and are drawn the same way around, share a tangent. It is the mean of where u grows on their triangles,
 * laid into the plane of the normal, weighted by their angles. The angular threshold is 180 degrees. Texture
 * coordinates are those of the normal map: its set, after its transform.
 *
 * A triangle without area in its picture takes the tangent of the group beside it. Without a group beside it,
 * any tangent holds. Surfaces without texture coordinates have no tangents. */
#ifndef LW_IMPORT_MESH_MESH_TANGENTS_H
#define LW_IMPORT_MESH_MESH_TANGENTS_H

#include "common/scene/scene.h"

/** Sets mesh->tangent; NULL where no triangle needs it.
 * given    per vertex, of the file: x, y, z and w, which is 1 or -1; w 0: none. NULL: none has. A wrong
 *          tangent gets w 0
 * out_bad  grows by the vertices whose given tangent is none: not finite, of no length, along the normal, or
 *          of another w. The rule's stands in
 * Errors   LW_NO_MEMORY */
LW_MUST_CHECK enum lw_status lw_mesh_tangents_build(struct lw_scene *scene, struct lw_mesh *mesh,
                                                    struct lw_vec4 *given, uint64_t *out_bad,
                                                    struct lw_error *err);

#endif
