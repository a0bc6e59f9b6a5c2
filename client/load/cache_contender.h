/* cache_contender.h: our side: a lightwelld, and a client of liblightwell with a view of his own per user, on loopback.
 * Flow:    scene package, views -> [lightwelld, clients, compose] -> pictures, CPU time by stage
 * Threads: as contender.h.
 *
 * All clients are real: they receive and decode. They share one copy of the scene and one structure for rays, since they
 * live in one process; what each would spend on moving that is counted for each. */
#ifndef LW_CLIENT_LOAD_CACHE_CONTENDER_H
#define LW_CLIENT_LOAD_CACHE_CONTENDER_H

#include "client/load/contender.h"

struct lw_cache_contender_desc {
    struct lw_contender_cameras cameras;
    uint32_t width, height, stride, bounces;
    unsigned threads; /* 0: all */
    bool denoise;
    const char *solver; /* by name; NULL: the default */
    /* The path of a scene package whose lightmap is so many times as dense as the default; good until destroy.
     * Errors: its own. */
    enum lw_status (*package)(void *context, double density, const char **out_path, struct lw_error *err);
    void *context;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_cache_contender_create(const struct lw_cache_contender_desc *desc,
                                                       struct lw_contender **out_contender,
                                                       struct lw_error *err);

#endif
