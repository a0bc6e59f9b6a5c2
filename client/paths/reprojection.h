/* reprojection.h: the pixel of the previous picture that shows a point, and whether its history holds for the
 * point.
 * Flow:    gbuffers of two frames -> [reprojection] -> svgf, instant_radiosity
 * Threads: values, [any]. */
#ifndef LW_CLIENT_PATHS_REPROJECTION_H
#define LW_CLIENT_PATHS_REPROJECTION_H

#include "client/paths/gbuffer.h"

/* Limits within which a pixel's history holds for a point: distance off the tangent plane in widths of a
 * pixel, cosine of normals. */
#define LW_REPROJECTION_APART_MAX 2.0f
#define LW_REPROJECTION_COSINE_MIN                                                                           \
    0.5f /* 0.9 forgot what small things looked like: 16 % more error in the atrium */

/** The picture before. */
struct lw_reprojection {
    uint32_t width, height;
    struct lw_camera_view camera;
    struct lw_camera_plane aim;
};

static inline struct lw_reprojection lw_reprojection_of(const struct lw_gbuffer *g) {
    return (struct lw_reprojection){g->width, g->height, g->camera, lw_gbuffer_aim(g)};
}

/** Place of a point in the picture: pixels, and its inverse depth. */
static inline bool lw_reprojection_find(const struct lw_reprojection *before, struct lw_vec3 point,
                                        float *out_x, float *out_y, float *out_depth) {
    const struct lw_camera_view *c = &before->camera;
    struct lw_vec3 away = lw_vec3_sub(point, c->position);
    const float z = lw_vec3_dot(away, c->forward);
    if (!(z > 0)) return false;
    const float scale = 1 / lw_camera_pixel_at(&before->aim, z);
    *out_x = before->aim.half_width + lw_vec3_dot(away, c->right) * scale - 0.5f;
    *out_y = before->aim.half_height - lw_vec3_dot(away, c->up) * scale - 0.5f;
    *out_depth = 1 / z;
    return *out_x > -1 && *out_y > -1 && *out_x < (float)before->width && *out_y < (float)before->height;
}

/** Planes that identify a pixel's surface, as in struct lw_gbuffer_planes. */
struct lw_reprojection_surface {
    uint32_t object;
    float depth, slope[2], apart;
    float normal[3];
};

static inline struct lw_reprojection_surface lw_reprojection_surface_of(const struct lw_gbuffer_planes *g,
                                                                        size_t at) {
    return (struct lw_reprojection_surface){g->object[at],
                                            g->depth[at],
                                            {g->slope[0][at], g->slope[1][at]},
                                            g->apart[at],
                                            {g->normal[0][at], g->normal[1][at], g->normal[2][at]}};
}

/** Whether a pixel's surface is that of a point, (dx, dy) pixels from it, at an inverse depth. */
static inline bool lw_reprojection_serves(const struct lw_reprojection_surface *past, float dx, float dy,
                                          float depth, uint32_t object, struct lw_vec3 normal) {
    if (past->object != object) return false;
    const float off = depth - past->depth - past->slope[0] * dx - past->slope[1] * dy;
    const float cosine = past->normal[0] * normal.x + past->normal[1] * normal.y + past->normal[2] * normal.z;
    return fabsf(off) * past->apart <= LW_REPROJECTION_APART_MAX && cosine >= LW_REPROJECTION_COSINE_MIN;
}

#endif
