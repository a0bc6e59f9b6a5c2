/* instant_radiosity.h: the light that bounces bring to a user's pixels, by virtual point lights.
 * Flow:    gbuffer, pose -> [shot_lights; shade; filter; sum of sets] -> radiance added to a picture
 * Threads: one thread at a time; works on several inside. Same inputs, same bytes, at any number.
 * After:   Keller 1997; Keller and Heidrich 2001 (interleaved sampling); Tonna 2019 (temporal sets).
 *
 *   E = sum over lights j of flux_j V_j cos cos_j / (pi max(r^2, d0^2))
 *
 *   shade     a frame takes one of T sets of lights; each pixel of 4 x 4 a sixteenth of it. Sixteen
 *             pixels of one kind, every 4th both ways, meet a light in one packet of rays
 *   filter    each pixel has the mean of those of 4 x 4 around it on its surface, by depth and normal
 *   sets      each set's light is brought along from picture to picture; a pixel has the sum of all sets
 *   albedo    last
 *
 * The light that d0 cuts off, mostly in corners, is lost. */
#ifndef LW_CLIENT_PATHS_INSTANT_RADIOSITY_H
#define LW_CLIENT_PATHS_INSTANT_RADIOSITY_H

#include "client/paths/gbuffer.h"
#include "common/light/lights.h"

#define LW_INSTANT_RADIOSITY_LIGHTS_DEFAULT 512u
#define LW_INSTANT_RADIOSITY_LIGHTS_MAX     65536u
#define LW_INSTANT_RADIOSITY_SETS_DEFAULT   8u
#define LW_INSTANT_RADIOSITY_SETS_MAX       32u

/** Settings. Zeroed: the defaults. */
struct lw_instant_radiosity_terms {
    uint32_t lights, sets;
    float near_m; /* d0, m; 0: by the area of all surfaces (virtual_paths.h) */
};

struct lw_instant_radiosity_desc {
    const struct lw_scene *scene;
    const struct lw_trace *trace;   /* the same scene's, at the pose of each frame */
    const struct lw_lights *lights; /* the same scene's, at that pose */
    uint32_t width, height;         /* pixels */
    uint32_t bounces;
    unsigned threads; /* 0: all */
    struct lw_instant_radiosity_terms terms;
};

struct lw_instant_radiosity;

/** The objects that desc points to outlive it.
 * Errors: LW_NO_MEMORY; LW_USAGE: too many lights or sets, or fewer lights than sets times bounces. */
LW_MUST_CHECK enum lw_status lw_instant_radiosity_create(const struct lw_instant_radiosity_desc *desc,
                                                         struct lw_instant_radiosity **out,
                                                         struct lw_error *err);
void lw_instant_radiosity_destroy(struct lw_instant_radiosity *instant);

/** Shoots lights where anything has moved, and shades the frame's set.
 * gbuffer  of this frame, of the same size
 * seed     of where lights lie
 * number   of the frame: which set it takes
 * Returns  rays */
uint64_t lw_instant_radiosity_shade(struct lw_instant_radiosity *instant, const struct lw_gbuffer *gbuffer,
                                    const struct lw_pose *pose, uint32_t seed, uint32_t number);

/** Filters the shaded light, and adds albedo/pi E of all sets to a picture.
 * rgb  width * height * 3 floats, W/(m^2 sr) */
void lw_instant_radiosity_add(struct lw_instant_radiosity *instant, const struct lw_gbuffer *gbuffer,
                              float *rgb);

/** d0, m; known from the first frame on. */
float lw_instant_radiosity_near_m(const struct lw_instant_radiosity *instant);

#endif
