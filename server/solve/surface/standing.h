/* standing.h: which objects part texels: those that stand still now.
 * Flow:    poses, frame by frame -> [standing] -> hidden_points, crossings, invalid_texels
 * Threads: one at a time; between two calls [any] may read.
 *
 * An object that never moves stands. One that clients move stands, too, once it has been put somewhere: at
 * once if it was at rest before, else after LW_STANDING_FRAMES frames at rest. While it is moved on
 * and on it does not, for the texels that it parts would change in every frame. A hidden object does not
 * stand, nor one that the scene's own animation moves. */
#ifndef LW_SURFACE_STANDING_H
#define LW_SURFACE_STANDING_H

#include "common/scene/pose.h"

#define LW_STANDING_FRAMES 8u

struct lw_standing {
    const struct lw_scene *scene;
    bool *stands; /* per object */
    bool *stood;  /* per object: before the last change */
    /* Per object: the frame of its last movement; LW_STANDING_NEVER. */
    uint64_t *moved_frame;
    bool waits; /* some are to stand later */
};
#define LW_STANDING_NEVER UINT64_MAX

/** All objects that may stand do so from the first. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_standing_init(struct lw_standing *standing, const struct lw_scene *scene,
                                              const struct lw_pose *pose);
/** A zeroed one is fine. */
void lw_standing_finish(struct lw_standing *standing);

/** Goes on to a frame.
 * was, is  its poses before and now; may be the same
 * Returns whether other objects stand than before, or some elsewhere. */
bool lw_standing_take(struct lw_standing *standing, const struct lw_pose *was, const struct lw_pose *is,
                      uint64_t frame);

#endif
