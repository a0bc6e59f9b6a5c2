/* per_user_renderer.h: the opponents: each user renders paths on a machine of its own (path_renderer.h).
 * Flow:    scene, views -> [per_user_renderer] -> pictures, CPU time
 * Threads: as renderer.h. */
#ifndef LW_CLIENT_MEASURE_SIDES_PER_USER_RENDERER_H
#define LW_CLIENT_MEASURE_SIDES_PER_USER_RENDERER_H

#include "client/measure/sides/renderer.h"
#include "client/paths/path_renderer.h"

/** Errors: LW_NO_MEMORY, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_per_user_renderer_create(const struct lw_renderer_desc *desc,
                                                         enum lw_path_renderer_kind kind,
                                                         struct lw_renderer **out_renderer,
                                                         struct lw_error *err);

#endif
