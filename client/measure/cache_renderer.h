/* cache_renderer.h: our side: a lightwelld, and a client of liblightwell with a view of his own per user, on
 * loopback.
 * Flow:    scene package, views -> [lightwelld, clients, compose] -> pictures, CPU time by stage
 * Threads: as renderer.h.
 *
 * All clients are real: they receive and decode. They share one copy of the scene and one structure for rays,
 * since they live in one process; what each would spend on moving that is counted for each. */
#ifndef LW_CLIENT_MEASURE_CACHE_RENDERER_H
#define LW_CLIENT_MEASURE_CACHE_RENDERER_H

#include "client/measure/renderer.h"

struct lw_cache_renderer_desc {
    struct lw_renderer_cameras cameras;
    uint32_t width, height, stride, bounces;
    unsigned threads; /* 0: all */
    bool denoise;
    const char *solver; /* by name; NULL: the default */
    /* The path of a scene package whose lightmap is so many times as dense as the default; good until
     * destroy.
     * Errors: its own. */
    enum lw_status (*package)(void *context, double density, const char **out_path, struct lw_error *err);
    void *context;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_cache_renderer_create(const struct lw_cache_renderer_desc *desc,
                                                      struct lw_renderer **out_renderer,
                                                      struct lw_error *err);

#endif
