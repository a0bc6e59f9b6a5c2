/* path_renderer.h: moving pictures by paths from the eye, as other renderers make them: raw, accumulated over
 * time, filtered.
 * Flow:    scene, pose, camera -> [path_renderer: path_trace, gbuffer, svgf, instant_radiosity] -> radiance
 *          of a frame
 * Threads: one thread at a time per renderer; works on several inside. Same inputs, same bytes, at any
 * number.
 *
 * The shared cache is measured against them (docs/lab/crossover.md), so each is as strong as we can make
 * it. Rays go through the centres of pixels. */
#ifndef LW_CLIENT_PATHS_PATH_RENDERER_H
#define LW_CLIENT_PATHS_PATH_RENDERER_H

#include "client/paths/instant_radiosity.h"
#include "client/paths/path_trace.h"

/* tag, short name, description. From LIGHTS on, each traces a shadow ray to each light or group of lights at
 * first hits. Light that a path brings from beyond its first hit is clamped to ten times the picture's
 * mean. */
#define LW_PATH_RENDERER_MAP(X)                                                                              \
    X(RAW, "raw", "paths as they are: one sample of all lights at each vertex")                              \
    X(LIGHTS, "lights", "all lights at first hits, a clamp")                                                 \
    X(REPROJECTED, "reprojected", "lights, and histories of up to 32 frames, longer where nothing moves")    \
    X(SVGF, "svgf", "lights, and SVGF over time and picture")                                                \
    X(SVGF_QUARTER, "svgf-quarter", "svgf, bounces for a quarter of the pixels with guided upsampling")      \
    X(VPL, "vpl", "svgf for light of lamps; bounces by the user's own virtual point lights")

enum lw_path_renderer_kind {
#define X(tag, name, about) LW_PATH_RENDERER_##tag,
    LW_PATH_RENDERER_MAP(X)
#undef X
        LW_PATH_RENDERER_COUNT
};

const char *lw_path_renderer_name(enum lw_path_renderer_kind kind);
const char *lw_path_renderer_about(enum lw_path_renderer_kind kind);
/** Whether the renderer has a history: a frame's picture builds on those before. */
bool lw_path_renderer_remembers(enum lw_path_renderer_kind kind);

struct lw_path_renderer_desc {
    enum lw_path_renderer_kind kind;
    const struct lw_scene *scene;
    const struct lw_trace *trace;       /* the same scene's, at the pose of each frame */
    const struct lw_path_trace *tracer; /* the same scene's, at that pose */
    const struct lw_lights *lights;     /* the same scene's, at that pose; for VPL */
    uint32_t width, height;             /* pixels */
    uint32_t bounces;                   /* orders of indirect light */
    unsigned threads;                   /* 0: all; for filters. Paths have the tracer's threads */
    struct lw_instant_radiosity_terms vpl;
};

struct lw_path_renderer;

/** The objects that desc points to must outlive it. Errors: LW_NO_MEMORY; LW_USAGE: desc->vpl
 * (instant_radiosity.h). */
LW_MUST_CHECK enum lw_status lw_path_renderer_create(const struct lw_path_renderer_desc *desc,
                                                     struct lw_path_renderer **out_renderer,
                                                     struct lw_error *err);
void lw_path_renderer_destroy(struct lw_path_renderer *renderer);

struct lw_path_frame {
    const struct lw_pose *pose;
    struct lw_camera_view camera;
    uint32_t samples; /* paths per pixel that this frame adds. SVGF_QUARTER: for a quarter of the pixels. VPL:
                         * of light of lamps */
    uint32_t seed;    /* for renderers with a history: the same in all frames */
    uint32_t number;  /* the frame's, from 0 */
    bool still;       /* nothing has moved since the last frame: renderers without a history add up samples */
};

/** CPU seconds of a frame, all threads, and the rays that it took. */
struct lw_path_frame_cost {
    double trace_s, filter_s;
    uint64_t rays; /* to first hits, towards lights and of bounces; a first hit that is shared counts once */
};

/** Renders a frame.
 * out_cost  may be NULL; added to
 * Returns   width * height * 3 floats, W/(m^2 sr), until the next call */
const float *lw_path_renderer_frame(struct lw_path_renderer *renderer, const struct lw_path_frame *frame,
                                    struct lw_path_frame_cost *out_cost);

/** VPL: nearer than this a virtual light is not brighter, m; known from the first frame on. Else 0. */
float lw_path_renderer_near_m(const struct lw_path_renderer *renderer);

/** Samples per pixel in the last picture, where nothing moves and the renderer has no history. */
uint32_t lw_path_renderer_samples(const struct lw_path_renderer *renderer);

#endif
