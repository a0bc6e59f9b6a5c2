/* path_trace.h: the reference: light by tracing paths from the eye, with nothing cached between them.
 * Flow:    scene, trace, lights, pose, camera -> [path_trace] -> path_film
 * Threads: one thread at a time per lw_path_trace; works on several inside. Same seed, same bytes, at any
 *          number of threads and for any split of the samples over calls.
 * After:   Veach 1997 (multiple importance sampling, power heuristic); Burley 2020 (Owen-scrambled Sobol by
 *          hashing).
 *
 * It shares scene, rays and lights with the solve, and counts light as the solve does: visible emission,
 * direct light, and `bounces` orders of indirect light. Surfaces with a finish (scene.h) scatter light as
 * common/shading/lobes.h has it, about the normal of their map; bounce rays are drawn by the lobes. Without
 * one they are diffuse. Occlusion maps do not count: paths find what hides light. */
#ifndef LW_CLIENT_PATHS_PATH_TRACE_H
#define LW_CLIENT_PATHS_PATH_TRACE_H

#include "client/paths/gbuffer.h"
#include "client/paths/guide.h"
#include "client/paths/path_film.h"
#include "common/light/lights.h"
#include "common/trace/trace.h"

#include <stdatomic.h>

#define LW_PATH_TRACE_BOUNCES_MAX 64u
/* BLEND surfaces along one ray from the eye; the last one counts as opaque */
#define LW_PATH_TRACE_LAYERS_MAX 16u

enum lw_path_pixel {
    LW_PATH_PIXEL_BOX,   /* a pixel is the mean over its square */
    LW_PATH_PIXEL_CENTRE /* it is what its centre sees, as compose.h has it */
};

/** Estimators of light from surfaces and sky. All have the same mean. */
enum lw_path_method {
    LW_PATH_METHOD_BOTH,  /* by lamps and by bounce rays, weighed by the power heuristic */
    LW_PATH_METHOD_LAMPS, /* by rays towards lamps alone */
    LW_PATH_METHOD_BOUNCE /* by bounce rays that meet them; point, spot and directional lights as in LAMPS */
};

/** Parts of light. Direct and indirect add up to all. */
enum lw_path_part {
    LW_PATH_PART_ALL,
    LW_PATH_PART_DIRECT,  /* visible emission, and light of lamps and sky on visible surfaces */
    LW_PATH_PART_INDIRECT /* light that reaches visible surfaces by bounces */
};

/** Groups of 16 pixels that share random numbers, so that their rays run parallel. */
enum lw_path_pattern {
    LW_PATH_PATTERN_SQUARE, /* 4 x 4 neighbours: the fastest, for pictures of many samples */
    /* Every 4th pixel of 16 x 16, in both directions. Neighbours differ, and 4 x 4 of them are stratified as
     * a whole, so that a filter over a few pixels averages better samples (Keller and Heidrich 2001). */
    LW_PATH_PATTERN_INTERLEAVED
};

struct lw_path_trace_desc {
    const struct lw_scene *scene;
    const struct lw_trace *trace; /* the same scene's, at the pose of each render */
    const struct lw_lights *lights;
    const struct lw_pose *pose;
    unsigned threads; /* 0: all */
};

struct lw_path_trace;

/** The objects that desc points to must outlive it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_path_trace_create(const struct lw_path_trace_desc *desc,
                                                  struct lw_path_trace **out_tracer, struct lw_error *err);
void lw_path_trace_destroy(struct lw_path_trace *tracer);

/** Takes another pose, to which trace and lights have been set. */
void lw_path_trace_set_pose(struct lw_path_trace *tracer, const struct lw_pose *pose);

/** The part of a picture that a film holds: from pixel (x, y) on, as wide and high as the film, of
 * width x height pixels. Its samples are those of the same pixels of the whole picture: byte for byte where
 * the part begins at multiples of 16 and ends at such or with the picture. Elsewhere rays travel in other
 * packets, and a hit may round differently. All zero: the film is the whole picture. */
struct lw_path_crop {
    uint32_t x, y, width, height;
};

struct lw_path_view {
    struct lw_camera_view camera;
    struct lw_path_crop crop;
    uint32_t bounces; /* orders of indirect light; up to LW_PATH_TRACE_BOUNCES_MAX */
    uint32_t seed;
    uint32_t first_sample; /* in the sequences: to go on where an earlier picture of the same seed ended */
    enum lw_path_pixel pixel;
    enum lw_path_method method;
    enum lw_path_pattern pattern;
    enum lw_path_part part;
    /* At first hits a sample and a shadow ray for each light or group of lights (direct16.h), in place of one
     * sample of all lights. Emission that bounce rays from there meet then does not count. First hits that
     * mirror, or have a normal map, keep to `method`: shadow rays alone do not find a lamp in a mirror. */
    bool all_lights;
    /* The most luminance, W/(m^2 sr), that one path may bring from beyond its first hit; a lamp in a mirror
     * there counts as the first hit's. Brighter paths are
     * scaled down to it: less noise by a few bright paths, and some light is lost. 0: no limit. */
    float clamp;
    /* First hits of the whole picture, already traced with the same pose and camera. Rays from the eye are
     * traced only for pixels that show several surfaces, or one that is not even (gbuffer.h), and for those
     * that share random numbers with them. A pixel is then its centre. NULL: none. */
    const struct lw_gbuffer *first_hits;
    /* Bounce rays follow the guide and report their radiance to it. Mirrored rays and the last bounce do not.
     * A render draws them all by what the guide learned before. Between renders lw_guide_learn() takes the
     * reports: then the samples of later renders depend on where it was called. NULL: cosine-weighted rays
     * alone. */
    struct lw_guide *guide;
    const _Atomic bool *cancel; /* may be NULL; once true, a render ends within some milliseconds */
};

struct lw_path_count {
    uint64_t paths, rays_primary, rays_shadow, rays_bounce;
};

/** Adds `samples` paths to every pixel of a film, which lies within the whole picture. Returns
 * false if it was cancelled: then some pixels of the film have their samples and others do not, and
 * film->samples and count are as they were.
 *
 * count   may be NULL; added to
 * Errors  none; a sample that is not finite counts as black
 * Cost    no allocation */
bool lw_path_trace_render(const struct lw_path_trace *tracer, const struct lw_path_view *view,
                          uint32_t samples, struct lw_path_film *film, struct lw_path_count *count);

#endif
