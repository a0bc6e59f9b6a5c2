/* path_contender.h: the opponent: every user traces paths on a machine of his own.
 * Flow:    scene, views -> [path_contender] -> pictures, CPU time
 * Threads: as contender.h. */
#ifndef LW_CLIENT_LOAD_PATH_CONTENDER_H
#define LW_CLIENT_LOAD_PATH_CONTENDER_H

#include "client/load/contender.h"
#include "client/load/views.h"

struct lw_path_contender_desc {
    const struct lw_scene *scene;
    const struct lw_views *views;
    uint32_t width, height, stride, bounces;
    unsigned threads; /* 0: all */
    /* Nothing moves, neither scene nor views: samples add up from frame to frame until there are `samples` of them. */
    bool rests;
    bool denoise; /* svgf.h over the path traced frames */
};

/** Errors: LW_NO_MEMORY, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_path_contender_create(const struct lw_path_contender_desc *desc,
                                                      struct lw_contender **out_contender,
                                                      struct lw_error *err);

#endif
