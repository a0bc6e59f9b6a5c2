/* camera_default.h: a view for a scene without a camera.
 * Flow:    scene, pose, rays -> [camera_default: candidates, each rated by a small path traced picture] ->
 *          camera view
 * Threads: pure function, [any]; works on the calling thread. */
#ifndef LW_CLIENT_PATHS_CAMERA_DEFAULT_H
#define LW_CLIENT_PATHS_CAMERA_DEFAULT_H

#include "client/camera/camera.h"

/** The best of some hundred views. A small picture of each is rated by how many parts of the scene it shows,
 * how large, and how well lit. Backs of single-sided surfaces show nothing.
 * Candidates:
 *   outside  all around, framing the scene's box, or the box of nearly all triangles, since a wide ground
 *            would make an object small
 *   inside   from eye height in that second box; they count the less the more open the place is to the sides
 * Same scene, pose and aspect: same view.
 *
 * pose     whose bounds are framed: without dynamic objects, which may be anywhere
 * trace    of the same scene and pose
 * aspect   width / height of the picture
 * Cost     some 100,000 rays on the calling thread; allocates, and without memory takes a fixed view from
 *          outside */
struct lw_camera_view lw_camera_default(const struct lw_scene *scene, const struct lw_pose *pose,
                                        const struct lw_trace *trace, float aspect);

#endif
