/* live_scene.h: what only the scene says, found once: names, boxes of meshes, where cameras are.
 * Flow:    package -> scene -> [live_scene] -> lw_live_get_object() and its likes
 * Threads: as live_state.h. */
#ifndef LIGHTWELL_LIVE_SCENE_H
#define LIGHTWELL_LIVE_SCENE_H

#include "client/lib/live_state.h"

/** Prepares what only the scene says. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_live_scene_init(struct lw_live *live, const struct lw_scene *scene);
/** A zeroed one is fine. */
void lw_live_scene_finish(struct lw_live *live);

#endif
