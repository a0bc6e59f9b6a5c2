/* renderer.h: the interface of both sides of the comparison: a path tracer per user, and the shared cache.
 * Flow:    setting -> [renderer: frame by frame, for all users] -> CPU time by stage, pictures
 * Threads: one thread calls; a renderer works on several inside. */
#ifndef LW_CLIENT_MEASURE_RENDERER_H
#define LW_CLIENT_MEASURE_RENDERER_H

#include "client/view/camera.h"
#include "common/status.h"

#include <stdint.h>

/* Where CPU time goes. name, whether every user pays it anew */
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
    double rays, bytes; /* of the solve; received by all users */
};
void lw_cost_add(struct lw_cost *sum, const struct lw_cost *cost, double times);
double lw_cost_total(const struct lw_cost *cost);

/** Where a user's eye is in a frame. Frames count from 1; scene time is (frame - 1) / 30 s. */
struct lw_renderer_cameras {
    const void *context;
    struct lw_camera_view (*at)(const void *context, uint32_t user, uint64_t frame);
};

/** How much a side spends on its pictures. A side reads what is its own. */
struct lw_setting {
    uint32_t samples; /* path tracer: paths per pixel and frame */
    double density;   /* cache: lightmap texels per length, times the scene's default */
    uint32_t direct_samples, indirect_samples; /* cache: per texel and frame */
    double rest_error;                         /* cache: at which a tile rests */
    bool draws; /* cache: users draw the direct light of client lights (client_lights.h) */
    bool whole; /* cache: all of the scene is lit, not what is looked at and what lights it */
};

struct lw_renderer;

struct lw_renderer_ops {
    const char *name;
    /** Begins a sequence at frame 0, with nothing cached and nobody there.
     * lattice: only every stride-th pixel is worked out, where a side can leave out the rest; costs then
     * mean nothing. */
    enum lw_status (*start)(struct lw_renderer *renderer, const struct lw_setting *setting, bool lattice,
                            uint32_t seed, struct lw_error *err);
    /** Lets users join or leave until there are `users`. If no more than before, those who stay forget
     * what they have
     * looked at: they may be another one's eye from now on. */
    enum lw_status (*set_users)(struct lw_renderer *renderer, uint32_t users, struct lw_error *err);
    /** Advances to a frame, the next one unless the side forgets all from frame to frame, and shows it to
     * some of the
     * users; what every user costs is scaled from those to all of them. Adds to *cost. */
    enum lw_status (*step)(struct lw_renderer *renderer, uint64_t frame, const uint32_t *shown,
                           uint32_t shown_count, struct lw_cost *cost, struct lw_error *err);
    /** The lattice of the picture that shown[index] saw in the last step. */
    void (*picture)(const struct lw_renderer *renderer, uint32_t index, float *out_lattice);
    /** CPU seconds that its other processes have spent since start(), and the most memory that they held,
     * bytes; 0 of one
     * that is gone. NULL: it has none. */
    void (*elsewhere)(const struct lw_renderer *renderer, double *out_cpu_s, double *out_bytes);
    void (*stop)(struct lw_renderer *renderer);
    void (*destroy)(struct lw_renderer *renderer);
};

struct lw_renderer {
    const struct lw_renderer_ops *ops;
    /* Frames before a picture that must have been stepped through for it to be what a user sees; UINT32_MAX:
     * all. */
    uint32_t history;
    bool keeps; /* pictures build on those before: the same users must be shown in every frame */
};

#endif
