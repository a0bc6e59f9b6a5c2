/* gbuffer.h: first hits, pixel by pixel: surfaces without their light.
 * Flow:    scene, trace, pose, camera -> [gbuffer] -> svgf
 * Threads: one thread at a time per lw_gbuffer; renders on several inside. Same inputs, same bytes, at any
 * number.
 *
 * Rays go through the centres of pixels, as in compose.h and path_trace.h (LW_PATH_PIXEL_CENTRE), so that
 *     radiance = albedo x E/pi + emission
 * holds for the mean of the path tracer's samples. BLEND surfaces are blended front to back: albedo and
 * emission are sums over all layers and the sky behind them, the rest belongs to the layer that weighs most.
 * Where there is one layer and it is even, paths may start from here instead of the eye (path_trace.h,
 * first_hits).
 *
 * A surface that mirrors or has a normal map has the map's normal. Its albedo is its reflectance of even
 * light towards the eye, diffuse and mirrored. */
#ifndef LW_CLIENT_PATHS_GBUFFER_H
#define LW_CLIENT_PATHS_GBUFFER_H

#include "client/camera/camera.h"
#include "client/camera/place.h"

/** Planes of width * height values each, row 0 on top. */
struct lw_gbuffer_planes {
    /* LW_TRACE_MISS: no surface, or none that reflects; then only albedo and emission count */
    uint32_t *object;
    float *depth; /* inverse, 1/m, along the camera's forward; 0 where nothing is met */
    /* slope of that inverse on the tangent plane, per pixel to the right and down: exact for flat surfaces */
    float *slope[2];
    /* how many pixels' breadth off the tangent plane a point is, per 1/m off its inverse depth; m */
    float *apart;
    float *normal[3]; /* unit shading normal, world space, on the side that is seen */
    float *albedo[3];
    float *emission[3]; /* W/(m^2 sr) */
    float *before[3];   /* where the point was in the render before this one, world space, m */
    float *origin[3];   /* where shadow and bounce rays start: the point, lifted off its surface, m */
};

/** A pixel's value of three planes. */
static inline struct lw_vec3 lw_gbuffer_load3(float *const plane[3], size_t at) {
    return lw_vec3(plane[0][at], plane[1][at], plane[2][at]);
}

/** Pixels of a picture that it has: every step-th, both ways, from (x, y) on. step 0: all of them. */
struct lw_gbuffer_lattice {
    uint32_t step, x, y;
    uint32_t width, height; /* the picture's */
};

struct lw_gbuffer {
    uint32_t width, height;
    struct lw_gbuffer_lattice lattice;
    struct lw_camera_view camera; /* the last render's */
    bool still;                   /* nothing has changed since the render before: camera, objects, lights */
    struct lw_gbuffer_planes plane;
    uint8_t
        *from_eye; /* 1: paths start at the eye: there is more than one surface, or one that is not even */

    /* inside */
    const struct lw_scene *scene;
    const struct lw_trace *trace;
    int threads;
    bool started;
    struct lw_gbuffer_place {
        struct lw_place now;
        struct lw_affine before;
        bool moved;
    } * place;                    /* per object */
    struct lw_light_state *light; /* the last render's */
    float *memory;                /* holds the planes of floats */
};

struct lw_gbuffer_desc {
    const struct lw_scene *scene;
    const struct lw_trace *trace; /* the same scene's, at the pose of each render */
    uint32_t width, height;       /* pixels */
    unsigned threads;             /* 0: all */
};

/** The objects that desc points to must outlive it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gbuffer_init(struct lw_gbuffer *gbuffer, const struct lw_gbuffer_desc *desc,
                                             struct lw_error *err);
/** A zeroed one is fine. */
void lw_gbuffer_finish(struct lw_gbuffer *gbuffer);

/** One for every step-th pixel of pictures of full->width x full->height, for lw_gbuffer_thin() alone.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gbuffer_init_thin(struct lw_gbuffer *thin, const struct lw_gbuffer *full,
                                                  uint32_t step, struct lw_error *err);

/** Takes every step-th pixel of the last render of `full`, from (x, y) on; both under step. Lattice pixels
 * beyond the picture's edge repeat its last. */
void lw_gbuffer_thin(struct lw_gbuffer *thin, const struct lw_gbuffer *full, uint32_t x, uint32_t y);

/** The picture plane by which pixel (i, j) is seen through (i + 0.5, j + 0.5), on a lattice as well. */
struct lw_camera_plane lw_gbuffer_aim(const struct lw_gbuffer *gbuffer);

/** Fills the planes. `before` is by the pose of the previous call; in the first one, nothing has moved. */
void lw_gbuffer_render(struct lw_gbuffer *gbuffer, const struct lw_pose *pose,
                       const struct lw_camera_view *camera);

#endif
