/* cache_renderer.h: the shared cache: one lightwelld, and for each user a client with a view of its own,
 * on loopback.
 * Flow:    scene package, views -> [lightwelld, clients, compose] -> pictures, CPU time by stage
 * Threads: as renderer.h.
 *
 * All clients are real: they receive and decode. They share one copy of the scene and one structure for
 * rays, since they are in one process. The cost of moving these is counted for each client. */
#ifndef LW_CLIENT_MEASURE_SIDES_CACHE_RENDERER_H
#define LW_CLIENT_MEASURE_SIDES_CACHE_RENDERER_H

#include "client/measure/sides/daemon_child.h"
#include "client/measure/sides/renderer.h"
#include "client/measure/sides/viewers.h"

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_cache_renderer_create(const struct lw_renderer_desc *desc,
                                                      struct lw_renderer **out_renderer,
                                                      struct lw_error *err);

/** Starts a server at a setting, for viewers that are yet to join. Stop and finish both in any case.
 * real_clock  frames follow the wall clock
 * Errors      those of the package and of lw_daemon_child_start() */
LW_MUST_CHECK enum lw_status lw_cache_renderer_serve(const struct lw_renderer_desc *desc,
                                                     const struct lw_setting *setting, uint32_t seed,
                                                     bool real_clock, struct lw_daemon_child **out_daemon,
                                                     struct lw_viewers *out_viewers, struct lw_error *err);

#endif
