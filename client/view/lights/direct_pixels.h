/* direct_pixels.h: the client-drawn lights of a picture, ready for the points that its pixels see.
 * Flow:    scene, lights at the pose -> [direct_pixels] -> direct_tile
 * Threads: create and begin by one thread; while tiles are lit nothing changes.
 *
 * Nothing is kept from picture to picture. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_PIXELS_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_PIXELS_H

#include "common/light/client_lights.h"
#include "common/trace/trace.h"

struct lw_direct_pixels;

struct lw_direct_pixels_desc {
    const struct lw_scene *scene;
    const struct lw_trace *trace; /* the same scene's, at the pose of each picture */
    const struct lw_client_lights *drawn;
    int threads; /* for work on the picture as a whole */
};

/** Scene, trace and the arrays of `drawn` must outlive it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_direct_pixels_create(const struct lw_direct_pixels_desc *desc,
                                                     const struct lw_pose *pose,
                                                     struct lw_direct_pixels **out_direct,
                                                     struct lw_error *err);
void lw_direct_pixels_destroy(struct lw_direct_pixels *direct);

/** Gets ready for a picture: takes over lights, objects and emissive materials as they are now.
 * pose    must stay until the picture is done
 * white   mean irradiance of the seen surfaces, luminance, W/m^2: light of less than a thousandth of that
 *         may be left out
 * sample  index among the pictures that are averaged; each has random numbers of its own
 * If memory lacks after materials have changed, it draws no emitters. */
void lw_direct_pixels_begin(struct lw_direct_pixels *direct, const struct lw_pose *pose, float white,
                            uint32_t sample);

#endif
