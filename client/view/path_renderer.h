/* path_renderer.h: moving pictures by paths from the eye, in the ways in which people render them: raw, over
 * time, filtered.
 * Flow:    scene, pose, camera -> [path_renderer: path_trace, gbuffer, svgf] -> radiance of a frame
 * Threads: one thread at a time per renderer; works on several inside. Same inputs, same bytes, at any
 * number.
 *
 * They are what the shared cache is measured against (docs/results/crossover.md), each as strong as we can
 * make it. Rays go through the centres of pixels. */
#ifndef LW_CLIENT_VIEW_PATH_RENDERER_H
#define LW_CLIENT_VIEW_PATH_RENDERER_H

#include "client/view/path_trace.h"

/* tag, short name, what it does. Each from LIGHTS on takes a shadow ray for each light or group of lights at
 * first hits and limits what a path brings from beyond them to ten times the picture's mean. */
#define LW_PATH_RENDERER_MAP(X)                                                                              \
    X(RAW, "raw", "paths as they are: one sample of all lights at each vertex")                              \
    X(LIGHTS, "lights", "all lights at first hits, a clamp")                                                 \
    X(REPROJECTED, "reprojected", "lights, and histories of up to 32 frames, longer where nothing moves")    \
    X(SVGF, "svgf", "lights, and SVGF over time and picture")                                                \
    X(SVGF_QUARTER, "svgf-quarter", "svgf, bounces for a quarter of the pixels with guided upsampling")

enum lw_path_renderer_kind {
#define X(tag, name, about) LW_PATH_RENDERER_##tag,
    LW_PATH_RENDERER_MAP(X)
#undef X
        LW_PATH_RENDERER_COUNT
};

const char *lw_path_renderer_name(enum lw_path_renderer_kind kind);
const char *lw_path_renderer_about(enum lw_path_renderer_kind kind);
/** Whether a frame's picture builds on those before. */
bool lw_path_renderer_remembers(enum lw_path_renderer_kind kind);

struct lw_path_renderer_desc {
    enum lw_path_renderer_kind kind;
    const struct lw_scene *scene;
    const struct lw_trace *trace;       /* of the same scene, at the pose of each frame */
    const struct lw_path_trace *tracer; /* likewise */
    uint32_t width, height;             /* pixels */
    uint32_t bounces;                   /* of indirect light */
    unsigned threads;                   /* 0: all; of filters. Those of paths are the tracer's */
};

struct lw_path_renderer;

/** What desc points to must outlive it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_path_renderer_create(const struct lw_path_renderer_desc *desc,
                                                     struct lw_path_renderer **out_renderer,
                                                     struct lw_error *err);
void lw_path_renderer_destroy(struct lw_path_renderer *renderer);

struct lw_path_frame {
    const struct lw_pose *pose;
    struct lw_camera_view camera;
    uint32_t
        samples;   /* paths per pixel that this frame adds; bounces of a quarter, for as many of its pixels */
    uint32_t seed; /* of those that remember: the same in all frames */
    uint32_t number; /* of the frame, from 0 */
    bool resting; /* nothing has moved since the last frame: samples of those that do not remember add up */
};

/** CPU seconds of a frame, all threads. */
struct lw_path_frame_cost {
    double trace_s, filter_s;
};

/** Renders a frame.
 * out_cost  may be NULL; added to
 * Returns   width * height * 3 floats, W/(m^2 sr), until the next call */
const float *lw_path_renderer_frame(struct lw_path_renderer *renderer, const struct lw_path_frame *frame,
                                    struct lw_path_frame_cost *out_cost);

/** Samples of a pixel that the last picture is made of, where nothing moves and the renderer does not
 * remember. */
uint32_t lw_path_renderer_samples(const struct lw_path_renderer *renderer);

#endif
