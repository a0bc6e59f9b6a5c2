/* path_contender.h: the opponents: every user renders paths on a machine of his own (path_renderer.h).
 * Flow:    scene, views -> [path_contender] -> pictures, CPU time
 * Threads: as contender.h. */
#ifndef LW_CLIENT_LOAD_PATH_CONTENDER_H
#define LW_CLIENT_LOAD_PATH_CONTENDER_H

#include "client/load/contender.h"
#include "client/view/path_renderer.h"

struct lw_path_contender_desc {
    const struct lw_scene *scene;
    struct lw_contender_cameras cameras;
    uint32_t width, height, stride, bounces;
    unsigned threads; /* 0: all */
    enum lw_path_renderer_kind kind;
    /* Nothing moves, neither scene nor views: samples of renderers that do not remember add up from frame to
     * frame until there are `samples` of them. */
    bool rests;
};

/** Errors: LW_NO_MEMORY, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_path_contender_create(const struct lw_path_contender_desc *desc,
                                                      struct lw_contender **out_contender,
                                                      struct lw_error *err);

#endif
