/* cache_renderer.h: the shared cache: one lightwelld, and for each user a client with a view of its own,
 * on loopback.
 * Flow:    scene package, views -> [lightwelld, clients, compose] -> pictures, CPU time by stage
 * Threads: as renderer.h.
 *
 * All clients are real: they receive and decode. They share one copy of the scene and one structure for
 * rays, since they are in one process. The cost of moving these is counted for each client. */
#ifndef LW_CLIENT_MEASURE_SIDES_CACHE_RENDERER_H
#define LW_CLIENT_MEASURE_SIDES_CACHE_RENDERER_H

#include "client/measure/sides/renderer.h"

struct lw_cache_renderer_desc {
    struct lw_renderer_cameras cameras;
    uint32_t width, height, stride, bounces;
    unsigned threads; /* 0: all */
    bool denoise;
    const char *solver; /* by name; NULL: the default */
    /* Gives the path of a scene package with a lightmap `density` times as dense as the default. The path
     * is good until destroy. Errors: its own. */
    enum lw_status (*package)(void *context, double density, const char **out_path, struct lw_error *err);
    void *context;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_cache_renderer_create(const struct lw_cache_renderer_desc *desc,
                                                      struct lw_renderer **out_renderer,
                                                      struct lw_error *err);

#endif
