/* renderer.h: the interface of both sides of a comparison: a path tracer per user, and the shared cache.
 * Flow:    setting -> [renderer: frame by frame, for all users] -> CPU time by stage, pictures
 * Threads: one thread calls; a renderer uses several inside. */
#ifndef LW_CLIENT_MEASURE_SIDES_RENDERER_H
#define LW_CLIENT_MEASURE_SIDES_RENDERER_H

#include "client/camera/camera.h"
#include "client/measure/sides/scene_densities.h"

#include <stdint.h>

/* CPU time by stage: tag, name, whether each user pays it */
#define LW_STAGE_MAP(X)                                                                                      \
    X(SOLVE, "solve", false)                                                                                 \
    X(ENCODE, "encode", false)                                                                               \
    X(BETWEEN, "between frames", false)                                                                      \
    X(SEND, "send", true)                                                                                    \
    X(RECEIVE, "receive", true)                                                                              \
    X(DECODE, "decode", true)                                                                                \
    X(COMPOSE, "compose", true)                                                                              \
    X(TRACE, "trace paths", true)                                                                            \
    X(FILTER, "filter", true)

enum lw_stage {
#define X(tag, name, per_user) LW_STAGE_##tag,
    LW_STAGE_MAP(X)
#undef X
        LW_STAGE_COUNT
};

const char *lw_stage_name(enum lw_stage stage);
bool lw_stage_is_per_user(enum lw_stage stage);

/** CPU seconds of all threads and processes of a side. */
struct lw_cost {
    double cpu_s[LW_STAGE_COUNT];
    double rays, bytes; /* rays of the solve; bytes received by all users */
};
void lw_cost_add(struct lw_cost *sum, const struct lw_cost *cost, double times);
double lw_cost_total(const struct lw_cost *cost);

/** A user's camera in a frame. Frames count from 1; scene time is (frame - 1) / 30 s. */
struct lw_renderer_cameras {
    const void *context;
    struct lw_camera_view (*at)(const void *context, uint32_t user, uint64_t frame);
};

/** Describes a side. Each side reads its own fields. All pointers outlive it. */
struct lw_renderer_desc {
    struct lw_scene_densities *densities;
    struct lw_renderer_cameras cameras;
    uint32_t width, height; /* pixels */
    uint32_t stride;        /* picture() gives a lattice of it (lattice.h) */
    uint32_t bounces;
    unsigned threads; /* 0: all */
    /* Neither scene nor views move. Path renderers without a history then add up samples from frame to frame,
     * up to `samples`. */
    bool still;
    bool denoise;       /* cache: lightmaps are filtered */
    const char *solver; /* cache: by name; NULL: the default */
};

/** Cost of a side's pictures. Each side reads its own fields. */
struct lw_setting {
    uint32_t samples;                          /* path tracer: paths per pixel and frame */
    double density;                            /* cache: texels per metre over the scene's default */
    uint32_t direct_samples, indirect_samples; /* cache: per texel and frame */
    double target_error;                       /* cache: blocks converge at this error */
    bool draws; /* cache: users draw the direct light of client lights (client_lights.h) */
    bool by_gl; /* cache: users draw by OpenGL, not by rays */
    bool whole; /* cache: light the whole scene, not only the interest set and its contributors */
};

struct lw_renderer;

struct lw_renderer_ops {
    const char *name;
    /** Starts a sequence at frame 0, with no users and nothing cached.
     * lattice: only every stride-th pixel counts. A side may leave out the rest; costs then mean nothing. */
    enum lw_status (*start)(struct lw_renderer *renderer, const struct lw_setting *setting, bool lattice,
                            uint32_t seed, struct lw_error *err);
    /** Lets users join or leave until there are `users`. If the number does not grow, the users that stay
     * clear their interest, since each may have another eye from here on. */
    enum lw_status (*set_users)(struct lw_renderer *renderer, uint32_t users, struct lw_error *err);
    /** Advances to a frame and shows it to some of the users. It is the next frame, unless the side keeps
     * nothing between frames. The cost per user is scaled from the users shown to all users. Adds to
     * *cost. */
    enum lw_status (*step)(struct lw_renderer *renderer, uint64_t frame, const uint32_t *shown,
                           uint32_t shown_count, struct lw_cost *cost, struct lw_error *err);
    /** The lattice of the picture that user shown[index] saw in the last step. */
    void (*picture)(const struct lw_renderer *renderer, uint32_t index, float *out_lattice);
    /** CPU seconds of the side's other processes since start(), and their peak memory in bytes; 0 of a
     * process that has ended. NULL: it has no other process. */
    void (*elsewhere)(const struct lw_renderer *renderer, double *out_cpu_s, double *out_bytes);
    void (*stop)(struct lw_renderer *renderer);
    void (*destroy)(struct lw_renderer *renderer);
};

struct lw_renderer {
    const struct lw_renderer_ops *ops;
    /* The number of frames to step through before a picture is what a user would see; UINT32_MAX: all
     * frames. */
    uint32_t history;
    bool keeps; /* a picture uses earlier ones: the same users must be shown in every frame */
};

#endif
