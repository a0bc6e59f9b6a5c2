/* camera.h: where the eye is, where it looks, and the rays through its pixels.
 * Flow:    option text, scene camera or bounds -> [camera] -> rays for compose
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_CAMERA_CAMERA_H
#define LW_CLIENT_CAMERA_CAMERA_H

#include "common/scene/pose.h"
#include "common/scene/scene.h"
#include "common/trace/trace.h"

/** A camera in world space; right, up and forward are unit and orthogonal. A pinhole camera, or an
 * orthographic one, whose rays are all along `forward` and start in the plane of its position. */
struct lw_camera_view {
    struct lw_vec3 position, right, up, forward;
    float fov_y;    /* radians, in (0, pi) */
    float height_m; /* orthographic: of the seen area; 0: a pinhole camera */
};

/** A camera at a place that looks at another, upright (+Y) unless it looks straight up or down. */
struct lw_camera_view lw_camera_look_at(struct lw_vec3 position, struct lw_vec3 target, float fov_y);

/** Reads "px,py,pz:tx,ty,tz:fov_y_deg", metres and degrees; "px,py,pz:tx,ty,tz:10m" is orthographic, 10 m
 * high.
 * Errors: LW_USAGE naming the part that is wrong. */
LW_MUST_CHECK enum lw_status lw_camera_parse(const char *text, struct lw_camera_view *out_view,
                                             struct lw_error *err);

/** Writes a view as lw_camera_parse() reads it; it is upright then. */
#define LW_CAMERA_TEXT_SIZE 160
void lw_camera_format(const struct lw_camera_view *view, char out[LW_CAMERA_TEXT_SIZE]);

/** A camera of the scene, where the pose has it. */
struct lw_camera_view lw_camera_of_scene(const struct lw_scene *scene, const struct lw_pose *pose,
                                         uint32_t camera);

/** Index of the scene's camera of that name.
 * Errors: LW_USAGE, listing the names there are. */
LW_MUST_CHECK enum lw_status lw_camera_find(const struct lw_scene *scene, const char *name,
                                            uint32_t *out_camera, struct lw_error *err);

/** The picture plane at depth 1: what a ray takes, worked out once per picture. */
struct lw_camera_plane {
    struct lw_vec3 middle, right, up;  /* direction of the middle, one pixel to the right, one pixel up */
    struct lw_vec3 eye, across, along; /* origin, likewise */
    float half_width, half_height;     /* pixels */
    float pixel;                       /* side of a pixel */
    bool parallel;                     /* orthographic: pixels are as large at every depth */
};
struct lw_camera_plane lw_camera_plane(const struct lw_camera_view *view, uint32_t width, uint32_t height);

/** Direction of the ray through (x, y) in pixels from the upper left corner; the centre of the first pixel is
 * (0.5, 0.5). Not unit: its component along `forward` is 1, so that a hit's t is its depth. */
static inline struct lw_vec3 lw_camera_direction(const struct lw_camera_plane *plane, float x, float y) {
    struct lw_vec3 across = lw_vec3_mad(plane->middle, plane->right, x - plane->half_width);
    return lw_vec3_mad(across, plane->up, plane->half_height - y);
}

/** Origin of that ray. */
static inline struct lw_vec3 lw_camera_origin(const struct lw_camera_plane *plane, float x, float y) {
    struct lw_vec3 across = lw_vec3_mad(plane->eye, plane->across, x - plane->half_width);
    return lw_vec3_mad(across, plane->along, plane->half_height - y);
}

/** Side of a pixel at a depth, m. */
static inline float lw_camera_pixel_at(const struct lw_camera_plane *plane, float depth) {
    return plane->parallel ? plane->pixel : depth * plane->pixel;
}

#endif
