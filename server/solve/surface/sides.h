/* sides.h: which texel to read where walls stand on a surface: one on the same side as the reader.
 * Flow:    hit near a wall -> [sides] -> the texel whose light is read
 * Threads: [any].
 *
 * A texel's square may lie on several sides of what stands on it, but its light is that of one (crossings.h). A
 * ray that ends on another side reads the nearest texel that can be seen from just before its end. */
#ifndef LW_SURFACE_SIDES_H
#define LW_SURFACE_SIDES_H

#include "common/scene/pose.h"
#include "common/trace/trace.h"
#include "server/solve/surface/texels.h"

struct lw_sides {
    const struct lw_texels *texels;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
};

/** The texel (global index) to read for a ray that ends at origin + t dir, on the square of texel `under` (global index)
 * of an object; LW_TEXEL_NONE where no texel of its side is near. World space. Costs a ray, and sixteen more where that
 * meets a wall. */
uint32_t lw_sides_read(const struct lw_sides *sides, uint32_t object, uint32_t under, struct lw_vec3 origin,
                       struct lw_vec3 dir, float t);

#endif
