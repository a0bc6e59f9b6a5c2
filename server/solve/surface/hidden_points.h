/* hidden_points.h: which of a texel's sample points light cannot reach.
 * Flow:    texels of an object, rays' structure -> [hidden_points] -> usable points -> invalid_texels
 * Threads: [any], each with texels of its own.
 *
 * Hundreds of texels are asked about at once: most of their points stand free, and a ray or two says so.
 * The points that are left after each ray move together, so that packets stay full. */
#ifndef LW_SURFACE_HIDDEN_POINTS_H
#define LW_SURFACE_HIDDEN_POINTS_H

#include "common/scene/pose.h"
#include "common/trace/trace.h"
#include "server/solve/surface/texels.h"

#define LW_HIDDEN_POINTS_TEXELS 512u /* in a call, at most */
#define LW_HIDDEN_POINTS_RAYS   8u   /* directions that are looked in */
/* Texels beside a wall that its back may darken: a look-up at level 2 reads as far. */
#define LW_HIDDEN_POINTS_RIM 4.0f
/* A texel whose surroundings are clear this many texel sizes around it is searched no further; double-sided
 * solids are looked for as far. */
#define LW_HIDDEN_POINTS_CLEAR 2

struct lw_hidden_points_search {
    const struct lw_texels *texels;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
    float near_m; /* backs that are farther away hide only points beside a wall */
    float far_m;  /* beyond all of the scene */
};

/** Direction r of LW_HIDDEN_POINTS_RAYS, cosine-weighted about a normal that is z; unit. */
struct lw_vec3 lw_hidden_points_direction(uint32_t r);

/** Takes points that light cannot reach out of the masks of some of an object's texels.
 * texel   within the object; count: up to LW_HIDDEN_POINTS_TEXELS
 * usable  per texel: its points that are asked about; afterwards those that are left, maybe none */
void lw_hidden_points_find(const struct lw_hidden_points_search *search, uint32_t object,
                           const uint32_t *texel, uint32_t count, uint8_t *usable);

#endif
